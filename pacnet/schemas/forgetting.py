"""Forgetting of targets: new ones replace those that a node stored before it was dishabituated.

Maistros, Marom & Hayes (2001), "Computational System": "due to forgetting (dishabituation) a node
can re-train itself and its motor schema, to adapt to changes in the environment". The paper does
not say how. Here each target that a forgotten node stores, once it is fully habituated again,
replaces the oldest one from before. So nothing is lost while the node responds, and a node keeps as
many targets as it stored in its longest interval: a sliding window, but one that keeps what is seen
seldom.
"""

from __future__ import annotations

import itertools
from typing import Any

import torch
from torch import Tensor, nn

from pacnet.attention.records import NO_NODE
from pacnet.core.growable_rows import GrowableRows
from pacnet.core.integrity import Checks, Tensors

HABITUATED_AT = "habituated_at"
"""Column of a sequence: sample since when its node was habituated at its last target, or NO_NODE
where that is not known."""
FORGOTTEN = "forgotten"
"""Column of a sequence: number of its targets, the first ones, that new ones will replace."""
_EPISODE = "blocks.episode"
_MISSING = {HABITUATED_AT: NO_NODE, FORGOTTEN: 0}  # in older releases


def count_replaced(blocks: GrowableRows, nodes: Tensor, habituated_at: Tensor) -> dict[int, int]:
    """Return how many of its oldest targets each node loses to new ones, and note it in place.

    Args:
        blocks: of the sequences, one for each node, without the new targets.
        nodes: of each new target `[T]`, equal ones together and in order of time.
        habituated_at: sample since when the node was habituated, at each of them, int64 `[T]`.

    Returns:
        Node -> count; nothing where no node was ever forgotten.
    """
    lengths, times, forgotten = map(blocks.live, ("length", HABITUATED_AT, FORGOTTEN))
    if bool(((times[nodes] == habituated_at) & (forgotten[nodes] == 0)).all()):
        return {}
    different = nodes.unique_consecutive()
    columns = (column[different].tolist() for column in (lengths, times, forgotten))
    states = {node: list(state) for node, *state in zip(different.tolist(), *columns, strict=True)}
    lost = dict.fromkeys(states, 0)
    targets = zip(nodes.tolist(), habituated_at.tolist(), strict=True)
    for (node, time), some in itertools.groupby(targets):
        count = len(list(some))
        length, before, old = states[node]
        if before != time and NO_NODE not in (before, time):
            old = length
        gone = min(old, count)
        states[node] = [length + count - gone, time, old - gone]
        lost[node] += gone
    times[different] = times.new_tensor([time for _, time, _ in states.values()])
    forgotten[different] = forgotten.new_tensor([old for *_, old in states.values()])
    return {node: count for node, count in lost.items() if count > 0}


def forgetting_holds(blocks: Tensors) -> Checks:
    """Return the conditions on the two columns of a saved state."""
    forgotten = blocks[FORGOTTEN]
    return {
        "sequences' habituated_at ≥ −1": (blocks[HABITUATED_AT] >= NO_NODE).all(),
        "no more forgotten targets than there are": (
            (forgotten >= 0) & (forgotten <= blocks["length"])
        ).all(),
    }


def load_without(module: nn.Module) -> None:
    """Let `load_state_dict` take motor schemas of older releases, which lack these columns.

    Call it before `check_on_load`, for every module that may be loaded by itself.
    """
    module.register_load_state_dict_pre_hook(_add_missing)


def _add_missing(_module: nn.Module, tensors: Any, prefix: str, *_: object) -> None:
    names = [name for name in tensors if name.startswith(prefix) and name.endswith(_EPISODE)]
    for name in names:
        blocks, episode = name.removesuffix("episode"), tensors[name]
        is_old = not any(blocks + column in tensors for column in _MISSING)
        if is_old and isinstance(episode, Tensor) and episode.dim() == 1:
            for column, value in _MISSING.items():
                tensors[blocks + column] = torch.full((len(episode),), value)
