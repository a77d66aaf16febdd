"""What must hold between the tensors of a network, whoever made them.

A checkpoint can be damaged or edited so that each tensor has the right name and shape and the whole
still means nothing: a target of NaN would reach a motor, an edge could lead to a node that is not
there. Checked after loading, and before a good checkpoint is replaced.
"""

from __future__ import annotations

import torch
from torch import Tensor

from pacnet.schemas import MotorSchemas
from pacnet.sofm import NOBODY, HabituatingSOFM


def check_integrity(sofm: HabituatingSOFM, schemas: MotorSchemas) -> None:
    """Checks a map and its motor schemas, whose pool must be without gaps.

    Raises:
        ValueError: naming the first thing that does not hold.
    """
    if len(sofm) != len(schemas):
        raise ValueError(
            f"expected a motor schema for each node, got {len(schemas)} for {len(sofm)} nodes"
        )
    for name, holds in {**_map_holds(sofm), **_schemas_hold(schemas)}.items():
        if not bool(holds):
            raise ValueError(f"expected {name}, got tensors in which it does not hold")


def _map_holds(sofm: HabituatingSOFM) -> dict[str, Tensor | bool]:
    habituation, since = sofm.habituation, sofm.nodes.live("habituated_at")
    ends, age = sofm.edges.live("ends"), sofm.edges.live("age")
    floor = sofm.config.floor_habituation - 1e-6  # rounding
    return {
        "finite prototypes": torch.isfinite(sofm.prototypes).all(),
        "habituation between its floor and 1": ((habituation >= floor) & (habituation <= 1)).all(),
        "habituated_at in the past": ((since >= NOBODY) & (since <= sofm.time)).all(),
        "edges between nodes that exist": ((ends >= 0) & (ends < len(sofm))).all(),
        "edges with the lower node first": (ends[:, 0] < ends[:, 1]).all(),
        "one edge between two nodes": len(ends.unique(dim=0)) == len(ends),
        "ages of edges ≥ 0": (age >= 0).all(),
    }


def _schemas_hold(schemas: MotorSchemas) -> dict[str, Tensor | bool]:
    lengths = schemas.lengths
    starts, room = schemas.blocks.live("start"), schemas.blocks.live("room")
    return {
        "finite targets": torch.isfinite(schemas.pool.live("target")).all(),
        "finite cues": torch.isfinite(schemas.pool.live("cue")).all(),
        "lengths of sequences ≥ 0": (lengths >= 0).all(),
        "sequences laid end to end": torch.equal(starts, lengths.cumsum(0) - lengths),
        "room for each sequence's targets alone": torch.equal(room, lengths),
        "a sequence for every target": int(lengths.sum()) == len(schemas.pool),
    }
