"""Corrections of an imitator: episodes, what is learned and written, the whole command."""

import json
import math
import subprocess
import sys
from copy import deepcopy
from pathlib import Path

import numpy as np
import pytest
from checkers import assert_clean
from matplotlib.colors import to_hex

from envs.postural_imitation import GLASS_NAMES
from pacnet.datasets.demonstrations import Demonstrations, load_demonstrations
from pacnet.evaluation.figure_style import VERMILION
from pacnet.imitator.imitator import Imitator
from train import correct
from train.correct import check
from train.postural.correction import teaching
from train.postural.correction.episodes import (
    USUAL,
    Attempt,
    Pause,
    Situation,
    Turn,
    as_demonstration,
    attempts,
)
from train.postural.correction.figures import novelty_over_time
from train.postural.correction.places import draw_other_place, draw_places, situations
from train.postural.correction.scores import print_scores, print_turn, score_attempts, score_turn
from train.postural.episodes import FPS
from train.postural.learning import FEATURES, frames_of, record

PROJECT = Path(__file__).parents[2]
FRAMES = 150


def tried(pause=None, contact=None, success=False, novelty=(0.1, 0.5)):
    return Attempt(np.array(novelty), pause, grasp=100, contact=contact, success=success)


PAUSE = Pause(10, "glass.x", -0.15, 0.05)
KNOWN = tried(contact=110, success=True)
PAUSED = tried(PAUSE, novelty=(0.2, 3.0))
RESUMED = tried(Pause(40, "elbow", 0.2, 0.1), success=True)  # it went on when that was over


def seen(seed, glass_x=0.5):
    """Return the features of a made-up drink: slow waves, and a glass."""
    rng = np.random.default_rng(seed)
    phase = np.linspace(0, np.pi, FRAMES)[:, None]
    angles = np.sin(phase * np.linspace(1, 2, 11))
    speeds = np.gradient(angles, axis=0)
    glass = np.tile((glass_x, -0.07, 0.22, 0.0, 0.0, 0.0), (FRAMES, 1))
    percepts = np.concatenate([angles, speeds, glass], axis=1)
    return frames_of((percepts + 0.01 * rng.standard_normal((FRAMES, 28))).astype(np.float32))


@pytest.fixture(scope="module")
def given():
    shown = tuple(as_demonstration(seed, seen(seed)) for seed in range(3))
    return Demonstrations(FPS, FEATURES, shown, "drinking")


@pytest.fixture(scope="module")
def imitator(given):
    made = Imitator.from_demonstrations(given)
    made.learn(given)
    return made.eval()


@pytest.fixture(scope="module")
def corrected(imitator, given, tmp_path_factory):
    """A session in which something goes wrong thrice at the new place, and what it left behind."""
    succeeds = [RESUMED, *[tried(success=True)] * (teaching.ENOUGH - 1)]
    outcomes = iter([KNOWN, PAUSED, tried(), RESUMED, tried(), *succeeds])
    learner, dataset = deepcopy(imitator), tmp_path_factory.mktemp("session") / "dataset"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(teaching, "make_environment", lambda _: None)
        patch.setattr(teaching, "attempt", lambda *_: next(outcomes))
        patch.setattr(
            teaching,
            "demonstrate",
            lambda _, situation: (seen(situation.seed % 1000, 0.65), np.arange(FRAMES) > 140),
        )
        turns = teaching.correct(learner, given, [(0.15, 0.0)], 0, dataset)
    return turns, learner, dataset


def test_corrections_continue_until_the_imitator_succeeds(corrected):
    turns, imitator, _ = corrected
    assert [turn.place for turn in turns] == [0, *[1] * (4 + teaching.ENOUGH)]
    learning = [turn.learning for turn in turns]
    assert [seconds is not None for seconds in learning[:5]] == [False, True, True, False, True]
    assert learning[5:] == [None] * teaching.ENOUGH
    assert min(learning[1], learning[2], learning[4]) > 0
    assert [(report.dataset, report.episode) for report in imitator.reports] == [
        ("drinking", number) for number in range(6)
    ]
    assert imitator.reports[3].max_novelty > 1 > imitator.reports[5].max_novelty
    assert not imitator.training


def test_the_corrections_are_appended_to_the_dataset(corrected, given):
    *_, dataset = corrected
    extended = load_demonstrations(dataset)
    assert len(extended) == 6
    for old, new in zip(given, extended, strict=False):
        assert np.array_equal(old.percepts, new.percepts)
        assert np.array_equal(old.action, new.action)
        assert old.task == new.task
    glass_x = [float(shown.environment_state[:, 0].mean()) for shown in extended]
    assert glass_x == pytest.approx([0.5] * 3 + [0.65] * 3, abs=0.01)


def test_the_dataset_holds_novelty_and_success_before_learning(corrected):
    *_, dataset = corrected
    columns = {
        name: load_demonstrations(dataset, state=name, environment_state=None).episodes
        for name in ("novelty", "winner")
    }
    largest = [float(shown.state.max()) for shown in columns["novelty"]]
    assert max(largest[:3]) < 1 < largest[3]
    assert largest[4] < 1
    winners = np.concatenate([shown.state for shown in columns["winner"]])
    assert np.array_equal(winners, winners.round())
    assert winners.min() >= -1
    info = json.loads((dataset / "meta" / "info.json").read_text())
    assert info["features"]["winner"]["dtype"] == "int64"
    assert info["features"]["next.success"]["dtype"] == "bool"


def test_a_corrected_imitator_can_be_saved_and_corrected_again(corrected, tmp_path):
    _, imitator, dataset = corrected
    imitator.save_pretrained(tmp_path / "checkpoint")
    loaded = Imitator.from_pretrained(tmp_path / "checkpoint").eval()
    for one in (imitator, loaded):
        one.reset()
    for percept in load_demonstrations(dataset).episodes[-1].percepts:
        assert loaded.step(percept).novelty == imitator.step(percept).novelty


def test_scores_of_attempts_are_those_worked_out_by_hand():
    late = tried(Pause(120, "glass.y", 0.1, 0.05), contact=110, novelty=(0.2, 2.0))
    scores = score_attempts([KNOWN, PAUSED, late, KNOWN])
    assert scores["episodes"] == 4
    assert scores["success_rate"] == 0.5
    assert scores["paused_share"] == 0.5
    assert scores["paused_in_time_share"] == 0.25
    assert scores["paused_after_s"] == pytest.approx((0.2 + 2.4) / 2)
    assert scores["paused_for"] == ["glass.x", "glass.y"]
    assert scores["novelty_median"] == pytest.approx(1.25)
    assert scores["novelty_max"] == 3.0
    assert score_attempts([KNOWN])["paused_after_s"] is None


@pytest.mark.parametrize(
    ("step", "contact", "in_time"),
    [(99, None, True), (100, None, False), (49, 50, True), (50, 50, False), (99, 120, True)],
)
def test_a_pause_is_in_time_before_any_hand_is_at_a_glass(step, contact, in_time):
    assert tried(Pause(step, "glass.x", 0.1, 0.05), contact).paused_in_time == in_time
    assert not KNOWN.paused_in_time


def test_the_score_of_a_turn_has_the_novel_dimension_and_the_learning_time(capsys):
    print_turn(Turn(0, KNOWN, None))
    print_turn(Turn(1, PAUSED, 0.0421))
    print_turn(Turn(1, tried(), 0.05))
    assert [" ".join(line.split()) for line in capsys.readouterr().out.splitlines()] == [
        "usual place acted, with success",
        "place 1 paused after 0.20 s, without success: glass.x is -0.150 off, 0.050 is tolerated;"
        " shown, and learned in 0.042 s",
        "place 1 acted, without success; shown, and learned in 0.050 s",
    ]
    assert score_turn(Turn(1, PAUSED, 0.04)) == {
        "place": 1,
        "success": False,
        "paused_at_s": 0.2,
        "dimension": "glass.x",
        "deviation": -0.15,
        "tolerated": 0.05,
        "learning_s": 0.04,
    }


def test_the_table_has_a_row_for_each_kind(capsys):
    print_scores({"known": score_attempts([KNOWN, KNOWN]), "new": score_attempts([PAUSED])})
    lines = [" ".join(line.split()) for line in capsys.readouterr().out.splitlines()[2:]]
    assert lines == ["known 2 1.000 0.000 0.000 0.500", "new 1 0.000 1.000 1.000 3.000"]


def test_the_figure_marks_the_pause_and_the_contact():
    novelty = np.linspace(0, 2, 150)
    paused = Attempt(novelty, PAUSE, grasp=100, contact=None, success=False)
    acted = Attempt(novelty / 4, None, grasp=90, contact=110, success=True)
    (axes,) = novelty_over_time({"known": acted, "new": paused}, 0.02).axes
    lines = {line.get_label(): line for line in axes.lines}
    assert np.array_equal(lines["new"].get_ydata(), novelty)
    assert lines["new"].get_xdata()[-1] == pytest.approx(149 * 0.02)
    assert to_hex(lines["new"].get_color()) == VERMILION
    assert lines["imitator's hand at its glass"].get_xdata()[0] == pytest.approx(2.2)
    assert [text.get_text() for text in axes.texts] == ["pauses: glass.x"]
    (mark,) = (line for line in axes.lines if line.get_marker() == "o")
    assert mark.get_xdata() == pytest.approx([0.2])
    assert mark.get_ydata() == pytest.approx([novelty[10]])


@pytest.mark.parametrize("count", [1, 2, 3])
def test_drawn_places_are_apart_and_depend_on_the_seed(count):
    for seed in range(20):
        places = draw_places((seed, 1), count)
        assert len(places) == count
        for i, place in enumerate(places):
            assert all(math.dist(place, other) >= 0.15 - 1e-9 for other in [USUAL, *places[:i]])
            assert math.hypot(*place) == pytest.approx(0.15)
        assert draw_places((seed, 1), count) == places
        assert draw_places((seed, 2), count) != places


def test_other_places_are_away_from_the_corrected_ones():
    for seed in range(20):
        corrected = draw_places((seed, 1), 3)
        place = draw_other_place((seed, 2), corrected)
        assert math.hypot(*place) == pytest.approx(0.15)
        assert min(math.dist(place, other) for other in corrected) >= 0.075
        assert draw_other_place((seed, 2), corrected) == place


def test_situations_cycle_through_places_with_different_seeds():
    places = draw_places((0, 1), 2)
    drawn = situations((0, 2), places, 6)
    assert [situation.offset for situation in drawn] == places * 3
    assert len({situation.seed for situation in drawn}) == 6
    assert situations((0, 2), [USUAL], 3) == [Situation(one.seed, USUAL) for one in drawn[:3]]
    assert situations((1, 2), places, 6)[0].seed != drawn[0].seed


def test_an_imitator_or_a_dataset_of_another_environment_is_refused(imitator, given):
    check(imitator, given)
    names = {"observation.state": ("elbow",), "action": ("motor",)}
    with pytest.raises(ValueError, match="features of the drinking environment at 50 frames"):
        check(imitator, Demonstrations(FPS, names, given.episodes))
    with pytest.raises(ValueError, match=r"got .* at 25"):
        check(imitator, Demonstrations(25, FEATURES, given.episodes))
    with pytest.raises(ValueError, match="learned something"):
        check(Imitator.from_demonstrations(given), given)
    with pytest.raises(ValueError, match="targets are states"):
        check(Imitator.from_demonstrations(given, "state"), given)


def test_a_missing_checkpoint_ends_with_one_line(tmp_path, monkeypatch):
    command = ["correct", tmp_path / "none", "--dataset", tmp_path, "--runs", tmp_path / "runs"]
    monkeypatch.setattr(sys, "argv", [*map(str, command)])
    with pytest.raises(SystemExit, match=r"^error: [^\n]*none[^\n]*$"):
        correct.main()
    assert not (tmp_path / "runs").exists()


def taught(dataset, seed, count):
    """Demonstrations that are recorded, and an imitator that has learned them."""
    record(dataset, seed, count)
    demonstrations = load_demonstrations(dataset)
    imitator = Imitator.from_demonstrations(demonstrations)
    imitator.learn(demonstrations)
    return demonstrations, imitator


@pytest.mark.slow
def test_what_was_learned_from_a_few_demonstrations_is_corrected_at_several_places(tmp_path):
    """More corrections than demonstrations, and a further place is new still."""
    demonstrations, imitator = taught(tmp_path / "dataset", 31, 3)
    before = imitator.novelty_detector.thresholds
    places = draw_places((31, 1), 2)
    turns = teaching.correct(imitator.eval(), demonstrations, places, 31, tmp_path / "corrected")
    assert {turn.place for turn in turns if turn.learning is not None} >= {1, 2}
    assert (imitator.novelty_detector.thresholds == before).all()
    imitator.save_pretrained(tmp_path / "checkpoint")
    drawn = [draw_other_place((31, 2, i), places) for i in range(40)]
    others = [one for one in drawn if min(math.dist(one, place) for place in places) > 0.11]
    assert len(others) >= 6
    tried = attempts(tmp_path / "checkpoint", situations((31, 3), others, 6), "other places")
    assert all(attempt.paused_in_time for attempt in tried)


@pytest.mark.slow
def test_corrections_at_new_places_do_not_harm_known_ones(tmp_path):
    _, imitator = taught(tmp_path / "dataset", 0, 8)
    imitator.save_pretrained(tmp_path / "checkpoint")
    command = [sys.executable, "-m", "train.correct", tmp_path / "checkpoint"]
    command += ["--dataset", tmp_path / "dataset", "--seed", "0", "--runs", tmp_path / "runs"]
    done = subprocess.run(command, cwd=PROJECT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    (folder,) = (tmp_path / "runs" / "correct").iterdir()
    scores = json.loads((folder / "metrics.json").read_text())

    known, new = scores["known places, before"], scores["new places, before"]
    assert known["episodes"] == new["episodes"] == 50
    assert known["paused_share"] <= 0.02
    assert new["paused_in_time_share"] >= 0.95
    assert set(new["paused_for"]) <= set(GLASS_NAMES)

    after, corrected = scores["known places, after"], scores["corrected places, after"]
    assert 1 <= scores["corrections"] <= teaching.ATTEMPTS - teaching.ENOUGH
    assert scores["learning_s_max"] < 1
    assert scores["new places, after"]["paused_in_time_share"] >= 0.95
    assert corrected["success_rate"] >= 0.9
    assert after["success_rate"] >= known["success_rate"] - 0.04
    assert after["paused_share"] <= 0.02

    extended = Imitator.from_pretrained(folder / "checkpoint")
    assert len(load_demonstrations(folder / "dataset")) == 8 + scores["corrections"]
    assert_clean(folder / "dataset")
    assert len({report.episode for report in extended.reports}) == 8 + scores["corrections"]
    assert (folder / "novelty.png").stat().st_size > 10_000
    assert load_demonstrations(tmp_path / "dataset").episodes[-1].episode == 7  # left as it was
