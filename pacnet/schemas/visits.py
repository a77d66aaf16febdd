"""Passes: an episode is kept as the stretches of it at one habituated node each.

A node that wins again soon goes on with its pass. What is kept follows from the samples alone, to
the bit, in whatever portions they come.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import torch
from torch import Tensor
from torch.nn.utils.rnn import pad_sequence

from pacnet.attention.records import NO_NODE
from pacnet.schemas.sequences import Samples
from pacnet.schemas.state_checks import OPEN

if TYPE_CHECKING:
    from pacnet.competition.competing_schemas import CompetingSchemas


@dataclass(eq=False)
class Pass:
    """A pass of the episode that is being learned.

    Attributes:
        node: at which it is.
        last: sample of the episode at which the node won last.
        number: its row among the passes that are remembered; `NO_NODE` while it has none.
        schema: number of its own schema, likewise.
        samples: those of the portion at hand that belong to it, ascending.
    """

    node: int
    last: int
    number: int = NO_NODE
    schema: int = NO_NODE
    samples: list[int] = field(default_factory=list)


def take_in(schemas: CompetingSchemas, samples: Samples) -> None:
    """Learns the next portion of the episode that was begun last.

    Args:
        schemas: changed.
        samples: at least one.
    """
    episode = schemas.episodes
    first = int(episode.live("samples")[-1])
    nodes = samples.node.where(samples.habituated, NO_NODE).tolist()
    passes = assign(nodes, first, _recent(schemas, first), schemas.config.continuation)
    _open(schemas, [new for new in passes if new.number == NO_NODE], first)
    _keep(schemas, [here for here in passes if here.samples], samples, first)
    _look_on(schemas, passes, samples.cue, first)
    episode.live("samples")[-1] += len(nodes)
    episode.live("last_cue")[-1] = samples.cue[-1]


def assign(
    nodes: Sequence[int], first: int, recent: Sequence[Pass], continuation: int
) -> list[Pass]:
    """Gives each sample to its pass.

    Args:
        nodes: the habituated winner at each sample, or `NO_NODE`.
        first: which sample of the episode the first one is.
        recent: passes that may go on, one a node.
        continuation: samples after its last at which a pass still may.

    Returns:
        The recent passes, changed, and then those that began, in the order in which they did.
    """
    passes = list(recent)
    at = {known.node: known for known in passes}
    for sample, node in enumerate(nodes):
        if node == NO_NODE:
            continue
        here = at.get(node)
        if here is None or first + sample - here.last > continuation:
            here = at[node] = Pass(node, first + sample)
            passes.append(here)
        here.last = first + sample
        here.samples.append(sample)
    return passes


def means_going_on(means: Tensor, seen: Tensor, values: Tensor, counts: Tensor) -> Tensor:
    """Running means after more values, to the bit as if these had come one at a time.

    Args:
        means: of the values so far, `[K]`.
        seen: how many each is of so far, int64 `[K]`.
        values: `[sum of counts]`, of the means' dtype: those of one mean after those of another.
        counts: how many each gets, int64 `[K]`, ≥ 1.

    Returns:
        The means over all values, `[K]`.
    """
    table = pad_sequence(list(values.split(counts.tolist())))  # [most, K]
    rank = torch.arange(1, len(table) + 1, device=means.device)[:, None]
    # Where there are no more values, a mean moves on by an infinitely small part.
    parts = (seen + rank).to(means.dtype).where(rank <= counts, torch.inf)
    for row, part in zip(table.unbind(), parts.unbind(), strict=True):
        means = means + (row - means) / part
    return means


def _recent(schemas: CompetingSchemas, frame: int) -> list[Pass]:
    """This episode's passes of which it is still seen what comes after."""
    passes = schemas.passes
    this = passes.live("episode") == len(schemas.episodes) - 1
    since = frame - passes.live("last")
    number = (this & (since <= schemas.config.continuation)).nonzero().flatten()
    schema = passes.live("schema")[number]
    columns = (schemas.blocks.live("node")[schema], passes.live("last")[number], number, schema)
    return [Pass(*row) for row in torch.stack(columns, dim=1).tolist()]


def _open(schemas: CompetingSchemas, new: list[Pass], first: int) -> None:
    """Gives new passes their numbers, and each a schema of its own."""
    if not new:
        return
    blocks, passes = schemas.blocks, schemas.passes
    schema, number = blocks.extend(len(new)), passes.extend(len(new))
    for place, each in enumerate(new):
        each.number, each.schema = number + place, schema + place
    nodes = blocks.live("node")
    nodes[schema:] = nodes.new_tensor([each.node for each in new])
    blocks.live("support")[schema:] = OPEN
    blocks.live("shown_in")[schema:] = passes.live("episode")[number:] = len(schemas.episodes) - 1
    passes.live("schema")[number:] = torch.arange(schema, len(blocks), device=nodes.device)
    passes.live("first")[number:] = nodes.new_tensor([first + each.samples[0] for each in new])


def _keep(schemas: CompetingSchemas, passes: list[Pass], samples: Samples, first: int) -> None:
    """Appends samples to the schemas of their passes."""
    if not passes:
        return
    fit, lengths = schemas.blocks.live("fit"), schemas.lengths
    rows = [(each.schema, len(each.samples)) for each in passes]
    schema, count = lengths.new_tensor(rows).unbind(dim=1)
    order = lengths.new_tensor([sample for each in passes for sample in each.samples])
    activation = samples.activation[order].to(fit.dtype)
    fit[schema] = means_going_on(fit[schema], lengths[schema], activation, count)
    columns = {"target": samples.target[order], "cue": samples.cue[order], "frame": first + order}
    schemas.append_each(schema, count, columns)


def _look_on(schemas: CompetingSchemas, passes: list[Pass], cues: Tensor, first: int) -> None:
    """Keeps where passes end so far, and what came after: the latest of a few cues."""
    if not passes:
        return
    latest = [each.last + schemas.config.continuation - first for each in passes]
    seen = [min(sample, len(cues) - 1) for sample in latest]
    rows = [(each.number, each.last, each.schema) for each in passes]
    number, last, schema = schemas.lengths.new_tensor(rows).unbind(dim=1)
    schemas.passes.live("last")[number] = last
    schemas.blocks.live("continuation")[schema] = cues[seen]
