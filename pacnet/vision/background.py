"""What is always there, taken away from pictures: what is left is what differs."""

from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.nn import functional

from pacnet.core.growable_rows import copy_on_state_dict

_DARK = 0.08  # brightness up to which noise says more about a pixel than the light
_EVERY = 2  # pixels: so many are enough to tell the light
_LEAST, _MOST = 0.3, 3.0  # by which the light may differ


class Background(nn.Module):
    """The median of the first pictures of demonstrations.

    Args:
        height: of pictures [pixels].
        width: of them [pixels].
    """

    median: Tensor  # uint8 [3, h, w]

    def __init__(self, height: int, width: int) -> None:
        super().__init__()
        self.register_buffer("median", torch.zeros(3, height, width, dtype=torch.uint8))
        copy_on_state_dict(self)

    def fit(self, pictures: Tensor) -> None:
        """Keep the median of pictures `[N, 3, h, w]`, from 0 to 1."""
        self.median = (255 * pictures.median(dim=0).values).round().to(torch.uint8)

    def taken_from(self, pictures: Tensor, shift: Tensor | None = None) -> Tensor:
        """Return pictures `[N, 3, h, w]` less the background, in the light of the demonstrations.

        Args:
            pictures: from 0 to 1.
            shift: by how many pixels the camera was nudged down and right, `[2]`; None for 0.
        """
        median = self.median.float() / 255
        median = median if shift is None else _moved(median, shift)
        return pictures / _light(pictures, median)[:, None, None, None] - median


def _light(pictures: Tensor, median: Tensor) -> Tensor:
    """Return by how much brighter pictures are than the background, in most pixels, `[N]`."""
    grey = median.mean(dim=0)[::_EVERY, ::_EVERY]
    bright = grey > _DARK
    if not bright.any():
        return pictures.new_ones(len(pictures))
    own = pictures.mean(dim=1)[:, ::_EVERY, ::_EVERY]
    return (own[:, bright] / grey[bright]).median(dim=1).values.clamp(_LEAST, _MOST)


def _moved(picture: Tensor, shift: Tensor) -> Tensor:
    """Return a picture `[3, h, w]` moved down and right by `[2]`; the border is repeated."""
    if not shift.any():
        return picture
    height, width = picture.shape[1:]
    rows = torch.arange(height) - shift[0]
    columns = torch.arange(width) - shift[1]
    at = torch.stack(
        torch.broadcast_tensors(
            columns[None, :] * 2 / (width - 1) - 1, rows[:, None] * 2 / (height - 1) - 1
        ),
        dim=2,
    )
    return functional.grid_sample(
        picture[None], at[None].to(picture), padding_mode="border", align_corners=True
    )[0]
