"""Settings of all cameras of an imitator."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from pacnet.core.validation import check_fields, is_integer
from pacnet.vision.config import ImageEncoderConfig
from pacnet.vision.goals import goal_names

CAMERAS = "cameras"
"""What the goals are called as a feature of a percept."""
_MOST_FRAMES = 1_000_000


@dataclass(frozen=True)
class CamerasConfig:
    """Which cameras tell an imitator where its hand will be.

    Attributes:
        features: the cameras, as their features are called.
        encoders: settings of each one's encoder.
        hand: names of the dimensions of what is told, such as x, y and z.
        at_once: looks of which the median is taken.
        until: frames after which the hand may be in the way, and nothing is looked for.
    """

    features: tuple[str, ...]
    encoders: tuple[ImageEncoderConfig, ...]
    hand: tuple[str, ...]
    at_once: int
    until: int

    def __post_init__(self) -> None:
        """Turn the lists that JSON reads into tuples, and check the fields."""
        for name in ("features", "encoders", "hand"):
            object.__setattr__(self, name, tuple(getattr(self, name)))
        names = [isinstance(name, str) and name != "" for name in (*self.features, *self.hand)]
        different = all(names) and len({*self.features}) == len(self.features) > 0
        outputs = len(goal_names(self.hand))
        encoders = [
            isinstance(one, ImageEncoderConfig) and one.outputs == outputs for one in self.encoders
        ]
        frames = is_integer(self.until, 0) and self.until <= _MOST_FRAMES
        check_fields(
            self,
            {
                "features": (different, "as different cameras, one at least"),
                "hand": (len(self.hand) > 0, "as names"),
                "encoders": (
                    all(encoders) and len(encoders) == len(self.features),
                    f"as one for each camera, of {outputs} outputs",
                ),
                "at_once": (is_integer(self.at_once, 1) and self.at_once <= 1000, "1 to 1000"),
                "until": (frames, f"from 0 to {_MOST_FRAMES}"),
            },
        )

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the dimensions of the goals."""
        return goal_names(self.hand)

    @classmethod
    def from_dict(cls, fields: dict[str, Any]) -> CamerasConfig:
        """Return the config that `dataclasses.asdict` turned into these fields, after JSON.

        Raises:
            ValueError: a field is missing, unknown or out of range.
        """
        try:
            encoders = tuple(ImageEncoderConfig(**one) for one in fields["encoders"])
            return cls(**{**fields, "encoders": encoders})
        except (KeyError, TypeError) as error:
            raise ValueError(f"expected the fields of CamerasConfig, got {error!r}") from error
