"""A progress bar on stderr, where somebody watches it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from pacnet.demonstrations import Demonstrations


@contextmanager
def progress_bar(doing: str, demonstrations: Demonstrations) -> Iterator[Callable[[int], None]]:
    """Counts the frames of all demonstrations; gives what is called with how many more are done.

    Args:
        doing: what is being done, in a word.
        demonstrations: that it is done with.
    """
    from tqdm import tqdm

    frames = sum(len(shown.state) for shown in demonstrations)
    with tqdm(total=frames, desc=doing, unit="frame", disable=None, leave=False) as bar:

        def advance(frames: int) -> None:
            bar.update(frames)

        yield advance
