"""What is raised where a dataset is not as it should be."""


class DatasetError(ValueError):
    """A dataset that cannot be read as demonstrations; the message says what is wrong with it."""
