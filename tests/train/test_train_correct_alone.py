"""An imitator with a body, alone: what is new to it, what it asks for, and what is written."""

import argparse
import json
import math
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from envs.glass_offset import DIRECTIONS
from pacnet.datasets.demonstrations import Demonstrations, load_demonstrations
from pacnet.forward_models.kinematics import KinematicModel
from pacnet.imitator.imitator import Imitator
from pacnet.imitator.records import ImitatorStep
from train import correct
from train.postural.correction import teaching
from train.postural.correction.episodes import (
    PATIENCE,
    Attempt,
    Pause,
    Situation,
    as_demonstration,
    attempt,
)
from train.postural.correction.figures import novelty_over_time
from train.postural.correction.places import alone, situations
from train.postural.correction.questions import question
from train.postural.correction.scores import print_questions, score_alone
from train.postural.episodes import FPS, Condition, make_environment
from train.postural.learning import FEATURES, frames_of, record

PROJECT = Path(__file__).parents[2]
FRAMES = 150

FAR = Pause(0, "glass.y", 0.09, 0.03, "glass.y is too far: move the glass, or show me")
NEARER = Pause(4, "glass.y", 0.05, 0.03, "glass.y is far: move the glass, or show me")
BESIDE = Pause(2, "glass.x", -0.25, 0.03, "glass.x is off: move the glass, or show me")


def tried(pause=None, success=False, novelty=(0.1, 0.3, 0.2)):
    contact = 1 if success else None
    return Attempt(np.array(novelty), pause, grasp=None, contact=contact, success=success)


def teach(folder, count):
    """Record drinks in a dataset, and teach them to an imitator with the body that is shipped."""
    record(folder / "dataset", 3, count)
    shown = load_demonstrations(folder / "dataset")
    body = KinematicModel.from_pretrained(PROJECT / "checkpoints" / "body")
    imitator = Imitator.from_demonstrations(shown, body=body)
    imitator.learn(shown)
    return shown, imitator.eval()


@pytest.fixture(scope="module")
def taught(tmp_path_factory):
    return teach(tmp_path_factory.mktemp("drinks"), 2)


@pytest.fixture(scope="module")
def drinker(taught):
    return taught[1]


@pytest.fixture(scope="module")
def environment():
    made = make_environment(Condition())
    yield made
    made.close()


def at(dimension, deviation, threshold, novelty=2.0):
    is_novel = novelty > 1
    return ImitatorStep(
        None, is_novel, novelty, dimension, deviation, threshold, 0.0, False, (), None
    )


@pytest.mark.parametrize(
    ("step", "glass", "asked"),
    [
        (
            at("glass.y", 0.214, 0.034),
            (0.5, 0.43, 0.22, 0, 0, 0),
            "glass.y is 0.21 m more than the hand reaches, 0.03 m is tolerated: "
            "move the glass, or show me",
        ),
        (
            at("glass.x", -0.12, 0.034),
            (0.1, 0.0, 0.22, 0, 0, 0),
            "glass.x is 0.12 m less than the hand reaches, 0.03 m is tolerated: "
            "move the glass, or show me",
        ),
        (
            at("glass.ry", 1.523, 0.6),
            (0.5, -0.07, 0.18, -0.4, 1.5, 0),
            "glass.ry would leave the hand turned 1.52 rad otherwise than shown, 0.60 rad is "
            "tolerated: stand the glass up, or show me",
        ),
        (
            at("glass.x", -0.232, 0.034),
            (0.0,) * 6,
            "no glass is perceived (as zeros, glass.x is 0.23 m less than the hand reaches, 0.03 m "
            "is tolerated): put one within reach, or show me",
        ),
        (
            at("elbow.vel", -2.5, 1.25),
            (0.5, -0.07, 0.22, 0, 0, 0),
            "elbow.vel is -2.500 off, 1.250 is tolerated: show me",
        ),
    ],
)
def test_a_question_says_what_is_off_by_how_much_and_what_helps(step, glass, asked):
    assert question(step, np.array([0.3] * 22 + list(glass), np.float32)) == asked


def test_there_is_no_question_where_nothing_is_novel():
    with pytest.raises(ValueError, match=r"a step that is novel, got one of novelty 0\.50"):
        question(at("glass.y", 0.1, 0.2, novelty=0.5), np.ones(28, np.float32))


def test_situations_alone_are_within_reach_and_repeat_for_any_glass():
    known = alone((0, 1), 200)
    lengths = np.array([math.hypot(*one.offset) for one in known])
    assert lengths.max() <= 0.15
    assert np.mean(lengths < 0.15 / 2) == pytest.approx(0.25, abs=0.09)  # uniform in area
    for x, y in (one.offset for one in known):
        assert DIRECTIONS[0] <= math.atan2(y, x) % (2 * math.pi) <= DIRECTIONS[1]
    assert [one.seed for one in known] == [
        one.seed for one in situations((0, 1), [(0.0, 0.0)], 200)
    ]
    far = alone((0, 1), 200, "far")
    assert [one._replace(own_glass="standing") for one in far] == known
    assert far[0].options == {
        "glass_offset": known[0].offset,
        "demonstrator": "absent",
        "own_glass": "far",
    }


def test_one_that_watches_has_a_demonstrator_and_perceives_it():
    observation = {
        "demonstrator": np.full(22, 1.0),
        "glass": np.full(6, 2.0),
        "proprioception": np.full(22, 3.0),
        "own_glass": np.full(6, 4.0),
    }
    watching, by_itself = Situation(0, (0.0, 0.0)), Situation(0, (0.0, 0.0), True)
    assert watching.perceive(observation).tolist() == [1.0] * 22 + [2.0] * 6
    assert by_itself.perceive(observation).tolist() == [3.0] * 22 + [4.0] * 6
    assert watching.options["demonstrator"] == "present"
    assert by_itself.options["own_glass"] == "standing"


def test_an_imitator_with_a_body_is_accepted_but_not_at_new_places(taught, drinker):
    correct.check(drinker, taught[0])
    assert correct.has_body(drinker)
    correct.check_places(drinker, 1)
    with pytest.raises(ValueError, match=r"without a body.*knows all places within reach"):
        correct.check_places(drinker, 2)
    without = Imitator.from_demonstrations(taught[0], points=None)
    assert not correct.has_body(without)
    correct.check_places(without, 3)


def test_it_drinks_alone_where_the_glass_stands(drinker, environment):
    known = alone((5, 1), 1)[0]
    done = attempt(drinker, environment, known)
    assert done.success
    assert done.pause is None
    assert done.grasp is None
    assert done.contact is not None
    assert len(done.novelty) == 750


@pytest.mark.parametrize(
    ("own_glass", "asked"),
    [
        ("far", r"^glass\.[xy] is 0\.\d\d m more than the hand reaches, .*: move the glass, or"),
        (
            "tipped",
            r"^glass\.r[xy] would leave the hand turned 1\.\d\d rad .*: stand the glass up,",
        ),
        ("absent", r"^no glass is perceived .*: put one within reach, or show me$"),
    ],
)
def test_it_holds_still_and_asks_where_the_glass_is_out_of_order(
    drinker, environment, own_glass, asked
):
    paused = attempt(drinker, environment, alone((5, 2), 1, own_glass)[0])
    assert paused.paused_in_time
    assert paused.contact is None
    assert not paused.success
    assert paused.pause is not None
    assert paused.pause.step < 10
    assert abs(paused.pause.deviation) > paused.pause.tolerated
    assert re.search(asked, paused.pause.asks)
    assert len(paused.novelty) - paused.pause.step == round(PATIENCE * FPS)


def test_scores_alone_are_those_worked_out_by_hand(capsys):
    far = [
        tried(FAR, novelty=(3.0, 0.9, 2.0)),
        tried(NEARER, novelty=(0.5, 0.5, 0.5, 0.5, 1.5)),
        tried(BESIDE, novelty=(0.1, 0.1, 8.0)),
    ]
    scores = score_alone(far)
    assert scores["paused_share"] == scores["paused_in_time_share"] == 1.0
    assert scores["named"] == {
        "glass.x": {
            "episodes": 1,
            "deviation_min": -0.25,
            "deviation_median": -0.25,
            "deviation_max": -0.25,
            "tolerated": 0.03,
        },
        "glass.y": {
            "episodes": 2,
            "deviation_min": 0.05,
            "deviation_median": pytest.approx(0.07),
            "deviation_max": 0.09,
            "tolerated": 0.03,
        },
    }
    assert scores["actions_after_pause_max"] == 1
    assert scores["asks"] == FAR.asks
    known = score_alone([tried(success=True)])
    assert known["named"] == {}
    assert known["actions_after_pause_max"] is known["asks"] is None
    print_questions({"known": known, "far": scores})
    assert capsys.readouterr().out == f"\nfar: {FAR.asks}\n"


def test_without_a_demonstrator_the_figure_has_no_line_of_it():
    shown = {
        "known": tried(success=True),
        "far": tried(FAR),
        "tipped": tried(NEARER),
        "no": tried(),
    }
    shown["tipped"] = tried(NEARER, novelty=(0.5,) * 4 + (1.5,))
    (axes,) = novelty_over_time(shown, 0.02).axes
    labels = [line.get_label() for line in axes.lines]
    assert set(shown) < {*labels}
    assert "demonstrator's hand at its glass" not in labels
    assert len({line.get_color() for line in axes.lines if line.get_label() in shown}) == 4


def slow_waves(seed):
    """Return the features of a made-up demonstration."""
    phase = np.linspace(0, np.pi, FRAMES)[:, None]
    percepts = np.sin(phase * np.linspace(1, 2, 28))
    noise = np.random.default_rng(seed).standard_normal(percepts.shape)
    return frames_of((percepts + 0.01 * noise).astype(np.float32))


def run_alone(monkeypatch, tmp_path, known):
    shown = tuple(as_demonstration(seed, slow_waves(seed)) for seed in range(2))
    given = Demonstrations(FPS, FEATURES, shown, "drinking")
    imitator = Imitator.from_demonstrations(given)
    imitator.learn(given)
    seen = []

    def act(checkpoint, wanted, label):
        seen.append((Path(checkpoint).name, [one.own_glass for one in wanted]))
        if label == "known places" and Path(checkpoint).name == "given":
            return known
        is_asking = wanted[0].own_glass != "standing"
        return [tried(FAR) if is_asking else tried(success=True) for _ in wanted]

    monkeypatch.setattr(correct, "attempts", act)
    monkeypatch.setattr(teaching, "make_environment", lambda _: None)
    monkeypatch.setattr(teaching, "attempt", lambda *_: tried())
    done = (slow_waves(9), np.arange(FRAMES) > 140)
    monkeypatch.setattr(teaching, "demonstrate", lambda *_: done)
    arguments = argparse.Namespace(
        checkpoint="given", dataset="drinking", places=1, episodes=2, seed=0, runs=tmp_path
    )
    correct.run_alone(arguments, imitator.eval(), given, tmp_path)
    return seen, json.loads((tmp_path / "metrics.json").read_text())


def test_nothing_is_demonstrated_where_known_places_succeed(monkeypatch, tmp_path):
    seen, scores = run_alone(monkeypatch, tmp_path, [tried(success=True)] * 2)
    assert seen == [
        ("given", [kind] * 2)
        for kind in ("standing", "far", "standing", "tipped", "standing", "absent", "standing")
    ]
    assert scores["corrections"] == 0
    assert scores["session"] == []
    assert scores["glass out of reach"]["paused_share"] == 1.0
    assert scores["glass out of reach, helped"]["success_rate"] == 1.0
    assert scores["known places"]["paused_share"] == 0.0
    assert {path.name for path in tmp_path.iterdir()} == {"metrics.json", "novelty.png"}


def test_a_failure_at_a_known_place_is_corrected(monkeypatch, tmp_path):
    seen, scores = run_alone(monkeypatch, tmp_path, [tried(success=True), tried()])
    assert [checkpoint for checkpoint, _ in seen] == ["given"] + ["checkpoint"] * 7
    assert scores["corrections"] == 1
    assert scores["known places, after"]["success_rate"] == 1.0
    assert len(load_demonstrations(tmp_path / "dataset")) == 3
    assert len(Imitator.from_pretrained(tmp_path / "checkpoint").reports) == 3


@pytest.mark.slow
def test_what_is_new_to_a_body_is_asked_about_and_places_within_reach_are_not(tmp_path):
    _, imitator = teach(tmp_path, 8)
    imitator.save_pretrained(tmp_path / "checkpoint")
    command = [sys.executable, "-m", "train.correct", tmp_path / "checkpoint", "--episodes", "8"]
    command += ["--dataset", tmp_path / "dataset", "--seed", "0", "--runs", tmp_path / "runs"]
    done = subprocess.run(command, cwd=PROJECT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    (folder,) = (tmp_path / "runs" / "correct").iterdir()
    scores = json.loads((folder / "metrics.json").read_text())
    assert scores["known places"]["paused_share"] <= 0.02
    assert scores["known places"]["success_rate"] >= 0.9
    for kind, named in (
        ("glass out of reach", "x y"),
        ("glass tipped", "rx ry"),
        ("no glass", "x y z"),
    ):
        new, helped = scores[kind], scores[f"{kind}, helped"]
        assert new["paused_in_time_share"] >= 0.95
        assert new["success_rate"] == 0
        assert helped["success_rate"] >= 0.9
        assert helped["paused_share"] <= 0.04
        assert {*new["named"]} <= {f"glass.{part}" for part in named.split()}
