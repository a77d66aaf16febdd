"""A bounded memory of targets: the two that are most alike become one.

The map decides how the memory is shared out. Each node stands for a kind of situation, and the one
with the most targets has to make room. Of its targets those two become one, their mean, whose cues
are nearest to each other: what is shown again and again takes no more room, and noise averages out.
"""

from __future__ import annotations

import torch
from torch import Tensor

from pacnet.core.growable_rows import Column
from pacnet.schemas.forgetting import FORGOTTEN, HABITUATED_AT
from pacnet.schemas.sequences import Sequences

COUNT = "count"
"""Column of a target: number of targets shown that it is the mean of."""
COUNTS = {COUNT: Column((), torch.int64)}


def make_room(schemas: Sequences, added: int) -> None:
    """Make one target fewer, of the node that has the most; of equal ones the first.

    A target that will be replaced anyway goes first. Where no node has two targets, the one goes
    that was stored for the longest time.

    Args:
        schemas: one sequence for each node, with the column `COUNT` of each target.
        added: node to which a target has just been added.
    """
    node = int(schemas.lengths.argmax())
    if int(schemas.lengths[node]) < 2:
        _forget_one(schemas, added)
    elif int(schemas.blocks.live(FORGOTTEN)[node]) > 0:
        schemas.blocks.live(FORGOTTEN)[node] -= 1
        schemas.drop_first(*schemas.lengths.new_tensor([[node], [1]]))
    else:
        _merge_most_alike(schemas, node)


def _forget_one(schemas: Sequences, added: int) -> None:
    since = schemas.blocks.live(HABITUATED_AT).clone()
    since[(schemas.lengths == 0) | (torch.arange(len(since), device=since.device) == added)] = 2**62
    gone = since.argmin() if bool((since < 2**62).any()) else schemas.lengths.argmax()
    schemas.lengths[gone] = 0


def _merge_most_alike(schemas: Sequences, node: int) -> None:
    """Let the earlier of two targets be the mean of both, and close the gap that is left."""
    first, second = _most_alike(schemas.cues(node).double())
    counts = schemas.rows_in(COUNT, node)
    both = counts[first] + counts[second]
    share = (counts[second] / both).to(torch.float64)
    for column in ("cue", "target"):
        rows = schemas.rows_in(column, node)
        rows[first] += (share * (rows[second].double() - rows[first].double())).to(rows)
    counts[first] = both
    for column in schemas.pool.columns:
        rows = schemas.rows_in(column, node)
        rows[second:-1] = rows[second + 1 :].clone()
    schemas.lengths[node] -= 1


def _most_alike(cues: Tensor) -> tuple[int, int]:
    """Return the two cues `[L ≥ 2, D]` that are nearest to each other; of equal ones the first."""
    pairs = torch.triu_indices(len(cues), len(cues), offset=1, device=cues.device)
    nearest = int(torch.nn.functional.pdist(cues).argmin())
    return int(pairs[0, nearest]), int(pairs[1, nearest])
