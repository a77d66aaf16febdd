"""A progress bar on stderr, where somebody watches it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from pacnet.datasets.demonstrations import Demonstrations


@contextmanager
def progress_bar(doing: str, total: int, unit: str = "frame") -> Iterator[Callable[[int], None]]:
    """Gives what is called with how many more are done.

    Args:
        doing: what is being done, in a word.
        total: how many there are to do.
        unit: what one of them is called.
    """
    from tqdm import tqdm

    with tqdm(total=total, desc=doing, unit=unit, disable=None, leave=False) as bar:

        def advance(done: int) -> None:
            bar.update(done)

        yield advance


def frames_of(demonstrations: Demonstrations) -> int:
    """Number of frames of all demonstrations."""
    return sum(len(shown.state) for shown in demonstrations)
