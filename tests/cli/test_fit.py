"""`pacnet fit` learns what the Python API learns."""

import re
import shutil
from pathlib import Path

import numpy as np
import pytest
from command_line import (
    ACTION,
    NAMES,
    STATE,
    SURROUNDINGS,
    assert_equal,
    process,
    record,
    refusal,
    rows_under,
    run,
    trained,
    unannounced,
    value_of,
)

from pacnet.datasets.demonstrations import load_demonstrations
from pacnet.imitator import Imitator


def test_fit_prints_what_each_episode_changed(
    dataset: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    assert run("fit", dataset, "--out", tmp_path / "out") == 0
    out, error = capsys.readouterr()
    assert unannounced(error) == ""  # no progress bar outside a terminal
    rows = rows_under("dataset", out)
    saved = Imitator.from_pretrained(tmp_path / "out")
    assert [row[:4] for row in rows] == [
        ["shown", str(number), task, "80"] for number, task in enumerate(("drink", "wave") * 3)
    ]
    grown = np.array([int(row[4]) for row in rows])
    assert [int(row[5]) for row in rows] == grown.cumsum().tolist()
    assert grown.sum() == len(saved.sofm) == int(value_of("nodes", out))
    novelty = [row[7] for row in rows]
    assert novelty[0] == "–"
    assert float(novelty[1]) > 1  # the first that waves
    assert max(map(float, novelty[2:])) < float(novelty[1]) / 2
    assert [row[6] for row in rows] == ["100.0%"] * 6
    assert value_of("tasks", out) == "2"
    assert value_of("targets", out) == "480 actions"
    assert value_of("learned", out).startswith("6 episodes, 480 frames in ")


def test_fit_keeps_within_a_budget(
    dataset: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    assert run("fit", dataset, "--budget", 100, "--out", tmp_path / "out") == 0
    out = capsys.readouterr().out
    saved, shown = Imitator.from_pretrained(tmp_path / "out"), load_demonstrations(dataset)
    python = Imitator.from_demonstrations(shown, budget=100)
    python.learn(shown)
    assert_equal(saved, python)
    kept = len(saved.memory.rows)
    assert 20 < kept <= 100  # of what is only noise less is kept
    assert value_of("targets", out) == f"{kept} actions of 480 shown"
    # By a second method: a demonstration's frames begin again at a lower number.
    time = saved.memory.rows.live("time").numpy()
    rows = [len(part) for part in np.split(time, np.flatnonzero(np.diff(time) < 0) + 1)]
    shares = [row[6] for row in rows_under("dataset", out)]
    assert [share for share in shares if share != "0.0%"] == [f"{row / 80:.1%}" for row in rows]
    assert len(rows) == 5  # of 20 each, the last ones among them
    assert "0.0%" in shares[:-2]
    assert run("info", tmp_path / "out") == 0
    assert [row[6] for row in rows_under("dataset", capsys.readouterr().out)] == shares
    more = ("fit", dataset, "--from", tmp_path / "out", "--out", tmp_path / "more")
    assert run(*more) == 0  # the budget stays
    python.learn(shown)
    assert_equal(Imitator.from_pretrained(tmp_path / "more"), python)
    targets = value_of("targets", capsys.readouterr().out)
    assert targets == f"{len(python.memory.rows)} actions of 960 shown"
    assert len(python.memory.rows) <= 100


def test_fit_writes_what_python_learns(dataset: Path, imitator: Path):
    assert_equal(Imitator.from_pretrained(imitator), trained(dataset))


def test_fit_continues_from_a_checkpoint(
    dataset: Path,
    other: Path,
    imitator: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
):
    before = (imitator / "model.safetensors").read_bytes()
    assert run("fit", other, "--from", imitator, "--out", tmp_path) == 0
    assert_equal(Imitator.from_pretrained(tmp_path), trained(dataset, other))
    assert (imitator / "model.safetensors").read_bytes() == before
    out = capsys.readouterr().out
    assert [row[0] for row in rows_under("dataset", out)] == ["others"] * 3
    assert value_of("learned", out).endswith("(9 episodes in all)")


def test_fit_with_corrections_leaves_thresholds_alone(dataset: Path, other: Path, tmp_path: Path):
    assert run("fit", dataset, "--out", tmp_path / "one") == 0
    more = ("fit", other, "--from", tmp_path / "one")
    assert run(*more, "--corrections", "--out", tmp_path / "corrected") == 0
    assert run(*more, "--out", tmp_path / "both") == 0
    one, corrected, both = (
        Imitator.from_pretrained(tmp_path / name).novelty_detector
        for name in ("one", "corrected", "both")
    )
    assert np.array_equal(corrected.thresholds, one.thresholds)
    assert not np.array_equal(both.thresholds, one.thresholds)
    assert [int(detector.compared) for detector in (one, corrected, both)] == [6, 6, 9]


def test_fit_replaces_a_checkpoint_only_when_asked(
    dataset: Path, other: Path, imitator: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    shutil.copytree(imitator, tmp_path / "copy")
    message = refusal(capsys, "fit", other, "--out", tmp_path / "copy")
    assert "expected a folder without a checkpoint" in message
    assert f"--from {tmp_path / 'copy'}" in message
    assert "--overwrite" in message
    message = refusal(capsys, "fit", other, "--out", tmp_path / "copy", "--from", imitator)
    assert "expected a folder without a checkpoint" in message
    assert run("fit", other, "--out", tmp_path / "copy", "--from", f"{tmp_path}/copy/") == 0
    assert_equal(Imitator.from_pretrained(tmp_path / "copy"), trained(dataset, other))
    assert run("fit", other, "--out", tmp_path / "copy", "--overwrite") == 0
    assert_equal(Imitator.from_pretrained(tmp_path / "copy"), trained(other))


def test_fit_takes_features_by_name(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    names = dict(zip(("observation.hand", "observation.cup", "aim"), NAMES.values(), strict=True))
    root = record(tmp_path / "renamed", ("drink", "wave"), 1002, names=names)
    message = refusal(capsys, "fit", root, "--out", tmp_path / "out")
    assert "expected the features 'observation.state' and 'action'" in message
    assert "'observation.hand' [2], 'observation.cup' [1], 'aim' [2]" in message
    assert "--state NAME and --action NAME" in message
    options = ("--state", "observation.hand", "--action", "aim")
    cup = ("--environment-state", "observation.cup")
    assert run("fit", root, *options, *cup, "--out", tmp_path / "out") == 0
    config = Imitator.from_pretrained(tmp_path / "out").config
    assert config.percepts == {"observation.hand": ("x", "y"), "observation.cup": ("z",)}
    assert config.action == ("right", "up")
    assert run("fit", root, *options, "--out", tmp_path / "blind") == 0
    assert list(Imitator.from_pretrained(tmp_path / "blind").config.percepts) == [
        "observation.hand"
    ]


def test_fit_can_leave_the_environment_state_out(dataset: Path, tmp_path: Path):
    assert run("fit", dataset, "--environment-state", "none", "--out", tmp_path) == 0
    assert Imitator.from_pretrained(tmp_path).percept_names == ("x", "y")
    assert run("fit", dataset, "--from", tmp_path, "--out", tmp_path) == 0  # knows what it takes
    assert len(Imitator.from_pretrained(tmp_path).reports) == 12


def test_fit_can_aim_at_states(dataset: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    assert run("fit", dataset, "--targets", "state", "--lead", 3, "--out", tmp_path) == 0
    config = Imitator.from_pretrained(tmp_path).config
    assert (config.targets, config.lead) == ("state", 3)
    out, error = capsys.readouterr()
    assert value_of("targets", out).endswith(" states")
    model = value_of("forward model", out)
    assert re.match(r"(affine|network), which predicts \d+% of the change over 3 frames", model)
    # From each frame to the next within 6 episodes of 80: what takes its time is announced.
    assert unannounced(error) == "fitting the forward model to 474 transitions ...\n"
    assert run("fit", dataset, "--from", tmp_path, "--out", tmp_path) == 0
    assert unannounced(capsys.readouterr().err) == ""  # it stays what it is
    assert run("info", tmp_path) == 0
    told = capsys.readouterr().out
    assert "states of 2 dimensions, 3 frames ahead" in told
    assert value_of("forward model", told) == model


def test_four_frames_are_enough_to_act(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    root = record(tmp_path / "short", ("drink",), 1003, frames=4)
    assert run("fit", root, "--out", tmp_path / "out") == 0
    assert value_of("targets", capsys.readouterr().out) == "4 actions"
    assert run("watch", tmp_path / "out", root) == 0
    (row,) = rows_under("episode", capsys.readouterr().out)
    assert row[-3:] == ["100.0%", "–", "100.0%"]


@pytest.mark.slow
def test_thirty_thousand_frames_are_what_python_learns(tmp_path: Path):
    from pacnet.datasets.recorder import Recorder

    rng = np.random.default_rng(1007)
    names = {
        STATE: [f"joint {number}" for number in range(22)],
        SURROUNDINGS: [f"glass {number}" for number in range(6)],
        ACTION: [f"motor {number}" for number in range(11)],
    }
    mix = rng.standard_normal((4, 28))
    with Recorder(tmp_path / "data", 50, names) as recorder:
        for number in range(30):
            time = np.linspace(0, 6, 1000)[:, None]
            bend = (1 - 2 * (number % 2)) * np.clip(time - 2, 0, None)
            moves = np.hstack([np.sin(time), np.cos(1.4 * time), bend, time / 3])
            path = moves @ mix + 0.01 * rng.standard_normal((1000, 28))
            episode = (path[:, :22], path[:, 22:], np.roll(path, -1, axis=0)[:, :11])
            recorder.save_episode(
                ("drink", "wave")[number % 2], dict(zip(names, episode, strict=True))
            )
    done = process("fit", tmp_path / "data", "--out", tmp_path / "out")
    assert done.returncode == 0, done.stderr
    assert value_of("learned", done.stdout).startswith("30 episodes, 30,000 frames in ")
    assert_equal(Imitator.from_pretrained(tmp_path / "out"), trained(tmp_path / "data"))
