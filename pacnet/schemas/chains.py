"""The parts of an episode, one after the other, and which episodes are usual ones of their task.

Demonstrations are cut where time is missing. What such a gap parts is a chain: its segments follow
one another as if nothing were missing. A chain is a series of legs, each to another landmark.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pacnet.schemas.demonstration_memory import Shown
from pacnet.schemas.scene import WORLD
from pacnet.schemas.segments import CONTINUES, MIDDLE, NO_SEGMENT

Array = NDArray[np.float64]
Numbers = NDArray[np.int64]
Way = tuple[int, ...]

GOES_ON = -1
"""In place of a leg's number: the segment goes on after a gap with the leg before it."""
ANY_LEG = -2
"""In place of a leg's number: the chain begins somewhere in the middle of its task."""

_ENOUGH = 3  # chains of a task from which the usual landmarks can be told
_RARER = 2  # how many times as many may end earlier than go on, and yet be cut off
_MISSED = 0.1  # share of the scene's size by which one that is cut off stays farther away


class Chains(NamedTuple):
    """Where each of S segments is in its chain."""

    chain: Numbers
    """Number of its chain, `[S]`."""
    order: Numbers
    """Its number in the chain, `[S]`."""
    leg: Numbers
    """Number of its leg in the chain, or `GOES_ON` or `ANY_LEG`, `[S]`."""
    task: Numbers
    """Of each of C chains, `[C]`."""
    is_whole: NDArray[np.bool_]
    """Whether a chain shows its task from the beginning, and is no correction, `[C]`."""


def in_chains(cuts: Mapping[str, Numbers], landmark: Numbers, shown: Shown) -> Chains:
    """Return where each segment is in its chain.

    Args:
        cuts: see `SegmentMemory.columns`.
        landmark: of each segment, `[S]`.
        shown: the demonstrations.
    """
    number, begins = cuts["demonstration"], cuts["begins"]
    index, is_first = np.arange(len(number)), np.diff(number, prepend=-1) != 0
    is_first &= begins != CONTINUES
    begin = np.maximum.accumulate(np.where(is_first, index, 0))
    goes_on = ~is_first & (np.diff(landmark, prepend=WORLD - 1) == 0)
    legs = (~goes_on).cumsum()
    leg = legs - legs[begin]
    leg[begins[begin] == MIDDLE] = ANY_LEG
    leg[goes_on] = GOES_ON
    of = number[is_first]
    is_whole = (begins[is_first] != MIDDLE) & ~shown.correction[of]
    chains = Chains(is_first.cumsum() - 1, index - begin, leg, shown.task[of], is_whole)
    return chains._replace(leg=np.where(_are_later(chains, landmark), ANY_LEG, leg))


def _are_later(chains: Chains, landmark: Numbers) -> NDArray[np.bool_]:
    """Return which segments begin legs of corrections that show only the end of their task, `[S]`.

    Recorded as an episode of its own, such a correction begins with that.
    """
    ways = _ways(chains, landmark)
    later = np.zeros(len(ways), bool)
    for index in np.flatnonzero(~chains.is_whole):
        alike = np.flatnonzero(chains.is_whole & (chains.task == chains.task[index]))
        way = ways[index]
        ends = [ways[one][-len(way) :] == way != ways[one] for one in alike]
        later[index] = any(ends) and way not in [ways[one] for one in alike]
    return later[chains.chain] & (chains.leg != GOES_ON)


def _ways(chains: Chains, landmark: Numbers) -> list[Way]:
    """Return the landmarks of each chain's legs, in order."""
    begins = np.flatnonzero(np.diff(chains.chain, prepend=-1))
    legs = [np.flatnonzero(part != GOES_ON) for part in np.split(chains.leg, begins[1:])]
    return [tuple(landmark[at + leg].tolist()) for at, leg in zip(begins, legs, strict=True)]


def after_gaps(cuts: Mapping[str, Numbers], rests: NDArray[np.bool_]) -> Numbers:
    """Return the landmark of each segment; what attention could not see before a gap is after it.

    Args:
        cuts: see `SegmentMemory.columns`.
        rests: whether each landmark rests in each segment, `[S, M]`.
    """
    landmark, number = cuts["landmark"].copy(), cuts["demonstration"]
    for one in range(len(landmark) - 2, -1, -1):
        later = landmark[one + 1]
        at_gap = number[one + 1] != number[one] and cuts["begins"][one + 1] == CONTINUES
        if at_gap and landmark[one] == WORLD != later and rests[one, later]:
            landmark[one] = later
    return landmark


def successors(chains: Chains, landmark: Numbers, usual: NDArray[np.bool_]) -> Numbers:
    """Return the segment after each one, `NO_SEGMENT` after the last one of a task, `[S]`.

    After a chain from the middle of a task comes what comes after its last landmark elsewhere.
    """
    index, task = np.arange(len(landmark)), chains.task[chains.chain]
    is_last = np.diff(chains.chain, append=-1) != 0
    after = np.where(is_last, NO_SEGMENT, index + 1)
    whole = chains.is_whole[chains.chain] & usual
    begin = index - chains.order
    for one in np.flatnonzero(is_last & (chains.leg[begin] == ANY_LEG)):
        reached = _reached(tuple(landmark[begin[one] : one + 1].tolist()))
        alike = whole & (task == task[one]) & (landmark == (reached or (WORLD,))[-1])
        if alike.any() and not (alike & is_last).any():
            legs = np.flatnonzero(alike)
            after[one] = legs[chains.leg[legs + 1] != GOES_ON][0] + 1
    return after


def usual_chains(
    chains: Chains, landmark: Numbers, distance: Array, extent: float
) -> NDArray[np.bool_]:
    """Return whether each chain goes where most of its task go, and to the end, `[C]`.

    One that goes back, since something failed, is left to the others, and so is one that is cut
    off. A correction, or what begins in the middle, is usual where it is needed.

    Args:
        chains: C of them.
        landmark: of each segment, `[S]`.
        distance: least one of the moved point from it in the segment, `[S]`.
        extent: size of the scene.
    """
    begins = np.flatnonzero(np.diff(chains.chain, prepend=-1))
    ways = _ways(chains, landmark)
    left = np.array([_left(part) for part in _parts(begins, landmark, distance)])
    usual = np.ones(len(ways), bool)
    for task in set(chains.task.tolist()):
        alike = np.flatnonzero((chains.task == task) & chains.is_whole)
        own = [ways[index] for index in alike]
        is_cut_off = _are_cut_off([_reached(way) for way in own], left[alike], extent)
        usual[alike] = ~is_cut_off
        rest = alike[~is_cut_off]
        if len(rest) >= _ENOUGH:
            most, count = Counter(ways[index] for index in rest).most_common(1)[0]
            usual[rest] = [2 * count <= len(rest) or ways[index] == most for index in rest]
    return usual


def _parts(begins: Numbers, landmark: Numbers, distance: Array) -> list[tuple[Numbers, Array]]:
    """Return landmarks and distances of each chain."""
    split = np.split(landmark, begins[1:]), np.split(distance, begins[1:])
    return list(zip(*split, strict=True))


def _left(part: tuple[Numbers, Array]) -> float:
    """Return how far a chain stays from the last landmark that it is on the way to."""
    landmark, distance = part
    to = np.flatnonzero(landmark != WORLD)
    if len(to) == 0:
        return 0.0
    before = np.flatnonzero(landmark[: to[-1]] != landmark[to[-1]])
    begin = before[-1] + 1 if len(before) else 0
    return float(distance[begin : to[-1] + 1].min())


def _reached(way: Way) -> Way:
    """Return a way without what leads nowhere at its end."""
    end = len(way)
    while end > 0 and way[end - 1] == WORLD:
        end -= 1
    return way[:end]


def _are_cut_off(ways: Sequence[Way], left: Array, extent: float) -> NDArray[np.bool_]:
    """Return which of the ways of a task end before others do, bool `[N]`.

    Args:
        ways: N of them, which end at a landmark.
        left: how far from it each of them stays, `[N]`.
        extent: size of the scene.
    """
    counts = Counter(ways)
    cut_off = np.zeros(len(ways), bool)
    for way, count in counts.items():
        alike = np.array([one == way for one in ways])
        further = sum(counts[other] for other in counts if _goes_further(other, way))
        nearest = np.sort(left[alike])[(count - 1) // 2]  # the nearer one of two
        missed = alike & (left > nearest + _MISSED * extent)
        cut_off |= alike if count <= _RARER * further else missed
    return cut_off


def _goes_further(other: Way, way: Way) -> bool:
    """Return whether another way goes on from the end of this one, to where it has not been."""
    return other[: len(way)] == way and not {*other[len(way) :]} <= {*way, WORLD}
