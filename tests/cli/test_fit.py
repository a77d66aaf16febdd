"""`pacnet fit` learns what the Python API learns."""

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

from pacnet.imitator import Imitator


def test_fit_prints_what_each_episode_changed(
    dataset: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    assert run("fit", dataset, "--out", tmp_path / "out") == 0
    out, error = capsys.readouterr()
    assert unannounced(error) == ""  # no progress bar outside a terminal
    rows = rows_under("dataset", out)
    saved = Imitator.from_pretrained(tmp_path / "out").network
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
    assert int(value_of("schemas", out)) == len(saved.schemas.lengths)
    assert value_of("targets", out) == f"{int(saved.schemas.lengths.sum())} actions"
    assert value_of("learned", out).startswith("6 episodes, 480 frames in ")


def test_fit_prints_the_share_of_each_episode_that_is_stored(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    for frames in (80, 24, 4):
        root = record(tmp_path / f"{frames}", ("drink",), 1010, frames)
        assert run("fit", root, "--out", tmp_path / f"trained{frames}") == 0
        ((*_, stored, _),) = rows_under("dataset", capsys.readouterr().out)
        schemas = Imitator.from_pretrained(tmp_path / f"trained{frames}").network.schemas
        # Of one episode alone no target is merged with another's: each has a frame of its own.
        kept = {
            frame
            for schema in range(len(schemas.lengths))
            for frame in schemas.frames(schema).tolist()
        }
        assert stored == f"{len(kept) / frames:.1%}"
        assert run("info", tmp_path / f"trained{frames}") == 0
        assert rows_under("dataset", capsys.readouterr().out)[0][6] == stored
    assert stored == "0.0%"


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
    assert len(both.episodes) > len(corrected.episodes) == len(one.episodes)


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
    # From each frame to the next within 6 episodes of 80: what takes its time is announced.
    assert unannounced(error) == "fitting the forward model to 474 transitions ...\n"
    assert run("fit", dataset, "--from", tmp_path, "--out", tmp_path) == 0
    assert unannounced(capsys.readouterr().err) == ""  # it stays what it is
    assert run("info", tmp_path) == 0
    assert "states of 2 dimensions, 3 frames ahead" in capsys.readouterr().out


def test_fit_says_when_no_targets_were_stored(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    root = record(tmp_path / "short", ("drink",), 1003, frames=4)
    assert run("fit", root, "--out", tmp_path / "out") == 0
    out, error = capsys.readouterr()
    assert value_of("targets", out) == "0 actions"
    assert error.startswith("note: no targets were stored")
    assert error.count("\n") == 1
    assert "expected a network that has learned schemas" in refusal(
        capsys, "watch", tmp_path / "out", root
    )


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
