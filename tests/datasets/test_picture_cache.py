"""Claims about the cache of pictures: nothing is decoded twice, and nothing wrong is read."""

import os
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
from layouts import Shown, write_v21
from video_files import pictures, write_video

from pacnet.datasets.demonstrations import load_demonstrations
from pacnet.datasets.format import DatasetWarning
from pacnet.datasets.pictures.cache import PictureCache
from pacnet.datasets.pictures.footage import Footage
from pacnet.datasets.pictures.video_file import VideoFile

TOP = "observation.images.top"
LENGTHS = (5, 3)
SHAPE = (2, 4, 6, 3)


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder of an empty cache."""
    monkeypatch.setenv("PACNET_CACHE", str(tmp_path / "cache"))
    return tmp_path / "cache/pictures"


@pytest.fixture
def root(tmp_path: Path) -> Path:
    episodes = [
        Shown("look", {"observation.state": rows, "action": rows}, videos={TOP: pictures(length)})
        for length in LENGTHS
        for rows in [np.zeros((length, 2), "f4")]
    ]
    return write_v21(tmp_path / "seen", episodes)


@pytest.fixture
def decoded(monkeypatch: pytest.MonkeyPatch) -> list[Path]:
    """The videos that are opened."""
    found: list[Path] = []
    begin = VideoFile.__init__
    monkeypatch.setattr(
        VideoFile, "__init__", lambda self, path: (found.append(path), begin(self, path))[1]
    )
    return found


def seen(root: Path) -> list[np.ndarray]:
    return [shown.pictures[TOP] for shown in load_demonstrations(root, cameras="all")]


def test_a_video_is_decoded_once(folder: Path, root: Path, decoded: list[Path]):
    first = seen(root)
    assert len(decoded) == len(LENGTHS) == len([*folder.iterdir()])
    second = seen(root)
    assert len(decoded) == len(LENGTHS)
    for before, after in zip(first, second, strict=True):
        assert np.array_equal(before, after)
        assert isinstance(after, np.memmap)
        assert not after.flags.writeable


def test_a_video_that_has_changed_is_decoded_again(folder: Path, root: Path):
    before = seen(root)
    path = root / f"videos/chunk-000/{TOP}/episode_000001.mp4"
    write_video(path, 255 - pictures(LENGTHS[1]))
    after = seen(root)
    assert np.array_equal(before[0], after[0])
    assert np.abs(255 - pictures(LENGTHS[1]).astype(int) - after[1]).max() <= 2
    assert folder.is_dir()


@pytest.mark.parametrize(
    "damage",
    [
        lambda content: content[:0],
        lambda content: content[:-1],
        lambda content: content + b"x",
        lambda content: content[:200] + bytes([content[200] ^ 1]) + content[201:],
        lambda content: content.replace(b"16, 16, 3", b"16, 12, 4"),
        lambda content: content.replace(b"|u1", b"|O8"),
        lambda content: b"PK" + content[2:],
    ],
    ids=["empty", "cut", "longer", "flipped", "shape", "objects", "zip"],
)
def test_what_is_damaged_is_decoded_again(folder: Path, root: Path, damage):
    first = [np.array(one) for one in seen(root)]
    for path in folder.iterdir():
        path.write_bytes(damage(path.read_bytes()))
    assert all(map(np.array_equal, first, seen(root)))
    assert all(map(np.array_equal, first, seen(root)))


def test_a_folder_that_cannot_be_written_costs_time_alone(
    tmp_path: Path, root: Path, monkeypatch: pytest.MonkeyPatch
):
    (tmp_path / "file").touch()
    monkeypatch.setenv("PACNET_CACHE", str(tmp_path / "file"))
    with pytest.warns(DatasetWarning, match="set PACNET_CACHE to a folder that can be written"):
        found = seen(root)
    assert [len(one) for one in found] == [*LENGTHS]


def test_several_readers_at_once(folder: Path, root: Path):
    with ThreadPoolExecutor(4) as pool:
        found = [*pool.map(lambda _: seen(root), range(8))]
    assert all(np.array_equal(a, b) for one in found for a, b in zip(one, found[0], strict=True))
    assert {path.suffix for path in folder.iterdir()} == {".npy"}


def footage(number: int) -> Footage:
    def frames() -> Iterator[tuple[int, np.ndarray]]:
        for frame in range(SHAPE[0]):
            yield frame, np.full(SHAPE[1:], number, np.uint8)

    return Footage(SHAPE[0], ("test", number), frames)


def test_the_files_used_longest_ago_go_first(folder: Path, monkeypatch: pytest.MonkeyPatch):
    clock = iter(range(1_000, 9_000))
    touch = os.utime
    monkeypatch.setattr("os.utime", lambda path: touch(path, (next(clock),) * 2))

    def read(cache: PictureCache, number: int) -> None:
        assert (cache.pictures(footage(number), lambda _: None) == number).all()

    large = PictureCache(10**6)
    for number in (0, 1, 2, 0):  # 1 was used longest ago, then 2
        read(large, number)
    large.close()
    files = {path.name for path in folder.iterdir()}
    size = next(folder.iterdir()).stat().st_size
    assert len(files) == 3
    (folder / "mine.npy").write_bytes(b"")
    small = PictureCache(2 * size)
    read(small, 3)
    small.close()
    assert len([*folder.glob("?" * 64 + ".npy")]) == 2
    assert (folder / "mine.npy").exists()

    def refuse() -> Iterator[tuple[int, np.ndarray]]:
        raise AssertionError("decoded")

    for number in (0, 3):
        kept = small.pictures(footage(number)._replace(frames=refuse), lambda _: None)
        assert (kept == number).all()


def test_the_user_chooses_the_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    from pacnet.datasets.pictures.cache import cache_folder

    monkeypatch.setenv("PACNET_CACHE", str(tmp_path))
    assert cache_folder() == tmp_path / "pictures"
    monkeypatch.delenv("PACNET_CACHE")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert cache_folder() == tmp_path / "pacnet/pictures"
    monkeypatch.setenv("XDG_CACHE_HOME", "relative")  # to be ignored, says the specification
    monkeypatch.setenv("HOME", str(tmp_path))
    assert cache_folder() == tmp_path / ".cache/pacnet/pictures"
