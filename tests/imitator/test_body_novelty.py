"""With a body, what it cannot reach is novel before it tries: too far away, or tipped over."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from arms import LIMITS, START, ArmScene, ArmWorld, body, pose, posture, script, shown
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation

from pacnet.attention.cutting import Size
from pacnet.forward_models.config import AffineForwardModelConfig
from pacnet.imitator import Imitator
from pacnet.imitator.framed_novelty import unreached
from pacnet.schemas.frames import FramesConfig
from pacnet.schemas.points import Point, Points

WORLD = ArmWorld()
REACH, TILTED = 0.05, 0.6  # share of the scene's size, [rad]; above them it is novel
OUT_OF_REACH = (0.75, 0.1, 0.15)


@pytest.fixture(scope="module")
def learned() -> Imitator:
    demonstrations = shown(WORLD)
    imitator = Imitator.from_demonstrations(demonstrations, body=body())
    imitator.learn(demonstrations)
    return imitator


def extent(imitator: Imitator) -> float:
    frames = imitator.config.frames
    assert frames is not None
    return frames.size.extent


def missed(imitator: Imitator, now: ArmScene) -> np.ndarray:
    """The way that is left of the hand at the end of its way to the object, by another search.

    The sum is made least of the squares of that, of 0.02 scene's sizes for each rad that the hand
    is turned otherwise, and of 0.02 for each rad from the posture shown.
    """
    size, first = extent(imitator), ArmScene(WORLD)
    (cut,) = imitator.cuts
    commanded = script(first)[0][cut.segments[1].first_frame - 1, :4]
    place, turn = pose(commanded)
    wanted = now.thing + now.turn.apply(place - first.thing)
    wanted_turn = now.turn * Rotation.from_matrix(turn)

    def cost(angles: np.ndarray) -> float:
        at, turned = pose(angles)
        off = (wanted_turn * Rotation.from_matrix(turned).inv()).magnitude()
        away = angles - commanded
        return ((at - wanted) ** 2).sum() + (0.02 * size) ** 2 * (off**2 + away @ away)

    starts = [commanded, posture(START), np.zeros(4)]
    limits = [(-LIMITS, LIMITS)] * 4
    best = min(
        (minimize(cost, one, bounds=limits, options={"ftol": 1e-14}) for one in starts),
        key=lambda one: one.fun,
    )
    return wanted - pose(best.x)[0]


def test_what_is_out_of_reach_is_novel_before_the_hand_is_on_its_way(learned: Imitator):
    learned.reset()
    now = ArmScene(WORLD, np.array(OUT_OF_REACH))
    for _ in range(10):  # the posture ahead is improved with each frame
        step = learned.step(now.percept)
    left = missed(learned, now)
    assert step.is_novel
    assert step.action is None
    assert step.target is not None
    assert step.landmark == "object"
    assert step.threshold == pytest.approx(REACH * extent(learned))
    assert step.novelty == pytest.approx(np.linalg.norm(left) / step.threshold, rel=0.05)
    assert step.dimension == "object.x"  # the arm is stretched out ahead
    assert step.deviation == pytest.approx(left[0], rel=0.05)


def test_the_first_step_says_so_too(learned: Imitator):
    learned.reset()
    assert learned.step(ArmScene(WORLD, np.array(OUT_OF_REACH)).percept).is_novel


def test_what_is_out_of_reach_is_novel_only_while_it_is_there(learned: Imitator):
    learned.reset()
    now, there = ArmScene(WORLD, np.array(OUT_OF_REACH)), ArmScene(WORLD)
    assert learned.step(now.percept).is_novel
    for _ in range(10):
        step = learned.step(there.percept)
    assert step.novelty < 0.4


def test_whoever_pauses_never_moves_on(learned: Imitator):
    learned.reset()
    now = ArmScene(WORLD, np.array(OUT_OF_REACH))
    steps = [learned.step(now.percept) for _ in range(600)]  # longer than what was shown
    assert all(step.action is None for step in steps)
    assert {(step.segment, step.followed) for step in steps} == {(0, steps[0].followed)}


def test_what_lies_on_its_side_is_novel(learned: Imitator):
    """The arm cannot roll its hand: it would stay turned otherwise by nearly as much."""
    learned.reset()
    now = ArmScene(WORLD)
    now.turn = Rotation.from_rotvec([1.2, 0, 0])
    now.thing = now.handle - now.turn.apply([0.05, 0, 0])
    for _ in range(3):
        step = learned.step(now.percept)
    assert step.is_novel
    assert step.threshold == TILTED
    assert step.dimension == "object.qx"
    assert TILTED < step.deviation <= 1.25
    assert step.novelty == pytest.approx(step.deviation / TILTED)


def test_what_is_within_reach_is_not_novel(learned: Imitator):
    """In the direction in which the hand points on the way there, more or less."""
    random = np.random.default_rng(0)
    for _ in range(100):
        ahead, heading, height = random.uniform((0.3, -0.1, 0.1), (0.5, 0.55, 0.35))
        handle = np.array((ahead * math.cos(heading), ahead * math.sin(heading), height))
        learned.reset()
        step = learned.step(ArmScene(WORLD, handle).percept)
        assert not step.is_novel, handle


def test_the_farther_out_of_reach_the_more_novel(learned: Imitator):
    scores = []
    for ahead in np.linspace(0.5, 1.2, 15):
        learned.reset()
        scores.append(learned.step(ArmScene(WORLD, np.array((ahead, 0.1, 0.15))).percept).novelty)
    assert scores[0] < 1 < scores[-1]
    assert scores[5:] == sorted(scores[5:])


def test_recognition_says_nothing_of_what_is_out_of_reach(learned: Imitator):
    """What is beyond a body is seen only while acting; a thing a hundred metres away is novel."""
    rows = [ArmScene(WORLD, np.array(at)).percept for at in (OUT_OF_REACH, (100.0, 0.1, 0.15))]
    assert learned.recognise(torch.from_numpy(np.stack(rows))).is_novel.tolist() == [False, True]


HAND, CUP = Point("hand", (0, 1, 2)), Point("cup", (3, 4, 5))


def config(orientation: tuple[int, ...]) -> FramesConfig:
    return FramesConfig(
        Points(HAND, (CUP, Point("plate", (6, 7, 8), orientation))),
        Size(2.0, 0.1),
        ((1.0, 1.0),) * 3,
        (),
        (),
        AffineForwardModelConfig(3, 1, 1, (-1,)),
    )


def turned(*vector: float) -> np.ndarray:
    turn = np.roll(Rotation.from_rotvec(vector).as_quat(), 1)
    return np.array([[1.0, 0, 0, 0], [1.0, 0, 0, 0], turn])


def test_what_is_short_of_a_place_is_told_where_it_is_largest():
    """0.06, −0.24 and 0.08 are 0.26 long; a scene of 2 allows 0.1."""
    score = unreached(np.array([0.06, -0.24, 0.08, 0.3]), 1, turned(0, 0, 0), config((9, 10, 11)))
    assert score.novelty == pytest.approx(2.6)
    assert score.dimension == 7
    assert score.deviation == pytest.approx(-0.24)
    assert score.threshold == pytest.approx(0.1)


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize(
    ("orientation", "first"), [((9, 10, 11), 9), ((9, 10, 11, 12), 10), ((9,), None)]
)
def test_what_is_tipped_is_told_by_the_axis_about_which_it_is_turned(orientation, first, axis: int):
    """A rotation vector, a quaternion that begins with w, or an angle."""
    vector = 0.1 * np.ones(3)
    vector[axis] = -0.9
    score = unreached(np.array([0.0, 0.0, 0.05, 0.9]), 1, turned(*vector), config(orientation))
    assert score.novelty == pytest.approx(1.5)
    assert score.dimension == (9 if first is None else first + axis)
    assert score.deviation == pytest.approx(0.9)
    assert score.threshold == TILTED


def test_on_the_way_to_no_landmark_nothing_is_out_of_reach():
    score = unreached(np.array([9.0, 9.0, 9.0, 3.0]), -1, turned(0, 0, 0), config(()))
    assert score.novelty == 0
