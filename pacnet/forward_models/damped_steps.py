"""Steps of damped least squares within a range, for the kernel `reach`."""

from __future__ import annotations

import math

from numba import njit


@njit
def cost_of(arrays, angles, shown, pull, work):
    """Return the sum that is made least, from the error that was measured."""
    cost = 0.0
    for k in range(6):
        cost += work.error[k] * work.error[k]
    for joint in arrays.moving:
        cost += pull * (angles[joint] - shown[joint]) ** 2
    return cost


@njit
def linearise(arrays, angles, shown, pull, work):
    """Write half the cost's gradient, and its curvature by Gauss and Newton; return the cost."""
    joints = len(arrays.moving)
    for a in range(joints):
        for b in range(a + 1):
            dot = 0.0
            for k in range(6):
                dot += work.slopes[a, k] * work.slopes[b, k]
            work.normal[a, b] = dot
        work.normal[a, a] += pull
        joint = arrays.moving[a]
        work.gradient[a] = pull * (angles[joint] - shown[joint])
        for k in range(6):
            work.gradient[a] += work.slopes[a, k] * work.error[k]
    return cost_of(arrays, angles, shown, pull, work)


@njit
def try_step(arrays, angles, damping, work):
    """Write the posture to try, within the range; return the longest way of a joint [rad]."""
    joints = len(arrays.moving)
    trace = 0.0
    for a in range(joints):
        trace += work.normal[a, a]
    _factorise(arrays, angles, damping * trace / joints + 1e-300, work)
    _substitute(work)
    longest = 0.0
    for a in range(joints):
        joint = arrays.moving[a]
        to = angles[joint] + work.step[a]
        to = min(max(to, arrays.lowest[joint]), arrays.highest[joint])
        work.trial[joint] = to
        longest = max(longest, abs(to - angles[joint]))
    return longest


@njit
def _factorise(arrays, angles, damping, work):
    """Write the damped Cholesky factor; a joint at its end that would go on there is not free."""
    factor = work.factor
    for a in range(len(arrays.moving)):
        joint, slope = arrays.moving[a], work.gradient[a]
        low, high = angles[joint] <= arrays.lowest[joint], angles[joint] >= arrays.highest[joint]
        work.free[a] = not (low and slope >= 0) and not (high and slope <= 0)
        for b in range(a + 1):
            value = work.normal[a, b] if work.free[a] and work.free[b] else 0.0
            for k in range(b):
                value -= factor[a, k] * factor[b, k]
            if a == b:
                factor[a, a] = math.sqrt(max(value + damping, 1e-300))
            else:
                factor[a, b] = value / factor[b, b]


@njit
def _substitute(work):
    """Write the step that the factor gives for the gradient."""
    factor, step, joints = work.factor, work.step, len(work.step)
    for a in range(joints):
        value = -work.gradient[a] if work.free[a] else 0.0
        for b in range(a):
            value -= factor[a, b] * step[b]
        step[a] = value / factor[a, a]
    for a in range(joints - 1, -1, -1):
        for b in range(a + 1, joints):
            step[a] -= factor[b, a] * step[b]
        step[a] /= factor[a, a]
