"""Files are whole and on the disk, or not there at all."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import pytest

from pacnet.core.durable import make_folder, open_synced, write_atomically


@pytest.mark.parametrize("name", ["file", "file.new"])
@pytest.mark.parametrize("link", [Path.symlink_to, Path.hardlink_to])
def test_a_link_is_replaced_and_not_written_through(
    tmp_path: Path, name: str, link: Callable[[Path, Path], None]
):
    (tmp_path / "precious").write_text("mine")
    link(tmp_path / name, tmp_path / "precious")
    write_atomically(tmp_path / "file", b"new")
    assert (tmp_path / "precious").read_text() == "mine"
    assert (tmp_path / "file").read_text() == "new"
    assert not (tmp_path / "file").is_symlink()


def test_a_write_that_fails_leaves_the_old_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    write_atomically(tmp_path / "file", b"old")

    def fail(_handle: int) -> None:
        raise OSError("no space")

    with monkeypatch.context() as patch:
        patch.setattr(os, "fsync", fail)
        with pytest.raises(OSError, match="no space"):
            write_atomically(tmp_path / "file", b"new")
    assert (tmp_path / "file").read_bytes() == b"old"
    write_atomically(tmp_path / "file", b"newer")  # what the first attempt left is no obstacle
    assert (tmp_path / "file").read_bytes() == b"newer"
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


def test_a_file_that_is_opened_anew_is_empty(tmp_path: Path):
    (tmp_path / "file").write_bytes(b"a long text")
    with open_synced(tmp_path / "file") as file:
        file.write(b"text")
    assert (tmp_path / "file").read_bytes() == b"text"


def test_every_folder_that_was_made_is_synced_with_its_parent(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    synced = []
    monkeypatch.setattr("pacnet.core.durable.sync_folder", synced.append)
    make_folder(tmp_path / "one" / "two")
    make_folder(tmp_path / "one" / "two")
    assert (tmp_path / "one" / "two").is_dir()
    assert sorted(synced) == [tmp_path, tmp_path / "one"]
