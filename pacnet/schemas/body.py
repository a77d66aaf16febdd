"""A robot's body: which numbers of a percept and of an action are the angles of its joints."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from pacnet.core.validation import check_fields, is_integer
from pacnet.forward_models.config import KinematicModelConfig


@dataclass(frozen=True)
class BodyConfig:
    """Where the angles of a body are that says where its hand is.

    Attributes:
        model: of the body, with J joints.
        angles: the dimensions of the percept that are its angles [rad], `[J]`.
        commands: the dimensions of the action that are targets of these angles [rad], `[J]`.
    """

    model: KinematicModelConfig
    angles: tuple[int, ...]
    commands: tuple[int, ...]

    def __post_init__(self) -> None:
        """Turn the lists that JSON reads into tuples, and check the fields."""
        count = len(self.model.joints)
        for name in ("angles", "commands"):
            numbers = tuple(getattr(self, name))
            object.__setattr__(self, name, numbers)
            valid = all(is_integer(one, 0) for one in numbers) and len({*numbers}) == len(numbers)
            check_fields(
                self, {name: (valid and len(numbers) == count, f"as {count} different dimensions")}
            )

    @classmethod
    def from_dict(cls, fields: dict[str, Any]) -> BodyConfig:
        """Return the settings that `dataclasses.asdict` turned into these fields, after JSON.

        Raises:
            KeyError, TypeError: a field is missing or unknown.
            ValueError: a field is out of range.
        """
        return cls(**{**fields, "model": KinematicModelConfig(**fields["model"])})
