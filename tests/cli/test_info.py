"""`pacnet info` describes every kind of checkpoint."""

import json
import re
import shutil
from pathlib import Path

import numpy as np
import pytest
from command_line import (
    ACTION,
    PROJECT,
    STATE,
    SURROUNDINGS,
    refusal,
    rows_under,
    run,
    trained,
    value_of,
)
from safetensors.torch import load_file

from pacnet.datasets.demonstrations import load_demonstrations
from pacnet.datasets.recorder import Recorder


def test_info_prints_what_was_learned(
    dataset: Path, imitator: Path, capsys: pytest.CaptureFixture[str]
):
    assert run("info", imitator) == 0
    out = capsys.readouterr().out
    known = trained(dataset)
    assert "Imitator" in value_of("checkpoint", out)
    assert value_of("percept", out) == "3 dimensions at 20 frames per second"
    assert value_of("action", out) == "right, up"
    assert value_of("positions", out) == "no action is a position target"
    assert value_of("tasks", out) == "drink, wave"
    assert int(value_of("nodes", out)) == len(known.sofm)
    assert value_of("demonstrations", out) == "6"
    assert value_of("targets", out) == "480 of 480 shown, actions of 2 dimensions"
    assert value_of("budget", out) == "none, all are kept"
    scale = known.config.scaling.scale
    thresholds = known.novelty_detector.thresholds.numpy() / scale
    rows = rows_under("feature", out)[:3]
    assert [row[:2] for row in rows] == [[STATE, "x"], [STATE, "y"], [SURROUNDINGS, "z"]]
    assert [float(row[2]) for row in rows] == pytest.approx(scale, rel=1e-3)
    assert [float(row[3]) for row in rows] == pytest.approx(thresholds, rel=1e-2)
    assert [row[:3] for row in rows_under("dataset", out)] == [
        ["shown", str(number), task] for number, task in enumerate(("drink", "wave") * 3)
    ]


def test_info_as_json_has_the_same(
    dataset: Path, imitator: Path, capsys: pytest.CaptureFixture[str]
):
    assert run("info", imitator, "--json") == 0
    document = json.loads(capsys.readouterr().out, parse_constant=pytest.fail)
    known = trained(dataset)
    assert document["kind"] == "Imitator"
    assert document["tasks"] == ["drink", "wave"]
    assert document["action"] == ["right", "up"]
    assert (document["fps"], document["targets_are"], document["lead"]) == (20, "action", None)
    assert document["nodes"] == len(known.sofm)
    assert (document["demonstrations"], document["budget"]) == (6, None)
    assert (document["targets"], document["targets_shown"]) == (480, 480)
    assert document["positions"] == {}
    assert list(document["percept"][STATE]) == ["x", "y"]
    assert document["percept"][SURROUNDINGS]["z"] == pytest.approx(known.config.scaling.scale[2])
    far = known.step(np.float32([0, 0, 100]))  # the threshold is that of a step, in its own unit
    assert far.dimension == "z"
    assert far.threshold == pytest.approx(document["thresholds"][SURROUNDINGS]["z"], rel=1e-6)
    assert [report["episode"] for report in document["reports"]] == list(range(6))
    assert document["reports"][0]["max_novelty"] is None
    assert document["bytes"] == sum(file.stat().st_size for file in imitator.iterdir())
    first = np.mean([shown.action[0].numpy() for shown in load_demonstrations(dataset)], axis=0)
    assert document["first_action"] == pytest.approx(first, rel=1e-5)


def test_info_names_the_actions_that_are_position_targets(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    names = {STATE: ("elbow", "wrist"), ACTION: ("elbow", "speed", "hand")}
    time = np.linspace(0, 6, 120)
    state = np.stack([np.sin(time), np.cos(1.7 * time)], axis=1)
    later = np.concatenate([state[3:], state[-1:].repeat(3, axis=0)])  # where it then goes
    rng = np.random.default_rng(1013)
    action = np.stack([later[:, 0], rng.standard_normal(120), later[:, 1]], axis=1)
    with Recorder(tmp_path / "arm", 20, names) as recorder:
        recorder.save_episode("swing", {STATE: state, ACTION: action})
    assert run("fit", tmp_path / "arm", "--budget", 50, "--out", tmp_path / "out") == 0
    capsys.readouterr()
    assert run("info", tmp_path / "out") == 0
    out = capsys.readouterr().out
    assert value_of("positions", out) == (
        "elbow, hand (of wrist), 3 frames (0.15 s) ahead of the state"
    )
    assert value_of("targets", out) == "50 of 120 shown, actions of 3 dimensions"
    assert value_of("budget", out) == "50 targets at most"
    assert run("info", tmp_path / "out", "--json") == 0
    document = json.loads(capsys.readouterr().out)
    assert document["positions"] == {"elbow": "elbow", "hand": "wrist"}
    assert document["positions_lead"] == 3


@pytest.mark.parametrize("name", sorted(path.name for path in (PROJECT / "checkpoints").iterdir()))
def test_info_describes_every_shipped_checkpoint(name: str, capsys: pytest.CaptureFixture[str]):
    folder = PROJECT / "checkpoints" / name
    fields = json.loads((folder / "config.json").read_text())["config"]
    assert run("info", folder, "--json") == 0
    document = json.loads(capsys.readouterr().out)
    assert document["kind"] == fields.get("model", "PACNet")
    tensors = load_file(folder / "model.safetensors")
    if document["kind"] == "PACNet":
        assert document["nodes"] == len(tensors["sofm.nodes.prototype"])
        assert document["targets"] == len(tensors["schemas.pool.target"])
    else:
        assert document["numbers"] == sum(tensor.numel() for tensor in tensors.values())
    assert run("info", folder) == 0
    assert document["kind"] in value_of("checkpoint", capsys.readouterr().out)


@pytest.mark.parametrize("content", [None, "", '{"type": "pac', "[]"])
def test_a_policy_whose_own_config_is_missing_or_damaged_is_refused_by_its_name(
    imitator: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], content: str | None
):
    policy = tmp_path / "policy"
    shutil.copytree(imitator, policy / "imitator")
    shutil.copy(imitator / "model.safetensors", policy)  # any file of tensors
    if content is not None:
        (policy / "config.json").write_text(content)
    assert re.search(
        r"config\.json.* copy or download the whole folder", refusal(capsys, "info", policy)
    )


def test_commands_find_the_imitator_of_a_policy(
    imitator: Path, dataset: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    shutil.copytree(imitator, tmp_path / "policy" / "imitator")
    (tmp_path / "policy" / "config.json").write_text('{"type": "pacnet"}')
    (tmp_path / "policy" / "model.safetensors").write_bytes(b"of the policy")
    assert run("info", tmp_path / "policy") == 0
    assert "Imitator" in value_of("checkpoint", capsys.readouterr().out)
    assert run("watch", tmp_path / "policy", dataset) == 0
