"""Compiled kernels: the choice among candidate actions, and a small network's predictions."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit

from pacnet.kernels.caching import cached_njit

LANES = 24  # candidates computed side by side, a multiple of the width of a vector register

_ENTRY: Any = {"nogil": True, "error_model": "numpy"}
# Functions that only kernels call compile faster without their wrappers for Python and C.
_PART: Any = {"error_model": "numpy", "no_cpython_wrapper": True, "no_cfunc_wrapper": True}
_FUSED = {"contract"}  # a product and a sum may be rounded once instead of twice

_LN2_HIGH = np.float32(355 / 512)  # few bits, so its product with a small integer is exact
_LN2_LOW = np.float32(math.log(2) - 355 / 512)
_PER_LN2 = np.float32(1 / math.log(2))
_TERMS = tuple(np.float32(1 / math.factorial(k)) for k in reversed(range(8)))  # Taylor series


@cached_njit(**_ENTRY)
def choose(after, target, abstain_below):
    """Choose the candidate whose predicted state is nearest (Euclidean) to a target.

    Ties go to the lowest index. Abstain if the spread is below the threshold, or if fewer than two
    candidates have a prediction (a single candidate needs one).

    Args:
        after: predicted states, float64 `[K, S]`; NaN without a prediction.
        target: float64 `[S]`.
        abstain_below: the threshold, in the state's unit.

    Returns:
        The index, −1 without any prediction; the costs `[K]`, infinite without a prediction; the
        spread, which is the root mean square distance from the mean; whether to abstain.
    """
    candidates, dimensions = after.shape
    costs = np.empty(candidates)
    best, least, known = -1, np.inf, 0
    for k in range(candidates):
        squared = 0.0
        for d in range(dimensions):
            difference = after[k, d] - target[d]
            squared += difference * difference
        costs[k] = np.inf
        if squared < np.inf:
            costs[k] = math.sqrt(squared)
            known += 1
        if costs[k] < least:
            best, least = k, costs[k]
    spread = _spread(after, costs, known)
    too_few = known < 2 and known < candidates
    return best, costs, spread, too_few or spread < abstain_below


@njit(**_PART)
def _spread(after, costs, known):
    """Return the root mean square distance of the known states from their mean."""
    total = 0.0
    for d in range(after.shape[1]):
        mean = 0.0
        for k in range(costs.size):
            if costs[k] < np.inf:
                mean += after[k, d] / known
        for k in range(costs.size):
            if costs[k] < np.inf:
                total += (after[k, d] - mean) * (after[k, d] - mean)
    return math.sqrt(total / known) if known > 0 else 0.0


@cached_njit(**_ENTRY)
def decide(candidates, normalisers, weights, biases, steps, abstain_below, state, target):
    """Predict the state after each candidate and `choose`; a state that is not finite has none.

    Args:
        candidates: float32 `[K, U]`.
        normalisers: float64; mean and std of states, actions and changes, lowest and highest state.
        weights: of each layer, float32 `[O, I]`.
        biases: of each layer, float32 `[O]`.
        steps: for which an action is held.
        abstain_below: the threshold.
        state: float32 `[S]`.
        target: float64 `[S]`.
    """
    dimensions = state.size
    after = np.empty((candidates.shape[0], dimensions))
    inputs = _lane_blocks(dimensions + candidates.shape[1])
    for first in range(0, candidates.shape[0], LANES):
        states = _prepare(state, candidates[first : first + LANES], normalisers, inputs)
        for _ in range(steps):
            _advance(states, inputs, normalisers, weights, biases)
        for lane in range(states.shape[1]):
            for d in range(dimensions):
                after[first + lane, d] = states[d, lane]
    return choose(after, target, abstain_below)


@njit(**_PART)
def _lane_blocks(rows):
    """Return zeros for at least so many rows, in blocks of four, each row with all lanes."""
    return np.zeros(((rows + 3) // 4, 4, LANES), np.float32)


@njit(**_PART)
def _prepare(state, candidates, normalisers, inputs):
    """Return the state in each lane; write the candidates, normalised, into the inputs."""
    action_mean, action_std = normalisers[2], normalisers[3]
    states = np.empty((state.size, candidates.shape[0]), np.float32)
    rows = inputs.reshape(-1, LANES)
    for lane in range(candidates.shape[0]):
        for d in range(state.size):
            states[d, lane] = state[d] if abs(state[d]) < np.inf else np.nan
        for d in range(candidates.shape[1]):
            rows[state.size + d, lane] = (candidates[lane, d] - action_mean[d]) / action_std[d]
    return states


@njit(fastmath=_FUSED, **_PART)
def _advance(states, inputs, normalisers, weights, biases):
    """Replace the states by those predicted for the next time step."""
    state_mean, state_std, _, _, mean, std, low, high = normalisers
    hidden, rows = inputs, inputs.reshape(-1, LANES)
    for d in range(states.shape[0]):
        for lane in range(states.shape[1]):
            rows[d, lane] = (states[d, lane] - state_mean[d]) / state_std[d]
    for layer in range(len(weights) - 1):
        hidden = _multiply(hidden, weights[layer])
        _activate(hidden.reshape(-1, LANES), biases[layer])
    rows, bias = _multiply(hidden, weights[-1]).reshape(-1, LANES), biases[-1]
    for d in range(states.shape[0]):
        lowest, highest = np.float32(low[d]), np.float32(high[d])
        for lane in range(states.shape[1]):
            change = (rows[d, lane] + bias[d]) * std[d] + mean[d]
            moved = states[d, lane] + np.float32(change)
            moved = lowest if moved < lowest else moved
            states[d, lane] = highest if moved > highest else moved


@njit(fastmath=_FUSED, **_PART)
def _multiply(inputs, weight):
    """Multiply blocks of inputs by a weight matrix, four by four, so that each is loaded less."""
    outputs = _lane_blocks(weight.shape[0])
    for p in range(outputs.shape[0]):
        for q in range(inputs.shape[0]):
            o, i, y, x = 4 * p, 4 * q, outputs[p], inputs[q]
            a, b = _four_weights(weight, o, i), _four_weights(weight, o + 1, i)
            c, d = _four_weights(weight, o + 2, i), _four_weights(weight, o + 3, i)
            for lane in range(LANES):
                values = x[0, lane], x[1, lane], x[2, lane], x[3, lane]
                y[0, lane] += _dot(a, values)
                y[1, lane] += _dot(b, values)
                y[2, lane] += _dot(c, values)
                y[3, lane] += _dot(d, values)
    return outputs


@njit(**_PART)
def _four_weights(weight, o, i):
    """Return four weights of an output: 0 beyond the last output, arbitrary beyond the last input.

    Beyond the last input the inputs are 0.
    """
    if o >= weight.shape[0]:
        return np.float32(0), np.float32(0), np.float32(0), np.float32(0)
    row, last = weight[o], weight.shape[1] - 1
    return row[i], row[min(i + 1, last)], row[min(i + 2, last)], row[min(i + 3, last)]


@njit(fastmath=_FUSED, **_PART)
def _dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3]


@njit(fastmath=_FUSED, **_PART)
def _activate(rows, bias):
    """Add the biases and apply SiLU, x / (1 + exp(−x)), in steps that vectorise over the lanes.

    exp(y) = 2ⁿ exp(r), |r| ≤ ln 2 / 2 (Cody & Waite, Software Manual, 1980), within 1 ulp; y is
    clamped to ±87, near the limits of float32.
    """
    for o in range(bias.size):
        for lane in range(LANES):
            x = rows[o, lane] + bias[o]
            y = min(max(-x, np.float32(-87)), np.float32(87))
            n = np.floor(y * _PER_LN2 + np.float32(0.5))
            r = y - n * _LN2_HIGH - n * _LN2_LOW
            series = _TERMS[0]
            for term in _TERMS[1:]:
                series = series * r + term
            power = np.int32((np.int32(n) + np.int32(127)) << np.int32(23)).view(np.float32)
            rows[o, lane] = x / (np.float32(1) + series * power)
