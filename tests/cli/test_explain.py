"""`pacnet explain` names the reason and the demonstrations of an action."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from command_line import refusal, rows_under, run, value_of

from pacnet.cli.explain import print_explanation
from pacnet.cli.explanation import explain
from pacnet.datasets.demonstrations import load_demonstrations
from pacnet.imitator import Imitator, ImitatorStep


def explained(capsys: pytest.CaptureFixture[str], *arguments: object) -> dict[str, Any]:
    capsys.readouterr()
    assert run("explain", *arguments, "--json") == 0
    return json.loads(capsys.readouterr().out, parse_constant=pytest.fail)


def stepped(
    checkpoint: Path, dataset: Path, episode: int, frame: int, task: str | None = None
) -> ImitatorStep:
    """The second method: the last step of a run from the episode's start."""
    known = Imitator.from_pretrained(checkpoint)
    known.reset(task)
    percepts = load_demonstrations(dataset).episodes[episode].percepts[: frame + 1]
    return [known.step(percept) for percept in percepts][-1]


def test_explain_has_what_the_step_returned(
    imitator: Path, other: Path, capsys: pytest.CaptureFixture[str]
):
    document = explained(capsys, imitator, other, "--episode", 1, "--frame", 60)
    step = stepped(imitator, other, 1, 60)
    assert step.action is not None
    assert (document["decision"], document["asked_for"]) == ("acts", None)
    assert list(document["action"]) == ["right", "up"]
    assert document["action"] == document["target"]
    np.testing.assert_array_equal(np.float32(list(document["action"].values())), step.action)
    for name in ("novelty", "dimension", "deviation", "threshold", "progress", "is_done"):
        assert document[name] == getattr(step, name)
    percept = load_demonstrations(other).episodes[1].percepts[60]
    assert document["percept"] == dict(zip("xyz", percept.tolist(), strict=True))


def test_explain_names_the_frames_of_the_demonstrations_that_are_followed(
    imitator: Path, dataset: Path, other: Path, capsys: pytest.CaptureFixture[str]
):
    document = explained(capsys, imitator, other, "--episode", 1, "--frame", 60)
    followed, step = document["followed"], stepped(imitator, other, 1, 60)
    assert [(row["episode"], row["frame"], row["weight"]) for row in followed] == [*step.followed]
    assert {row["dataset"] for row in followed} == {"shown"}
    assert sum(row["weight"] for row in followed) == pytest.approx(1)
    # About the same moments of the three drinks count for most.
    assert {row["episode"] for row in followed[:3]} == {0, 2, 4}
    assert all(abs(row["frame"] - 60) <= 2 for row in followed[:3])
    shown, known = load_demonstrations(dataset), Imitator.from_pretrained(imitator)
    percept = load_demonstrations(other).episodes[1].percepts[60].numpy()
    thresholds = known.novelty_detector.thresholds.numpy() / known.config.scaling.scale
    for row in followed:
        source = shown.episodes[row["episode"]]
        assert row["task"] == source.task
        assert row["seconds"] == row["frame"] / 20
        np.testing.assert_array_equal(list(row["target"].values()), source.action[row["frame"]])
        apart = percept - source.percepts[row["frame"]].numpy()
        most = int(np.argmax(np.abs(apart) / thresholds))
        assert row["dimension"] == "xyz"[most]
        assert row["deviation"] == pytest.approx(apart[most], rel=1e-3, abs=1e-5)


def test_explain_converts_each_frame_with_its_own_rate(imitator: Path, other: Path):
    faster = replace(load_demonstrations(other), fps=40)
    document = explain(Imitator.from_pretrained(imitator), faster, 1, 60)
    assert document["seconds"] == 60 / 40
    assert document["followed"]
    assert all(row["seconds"] == row["frame"] / 20 for row in document["followed"])


def test_explain_follows_only_the_task_asked_for(
    imitator: Path, other: Path, capsys: pytest.CaptureFixture[str]
):
    frame = ("--episode", 1, "--frame", 5)  # before drinking and waving part
    tasks = [row["task"] for row in explained(capsys, imitator, other, *frame)["followed"]]
    assert set(tasks) == {"drink", "wave"}
    document = explained(capsys, imitator, other, *frame, "--task", " wave")
    assert [row["task"] for row in document["followed"]] == ["wave"] * 3
    step = stepped(imitator, other, 1, 5, "wave")
    assert document["novelty"] == step.novelty
    np.testing.assert_array_equal(np.float32(list(document["action"].values())), step.action)
    print_explanation(document)
    assert value_of("follows", capsys.readouterr().out) == "only what was shown for “wave”"
    print_explanation({**document, "asked_for": ""})
    assert value_of("follows", capsys.readouterr().out) == "only what was shown for “untitled”"


def test_explain_tells_the_winner_of_the_map(
    imitator: Path, other: Path, capsys: pytest.CaptureFixture[str]
):
    document = explained(capsys, imitator, other, "--episode", 0, "--frame", 60)
    sofm = Imitator.from_pretrained(imitator).sofm
    percept = load_demonstrations(other).episodes[0].percepts[60]
    apart = np.linalg.norm((sofm.prototypes - percept) * sofm.scale, axis=1)
    assert document["winner"] == np.argmin(apart)
    assert document["activation"] == pytest.approx(np.exp(-apart.min()), 1e-5)
    print_explanation(document)
    winner = f"node {np.argmin(apart)} of the map, activation {np.exp(-apart.min()):.2f}"
    assert value_of("winner", capsys.readouterr().out) == f"{winner} (a match from 0.55)"


def test_explain_says_why_it_holds(imitator: Path, other: Path, capsys: pytest.CaptureFixture[str]):
    document = explained(capsys, imitator, other, "--episode", 2, "--frame", 79)
    assert (document["decision"], document["is_novel"], document["action"]) == ("holds", True, None)
    assert document["reason"] == "the percept is novel in y"
    assert run("explain", imitator, other, "--episode", 2, "--frame", 79) == 0
    out = capsys.readouterr().out
    assert value_of("decision", out) == "holds: the percept is novel in y"
    assert "(below 0.55, no match)" in value_of("winner", out)
    assert "\naction, not sent\n" in out
    assert rows_under("name", out)[0][:2] == ["right", f"{document['target']['right']:.4g}"]


def test_explain_prints_the_deviation_and_its_threshold(
    imitator: Path, other: Path, capsys: pytest.CaptureFixture[str]
):
    document = explained(capsys, imitator, other, "--episode", 2, "--frame", 79)
    print_explanation({**document, "novelty": 6.0, "deviation": -1.5, "threshold": 0.25})
    novelty = value_of("novelty", capsys.readouterr().out)
    assert novelty == "6.00 (novel above 1), largest in y: deviation -1.5, threshold 0.25"


def test_explain_says_how_far_it_is(
    imitator: Path, dataset: Path, capsys: pytest.CaptureFixture[str]
):
    document = explained(capsys, imitator, dataset, "--episode", 0, "--frame", 79)
    assert document["is_done"]
    print_explanation({**document, "progress": 0.987})
    progress = value_of("progress", capsys.readouterr().out)
    assert progress == "98.7%, at the end of what is followed most"
    print_explanation({**document, "progress": 0.5, "is_done": False})
    assert value_of("progress", capsys.readouterr().out) == "50.0%"


def test_explain_prints_the_content_of_its_json(
    imitator: Path, other: Path, capsys: pytest.CaptureFixture[str]
):
    document = explained(capsys, imitator, other, "--episode", 1, "--frame", 60)
    assert run("explain", imitator, other, "--episode", 1, "--frame", 60) == 0
    out = capsys.readouterr().out
    assert value_of("frame", out) == "60 (3.00 s) of episode 1 of others, “drink”"
    assert value_of("decision", out) == "acts: the percept is known"
    assert value_of("follows", out) == "whatever fits"
    assert "\naction\n" in out
    followed = document["followed"]
    mean = np.sum([np.multiply(row["weight"], [*row["target"].values()]) for row in followed], 0)
    assert rows_under("name", out)[:2] == [
        [name, f"{value:.4g}", f"{was_shown:.4g}"]
        for (name, value), was_shown in zip(document["action"].items(), mean, strict=True)
    ]
    assert rows_under("dataset", out)[: len(followed)] == [
        ["shown", f"{row['episode']}", row["task"], f"{row['frame']}", f"{row['seconds']:.2f} s",
         f"{row['weight']:.1%}", f"{row['deviation']:+.3g}", row["dimension"]]
        for row in followed
    ]  # fmt: skip
    assert rows_under("dimension", out) == [
        [name, f"{value:.4g}"] for name, value in document["percept"].items()
    ]


def test_explain_separates_a_state_target_from_the_action(
    dataset: Path, other: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    assert run("fit", dataset, "--targets", "state", "--out", tmp_path) == 0
    document = explained(capsys, tmp_path, other, "--episode", 1, "--frame", 60)
    assert list(document["target"]) == ["x", "y"]
    first = document["followed"][0]
    source = load_demonstrations(dataset).episodes[first["episode"]]
    np.testing.assert_array_equal(list(first["target"].values()), source.state[first["frame"] + 1])
    assert document["action"] is None or list(document["action"]) == ["right", "up"]
    assert run("explain", tmp_path, other, "--episode", 1, "--frame", 60) == 0
    now = load_demonstrations(other).episodes[1].state[60, 0]
    rows = rows_under("name", capsys.readouterr().out)
    assert rows[0][:3] == ["x", f"{float(now):.4g}", f"{document['target']['x']:.4g}"]


def test_explain_needs_nothing_to_follow(
    imitator: Path, other: Path, capsys: pytest.CaptureFixture[str]
):
    known = Imitator.from_pretrained(imitator)
    known.memory.select(known.memory.rows.live("time").numpy() < 0)  # none
    document = explain(known, load_demonstrations(other), 1, 60)
    assert (document["decision"], document["target"], document["followed"]) == ("holds", None, [])
    print_explanation(document)
    decision = value_of("decision", capsys.readouterr().out)
    assert decision == "holds: no demonstration is kept that could be followed"


def test_explain_names_the_valid_episodes_and_frames(
    imitator: Path, other: Path, capsys: pytest.CaptureFixture[str]
):
    message = refusal(capsys, "explain", imitator, other, "--episode", 3, "--frame", 0)
    assert "expected episodes of the dataset, which has 0-2, got 3" in message
    message = refusal(capsys, "explain", imitator, other, "--episode", 1, "--frame", 80)
    assert "expected a frame of episode 1, 0 to 79, got 80" in message
