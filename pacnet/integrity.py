"""What must hold between the tensors of a network, whoever made them.

A checkpoint can be damaged or edited so that each tensor has the right name and shape and the whole
still means nothing: a target of NaN would reach a motor, an edge could lead to a node that is not
there. Checked after loading, and before a good checkpoint is replaced.
"""

from __future__ import annotations

import torch
from torch import Tensor

from pacnet.attention import NOBODY
from pacnet.competing_schemas import CompetingSchemas
from pacnet.retraining import OPEN
from pacnet.schemas import MotorSchemas
from pacnet.sequences import Sequences
from pacnet.sofm import HabituatingSOFM


def check_integrity(sofm: HabituatingSOFM, schemas: MotorSchemas | CompetingSchemas) -> None:
    """Checks a map and its motor schemas, whose pool must be without gaps.

    Raises:
        ValueError: naming the first thing that does not hold.
    """
    if len(sofm) != len(schemas):
        raise ValueError(
            f"expected motor schemas for each node, got {len(schemas)} for {len(sofm)} nodes"
        )
    checks = {**_map_holds(sofm), **_sequences_hold(schemas)}
    if isinstance(schemas, CompetingSchemas):
        checks |= _episodes_hold(schemas)
    for name, holds in checks.items():
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


def _sequences_hold(schemas: Sequences) -> dict[str, Tensor | bool]:
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


def _episodes_hold(schemas: CompetingSchemas) -> dict[str, Tensor | bool]:
    blocks, passes, episodes = schemas.blocks, schemas.passes, schemas.episodes
    node, behaviour, number = blocks.live("node"), *map(episodes.live, ("behaviour", "number"))
    episode, schema = passes.live("episode"), passes.live("schema")
    first, last = passes.live("first"), passes.live("last")
    inside = (episode >= 0) & (episode < len(episodes))
    ended = episodes.live("samples")[episode[inside]]
    finite = [blocks.live(name) for name in ("typical_length", "fit", "continuation")]
    return {
        "schemas of nodes that exist": ((node >= 0) & (node < len(schemas))).all(),
        "schemas of at least one target": (schemas.lengths > 0).all(),
        "finite typical lengths, fits and continuations": all(t.isfinite().all() for t in finite),
        "a pass for each support of a schema": torch.equal(
            torch.bincount(schema.clamp(0, len(blocks)), minlength=len(blocks))[: len(blocks)],
            blocks.live("support").clamp(min=1),
        ),
        "positive lengths of what is supported": (
            (blocks.live("typical_length") > 0) | (blocks.live("support") == OPEN)
        ).all(),
        "finite last cues": episodes.live("last_cue").isfinite().all(),
        "behaviours that have a name": (
            (behaviour >= 0) & (behaviour < len(schemas.behaviours))
        ).all(),
        "ascending numbers of episodes": (number[1:] > number[:-1]).all(),
        "passes of episodes that exist": inside.all(),
        "passes through schemas that exist": ((schema >= 0) & (schema < len(blocks))).all(),
        "passes within their episodes": (
            (first >= 0) & (first <= last) & (last < ended if inside.all() else False)
        ).all(),
        "a pass in which each sequence was shown": _were_shown(schemas),
    }


def _were_shown(schemas: CompetingSchemas) -> bool:
    """Whether some pass through each schema is that of its sequence."""
    blocks, passes, frame = schemas.blocks, schemas.passes, schemas.pool.live("frame")
    schema, start = passes.live("schema"), blocks.live("start")
    ends = (start, start + schemas.lengths - 1)
    if not all(_are_within(rows, len(frame)) for rows in ends) or not _are_within(
        schema, len(blocks)
    ):
        return False
    own = (passes.live("episode") == blocks.live("shown_in")[schema]) & (
        (passes.live("first") == frame[ends[0]][schema])
        & (passes.live("last") == frame[ends[1]][schema])
    )
    return bool(torch.isin(torch.arange(len(blocks), device=schema.device), schema[own]).all())


def _are_within(numbers: Tensor, count: int) -> bool:
    return bool(((numbers >= 0) & (numbers < count)).all())
