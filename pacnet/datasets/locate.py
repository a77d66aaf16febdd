"""The folder of a dataset that is given by its folder or its name."""

from pathlib import Path


def find_dataset(name: str | Path) -> Path:
    """Return the dataset's folder."""
    return Path(name)


def source_name(name: str | Path, root: Path) -> str:  # noqa: ARG001
    """Return what the dataset is called in reports."""
    return root.resolve().name
