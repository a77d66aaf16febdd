"""A bounded memory of targets: the two that are most alike become one.

The map decides how the memory is shared out. Each node stands for a kind of situation, and the one
with the most targets has to make room; of equal ones, the first. A target that will be replaced
anyway, because its node was forgotten, goes first. Else those two targets of the node become one,
their mean, whose cues are nearest to each other: what is shown again and again takes no more room,
and noise averages out. Where no node has two targets, that node loses its own which has been
habituated for the longest time.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from pacnet.core.growable_rows import Column, as_array
from pacnet.core.integrity import Checks, Tensors, within
from pacnet.schemas.forgetting import FORGOTTEN, HABITUATED_AT
from pacnet.schemas.interface import Samples
from pacnet.schemas.sequences import Sequences, compact

COUNT = "count"
"""Column of a target: number of targets shown that it is the mean of."""
COUNTS = {COUNT: Column((), torch.int64)}
_COUNTED = 2**53  # `merging_kernels.MOST_SHOWN`, which is not imported here because numba is slow
_OF_NODE = ("length", "episode", HABITUATED_AT, FORGOTTEN)


def add_within_budget(schemas: Sequences, samples: Samples, episode: int, budget: int) -> None:
    """Add samples of habituated nodes, in order of time; after each there are at most so many.

    Rows move to other memory, so a thread that reads the old ones sees them unchanged.

    Args:
        schemas: one sequence for each node, with the column `COUNT` of each target.
        samples: checked, all habituated.
        episode: number of the learning episode.
        budget: number of targets, ≥ 1.

    Raises:
        ValueError: a node that does not exist; nothing has changed then.
    """
    if not within(samples.node, len(schemas.blocks)):
        raise ValueError(f"expected nodes below {len(schemas.blocks)}, got {samples.node}")
    whole = schemas.pool.live("cue").dtype in (torch.float32, torch.float64)
    # In half precision a mean is rounded when it is stored, which is after each sample.
    at_once = len(samples.node) if whole else 1
    for part in zip(*(column.split(at_once) for column in samples), strict=True):
        _add(schemas, Samples(*part), episode, budget)


def _add(schemas: Sequences, samples: Samples, episode: int, budget: int) -> None:
    from pacnet.schemas import merging_kernels  # imports numba

    compact(schemas)
    values = _values(schemas, samples)
    state = {name: as_array(schemas.blocks.live(name)).copy() for name in _OF_NODE}
    links = (np.empty(len(values[COUNT]), kind) for kind in (np.int64, np.int64, np.float64))
    rows = merging_kernels.Rows(values["cue"], values["target"], values[COUNT], *links)
    ends = (np.zeros(len(schemas.blocks), np.int64) for _ in range(3))
    nodes = merging_kernels.Nodes(*state.values(), *ends)
    node, since = as_array(samples.node), as_array(samples.habituated_at)
    budget = min(budget, len(rows.count))  # which may be more than int64 holds
    single = schemas.pool.live("cue").dtype != torch.float64
    left = merging_kernels.add_within_budget(node, since, episode, budget, single, rows, nodes)
    schemas.pool.replace({name: torch.from_numpy(column[left]) for name, column in values.items()})
    _set_blocks(schemas, {name: torch.from_numpy(column) for name, column in state.items()})


def _values(schemas: Sequences, samples: Samples) -> dict[str, NDArray[Any]]:
    """Return copies of the stored rows, and the new ones after them."""
    new = {"target": samples.target, "cue": samples.cue, COUNT: torch.ones_like(samples.node)}
    stored = {name: schemas.pool.live(name) for name in new}
    rows = {name: torch.cat([stored[name], new[name]]) for name in new}
    return {
        name: as_array(column.double() if column.is_floating_point() else column)
        for name, column in rows.items()
    }


def _set_blocks(schemas: Sequences, state: dict[str, Tensor]) -> None:
    """Lay the sequences end to end."""
    length = state["length"]
    block = {"start": length.cumsum(0) - length, "capacity": length}
    schemas.blocks.replace({**state, **block})


def budget_holds(tensors: Tensors, budget: int) -> Checks:
    """Return the conditions on a saved state of schemas with a budget."""
    count = tensors[f"pool.{COUNT}"]
    return {
        f"{budget} targets at most": len(count) <= budget,
        f"counts from 1 to {_COUNTED}": ((count >= 1) & (count <= _COUNTED)).all(),
    }


def check_counted(tensors: Tensors, budget: int | None) -> None:
    """Raise a ValueError unless a state has counts if, and only if, there is a budget."""
    is_counted, name = f"pool.{COUNT}" in tensors, [f"pool.{COUNT}"]
    if budget is None and is_counted:
        raise ValueError(f"expected the tensors of no budget, got none missing, {name} extra")
    if budget is not None and not is_counted:
        raise ValueError(f"expected the tensors of a budget, got {name} missing, none extra")
