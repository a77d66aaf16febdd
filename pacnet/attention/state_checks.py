"""What must hold of the tensors of a map before they become its state."""

from __future__ import annotations

import torch

from pacnet.attention.records import NO_NODE
from pacnet.core.integrity import Checks, Tensors, are_bounded
from pacnet.core.validation import MAX_SAMPLES


def map_holds(floor: float, tensors: Tensors) -> Checks:
    """What holds of a map.

    Args:
        floor: of habituation.
        tensors: of its `state_dict`.
    """
    habituation, since = tensors["nodes.habituation"], tensors["nodes.habituated_at"]
    ends, age, time = tensors["edges.ends"], tensors["edges.age"], tensors["time"]
    nodes, floor = len(habituation), floor - (1e-6 if habituation.dtype != torch.half else 1e-3)
    return {
        "finite prototypes, not too large": are_bounded(tensors["nodes.prototype"]),
        "habituation between its floor and 1": ((habituation >= floor) & (habituation <= 1)).all(),
        "a time ≥ 0 that can go on": (time >= 0) & (time <= MAX_SAMPLES),
        "habituated_at in the past": ((since >= NO_NODE) & (since <= time)).all(),
        "edges between nodes that exist": ((ends >= 0) & (ends < nodes)).all(),
        "edges with the lower node first": (ends[:, 0] < ends[:, 1]).all(),
        "one edge between two nodes": len(ends.unique(dim=0)) == len(ends),
        "ages of edges ≥ 0 that can go on": ((age >= 0) & (age <= MAX_SAMPLES)).all(),
    }
