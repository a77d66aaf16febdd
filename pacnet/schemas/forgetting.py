"""Forgetting of targets: new ones replace those that a node stored before it was dishabituated.

Maistros, Marom & Hayes (2001), "Computational System": "due to forgetting (dishabituation) a node
can re-train itself and its motor schema, to adapt to changes in the environment". The paper does
not say how. Here each target that a forgotten node stores, once it is fully habituated again,
replaces the oldest one from before. So nothing is lost while the node responds, and a node keeps as
many targets as it stored in its longest interval: a sliding window, but one that keeps what is seen
seldom.
"""

from __future__ import annotations

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
    """
    stretches, counts = torch.stack([nodes, habituated_at], dim=1).unique_consecutive(
        return_counts=True, dim=0
    )
    lengths, times, forgotten = map(blocks.live, ("length", HABITUATED_AT, FORGOTTEN))
    stored, lost = dict[int, int](), dict[int, int]()
    for (node, time), count in zip(stretches.tolist(), counts.tolist(), strict=True):
        before, old = int(times[node]), int(forgotten[node])
        length = stored.get(node, int(lengths[node]))
        if before != time and NO_NODE not in (before, time):
            old = length
        gone = min(old, count)
        stored[node], lost[node] = length + count - gone, lost.get(node, 0) + gone
        times[node], forgotten[node] = time, old - gone
    return lost


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
        if isinstance(tensors[name], Tensor):
            for column, value in _MISSING.items():
                new = name.removesuffix(_EPISODE) + f"blocks.{column}"
                tensors.setdefault(new, torch.full_like(tensors[name], value))
