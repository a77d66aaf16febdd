"""What is made of a picture before it is projected: small colours, or the grid of a network.

Networks with weights of others are imported when they are asked for. Nothing is downloaded.
"""

from __future__ import annotations

from collections.abc import Callable

from torch import Tensor

from pacnet.vision.config import PCA, ImageEncoderConfig
from pacnet.vision.projection import SIDE, small

Backbone = Callable[[Tensor], Tensor]
"""Turns pictures, uint8 `[N, h, w, 3]`, into features, float32 `[N, F]`."""


def backbone_of(config: ImageEncoderConfig) -> Backbone:
    """Return what makes features of pictures for an encoder that projects them."""
    if config.kind == PCA:
        return small
    raise ValueError(f"expected a kind of encoder that is built in, got {config.kind!r}")


def features_of(kind: str) -> tuple[int, str | None]:
    """Return the number of features that a kind makes of a picture, and its weights' digest."""
    if kind == PCA:
        return 3 * SIDE**2, None
    raise ValueError(f"expected a kind of encoder that is built in, got {kind!r}")
