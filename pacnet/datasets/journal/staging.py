"""Files of a dataset that are replaced together, even if the process is killed meanwhile.

They are written into a staging folder. Once all are on the disk, a list of their paths is renamed
into place, which commits them. Then they are moved one by one. If the process is killed before the
commit, the old files stay; after it, the next process moves the rest of the list. `meta/info.json`
moves last, directly after the file of episodes: between the two, the dataset is inconsistent.

The list may have been edited, so it is checked as a whole before the first file is moved.
"""

import hashlib
import json
import os
import re
import shutil
from collections.abc import Sequence
from pathlib import Path, PurePosixPath
from typing import NamedTuple, TypeGuard

from pacnet.core.durable import NEW, sync_folder, write_atomically
from pacnet.datasets.format import DatasetError
from pacnet.datasets.format.info import INFO
from pacnet.datasets.format.paths import path_for_file, real_path

EPISODE_FILE = re.compile(r"episode-([0-9]{6,})\.arrow")  # in the journal
_STAGED = "fold"  # folder in the journal
_LIST = "fold.json"


class _Commit(NamedTuple):
    """The content of a commit's list."""

    places: list[str]  # paths of the files in the dataset's folder, in the order they move in
    folded: list[str]  # names of the journal's files that are deleted afterwards
    info: str | None  # digest of the old `meta/info.json`
    new_info: str | None  # and of the new one


class Stage:
    """Files that are written before they move into the dataset.

    Attributes:
        paths: paths of the files in the dataset's folder, in the order of the moves.
    """

    def __init__(self, journal: Path) -> None:
        """Begin with no files; delete files that were staged before and not committed."""
        self._journal = journal
        self._folder = journal / _STAGED
        shutil.rmtree(self._folder, ignore_errors=True)
        self._folder.mkdir()
        self.paths: list[str] = []

    def add(self, path: str) -> Path:
        """Return where to write the file for a path in the dataset."""
        _check_path(self._journal, path)
        self.paths.append(path)
        return self._folder / str(len(self.paths) - 1)

    def commit(self, folded: Sequence[Path]) -> None:
        """Move all files into the dataset, then delete the journal's files that they contain.

        The last two that were added are the file of episodes and `meta/info.json`.
        """
        assert self.paths[-1] == INFO
        sync_folder(self._folder)
        listed = _Commit(
            self.paths,
            [path.name for path in folded],
            _digest(self._journal.parent / INFO),
            _digest(self._folder / str(len(self.paths) - 1)),
        )
        write_atomically(self._journal / _LIST, json.dumps(listed._asdict()).encode())
        finish_commit(self._journal)


def finish_commit(journal: Path) -> None:
    """Move the files of a commit and delete staged files that were not committed.

    If the dataset has changed since the commit, drop it: its episodes are still in the journal.
    """
    listed = _read_list(journal)
    if listed is not None:
        unchanged = _digest(journal.parent / INFO) in (listed.info, listed.new_info)
        if unchanged and _staged(journal, listed.places):
            _move(journal, listed.places)
        if not _staged(journal, listed.places):
            for name in listed.folded:
                (journal / name).unlink(missing_ok=True)
            sync_folder(journal)
        (journal / _LIST).unlink()
        sync_folder(journal)
    shutil.rmtree(journal / _STAGED, ignore_errors=True)
    for path in journal.glob(f"*{NEW}"):
        path.unlink()


def is_complete(journal: Path) -> bool:
    """Return whether all committed files are in place and only the journal is left to clear."""
    listed = _read_list(journal)
    return listed is not None and not _staged(journal, listed.places)


def check_journal(journal: Path) -> None:
    """Refuse a journal that holds links, or folders other than the staging folder."""
    if journal.is_symlink():
        raise DatasetError(f"expected a folder of the dataset's own at {journal}, found a link")
    for entry in _entries(journal):
        is_stage = entry.name == _STAGED and entry.is_dir(follow_symlinks=False)
        for file in _entries(Path(entry.path)) if is_stage else [entry]:
            if not file.is_file(follow_symlinks=False):
                raise DatasetError(f"expected a file at {file.path}, found a link or a folder")


def _entries(folder: Path) -> list[os.DirEntry[str]]:
    """Return the entries of a folder, or none if another process has deleted it."""
    try:
        with os.scandir(folder) as entries:
            return [*entries]
    except (FileNotFoundError, NotADirectoryError):
        return []


def _read_list(journal: Path) -> _Commit | None:
    """Return the list of a commit, if there is one."""
    check_journal(journal)
    path = journal / _LIST
    try:
        return _checked_list(journal, json.loads(path.read_bytes()))
    except FileNotFoundError:
        return None
    except (ValueError, RecursionError) as error:
        raise DatasetError(
            f"{path} is damaged ({error}): without it, the whole journal is folded again"
        ) from None


def _checked_list(journal: Path, listed: object) -> _Commit:
    listed = listed if isinstance(listed, dict) else {}
    places, folded, *digests = (listed.get(name) for name in _Commit._fields)
    if not _are_names(places) or places[-1:] != [INFO]:
        raise ValueError(f"expected different paths, {INFO} the last, found {places!r}")
    if not _are_names(folded) or not all(map(EPISODE_FILE.fullmatch, folded)):
        raise ValueError(f"expected names of episodes' files, found {folded!r}")
    for path in places:
        _check_path(journal, path)
    folders = {str(folder) for path in places for folder in PurePosixPath(path).parents}
    if folders & {*places}:
        raise ValueError(f"expected paths of files, found {folders & {*places}} with others in it")
    for digest in digests:
        if digest is not None and not isinstance(digest, str):
            raise ValueError(f"expected digests as text, found {digest!r}")
    return _Commit(places, folded, *digests)


def _are_names(names: object) -> TypeGuard[list[str]]:
    if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
        return False
    return len(set(names)) == len(names)


def _check_path(journal: Path, path: str) -> None:
    """Refuse a path outside of the dataset or inside of its journal."""
    target = path_for_file(journal.parent, path)
    if real_path(target).is_relative_to(real_path(journal)):
        raise DatasetError(f"expected a path outside of the journal, found {target}")


def _staged(journal: Path, paths: Sequence[str]) -> dict[str, Path]:
    """Return the files that are still to be moved: path in the dataset -> where it is now."""
    files = {path: journal / _STAGED / str(index) for index, path in enumerate(paths)}
    return {path: file for path, file in files.items() if file.exists()}


def _move(journal: Path, paths: Sequence[str]) -> None:
    """Move the staged files, the last two directly after each other."""
    root, last = journal.parent, paths[-2:]
    staged = _staged(journal, paths)
    for path in staged:
        (root / path).parent.mkdir(parents=True, exist_ok=True)
    for path in [path for path in staged if path not in last]:
        staged.pop(path).replace(root / path)
    # Sync the moves, and the folders that were made for them, to the disk.
    for folder in sorted({parent for path in paths for parent in Path(path).parents}):
        if (root / folder).exists():
            sync_folder(root / folder)
    for path, file in staged.items():
        file.replace(root / path)
    for path in last:
        sync_folder((root / path).parent)


def _digest(path: Path) -> str | None:
    return hashlib.sha256(path.read_bytes()).hexdigest() if path.is_file() else None
