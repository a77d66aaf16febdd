"""The moments of episodes that an affine law is fitted to, in blocks that can be held out."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_BLOCKS = 5  # of an episode, and parts held out in turn


class Rows(NamedTuple):
    """What is fitted: N moments of episodes, each with a frame before and `lead` after it."""

    inputs: Array
    """Mean action until the target's frame, then the last frame's change, `[N, U + S]`."""
    changes: Array
    """Change until the target's frame, `[N, S]`."""
    part: NDArray[np.int64]
    """The part that a moment is held out in; −1 where its frames are of two blocks, `[N]`."""


def rows_of(
    states: Sequence[Array], actions: Sequence[Array], follows: Sequence[int], lead: int
) -> Rows:
    """Return the moments of all episodes; nothing is taken across two of them."""
    inputs, changes, parts, blocks = [], [], [], 0
    for state, action in zip(states, actions, strict=True):
        count = len(state) - lead - 1
        if count < 1:
            continue
        now = state[1:-lead]
        sent = mean_ahead(action, lead)[1:] - placed(now, follows)
        inputs.append(np.concatenate([sent, now - state[: -lead - 1]], axis=1))
        changes.append(state[1 + lead :] - now)
        number = min(_BLOCKS, max(1, count // (2 * lead)))
        parts.append(_parts(count, number, lead, blocks))
        blocks += number
    if not inputs:
        wide, tall = len(follows), states[0].shape[1]
        return Rows(np.empty((0, wide + tall)), np.empty((0, tall)), np.empty(0, np.int64))
    return Rows(np.concatenate(inputs), np.concatenate(changes), np.concatenate(parts))


def mean_ahead(actions: Array, lead: int) -> Array:
    """Return the mean of the actions from each frame on, of `lead` frames, `[T − lead, U]`."""
    sums = np.concatenate([np.zeros((1, actions.shape[1])), actions.cumsum(axis=0)])
    return ((sums[lead:] - sums[:-lead]) / lead)[:-1]


def placed(states: Array, follows: Sequence[int] | NDArray[np.int64]) -> Array:
    """Return the place of each action that is one of the state's, 0 of others, `[N, U]`."""
    place = np.asarray(follows)
    return np.where(place >= 0, states[:, place], 0.0)


def _parts(count: int, blocks: int, lead: int, before: int) -> NDArray[np.int64]:
    """Return the part of each of so many moments, cut into blocks after those before."""
    block = np.arange(count) * blocks // count
    of_two = np.append(block[lead - 1 :], np.full(lead - 1, block[-1]))[:count] != block
    return np.where(of_two, -1, (before + block) % _BLOCKS)
