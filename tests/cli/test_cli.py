"""All commands: refusals of one line, wrong usage, progress bars, interrupts and help."""

import io
import re
import shlex
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import torch
from command_line import (
    ACTION,
    COMMANDS,
    INTERRUPT,
    NAMES,
    PROJECT,
    STATE,
    SURROUNDINGS,
    command_line,
    edit_info,
    process,
    record,
    refusal,
    run,
)
from tqdm import tqdm

import pacnet
from pacnet.imitator import Imitator


def test_it_tells_its_version(capsys: pytest.CaptureFixture[str]):
    assert run("--version") == 0
    assert capsys.readouterr().out == f"pacnet {pacnet.__version__}\n"


@pytest.mark.parametrize("command", [name for name in COMMANDS if name != "info"])
def test_a_dataset_that_cannot_be_read_is_one_line(
    command: str, imitator: Path, other: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    out = tmp_path / "out"

    def message(dataset: Path) -> str:
        return refusal(capsys, *command_line(command, imitator, dataset, out))

    assert "expected the folder of a LeRobot dataset" in message(tmp_path / "nowhere")
    assert "no LeRobot dataset: it has no meta/info.json" in message(tmp_path)
    old = tmp_path / "old"
    shutil.copytree(other, old)
    edit_info(old, lambda info: info.update(codebase_version="v1.6"))
    assert "found v1.6" in message(old)
    eye = tmp_path / "eye"
    shutil.copytree(other, eye)
    picture = {"dtype": "video", "shape": [3, 4, 4], "names": None}
    edit_info(eye, lambda info: info["features"].update({STATE: picture}))
    assert re.search(f"{STATE}.*video", message(eye))
    assert not out.exists()


@pytest.mark.parametrize("command", ["fit --from", "watch", "export", "explain"])
def test_a_dataset_of_something_else_is_one_line(
    command: str, imitator: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    names = {**NAMES, STATE: ("x", "elbow")}
    root = record(tmp_path / "else", ("drink",), 1005, names=names)
    message = refusal(capsys, *command_line(command, imitator, root, tmp_path / "out"))
    assert "expected 'observation.state' with the dimensions" in message
    assert "x, elbow" in message
    blind = {STATE: NAMES[STATE], "cup": NAMES[SURROUNDINGS], ACTION: NAMES[ACTION]}
    root = record(tmp_path / "blind", ("drink",), 1005, names=blind)
    message = refusal(capsys, *command_line(command, imitator, root, tmp_path / "out"))
    assert "observation.environment_state" in message
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("command", [name for name in COMMANDS if name != "fit"])
def test_no_checkpoint_is_one_line(
    command: str, other: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    def message(checkpoint: Path) -> str:
        return refusal(capsys, *command_line(command, checkpoint, other, tmp_path / "out"))

    assert "expected a checkpoint folder" in message(tmp_path / "nowhere")
    assert "expected a checkpoint folder" in message(other)
    (tmp_path / "model.safetensors").write_bytes(b"nothing")
    assert "expected a whole safetensors file" in message(tmp_path)
    if command != "info":
        network = PROJECT / "checkpoints" / "behaviours"
        assert "expected the checkpoint of an Imitator" in message(network)
        assert "got that of a PACNet" in message(network)
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("command", ["fit --from", "watch", "export", "explain"])
def test_a_dataset_of_another_rate_is_one_line(
    command: str, imitator: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    root = record(tmp_path / "fast", ("drink",), 1006, fps=30)
    message = refusal(capsys, *command_line(command, imitator, root, tmp_path / "out"))
    assert "expected 20 frames per second" in message
    assert "got 30" in message
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("command", ["fit", "watch"])
def test_a_file_where_a_folder_is_to_be_is_one_line(
    command: str, imitator: Path, other: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    (tmp_path / "out").touch()
    message = refusal(capsys, *command_line(command, imitator, other, tmp_path / "out"))
    assert f"expected --out as a folder, '{tmp_path / 'out'}' is a file" in message


def test_a_folder_where_a_file_is_to_be_is_one_line(
    imitator: Path, other: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    pytest.importorskip("rerun")
    message = refusal(capsys, "watch", imitator, other, "--rerun", tmp_path)
    assert f"expected --rerun as a file, '{tmp_path}' is a folder" in message


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (
            "explain in data --episode -1 --frame 0",
            "--episode: expected a whole number ≥ 0, got '-1'",
        ),
        ("explain in data --episode 0 --frame x", "--frame: expected a whole number ≥ 0, got 'x'"),
        (
            "fit data --out out --targets state --lead 0",
            "--lead: expected a whole number ≥ 1, got '0'",
        ),
        ("fit data --out out --budget 0", "--budget: expected a whole number ≥ 1, got '0'"),
        ("fit '' --out out", "DATASET: expected the name of a file or folder, got an empty one"),
        ("fit data --out ''", "--out: expected the name of a file or folder, got an empty one"),
        ("watch in data --out ''", "--out: expected the name of a file or folder"),
        ("export in data --out ''", "--out: expected the name of a file or folder"),
    ],
)
def test_wrong_usage_is_explained(
    arguments: str, expected: str, capsys: pytest.CaptureFixture[str]
):
    assert run(*shlex.split(arguments)) == 2
    assert expected in capsys.readouterr().err.splitlines()[-1]


@pytest.mark.parametrize(
    "arguments",
    [
        (),
        ("learn",),
        ("fit", "data"),
        ("fit", "data", "--out", "out", "--lead", "2"),
        ("fit", "data", "--out", "out", "--targets", "action", "--lead", "2"),
        ("fit", "data", "--out", "out", "--targets", "state", "--lead", "0"),
        ("fit", "data", "--out", "out", "--from", "in", "--targets", "state"),
        ("fit", "data", "--out", "out", "--from", "in", "--lead", "2"),
        ("fit", "data", "--out", "out", "--from", "in", "--budget", "9"),
        ("fit", "data", "--out", "out", "--corrections"),
        ("explain", "in", "data", "--episode", "-1", "--frame", "0"),
        ("explain", "in", "data", "--episode", "0"),
        ("watch", "in"),
    ],
)
def test_wrong_usage_exits_with_2(arguments: tuple[str, ...], capsys: pytest.CaptureFixture[str]):
    assert run(*arguments) == 2
    out, error = capsys.readouterr()
    assert out == ""
    assert error.startswith("usage: pacnet")


@pytest.mark.parametrize("command", ["fit", "watch", "export"])
def test_progress_bars_run_from_nothing_to_the_end(
    command: str, imitator: Path, other: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    bars = []

    class Watched(tqdm):
        """As on a terminal; notes where it stands each time."""

        def __init__(self, **named: Any) -> None:
            super().__init__(**{**named, "disable": False, "file": io.StringIO()})
            self.stood = [self.n]
            bars.append(self)

        def update(self, n: float | None = 1) -> bool | None:
            moved = super().update(n)
            self.stood.append(self.n)
            return moved

    monkeypatch.setattr("tqdm.tqdm", Watched)
    assert run(*command_line(command, imitator, other, tmp_path / "out")) == 0
    stood = {bar.desc: bar.stood for bar in bars}
    expected = {
        "fit": {"learning": [0, 80, 160, 240]},
        "watch": {
            "watching": [0, 50, 80, 130, 160, 210, 240],
            "drawing": [0, 1, 2, 3],
        },
        "export": {
            "watching": [0, 50, 80, 130, 160, 210, 240],
            "copying": [0, 80, 160, 240],
        },
    }
    assert stood == expected[command]
    assert [bar.total for bar in bars] == [bar.stood[-1] for bar in bars]


@pytest.fixture
def restored_threads() -> Iterator[None]:
    threads = torch.get_num_threads()
    yield
    torch.set_num_threads(threads)


@pytest.mark.usefixtures("restored_threads")
@pytest.mark.parametrize("command", ["fit", "watch", "export", "explain"])
def test_it_takes_no_more_than_one_thread(
    command: str, imitator: Path, other: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    threads = []
    method = "learn" if command == "fit" else "step"
    work = getattr(Imitator, method)

    def counting(self: Imitator, *given: Any, **named: Any) -> Any:
        threads.append(torch.get_num_threads())
        return work(self, *given, **named)

    monkeypatch.setattr(Imitator, method, counting)
    torch.set_num_threads(2)
    assert run(*command_line(command, imitator, other, tmp_path / "out")) == 0
    assert set(threads) == {1}


def test_ctrl_c_while_it_learns_leaves_nothing(dataset: Path, tmp_path: Path):
    code = f"""
from pacnet.imitator.imitator import Imitator
learn = Imitator.learn
def interrupt(_):
    {INTERRUPT}
Imitator.learn = lambda self, shown, _, **options: learn(self, shown, interrupt, **options)
"""
    done = process("fit", dataset, "--out", tmp_path / "out", code=code)
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "interrupted\n")
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
def test_ctrl_c_while_it_writes_waits_until_the_checkpoint_is_whole(
    dataset: Path, imitator: Path, tmp_path: Path
):
    code = f"""
from pacnet.core import checkpoint
write = checkpoint.open_synced
def interrupted(path):
    {INTERRUPT}
    return write(path)
checkpoint.open_synced = interrupted
"""
    done = process("fit", dataset, "--out", tmp_path / "out", code=code)
    assert (done.returncode, done.stderr) == (130, "interrupted\n")
    written = {file.name: file.read_bytes() for file in (tmp_path / "out").iterdir()}
    assert written == {file.name: file.read_bytes() for file in imitator.iterdir()}


def test_help_lists_every_command():
    done = subprocess.run(
        [sys.executable, "-m", "pacnet", "--help"],
        cwd=PROJECT, capture_output=True, text=True, check=True,
    )  # fmt: skip
    for command in ("fit", "info", "watch", "export", "explain"):
        assert re.search(rf"^ +{command} +\w", done.stdout, re.MULTILINE)
    assert "pacnet fit recordings/drinking --out imitator" in done.stdout


@pytest.mark.parametrize("command", ["fit", "info", "watch", "export", "explain"])
def test_help_of_a_command_ends_with_an_example(command: str, capsys: pytest.CaptureFixture[str]):
    assert run(command, "--help") == 0
    out = capsys.readouterr().out
    assert re.search(rf"\nexample:\n  pacnet {command} \S", out)
    assert max(map(len, out.splitlines())) <= 100


@pytest.mark.slow
def test_a_closed_pipe_gives_no_traceback(imitator: Path):
    command = f"{sys.executable} -m pacnet info {imitator} | true"
    done = subprocess.run(
        ["bash", "-c", command], cwd=PROJECT, capture_output=True, text=True, check=False
    )
    assert done.stderr == ""
