"""`pacnet explain` names the reason and the demonstrations of an action."""

import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from command_line import refusal, rows_under, run, value_of

from pacnet.cli.explain import print_explanation
from pacnet.cli.explanation import explain
from pacnet.datasets.demonstrations import load_demonstrations
from pacnet.imitator import Imitator


def explained(capsys: pytest.CaptureFixture[str], *arguments: object) -> dict[str, Any]:
    capsys.readouterr()
    assert run("explain", *arguments, "--json") == 0
    return json.loads(capsys.readouterr().out, parse_constant=pytest.fail)


def test_explain_names_the_frame_and_demonstration_of_the_target(
    imitator: Path, dataset: Path, other: Path, capsys: pytest.CaptureFixture[str]
):
    document = explained(capsys, imitator, other, "--episode", 1, "--frame", 60)
    watched = load_demonstrations(other).episodes[1]
    known = Imitator.from_pretrained(imitator)
    for percept in watched.percepts[:61]:
        step = known.step(percept)
    assert document["decision"] == "acts"
    assert list(document["action"]) == ["right", "up"]
    assert document["action"] == document["target"]
    np.testing.assert_array_equal(np.float32(list(document["action"].values())), step.action)
    assert (document["novelty"], document["dimension"]) == (step.novelty, step.dimension)
    assert (document["winner"], document["schema"]) == (step.decision.winner, step.decision.schema)
    # The action itself stands in the dataset, at the frame it is said to come from.
    origin, *others = document["origins"]
    assert (origin["dataset"], origin["task"]) == ("shown", "drink")
    shown = load_demonstrations(dataset)
    source = shown.episodes[origin["episode"]]
    assert source.task == "drink"
    np.testing.assert_array_equal(source.action[origin["frame"]], step.action)
    assert origin["seconds"] == origin["frame"] / 20
    near = source.percepts[origin["frame"]] - watched.percepts[60]
    assert float(near.abs().max()) < 0.1
    # It stands for about the same place in the other drinks.
    assert {row["episode"] for row in document["origins"]} == {0, 2, 4}
    for row in others:
        apart = shown.episodes[row["episode"]].percepts[row["frame"]] - watched.percepts[60]
        assert float(apart.abs().max()) < 0.5


def test_explain_converts_each_frame_with_its_own_rate(imitator: Path, other: Path):
    faster = replace(load_demonstrations(other), fps=40)
    document = explain(Imitator.from_pretrained(imitator), faster, 1, 60)
    assert document["seconds"] == 60 / 40
    assert document["origins"]
    assert all(row["seconds"] == row["frame"] / 20 for row in document["origins"])


def test_explain_ranks_schemas_and_nodes(
    imitator: Path, other: Path, capsys: pytest.CaptureFixture[str]
):
    document = explained(capsys, imitator, other, "--episode", 0, "--frame", 60)
    confidences = [row["confidence"] for row in document["schemas"]]
    assert confidences == sorted(confidences, reverse=True)
    (won,) = [row for row in document["schemas"] if row["schema"] == document["schema"]]
    assert won["behaviours"] == ["wave"]
    assert won["confidence"] > confidences[0] - 0.1  # who has won is given up only by a margin
    sofm = Imitator.from_pretrained(imitator).network.sofm
    percept = load_demonstrations(other).episodes[0].percepts[60]
    apart = np.linalg.norm((sofm.prototypes - percept) * sofm.scale, axis=1)
    nearest = np.argsort(apart)[:5]
    assert [row["node"] for row in document["nodes"]] == nearest.tolist()
    np.testing.assert_allclose([row["distance"] for row in document["nodes"]], apart[nearest], 1e-5)
    np.testing.assert_allclose(
        [row["activation"] for row in document["nodes"]], np.exp(-apart[nearest]), 1e-5
    )
    assert document["winner"] == nearest[0]
    assert document["activation"] == pytest.approx(np.exp(-apart.min()), 1e-5)


def test_explain_says_why_the_most_confident_schema_did_not_win(
    imitator: Path, other: Path, capsys: pytest.CaptureFixture[str]
):
    document = explained(capsys, imitator, other, "--episode", 0, "--frame", 60)
    print_explanation(document)
    assert "loses only to" not in capsys.readouterr().out
    challenger = {**document["schemas"][0], "schema": 99, "confidence": 0.99}
    print_explanation({**document, "schemas": [challenger, *document["schemas"]]})
    assert "loses only to a schema that is more confident by 10.0%" in capsys.readouterr().out


def test_explain_says_why_it_holds(imitator: Path, other: Path, capsys: pytest.CaptureFixture[str]):
    document = explained(capsys, imitator, other, "--episode", 2, "--frame", 79)
    assert (document["decision"], document["is_novel"], document["action"]) == ("holds", True, None)
    assert document["reason"] == "the percept is novel in y"
    assert run("explain", imitator, other, "--episode", 2, "--frame", 79) == 0
    out = capsys.readouterr().out
    assert value_of("decision", out) == "holds: the percept is novel in y"
    assert "(below 0.55, no match)" in value_of("winner", out)


def test_explain_prints_the_deviation_and_its_threshold(
    imitator: Path, other: Path, capsys: pytest.CaptureFixture[str]
):
    document = explained(capsys, imitator, other, "--episode", 2, "--frame", 79)
    known = Imitator.from_pretrained(imitator)
    for percept in load_demonstrations(other).episodes[2].percepts:
        step = known.step(percept)
    assert (document["deviation"], document["threshold"]) == (step.deviation, step.threshold)
    print_explanation({**document, "novelty": 6.0, "deviation": -1.5, "threshold": 0.25})
    novelty = value_of("novelty", capsys.readouterr().out)
    assert novelty == "6.00 (novel above 1), largest in y: deviation -1.5, threshold 0.25"


def test_explain_says_that_an_action_is_not_sent(
    imitator: Path, other: Path, capsys: pytest.CaptureFixture[str]
):
    document = explained(capsys, imitator, other, "--episode", 1, "--frame", 60)
    print_explanation(document)
    assert "\naction\n" in capsys.readouterr().out
    print_explanation({**document, "decision": "holds", "action": None})  # as for novel percepts
    out = capsys.readouterr().out
    assert "\naction, not sent\n" in out
    assert rows_under("name", out)[0] == ["right", f"{document['target']['right']:.4g}"]


def test_explain_prints_the_content_of_its_json(
    imitator: Path, other: Path, capsys: pytest.CaptureFixture[str]
):
    document = explained(capsys, imitator, other, "--episode", 1, "--frame", 60)
    assert run("explain", imitator, other, "--episode", 1, "--frame", 60) == 0
    out = capsys.readouterr().out
    assert value_of("frame", out) == "60 (3.00 s) of episode 1 of others, “drink”"
    assert value_of("decision", out) == "acts: the percept is known and a motor schema is confident"
    length = document["schemas"][0]["targets"]
    schema = f"{document['schema']}, target {document['position'] + 1} of {length}"
    assert re.search(rf"^schema {{2,}}{schema}$", out, re.MULTILINE)
    assert "loses only to" not in out
    assert rows_under("name", out)[:2] == [
        [name, f"{value:.4g}"] for name, value in document["action"].items()
    ]
    assert rows_under("dataset", out)[: len(document["origins"])] == [
        ["shown", f"{row['episode']}", "drink", f"{row['frame']}", f"{row['seconds']:.2f} s"]
        for row in document["origins"]
    ]
    (won,) = [row for row in rows_under("schema +node", out) if row[0] == f"* {document['schema']}"]
    assert won[1] == str(document["winner"])
    assert won[2] == f"{document['schemas'][0]['confidence']:.1%}"
    assert f"\nmotor schemas of node {document['winner']}; * won\n" in out
    elsewhere = {**document["schemas"][0], "node": document["winner"] + 1}
    print_explanation({**document, "schemas": [elsewhere]})
    assert "and those of other nodes near the percept; * won\n" in capsys.readouterr().out
    assert [row[0].removeprefix("* ") for row in rows_under("node", out)][:2] == [
        str(row["node"]) for row in document["nodes"][:2]
    ]


def test_explain_separates_a_state_target_from_the_action(
    dataset: Path, other: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    assert run("fit", dataset, "--targets", "state", "--out", tmp_path) == 0
    document = explained(capsys, tmp_path, other, "--episode", 1, "--frame", 60)
    assert list(document["target"]) == ["x", "y"]
    origin = document["origins"][0]
    source = load_demonstrations(dataset).episodes[origin["episode"]]
    np.testing.assert_array_equal(
        np.float32(list(document["target"].values())), source.state[origin["frame"] + 1]
    )
    assert document["action"] is None or list(document["action"]) == ["right", "up"]
    assert run("explain", tmp_path, other, "--episode", 1, "--frame", 60) == 0
    now = load_demonstrations(other).episodes[1].state[60, 0]
    rows = rows_under("name", capsys.readouterr().out)
    assert rows[0] == ["x", f"{float(now):.4g}", f"{document['target']['x']:.4g}"]


def test_explain_names_the_valid_episodes_and_frames(
    imitator: Path, other: Path, capsys: pytest.CaptureFixture[str]
):
    message = refusal(capsys, "explain", imitator, other, "--episode", 3, "--frame", 0)
    assert "expected episodes of the dataset, which has 0-2, got 3" in message
    message = refusal(capsys, "explain", imitator, other, "--episode", 1, "--frame", 80)
    assert "expected a frame of episode 1, 0 to 79, got 80" in message
