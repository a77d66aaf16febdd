"""The state of a growing map: its buffers and their invariants."""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor

from pacnet.attention.records import NO_NODE
from pacnet.core.growable_rows import GrowableRows, check_storage
from pacnet.core.integrity import Checks, Tensors, are_bounded
from pacnet.core.validation import MAX_SAMPLES, describe


class MapState(NamedTuple):
    """The buffers that an engine reads and changes."""

    nodes: GrowableRows
    edges: GrowableRows
    buffers: dict[str, Tensor]  # "time", int64 [], and "scale", float [D]

    def check_widths(self, width: int) -> None:
        """Raise a ValueError unless prototypes and scale have this width and the same type."""
        prototypes, scale = self.nodes.live("prototype"), self.buffers["scale"]
        wanted = (width,), (width,), prototypes.dtype
        if (prototypes.shape[1:], scale.shape, scale.dtype) != wanted:
            raise ValueError(
                f"expected prototypes [nodes, {width}] and a scale [{width}], as the config says, "
                f"of one type, got {describe(prototypes)} and {describe(scale)}"
            )
        check_storage("scale", scale)

    def delete_nodes(self, isolated: Tensor) -> None:
        """Delete nodes without edges, int64 `[K]` ascending; later ones move down."""
        self.nodes.delete(isolated)
        ends = self.edges.live("ends")
        ends -= torch.searchsorted(isolated, ends)

    def check(self) -> None:
        """Raise a ValueError for misshapen time, nodes or edges, or edges to missing nodes."""
        time = self.buffers["time"]
        if time.shape != () or time.dtype != torch.int64:
            raise ValueError(f"expected time as one torch.int64, got {time}")
        self.nodes.check()
        self.edges.check()
        ends, count = self.edges.live("ends"), len(self.nodes)
        valid = (ends >= 0) & (ends < count) & (ends[:, :1] != ends[:, 1:])
        if not bool(valid.all()):
            raise ValueError(f"expected edges between two of {count} nodes each, got others")


def map_holds(floor: float, tensors: Tensors) -> Checks:
    """Return the conditions on a map's `state_dict`, given its lowest habituation."""
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
