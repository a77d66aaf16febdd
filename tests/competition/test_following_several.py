"""Following several demonstrations: which of them act, how they are blended, what is asked for."""

import numpy as np
import pytest
import torch
from paths import FPS, bend, learned, line, run, shown, shown_by_speed

from pacnet.competition.following_kernels import BLENDED, FOLLOWED, SOFTNESS
from pacnet.datasets.demonstrations import Demonstration, Demonstrations

FAN = [line((0, number / 40), (2, number / 20)) for number in range(40)]


def constant(*places: float, action: tuple[float, ...]) -> Demonstrations:
    """Straight on beside one another, each with an action of its own, which is no place."""
    episodes = []
    for number, (place, value) in enumerate(zip(places, action, strict=True)):
        state = torch.from_numpy(line((0, place), (1, place))).float()
        shown_value = torch.full((len(state), 1), value)
        episodes.append(Demonstration(number, "go", state, torch.empty(len(state), 0), shown_value))
    names = {"observation.state": ("x", "y"), "action": ("grip",)}
    return Demonstrations(FPS, names, tuple(episodes), "constant")


def crossing(count: int, seed: int = 0) -> list[np.ndarray]:
    """Up and down in turn, all of them by about (0, 0)."""
    ways = (line((-1, -1), (1, 1)), line((-1, 1), (1, -1)))
    rng = np.random.default_rng(seed)
    return [ways[number % 2] + rng.normal(0, 0.03, 2) for number in range(2 * count)]


@pytest.mark.parametrize("by_speed", [False, True])
@pytest.mark.parametrize("way", [0, 1])
def test_behind_a_crossing_the_way_that_it_came_by_is_continued(by_speed: bool, way: int):
    paths = crossing(BLENDED)
    done = run(
        learned((shown_by_speed if by_speed else shown)(*paths)), paths[way][0], 99,
        by_speed=by_speed,
    )  # fmt: skip
    np.testing.assert_allclose(done.places, paths[way], atol=0.06)  # they are 0.03 apart
    assert {step.followed[0].demonstration % 2 for step in done.steps} == {way}


@pytest.mark.parametrize("way", [0, 1])
def test_of_two_that_cross_the_one_that_is_shown_weighs_most_at_every_frame(way: int):
    ways = crossing(1)
    imitator = learned(shown(*ways))
    steps = [imitator.step(place.astype(np.float32)) for place in ways[way]]
    assert all(step.followed[0].demonstration == way for step in steps)
    assert steps[-1].followed[0].weight > 0.9


@pytest.mark.parametrize("pairs", [1, 2, BLENDED])
@pytest.mark.parametrize("way", [0, 1])
def test_there_is_told_from_back(way: int, pairs: int):
    rng, both = np.random.default_rng(0), [bend(), bend()[::-1]]
    imitator = learned(shown(*(path + rng.normal(0, 0.01, path.shape) for path in both * pairs)))
    steps = [imitator.step(place.astype(np.float32)) for place in both[way][45:85]]
    # At first nothing tells where it is going.
    assert {one.demonstration % 2 for one in steps[0].followed} == {0, 1}
    for step in steps[round(0.6 * FPS) :]:
        assert {one.demonstration % 2 for one in step.followed} == {way}


def test_what_fits_equally_well_is_blended():
    imitator = learned(constant(-0.1, 0.1, action=(1.0, 3.0)))
    first = imitator.step(np.float32([0, 0]))
    assert [one.weight for one in first.followed] == pytest.approx([0.5, 0.5])
    assert first.action == pytest.approx([2.0], abs=1e-4)  # the mean
    assert imitator.step(np.float32([0.01, 0])).action == pytest.approx([2.0], abs=1e-4)


# Half of the frames are at 0, half at 1: a standard deviation of 0.5, so that 0.1 is 0.2 far.
@pytest.mark.parametrize(("place", "near", "far"), [(0.4, 0.8, 1.2), (0.25, 0.5, 1.5)])
def test_what_is_nearer_weighs_more(place: float, near: float, far: float):
    imitator = learned(constant(0.0, 1.0, action=(1.0, 3.0)))
    step = imitator.step(np.float32([0, place]))
    weights = np.array([1 / (near + SOFTNESS), 1 / (far + SOFTNESS)])
    assert [one.demonstration for one in step.followed] == [0, 1]
    assert [one.weight for one in step.followed] == pytest.approx(weights / weights.sum(), rel=1e-4)


@pytest.mark.parametrize("place", [0.0, 0.2])  # 0.4 + SOFTNESS, and more than thrice that
def test_what_is_far_away_has_no_weight(place: float):
    imitator = learned(constant(0.0, 1.0, action=(1.0, 3.0)))
    step = imitator.step(np.float32([0, place]))
    assert [(one.demonstration, one.weight) for one in step.followed] == [(0, 1)]


def test_of_many_the_nearest_act():
    imitator = learned(shown(*FAN))
    assert len(FAN) > FOLLOWED
    for number in (0, 17, 39):
        done = run(imitator, FAN[number][0], 100)
        followed = done.steps[0].followed
        apart = [abs(one.demonstration - number) for one in followed]
        assert 1 < len(apart) <= BLENDED
        # The nearest of all, the nearest first; beside 17 there are two of each distance.
        assert apart == sorted(abs(other - number) for other in range(len(FAN)))[: len(apart)]
        assert sum(one.weight for one in followed) == pytest.approx(1)
        # The mean of five at most, of which the farthest ends 4 / 20 away.
        assert done.places[-1] == pytest.approx(FAN[number][-1], abs=0.15)


def test_only_the_task_that_is_asked_for_is_followed():
    up, down = bend(), bend() * (1, -1)
    imitator = learned(shown(up, down, up + 0.01, tasks=("up", "down", "up")))
    for task, path, numbers in (("up", up, {0, 2}), ("down", down, {1})):
        done = run(imitator, (0.0, 0.0), 100, task=task)
        assert {one.demonstration for step in done.steps for one in step.followed} == numbers
        assert done.places[50] == pytest.approx(path[50], abs=0.05)
    imitator.reset()
    assert len(imitator.step(np.float32([0, 0])).followed) == 3


def test_an_unknown_task_is_refused_and_changes_nothing():
    imitator = learned(shown(bend(), bend() * (1, -1), tasks=("up", "down")))
    run(imitator, (0.0, 0.0), 50, task="down")
    for task in ("sideways", "", 3, b"up"):
        with pytest.raises(ValueError, match="expected a task that was shown: 'up', 'down', got"):
            imitator.reset(task=task)
    step = imitator.step(np.float32([1, -1]))
    assert [one.demonstration for one in step.followed] == [1]
    assert step.followed[0].frame == pytest.approx(50, abs=1)


def test_before_anything_was_learned_no_task_is_known():
    untrained = type(learned(shown(bend()))).from_demonstrations(shown(bend()))
    with pytest.raises(ValueError, match="expected a task that was shown: none, got 'go'"):
        untrained.reset("go")


def test_blanks_in_a_task_do_not_matter():
    imitator = learned(shown(bend(), bend() + 0.1, tasks=("go  there", " go there\n")))
    assert imitator.tasks == ("go there",)
    imitator.reset("go   there ")
    assert len(imitator.step(np.float32([0.05, 0.05])).followed) == 2  # between both


def test_the_order_of_learning_does_not_matter():
    rng = np.random.default_rng(0)
    paths = [bend() + rng.normal(0, 0.02, (100, 2)) for _ in range(2)]
    actions = []
    for both in (paths, paths[::-1]):
        imitator = learned(shown(*both))
        actions.append([imitator.step(place.astype(np.float32)).action for place in bend()])
    np.testing.assert_allclose(*actions, atol=1e-5)


def test_the_same_percepts_are_answered_in_the_same_way_again():
    imitator = learned(shown(*FAN[::4]))
    first, second = (run(imitator, FAN[3][0], 60) for _ in range(2))
    np.testing.assert_array_equal(first.places, second.places)
    np.testing.assert_equal(first.steps, second.steps)
