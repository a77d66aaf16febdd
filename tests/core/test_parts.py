"""Claims about folders that lack a part: the part, its folder and what to do are named."""

import re
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
import torch

from pacnet.core.checkpoint import read_checkpoint, write_checkpoint
from pacnet.core.parts import REMEDY, check_part, read_json_part

POINTER = b"version https://git-lfs.github.com/spec/v1\noid sha256:4d7a\nsize 12345\n"
FILES = ("config.json", "model.safetensors")


def remove(path: Path) -> None:
    path.unlink()


def replace_by_folder(path: Path) -> None:
    path.unlink()
    path.mkdir()


def cut(path: Path) -> None:
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])


DAMAGE: dict[str, Callable[[Path], object]] = {
    "missing": remove,
    "folder": replace_by_folder,
    "empty": lambda path: path.write_bytes(b""),
    "truncated": cut,
    "pointer": lambda path: path.write_bytes(POINTER),
}


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    write_checkpoint(tmp_path / "net", {"nodes": 2}, {"rows": torch.arange(6.0)})
    return tmp_path / "net"


@pytest.mark.parametrize("name", FILES)
@pytest.mark.parametrize("damage", DAMAGE)
def test_a_checkpoint_that_lacks_a_part_is_refused_by_name(folder: Path, name: str, damage: str):
    DAMAGE[damage](folder / name)
    with pytest.raises((FileNotFoundError, ValueError), match=re.escape(name)) as refused:
        read_checkpoint(folder)
    message = str(refused.value)
    assert str(folder) in message
    assert "\n" not in message
    assert ("git lfs pull" if damage == "pointer" else REMEDY) in message
    assert isinstance(refused.value, FileNotFoundError) is (damage == "missing")


def test_what_is_no_folder_is_said_as_such(folder: Path):
    shutil.rmtree(folder)
    for call in (read_checkpoint, lambda path: check_part(path, "config.json")):
        with pytest.raises(FileNotFoundError, match=r"no( such)? folder"):
            call(folder)


def test_a_json_part_holds_an_object(folder: Path):
    assert read_json_part(folder, "config.json")["config"] == {"nodes": 2}
    for text in (b"[1]", b"\xff", b"[" * 100_000, b'{"a":'):
        (folder / "config.json").write_bytes(text)
        with pytest.raises(ValueError, match=r"expected .*JSON, got '.*config\.json'"):
            read_json_part(folder, "config.json")
