"""`pacnet fit --held-out` learns the rest and prints what the library scores."""

import re
from pathlib import Path

import pytest
from carrying import record_carrying
from command_line import assert_equal, record, refusal, rows_under, run, unannounced, value_of

from pacnet.datasets.demonstrations import Demonstrations, load_demonstrations
from pacnet.evaluation import HeldOutScores, score, splits
from pacnet.imitator import Imitator

NAMES = ["imitator", "1-NN", "5-NN", "5-NN with history", "repeating the last action"]


def learned(
    demonstrations: Demonstrations, targets: str = "action", budget: int | None = None
) -> Imitator:
    imitator = Imitator.from_demonstrations(demonstrations, targets, budget=budget)
    imitator.learn(demonstrations)
    return imitator


def assert_printed(scores: HeldOutScores, out: str) -> None:
    rows = rows_under("compared", out)
    assert [row[0] for row in rows] == NAMES
    errors = [scores.error, *scores.baselines.values()]
    assert [row[3] for row in rows] == [f"{error:.3f}" for error in errors]
    assert rows[0][1:3] == [f"{scores.acted:.1%}", f"{scores.novel:.1%}"]
    assert len(re.findall(r"^error: root mean square .* standard deviations", out, re.M)) == 1


def test_every_third_episode_is_compared_and_not_learned(
    dataset: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    assert run("fit", dataset, "--held-out", 3, "--out", tmp_path / "out") == 0
    out, error = capsys.readouterr()
    assert unannounced(error) == ""
    (split,) = splits(load_demonstrations(dataset), every=3)
    assert_equal(Imitator.from_pretrained(tmp_path / "out"), learned(split.training))
    assert value_of("learned", out).startswith("4 episodes, 320 frames in ")
    assert "held out: episodes 2,5, 160 frames, which were not learned\n" in out
    assert_printed(score([split]), out)


def test_few_episodes_are_each_left_out_and_all_learned(
    dataset: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    chosen = ("--episodes", "0,2,4")
    assert run("fit", dataset, *chosen, "--held-out", 5, "--out", tmp_path / "out") == 0
    out = capsys.readouterr().out
    demonstrations = load_demonstrations(dataset, episodes=[0, 2, 4])
    assert_equal(Imitator.from_pretrained(tmp_path / "out"), learned(demonstrations))
    assert re.search(r"^3 episodes, 240 frames: each was left out in turn", out, re.M)
    assert "the checkpoint has learned all of them" in out
    assert_printed(score(splits(demonstrations)), out)


def test_imitators_left_out_in_turn_have_the_chosen_targets(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    root = record(tmp_path / "two", ("drink", "drink"), 1020, frames=120)
    states = ("--targets", "state", "--held-out", 2)
    assert run("fit", root, *states, "--out", tmp_path / "out") == 0
    parted = splits(load_demonstrations(root), every=2)
    assert_printed(score(parted, lambda one: learned(one, "state")), capsys.readouterr().out)


def test_imitators_left_out_in_turn_have_the_budget(
    dataset: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    options = ("--episodes", "0,2,4", "--budget", 30, "--held-out", 5)
    assert run("fit", dataset, *options, "--out", tmp_path / "out") == 0
    demonstrations = load_demonstrations(dataset, episodes=[0, 2, 4])
    assert_equal(Imitator.from_pretrained(tmp_path / "out"), learned(demonstrations, budget=30))
    scores = score(splits(demonstrations), lambda one: learned(one, budget=30))
    assert_printed(scores, capsys.readouterr().out)
    assert scores.error != score(splits(demonstrations)).error


def test_one_episode_is_too_few_and_nothing_is_written(
    dataset: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    alone = ("--episodes", 0, "--held-out", 5)
    message = refusal(capsys, "fit", dataset, *alone, "--out", tmp_path / "out")
    assert "expected at least 2 episodes, one to learn and one to hold out, got 1" in message
    assert not (tmp_path / "out").exists()


def test_what_was_learned_before_cannot_be_held_out(
    dataset: Path, imitator: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    more = ("fit", dataset, "--from", imitator, "--out", tmp_path / "out")
    assert run(*more, "--held-out", 5) == 2
    assert "argument --held-out: not with --from" in capsys.readouterr().err
    assert run("fit", dataset, "--held-out", 1, "--out", tmp_path / "out") == 2
    assert "expected a whole number ≥ 2, got '1'" in capsys.readouterr().err


def test_with_points_it_says_what_the_error_means(
    dataset: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    carrying = record_carrying(tmp_path / "carrying", (False,) * 4)
    assert run("fit", carrying, "--held-out", 2, "--out", tmp_path / "out") == 0
    out = capsys.readouterr().out
    (split,) = splits(load_demonstrations(carrying), every=2)
    scores = score([split])
    assert (scores.acted, scores.novel) == (1, 0)
    assert_printed(scores, out)
    assert "with points the imitator leads hand back" in out
    for points in ((carrying, "--points", "none"), (dataset,)):
        assert run("fit", *points, "--held-out", 3, "--overwrite", "--out", tmp_path / "out") == 0
        assert "with points" not in capsys.readouterr().out
