"""The choice among candidates as machine code: what `MLPForwardModel.command` does, for one state.

`command` in torch is the specification; the two part only where float32 rounding decides. The
network runs for LANES candidates side by side, one in each lane of a vector register, so that a
layer is nothing but sums of weight × vector. Rows of numbers have LANES columns, one for each
candidate, and lie one after the other.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numba import njit

from pacnet.engine import announce_compilation
from pacnet.lanes import add_product, fill, load, silu, store
from pacnet.pointers import doubles, floats, integers

announce_compilation()

ABSTAINED, UNDECIDED = -1, -2  # instead of the number of a candidate

LANES = 32  # two registers of AVX-512, four of AVX: more sums at a time hide how long each takes

# What only kernels call compiles faster without the ways into it from Python and C.
_PART: Any = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}


class Model(NamedTuple):
    """The model, borrowed: pointers to its buffers, in the order of the table, and sizes."""

    candidates: Any  # float32 [K * U]
    action_mean: Any  # float64 [U]
    action_std: Any  # float64 [U]
    state_mean: Any  # float64 [S]; and so on
    state_std: Any
    change_mean: Any
    change_std: Any
    state_low: Any
    state_high: Any
    weights: Any  # int64, addresses of each layer's weight and bias
    widths: Any  # int64, of the inputs and of each layer
    layers: int
    number: int  # K
    actions: int  # U
    states: int  # S


BUFFERS = Model._fields[:9]
_BUFFERS = len(BUFFERS)


@njit(**_PART)
def _model_at(table, layers, states):
    """What lies where `pacnet.compiled_mlp` says."""
    sizes = _BUFFERS + 2 * layers
    return Model(
        candidates=floats(table[0]),
        action_mean=doubles(table[1]),
        action_std=doubles(table[2]),
        state_mean=doubles(table[3]),
        state_std=doubles(table[4]),
        change_mean=doubles(table[5]),
        change_std=doubles(table[6]),
        state_low=doubles(table[7]),
        state_high=doubles(table[8]),
        weights=integers(table.ctypes.data + 8 * _BUFFERS),
        widths=integers(table.ctypes.data + 8 * (sizes + 1)),
        layers=layers,
        number=table[sizes],
        actions=table[sizes + 1] - states,
        states=states,
    )


@njit(cache=True, nogil=True, error_model="numpy")
def choose(state, target, table, layers, steps, abstain_below):
    """Number of the candidate that leads nearest to the target, or ABSTAINED, or UNDECIDED.

    Args:
        state: float32 `[S]`.
        target: float32 `[S]`.
        table: int64; the addresses of the buffers in the order of `BUFFERS` and of each layer's
            weight and bias; the number of candidates; widths of the inputs and of each layer.
        layers: their number.
        steps: for which an action is held.
        abstain_below: spread under which it abstains.
    """
    for d in range(state.size):
        if not np.isfinite(state[d]):  # of a target that is not, no distance is finite
            return UNDECIDED
    model = _model_at(table, layers, state.size)
    widest = 0
    for layer in range(layers):
        widest = max(widest, model.widths[layer + 1])
    inputs = np.empty(model.widths[0] * LANES, np.float32)
    hidden = np.empty(2 * widest * LANES, np.float32)
    blocks = (model.number + LANES - 1) // LANES
    predicted = np.empty(blocks * model.states * LANES, np.float32)
    _predict(state, model, steps, inputs, hidden, predicted)
    return _nearest(predicted, target, model, abstain_below)


@njit(error_model="numpy", **_PART)
def _predict(state, model, steps, inputs, hidden, predicted):
    """Writes the states to which the candidates lead, a block of LANES after the other."""
    rows, room = floats(inputs.ctypes.data), floats(hidden.ctypes.data)
    other = floats(hidden.ctypes.data + 2 * hidden.size)  # its second half
    for first in range(0, model.number, LANES):
        states = floats(predicted.ctypes.data + 4 * first * model.states)
        _begin(state, model, first, states, rows)
        for _ in range(steps):
            _lead_on(states, model, rows, room, other)


@njit(error_model="numpy", **_PART)
def _begin(state, model, first, states, inputs):
    """Lays out the state, and a block of candidates, normalised in float64 and then rounded."""
    for d in range(model.states):
        for i in range(d * LANES, (d + 1) * LANES):
            states[i] = state[d]
    for d in range(model.actions):
        mean, std = model.action_mean[d], model.action_std[d]
        for lane in range(LANES):
            candidate = min(first + lane, model.number - 1)  # the last one to the end
            action = model.candidates[candidate * model.actions + d]
            inputs[(model.states + d) * LANES + lane] = (action - mean) / std


@njit(error_model="numpy", **_PART)
def _lead_on(states, model, inputs, room, other):
    """One step of `MLPForwardModel._after`, in place; the rows of `inputs` end with the actions."""
    for d in range(model.states):
        mean, std = model.state_mean[d], model.state_std[d]
        for i in range(d * LANES, (d + 1) * LANES):
            inputs[i] = (states[i] - mean) / std
    rows = inputs
    for layer in range(model.layers):
        _linear(rows, model, layer, room)
        if layer + 1 < model.layers:
            for at in range(0, model.widths[layer + 1] * LANES, LANES):
                store(room, at, silu(load(room, at, LANES)))
        rows, room, other = room, other, room
    for d in range(model.states):
        mean, std = model.change_mean[d], model.change_std[d]
        low, high = np.float32(model.state_low[d]), np.float32(model.state_high[d])
        for i in range(d * LANES, (d + 1) * LANES):
            after = states[i] + np.float32(rows[i] * std + mean)
            after = low if after < low else after
            states[i] = high if after > high else after


@njit(**_PART)
def _linear(rows, model, layer, outputs):
    """A row of outputs for each bias; four at a time, for which an input is loaded once."""
    weight, bias = floats(model.weights[2 * layer]), floats(model.weights[2 * layer + 1])
    inputs, size = model.widths[layer], model.widths[layer + 1]
    whole = size // 4 * 4
    for o in range(0, whole, 4):
        at0, at1, at2, at3 = o * inputs, (o + 1) * inputs, (o + 2) * inputs, (o + 3) * inputs
        sum0, sum1 = fill(bias, o, LANES), fill(bias, o + 1, LANES)
        sum2, sum3 = fill(bias, o + 2, LANES), fill(bias, o + 3, LANES)
        for i in range(inputs):
            lanes = load(rows, i * LANES, LANES)
            sum0 = add_product(sum0, fill(weight, at0 + i, LANES), lanes)
            sum1 = add_product(sum1, fill(weight, at1 + i, LANES), lanes)
            sum2 = add_product(sum2, fill(weight, at2 + i, LANES), lanes)
            sum3 = add_product(sum3, fill(weight, at3 + i, LANES), lanes)
        store(outputs, o * LANES, sum0)
        store(outputs, (o + 1) * LANES, sum1)
        store(outputs, (o + 2) * LANES, sum2)
        store(outputs, (o + 3) * LANES, sum3)
    for o in range(whole, size):
        total = fill(bias, o, LANES)
        for i in range(inputs):
            weights = fill(weight, o * inputs + i, LANES)
            total = add_product(total, weights, load(rows, i * LANES, LANES))
        store(outputs, o * LANES, total)


@njit(error_model="numpy", **_PART)
def _nearest(predicted, target, model, abstain_below):
    """The choice among predicted states, block by block; see `pacnet.candidates`."""
    best, least, spread = 0, np.float32(np.inf), np.float32(0)
    for k in range(model.number):
        squared = np.float32(0)
        for d in range(model.states):
            apart = predicted[_place(model, k, d)] - target[d]
            squared += apart * apart
        distance = np.sqrt(squared)
        if not np.isfinite(distance):
            return UNDECIDED
        if distance < least:
            best, least = k, distance
    for d in range(model.states):
        mean = np.float32(0)
        for k in range(model.number):
            mean += predicted[_place(model, k, d)]
        mean /= np.float32(model.number)
        for k in range(model.number):
            apart = predicted[_place(model, k, d)] - mean
            spread += apart * apart
    spread = np.sqrt(spread / np.float32(model.number))
    return ABSTAINED if spread < np.float32(abstain_below) else best


@njit(**_PART)
def _place(model, k, d):
    """Where number d of candidate k lies."""
    return (k // LANES * model.states + d) * LANES + k % LANES
