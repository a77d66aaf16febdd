"""Demonstrations recorded as a LeRobot dataset (format v3.0), safe against crashes.

`save_episode` writes the episode to the journal in the dataset's folder (`journal/`) and waits for
the disk. The journal is folded into the dataset when the recording is closed; if the process is
killed before, by the next `Recorder` of the dataset or by `recover`. Frames that were added one by
one are only in memory until `save_episode`.
"""

from __future__ import annotations

import threading
from collections.abc import Mapping
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING, Self, SupportsIndex

import numpy as np
from numpy.typing import ArrayLike

from pacnet.core.interrupts import defer_sigint
from pacnet.datasets.format.features import (
    Arrays,
    Feature,
    Features,
    Picture,
    checked_episode,
    checked_frame,
    checked_recording,
    is_text,
)

# What imports pyarrow, 0.2 s, is imported where it is used.
if TYPE_CHECKING:
    from pacnet.datasets.journal.image_queue import ImageQueue
    from pacnet.datasets.journal.journal import Journal

__all__ = ["Feature", "Picture", "Recorder", "recover"]


class Recorder:
    """Records demonstrations, into a new dataset or at the end of one; a context manager.

    When the `with` block is left, normally, by an exception or by Ctrl-C, every episode saved so
    far is in the dataset, and frames of an unfinished one are dropped. A new dataset without any
    episode is deleted. Leaving the block reads all frames into memory, for exact statistics.

    Pictures of cameras are compressed without loss while frames are added, by two threads, and
    become videos when the block is left, at some 15 ms for one of 640x480; a Ctrl-C waits for them.
    They take `pip install 'pacnet[cameras]'`.

    LeRobot's policies learn from all features called `observation*` or `action*`. Give features
    that they should not see, such as `novelty` and `winner`, other names.

    Example:
        ```python
        from pacnet.datasets import Feature, Recorder

        features = {
            "observation.state": ("shoulder", "elbow"),
            "action": ("shoulder", "elbow"),
            "winner": Feature(("winner",), "int64"),
        }
        with Recorder("drinking", fps=50, features=features) as recorder:
            recorder.save_episode("drink", {"observation.state": state, "action": action, ...})
        ```
        Or frame by frame, as in a control loop:
        ```python
        with Recorder("waving", fps=50, features=features) as recorder:
            while not finished():
                state = measure()
                action = act(state)
                recorder.add_frame({"observation.state": state, "action": action, ...})
            recorder.save_episode("wave")  # or clear_episode(), to try again
        ```
    """

    def __init__(
        self,
        root: str | Path,
        fps: SupportsIndex,
        features: Features,
        robot_type: str | None = None,
    ) -> None:
        """Describe the recording; nothing is written before the `with` block is entered.

        Args:
            root: the dataset's folder, which is made, or holds a dataset to append to.
            fps: frames per second [1/s].
            features: feature name -> names of its dimensions, or a `Feature` for integers and
                booleans, or a `Picture` for a camera, called `observation.images.top` or so.
            robot_type: type of the robot, for the description of a new dataset.

        Raises:
            ValueError: `fps` is not a positive integer, there is no feature of numbers, a feature
                has no dimensions or two of one name, a side of a picture is odd, or LeRobot cannot
                store a name.
            DatasetError: PyAV or Pillow is not installed, and there is a camera.
        """
        self._root = Path(root).absolute()  # the working directory may change
        self._recording = checked_recording(fps, features, robot_type)
        self._journal: Journal | None = None  # while the `with` block is open
        self._lock = threading.Lock()  # of the threads that save
        self._frames: list[Arrays] = []  # added to the unfinished episode
        self._images: ImageQueue | None = None
        if self._recording.cameras:
            from pacnet.datasets.journal.image_queue import ImageQueue

            self._images = ImageQueue(self._recording.cameras)

    def __enter__(self) -> Self:
        """Open the dataset, after recovering episodes that a killed process recorded into it.

        Raises:
            FileExistsError: `root` exists and is not a dataset.
            BlockingIOError: another process records into the dataset.
            DatasetError: the dataset or its journal cannot be read, its files contradict one
                another, or its frames have gaps, numbers that are not finite or no episode.
            ValueError: the dataset has another `fps`, other features or another robot.
            RuntimeError: the `with` block is open already.
        """
        from pacnet.datasets.journal.folding import check_ready, fold
        from pacnet.datasets.journal.journal import Journal

        if self._journal is not None:
            raise RuntimeError("expected the recorder's `with` block to be entered once at a time")
        try:
            with defer_sigint():
                self._journal = Journal(self._root)
                fold(self._journal)
                check_ready(self._root, self._recording)
        except BaseException:
            self._close()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        """Fold the journal into the dataset; do nothing in a fork of the recording process."""
        from pacnet.datasets.journal.folding import fold

        journal = self._open_journal()
        if journal.is_forked:
            self._close()
            return
        with defer_sigint(), self._lock:
            try:
                fold(journal)
            finally:
                self._close()

    def add_frame(self, frame: Mapping[str, ArrayLike]) -> None:
        """Add a frame to the episode that the next `save_episode` without frames saves.

        Until then it is in memory, and lost when the process is killed or the `with` block is left.

        Args:
            frame: feature name -> its values, `[D]`, or a number for D = 1, of a dtype that
                `save_episode` takes; of a camera `[H, W, 3]`. They are copied.

        Raises:
            ValueError: a feature is missing or unknown, or its values are of another shape or dtype
                or not finite in float32. The frames before stay.
            RuntimeError: as `save_episode`.
        """
        self._check_open()
        with self._lock:
            try:
                row = checked_frame(self._recording.features, frame, self._recording.cameras)
            except ValueError as error:
                raise ValueError(f"frame {len(self._frames)}: {error}") from None
            if self._images is not None:
                self._images.add(row)
            self._frames.append(row)

    def clear_episode(self) -> None:
        """Drop the frames added since the last episode."""
        self._check_open()
        with self._lock:
            self._clear()

    def save_episode(self, task: str, frames: Mapping[str, ArrayLike] | None = None) -> None:
        """Append an episode and wait until it is on the disk; a Ctrl-C is deferred until then.

        Threads may save at the same time.

        Args:
            task: the task in words.
            frames: feature name -> its values, `[T, D]`: float32 or float64, stored as float32;
                integers, stored as int64; or booleans; of a camera `[T, H, W, 3]` uint8. None
                takes those that were added.

        Raises:
            ValueError: the task is empty; a feature is missing or unknown; an array is of
                another shape or dtype, empty, not finite in float32, or not as long as the others;
                frames are given although some were added; or there are none. Nothing is written
                then, and added frames stay.
            RuntimeError: the `with` block is not open, or was entered by another process.
        """
        self._check_open()
        if not is_text(task) or not task.strip():
            raise ValueError(f"expected the task in words, got {task!r}")
        features, cameras = self._recording.features, self._recording.cameras
        columns = None if frames is None else checked_episode(features, frames, cameras)
        with defer_sigint(), self._lock:
            if columns is None:
                if not self._frames:
                    raise ValueError("expected frames, given here or added before, got none")
                columns = {name: np.stack([row[name] for row in self._frames]) for name in features}
            elif self._frames:
                raise ValueError(
                    f"expected no frames, as {len(self._frames)} were added: save them first, or "
                    "drop them by clear_episode"
                )
            images = {} if self._images is None else self._images.encoded(columns)
            self._open_journal().add(self._recording, task, columns, images)
            self._clear()

    def _check_open(self) -> None:
        if self._open_journal().is_forked:
            raise RuntimeError("expected to record in the process that entered the `with` block")

    def _open_journal(self) -> Journal:
        if self._journal is None:
            raise RuntimeError("expected to be inside the recorder's `with` block")
        return self._journal

    def _clear(self) -> None:
        self._frames.clear()
        if self._images is not None:
            self._images.clear()

    def _close(self) -> None:
        self._clear()
        if self._journal is not None:
            self._journal.close()
            self._journal = None


def recover(root: str | Path) -> int:
    """Fold the episodes that a killed process recorded into their dataset.

    Returns:
        How many there were.

    Raises:
        BlockingIOError: another process still records.
        FileExistsError: `root` exists and is not a dataset.
        DatasetError: the dataset or its journal cannot be read, or its files contradict one
            another.
        ValueError: the dataset has got another `fps`, other features or another robot since.
    """
    from pacnet.datasets.journal.folding import fold
    from pacnet.datasets.journal.journal import JOURNAL, Journal

    root = Path(root).absolute()
    if not (root / JOURNAL).is_dir():
        return 0
    with defer_sigint(), closing(Journal(root)) as journal:
        return fold(journal)
