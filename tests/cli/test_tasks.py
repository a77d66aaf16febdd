"""Commands follow the task asked for, by its text, also one that was shown in a single frame."""

from pathlib import Path

import numpy as np
import pytest
from command_line import (
    ACTION,
    NAMES,
    STATE,
    SURROUNDINGS,
    command_line,
    record,
    refusal,
    rows_under,
    run,
    value_of,
)

from pacnet.datasets.demonstrations import load_demonstrations
from pacnet.datasets.recorder import Recorder


@pytest.mark.parametrize("command", ["watch", "export", "explain"])
def test_an_unknown_task_is_one_line_with_the_known_ones(
    command: str, imitator: Path, other: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    line = command_line(command, imitator, other, tmp_path / "out")
    message = refusal(capsys, *line, "--task", "juggle")
    assert message == "error: expected a task that was shown: 'drink', 'wave', got 'juggle'\n"
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("command", ["watch", "export", "explain"])
def test_a_task_is_known_whatever_its_blanks(
    command: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    root = record(tmp_path / "blanks", ("drink  beer", " drink beer "), 1011)
    assert run("fit", root, "--out", tmp_path / "in") == 0
    assert run("info", tmp_path / "in") == 0
    assert value_of("tasks", capsys.readouterr().out.split("\ncheckpoint ")[-1]) == "drink beer"
    line = command_line(command, tmp_path / "in", root, tmp_path / "out")
    assert run(*line, "--task", "\tdrink   beer") == 0


def test_an_episode_of_one_frame_goes_through_all_commands(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    root = record(tmp_path / "one", ("drink", "wave"), 1012)
    frame = {STATE: np.zeros((1, 2)), SURROUNDINGS: np.ones((1, 1)), ACTION: np.float64([[2, 3]])}
    with Recorder(root, 20, NAMES) as recorder:
        recorder.save_episode("blink", frame)
    assert run("fit", root, "--out", tmp_path / "in") == 0
    assert rows_under("dataset", capsys.readouterr().out)[2][2:4] == ["blink", "1"]
    task = ("--task", "blink")
    assert run("watch", tmp_path / "in", root, *task, "--out", tmp_path / "pictures") == 0
    row = rows_under("episode", capsys.readouterr().out)[2]
    assert [row[0], row[2], *row[5:7]] == ["2", "blink", "0.0%", "0.00"]
    assert float(row[3].removesuffix("%")) > 90
    assert row[-1] == "100.0%"  # its only frame is its last
    assert run("explain", tmp_path / "in", root, "--episode", 2, "--frame", 0, *task) == 0
    rows = rows_under("name", capsys.readouterr().out)
    assert rows[:2] == [["right", "2", "2"], ["up", "3", "3"]]
    assert run("export", tmp_path / "in", root, "--out", tmp_path / "copy") == 0
    assert len(load_demonstrations(tmp_path / "copy").episodes[2].state) == 1
