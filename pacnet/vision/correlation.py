"""Finds patches in pictures by normalised cross-correlation, to a fraction of a pixel.

At each place the patch and the picture's part, both less their mean in each colour, are multiplied
and divided by their norms (zero-mean normalised cross-correlation): 1 where they are the same, also
where the light is another. A parabola through the peak and its neighbours gives the fraction.
"""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor
from torch.nn import functional

_LEAST = 1e-4  # square of the norm of a part without contrast
_BESIDE = 4  # pixels from the peak: farther, another peak is another place
_AT_ONCE = 8  # pictures


class Found(NamedTuple):
    """Where K patches were found in N pictures."""

    places: Tensor
    """Row and column of the patch's upper left corner [pixels], `[N, K, 2]`."""
    scores: Tensor
    """Correlation there, up to 1, `[N, K]`."""
    margins: Tensor
    """By how much it exceeds that of the best other place, `[N, K]`."""


def as_tensor(pictures: Tensor) -> Tensor:
    """Return pictures, uint8 `[N, h, w, 3]`, as float32 `[N, 3, h, w]` from 0 to 1."""
    return pictures.permute(0, 3, 1, 2).float() / 255


def contrast(pictures: Tensor, size: int) -> Tensor:
    """Return the norm of each part of a size, less its mean, `[N, 1, h − size + 1, w − size + 1]`.

    Args:
        pictures: `[N, 3, h, w]`.
        size: of the parts [pixels].
    """
    mean = functional.avg_pool2d(pictures, size, 1)
    squares = functional.avg_pool2d(pictures.square(), size, 1) - mean.square()
    return (squares.sum(dim=1, keepdim=True) * size**2).clamp(min=_LEAST).sqrt()


def patches_at(picture: Tensor, corners: list[tuple[int, int]], size: int) -> Tensor:
    """Return patches of a picture `[3, h, w]`, less their mean, `[K, 3, size, size]`.

    Args:
        picture: from which they are cut.
        corners: row and column of each.
        size: of a patch [pixels].
    """
    parts = [picture[:, row : row + size, column : column + size] for row, column in corners]
    patches = torch.stack(parts)
    return patches - patches.mean(dim=(2, 3), keepdim=True)


def norms_of(patches: Tensor) -> Tensor:
    """Return the norm of each patch, `[K, 1, 1, 1]`, at least that of one without contrast."""
    norms = torch.linalg.vector_norm(patches, dim=(1, 2, 3), keepdim=True)
    return norms.clamp(min=_LEAST**0.5)


def find(pictures: Tensor, patches: Tensor) -> Found:
    """Find patches `[K, 3, size, size]`, less their mean, in pictures `[N, 3, h, w]`."""
    units = patches / norms_of(patches)
    found = [_find(part, units) for part in pictures.split(_AT_ONCE)]
    return Found(*map(torch.cat, zip(*found, strict=True)))


def _find(pictures: Tensor, patches: Tensor) -> Found:
    alike = functional.conv2d(pictures, patches) / contrast(pictures, patches.shape[-1])
    rows, columns = alike.shape[2:]
    flat = alike.flatten(2)
    scores, at = flat.max(dim=2)
    row, column = at // columns, at % columns
    down = _fraction(flat, row, rows, at, columns)
    right = _fraction(flat, column, columns, at, 1)
    place = torch.stack([row + down, column + right], dim=2)
    return Found(place, scores, scores - _second(alike, row, column))


def _fraction(flat: Tensor, index: Tensor, length: int, at: Tensor, step: int) -> Tensor:
    """Return by how much of a pixel the peak lies beyond its index along one axis, `[N, K]`."""
    inside = (index > 0) & (index < length - 1)
    middle = torch.where(inside, at, at.clamp(step, flat.shape[2] - 1 - step))
    before, here, after = (
        flat.gather(2, (middle + offset)[..., None])[..., 0] for offset in (-step, 0, step)
    )
    bend = (before - 2 * here + after).clamp(max=-1e-6)
    return torch.where(inside, ((before - after) / (2 * bend)).clamp(-0.5, 0.5), 0.0)


def _second(alike: Tensor, row: Tensor, column: Tensor) -> Tensor:
    """Return the best correlation at another place, `[N, K]`; −1 where there is none."""
    rows, columns = torch.arange(alike.shape[2]), torch.arange(alike.shape[3])
    near = (rows - row[..., None]).abs() <= _BESIDE
    near = near[..., None] & ((columns - column[..., None]).abs() <= _BESIDE)[:, :, None]
    return alike.masked_fill(near, -1.0).flatten(2).max(dim=2).values
