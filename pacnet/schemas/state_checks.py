"""Conditions on the tensors of motor schemas and of the episodic memory."""

from __future__ import annotations

import torch
from torch import Tensor

from pacnet.core.integrity import Checks, Tensors, are_bounded, part_of, within

OPEN = 0
"""Support of a schema whose episode is not over."""
_MOST_SAMPLES = 2**53  # of an episode, the most that float64 counts


def sequences_hold(tensors: Tensors) -> Checks:
    """Return the conditions on sequences in a pool without gaps."""
    lengths, starts = tensors["blocks.length"], tensors["blocks.start"]
    target = tensors["pool.target"]
    within_pool = (lengths >= 0) & (lengths <= len(target))
    return {
        "finite targets, not too large": are_bounded(target),
        "finite cues, not too large": are_bounded(tensors["pool.cue"]),
        "lengths of sequences ≥ 0": within_pool.all(),
        "sequences laid end to end": torch.equal(starts, lengths.cumsum(0) - lengths),
        "blocks as long as their sequences": torch.equal(tensors["blocks.capacity"], lengths),
        "a sequence for every target": int(lengths.sum()) == len(target),
    }


def references_hold(behaviours: int, tensors: Tensors) -> Checks:
    """Return the conditions on episodes at any time: each row refers to rows that exist.

    Args:
        behaviours: number of behaviours that have a name.
        tensors: buffers by name.
    """
    blocks, visits = part_of(tensors, "blocks."), part_of(tensors, "visits.")
    episode, first, last = visits["episode"], visits["first"], visits["last"]
    samples, support = tensors["episodes.samples"], blocks["support"]
    known = within(episode, len(samples))
    return {
        "schemas of nodes that exist": within(blocks["node"], int(tensors["nodes"])),
        "schemas of at least one target": (blocks["length"] > 0).all(),
        "sequences of episodes that exist": within(blocks["shown_in"], len(samples)),
        "support ≥ 0": (support >= OPEN).all(),
        "a typical length > 0 of what has support": (
            (blocks["typical_length"] > 0) | (support == OPEN)
        ).all(),
        "behaviours that have a name": within(tensors["episodes.behaviour"], behaviours),
        "visits of episodes that exist": known,
        "visits of schemas that exist": within(visits["schema"], len(support)),
        "visits within their episodes": (first >= 0).all()
        and (first <= last).all()
        and (last < samples[episode]).all()
        if known
        else False,
    }


def episodes_hold(tensors: Tensors) -> Checks:
    """Return the conditions on episodes in a saved state, in addition to `references_hold`."""
    blocks, visits = part_of(tensors, "blocks."), part_of(tensors, "visits.")
    frame, samples = tensors["pool.frame"], tensors["episodes.samples"]
    number, schema, count = tensors["episodes.number"], visits["schema"], len(blocks["node"])
    finite = [blocks[name] for name in ("typical_length", "fit", "continuation")]
    visited = torch.bincount(schema, minlength=count)
    return {
        "finite typical lengths, fits and continuations": all(t.isfinite().all() for t in finite),
        "a visit for each support of a schema": torch.equal(
            visited, blocks["support"].clamp(min=1)
        ),
        "finite last cues, not too large": are_bounded(tensors["episodes.last_cue"]),
        "ascending numbers of episodes, from 0 on": (number[1:] > number[:-1]).all()
        and (number >= 0).all(),
        "episodes of so many samples": within(samples, _MOST_SAMPLES),
        "frames of their episodes": _frames_hold(blocks, frame, samples),
        "a visit in which each sequence was shown": _were_shown(blocks, visits, frame),
    }


def _frames_hold(blocks: Tensors, frame: Tensor, samples: Tensor) -> bool:
    """Return whether each row of the pool is a sample of the episode that its sequence is from."""
    ends = samples[blocks["shown_in"]].repeat_interleave(blocks["length"])
    return bool(((frame >= 0) & (frame < ends)).all())


def _were_shown(blocks: Tensors, visits: Tensors, frame: Tensor) -> bool:
    """Return whether some visit of each schema is that of its sequence."""
    schema, start = visits["schema"], blocks["start"]
    end = start + blocks["length"] - 1
    own = (visits["episode"] == blocks["shown_in"][schema]) & (
        (visits["first"] == frame[start][schema]) & (visits["last"] == frame[end][schema])
    )
    return bool(torch.isin(torch.arange(len(start), device=schema.device), schema[own]).all())
