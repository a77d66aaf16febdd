"""The files of a LeRobot dataset: formats v3.0, v2.1 and v2.0 are read, v3.0 is written.

They may come from anywhere, so they are checked before anything is changed.
"""

from pathlib import Path

from pacnet.core.lfs import is_lfs_pointer


class DatasetError(ValueError):
    """A dataset that cannot be read or appended to."""


class MissingFeature(DatasetError):  # noqa: N818 — it is a kind of DatasetError
    """A dataset without a feature that was asked for; the message names those there.

    Attributes:
        features: the names that were asked for.
        problem: the message without what to do.
    """

    def __init__(self, problem: str, features: tuple[str, ...], hint: str = "") -> None:
        super().__init__(problem + hint)
        self.problem, self.features = problem, features


class DatasetWarning(UserWarning):
    """What a dataset's files contradict or lack, and what was done about it."""


def unreadable(path: Path, reason: object) -> DatasetError:
    """Return the error that a file cannot be read, for the given reason."""
    if is_lfs_pointer(path):
        return DatasetError(
            f"{path} cannot be read: it is a Git LFS pointer in place of the file; run "
            f"`git lfs pull` in the dataset's folder"
        )
    return DatasetError(f"{path} cannot be read: {reason}")
