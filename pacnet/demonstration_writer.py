"""Demonstrations written as a LeRobot dataset (format v3.0), by LeRobot's own writer.

LeRobot takes seconds to import, so it is imported when a recording starts. Its files can be read
once they are closed: leaving the `with` block closes them, however it is left.
"""

import shutil
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pacnet.interrupts import interrupts_held_back

# Columns that LeRobot fills in by itself.
RESERVED = ("timestamp", "frame_index", "episode_index", "index", "task_index", "task")


class DemonstrationWriter:
    """Records demonstrations; a context manager.

    When the `with` block is left, normally, by an exception or by Ctrl-C, every episode saved so
    far is in the dataset. Without any, nothing stays on disk. A killed process loses them all.

    Example:
        ```python
        features = {"observation.state": ("shoulder", "elbow"), "action": ("shoulder", "elbow")}
        with DemonstrationWriter("drinking", fps=50, features=features) as writer:
            writer.save_episode("drink", {"observation.state": state, "action": action})
        ```
    """

    def __init__(
        self,
        root: str | Path,
        fps: int,
        features: Mapping[str, Sequence[str]],
        robot_type: str | None = None,
    ) -> None:
        """Nothing is written before the `with` block is entered.

        Args:
            root: The dataset's folder, which must not exist yet.
            fps: Frames per second [1/s].
            features: Feature name -> names of its dimensions.
            robot_type: What was recorded, in the dataset's description.

        Raises:
            ValueError: `fps` is not a positive integer, there is no feature, one is without
                dimensions or has two of one name, or its name is one that LeRobot cannot store.
        """
        if not isinstance(fps, int) or isinstance(fps, bool) or fps <= 0:
            raise ValueError(f"expected fps as an integer above 0, got {fps!r}")
        self._root = Path(root)
        self._fps = fps
        self._features = _checked_features(features)
        self._robot_type = robot_type
        self._dataset: Any = None  # LeRobotDataset, while the `with` block is open

    def __enter__(self) -> Self:
        """Create the dataset.

        Raises:
            FileExistsError: There is something at `root` already.
        """
        from lerobot.datasets.lerobot_dataset import LeRobotDataset

        if self._root.exists():
            raise FileExistsError(
                f"expected a folder to be made for the dataset, {self._root} exists"
            )
        try:
            with interrupts_held_back():
                self._dataset = LeRobotDataset.create(
                    repo_id=f"local/{self._root.name}",
                    fps=self._fps,
                    features=_lerobot_features(self._features),
                    root=self._root,
                    robot_type=self._robot_type,
                    use_videos=False,
                    # Any other backend has LeRobot look for torchcodec, which fails noisily.
                    video_backend="pyav",
                )
        except BaseException:
            if self._dataset is not None:
                self._close()
            raise
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        """Close the dataset, so that all saved episodes can be read."""
        with interrupts_held_back():
            self._close()

    def save_episode(self, task: str, frames: Mapping[str, ArrayLike]) -> None:
        """Append a whole episode; Ctrl-C waits until it is written.

        Args:
            task: The task in words.
            frames: Feature name -> its values, [T, D], float32 or float64; stored as float32.

        Raises:
            ValueError: The task is empty, a feature is missing or unknown, or an array is of
                another shape or dtype, empty, not finite in float32, or not as long as the others.
                Nothing is written then.
            RuntimeError: The `with` block is not open.
        """
        if self._dataset is None:
            raise RuntimeError("expected save_episode inside the writer's `with` block")
        if not isinstance(task, str) or not task.strip():
            raise ValueError(f"expected the task in words, got {task!r}")
        columns = checked_frames(self._features, frames)
        length = len(next(iter(columns.values())))
        time = np.arange(length)
        episode = {
            "size": length,
            "task": [task] * length,
            "episode_index": self._dataset.meta.total_episodes,
            "frame_index": time,
            "timestamp": time / self._fps,
            **dict.fromkeys(("index", "task_index"), ()),  # filled in by LeRobot
            # LeRobot stores vectors of length 1 as scalars.
            **{name: rows[:, 0] if rows.shape[1] == 1 else rows for name, rows in columns.items()},
        }
        with interrupts_held_back(), _progress_bars_off():
            self._dataset.save_episode(episode)

    def _close(self) -> None:
        dataset, self._dataset = self._dataset, None
        dataset.finalize()
        if dataset.meta.total_episodes == 0:
            shutil.rmtree(self._root)


def _checked_features(features: Mapping[str, Sequence[str]]) -> dict[str, tuple[str, ...]]:
    if not features:
        raise ValueError("expected at least one feature, got none")
    for feature, names in features.items():
        if feature in RESERVED or "/" in feature:
            raise ValueError(
                f"expected feature names without '/' and other than {', '.join(RESERVED)}, "
                f"got {feature!r}"
            )
        if isinstance(names, str) or not names or len(set(names)) != len(names):
            raise ValueError(
                f"expected {feature!r} to have distinct dimension names, got {names!r}"
            )
    return {feature: tuple(names) for feature, names in features.items()}


def _lerobot_features(features: Mapping[str, tuple[str, ...]]) -> dict[str, dict[str, Any]]:
    return {
        feature: {"dtype": "float32", "shape": (len(names),), "names": list(names)}
        for feature, names in features.items()
    }


def checked_frames(
    features: Mapping[str, Sequence[str]], frames: Mapping[str, ArrayLike]
) -> dict[str, NDArray[np.float32]]:
    """An episode's arrays as the writer stores them.

    Args:
        features: Feature name -> names of its dimensions, at least one feature.
        frames: Feature name -> its values, [T, D], float32 or float64.

    Returns:
        Feature name -> its values, float32 [T, D], all of one T.

    Raises:
        ValueError: As `DemonstrationWriter.save_episode`.
    """
    if set(frames) != set(features):
        raise ValueError(f"expected the features {sorted(features)}, got {sorted(frames)}")
    columns = {name: _checked_rows(name, frames[name], len(features[name])) for name in features}
    lengths = {name: len(rows) for name, rows in columns.items()}
    if len(set(lengths.values())) != 1:
        raise ValueError(f"expected as many frames in every feature, got {lengths}")
    return columns


def _checked_rows(name: str, values: ArrayLike, dimension: int) -> NDArray[np.float32]:
    """One feature's values as float32 [T, D], or a ValueError."""
    rows = np.asarray(values)
    wanted = f"expected {name!r} as float32 or float64 of shape [T > 0, {dimension}]"
    if rows.dtype not in (np.float32, np.float64):
        raise ValueError(f"{wanted}, got dtype {rows.dtype}")
    if rows.ndim != 2 or rows.shape[1] != dimension or len(rows) == 0:
        raise ValueError(f"{wanted}, got shape {list(rows.shape)}")
    with np.errstate(over="ignore"):  # what float32 cannot hold becomes infinite, and is refused
        rows = rows.astype(np.float32)
    bad = np.argwhere(~np.isfinite(rows))
    if len(bad):
        raise ValueError(
            f"{wanted} and finite, got {len(bad)} others, the first in row {bad[0][0]}"
        )
    return rows


@contextmanager
def _progress_bars_off() -> Iterator[None]:
    """Keeps the `datasets` library from drawing a progress bar for every episode."""
    import datasets

    if datasets.are_progress_bars_disabled():
        yield
        return
    datasets.disable_progress_bars()
    try:
        yield
    finally:
        datasets.enable_progress_bars()
