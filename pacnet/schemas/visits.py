"""Visits: an episode is stored as stretches of samples at one habituated node each.

A node that wins again soon continues its visit. Learning an episode in parts gives the same result
as learning it at once, to the bit.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import torch
from torch import Tensor
from torch.nn.utils.rnn import pad_sequence

from pacnet.attention.records import NO_NODE
from pacnet.schemas.interface import Samples
from pacnet.schemas.memory import EpisodicMemory
from pacnet.schemas.state_checks import OPEN

_NO_ROW = -1


@dataclass(eq=False)
class Visit:
    """A visit of the episode that is being learned.

    Attributes:
        node: where it is.
        last: sample of the episode at which the node won last.
        row: of `EpisodicMemory.visits`; −1 while it has none.
        schema: id of its own schema, likewise.
        samples: those of the current part of the episode that belong to it, ascending.
    """

    node: int
    last: int
    row: int = _NO_ROW
    schema: int = _NO_ROW
    samples: list[int] = field(default_factory=list)


def add_samples(memory: EpisodicMemory, samples: Samples) -> None:
    """Learn the next part of the latest episode, at least one sample, in place."""
    episode = memory.episodes
    first = int(episode.live("samples")[-1])
    nodes = samples.node.where(samples.habituated, NO_NODE).tolist()
    lookahead = memory.config.lookahead_samples
    visits = assign_samples(nodes, first, _unfinished(memory, first), lookahead)
    _start(memory, [new for new in visits if new.row == _NO_ROW], first)
    _append(memory, [visit for visit in visits if visit.samples], samples, first)
    _update_continuations(memory, visits, samples.cue, first)
    episode.live("samples")[-1] += len(nodes)
    episode.live("last_cue")[-1] = samples.cue[-1]


def assign_samples(
    nodes: Sequence[int], first: int, unfinished: Sequence[Visit], lookahead: int
) -> list[Visit]:
    """Assign each sample to its visit, and return the unfinished visits, then the new ones.

    Args:
        nodes: the habituated winner at each sample, or `NO_NODE`.
        first: index in the episode of the first sample.
        unfinished: visits that may continue, one per node; they are changed.
        lookahead: number of samples after its last within which a visit may continue.
    """
    visits = list(unfinished)
    at = {visit.node: visit for visit in visits}
    for sample, node in enumerate(nodes):
        if node == NO_NODE:
            continue
        visit = at.get(node)
        if visit is None or first + sample - visit.last > lookahead:
            visit = at[node] = Visit(node, first + sample)
            visits.append(visit)
        visit.last = first + sample
        visit.samples.append(sample)
    return visits


def continue_means(means: Tensor, seen: Tensor, values: Tensor, counts: Tensor) -> Tensor:
    """Return updated running means, the same to the bit as with one value at a time.

    Args:
        means: of the values so far, `[K]`.
        seen: number of values in each so far, int64 `[K]`.
        values: new values `[sum of counts]` of the means' dtype, one mean after the other.
        counts: number of new values of each, int64 `[K]`, ≥ 1.
    """
    table = pad_sequence(list(values.split(counts.tolist())))  # [most, K]
    rank = torch.arange(1, len(table) + 1, device=means.device)[:, None]
    # Divided by infinity, a change is zero: a mean without further values stays as it is.
    parts = (seen + rank).to(means.dtype).where(rank <= counts, torch.inf)
    for row, part in zip(table.unbind(), parts.unbind(), strict=True):
        means = means + (row - means) / part
    return means


def _unfinished(memory: EpisodicMemory, frame: int) -> list[Visit]:
    """Return the latest episode's visits that may still continue."""
    visits = memory.visits
    latest = visits.live("episode") == len(memory.episodes) - 1
    since = frame - visits.live("last")
    row = (latest & (since <= memory.config.lookahead_samples)).nonzero().flatten()
    schema = visits.live("schema")[row]
    columns = (memory.blocks.live("node")[schema], visits.live("last")[row], row, schema)
    return [Visit(*fields) for fields in torch.stack(columns, dim=1).tolist()]


def _start(memory: EpisodicMemory, new: list[Visit], first: int) -> None:
    """Give new visits their rows, and each a schema of its own."""
    if not new:
        return
    blocks, visits = memory.blocks, memory.visits
    schema, row = blocks.extend(len(new)), visits.extend(len(new))
    for index, visit in enumerate(new):
        visit.row, visit.schema = row + index, schema + index
    nodes = blocks.live("node")
    nodes[schema:] = nodes.new_tensor([visit.node for visit in new])
    blocks.live("support")[schema:] = OPEN
    blocks.live("shown_in")[schema:] = visits.live("episode")[row:] = len(memory.episodes) - 1
    visits.live("schema")[row:] = torch.arange(schema, len(blocks), device=nodes.device)
    visits.live("first")[row:] = nodes.new_tensor([first + visit.samples[0] for visit in new])


def _append(memory: EpisodicMemory, visits: list[Visit], samples: Samples, first: int) -> None:
    """Append samples to the schemas of their visits."""
    if not visits:
        return
    fit, lengths = memory.blocks.live("fit"), memory.lengths
    rows = [(visit.schema, len(visit.samples)) for visit in visits]
    schema, count = lengths.new_tensor(rows).unbind(dim=1)
    order = lengths.new_tensor([sample for visit in visits for sample in visit.samples])
    activation = samples.activation[order].to(fit.dtype)
    fit[schema] = continue_means(fit[schema], lengths[schema], activation, count)
    columns = {"target": samples.target[order], "cue": samples.cue[order], "frame": first + order}
    memory.append_rows(schema, count, columns)


def _update_continuations(
    memory: EpisodicMemory, visits: list[Visit], cues: Tensor, first: int
) -> None:
    """Update the last sample of visits, and the continuation of their schemas."""
    if not visits:
        return
    latest = [visit.last + memory.config.lookahead_samples - first for visit in visits]
    seen = [min(sample, len(cues) - 1) for sample in latest]
    rows = [(visit.row, visit.last, visit.schema) for visit in visits]
    row, last, schema = memory.lengths.new_tensor(rows).unbind(dim=1)
    memory.visits.live("last")[row] = last
    memory.blocks.live("continuation")[schema] = cues[seen]
