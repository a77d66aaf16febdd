"""Settings of frames of reference, chosen from demonstrations: no unit or rate is presumed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from pacnet.attention.cutting import Size
from pacnet.core.validation import check_fields, is_integer, is_number
from pacnet.forward_models.config import AffineForwardModelConfig
from pacnet.schemas.body import BodyConfig
from pacnet.schemas.points import Point, Points
from pacnet.schemas.scene import pose_dimensions


@dataclass(frozen=True)
class FramesConfig:
    """How targets are kept in frames of reference.

    Attributes:
        points: which dimensions of a percept are points.
        size: how large the scene is, and how fast what the robot moves.
        smoothing: alpha and beta of each point; see `pacnet.schemas.smoothing`.
        others: the dimensions of a percept that are no points and changed in what was shown.
        ranges: the range of each of these in what was shown, > 0.
        forward_model: settings of the model that finds actions which move a pose; None with a body.
        body: says where the moved point is and finds postures that take it somewhere; None without.
        put_back: numbers of the landmarks that are put back where they stood; these places are the
            last of the points' landmarks, in this order.
    """

    points: Points
    size: Size
    smoothing: tuple[tuple[float, float], ...]
    others: tuple[int, ...]
    ranges: tuple[float, ...]
    forward_model: AffineForwardModelConfig | None
    body: BodyConfig | None = None
    put_back: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        """Turn the lists that JSON reads into tuples, and check the fields."""
        object.__setattr__(self, "size", Size(*self.size))
        object.__setattr__(self, "smoothing", tuple(map(tuple, self.smoothing)))
        for name in ("others", "ranges", "put_back"):
            object.__setattr__(self, name, tuple(getattr(self, name)))
        count, pose = len(self.points.names), len(pose_dimensions(self.points.moved))
        gains = [gain for pair in self.smoothing for gain in pair]
        pairs = [len(pair) for pair in self.smoothing] == [2] * count
        of_others = all(is_integer(one, 0) for one in self.others)
        differ = of_others and len({*self.others}) == len(self.others)
        apart = differ and not {*self.others} & {*self.points.used}
        ranges = all(is_number(one) and one > 0 for one in self.ranges)
        model, back = self.forward_model, self.put_back
        one_of_both = (model is None) != (self.body is None)
        states = pose if model is None else model.state_dimensions
        seen = len(self.perceived)
        parts = len(self.points.moved.place), len(self.points.moved.orientation)
        checks = {
            "size": (all(is_number(one) and one > 0 for one in self.size), "above 0"),
            "smoothing": (
                pairs and all(is_number(gain) and 0 <= gain <= 1 for gain in gains),
                f"as {count} pairs from 0 to 1",
            ),
            "others": (apart, "as different dimensions that are no points"),
            "ranges": (ranges and len(self.ranges) == len(self.others), "above 0, of the others"),
            "forward_model": (
                one_of_both and states == pose,
                f"of the {pose} dimensions of the moved point, or a body",
            ),
            "body": (
                self.body is None or parts == (3, 4),
                f"that tells place and quaternion of the moved point, which has {parts} dimensions",
            ),
            "put_back": (
                all(is_integer(one, 0) and one < seen for one in back)
                and len({*back}) == len(back),
                f"as different landmarks, of {seen}",
            ),
        }
        check_fields(self, checks)

    @property
    def perceived(self) -> tuple[Point, ...]:
        """The landmarks without the places where some stood."""
        landmarks = self.points.landmarks
        return landmarks[: len(landmarks) - len(self.put_back)]

    @property
    def parted(self) -> tuple[tuple[int, ...], tuple[int, ...]]:
        """Dimensions of points that are perceived, and of those that a percept implies."""
        perceived = [*self.perceived]
        implied = [*self.points.landmarks[len(perceived) :]]
        (perceived if self.body is None else implied).insert(0, self.points.moved)
        one, other = ([n for point in part for n in point.used] for part in (perceived, implied))
        return tuple(one), tuple(other)

    @property
    def added(self) -> tuple[str, ...]:
        """Names of what is appended to a percept; see `pacnet.schemas.percept_extension`."""
        hand, former = self.points.moved.name, self.points.landmarks[len(self.perceived) :]
        parts = ("x", "y", "z", "qw", "qx", "qy", "qz") if self.body is not None else ()
        names = [f"{hand}.{part}" for part in parts]
        for landmark in former:
            names += [f"{landmark.name}.{axis}" for axis in "xyz"[: len(landmark.place)]]
        return tuple(names)

    @classmethod
    def from_dict(cls, fields: dict[str, Any]) -> FramesConfig:
        """Return the settings that `dataclasses.asdict` turned into these fields, after JSON.

        Raises:
            ValueError: a field is missing, unknown or out of range.
        """
        try:
            points = Points.from_dict(fields["points"])
            model, body = fields["forward_model"], fields.get("body")
            parts = {
                "points": points,
                "forward_model": None if model is None else AffineForwardModelConfig(**model),
                "body": None if body is None else BodyConfig.from_dict(body),
            }
            return cls(**{**fields, **parts})
        except (KeyError, TypeError) as error:
            raise ValueError(f"expected the fields of FramesConfig, got {error!r}") from error
