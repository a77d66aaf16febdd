"""What must hold of the tensors of motor schemas before they become their state."""

from __future__ import annotations

import torch
from torch import Tensor

from pacnet.core.integrity import Checks, Tensors, distant, part_of, within

OPEN = 0
"""Support of a schema whose episode is not over."""


def sequences_hold(tensors: Tensors) -> Checks:
    """What holds of motor schemas, whose pool is without gaps."""
    lengths, starts = tensors["blocks.length"], tensors["blocks.start"]
    target = tensors["pool.target"]
    within = (lengths >= 0) & (lengths <= len(target))
    return {
        "finite targets, not too large": distant(target),
        "finite cues, not too large": distant(tensors["pool.cue"]),
        "lengths of sequences ≥ 0": within.all(),
        "sequences laid end to end": torch.equal(starts, lengths.cumsum(0) - lengths),
        "room for each sequence's targets alone": torch.equal(tensors["blocks.room"], lengths),
        "a sequence for every target": int(lengths.sum()) == len(target),
    }


def episodes_hold(behaviours: int, tensors: Tensors) -> Checks:
    """What holds of schemas that compete, beside `sequences_hold`.

    Args:
        behaviours: how many have a name.
        tensors: of their `state_dict`.
    """
    blocks, episodes = part_of(tensors, "blocks."), part_of(tensors, "episodes.")
    passes, frame = part_of(tensors, "passes."), tensors["pool.frame"]
    node, behaviour, number = blocks["node"], episodes["behaviour"], episodes["number"]
    episode, schema, first, last = (passes[n] for n in ("episode", "schema", "first", "last"))
    inside, known = within(episode, len(number)), within(blocks["shown_in"], len(number))
    samples = episodes["samples"]
    finite = [blocks[name] for name in ("typical_length", "fit", "continuation")]
    through = torch.bincount(schema.clamp(0, len(node)), minlength=len(node))[: len(node)]
    return {
        "schemas of nodes that exist": within(node, int(tensors["nodes"])),
        "schemas of at least one target": (blocks["length"] > 0).all(),
        "finite typical lengths, fits and continuations": all(t.isfinite().all() for t in finite),
        "a pass for each support of a schema": torch.equal(
            through, blocks["support"].clamp(min=1)
        ),
        "support ≥ 0": (blocks["support"] >= OPEN).all(),
        "positive lengths of what is supported": (
            (blocks["typical_length"] > 0) | (blocks["support"] == OPEN)
        ).all(),
        "finite last cues, not too large": distant(episodes["last_cue"]),
        "behaviours that have a name": within(behaviour, behaviours),
        "ascending numbers of episodes, from 0 on": (number[1:] > number[:-1]).all()
        and (number >= 0).all(),
        "episodes of so many samples": within(samples, _MOST_SAMPLES),
        "passes of episodes that exist": inside,
        "passes through schemas that exist": within(schema, len(node)),
        "passes within their episodes": (first >= 0).all()
        and (first <= last).all()
        and (last < samples[episode]).all() if inside else False,
        "sequences of episodes that exist": known,
        "frames of their episodes": _frames_hold(blocks, frame, samples) if known else False,
        "a pass in which each sequence was shown": _were_shown(blocks, passes, frame),
    }  # fmt: skip


_MOST_SAMPLES = 2**53  # of an episode, which float64 counts


def _frames_hold(blocks: Tensors, frame: Tensor, samples: Tensor) -> bool:
    """Whether each row of the pool is a sample of the episode that its sequence is from."""
    lengths = blocks["length"]
    if not within(lengths, len(frame) + 1) or int(lengths.sum()) != len(frame):
        return False
    ended = samples[blocks["shown_in"]].repeat_interleave(lengths)
    return bool(((frame >= 0) & (frame < ended)).all())


def _were_shown(blocks: Tensors, passes: Tensors, frame: Tensor) -> bool:
    """Whether some pass through each schema is that of its sequence."""
    schema, start = passes["schema"], blocks["start"]
    ends = (start, start + blocks["length"] - 1)
    count = len(start)
    if not all(within(rows, len(frame)) for rows in ends) or not within(schema, count):
        return False
    own = (passes["episode"] == blocks["shown_in"][schema]) & (
        (passes["first"] == frame[ends[0]][schema]) & (passes["last"] == frame[ends[1]][schema])
    )
    return bool(torch.isin(torch.arange(count, device=schema.device), schema[own]).all())
