"""Settings of what looks at pictures."""

from __future__ import annotations

from dataclasses import dataclass

from pacnet.core.validation import check_fields, is_integer, is_number

PATCHES, PCA, NONE = "patches", "pca", "none"
BUILT_IN = (PATCHES, PCA, NONE)
OUTSIDE = ("torchvision:", "timm:", "hf:", "file:")
"""Beginnings of the names of encoders with weights of others."""
_LARGEST = 4096  # pixels of a side
_MOST = 65_536  # numbers


@dataclass(frozen=True)
class ImageEncoderConfig:
    """Settings of an `ImageEncoder`.

    Attributes:
        kind: one of `BUILT_IN`, or a name that begins like one of `OUTSIDE`.
        height: of the pictures that it looks at [pixels].
        width: of them [pixels].
        outputs: length of what it tells, the goals.
        patch: size of a patch [pixels].
        features: numbers that the kind makes of a picture before they are projected; 0 for patches.
        digest: SHA-256 of the weights of others, in hexadecimal; None without.
    """

    kind: str
    height: int
    width: int
    outputs: int
    patch: int = 7
    features: int = 0
    digest: str | None = None

    def __post_init__(self) -> None:
        """Check the fields."""
        sides = [is_integer(side, 1) and side <= _LARGEST for side in (self.height, self.width)]
        patch = is_integer(self.patch, 2) and self.patch < min(self.height, self.width)
        widths = [is_integer(one, 0) and one <= _MOST for one in (self.outputs, self.features)]
        digest = self.digest is None or (isinstance(self.digest, str) and len(self.digest) == 64)
        check_fields(
            self,
            {
                "kind": (is_kind(self.kind), f"as {KINDS_TEXT}"),
                "height": (sides[0], f"from 1 to {_LARGEST}"),
                "width": (sides[1], f"from 1 to {_LARGEST}"),
                "outputs": (widths[0] and self.outputs > 0, f"from 1 to {_MOST}"),
                "patch": (patch, "from 2 to less than the picture has"),
                "features": (widths[1], f"from 0 to {_MOST}"),
                "digest": (digest, "as a SHA-256 in hexadecimal, or None"),
            },
        )


KINDS_TEXT = f"{', '.join(BUILT_IN)}, or {', '.join(f'{one}NAME' for one in OUTSIDE)}"


def is_kind(name: object) -> bool:
    """Return whether there is such a kind of encoder."""
    if not isinstance(name, str):
        return False
    return name in BUILT_IN or any(name.startswith(one) and name != one for one in OUTSIDE)


@dataclass(frozen=True)
class Told:
    """How well a camera tells goals, with each demonstration left out.

    Attributes:
        error: mean distance from the goal, in the hand's unit.
        alone: the same for the mean of the other demonstrations' goals, without a camera.
        chance: share of permutations of the goals that are foretold as well; 1 where there are too
            few demonstrations to tell.
    """

    error: float
    alone: float
    chance: float

    def __post_init__(self) -> None:
        """Check the fields."""
        for name in ("error", "alone", "chance"):
            value = getattr(self, name)
            check_fields(self, {name: (is_number(value) and value >= 0, "≥ 0")})
