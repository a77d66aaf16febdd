"""The world in which a turned mug is hung on a turned hook, and the imitator in it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from benchmarks.turned import outcome
from benchmarks.turned_expert import demonstrations_of
from benchmarks.turned_learners import Imitating, Nearest
from benchmarks.turned_world import HANDLE, VARIANTS, World, in_front, turned
from pacnet.datasets.demonstrations import Demonstrations

SHOWN = 10_000  # seed of the demonstration


def scene(name: str, seed: int = 0) -> World:
    return World(VARIANTS[name], np.random.default_rng(seed))


def test_a_vector_is_turned_against_the_clock_and_keeps_its_height() -> None:
    assert turned(np.array([1.0, 0.0, 5.0]), np.pi / 2) == pytest.approx([0, 1, 5])


def test_a_mug_that_is_not_turned_has_its_handle_towards_the_robot() -> None:
    pose = np.array([0.1, 0.2, 0.05, 0.0])
    assert in_front(pose, HANDLE) == pytest.approx([0.1, 0.2 - HANDLE, 0.05])


def test_the_gripper_that_closes_elsewhere_holds_nothing() -> None:
    world = scene("space")
    world.hand[:3] = world.handle + np.array([0, 0, 0.03])
    for _ in range(25):
        world.step(np.array([0.0, 0, 0, 1]))
    assert world.opening == 0
    assert not world.is_held


def test_the_hand_holds_the_mug_by_its_handle_and_carries_it() -> None:
    world = scene("space")
    world.hand[:3] = world.handle
    for _ in range(25):
        world.step(np.array([0.0, 0, 0, 1]))
    before = world.mug.copy(), world.hand.copy()
    for _ in range(25):
        world.step(np.array([0.0, 0.5, 1, 1]))
    assert world.hand[2] > before[1][2] + 0.05
    assert world.mug - before[0] == pytest.approx(world.hand - before[1])


def test_the_hand_pushes_the_mug_away() -> None:
    world = scene("plane")
    mug = world.mug.copy()
    world.hand[:2] = mug[:2] - [0.1, 0]
    for _ in range(25):
        world.step(np.array([1.0, 0, -1]))
    assert world.mug[0] > mug[0] + 0.02


def test_the_hand_does_not_pass_through_the_board() -> None:
    world = scene("space")
    world.board[3] = 0.0
    world.hand[:3] = world.board[:3] - [0, 0.05, 0]
    for _ in range(50):
        world.step(np.array([0.0, 1, 0, -1]))
    assert world.hand[1] < world.board[1]


def test_a_hand_that_turns_grasps_only_what_it_is_aligned_with() -> None:
    for off, holds in ((15, True), (25, False)):
        world = scene("hand")
        world.hand = np.append(world.handle, world.mug[3] + np.radians(off))
        for _ in range(25):
            world.step(np.array([0.0, 0, 0, 0, 1]))
        assert world.is_held is holds


@pytest.mark.parametrize("name", VARIANTS)
def test_the_imitator_hangs_turned_mugs_after_one_demonstration(name: str) -> None:
    """The mug stays in the hand, however else the board is turned than in the demonstration."""
    variant, learner = VARIANTS[name], Imitating()
    learner.learn(demonstrations_of(variant, SHOWN))
    assert all(outcome(learner, variant, 1_000 + seed).hung for seed in (6, 13, 24))


class OtherUnits:
    """An imitator whose places and whose turning have other units.

    Args:
        place: what a metre is.
        turn: what an action of 1 that turns the hand is.
    """

    def __init__(self, place: float, turn: float) -> None:
        self._learner, variant = Imitating(), VARIANTS["hand"]
        is_place = [name.endswith((".x", ".y", ".z")) for name in variant.percept_names]
        self._percept = np.where(is_place, place, 1.0).astype(np.float32)
        self._action = np.array([1, 1, 1, turn, 1], np.float32)
        self.reset = self._learner.reset

    def learn(self, demonstrations: Demonstrations) -> None:
        """Learn one demonstration in these units."""
        one, factors = demonstrations.episodes[0], torch.from_numpy(self._percept)
        own = one.state.shape[1]
        other = replace(
            one,
            state=one.state * factors[:own],
            environment_state=one.environment_state * factors[own:],
            action=one.action * torch.from_numpy(self._action),
        )
        self._learner.learn(replace(demonstrations, episodes=(other,)))

    def act(self, percept: NDArray[np.floating]) -> NDArray[np.floating] | None:
        """Return the action, in the world's units."""
        action = self._learner.act(percept * self._percept)
        return None if action is None else action / self._action


@pytest.mark.parametrize(("place", "turn"), [(1000.0, 1.0), (1.0, 0.1), (0.01, 1.0)])
def test_any_units_of_places_and_of_turning_will_do(place: float, turn: float) -> None:
    variant, learner = VARIANTS["hand"], OtherUnits(place, turn)
    learner.learn(demonstrations_of(variant, SHOWN))
    assert all(outcome(learner, variant, 1_000 + seed).hung for seed in (6, 13, 24))


def test_what_is_dropped_is_picked_up_again() -> None:
    variant, learner = VARIANTS["space"], Imitating()
    learner.learn(demonstrations_of(variant, SHOWN))
    world = scene("space", 1_006)
    learner.reset()
    grasps, dropped = 0, False
    for _ in range(600):
        held = world.is_held
        world.step(_acted(learner, world))
        grasps += world.is_held and not held
        if world.is_held and not dropped and np.linalg.norm(world.handle - world.board[:3]) < 0.3:
            dropped, world.is_held, world.mug[2] = True, False, 0.05
            world.mug[:2] -= [0.0, 0.15]
        if world.hangs:
            break
    assert dropped
    assert grasps == 2
    assert world.hangs


def test_the_nearest_frame_along_the_mugs_axes_is_the_same_wherever_all_is_turned() -> None:
    variant = VARIANTS["plane"]
    learner = Nearest(variant, of_mug=True)
    shown = demonstrations_of(variant, SHOWN)
    learner.learn(shown)
    frame, turn = 30, 0.7
    percept = shown.episodes[0].percepts.numpy()[frame].astype(np.float64)
    action = shown.episodes[0].action.numpy()[frame]
    got = learner.act(_turned_scene(percept, turn))
    assert got == pytest.approx(np.append(turned(action[:2], turn), action[2]), abs=1e-5)


def _turned_scene(percept: NDArray[np.float64], turn: float) -> NDArray[np.float64]:
    out = percept.copy()
    for first in (0, 3, 6):
        out[first : first + 2] = turned(percept[first : first + 2], turn)
    out[[5, 8]] += turn
    return out


def _acted(learner: Imitating, world: World) -> NDArray[np.floating]:
    action = learner.act(world.percept())
    assert action is not None
    return action
