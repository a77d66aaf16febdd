"""Claims about the cache of compiled kernels: it is used where it can be, and needed nowhere."""

from __future__ import annotations

import importlib.util
import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from pacnet.kernels import caching

PROJECT = Path(__file__).parents[2]
SOURCE = """
from pacnet.kernels.caching import cached_njit

@cached_njit()
def double(x):
    return 2 * x

@cached_njit(nogil=True)
def triple(x):
    return 3 * x
"""
NOTE = "pacnet: compiled kernels cannot be kept, so each process compiles them, some 10 s: "
IMPORT_ALL = """
import importlib, pkgutil, pacnet
for module in pkgutil.walk_packages(pacnet.__path__, "pacnet."):
    if module.name.rpartition(".")[2] != "__main__":
        importlib.import_module(module.name)
print(pacnet.__file__)
"""
LEARN = """
import numpy as np, torch
from pacnet import Imitator
from pacnet.attention.kernels import learn
from pacnet.datasets.demonstrations import Demonstration, Demonstrations
phase = torch.linspace(0, 1.5, 200)[:, None]
shown = Demonstration(0, "wave", phase.sin(), torch.empty(200, 0), phase.cos())
names = {"observation.state": ("elbow",), "action": ("motor",)}
demonstrations = Demonstrations(50, names, (shown,), "waving")
imitator = Imitator.from_demonstrations(demonstrations)
imitator.learn(demonstrations)
print(imitator.step(np.float32([0.5])).action.round(1))
print(sum(learn.stats.cache_hits.values()), sum(learn.stats.cache_misses.values()))
"""


@pytest.fixture(autouse=True)
def messages(monkeypatch: pytest.MonkeyPatch) -> None:
    """Those of a process that has printed none yet."""
    monkeypatch.setattr(caching, "_messages", caching._Messages())


@pytest.fixture
def source(tmp_path: Path) -> Path:
    path = tmp_path / "tiny.py"
    path.write_text(SOURCE)
    return path


def load(source: Path) -> Any:
    """The kernels as a new process has them."""
    spec = importlib.util.spec_from_file_location("tiny", source)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def without_folders(folder: Path) -> dict[str, str]:
    """Block the cache beside each source by a file; the variables that block a user's own."""
    folders = [path for path in folder.rglob("*") if path.is_dir() and path.name != "__pycache__"]
    for path in [folder, *folders]:
        shutil.rmtree(path / "__pycache__", ignore_errors=True)
        (path / "__pycache__").touch()
    return {"HOME": "/dev/null/home", "XDG_CACHE_HOME": "/dev/null/cache"}


def cache_of(source: Path, suffix: str) -> Path:
    """The one file of `double` with a suffix: .nbi the index, .nbc the machine code."""
    (path,) = (source.parent / "__pycache__").glob(f"tiny.double-*{suffix}")
    return path


def hits(kernel: Any) -> tuple[int, int]:
    """How often a kernel was loaded, and compiled."""
    stats = kernel.stats
    return sum(stats.cache_hits.values()), sum(stats.cache_misses.values())


def test_the_second_process_loads_what_the_first_compiled(
    source: Path, capsys: pytest.CaptureFixture[str]
):
    for expected in ((0, 1), (1, 0), (1, 0)):
        tiny = load(source)
        assert (tiny.double(4), tiny.triple(4)) == (8, 12)
        assert hits(tiny.double) == hits(tiny.triple) == expected
    assert capsys.readouterr().err == ""


def test_without_a_folder_kernels_compile_with_one_note(
    source: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    for name, value in without_folders(source.parent).items():
        monkeypatch.setenv(name, value)
    tiny = load(source)
    assert capsys.readouterr().err == ""  # nothing to tell unless something is compiled
    assert (tiny.double(4), tiny.double(0.5), tiny.triple(4)) == (8, 1.0, 12)
    error = capsys.readouterr().err
    assert error.startswith(f"{NOTE}set NUMBA_CACHE_DIR to a folder that can be written (")
    assert error.count("\n") == 1
    assert str(source) in error


def test_a_folder_that_can_no_longer_be_written_gives_one_note(
    source: Path, capsys: pytest.CaptureFixture[str]
):
    tiny = load(source)
    without_folders(source.parent)
    assert (tiny.double(4), tiny.triple(4)) == (8, 12)
    error = capsys.readouterr().err
    assert error.startswith(NOTE)
    assert error.count("\n") == 1
    assert "__pycache__" in error


@pytest.mark.parametrize("suffix", ["nbi", "nbc"])
@pytest.mark.parametrize("damage", ["empty", "truncated", "other"])
def test_a_damaged_cache_is_replaced(
    source: Path, suffix: str, damage: str, capsys: pytest.CaptureFixture[str]
):
    assert load(source).double(4) == 8
    path = cache_of(source, suffix)
    content = path.read_bytes()
    share = {"empty": b"", "truncated": content[: len(content) // 2], "other": b"version https"}
    path.write_bytes(share[damage])
    for expected in ((0, 1), (1, 0)):
        tiny = load(source)
        assert tiny.double(4) == 8
        assert hits(tiny.double) == expected
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize("suffix", ["nbi", "nbc"])
def test_a_cache_that_can_be_neither_read_nor_replaced_gives_a_note(
    source: Path, suffix: str, capsys: pytest.CaptureFixture[str]
):
    assert load(source).double(4) == 8
    path = cache_of(source, suffix)
    path.unlink()
    path.mkdir()
    assert load(source).double(4) == 8
    error = capsys.readouterr().err
    assert error.startswith(NOTE)
    assert path.name in error


def test_a_damaged_index_that_cannot_be_replaced_gives_a_note(
    source: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    def refuse(*_: object) -> None:
        raise PermissionError("read-only")

    assert load(source).double(4) == 8
    cache_of(source, "nbi").write_bytes(b"")
    monkeypatch.setattr("numba.core.caching.os.replace", refuse)
    assert load(source).double(4) == 8
    assert capsys.readouterr().err.startswith(NOTE)


def process(code: str, folder: Path, **variables: str) -> subprocess.CompletedProcess[str]:
    """A process that finds pacnet in this folder."""
    environment = {**os.environ, "PYTHONPATH": str(folder), **variables}
    return subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True, text=True, check=True, env=environment, cwd=folder, timeout=600,
    )  # fmt: skip


@pytest.fixture
def installed(tmp_path: Path) -> Path:
    """A copy of the package, without a cache."""
    ignored = shutil.ignore_patterns("__pycache__")
    shutil.copytree(PROJECT / "pacnet", tmp_path / "pacnet", ignore=ignored)
    return tmp_path


def test_every_module_is_imported_where_nothing_can_be_written(installed: Path):
    done = process(IMPORT_ALL, installed, **without_folders(installed))
    assert done.stdout.startswith(str(installed))
    assert "pacnet:" not in done.stderr  # but Matplotlib reports its own cache


@pytest.mark.slow
def test_an_installation_where_nothing_can_be_written_works_with_one_note(installed: Path):
    done = process(LEARN, installed, **without_folders(installed))
    assert done.stdout == "[0.9]\n0 1\n"
    assert done.stderr.startswith(NOTE)
    assert done.stderr.count("\n") == 1


@pytest.mark.slow
def test_a_usual_installation_compiles_once(installed: Path):
    first, second = (process(LEARN, installed) for _ in range(2))
    assert first.stdout == "[0.9]\n0 1\n"
    assert first.stderr == "pacnet: compiling for this machine, once, some 10 s ...\n"
    assert (second.stdout, second.stderr) == ("[0.9]\n1 0\n", "")
