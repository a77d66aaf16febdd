"""Where a hand is in a posture, and the posture that takes it somewhere, for compiled callers.

Places are tuples of 3, turns unit quaternions w, x, y, z, as tuples of 4; see `pacnet.kernels`.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from pacnet.forward_models.damped_steps import cost_of, linearise, try_step
from pacnet.forward_models.kinematic_arrays import KinematicArrays, ReachWork
from pacnet.forward_models.turn_kernels import AXES, between, cross, dot, nearest_turn, spin_of
from pacnet.kernels.caching import cached_njit
from pacnet.kernels.turns import (
    inverse,
    minus,
    multiply,
    norm,
    plus,
    rotate,
    to_vector,
)

_DAMPING = 1e-3  # at first, in shares of the mean square of a joint's effect
_EASED, _RAISED = 0.1, 8.0  # its factors after a step that helped, and after one that did not
_STILL = 1e-10  # [rad]; a smaller step is none
_LEAST_DAMPING = 1e-12


def make_work(arrays: KinematicArrays) -> ReachWork:
    """Return memory for `reach`; each thread needs its own."""
    joints = len(arrays.moving)
    levels = np.zeros((3 ** (joints - 1), 1 + joints, 12))
    square, row = np.zeros((joints, joints)), np.zeros(joints)
    return ReachWork(
        levels, np.zeros(6), np.zeros((joints, 6)), square, square.copy(), row, row > 0, row.copy(),
        np.zeros(len(arrays.lowest)),
    )  # fmt: skip


@cached_njit(nogil=True)
def pose_at(arrays, angles):
    """Return where the hand is, in the unit that was fitted, and how it is turned.

    Args:
        arrays: of the model.
        angles: posture, `[J]` [rad].
    """
    products = np.ones(len(arrays.coefficients))
    size = 1
    for joint in arrays.moving:
        sine, cosine = math.sin(angles[joint]), math.cos(angles[joint])
        for i in range(size - 1, -1, -1):  # from the last, so that none is overwritten too soon
            value = products[i]
            products[3 * i] = value
            products[3 * i + 1], products[3 * i + 2] = value * sine, value * cosine
        size *= 3
    pose = np.zeros(12)
    for i in range(size):
        for k in range(12):
            pose[k] += products[i] * arrays.coefficients[i, k]
    return (pose[0], pose[1], pose[2]), nearest_turn(pose)


@cached_njit(nogil=True)
def poses_at(arrays, angles):
    """Return where the hand is in N postures `[N, J]` [rad]: place and quaternion, `[N, 7]`."""
    poses = np.empty((len(angles), 7))
    for row in range(len(angles)):
        place, turn = pose_at(arrays, angles[row])
        for k in range(3):
            poses[row, k] = place[k]
        for k in range(4):
            poses[row, 3 + k] = turn[k]
    return poses


@cached_njit(nogil=True)
def reach(
    arrays, angles, shown, held_place, held_turn, place, turn, axis, weights, work
):  # fmt: skip
    """Take what the hand holds to a place and a turn, by damped least squares (Levenberg).

    The sum of these is made least over the joints that move the hand, within the angles that were
    fitted: |p − place|², (w_t e)², where e is the angle between the turn and the one wanted, and
    (w_p |q − shown|)². The hand itself is held at (0, 0, 0) with the turn (1, 0, 0, 0).

    Args:
        arrays: of the model.
        angles: where to begin; overwritten by the posture found, `[J]` [rad].
        shown: posture to stay near, `[J]` [rad].
        held_place: of the thing, in the hand's frame.
        held_turn: of the thing, in the hand's frame.
        place: wanted of the thing.
        turn: wanted of the thing.
        axis: whether only the direction of its third axis counts, and not a turn about that.
        weights: w_t [unit/rad], w_p [unit/rad] and the number of steps, an integer.
        work: of `make_work`.

    Returns:
        The distance that is left, and the angle [rad].
    """
    goal = (held_place, held_turn, place, turn, axis, weights[0])
    pull = weights[1] * weights[1]
    for joint in arrays.moving:
        angles[joint] = min(max(angles[joint], arrays.lowest[joint]), arrays.highest[joint])
    work.trial[:] = angles
    distance, off = _measure(arrays, angles, goal, work)
    cost = linearise(arrays, angles, shown, pull, work)
    damping = _DAMPING
    for _ in range(weights[2]):
        if try_step(arrays, angles, damping, work) < _STILL:
            break
        new_distance, new_off = _measure(arrays, work.trial, goal, work)
        if cost_of(arrays, work.trial, shown, pull, work) < cost:
            damping = max(damping * _EASED, _LEAST_DAMPING)
            distance, off = new_distance, new_off
            angles[:] = work.trial
            cost = linearise(arrays, angles, shown, pull, work)
        else:
            damping *= _RAISED
    return distance, off


@njit
def _measure(arrays, angles, goal, work):
    """Write the error in a posture and its slopes; return the distance and the angle left."""
    held_place, held_turn, place, turn, axis, turn_weight = goal
    _evaluate(arrays, angles, work.levels)
    pose = work.levels[0, 0]
    hand = nearest_turn(pose)
    lever = rotate(hand, held_place)
    left = minus(plus((pose[0], pose[1], pose[2]), lever, 1.0), place)
    now = multiply(hand, held_turn)
    third = rotate(now, AXES[2])
    whole = to_vector(multiply(turn, inverse(now)))
    way = between(third, rotate(turn, AXES[2])) if axis else whole
    for k in range(3):
        work.error[k] = left[k]
        work.error[3 + k] = -turn_weight * way[k]
    for j in range(len(arrays.moving)):
        slope = work.levels[0, 1 + j]
        spin = spin_of(slope, hand)
        swing = cross(spin, lever)
        if axis:  # a turn about the axis itself changes nothing
            spin = plus(spin, third, -dot(spin, third))
        for k in range(3):
            work.slopes[j, k] = slope[k] + swing[k]
            work.slopes[j, 3 + k] = turn_weight * spin[k]
    return norm(left), norm(way)


@njit
def _evaluate(arrays, angles, levels):
    """Write the pose in a posture and its slope in each joint into the first row of levels.

    Products share their factors: first, those that differ in the last joint alone are added up. A
    slope has 0, cos q, −sin q in place of 1, sin q, cos q.
    """
    joints, size = len(arrays.moving), len(arrays.coefficients)
    for j in range(joints - 1, -1, -1):
        angle = angles[arrays.moving[j]]
        sine, cosine = math.sin(angle), math.cos(angle)
        size //= 3
        if j == joints - 1:
            _add_up(arrays.coefficients, size, sine, cosine, levels[:, 0], levels[:, 1 + j])
            continue
        _add_up(levels[:, 0], size, sine, cosine, levels[:, 0], levels[:, 1 + j])
        for later in range(j + 2, joints + 1):
            _add_up_values(levels[:, later], size, sine, cosine)


@njit
def _add_up(rows, size, sine, cosine, values, slopes):
    """Write sums of three rows each, which may be the same memory, and the sums' slopes."""
    for i in range(size):
        for k in range(12):
            one, of_sine, of_cosine = rows[3 * i, k], rows[3 * i + 1, k], rows[3 * i + 2, k]
            values[i, k] = one + of_sine * sine + of_cosine * cosine
            slopes[i, k] = of_sine * cosine - of_cosine * sine


@njit
def _add_up_values(rows, size, sine, cosine):
    """Add up three rows each, in place."""
    for i in range(size):
        for k in range(12):
            rows[i, k] = rows[3 * i, k] + rows[3 * i + 1, k] * sine + rows[3 * i + 2, k] * cosine
