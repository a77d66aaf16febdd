"""One picture made smaller by averaging over areas, the same for datasets and for live cameras.

The red, green and blue of a reduced pixel are the means over the rectangle that it covers, where
pixels count by how much of them lies in it. Videos are converted to RGB before, since FFmpeg's own
reduction of `yuv420p` to RGB loses colours (mean error 17 of 255 on a colourful picture, against
3).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from pacnet.kernels.caching import cached_njit

MAX_SIDE = 128  # pixels of the longer side
LARGEST_SIDE = 8192  # pixels of a side that are taken at all


def reduce(picture: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return a picture with its longer side reduced to 128 pixels.

    Args:
        picture: red, green and blue, `[H, W, 3]`.

    Returns:
        The reduced picture `[h, w, 3]` of the same aspect; a copy where it is small already.

    Raises:
        ValueError: another dtype or shape, no pixel, or a side of more than 8192 pixels.
    """
    check_picture(picture)
    size = reduced_size(*picture.shape[:2])
    if size == picture.shape[:2]:
        return np.array(picture)
    reduced = np.empty((*size, 3), np.uint8)
    _average(picture, np.empty((picture.shape[1], 3), np.uint32), reduced)
    return reduced


def reduced_size(height: int, width: int) -> tuple[int, int]:
    """Return the height and width to which a picture is reduced [pixels]."""
    longer = max(height, width)
    if longer <= MAX_SIDE:
        return height, width
    return _rounded(height * MAX_SIDE, longer), _rounded(width * MAX_SIDE, longer)


def _rounded(dividend: int, divisor: int) -> int:
    """Return a quotient rounded half up, at least 1."""
    return max(1, (2 * dividend + divisor) // (2 * divisor))


def check_picture(picture: Any) -> None:
    """Raise a ValueError unless this is an RGB picture, uint8 `[H, W, 3]`."""
    expected = "expected a picture as uint8 [height, width, 3]"
    if not isinstance(picture, np.ndarray):
        raise ValueError(f"{expected}, got {type(picture).__name__}")
    shape = picture.shape
    if picture.dtype != np.uint8 or len(shape) != 3 or shape[2] != 3 or 0 in shape:
        raise ValueError(f"{expected}, got {picture.dtype} {[*shape]}")
    if max(shape) > LARGEST_SIDE:
        raise ValueError(f"{expected} with sides up to {LARGEST_SIDE}, got {[*shape]}")


@cached_njit()
def _average(picture, sums, out):
    """Write the means over areas; all is counted in parts of pixels, so that sums are exact.

    Row i of h covers the rows from i H / h to (i + 1) H / h of H, and so for columns.

    Args:
        picture: `[H, W, 3]`.
        sums: to work in, `[W, 3]` uint32.
        out: where to write, `[h, w, 3]`, h ≤ H, w ≤ W.
    """
    height, width, _ = picture.shape
    rows, columns, _ = out.shape
    area = np.uint64(height * width)
    for i in range(rows):
        top, bottom = i * height, (i + 1) * height
        sums[:] = 0
        for y in range(top // rows, (bottom - 1) // rows + 1):
            part = np.uint32(min(bottom, (y + 1) * rows) - max(top, y * rows))
            for x in range(width):
                for colour in range(3):
                    sums[x, colour] += part * picture[y, x, colour]
        for j in range(columns):
            left, right = j * width, (j + 1) * width
            red = green = blue = area // np.uint64(2)  # rounds half up
            for x in range(left // columns, (right - 1) // columns + 1):
                part = np.uint64(min(right, (x + 1) * columns) - max(left, x * columns))
                red += part * sums[x, 0]
                green += part * sums[x, 1]
                blue += part * sums[x, 2]
            out[i, j, 0], out[i, j, 1], out[i, j, 2] = red // area, green // area, blue // area
