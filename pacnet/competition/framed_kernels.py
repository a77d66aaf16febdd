"""Kernels that follow motor schemas in the frames of their landmarks.

Nothing is checked here: `pacnet.competition.framed_following` passes arrays that agree. Numbers of
frames are in `FramedSettings`, distances in shares of the scene's size.
"""

from __future__ import annotations

import math

from numba import njit

from pacnet.kernels.caching import cached_njit
from pacnet.kernels.turns import (
    from_vector,
    inverse,
    minus,
    multiply,
    norm,
    plus,
    rotate,
    to_vector,
    turn_of,
    vector_of,
)
from pacnet.schemas.chains import ANY_LEG, GOES_ON
from pacnet.schemas.layout_kernels import layout_at
from pacnet.schemas.scene import WORLD
from pacnet.schemas.segments import NO_SEGMENT

FADE = 0.6  # share of a segment's path along which its offset fades
FLOOR = 0.01  # that the moved point may be off in any case
OTHER = 0.3  # of its range: what is no point may be off, such as a gripper's opening
PROGRESS = 0.1  # of what they may be off: less than this nearer is no progress
LEAST_SPREAD = 0.02  # of a layout's feature over demonstrations
MOVED = 0.05  # distance from where a point is expected, above which it was moved
HELD = 0.4  # distance within which what moves is held
LOST = 0.15  # by how much what is held is elsewhere when it is lost
TOGETHER = 0.6  # share of their distance that is left of landmarks that are brought together
UNDONE = 0.05  # by how much farther apart they are when that has failed
ANY = -2  # in place of a landmark
NOTHING = 1e300
UNTURNED = (1.0, 0.0, 0.0, 0.0)


@cached_njit(nogil=True)
def follow(places, turns, others, segments, allowed, state, settings, model, action):
    """Follow a motor schema for one more percept, and write the action.

    Args:
        places: of all points, `[P, 3]`.
        turns: `[P, 4]`.
        others: `[Q]`.
        segments: `Segments`.
        allowed: whether each segment may be followed, bool `[S]`.
        state: `FramedState`, which changes; without a segment afterwards if there is none.
        settings: `FramedSettings`.
        model: `AffineArrays`, with the range of actions relative to places.
        action: where to write, `[U]`.
    """
    advance(places, turns, others, segments, allowed, state, settings)
    if state.segment[0] != NO_SEGMENT:
        _act(segments, settings, state, model, action)


@njit
def advance(places, turns, others, segments, allowed, state, settings):
    """Take in one more percept: choose a motor schema, or go on in it; arguments of `follow`.

    Whoever pauses stays at the place in the sequence, however long that takes.
    """
    _look(places, turns, settings, state)
    if state.pauses[0] and state.segment[0] != NO_SEGMENT:
        return
    if state.segment[0] == NO_SEGMENT:
        _choose(0, ANY, others, segments, allowed, settings.extent, state)
        if state.segment[0] == NO_SEGMENT:
            _choose(ANY_LEG, ANY, others, segments, allowed, settings.extent, state)
    else:
        lost = _lost(segments, settings.extent, state)
        if lost == NO_SEGMENT:
            _go_on(others, segments, allowed, settings, state)
        else:  # what was held is picked up again
            leg, landmark = segments.leg[lost], segments.landmark[lost]
            _choose(leg, landmark, others, segments, allowed, settings.extent, state)


@njit
def _look(places, turns, settings, state):
    """Take in where the points are, smoothed; what is suddenly elsewhere was moved."""
    first = state.seen[0] == 0
    state.seen[0] += 1
    for i in range(len(places)):
        alpha, beta = max(settings.smoothing[i, 0], 1 / state.seen[0]), settings.smoothing[i, 1]
        expected = plus(vector_of(state.places, i), vector_of(state.speeds, i), 1.0)
        if norm(minus(vector_of(places, i), expected)) > MOVED * settings.extent:
            alpha, beta = 1.0, beta if i == 0 else 0.0  # a landmark was put elsewhere
        for k in range(3):
            expected = state.places[i, k] + state.speeds[i, k]
            apart = places[i, k] - expected
            state.places[i, k] = places[i, k] if first else expected + alpha * apart
            state.speeds[i, k] = 0.0 if first else state.speeds[i, k] + beta * apart
    change = to_vector(multiply(turn_of(turns, 0), inverse(turn_of(state.turns, 0))))
    for k in range(3):
        state.turning[k] = 0.0 if first else change[k]
    state.turns[:] = turns


# Which motor schema


@njit
def _choose(leg, landmark, others, segments, allowed, extent, state):
    """Begin the segment whose beginning looks most like the present scene, if there is any.

    Args:
        leg: its number, or `ANY_LEG`.
        landmark: of the segment; `ANY` at the beginning of an episode.
        others: `[Q]`.
        segments: `Segments`.
        allowed: bool `[S]`.
        extent: size of the scene.
        state: `FramedState`.
    """
    layout = state.layout
    layout_at(state.places, state.turns, others, extent, layout)
    usual = False
    for s in range(len(allowed)):
        state.candidate[s] = (
            allowed[s]
            and (landmark == ANY or segments.landmark[s] == landmark)
            and _is_leg(segments.leg[s], leg, landmark == ANY)
        )
        usual |= state.candidate[s] and segments.usual[s]
    for s in range(len(allowed)):
        state.candidate[s] &= segments.usual[s] or not usual
    _measure_spread(segments.layout, state)
    best, least = NO_SEGMENT, NOTHING
    for s in range(len(allowed)):
        if state.candidate[s]:
            apart = 0.0
            for k in range(len(layout)):
                apart += ((segments.layout[s, k] - layout[k]) / state.spread[k]) ** 2
            if apart < least:
                best, least = s, apart
    if best != NO_SEGMENT:
        _begin(best, segments.first[best], segments, state)


@njit
def _is_leg(own, leg, at_beginning):
    """Return whether a segment may be the leg that is wanted, by its own number."""
    if at_beginning or own == GOES_ON:
        return own == leg
    return own in (leg, ANY_LEG) or leg == ANY_LEG


@njit
def _measure_spread(layouts, state):
    """Write the standard deviation of each feature over the candidates, as far as it is large."""
    for k in range(layouts.shape[1]):
        count, mean, squares = 0, 0.0, 0.0
        for s in range(len(layouts)):
            if state.candidate[s]:  # Welford's updates: no difference of large numbers
                count += 1
                apart = layouts[s, k] - mean
                mean += apart / count
                squares += apart * (layouts[s, k] - mean)
        state.spread[k] = max(LEAST_SPREAD, math.sqrt(squares / max(1, count)))


@njit
def _begin(segment, row, segments, state):
    """Follow a segment from a row on, wherever the moved point is."""
    state.begun[0] = segments.share[row]
    state.segment[0], state.row[0], state.tries[0] = segment, row, 0
    place, turn = _here(segment, segments, state)
    apart = minus(place, vector_of(segments.place, row))
    turned = to_vector(multiply(turn, inverse(turn_of(segments.turn, row))))
    for k in range(3):
        state.offset[k], state.offset_turn[k] = apart[k], turned[k]


@njit
def _here(segment, segments, state):
    """Return where what is moved is, seen from the segment's landmark, and how it is turned."""
    place = vector_of(state.places, segments.moved[segment])
    turn = turn_of(state.turns, segments.turned[segment])
    mark = segments.landmark[segment] + 1
    if mark == WORLD + 1:
        return place, turn
    back = inverse(turn_of(state.turns, mark))
    return rotate(back, minus(place, vector_of(state.places, mark))), multiply(back, turn)


@njit
def _lost(segments, extent, state):
    """Return the segment in which was picked up what is no longer held; `NO_SEGMENT` if none."""
    segment, row = state.segment[0], state.row[0]
    mark = segments.landmark[segment]
    for m in range(segments.carried.shape[1]):
        if m == mark or not segments.carried[row, m]:
            continue
        hold = _between(segments.places[row], 0, m + 1)
        if norm(hold) < HELD * extent and _is_elsewhere(hold, m + 1, row, segments, extent, state):
            earlier = segment - 1
            for _ in range(segments.order[segment]):
                if segments.landmark[earlier] == m and segments.leg[earlier] != GOES_ON:
                    return earlier
                earlier -= 1
    return NO_SEGMENT


@njit
def _is_elsewhere(hold, point, row, segments, extent, state):
    """Return whether a point is not where it was held, turned as it is itself, or as the hand is.

    A point without an orientation that is grasped and then turned goes with the hand. How the
    landmark is turned that it is carried to says nothing: it was grasped before.
    """
    now, shown = _between(state.places, 0, point), segments.turns[row]
    for of in (point, 0):
        turn = multiply(turn_of(state.turns, of), inverse(turn_of(shown, of)))
        if norm(minus(now, rotate(turn, hold))) <= LOST * extent:
            return False
    return True


@njit
def _between(places, one, other):
    """Return the way from one point to another."""
    return minus(vector_of(places, other), vector_of(places, one))


@njit
def _axes(mark, state):
    """Return how a landmark is turned now."""
    return UNTURNED if mark == WORLD else turn_of(state.turns, mark + 1)


# Where in it


@njit
def _go_on(others, segments, allowed, settings, state):
    """Advance as far as the robot has come, to the next segment after the last frame."""
    segment, row = state.segment[0], state.row[0]
    last = segments.end[segment] - 1
    place, _ = _here(segment, segments, state)
    following = min(row + 1, last)
    off = _off(place, row, segments, state)
    nearer = _off(place, following, segments, state) < off
    other = _other_off(others, segments.others, row)
    allowance = _allowance(row, last, segments, settings, state)
    error = max(off / allowance, other / OTHER)
    if error <= 1:
        state.tries[0] = 0
        steps = 1
        if _off(place, min(row + 2, last), segments, state) < _off(
            place, following, segments, state
        ):
            steps = 2
    elif nearer and other <= OTHER:
        steps = 1
    else:
        steps = int(not _is_coming_nearer(error, state))
    _remember(error, state)
    if row + steps > last and row == last and segments.after[segment] != NO_SEGMENT:
        after = segments.after[segment]
        leg, landmark = segments.leg[after], segments.landmark[after]
        if leg == GOES_ON:
            _begin(after, segments.first[after], segments, state)
        else:
            _choose(leg, landmark, others, segments, allowed, settings.extent, state)
    elif row + steps > last and row == last and _is_undone(segment, segments, settings, state):
        _repeat(segment, others, segments, settings.extent, state)
    else:
        state.row[0] = min(row + steps, last)


# What is not as it was shown at the end


@njit
def _is_undone(segment, segments, settings, state):
    """Return whether two landmarks that were brought together in the demonstration are not now."""
    last = segments.end[segment] - 1
    first = segments.first[segment - segments.order[segment]]
    for i in range(1, len(state.places)):
        for j in range(1, i):
            begin = norm(_between(segments.places[first], j, i))
            end = norm(_between(segments.places[last], j, i))
            if end <= TOGETHER * begin and (
                norm(_between(state.places, j, i)) > end + UNDONE * settings.extent
            ):
                return True
    return False


@njit
def _repeat(segment, others, segments, extent, state):
    """Go on from the moment of the demonstration in which the scene was most like the present."""
    layout, shown = state.layout, state.spread
    layout_at(state.places, state.turns, others, extent, layout)
    best, moment, least = segment, segments.end[segment] - 1, NOTHING
    for s in range(segment - segments.order[segment], segment + 1):
        for row in range(segments.first[s], segments.end[s]):
            layout_at(
                segments.places[row], segments.turns[row], segments.others[row], extent, shown
            )
            apart = 0.0
            for k in range(len(layout)):
                apart += (layout[k] - shown[k]) ** 2
            if apart < least:
                best, moment, least = s, row, apart
    _begin(best, moment, segments, state)
    if best == segment:  # its offset has faded: to begin with it anew would be to stay off
        state.offset[:] = 0.0
        state.offset_turn[:] = 0.0


@njit
def _off(place, row, segments, state):
    """Return how far the moved point, seen from the landmark, is from where a row wants it."""
    left = left_of(segments.share[row], state.begun[0])
    wanted = plus(vector_of(segments.place, row), vector(state.offset), left)
    return norm(minus(place, wanted))


@njit
def vector(row):
    """Return the first three numbers of an array."""
    return row[0], row[1], row[2]


@njit
def left_of(share, begun):
    """Return the share of an offset that is left, since another share of the path."""
    return max(0.0, 1 - (share - begun) / max(1e-9, FADE * (1 - begun)))


@njit
def faded_turn(state, left):
    """Return the share that is left of the turn by which a segment was begun otherwise."""
    turn = state.offset_turn
    return from_vector((left * turn[0], left * turn[1], left * turn[2]))


@njit
def _other_off(others, shown, row):
    """Return the largest difference in what is no point, in shares of its range."""
    most = 0.0
    for k in range(len(others)):
        most = max(most, abs(others[k] - shown[row, k]))
    return most


@njit
def _allowance(row, last, segments, settings, state):
    """Return how far off the moved point may be: little where the demonstration is slow."""
    later = min(row + settings.lag, last)
    step = minus(vector_of(segments.place, later), vector_of(segments.place, row))
    begun = state.begun[0]
    fading = left_of(segments.share[later], begun) - left_of(segments.share[row], begun)
    return FLOOR * settings.extent + norm(plus(step, vector(state.offset), fading))


@njit
def _remember(error, state):
    """Keep the errors of the last frames at this place, a ring."""
    state.errors[state.tries[0] % len(state.errors)] = error
    state.tries[0] += 1


@njit
def _is_coming_nearer(error, state):
    """Return whether the error is less than some frames ago, or was not known then."""
    count = len(state.errors)
    if state.tries[0] < count:
        return True
    return error <= state.errors[state.tries[0] % count] - PROGRESS


# What to do


@njit
def _act(segments, settings, state, model, action):
    """Write the shown action, turned with the landmark, and corrected for what the pose is off."""
    segment, row = state.segment[0], state.row[0]
    last = segments.end[segment] - 1
    axes = _axes(segments.landmark[segment], state)
    place, turn = _here(segment, segments, state)
    later = left_of(segments.share[min(row + model.lead, last)], state.begun[0])
    wanted = plus(vector_of(segments.place, row), vector(state.offset), later)
    faded = faded_turn(state, later)
    turned = multiply(multiply(faded, turn_of(segments.turn, row)), inverse(turn))
    _write(state.error, rotate(axes, minus(wanted, place)), rotate(axes, to_vector(turned)))
    shown = segments.velocity[row]
    _write(
        state.velocity,
        minus(vector_of(state.speeds, 0), rotate(axes, (shown[0], shown[1], shown[2]))),
        minus(vector(state.turning), rotate(axes, (shown[3], shown[4], shown[5]))),
    )
    _turned_action(segments.action[row], axes, turn_of(segments.axes, row), settings, model, state)
    _correct(settings.pose, settings.trust, model, state, action)


@njit
def _write(six, first, second):
    for k in range(3):
        six[k], six[3 + k] = first[k], second[k]


@njit
def _turned_action(shown, now, then, settings, model, state):
    """Write the shown action, relative to the pose, as it is where the landmark is turned so."""
    relative = state.relative
    relative[:] = shown
    turn = multiply(now, inverse(then))
    if norm((turn[1], turn[2], turn[3])) < 1e-9:
        return
    six, pose = state.moved, settings.pose
    six[:] = 0.0
    for i in range(len(pose)):
        for j in range(len(shown)):
            six[pose[i]] += model.gain[i, j] * shown[j]
    place, spin = (six[0], six[1], six[2]), (six[3], six[4], six[5])
    _write(six, minus(rotate(turn, place), place), minus(rotate(turn, spin), spin))
    for j in range(len(shown)):
        for i in range(len(pose)):
            relative[j] += model.inverse[j, i] * six[pose[i]]


@njit
def _correct(pose, trust, model, state, action):
    """Write the action that also makes good what the pose is off, as far as actions were shown."""
    for j in range(len(action)):
        value = state.relative[j]
        for i in range(len(pose)):
            change = state.error[pose[i]]
            for k in range(len(pose)):
                change -= model.lag[i, k] * state.velocity[pose[k]]
            value += trust * model.inverse[j, i] * change
        value = min(max(value, model.lowest[j]), model.highest[j])
        if model.follows[j] >= 0:
            at = pose[model.follows[j]]
            value += state.places[0, at] if at < 3 else to_vector(turn_of(state.turns, 0))[at - 3]
        action[j] = value
