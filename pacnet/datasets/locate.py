"""The folder of a dataset that is named as `user/name`: it is looked for in LeRobot's caches.

Both lines of LeRobot keep `$HF_LEROBOT_HOME/user/name` for recordings. LeRobot 0.4 also downloads
to there; 0.6 and Hugging Face's `hf download` keep a folder for each revision:

    datasets--user--name/refs/v3.0             the commit of a tag or branch
    datasets--user--name/snapshots/COMMIT/     links to files in datasets--user--name/blobs/
"""

# ruff: noqa: PTH110, PTH111, PTH112
# pathlib raises where there is no home, a folder is closed or a name is too long; os.path does not.

import os
import re
from collections.abc import Iterator
from pathlib import Path

from pacnet.datasets.format import DatasetError

# Hugging Face's rules for names; they also hold no "--", no ".." and do not end with ".git".
_NAME = re.compile(r"\b[\w.-]{1,96}\b/\b[\w.-]{1,96}\b", re.ASCII)
_COMMIT = re.compile(r"[0-9a-f]{40}", re.ASCII)
_VERSION = re.compile(r"v([0-9]{1,4})\.([0-9]{1,4})", re.ASCII)
_OUR_MAJOR = 3  # LeRobot takes a dataset at the tag of its own format


def find_dataset(name: str | Path) -> Path:
    """Return the folder of a dataset, without any access to a network.

    Args:
        name: the folder, or `user/name` of a dataset on the Hugging Face hub, which is looked for
            in the caches of LeRobot and the hub. A folder goes before a cache.

    Returns:
        The folder; a `Path` comes back as it is.

    Raises:
        DatasetError: there is no folder of this name and none in the caches; for `user/name`, the
            message has the command that downloads it.
    """
    if isinstance(name, Path):
        return name
    if os.path.isdir(name):
        return Path(name)
    if not _is_name(name):
        shown = name if name and name.isprintable() else repr(name)
        raise DatasetError(f"expected the folder of a LeRobot dataset, found no folder {shown}")
    found = [path for path in _candidates(name) if os.path.exists(path / "meta" / "info.json")]
    for path in found:
        if _has_data(path):
            return path
    problem = f"found no folder {name}, and no dataset of this name in {_places()}: download it"
    if found:
        problem = f"{_short(found[0])} holds only the meta/ of {name}: download the rest"
    raise DatasetError(
        f"{problem} with `hf download --repo-type dataset {name}` (of the package huggingface_hub)"
    )


def source_name(name: str | Path, root: Path) -> str:
    """Return what a dataset is called in reports.

    Args:
        name: as given to `find_dataset`.
        root: as returned by it.

    Returns:
        `user/name` for a snapshot in a cache, whose folder is named by its commit; the folder's
        own name for others.
    """
    is_snapshot = root.parent.name == "snapshots" and _COMMIT.fullmatch(root.name)
    if isinstance(name, str) and is_snapshot and root.parent.parent.name == _cache_folder(name):
        return name
    return root.resolve().name


def _is_name(name: str) -> bool:
    forbidden = "--" in name or ".." in name or name.endswith(".git")
    return bool(_NAME.fullmatch(name)) and not forbidden


def _cache_folder(name: str) -> str:
    return f"datasets--{name.replace('/', '--')}"


def _candidates(name: str) -> Iterator[Path]:
    """Yield where a dataset may be, the best first."""
    home = _lerobot_home()
    folder = home / name
    # LeRobot 0.6 takes its snapshots in place of a folder that 0.4 downloaded.
    downloaded = os.path.exists(folder / ".cache" / "huggingface" / "download")
    if not downloaded:
        yield folder
    yield from _snapshots(home / "hub" / _cache_folder(name))
    if downloaded:
        yield folder
    yield from _snapshots(_hub_cache() / _cache_folder(name))


def _snapshots(folder: Path) -> list[Path]:
    """Return the snapshots of a dataset: those of v3 tags, of `main`, of older tags, the newest."""
    snapshots = {
        path.name: path
        for path in _list(folder / "snapshots")
        if _COMMIT.fullmatch(path.name) and os.path.isdir(path) and not path.is_symlink()
    }
    refs = sorted((path.name for path in _list(folder / "refs")), key=_preference, reverse=True)
    preferred = [_read_commit(folder / "refs" / ref) for ref in refs if _preference(ref)]
    newest = sorted(snapshots, key=lambda commit: (_time(snapshots[commit]), commit), reverse=True)
    return [
        snapshots[commit] for commit in dict.fromkeys([*preferred, *newest]) if commit in snapshots
    ]


def _preference(ref: str) -> tuple[int, ...]:
    """Return a key that is greater the rather LeRobot takes a tag or branch; () for never."""
    version = _VERSION.fullmatch(ref)
    if version is None:
        return (1,) if ref == "main" else ()
    major, minor = map(int, version.groups())
    if major > _OUR_MAJOR:
        return ()
    return (2 if major == _OUR_MAJOR else 0, major, minor)


def _read_commit(path: Path) -> str:
    try:
        with path.open(encoding="ascii") as file:
            return file.read(64).strip()
    except (OSError, ValueError):
        return ""


def _has_data(root: Path) -> bool:
    """Return whether there is more than `meta/`, which LeRobot downloads first, and videos."""
    return any(
        os.path.isdir(path)
        and not path.name.startswith(".")
        and path.name not in ("meta", "videos")
        for path in _list(root)
    )


def _list(folder: Path) -> list[Path]:
    try:
        return [*folder.iterdir()]
    except OSError:
        return []


def _time(path: Path) -> float:
    try:
        return path.stat().st_mtime
    except OSError:
        return 0.0


def _hf_home() -> str:
    """Return `$HF_HOME` or its default as `huggingface_hub` does."""
    cache = os.environ.get("XDG_CACHE_HOME", "~/.cache")
    home = os.environ.get("HF_HOME", f"{cache}/huggingface")
    return os.path.expandvars(os.path.expanduser(home))


def _lerobot_home() -> Path:
    home = os.environ.get("HF_LEROBOT_HOME", f"{_hf_home()}/lerobot")
    return Path(os.path.expanduser(home))


def _hub_cache() -> Path:
    cache = f"{_hf_home()}/hub"
    for variable in ("HUGGINGFACE_HUB_CACHE", "HF_HUB_CACHE"):
        cache = os.environ.get(variable, cache)
    return Path(os.path.expandvars(os.path.expanduser(cache)))


def _places() -> str:
    """Return the caches that were looked through, shortly."""
    lerobot, hub, home = _lerobot_home(), _hub_cache(), Path(_hf_home())
    if (lerobot, hub) == (home / "lerobot", home / "hub"):
        return f"the caches in {_short(home)}"
    return f"the caches {_short(lerobot)} and {_short(hub)}"


def _short(path: Path) -> str:
    home = os.path.expanduser("~")
    text = str(path)
    return f"~{text.removeprefix(home)}" if text.startswith(home + os.sep) else text
