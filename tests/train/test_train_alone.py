"""Experiment 1 alone: who acts, what an episode is, and how it is scored."""

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from envs.behaviours import REST_POSTURE
from envs.glass_offset import DIRECTIONS
from envs.postural_imitation import PosturalImitationEnv
from train.common.typical import Typical
from train.postural.alone import actors, mirror
from train.postural.alone.actors import Observation, own_percept
from train.postural.alone.episodes import Outcome, Shown, act, demonstrate, demonstrate_again
from train.postural.alone.learning import load_body
from train.postural.alone.replicates import summary_of
from train.postural.alone.report import print_tables
from train.postural.alone.scenes import (
    ALONE,
    COPYING,
    OURS,
    RADIUS,
    REPLAY,
    SCENES,
    STRANGE,
    USUAL,
    Scene,
    draw_place,
    scenes_of,
)
from train.postural.alone.scores import ours, score_trials
from train.postural.alone.trials import Trial
from train.postural.episodes import Condition, make_environment

PRESENT = Scene((), "present", radius=0.0)


def observation(body: float = 0.0, glass: float = 0.0, other: float = 0.0) -> Observation:
    return {
        "demonstrator": np.full(22, other, np.float32),
        "glass": np.full(6, other, np.float32),
        "proprioception": np.full(22, body, np.float32),
        "own_glass": np.full(6, glass, np.float32),
    }


def shown(*levels: float) -> actors.Shown:
    """Return demonstrations of three samples: percepts from a level upwards, actions as many."""
    percepts = [np.full((3, 28), level, np.float32) + np.arange(3)[:, None] for level in levels]
    actions = [np.full((3, 11), 10 * level) + np.arange(3)[:, None] for level in levels]
    return percepts, [action.astype(np.float32) for action in actions]


class _Scripted:
    """Do what a function of environment and step says, and call it new from a step on."""

    def __init__(self, environment: PosturalImitationEnv, new_from: int = 10_000) -> None:
        self._environment, self._new_from = environment, new_from
        self.is_novel = False

    def reset(self) -> None:
        self.steps = 0

    def step(self, _: Observation) -> actors.Target:
        self.is_novel = self.steps >= self._new_from
        self.steps += 1
        return self._environment.demonstrator_target


@pytest.fixture(scope="module")
def environment() -> PosturalImitationEnv:
    return make_environment(Condition())


def test_own_body_and_glass_come_in_the_order_of_the_others():
    row = own_percept(observation(body=1.0, glass=2.0, other=9.0))
    np.testing.assert_array_equal(row, np.repeat(np.float32([1, 2]), (22, 6)))


def test_copying_is_a_filter_of_the_demonstrator_and_holds_without_one():
    copying = actors._Copying()
    copying.reset()
    assert copying.step(observation(other=0.0)) is None
    seen = observation()
    seen["demonstrator"] = np.r_[np.full(11, 1.0), np.full(11, 3.0)].astype(np.float32)
    # Towards 1 + 0.067 * 3 = 1.201 by three tenths of what is left, twice: 1 - 0.7² = 0.51.
    copying.step(seen)
    target = copying.step(seen)
    np.testing.assert_allclose(target, 0.49 * REST_POSTURE + 0.51 * 1.201, rtol=1e-6)
    assert copying.step(observation(body=1.0)) is None


def test_replay_chooses_by_the_first_percept_plays_in_order_and_holds_the_end():
    replay = actors._Replay(shown(0.0, 4.0), np.ones(28, np.float32))
    for first, actions in ((0.5, [0, 1, 2, 2]), (3.0, [40, 41, 42, 42])):
        replay.reset()
        played = [replay.step(observation(body=at, glass=at))[0] for at in (first, 0, 9, 0)]
        assert played == actions


def test_the_nearest_frame_decides_by_the_scaled_own_percept():
    scale = np.repeat(np.float32([1.0, 0.0]), (22, 6))  # the glass does not count
    nearest = actors._Nearest(shown(0.0, 4.0), scale)
    assert nearest.step(observation(body=5.1, glass=0.0, other=0.0))[0] == 41
    assert nearest.step(observation(body=0.9, glass=6.0, other=6.0))[0] == 1


def test_places_are_drawn_by_the_seed_within_the_radius():
    places = np.array([draw_place(seed, RADIUS) for seed in range(400)])
    distances, turns = np.hypot(*places.T), np.arctan2(*places.T[::-1]) % (2 * np.pi)
    assert distances.max() <= RADIUS
    # Uniform in area: a quarter of them within half the radius; 0.25 ± 3 standard errors of 0.022.
    assert (distances < RADIUS / 2).mean() == pytest.approx(0.25, abs=0.066)
    assert DIRECTIONS[0] <= turns.min() <= turns.max() <= DIRECTIONS[1]
    assert draw_place(7, RADIUS) == tuple(places[7])
    assert draw_place(7, 0.0) == (0.0, 0.0)


def test_every_scene_has_the_places_of_one_radius():
    near, far = scenes_of(0.0), scenes_of(RADIUS)
    assert near.keys() | far.keys() == SCENES.keys() | STRANGE.keys()
    assert not near.keys() & far.keys()


def test_whoever_does_as_the_demonstrator_drinks_and_what_is_new_then_comes_late(environment):
    done = act(_Scripted(environment, new_from=300), environment, PRESENT, seed=3)
    assert done.success
    assert done.is_novel
    assert not done.is_novel_in_time  # the glass was in hand long before
    assert done.held.any()
    assert done.percepts.shape == (environment.episode_steps, 28)
    early = act(_Scripted(environment, new_from=2), environment, PRESENT, seed=3)
    assert early.is_novel_in_time
    assert early.success  # that it is new ends no episode here


def test_an_episode_ends_when_something_strange_is_noticed(environment):
    steps: list[int] = []
    scene = Scene((), own_glass="absent")
    done = act(_Scripted(environment, new_from=4), environment, scene, 3, steps.append)
    assert steps == [1, 2, 3, 4, 5]
    assert (len(done.wrist), len(done.percepts), len(done.held)) == (5, 5, 5)
    assert done.is_novel_in_time
    assert not done.success


def test_another_demonstrator_drinks_at_the_same_place_in_its_own_way(environment):
    offset = (-0.1, 0.02)
    one, other = (f(environment, 5, offset) for f in (demonstrate, demonstrate_again))
    glasses = [watched.percepts[:40, 22:25].mean(axis=0) for watched in (one, other)]
    np.testing.assert_allclose(*glasses, atol=4 * 0.005 / np.sqrt(40))  # noise of 5 mm
    assert len(one.wrist) != len(other.wrist)
    again = demonstrate_again(environment, 5, offset)
    np.testing.assert_array_equal(other.wrist, again.wrist)


def outcome(success: bool = True, novel: str = "", held_from: int | None = None) -> Outcome:
    """Return an outcome of 100 steps; percepts begin with the number of the node that wins."""
    percepts = np.zeros((100, 28), np.float32)
    percepts[30:50, 0] = 1
    held = np.arange(100) >= (100 if held_from is None else held_from)
    wrist = np.zeros((100, 3), np.float32)
    return Outcome(success, bool(novel), novel == "early", 2e-4, wrist, percepts, held)


def trial(scene: str, strange: str = "early", **kwargs) -> Trial:
    """Return a trial in which all rows of the scenes at its place do the same."""
    scenes = scenes_of(SCENES[scene].radius)
    outcomes = {
        name: dict.fromkeys(s.rows, outcome(**kwargs) if s.is_known else outcome(novel=strange))
        for name, s in scenes.items()
    }
    distances = {name: dict.fromkeys(outcomes[name], 0.02) for name in scenes if name in SCENES}
    percepts = np.zeros((60, 28), np.float32)
    percepts[20:30, 0] = 1
    phases = np.where((np.arange(60) >= 20) & (np.arange(60) < 30), "grasp", "rest")
    watched = Shown(np.zeros((60, 3), np.float32), percepts, phases)
    return Trial(0, (0.0, 0.0), outcomes, distances, watched, 0.005)


@pytest.fixture
def first_column_wins(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let the first number of a percept be the node that wins."""
    winners: Callable = lambda _, percepts: percepts[:, 0].astype(np.int64)  # noqa: E731
    monkeypatch.setattr(mirror, "nearest_nodes", winners)


@pytest.mark.usefixtures("first_column_wins")
def test_scores_are_means_over_the_episodes_of_a_scene():
    trials = [
        trial(USUAL, held_from=50),
        trial(USUAL, success=False, novel="late", held_from=45),
        trial(ALONE),
        trial(ALONE, "late", success=False),
        trial(ALONE, "early", novel="early"),
    ]
    scores = score_trials(trials, None, 1.5)
    assert scores["success"][f"{USUAL} | {OURS}"] == 0.5
    assert scores["success"][f"{ALONE} | {COPYING}"] == pytest.approx(2 / 3)
    assert f"{USUAL} | {COPYING}" not in scores["success"]
    assert scores["distance_m"][f"{ALONE} | {REPLAY}"] == pytest.approx(0.02)
    assert scores["distance_m"][f"{ALONE} | another demonstrator"] == pytest.approx(0.005)
    assert scores["novelty"] == pytest.approx(
        {"far": 2 / 3, "tipped": 2 / 3, "absent": 2 / 3, USUAL: 0.5, ALONE: 1 / 3}
    )
    assert scores["timing"] == pytest.approx({"learning_s": 1.5, "step_s": 2e-4})
    assert len(ours(trials, ALONE)) == 3
    # Node 1 wins the whole grasp that was watched. Of the own ones, which begin 20 samples before
    # the glass is held, it wins 30 to 49 and 30 to 44 of 25 to 44; of 200 samples in all, 40.
    shares = {"watched": 1.0, "own": (20 + 15) / 40, "chance": 0.2}
    assert scores["mirror"] == pytest.approx(shares)


@pytest.mark.usefixtures("first_column_wins")
def test_nobody_who_takes_no_glass_mirrors_a_grasp():
    got = mirror.mirror(None, [trial(USUAL)])
    assert (got.node, got.watched, got.own) == (1, 1.0, 0.0)


@pytest.mark.usefixtures("first_column_wins")
def test_tables_show_a_spread_only_over_replicates(capsys):
    trials = [trial(USUAL, held_from=50), trial(ALONE)]
    one = score_trials(trials, None, 1.0)
    other = score_trials(trials, None, 2.0)
    print_tables(summary_of([one]))
    single = capsys.readouterr().out
    assert "±" not in single.replace("± 1 cm", "")
    assert re.search(rf"{OURS} +1\.00 +1\.00 +1\.00 +- +-\n", single)
    assert re.search(r"another demonstrator( +0\.50){5}\n", single)  # [cm]
    print_tables(summary_of([one, other]))
    both = capsys.readouterr().out
    assert "1.00 ± 0.00" in both
    assert "learning 1.50 ± 0.71 s" in both


@pytest.mark.usefixtures("first_column_wins")
def test_tables_of_one_replicate_show_in_brackets_what_is_typical(capsys):
    trials = [trial(USUAL, held_from=50), trial(ALONE)]
    one, other = (score_trials(trials, None, seconds) for seconds in (1.0, 2.0))
    known = Typical("of two", {"success": summary_of([one, other])["success"]})
    print_tables(summary_of([one]), known)
    text = capsys.readouterr().out
    assert re.search(rf"{OURS} +1\.00 \(1\.00 ± 0\.00\) ", text)
    assert re.search(r"another demonstrator( +0\.50){5}\n", text)  # of which nothing is known
    assert text.endswith("in brackets: of two\n")


def test_a_missing_body_ends_with_one_line_that_says_how_to_make_one(tmp_path: Path):
    with pytest.raises(SystemExit, match=r"error: expected .*train\.babbling"):
        load_body(tmp_path / "nowhere")
