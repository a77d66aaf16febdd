"""Finds patches in pictures by normalised cross-correlation, to a fraction of a pixel.

At each place the patch and the picture's part, both less their mean in each colour, are multiplied
and divided by their norms (zero-mean normalised cross-correlation): 1 where they are the same, also
where the light is another. A part that stands out much less than the patch is not it: its norm
counts as a share of the patch's at least, or noise would be alike to anything.

A quadratic through the peak and its eight neighbours gives the fraction. It may be slanted:
parabolas down and right alone are wrong by twice as much.
"""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor
from torch.nn import functional

_LEAST = 1e-4  # square of the norm of a part without contrast
_STANDS_OUT = 0.3  # of the patch's norm, that of a part at least
_BESIDE = 4  # pixels from the peak: farther, another peak is another place
_AT_ONCE = 8  # pictures
_SLANT = 0.9  # of what a peak may be slanted by
_BEYOND = 0.75  # pixels from the highest value to the peak, at most


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
    squares = pictures.square().sum(dim=1, keepdim=True)
    sums = _sums(torch.cat([pictures, squares], dim=1), size)
    about_mean = sums[:, 3:] - sums[:, :3].square().sum(dim=1, keepdim=True) / size**2
    return about_mean.clamp(min=_LEAST).sqrt()


def _sums(pictures: Tensor, size: int) -> Tensor:
    """Return the sums over each part of a size; `avg_pool2d` takes 15 times as long."""
    return pictures.unfold(2, size, 1).sum(dim=-1).unfold(3, size, 1).sum(dim=-1)


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
    found = [_find(part, patches) for part in pictures.split(_AT_ONCE)]
    return Found(*map(torch.cat, zip(*found, strict=True)))


def find_within(
    picture: Tensor, patches: Tensor, low: Tensor, high: Tensor
) -> tuple[Tensor, Tensor]:
    """Find patches in one picture, each where it is looked for; return places and scores.

    Args:
        picture: `[1, 3, h, w]`.
        patches: less their mean, `[K ≥ 1, 3, size, size]`.
        low: the least row and column of each one's upper left corner [pixels], `[K, 2]`.
        high: the largest.

    Returns:
        The rows and columns `[K, 2]`, and the correlations there `[K]`.
    """
    size = patches.shape[-1]
    most = low.new_tensor([side - size for side in picture.shape[2:]])
    first, last = (torch.minimum(one.clamp(min=0), most) for one in (low.floor(), high.ceil()))
    (top, left), (bottom, right) = first.amin(0).long().tolist(), last.amax(0).long().tolist()
    part = picture[:, :, top : bottom + size, left : right + size]
    alike = _alike(part, patches)
    rows, columns = torch.arange(top, bottom + 1), torch.arange(left, right + 1)
    down = (rows >= first[:, :1]) & (rows <= last[:, :1])
    across = (columns >= first[:, 1:]) & (columns <= last[:, 1:])
    within = down[:, :, None] & across[:, None]
    scores, at = alike.masked_fill(~within, -1.0).flatten(2).max(dim=2)
    row, column = at // len(columns), at % len(columns)
    place = torch.stack([row + top, column + left], dim=2)
    beyond = _fraction(alike.flatten(2), row, column, (len(rows), len(columns)))
    return (place + beyond)[0], scores[0]


def _alike(pictures: Tensor, patches: Tensor) -> Tensor:
    """Return the correlation with each patch at each place, `[N, K, h', w']`."""
    norms = norms_of(patches)
    own = contrast(pictures, patches.shape[-1])
    least = _STANDS_OUT * norms.reshape(1, -1, 1, 1)
    return functional.conv2d(pictures, (patches / norms).to(pictures)) / torch.maximum(own, least)


def _find(pictures: Tensor, patches: Tensor) -> Found:
    alike = _alike(pictures, patches)
    rows, columns = alike.shape[2:]
    flat = alike.flatten(2)
    scores, at = flat.max(dim=2)
    row, column = at // columns, at % columns
    place = torch.stack([row, column], dim=2) + _fraction(flat, row, column, (rows, columns))
    return Found(place, scores, scores - _second(alike, row, column))


def _fraction(flat: Tensor, row: Tensor, column: Tensor, size: tuple[int, int]) -> Tensor:
    """Return by how much of a pixel peaks lie beyond their row and column, `[N, K, 2]`.

    At the border of a picture, and where there is no other row or column, it is 0 that way.
    """
    down = size[1] * ((row > 0) & (row < size[0] - 1))  # to the next row in memory
    right = ((column > 0) & (column < size[1] - 1)).long()
    at = row * size[1] + column

    def value(rows: int, columns: int) -> Tensor:
        return flat.gather(2, (at + rows * down + columns * right)[..., None])[..., 0]

    here = value(0, 0)
    slope_down, slope_right = (value(1, 0) - value(-1, 0)) / 2, (value(0, 1) - value(0, -1)) / 2
    bend_down = (value(1, 0) - 2 * here + value(-1, 0)).clamp(max=-1e-6)
    bend_right = (value(0, 1) - 2 * here + value(0, -1)).clamp(max=-1e-6)
    slant = (value(1, 1) - value(1, -1) - value(-1, 1) + value(-1, -1)) / 4
    most = _SLANT * (bend_down * bend_right).sqrt()  # more, and it is a saddle
    slant = torch.minimum(torch.maximum(slant, -most), most)
    shrunk = bend_down * bend_right - slant.square()
    beyond = torch.stack(
        [
            (slant * slope_right - bend_right * slope_down) / shrunk,
            (slant * slope_down - bend_down * slope_right) / shrunk,
        ],
        dim=2,
    )
    return beyond.clamp(-_BEYOND, _BEYOND)


def _second(alike: Tensor, row: Tensor, column: Tensor) -> Tensor:
    """Return the best correlation at another place, `[N, K]`; −1 where there is none."""
    rows, columns = torch.arange(alike.shape[2]), torch.arange(alike.shape[3])
    near = (rows - row[..., None]).abs() <= _BESIDE
    near = near[..., None] & ((columns - column[..., None]).abs() <= _BESIDE)[:, :, None]
    return alike.masked_fill(near, -1.0).flatten(2).max(dim=2).values
