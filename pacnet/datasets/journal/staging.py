"""Files of a dataset that are replaced together, whenever the process is killed.

They are written into a staging folder. A list of their places, renamed into its name once all of
them are on the disk, is the instant from which they count; then they are moved, one by one. Killed
before that instant, the process leaves the old files; after it, what is left to move is in the
list. As long as any is staged, not all are in place. `meta/info.json` is the last, directly after
the episodes' file: between the two, the dataset contradicts itself.

The list is believed in nothing: it is checked as a whole before the first file is moved.
"""

import hashlib
import json
import shutil
from collections.abc import Sequence
from pathlib import Path, PurePosixPath
from typing import NamedTuple, TypeGuard

from pacnet.core.durable import NEW, sync_folder, write_atomically
from pacnet.datasets.format.errors import DatasetError
from pacnet.datasets.format.lerobot_files import INFO
from pacnet.datasets.format.places import (
    EPISODE_FILE,
    STAGED,
    check_journal,
    free_for_file,
    real_path,
)

_LIST = "fold.json"


class _Commit(NamedTuple):
    """What the list of a commit says."""

    places: list[str]  # of the files, in the order in which they move
    folded: list[str]  # names of the journal's files that are then deleted
    info: str | None  # digest of `meta/info.json` as it was
    new_info: str | None  # and as it will be


class Stage:
    """Files on their way to their places.

    Attributes:
        places: The files' places in the dataset's folder, in the order in which they move there.
    """

    def __init__(self, journal: Path) -> None:
        """An empty stage; what was staged and not committed before goes.

        Raises:
            DatasetError: There are links in the journal.
        """
        check_journal(journal)
        self._journal = journal
        self._folder = journal / STAGED
        shutil.rmtree(self._folder, ignore_errors=True)
        self._folder.mkdir()
        self.places: list[str] = []

    def add(self, place: str) -> Path:
        """Where to write the file for a place, down to the disk.

        Raises:
            DatasetError: No file of the dataset can be there.
        """
        _check_place(self._journal, place)
        self.places.append(place)
        return self._folder / str(len(self.places) - 1)

    def commit(self, folded: Sequence[Path]) -> None:
        """Put all files, the last added of which are episodes and `meta/info.json`, into place.

        Args:
            folded: Files of the journal whose content is in the staged ones; they are deleted.
        """
        assert self.places[-1] == INFO  # the last to move
        sync_folder(self._folder)
        listed = {
            "places": self.places,
            "info": _digest(self._journal.parent / INFO),
            "new_info": _digest(self._folder / str(len(self.places) - 1)),
            "folded": [path.name for path in folded],
        }
        write_atomically(self._journal / _LIST, json.dumps(listed).encode())
        settle(self._journal)


def settle(journal: Path) -> None:
    """Complete what was committed, or drop what was not, before anything else is folded.

    Where somebody else has changed the dataset since, the commit is dropped: what it was made from
    is still in the journal.

    Raises:
        DatasetError: The list of what was committed is damaged or names places outside of the
            dataset, or there are links in the journal; nothing is changed then.
    """
    listed = _listed(journal)
    if listed is not None:
        ours = _digest(journal.parent / INFO) in (listed.info, listed.new_info)
        if ours and not is_complete(journal):
            _move(journal, listed.places)
        if is_complete(journal):
            for name in listed.folded:
                (journal / name).unlink(missing_ok=True)
            sync_folder(journal)
        (journal / _LIST).unlink()
        sync_folder(journal)
    shutil.rmtree(journal / STAGED, ignore_errors=True)
    for path in journal.glob(f"*{NEW}"):
        path.unlink()


def is_complete(journal: Path) -> bool:
    """Whether all that was committed is in place, and only the journal is still to be cleared."""
    listed = _listed(journal)
    return listed is not None and not _staged(journal, listed.places)


def _listed(journal: Path) -> _Commit | None:
    """What was committed, or None."""
    check_journal(journal)
    path = journal / _LIST
    try:
        return _checked(journal, json.loads(path.read_bytes()))
    except FileNotFoundError:
        return None
    except (ValueError, RecursionError) as error:
        raise DatasetError(
            f"{path} is damaged ({error}): without it, all that is in the journal is folded anew"
        ) from None


def _checked(journal: Path, listed: object) -> _Commit:
    """What a list says, or a ValueError."""
    told = listed if isinstance(listed, dict) else {}
    places, folded = told.get("places"), told.get("folded")
    if not _are_names(places) or places[-1:] != [INFO]:
        raise ValueError(f"expected different places, {INFO} the last, found {places!r}")
    if not _are_names(folded) or not all(map(EPISODE_FILE.fullmatch, folded)):
        raise ValueError(f"expected names of episodes' files, found {folded!r}")
    for place in places:
        _check_place(journal, place)
    folders = {str(folder) for place in places for folder in PurePosixPath(place).parents}
    if folders & {*places}:
        raise ValueError(f"expected places of files, found {folders & {*places}} with others in it")
    digests = [told.get(name) for name in ("info", "new_info")]
    for digest in digests:
        if digest is not None and not isinstance(digest, str):
            raise ValueError(f"expected digests as text, found {digest!r}")
    return _Commit(places, folded, *digests)


def _are_names(names: object) -> TypeGuard[list[str]]:
    if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
        return False
    return len(set(names)) == len(names)


def _check_place(journal: Path, place: str) -> None:
    """Refuse a place that is none for a file of the dataset, or lies in its journal."""
    path = free_for_file(journal.parent, place)
    if real_path(path).is_relative_to(real_path(journal)):
        raise DatasetError(f"expected a place outside of the journal, found {path}")


def _staged(journal: Path, places: Sequence[str]) -> dict[str, Path]:
    """Where the files are that are still to be moved, by their places."""
    paths = {place: journal / STAGED / str(number) for number, place in enumerate(places)}
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
        sync_folder((root / place).parent)


def _flush_folders(root: Path, places: Sequence[str]) -> None:
    """Make durable what was moved, and the folders that were made for it."""
    for folder in sorted({parent for place in places for parent in Path(place).parents}):
        if (root / folder).exists():
            sync_folder(root / folder)


def _digest(path: Path) -> str | None:
    return hashlib.sha256(path.read_bytes()).hexdigest() if path.is_file() else None
