"""The files of a LeRobot dataset (format v3.0), as they lie on disk.

They may come from anywhere: what reads or checks them raises a `DatasetError` wherever they are not
as expected, before it changes anything.
"""


class DatasetError(ValueError):
    """A dataset that cannot be read or appended to; the message says what is wrong with it."""
