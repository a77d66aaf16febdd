"""Pictures of an unfinished episode, compressed beside the control loop that adds them."""

from __future__ import annotations

from collections.abc import Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any

from pacnet.datasets.format.features import Arrays, Picture
from pacnet.datasets.pictures.decoders import import_decoder
from pacnet.datasets.pictures.image_file import encode_png

_THREADS = 2  # each compresses some 80 pictures of 640x480 in a second


class ImageQueue:
    """The pictures of each camera that were added, as PNG or soon to be."""

    def __init__(self, cameras: Mapping[str, Picture]) -> None:
        """Begin with no picture.

        Raises:
            DatasetError: PyAV or Pillow is not installed.
        """
        for name in ("PIL.Image", "av"):
            import_decoder(name)
        self._added: dict[str, list[Future[bytes]]] = {name: [] for name in cameras}
        self._pool: ThreadPoolExecutor | None = None  # while there is something to compress

    def add(self, row: Arrays) -> None:
        """Take the pictures `[H, W, 3]` out of a frame."""
        for name, images in self._added.items():
            images.append(self._submit(row.pop(name)))

    def encoded(self, columns: Arrays) -> dict[str, list[bytes]]:
        """Return an episode's pictures as PNG: those in its columns, or those that were added."""
        given = {
            name: [self._submit(picture) for picture in columns.pop(name)] if name in columns
            else images
            for name, images in self._added.items()
        }  # fmt: skip
        return {name: [image.result() for image in images] for name, images in given.items()}

    def clear(self) -> None:
        """Drop the pictures that were added, and end the threads."""
        for images in self._added.values():
            for image in images:
                image.cancel()
            images.clear()
        if self._pool is not None:
            self._pool.shutdown(wait=False)
            self._pool = None

    def _submit(self, picture: Any) -> Future[bytes]:
        if self._pool is None:
            self._pool = ThreadPoolExecutor(_THREADS, thread_name_prefix="pacnet-png")
        return self._pool.submit(encode_png, picture)
