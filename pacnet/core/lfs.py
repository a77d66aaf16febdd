"""Git LFS pointers: small texts in place of files that were not downloaded."""

from pathlib import Path

_FIRST = b"version https://git-lfs.github.com/spec/v1"


def is_lfs_pointer(path: Path) -> bool:
    """Return whether a file is such a pointer; False for folders and missing files."""
    try:
        if not path.is_file():
            return False
        with path.open("rb") as file:
            return file.read(len(_FIRST)) == _FIRST
    except OSError:
        return False
