"""`pacnet fit --points` says which dimensions are points; `fit` and `info` print what is used."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pytest
from command_line import SURROUNDINGS, assert_equal, record, refusal, run, value_of

from pacnet.datasets.demonstrations import load_demonstrations
from pacnet.datasets.recorder import Recorder
from pacnet.imitator import Imitator
from pacnet.schemas.points import Point, Points

NAMES = {"observation.state": ("a", "b"), SURROUNDINGS: ("c",), "action": ("right", "up")}
HAND = "hand=observation.state[0:2]"


@pytest.fixture(scope="module")
def pushing(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A dataset of a hand, a box that is turned, and a speed."""
    root = tmp_path_factory.mktemp("data") / "pushing"
    names = {
        "observation.state": ("hand.x", "hand.y", "hand.vx"),
        SURROUNDINGS: ("box.x", "box.y", "box.yaw", "goal.x", "goal.y"),
        "action": ("hand.vx", "hand.vy"),
    }
    rng = np.random.default_rng(0)
    with Recorder(root, 20, names, "hand") as recorder:
        for number in range(3):
            path = np.linspace(0, 1 + number, 40)[:, None] + 0.01 * rng.standard_normal((40, 3))
            place = np.tile(0.1 * number + np.array([1, 2, 0, 4, 5]), (40, 1))
            values = (path, place, np.gradient(path[:, :2], axis=0))
            recorder.save_episode("push", dict(zip(names, values, strict=True)))
    return root


def record_missing(root: Path, names: Mapping[str, Sequence[str]]) -> Path:
    """A dataset of two numbers each; the surroundings are zero in its first episode."""
    with Recorder(root, 20, names) as recorder:
        for number in range(2):
            path = np.linspace(0, 1, 40)[:, None] * [1.0, 2.0]
            values = (path, np.full((40, 2), float(number)), path)
            recorder.save_episode("push", dict(zip(names, values, strict=True)))
    return root


FOUND = Points(Point("hand", (0, 1)), (Point("box", (3, 4), (5,)), Point("goal", (6, 7))))


def test_points_are_found_and_printed(
    pushing: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    assert run("fit", pushing, "--out", tmp_path / "out") == 0
    assert value_of("points", capsys.readouterr().out) == "hand (moved), box, goal"
    assert Imitator.from_pretrained(tmp_path / "out").config.points == FOUND
    assert run("info", tmp_path / "out") == 0
    assert value_of("points", capsys.readouterr().out) == "hand (moved), box, goal"
    assert run("info", tmp_path / "out", "--json") == 0
    document = json.loads(capsys.readouterr().out)
    assert document["points"] == {
        "hand": ["hand.x", "hand.y"], "box": ["box.x", "box.y", "box.yaw"],
        "goal": ["goal.x", "goal.y"],
    }  # fmt: skip
    assert next(iter(document["points"])) == "hand"
    assert document["no_points"] is None


def test_points_that_are_given_are_used(
    pushing: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    given = ["tip=observation.state[0:2]", f"box={SURROUNDINGS}[0:2]+{SURROUNDINGS}[2:3]"]
    assert run("fit", pushing, "--out", tmp_path / "out", "--points", *given) == 0
    assert value_of("points", capsys.readouterr().out) == "tip (moved), box"
    saved, shown = Imitator.from_pretrained(tmp_path / "out"), load_demonstrations(pushing)
    python = Imitator.from_demonstrations(shown, points=given)
    python.learn(shown)
    assert_equal(saved, python)
    assert saved.config.points == Points(Point("tip", (0, 1)), (Point("box", (3, 4), (5,)),))
    more = ("fit", pushing, "--from", tmp_path / "out", "--out", tmp_path / "more")
    assert run(*more) == 0  # they stay
    assert value_of("points", capsys.readouterr().out) == "tip (moved), box"


def test_points_are_used_within_a_budget(
    pushing: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    assert run("fit", pushing, "--out", tmp_path / "out", "--budget", 30) == 0
    printed = capsys.readouterr().out
    assert value_of("points", printed) == "hand (moved), box, goal"
    saved = Imitator.from_pretrained(tmp_path / "out")
    assert saved.config.points == FOUND
    assert 0 < len(saved.memory.rows) <= 30
    assert value_of("targets", printed) == f"{len(saved.memory.rows)} actions of 120 shown"
    assert run("info", tmp_path / "out") == 0
    assert value_of("budget", capsys.readouterr().out) == "30 targets at most"


def test_points_can_be_switched_off(
    pushing: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    assert run("fit", pushing, "--points", "none", "--out", tmp_path / "out") == 0
    reason = "as asked, or since hand, box, goal, found by their names, do not hold"
    assert value_of("points", capsys.readouterr().out) == f"none: {reason}"
    assert Imitator.from_pretrained(tmp_path / "out").config.points is None
    assert run("info", tmp_path / "out", "--json") == 0
    document = json.loads(capsys.readouterr().out)
    assert (document["points"], document["no_points"]) == ({}, reason)


def test_where_there_are_none_the_reason_is_printed(
    imitator: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    assert run("info", imitator) == 0
    text = value_of("points", capsys.readouterr().out)
    assert text == "none: hand alone: no landmark in as many dimensions"
    unnamed = record(tmp_path / "unnamed", ["drink"], 0, names=NAMES)
    assert run("fit", unnamed, "--out", tmp_path / "out") == 0
    text = value_of("points", capsys.readouterr().out)
    assert text.startswith("none: no dimensions are called like coordinates")


def test_what_does_not_hold_is_left_out_with_a_note(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    names = {**NAMES, SURROUNDINGS: ("x", "y")}
    record_missing(tmp_path / "missing", names)
    given = [HAND, f"box={SURROUNDINGS}"]
    out = ("--out", tmp_path / "out")
    error = refusal(capsys, "fit", tmp_path / "missing", *out, "--points", *given)
    assert "expected 'box' to be there in every episode" in error
    assert "--exclude 0" in error
    kept = ("fit", tmp_path / "missing", *out, "--exclude", 0, "--points", *given)
    assert run(*kept) == 0
    named = record_missing(tmp_path / "named", names | {"observation.state": ("x", "y")})
    capsys.readouterr()
    assert run("fit", named, "--out", tmp_path / "other") == 0
    printed, error = capsys.readouterr()
    assert "note: by its name it is a point, but it is not used as one: expected 'object'" in error
    assert value_of("points", printed).startswith("none: as asked, or since")


def test_points_that_are_none_are_refused(
    pushing: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    def refused(*texts: str) -> str:
        return refusal(capsys, "fit", pushing, "--out", tmp_path / "out", "--points", *texts)

    assert "a landmark at least" in refused(HAND)
    assert "NAME=FEATURE[FIRST:END]" in refused(HAND, "box")
    there = "observation.state [3], observation.environment_state [5]"
    assert f"of the features {there}, got 'box'" in refused(HAND, "box=box")
    assert "expected 'box' as 2 or 3 dimensions, got 5" in refused(HAND, f"box={SURROUNDINGS}")
    assert "within the 3 dimensions" in refused(HAND, "box=observation.state[2:4]")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--points", "none", HAND), "argument --points: none only by itself"),
        (("--points", HAND, "--from", "other"), "argument --points: not with --from"),
        (("--points",), "argument --points: expected at least one argument"),
    ],
)
def test_usage_is_checked(
    options: tuple[str, ...], message: str, pushing: Path, tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
):  # fmt: skip
    assert run("fit", pushing, "--out", tmp_path / "out", *options) == 2
    assert message in capsys.readouterr().err


def test_help_explains_points(capsys: pytest.CaptureFixture[str]):
    assert run("fit", "--help") == 0
    text = " ".join(capsys.readouterr().out.split())
    assert "--points POINT [POINT ...]" in text
    assert "'hand=observation.state[0:3]': first the one that the robot's actions move" in text
