"""Commands take a dataset's features by name, and an imitator's from its checkpoint."""

import re
from pathlib import Path

import pytest
import torch
from command_line import ACTION, NAMES, STATE, SURROUNDINGS, record, refusal, rows_under, run

from pacnet.imitator import Imitator

APART = {"arm": ("x", "y"), "cup": ("z",), "motors": ("right", "up")}
"""The features of `command_line.NAMES` under other names."""


@pytest.fixture
def apart(tmp_path: Path) -> Path:
    return record(tmp_path / "apart", ("drink", "wave"), 1000, names=APART)


def config_of(folder: Path):
    return Imitator.from_pretrained(folder).config


def assert_same_tensors(folder: Path, other: Path) -> None:
    ours, theirs = (Imitator.from_pretrained(one).state_dict() for one in (folder, other))
    for name, tensor in ours.items():
        assert torch.equal(tensor, theirs[name]), name


def test_several_features_are_taken_in_the_order_given(apart: Path, tmp_path: Path):
    line = ("fit", apart, "--action", "motors", "--out")
    assert run(*line, tmp_path / "two", "--state", "cup", "--state", "arm") == 0
    config = config_of(tmp_path / "two")
    assert config.percept_names == ("z", "x", "y")
    assert (config.state_features, config.state_dimensions) == (("cup", "arm"), 3)
    assert config.action_features == ("motors",)
    assert run("fit", apart, "--state", "arm", "--action", "cup", "--action", "motors",
               "--out", tmp_path / "actions") == 0  # fmt: skip
    assert config_of(tmp_path / "actions").action == ("z", "right", "up")


def test_several_features_learn_what_one_does(apart: Path, tmp_path: Path):
    usual = record(tmp_path / "usual", ("drink", "wave"), 1000)
    assert run("fit", usual, "--out", tmp_path / "one") == 0
    line = ("fit", apart, "--action", "motors", "--out")
    assert run(*line, tmp_path / "two", "--state", "arm", "--state", "cup") == 0
    assert_same_tensors(tmp_path / "one", tmp_path / "two")
    kinds = ("--state", "arm", "--environment-state", "cup")
    assert run(*line, tmp_path / "three", *kinds) == 0
    assert_same_tensors(tmp_path / "one", tmp_path / "three")


def test_an_environment_state_alone_is_learned_and_watched(
    dataset: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    out = tmp_path / "blind"
    assert run("fit", dataset, "--state", "none", "--out", out) == 0
    assert config_of(out).state_features == ()
    assert config_of(out).percept_names == ("z",)
    assert run("watch", out, dataset) == 0
    assert run("explain", out, dataset, "--episode", 0, "--frame", 40) == 0
    message = refusal(
        capsys, "fit", dataset, "--state", "none", "--targets", "state", "--out", tmp_path / "aims"
    )
    assert "expected a state of the robot to aim at" in message


def test_neither_of_both_is_refused(
    dataset: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    none = ("--state", "none", "--environment-state", "none")
    message = refusal(capsys, "fit", dataset, *none, "--out", tmp_path / "out")
    assert "expected a state, an environment state" in message


@pytest.mark.parametrize("option", ["--state", "--environment-state"])
def test_none_is_given_alone(option: str, capsys: pytest.CaptureFixture[str]):
    assert run("fit", "data", option, "none", option, "arm", "--out", "out") == 2
    assert capsys.readouterr().err.endswith(f"argument {option}: none only by itself\n")


def test_a_feature_given_twice_is_refused(
    apart: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    twice = ("--state", "arm", "--state", "arm", "--action", "motors")
    message = refusal(capsys, "fit", apart, *twice, "--out", tmp_path / "out")
    assert "expected different features, got arm, arm" in message


@pytest.mark.parametrize("command", ["fit --from", "watch", "explain"])
def test_the_features_are_those_of_the_imitator(
    command: str, apart: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    """State and action of any name, in the order in which they were learned, without options."""
    out = tmp_path / "out"
    first = ("--state", "cup", "--state", "arm", "--action", "motors")
    assert run("fit", apart, *first, "--out", out) == 0
    line = {
        "fit --from": ["fit", apart, "--from", out, "--out", out],
        "watch": ["watch", out, apart],
        "explain": ["explain", out, apart, "--episode", 1, "--frame", 60],
    }[command]
    capsys.readouterr()
    assert run(*line) == 0
    if command == "watch":
        rows = rows_under("episode", capsys.readouterr().out)
        assert [row[:3] for row in rows] == [["0", "drink", "drink"], ["1", "wave", "wave"]]


@pytest.mark.parametrize("command", ["fit --from", "watch", "export", "explain"])
def test_a_feature_that_was_learned_and_is_not_there(
    command: str,
    imitator: Path,
    apart: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
):
    line = {
        "fit --from": ["fit", apart, "--from", imitator, "--out", tmp_path / "out"],
        "watch": ["watch", imitator, apart],
        "export": ["export", imitator, apart, "--out", tmp_path / "out"],
        "explain": ["explain", imitator, apart, "--episode", 1, "--frame", 60],
    }[command]
    message = refusal(capsys, *line)
    assert re.search(f"expected the features? '{STATE}'", message)
    assert "'arm' [2], 'cup' [1], 'motors' [2]" in message
    assert f"the imitator has learned {STATE!r} and {SURROUNDINGS!r}" in message
    assert "--state" not in message  # which would not help


def test_fit_from_names_the_option_for_an_action_of_another_name(
    imitator: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    names = {STATE: NAMES[STATE], SURROUNDINGS: NAMES[SURROUNDINGS], "aim": NAMES[ACTION]}
    root = record(tmp_path / "aims", ("drink",), 1000, names=names)
    line = ("fit", root, "--from", imitator, "--out", tmp_path / "out")
    assert "--action NAME" in refusal(capsys, *line)
    assert run(*line, "--action", "aim") == 0


def test_a_dataset_is_found_by_its_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    monkeypatch.setenv("HF_LEROBOT_HOME", str(tmp_path / "cache"))
    monkeypatch.chdir(tmp_path)
    record(tmp_path / "cache" / "someone" / "drinking", ("drink", "wave"), 1000)
    assert run("fit", "someone/drinking", "--out", "out") == 0
    assert rows_under("dataset", capsys.readouterr().out)[0][0].endswith("drinking")
    assert run("watch", "out", "someone/drinking") == 0
    assert run("explain", "out", "someone/drinking", "--episode", 0, "--frame", 3) == 0
    message = refusal(capsys, "fit", "someone/dancing", "--out", "out2")
    assert "hf download --repo-type dataset someone/dancing" in message


def test_explain_names_the_target_as_the_percept(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    """A state to reach stands beside the percept, also where features share names."""
    names = {"arm": ("x", "y"), "cup": ("x",), "motors": ("right", "up")}
    root = record(tmp_path / "same", ("drink", "wave"), 1000, names=names)
    out = tmp_path / "out"
    options = ("--state", "arm", "--environment-state", "cup", "--action", "motors")
    assert run("fit", root, *options, "--targets", "state", "--lead", 3, "--out", out) == 0
    capsys.readouterr()
    assert run("explain", out, root, "--episode", 0, "--frame", 40) == 0
    assert [row[0] for row in rows_under("name", capsys.readouterr().out)[:2]] == ["arm.x", "arm.y"]
