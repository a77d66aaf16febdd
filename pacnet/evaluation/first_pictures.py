"""How far apart the first pictures of episodes are, for neighbours that see."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor

from pacnet.datasets.demonstrations import Demonstration
from pacnet.vision.projection import small


class FirstPictures:
    """The first pictures of P training parts, with N frames in all.

    Args:
        parts: with frames and pictures.
        cameras: that are compared.
        spread: mean squared distance of whatever else is compared from its mean, as much as
            pictures count on average.

    Raises:
        ValueError: a part has no pictures of a camera.
    """

    def __init__(self, parts: Sequence[Demonstration], cameras: Sequence[str], spread: float):
        self._cameras = tuple(cameras)
        self._rows = torch.stack([self._coarse(part) for part in parts])  # [P, C · 3 · 16²]
        self._lengths = torch.tensor([len(part.action) for part in parts])  # [P]
        seen = self._rows.var(dim=0, correction=0).sum().item()
        self._weight = spread / seen if seen > 0 else 0.0

    def apart(self, part: Demonstration) -> Tensor:
        """Return the squared distance of a part's first picture from that of each frame, `[N]`."""
        apart = (self._rows - self._coarse(part)).square().sum(dim=1)
        return (self._weight * apart).repeat_interleave(self._lengths)

    def _coarse(self, part: Demonstration) -> Tensor:
        """Return the means over cells of the first pictures, from 0 to 1, `[C · 3 · 16²]`."""
        lacking = [name for name in self._cameras if name not in part.pictures]
        if lacking:
            raise ValueError(
                f"expected pictures of {lacking[0]!r}, episode {part.episode} has none"
            )
        first = [torch.tensor(part.pictures[name][:1]) for name in self._cameras]
        return torch.cat([small(one)[0].double() for one in first])
