"""Kernels that follow demonstrations: where in each of them a robot is, and what it does.

Distances are squared and of scaled percepts. Nothing is checked here:
`pacnet.competition.following` passes arrays that agree.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from pacnet.kernels.caching import cached_njit
from pacnet.schemas.change_kernels import change_at

FOLLOWED = 16  # demonstrations that are followed at once
BLENDED = 5  # of them decide together
STIFFNESS = 2.0  # of time: what a frame too early or late costs, in usual steps
PULL = 0.5  # share of the difference from the expected time that is made good at once
CHANGE_WEIGHT = 0.3  # of the change beside the percept, in choosing what to follow
JUMP_CHANGE_WEIGHT = 0.1  # the same, in judging whether another moment fits better
JUMP = 0.3  # by how much another moment must fit better, on average, beyond what is no movement
LATE_START = 0.3  # what it costs to begin a demonstration in its middle
RETAINED = 0.6  # share of a deviation that a position target keeps; the rest is led back at once
SOFTNESS = 0.1  # mismatch, as a distance, that halves a weight
FAR = 3.0  # times as badly as the best must one fit to be left out of the blend
NOTHING = 1e300
NO_ONE = -1
_SUM = {"contract", "reassoc", "nsz"}  # sums in any order, so that they are vectorised


@cached_njit(nogil=True)
def follow(percept, shown, allowed, state, settings, correction, action):
    """Follow the demonstrations for one more percept, and write the action.

    Args:
        percept: scaled, `[D]`.
        shown: `Shown`.
        allowed: whether each demonstration may be followed, bool `[E]`.
        state: `State`, which changes.
        settings: `Settings`.
        correction: `Correction`.
        action: where to write, `[U]`; unchanged if there is nothing to follow.
    """
    change_at(percept, state.kept, state.kept_count, settings.least, state.change)
    for k in range(len(percept)):
        state.change[k] *= settings.change_ratio[k]
    nearest = state.nearest[0]  # a candidate still, where a search is spread over steps
    state.distance[0] = (
        NOTHING if nearest == NO_ONE else _distance(percept, shown.percepts, nearest)
    )
    begins = state.steps[0] == 0
    for slot in range(FOLLOWED):
        if state.demonstration[slot] != NO_ONE:
            _go_on(percept, slot, shown, state, settings)
    every = 1 if begins else settings.every
    for number in range(state.steps[0] % every, len(shown.frames), every):
        if allowed[number]:
            _consider(percept, number, begins, shown, state, settings)
    state.steps[0] += 1
    _weigh(shown, state)
    _act(percept, shown, state, correction, action)


@njit
def _go_on(percept, slot, shown, state, settings):
    """Find the present moment of a followed demonstration, near where it is expected."""
    number = state.demonstration[slot]
    first, end, frames = shown.first[number], shown.first[number + 1], shown.frames[number]
    # Passing whole records to a function for each row would take longer than the distances.
    percepts, time, moved = shown.percepts, shown.time, state.moved[slot]
    expected = min(state.time[slot] + 1.0, frames - 1.0)
    stiffness = (STIFFNESS * shown.pace[number]) ** 2
    least, row, mismatch = NOTHING, state.row[slot], 0.0
    low = high = row
    while low > first and time[low - 1] >= expected - settings.window:
        low -= 1
    while high + 1 < end and time[high + 1] <= expected + settings.window:
        high += 1
    for candidate in range(low, high + 1):
        plain = _distance(percept, percepts, candidate)
        if plain < state.distance[0]:
            state.nearest[0], state.distance[0] = candidate, plain
        left = _share_left(frames - 1 - time[candidate], state.ahead[slot])
        apart = _moved_distance(percept, percepts, candidate, np.float32(left), moved)
        late = time[candidate] - expected
        if apart + stiffness * late * late < least:
            least, row, mismatch = apart + stiffness * late * late, candidate, apart
    state.row[slot] = row
    state.time[slot] = expected + PULL * (time[row] - expected)
    _judge(slot, row, mismatch + state.gone[slot], shown, state)


@njit
def _judge(slot, row, mismatch, shown, state):
    """Record how well the present moment of a demonstration fits."""
    change = _distance(state.change, shown.changes, row)
    state.mismatch[slot] = mismatch
    state.change_mismatch[slot] = change
    state.cost[slot] = mismatch + CHANGE_WEIGHT * change


@njit
def _share_left(frames, ahead):
    """Return the share of an offset that is left so many frames before the end."""
    return min(1.0, max(0.0, frames / ahead))


@njit(fastmath=_SUM)
def _moved_distance(percept, rows, row, left, moved):
    """Return the distance from a row, moved by what is left of an offset."""
    squared, here = np.float32(0), rows[row]
    for k in range(len(percept)):
        apart = percept[k] - here[k] - left * moved[k]
        squared += apart * apart
    return squared


@njit
def _consider(percept, number, begins, shown, state, settings):
    """Follow a demonstration, or another moment of it, if that fits better."""
    own, worst = NO_ONE, 0
    for slot in range(FOLLOWED):
        if state.demonstration[slot] == number:
            own = slot
        if state.cost[slot] > state.cost[worst]:
            worst = slot
    limit = state.cost[worst if own == NO_ONE else own]
    cost, row, jump = _best_moment(percept, number, begins, limit, shown, state, settings)
    if own == NO_ONE:
        if cost < limit:
            _begin(percept, worst, number, row, shown, state, settings)
        return
    present = state.mismatch[own] + JUMP_CHANGE_WEIGHT * state.change_mismatch[own]
    excess = max(0.0, present - jump)
    state.excess[own] += settings.jump_rate * (excess - state.excess[own])
    if state.excess[own] > JUMP + settings.least * settings.least and row != NO_ONE:
        _begin(percept, own, number, row, shown, state, settings)


@njit
def _best_moment(percept, number, begins, limit, shown, state, settings):
    """Return the cost and the row of the moment that fits best, and the least cost of a jump.

    What costs more than the limit is left out, and boxes that are farther away than that.
    """
    cost, row, jump = limit, NO_ONE, NOTHING
    percepts, changes, low, high = shown.percepts, shown.changes, shown.low, shown.high
    for box in range(shown.box_of[number], shown.box_of[number + 1]):
        farthest = max(limit, state.distance[0])
        if _box_distance(percept, low, high, box) >= farthest:
            continue
        for candidate in range(shown.box_first[box], shown.box_first[box + 1]):
            apart = _distance(percept, percepts, candidate)
            if apart < state.distance[0]:
                state.nearest[0], state.distance[0] = candidate, apart
            if apart >= limit:
                continue
            change = _distance(state.change, changes, candidate)
            if begins and shown.time[candidate] > settings.late:
                apart += LATE_START
            jump = min(jump, apart + JUMP_CHANGE_WEIGHT * change)
            if apart + CHANGE_WEIGHT * change < cost:
                cost, row = apart + CHANGE_WEIGHT * change, candidate
    return cost, row, jump


@njit(fastmath=_SUM)
def _box_distance(percept, low, high, box):
    """Return the distance of a percept from a box."""
    squared, below, above = np.float32(0), low[box], high[box]
    for k in range(len(percept)):
        apart = max(below[k] - percept[k], percept[k] - above[k], np.float32(0))
        squared += apart * apart
    return squared


@njit(fastmath=_SUM)
def _distance(percept, rows, row):
    """Return the distance of a percept from a row."""
    squared, here = np.float32(0), rows[row]
    for k in range(len(percept)):
        apart = percept[k] - here[k]
        squared += apart * apart
    return squared


@njit
def _begin(percept, slot, number, row, shown, state, settings):
    """Follow a demonstration from this moment on."""
    state.demonstration[slot], state.row[slot] = number, row
    state.time[slot], state.excess[slot] = shown.time[row], 0.0
    state.ahead[slot] = max(1, shown.frames[number] - 1 - shown.time[row])
    mismatch = state.gone[slot] = 0.0
    for k in range(len(percept)):
        apart = percept[k] - shown.percepts[row, k]
        state.moved[slot, k] = apart if settings.follows[k] else np.float32(0)
        state.gone[slot] += state.moved[slot, k] ** 2
        mismatch += apart * apart
    _judge(slot, row, mismatch, shown, state)


@njit
def _weigh(shown, state):
    """Let the demonstrations that fit best decide together; write weights and progress."""
    state.weight[:] = 0.0
    state.heaviest[0], state.progress[0], total, nearest = NO_ONE, 0.0, 0.0, NOTHING
    for _ in range(BLENDED):
        best = _next_best(state)
        if best == NO_ONE:
            break
        apart, heaviest = math.sqrt(state.cost[best]) + SOFTNESS, state.heaviest[0]
        nearest = apart if heaviest == NO_ONE else nearest
        if apart > FAR * nearest:
            break
        state.weight[best] = 1 / (math.sqrt(state.mismatch[best]) + SOFTNESS)
        total += state.weight[best]
        if heaviest == NO_ONE or state.weight[best] > state.weight[heaviest]:
            state.heaviest[0] = best
    for slot in range(FOLLOWED):
        if state.weight[slot] > 0:
            state.weight[slot] /= total
            last = shown.frames[state.demonstration[slot]] - 1
            share = shown.time[state.row[slot]] / last if last > 0 else 1.0
            state.progress[0] += state.weight[slot] * share


@njit
def _next_best(state):
    """Return which of the demonstrations without a weight fits best."""
    best, least = NO_ONE, NOTHING
    for slot in range(FOLLOWED):
        if state.weight[slot] == 0 and state.cost[slot] < least:
            best, least = slot, state.cost[slot]
    return best


@njit
def _act(percept, shown, state, correction, action):
    """Write the mean action of the demonstrations that decide, each corrected for the deviation."""
    if state.heaviest[0] == NO_ONE:
        return
    action[:] = 0.0
    for slot in range(FOLLOWED):
        weight, row = state.weight[slot], state.row[slot]
        if weight == 0:
            continue
        ahead = shown.frames[state.demonstration[slot]] - 1 - shown.time[row]
        left = _share_left(ahead, state.ahead[slot])
        later = _share_left(ahead - correction.lead, state.ahead[slot])
        for j in range(len(action)):
            value, i = float(shown.targets[row, j]), correction.follows[j]
            if i != NO_ONE:
                offset = state.moved[slot, i]
                apart = percept[i] - shown.percepts[row, i]
                value += correction.unit[i] * (offset * later + RETAINED * (apart - offset * left))
            else:
                for k in range(len(percept)):
                    value += (percept[k] - shown.percepts[row, k]) * correction.gain[k, j]
            action[j] += weight * value


@cached_njit(nogil=True)
def nearest_rows(percepts, shown, allowed, nearest):
    """Write the rows that are nearest to each of an episode's percepts.

    Args:
        percepts: scaled, in order of time, `[T, D]`.
        shown: `Shown`.
        allowed: the demonstrations to search, bool `[E]`.
        nearest: where to write, int64 `[T, K]`, the nearest first; `NO_ONE` where there are fewer.
    """
    low, high, rows = shown.low, shown.high, shown.percepts
    apart, last = np.empty(nearest.shape[1]), nearest.shape[1] - 1
    for frame in range(len(percepts)):
        percept, found = percepts[frame], nearest[frame]
        apart[:], found[:] = NOTHING, NO_ONE
        if frame > 0:  # as many were found then, so none that is farther than all of these counts
            apart[last] = _farthest(percept, rows, nearest[frame - 1])
        for number in range(len(shown.frames)):
            if not allowed[number]:
                continue
            for box in range(shown.box_of[number], shown.box_of[number + 1]):
                if _box_distance(percept, low, high, box) < apart[last]:
                    for row in range(shown.box_first[box], shown.box_first[box + 1]):
                        _insert(row, float(_distance(percept, rows, row)), apart, found)


@njit
def _farthest(percept, rows, some):
    """Return a distance just beyond some rows; `NOTHING` if not all of them are there."""
    farthest = 0.0
    for row in some:
        apart = NOTHING if row == NO_ONE else float(_distance(percept, rows, row))
        farthest = max(farthest, apart)
    return farthest * 1.000001 + 1e-30  # boxes are rounded otherwise than distances


@njit
def _insert(row, distance, apart, found):
    """Insert a row into those found, in order of their distances, if it is among the nearest."""
    place = len(found) - 1
    if distance >= apart[place]:
        return
    while place > 0 and distance < apart[place - 1]:
        apart[place], found[place] = apart[place - 1], found[place - 1]
        place -= 1
    apart[place], found[place] = distance, row
