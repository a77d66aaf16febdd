"""Parts of a saved folder: files that must all be there, and not as Git LFS pointers."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from pacnet.core.lfs import is_lfs_pointer

REMEDY = "copy or download the whole folder again, or save it anew"


def check_part(folder: Path, name: str) -> Path:
    """Return the path of a file that belongs to a folder.

    Raises:
        FileNotFoundError: the folder or the file is missing.
        ValueError: something else in its place: a folder, a Git LFS pointer or an empty file.
    """
    path = folder / name
    if not folder.is_dir():
        raise FileNotFoundError(f"expected {name} in the folder '{folder}', got no such folder")
    if path.is_dir():
        raise ValueError(f"expected the file {name} in '{folder}', got a folder: {REMEDY}")
    if not path.is_file():
        raise FileNotFoundError(f"expected {name} in '{folder}', got none: {REMEDY}")
    if is_lfs_pointer(path):
        raise ValueError(
            f"expected the content of {name} in '{folder}', got a Git LFS pointer: "
            "run `git lfs pull` there"
        )
    if path.stat().st_size == 0:
        raise ValueError(f"expected content of {name} in '{folder}', got an empty file: {REMEDY}")
    return path


def read_json_part(folder: Path, name: str) -> dict[str, Any]:
    """Return the object of a JSON file that belongs to a folder.

    Raises:
        FileNotFoundError: the folder or the file is missing.
        ValueError: as `check_part`, or other than an object in JSON.
    """
    path = check_part(folder, name)
    return parse_json(path, path.read_bytes())


def parse_json(path: Path, text: bytes) -> dict[str, Any]:
    """Return the object that the text of a JSON file holds.

    Raises:
        ValueError: other than an object in JSON.
    """
    try:
        document = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise ValueError(f"expected JSON, got '{path}': {error}: {REMEDY}") from error
    if not isinstance(document, dict):
        raise ValueError(f"expected an object in JSON, got '{path}': {REMEDY}")
    return document
