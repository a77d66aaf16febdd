"""Demonstrations recorded as a LeRobot dataset (format v3.0) that loses no finished episode.

An episode goes to the journal in the dataset's folder (`pacnet.journal`) and is on the disk when
`save_episode` returns. The journal is folded into the dataset when the recording is closed; where
the process was killed before, by the next `Recorder` of the dataset or by `recover`. Writing needs
pyarrow alone.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Self

from numpy.typing import ArrayLike

from pacnet.folding import find_dataset, fold
from pacnet.interrupts import interrupts_held_back
from pacnet.journal import Journal, has_journal
from pacnet.recording import Feature, Recording, checked_features, checked_frames
from pacnet.staging import INFO


class Recorder:
    """Records demonstrations, into a new dataset or at the end of one; a context manager.

    When the `with` block is left, normally, by an exception or by Ctrl-C, every episode saved so
    far is in the dataset. Of a new dataset without any, nothing stays on disk.

    Annotations such as `novelty` and `winner` are features like others. LeRobot's policies learn
    from whatever is called `observation*` or `action*`, so these are not.

    Example:
        ```python
        features = {
            "observation.state": ("shoulder", "elbow"),
            "action": ("shoulder", "elbow"),
            "novelty": ("novelty",),
            "winner": Feature(("winner",), "int64"),
            "next.success": Feature(("success",), "bool"),
        }
        with Recorder("drinking", fps=50, features=features) as recorder:
            recorder.save_episode("drink", {"observation.state": state, "action": action, ...})
        ```
    """

    def __init__(
        self,
        root: str | Path,
        fps: int,
        features: Mapping[str, Sequence[str] | Feature],
        robot_type: str | None = None,
    ) -> None:
        """Nothing is written before the `with` block is entered.

        Args:
            root: The dataset's folder, which is made, or holds a dataset to append to.
            fps: Frames per second [1/s].
            features: Feature name -> names of its dimensions, or a `Feature` that also says that
                they are integers or booleans.
            robot_type: What is recorded, in the description of a new dataset.

        Raises:
            ValueError: `fps` is not a positive integer, there is no feature, one is without
                dimensions or has two of one name, or its name is one that LeRobot cannot store.
        """
        if not isinstance(fps, int) or isinstance(fps, bool) or fps <= 0:
            raise ValueError(f"expected fps as an integer above 0, got {fps!r}")
        self._root = Path(root)
        self._recording = Recording(fps, checked_features(features), robot_type)
        self._journal: Journal | None = None  # while the `with` block is open

    def __enter__(self) -> Self:
        """Open the dataset, after recovering what a killed process recorded into it.

        Raises:
            FileExistsError: There is something at `root` that is no dataset.
            BlockingIOError: Another recording into the dataset goes on.
            DatasetError: The dataset cannot be read, or its files contradict one another.
            ValueError: Its frames per second, features or robot are others.
        """
        _check_free(self._root)
        try:
            with interrupts_held_back():
                self._journal = Journal(self._root)
                fold(self._journal)
                find_dataset(self._root, self._recording)
        except BaseException:
            self._close()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        """Fold the journal into the dataset, so that all saved episodes can be read."""
        assert self._journal is not None
        with interrupts_held_back():
            try:
                fold(self._journal)
            finally:
                self._close()

    def save_episode(self, task: str, frames: Mapping[str, ArrayLike]) -> None:
        """Append a whole episode, which no kill can take back; Ctrl-C waits until it is written.

        Args:
            task: The task in words.
            frames: Feature name -> its values, [T, D]: float32 or float64, stored as float32;
                integers, stored as int64; or booleans.

        Raises:
            ValueError: The task is empty, a feature is missing or unknown, or an array is of
                another shape or dtype, empty, not finite in float32, or not as long as the others.
                Nothing is written then.
            RuntimeError: The `with` block is not open.
        """
        if self._journal is None:
            raise RuntimeError("expected save_episode inside the recorder's `with` block")
        if not isinstance(task, str) or not task.strip():
            raise ValueError(f"expected the task in words, got {task!r}")
        columns = checked_frames(self._recording.features, frames)
        with interrupts_held_back():
            self._journal.add(self._recording, task, columns)

    def _close(self) -> None:
        if self._journal is not None:
            self._journal.close()
            self._journal = None


def recover(root: str | Path) -> int:
    """Make the episodes that a killed process recorded part of their dataset.

    Returns:
        How many there were.

    Raises:
        BlockingIOError: The recording goes on.
        DatasetError: The dataset cannot be read, or its files contradict one another.
        ValueError: Somebody has made it a dataset of something else since.
    """
    if not has_journal(Path(root)):
        return 0
    with interrupts_held_back(), Journal(Path(root)) as journal:
        return fold(journal)


def _check_free(root: Path) -> None:
    """Refuse a folder of something else; an empty one is what is left of a recording not begun."""
    if root.is_dir() and ((root / INFO).exists() or has_journal(root) or not any(root.iterdir())):
        return
    if root.exists():
        raise FileExistsError(f"expected a dataset or a folder to be made, {root} exists")
