"""The files of a LeRobot dataset (format v3.0).

They may come from anywhere, so they are checked before anything is changed.
"""


class DatasetError(ValueError):
    """A dataset that cannot be read or appended to."""


class DatasetWarning(UserWarning):
    """What a dataset's files contradict or lack, and what was done about it."""
