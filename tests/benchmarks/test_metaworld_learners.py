"""Learners of Metaworld's tasks on a made-up one: what each does, in places never shown."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from metaworld_toys import ToyWorld, demonstrations, reaching

from benchmarks.metaworld import baselines
from benchmarks.metaworld.baselines import Frames, Network, regress
from benchmarks.metaworld.evaluation import SEEDS, evaluate, run
from benchmarks.metaworld.features import View, relative
from benchmarks.metaworld.learners import LEARNERS, TITLES, Learner
from benchmarks.metaworld.recording import NUMBER
from benchmarks.metaworld.recording import SEEDS as SEEDS_SHOWN
from benchmarks.metaworld.results import Cell
from benchmarks.metaworld.simulation import HORIZON

SHOWN = demonstrations(20)


@pytest.fixture(autouse=True)
def short_training(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(baselines, "STEPS", 200)


def learned(name: str) -> Learner:
    learner = LEARNERS[name]()
    learner.learn(SHOWN)
    learner.reset()
    return learner


@pytest.mark.parametrize("name", ["local", "bc", "darp"])
def test_those_that_generalise_act_on_relative_places(name: str):
    learner = learned(name)
    percepts, actions = reaching(seed=100)
    errors = [learner.act(p) - a for p, a in zip(percepts, actions, strict=True)]
    assert np.sqrt(np.square(errors).mean()) < 0.4 * actions.std()  # 1-NN: 0.50
    moved = percepts + np.float32([0.4, 0.3, 0.2, 0, 0.4, 0.3, 0.2, 0.4, 0.3, 0.2])
    assert learner.act(moved[0]) == pytest.approx(learner.act(percepts[0]), abs=1e-3)


@pytest.mark.parametrize("name", LEARNERS)
def test_a_learner_repeats_itself_and_leaves_what_it_is_given(name: str):
    percepts, _ = reaching(seed=3)
    before, shown_before = percepts.copy(), SHOWN.episodes[0].percepts.clone()
    runs = []
    for _ in range(2):
        learner = learned(name)
        runs.append([learner.act(percept) for percept in percepts[:5]])
    for one, other in zip(*runs, strict=True):
        assert (one is None and other is None) or np.array_equal(one, other)
    assert np.array_equal(percepts, before)
    assert torch.equal(SHOWN.episodes[0].percepts, shown_before)
    assert name in TITLES


def test_training_a_network_leaves_the_random_numbers_of_others_alone():
    torch.manual_seed(5)
    expected = torch.rand(3)
    torch.manual_seed(5)
    learned("bc")
    assert torch.equal(torch.rand(3), expected)


def test_the_nearest_frame_is_that_of_the_smallest_scaled_distance():
    learner = learned("nearest")
    rows = np.concatenate([relative(shown.percepts.numpy()) for shown in SHOWN])
    actions = np.concatenate([shown.action.numpy() for shown in SHOWN])
    deviations = rows.std(axis=0)
    deviations[0] = np.inf  # the gripper never moves
    percept = reaching(seed=42)[0][7]
    apart = np.linalg.norm((rows - relative(percept)) / deviations, axis=1)
    assert np.array_equal(learner.act(percept), actions[apart.argmin()])


def test_frames_scale_and_find_neighbours():
    frames = Frames(np.array([[0.0, 5.0], [2.0, 5.0], [4.0, 5.0]]), np.zeros((3, 1)))
    assert frames.rows[:, 0] == pytest.approx([-(1.5**0.5), 0, 1.5**0.5])  # of deviation 8/3 ** .5
    assert frames.rows[:, 1] == pytest.approx([0, 0, 0])
    assert set(frames.nearest(frames.scaled(np.array([3.9, 5.0])), 2)) == {1, 2}
    assert set(frames.nearest(frames.rows[0], 10)) == {0, 1, 2}


def test_replay_repeats_the_demonstration_that_begins_most_alike_and_stays_at_its_end():
    learner = learned("replay")
    shown = SHOWN.episodes[3]
    first = shown.percepts[0].numpy() + np.float32(0.001)
    elsewhere = first + np.float32(0.3)
    actions = [learner.act(first)] + [learner.act(elsewhere) for _ in range(50)]
    assert np.array_equal(actions[:40], shown.action.numpy())
    assert np.array_equal(actions[45], shown.action[-1].numpy())
    learner.reset()
    other = SHOWN.episodes[1]
    assert np.array_equal(learner.act(other.percepts[0].numpy()), other.action[0])


def test_regression_is_exact_for_what_is_linear_and_ignores_what_weighs_nothing():
    random = np.random.default_rng(0)
    inputs = random.normal(size=(30, 3))
    outputs = inputs @ np.array([[1.0, 0], [2.0, 1], [0.0, -1]]) + [0.5, -0.25]
    weights = np.full(30, 1 / 29)
    weights[4], outputs[4] = 0, 100
    found = regress(inputs, outputs, weights, ridge=1e-9)
    assert found == pytest.approx([0.5, -0.25], abs=1e-6)


def test_regression_without_a_spread_is_the_mean():
    outputs = np.array([[1.0], [3.0]])
    assert regress(np.ones((2, 2)), outputs, np.array([0.5, 0.5])) == pytest.approx([2.0])


def test_a_network_averages_over_neighbours():
    random = np.random.default_rng(1)
    inputs = random.normal(size=(200, 2, 3))
    network = Network().fit(inputs, inputs.mean(axis=(1, 2))[:, None])
    one, other = (network.predict(part[None]) for part in inputs[0])
    assert network.predict(inputs[0]) == pytest.approx((one + other) / 2, abs=1e-6)
    assert network.predict(inputs[0]) == pytest.approx([inputs[0].mean()], abs=0.1)


def test_no_frame_is_its_own_neighbour_in_training(monkeypatch: pytest.MonkeyPatch):
    given = []
    monkeypatch.setattr(Network, "fit", lambda _, inputs, actions: given.append((inputs, actions)))
    learned("darp")
    inputs, actions = given[0]
    assert inputs.shape == (800, 10, 10 + 4 + 10)
    rows, difference = inputs[..., :10], inputs[..., 14:]
    assert np.linalg.norm(difference, axis=-1).min() > 1e-3
    percepts = rows + difference  # of the frame itself, ten times
    assert percepts == pytest.approx(np.repeat(percepts[:, :1], 10, axis=1))
    assert actions.shape == (800, 4)


def test_held_out_places_are_in_no_demonstration():
    draws = 50  # at most
    tried = int(NUMBER / 0.8)
    shown = {SEEDS_SHOWN * (d + 1) + n for d in range(draws) for n in range(tried)}
    assert max(shown) < SEEDS


class Scripted:
    """A learner that does what a list says."""

    def __init__(self, *actions: np.ndarray | None) -> None:
        self.actions, self.seen, self.resets = list(actions), [], 0

    def learn(self, shown: object) -> None:
        """Learn nothing."""

    def reset(self) -> None:
        """Count."""
        self.resets += 1

    def act(self, percept: np.ndarray) -> np.ndarray | None:
        """Return the next action."""
        self.seen.append(percept)
        return self.actions[min(len(self.seen) - 1, len(self.actions) - 1)]


def test_where_a_learner_holds_the_zero_action_is_sent_until_the_horizon():
    world, learner = ToyWorld(), Scripted(None)
    outcome = run(world, learner, 5, View())
    assert (outcome.success, outcome.steps, outcome.held) == (False, HORIZON, HORIZON)
    assert len(outcome.seconds) == len(world.commands) == HORIZON
    assert not np.any(world.commands)
    assert learner.resets == 1


def test_an_episode_ends_with_success():
    world = ToyWorld()
    world.reset(5)
    straight = np.append(world.thing - world.hand, 0)
    steps = int(np.ceil((np.linalg.norm(straight) - 0.01) / 0.01))  # of 1 cm each
    learner = Scripted(None, straight / np.linalg.norm(straight))
    outcome = run(world, learner, 5, View())
    assert outcome.success
    assert (outcome.steps, outcome.held) == (steps + 1, 1)


def test_noise_is_perceived_but_does_not_move_anything():
    exact, noisy = Scripted(None), Scripted(None)
    world = ToyWorld()
    run(world, exact, 5, View())
    run(world, noisy, 5, View(noise=0.01))
    errors = np.array(noisy.seen) - np.array(exact.seen)
    assert errors[:, [0, 1, 2, 4, 9]].std(axis=0) == pytest.approx(np.full(5, 0.01), rel=0.2)
    repeated = Scripted(None)
    run(world, repeated, 5, View(noise=0.01))
    assert np.array_equal(repeated.seen, noisy.seen)


def test_a_cell_is_measured_in_the_same_places_for_every_learner():
    seeds = []
    for name in ("local", "replay"):
        world = ToyWorld()
        result = evaluate(Cell("reach", 2, 5, name), world, SHOWN, episodes=4)
        seeds.append(world.seeds)
        assert len(result.successes) == len(result.steps) == 4
        assert result.held == 0
        assert result.learning_s > 0
        assert result.step_us > 0
    assert seeds[0] == seeds[1] == [1_002_000, 1_002_001, 1_002_002, 1_002_003]


@pytest.mark.parametrize("view", [View(units=1000), View(turn=30)])
def test_a_learner_of_relative_places_succeeds_in_any_unit_and_axes(view: View):
    cell = Cell("reach", 0, 20, "local")
    usual = evaluate(cell, ToyWorld(), SHOWN, episodes=10)
    other = evaluate(replace(cell, view=view), ToyWorld(), SHOWN, episodes=10)
    assert other.successes == usual.successes
    assert usual.success >= 0.5  # some start too far away
