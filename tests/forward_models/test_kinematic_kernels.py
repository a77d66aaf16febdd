"""The body model's kernels: poses, slopes and what is reached agree with second methods."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import torch
from hinge_chains import Array, Chain, exact_model, make_chain, postures, wxyz
from numba import njit
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from pacnet.forward_models.kinematic_kernels import make_work, pose_at, reach
from pacnet.forward_models.turn_matrices import nearest_turns

HAND = (0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0)
GLASS = (0.02, -0.05, 0.1), wxyz(Rotation.from_rotvec([0.3, -0.8, 0.4]))
TURN_WEIGHT, POSTURE_WEIGHT = 0.2, 0.02


def held_pose(chain: Chain, held: Any, angles: Array) -> tuple[Array, Rotation]:
    """Return where what is held is and how it is turned."""
    place, turn = chain.pose(angles)
    return place + turn.apply(held[0]), turn * Rotation.from_quat(np.roll(held[1], -1))


def residuals(chain: Chain, held: Any, goal: Any, shown: Array, angles: Array) -> Array:
    """Return what `reach` makes least, as a second method."""
    place, turn = held_pose(chain, held, angles)
    wanted = Rotation.from_quat(np.roll(goal[1], -1))
    off = (wanted * turn.inv()).as_rotvec()
    if goal[2]:
        now, then = turn.apply([0, 0, 1]), wanted.apply([0, 0, 1])
        off = [np.arctan2(np.linalg.norm(np.cross(now, then)), now @ then)]
    moving = list(chain.moving)
    pull = POSTURE_WEIGHT * (angles - shown)[moving]
    return np.concatenate([place - goal[0], TURN_WEIGHT * np.array(off), pull])


def run(
    model: Any, held: Any, goal: Any, shown: Array, begin: Array, steps: int
) -> tuple[Array, Any, Any]:
    """Return the posture, the distance and the angle, and the work."""
    arrays, angles = model.arrays(), begin.copy()
    work = make_work(arrays)
    left = reach(
        arrays, angles, shown, held[0], tuple(map(float, held[1])), tuple(map(float, goal[0])),
        tuple(map(float, goal[1])), goal[2], (TURN_WEIGHT, POSTURE_WEIGHT, steps), work,
    )  # fmt: skip
    return angles, left, work


@pytest.mark.parametrize(("moving", "joints"), [(1, 1), (2, 4), (4, 11), (6, 6)])
def test_poses_are_those_of_the_chain(moving: int, joints: int):
    chain = make_chain(moving, joints, seed=1)
    arrays = exact_model(chain).arrays()
    for angles in postures(chain, 30, seed=2):
        place, turn = pose_at(arrays, angles)
        there, turned = chain.pose(angles)
        np.testing.assert_allclose(place, there, atol=1e-12)
        assert abs(np.dot(turn, wxyz(turned))) == pytest.approx(1, abs=1e-12)
        assert turn[0] >= 0


def test_turns_of_matrices_that_are_not_quite_rotations_are_the_nearest():
    chain = make_chain(3, 3, seed=1)
    model = exact_model(chain)
    noise = torch.randn(model.coefficients.shape, generator=torch.Generator().manual_seed(0))
    model.coefficients += 0.01 * noise
    arrays = model.arrays()
    angles = postures(chain, 50, seed=2)
    turns = np.array([pose_at(arrays, one)[1] for one in angles])
    np.testing.assert_allclose(model(torch.from_numpy(angles)).turn, turns, atol=1e-7)


def test_the_nearest_rotation_is_that_of_a_singular_value_decomposition():
    rng = np.random.default_rng(0)
    matrices = Rotation.random(50, random_state=1).as_matrix() + rng.normal(0, 0.1, (50, 3, 3))
    u, _, v = np.linalg.svd(matrices)
    expected = np.roll(Rotation.from_matrix(u @ v).as_quat(), 1, axis=1)
    found = nearest_turns(torch.from_numpy(matrices)).numpy()
    np.testing.assert_allclose(np.abs((found * expected).sum(axis=1)), 1, atol=1e-12)


@pytest.mark.parametrize("axis", [False, True])
@pytest.mark.parametrize("held", [HAND, GLASS])
def test_the_gradient_is_that_of_finite_differences(held: Any, axis: bool):
    chain = make_chain(4, 6, seed=3)
    model = exact_model(chain)
    shown, begin, aim = postures(chain, 3, seed=4)
    place, turn = held_pose(chain, held, aim)
    goal = (place, wxyz(turn), axis)
    _, _, work = run(model, held, goal, shown, begin, steps=0)

    def half_cost(angles: Array) -> float:
        return 0.5 * float(np.square(residuals(chain, held, goal, shown, angles)).sum())

    for number, joint in enumerate(chain.moving):
        step = np.zeros(6)
        step[joint] = 1e-6
        slope = (half_cost(begin + step) - half_cost(begin - step)) / 2e-6
        assert work.gradient[number] == pytest.approx(slope, abs=1e-7), joint


def cost_and_least(
    chain: Chain, held: Any, goal: Any, shown: Array, angles: Array, widest: float
) -> tuple[float, float]:
    """Return the cost of a posture, and the least that SciPy finds within ± `widest`."""
    free = list(chain.moving)

    def of_free(moved: Array) -> Array:
        posture = shown.copy()
        posture[free] = moved
        return residuals(chain, held, goal, shown, posture)

    begin = shown[free].clip(1e-6 - widest, widest - 1e-6)
    found = least_squares(of_free, begin, bounds=(-widest, widest), xtol=1e-12, ftol=1e-12)
    return float(np.square(of_free(angles[free])).sum()) / 2, float(found.cost)


@pytest.mark.parametrize("axis", [False, True])
@pytest.mark.parametrize("held", [HAND, GLASS])
def test_what_is_reached_is_what_another_solver_finds(held: Any, axis: bool):
    chain = make_chain(5, 6, seed=3)
    model = exact_model(chain)
    for shown, way in zip(
        0.5 * postures(chain, 8, seed=4), 0.3 * postures(chain, 8, seed=5), strict=True
    ):
        place, turn = held_pose(chain, held, shown + way)
        goal = (place + 0.02, wxyz(turn), axis)
        angles, left, _ = run(model, held, goal, shown, shown, steps=300)
        cost, least = cost_and_least(chain, held, goal, shown, angles, widest=1.2)
        assert cost <= least * (1 + 1e-6) + 1e-12
        there, turned = held_pose(chain, held, angles)
        assert left[0] == pytest.approx(np.linalg.norm(there - goal[0]), abs=1e-9)
        wanted = Rotation.from_quat(np.roll(goal[1], -1))
        off = (wanted * turned.inv()).magnitude()
        if axis:
            off = np.arccos(np.clip(turned.apply([0, 0, 1]) @ wanted.apply([0, 0, 1]), -1, 1))
        assert left[1] == pytest.approx(off, abs=1e-6)


def test_five_steps_are_enough_for_a_target_nearby():
    chain = make_chain(4, 11, seed=3)
    model = exact_model(chain)
    shown = 0.5 * postures(chain, 1, seed=4)[0]
    place, turn = held_pose(chain, GLASS, shown + 0.1)
    _, five, _ = run(model, GLASS, (place, wxyz(turn), True), shown, shown, steps=5)
    _, many, _ = run(model, GLASS, (place, wxyz(turn), True), shown, shown, steps=100)
    assert five == pytest.approx(many, abs=1e-5)


def test_an_axis_leaves_the_turn_about_itself_free():
    chain = Chain(("spin",), (0,), np.array([[0.0, 0.0, 1.0]]), np.zeros((1, 3)))
    model = exact_model(chain)
    begin, turned = np.zeros(1), wxyz(Rotation.from_rotvec([0, 0, 1.0]))
    angles, left, _ = run(model, HAND, ((0, 0, 0), turned, True), begin, begin, steps=10)
    assert angles[0] == 0
    assert left == (0, 0)
    angles, left, _ = run(model, HAND, ((0, 0, 0), turned, False), begin, begin, steps=10)
    # The least of (.2 (1 − q))² + (.02 q)²: q = .04 / .0404.
    assert angles[0] == pytest.approx(0.04 / 0.0404)
    assert left[1] == pytest.approx(1 - 0.04 / 0.0404)


def test_an_axis_that_points_the_other_way_is_half_a_turn_off():
    chain = Chain(("tip",), (0,), np.array([[1.0, 0.0, 0.0]]), np.zeros((1, 3)))
    model = exact_model(chain, widest=3.14)
    begin, upside_down = np.zeros(1), wxyz(Rotation.from_rotvec([np.pi, 0, 0]))
    _, left, _ = run(model, HAND, ((0, 0, 0), upside_down, True), begin, begin, steps=0)
    assert left[1] == pytest.approx(np.pi)
    angles, left, _ = run(model, HAND, ((0, 0, 0), upside_down, True), begin, begin + 0.1, steps=30)
    assert abs(angles[0]) == pytest.approx(0.04 / 0.0404 * np.pi)


def test_ends_are_kept_and_other_joints_stay():
    chain = make_chain(5, 6, seed=3)
    model = exact_model(chain, widest=0.4)
    begin = np.linspace(-0.9, 0.9, 6)  # beyond the ends too
    place, turn = chain.pose(np.full(6, 1.1))
    goal = (place, wxyz(turn), False)
    angles, _, _ = run(model, HAND, goal, begin, begin, steps=30)
    cost, least = cost_and_least(chain, HAND, goal, begin, angles, widest=0.4)
    assert cost <= least * (1 + 1e-6)
    for joint in range(6):
        if joint in chain.moving:
            assert abs(angles[joint]) <= 0.4
        else:
            assert angles[joint] == begin[joint]
    assert (np.abs(angles[list(chain.moving)]) == 0.4).any()


def test_the_same_call_gives_the_same_bytes():
    chain = make_chain(4, 5, seed=3)
    model = exact_model(chain)
    shown, begin, aim = postures(chain, 3, seed=4)
    goal = (chain.pose(aim)[0], wxyz(chain.pose(aim)[1]), False)
    first = run(model, HAND, goal, shown, begin, steps=8)
    arrays, angles = model.arrays(), begin.copy()
    work = make_work(arrays)
    for array in work:
        array.fill(7)  # what lies in the memory does not matter
    reach(
        arrays, angles, shown, *HAND, tuple(map(float, goal[0])), tuple(map(float, goal[1])), False,
        (TURN_WEIGHT, POSTURE_WEIGHT, 8), work,
    )  # fmt: skip
    assert angles.tobytes() == first[0].tobytes()


def test_kernels_call_them():
    @njit
    def both(arrays, angles, axis, weights, work):
        place, turn = pose_at(arrays, angles)
        shown = angles.copy()
        return reach(arrays, angles, shown, HAND[0], HAND[1], place, turn, axis, weights, work)

    chain = make_chain(2, 2)
    arrays = exact_model(chain).arrays()
    distance, off = both(arrays, np.zeros(2), True, (0.1, 0.1, 3), make_work(arrays))
    assert distance == pytest.approx(0, abs=1e-12)
    assert off == pytest.approx(0, abs=1e-7)
