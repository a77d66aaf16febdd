"""Which dimensions of a percept are points: what the robot moves, and the landmarks about it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from pacnet.core.validation import check_fields, is_integer

ORIENTATIONS = {
    0: "none",
    1: "an angle [rad]; in three dimensions about the last axis",
    3: "a rotation vector [rad]",
    4: "a quaternion in the order w, x, y, z",
}
"""Number of dimensions of an orientation -> what they are."""


@dataclass(frozen=True)
class Point:
    """A place that is perceived, and which way it is turned.

    Attributes:
        name: of the point.
        place: the dimensions of the percept that are its coordinates, two or three.
        orientation: the dimensions that say how it is turned: one of `ORIENTATIONS`, in two
            dimensions an angle or none.
    """

    name: str
    place: tuple[int, ...]
    orientation: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        """Turn the lists that JSON reads into tuples, and check the fields."""
        for field in ("place", "orientation"):
            object.__setattr__(self, field, tuple(getattr(self, field)))
        turns = (0, 1) if len(self.place) == 2 else tuple(ORIENTATIONS)
        listed = " or ".join(map(str, turns))
        checks = {
            "name": (isinstance(self.name, str) and self.name.strip() != "", "as a name"),
            "place": (_are_dimensions(self.place, (2, 3)), "as 2 or 3 different dimensions"),
            "orientation": (
                _are_dimensions(self.orientation, turns),
                f"as {listed} different dimensions of a point in {len(self.place)}",
            ),
        }
        check_fields(self, checks)
        apart = not {*self.place} & {*self.orientation}
        check_fields(self, {"orientation": (apart, f"of other dimensions than {self.place}")})

    @property
    def used(self) -> tuple[int, ...]:
        """All its dimensions, those of the place first."""
        return self.place + self.orientation


@dataclass(frozen=True)
class Points:
    """The points of a percept: the one that the robot's actions move, and the landmarks.

    Iteration gives all of them, the moved one first.

    Attributes:
        moved: what the robot's actions move, such as a hand.
        landmarks: such as an object and a goal, one at least.
    """

    moved: Point
    landmarks: tuple[Point, ...]

    def __post_init__(self) -> None:
        """Turn the list that JSON reads into a tuple, and check the fields."""
        object.__setattr__(self, "landmarks", tuple(self.landmarks))
        check_fields(self, {"moved": (isinstance(self.moved, Point), "as a Point")})
        are_points = all(isinstance(point, Point) for point in self.landmarks)
        check_fields(self, {"landmarks": (are_points and self.landmarks != (), "as Points")})
        names, used, size = self.names, self.used, self.dimensions
        alike = all(len(point.place) == size for point in self.landmarks)
        for valid, wanted in (
            (alike, f"with places of {size} dimensions, as of {self.moved.name!r}"),
            (len(set(names)) == len(names), f"of different names, and another than {names[0]!r}"),
            (len(set(used)) == len(used), f"with different dimensions, none of {self.moved.used}"),
        ):
            check_fields(self, {"landmarks": (valid, wanted)})

    def __iter__(self) -> Iterator[Point]:
        """Iterate over all points, the moved one first."""
        return iter((self.moved, *self.landmarks))

    @property
    def dimensions(self) -> int:
        """Number of coordinates of each place, 2 or 3."""
        return len(self.moved.place)

    @property
    def used(self) -> tuple[int, ...]:
        """All dimensions of the percept that belong to a point, in the points' order."""
        return tuple(dimension for point in self for dimension in point.used)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the points, the moved one first."""
        return tuple(point.name for point in self)

    @classmethod
    def from_dict(cls, fields: dict[str, Any]) -> Points:
        """Return the points that `dataclasses.asdict` turned into these fields, after JSON.

        Raises:
            ValueError: a field is missing, unknown or out of range.
        """
        try:
            landmarks = tuple(Point(**landmark) for landmark in fields["landmarks"])
            return cls(**{**fields, "moved": Point(**fields["moved"]), "landmarks": landmarks})
        except (KeyError, TypeError) as error:
            raise ValueError(f"expected the fields of Points, got {error!r}") from error


def _are_dimensions(numbers: tuple[object, ...], lengths: tuple[int, ...]) -> bool:
    """Return whether these are different indices, as many as one of the lengths."""
    if len(numbers) not in lengths or not all(is_integer(number, 0) for number in numbers):
        return False
    return len(set(numbers)) == len(numbers)
