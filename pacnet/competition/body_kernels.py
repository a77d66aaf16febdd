"""Kernels that follow motor schemas with a body: postures that take a hand where it is to be.

What is to be at a place is the hand, or what it carries: the hold is measured while it is carried.
The posture is the one nearest to the one that was shown.
"""

from __future__ import annotations

from numba import njit

from pacnet.competition.framed_kernels import UNTURNED, advance, faded_turn, left_of, vector
from pacnet.forward_models.kinematic_kernels import pose_at, reach
from pacnet.forward_models.turn_kernels import unit
from pacnet.kernels.caching import cached_njit
from pacnet.kernels.turns import (
    inverse,
    minus,
    multiply,
    norm,
    plus,
    rotate,
    turn_of,
    vector_of,
)
from pacnet.schemas.scene import WORLD
from pacnet.schemas.segments import NO_SEGMENT

ANEW = 5  # times as many steps to find a posture that is not near the last one
AT = 0.1  # share of the scene's size within which the hand is at a landmark
FARTHER = 1.5  # times as far from it as was shown, it is at it too
NOWHERE = (0.0, 0.0, 0.0)


@cached_njit(nogil=True)
def follow_with_body(
    places, turns, others, segments, allowed, state, settings, body, hold, action
):  # fmt: skip
    """Follow a motor schema for one more percept, and write the action.

    Args:
        places: of all points, `[P, 3]`.
        turns: `[P, 4]`.
        others: `[Q]`.
        segments: `Segments`.
        allowed: whether each segment may be followed, bool `[S]`.
        state: `FramedState`, which changes; without a segment afterwards if there is none.
        settings: `FramedSettings`.
        body: `Body`.
        hold: `Hold`, which changes.
        action: where to write, `[U]`.
    """
    advance(places, turns, others, segments, allowed, state, settings)
    hold.miss[:] = 0.0
    segment, row = state.segment[0], state.row[0]
    if segment == NO_SEGMENT:
        return
    is_first, is_new = hold.segment[0] == NO_SEGMENT, hold.segment[0] != segment
    anew = is_first or state.pauses[0]  # the posture that was found last may lead nowhere
    _locate(is_first, segments, settings, state, hold)
    hold.segment[0] = segment
    _grasp(segments, state, hold)
    if segments.landmark[segment] != WORLD:
        _look_ahead(is_new or anew, segments, state, body, hold)
    _show(row, segments, body, hold.shown)
    for j in range(len(body.commands)):
        if anew or not body.moves[j]:
            hold.posture[j] = hold.shown[j]
    left = left_of(segments.share[row], state.begun[0])
    _reach(row, left, segments, state, body, hold, hold.posture, hold.off)
    action[:] = segments.action[row]
    for j in range(len(body.commands)):
        action[body.commands[j]] = hold.posture[j]


@njit
def _look_ahead(anew, segments, state, body, hold):
    """Write by how much the hand would be off at the end of the segment."""
    last = segments.end[state.segment[0]] - 1
    _show(last, segments, body, hold.shown)
    if anew:
        hold.ahead[:] = hold.shown
    for _ in range(ANEW if anew else 1):
        _reach(last, 0.0, segments, state, body, hold, hold.ahead, hold.miss)


@njit
def _locate(is_first, segments, settings, state, hold):
    """Take in where landmarks are, unless the hand is at them: then they may move with it.

    A hand that is led by what it holds itself would never stop. An object may be held far from its
    middle, as it was shown at the end of the way to it.
    """
    segment, hand = state.segment[0], vector_of(state.places, 0)
    mark = segments.landmark[segment] + 1
    shown = norm(vector_of(segments.place, segments.end[segment] - 1))
    for i in range(len(hold.places)):
        apart = norm(minus(vector_of(state.places, i), hand))
        at = AT * settings.extent
        if i == mark and segments.moved[segment] == 0:
            at = max(at, FARTHER * shown)
        if not is_first and apart <= at:
            continue
        hold.places[i] = state.places[i]
        share = 1.0 if is_first else settings.smoothing[i, 0]
        turn = _alike(hold.axes, i, turn_of(state.turns, i))
        for k in range(4):
            hold.axes[i, k] += share * (turn[k] - hold.axes[i, k])


@njit
def _alike(rows, i, turn):
    """Return a quaternion, or the opposite one, which is the same turn: the nearer one to a row."""
    alike = 0.0
    for k in range(4):
        alike += rows[i, k] * turn[k]
    return turn if alike >= 0 else (-turn[0], -turn[1], -turn[2], -turn[3])


@njit
def _show(row, segments, body, posture):
    """Write the posture that was commanded in a row."""
    for j in range(len(body.commands)):
        posture[j] = segments.action[row, body.commands[j]]


@njit
def _grasp(segments, state, hold):
    """Take the mean of how the hand holds what it carries, since it took it."""
    moved, turned = segments.moved[state.segment[0]], segments.turned[state.segment[0]]
    if moved != hold.moved[0]:
        hold.moved[0], hold.frames[0] = moved, 0
        hold.place[:] = 0.0
        hold.turns[:] = 0.0
    if moved == 0:
        return
    hold.frames[0] += 1
    back = inverse(turn_of(state.turns, 0))
    place = rotate(back, minus(vector_of(state.places, moved), vector_of(state.places, 0)))
    turn = _alike(hold.turns, 0, multiply(back, turn_of(state.turns, turned)))
    for k in range(3):
        hold.place[k] += (place[k] - hold.place[k]) / hold.frames[0]
    for k in range(4):
        hold.turns[0, k] += turn[k]


@njit
def _reach(row, left, segments, state, body, hold, posture, off):
    """Write the posture for a row of the present segment, and by how much it is off.

    Args:
        row: of the segment.
        left: share that is left of the offset at its beginning.
        segments: `Segments`.
        state: `FramedState`.
        body: `Body`.
        hold: `Hold`; its posture shown is the one to stay near to.
        posture: where to begin, and to write, `[J]`.
        off: where to write by how much it is off, `[4]`.
    """
    segment = state.segment[0]
    landmark = segments.landmark[segment]
    origin, axes = NOWHERE, UNTURNED
    if landmark != WORLD:
        origin, axes = vector_of(hold.places, landmark + 1), unit(turn_of(hold.axes, landmark + 1))
    seen = plus(vector_of(segments.goal, row), vector(state.offset), left)
    place = plus(origin, rotate(axes, seen), 1.0)
    faded = faded_turn(state, left)
    turn = multiply(axes, multiply(faded, turn_of(segments.goal_turn, row)))
    held, held_turn, axis, weights = NOWHERE, UNTURNED, False, body.free
    if hold.moved[0] != 0:
        held, held_turn = vector(hold.place), unit(turn_of(hold.turns, 0))
        axis = segments.about_axis[segment]
        weights = body.carrying if segments.turned[segment] != 0 else body.free
    _, turned = reach(
        body.kinematics, posture, hold.shown, held, held_turn, place, turn, axis, weights, body.work
    )  # fmt: skip
    hand, hand_turn = pose_at(body.kinematics, posture)
    short = minus(place, plus(hand, rotate(hand_turn, held), 1.0))
    for k in range(3):
        off[k] = short[k]
    off[3] = turned
