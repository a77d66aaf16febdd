"""Lays the known episodes out in time: which stored percept is expected at each place of each."""

from __future__ import annotations

from typing import TYPE_CHECKING

import torch
from torch import Tensor

from pacnet.competition.belief import Timeline, make_timeline
from pacnet.schemas.sequences import rows_of

if TYPE_CHECKING:
    from pacnet.competition.competing_schemas import CompetingSchemas


def lay_out(schemas: CompetingSchemas, places: int) -> Timeline:
    """The timeline of all episodes that still have a schema.

    A place takes the row whose time in the episode is nearest to its middle. A schema that was
    shown in another episode is stretched to the time that this one took for it.

    Args:
        schemas: with at least one pass.
        places: P of each episode.
    """
    number, frame, row = shown(schemas)
    episode, samples = schemas.passes.live("episode")[number], schemas.episodes.live("samples")
    at = (frame + 0.5) / samples[episode] * places  # [S] in places
    place = at.floor().clamp(0, places - 1).long()
    table = _nearest_in_time(episode * places + place, (at - place - 0.5).abs(), row)
    rows = torch.full((len(samples) * places,), -1, device=row.device)
    rows[table[0]] = table[1]
    rows = rows.view(len(samples), places)
    known = (rows >= 0).any(dim=1).nonzero().flatten()
    behaviour = schemas.episodes.live("behaviour")
    return make_timeline(_filled(rows[known]), known, samples[known], behaviour[known])


def shown(schemas: CompetingSchemas) -> tuple[Tensor, Tensor, Tensor]:
    """Every sample that some pass stands for, pass by pass.

    Returns:
        Number of its pass, int64 `[S]`; its time in the episode, in samples, `[S]`; its row of the
        pool, int64 `[S]`.
    """
    passes = schemas.passes
    schema = passes.live("schema")
    lengths, starts = schemas.lengths[schema], schemas.blocks.live("start")[schema]
    number = torch.repeat_interleave(torch.arange(len(passes), device=schema.device), lengths)
    row = rows_of(starts, lengths)
    own = schemas.pool.live("frame")
    own_first, own_last = own[starts][number], own[starts + lengths - 1][number]
    share = (own[row] - own_first) / (own_last - own_first).clamp(min=1)
    first, last = passes.live("first")[number], passes.live("last")[number]
    return number, first + share * (last - first), row


def _nearest_in_time(place: Tensor, distance: Tensor, row: Tensor) -> tuple[Tensor, Tensor]:
    """Of several rows at one place the one nearest to its middle: the places and their rows."""
    order = distance.argsort(stable=True)
    order = order[place[order].argsort(stable=True)]
    place, row = place[order], row[order]
    first = torch.ones_like(place, dtype=torch.bool)
    first[1:] = place[1:] != place[:-1]
    return place[first], row[first]


def _filled(rows: Tensor) -> Tensor:
    """Rows `[E, P]` in which a place without one, −1, takes that of the nearest place in time."""
    places = torch.arange(rows.shape[1], device=rows.device).expand_as(rows)
    nowhere = 2 * rows.shape[1]
    before = places.where(rows >= 0, -nowhere).cummax(dim=1).values
    after = places.where(rows >= 0, nowhere).flip(1).cummin(dim=1).values.flip(1)
    nearest = before.where(places - before <= after - places, after)
    return rows.gather(1, nearest)
