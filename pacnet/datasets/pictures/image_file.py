"""One picture as the content of a PNG or JPEG file, decoded and encoded by Pillow."""

from __future__ import annotations

import io
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pacnet.datasets.format import DatasetError
from pacnet.datasets.pictures.decoders import import_decoder
from pacnet.datasets.pictures.footage import DepthPictures
from pacnet.datasets.pictures.reducing import LARGEST_SIDE

_FAST = 1  # level of compression; more takes two to four times as long for 7 to 14 % less


def encode_png(picture: NDArray[np.uint8]) -> bytes:
    """Return an RGB picture `[H, W, 3]` as PNG, which loses nothing."""
    images: Any = import_decoder("PIL.Image")
    content = io.BytesIO()
    images.fromarray(picture).save(content, "png", compress_level=_FAST)
    return content.getvalue()


def decode_image(content: bytes) -> NDArray[np.uint8]:
    """Return a picture as RGB `[H, W, 3]`; grey becomes such, transparency is dropped."""
    images: Any = import_decoder("PIL.Image")
    try:
        with images.open(io.BytesIO(content), formats=("PNG", "JPEG")) as image:
            if max(image.size) > LARGEST_SIDE:
                size = "x".join(map(str, image.size))
                raise DatasetError(f"expected sides up to {LARGEST_SIDE} pixels, found {size}")
            if image.mode[0] in "IF":
                raise DepthPictures(f"it shows distances (mode {image.mode})")
            return np.asarray(image.convert("RGB"))
    except DatasetError:
        raise
    except Exception as error:  # damaged files raise whatever Pillow's readers run into
        raise DatasetError(f"expected a picture as PNG or JPEG, found: {error}") from error
