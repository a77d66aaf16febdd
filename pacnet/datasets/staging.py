"""Files of a dataset that are replaced together, whenever the process is killed.

They are written into a staging folder. A list of their places, renamed into its name once all of
them are on the disk, is the instant from which they count; then they are moved, one by one. Killed
before that instant, the process leaves the old files; after it, what is left to move is in the
list. As long as any is staged, not all are in place. `meta/info.json` is the last, directly after
the episodes' file: between the two, the dataset contradicts itself.
"""

import hashlib
import json
import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from pacnet.datasets.lerobot_files import INFO, DatasetError
from pacnet.durable import NEW, flush_folder, put_in_place

_LIST = "fold.json"
_STAGED = "fold"


class Stage:
    """Files on their way to their places.

    Attributes:
        places: The files' places in the dataset's folder, in the order in which they move there.
    """

    def __init__(self, journal: Path) -> None:
        """An empty stage; what was staged and not committed before goes."""
        self._journal = journal
        self._folder = journal / _STAGED
        shutil.rmtree(self._folder, ignore_errors=True)
        self._folder.mkdir()
        self.places: list[str] = []

    def add(self, place: str) -> Path:
        """Where to write the file for a place, down to the disk."""
        self.places.append(place)
        return self._folder / str(len(self.places) - 1)

    def commit(self, folded: Sequence[Path]) -> None:
        """Put all files, the last added of which are episodes and `meta/info.json`, into place.

        Args:
            folded: Files of the journal whose content is in the staged ones; they are deleted.
        """
        assert self.places[-1] == INFO  # the last to move
        flush_folder(self._folder)
        listed = {
            "places": self.places,
            "info": _digest(self._journal.parent / INFO),
            "new_info": _digest(self._folder / str(len(self.places) - 1)),
            "folded": [path.name for path in folded],
        }
        put_in_place(self._journal / _LIST, json.dumps(listed).encode())
        settle(self._journal)


def settle(journal: Path) -> None:
    """Complete what was committed, or drop what was not, before anything else is folded.

    Where somebody else has changed the dataset since, the commit is dropped: what it was made from
    is still in the journal.

    Raises:
        DatasetError: The list of what was committed is damaged.
    """
    listed = _listed(journal)
    if listed is not None:
        ours = _digest(journal.parent / INFO) in (listed["info"], listed.get("new_info"))
        if ours and not is_complete(journal):
            _move(journal, listed["places"])
        if is_complete(journal):
            for name in listed["folded"]:
                (journal / name).unlink(missing_ok=True)
            flush_folder(journal)
        (journal / _LIST).unlink()
        flush_folder(journal)
    shutil.rmtree(journal / _STAGED, ignore_errors=True)
    for path in journal.glob(f"*{NEW}"):
        path.unlink()


def is_complete(journal: Path) -> bool:
    """Whether all that was committed is in place, and only the journal is still to be cleared."""
    listed = _listed(journal)
    return listed is not None and not _staged(journal, listed["places"])


def _listed(journal: Path) -> dict[str, Any] | None:
    """What was committed, or None."""
    path = journal / _LIST
    try:
        return json.loads(path.read_bytes())
    except FileNotFoundError:
        return None
    except ValueError as error:
        raise DatasetError(
            f"{path} is damaged ({error}): without it, all that is in the journal is folded anew"
        ) from None


def _staged(journal: Path, places: Sequence[str]) -> dict[str, Path]:
    """Where the files are that are still to be moved, by their places."""
    paths = {place: journal / _STAGED / str(number) for number, place in enumerate(places)}
    return {place: path for place, path in paths.items() if path.exists()}


def _move(journal: Path, places: Sequence[str]) -> None:
    """Move what is staged, and nothing between the last two: a kill may come there."""
    root, last = journal.parent, places[-2:]
    staged = _staged(journal, places)
    for place in staged:
        (root / place).parent.mkdir(parents=True, exist_ok=True)
    for place in [place for place in staged if place not in last]:
        staged.pop(place).replace(root / place)
    _flush_folders(root, places)
    for place, path in staged.items():
        path.replace(root / place)
    for place in last:
        flush_folder((root / place).parent)


def _flush_folders(root: Path, places: Sequence[str]) -> None:
    """Make durable what was moved, and the folders that were made for it."""
    for folder in sorted({parent for place in places for parent in Path(place).parents}):
        if (root / folder).exists():
            flush_folder(root / folder)


def _digest(path: Path) -> str | None:
    return hashlib.sha256(path.read_bytes()).hexdigest() if path.exists() else None
