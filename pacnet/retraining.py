"""Whether a node's schema is better replaced by what a new episode shows, or kept.

Maistros, Marom & Hayes (2001), "The Integrated System", overwrite a schema by each new episode and
call that crude. Here a new sequence of targets must not be worse than the old one.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import torch
from torch import Tensor

if TYPE_CHECKING:
    from pacnet.competing_schemas import CompetingSchemas

OPEN = 0
"""Support of a schema whose episode is not over."""

_SMOOTHEST = 1e-4  # [units of a target] roughness below which smoother is not better


class Quality(NamedTuple):
    """What speaks for a sequence of targets."""

    fit: float
    """Mean activation of its node by its cues, in (0, 1]."""
    roughness: float
    """How far its targets jump off their own course; see `roughness`."""
    length: int
    """Number of its targets."""


def roughness(targets: Tensor) -> float:
    """Root mean square distance of each target from the middle of both its neighbours in time.

    A tremor, lost tracking or a jump makes it large; a smooth movement of any speed leaves it
    small. It is the sequence's consistency with itself, in units of a target.

    Args:
        targets: `[L, A]`; fewer than three have no course to leave, and give 0.
    """
    if len(targets) < 3:
        return 0.0
    middle = (targets[:-2] + targets[2:]) / 2
    return float((targets[1:-1] - middle).square().sum(dim=1).mean().sqrt())


def is_not_worse(
    new: Quality,
    old: Quality,
    typical_length: float,
    worse_by: float,
    familiarity: float = 1.0,
) -> bool:
    """Whether the new sequence may take the old one's place.

    Three ratios are multiplied, each 1 where both are alike: of their fits; of their roughness, the
    old one's over the new one's, at most 1, for a target that stands still is smooth and nothing
    more; and of how near their lengths are to the typical one, as shorter over longer. Their
    product, times the familiarity of the new episode, must be at least 1 − `worse_by`. A hand that
    misses the glass moves as smoothly as one that does not: that something went wrong is seen in
    the rest of the episode alone.

    Args:
        new: of what the new episode shows.
        old: of what the node keeps.
        typical_length: geometric mean length of all sequences seen on this occasion, the new one's
            included.
        worse_by: how much worse is still not worse, in [0, 1).
        familiarity: share of the new episode's targets in sequences that are like kept ones.
    """
    smoothness = max(old.roughness, _SMOOTHEST) / max(new.roughness, _SMOOTHEST)
    if min(new.length, old.length) < 3:
        smoothness = 1.0  # there is nothing to compare
    completeness = _nearness(new.length, typical_length) / _nearness(old.length, typical_length)
    fit = new.fit / max(old.fit, _SMOOTHEST)
    return fit * min(smoothness, 1.0) * completeness * familiarity >= 1 - worse_by


def settle(schemas: CompetingSchemas) -> None:
    """Compares each schema of an episode that is over with those that its node keeps.

    Args:
        schemas: changed; those of the episode are the ones whose support is `OPEN`.
    """
    support, lengths = schemas.blocks.live("support"), schemas.lengths
    fresh = (support == OPEN).nonzero().flatten().tolist()
    known = sum(int(lengths[new]) for new in fresh if _twin(schemas, new, []) is not None)
    familiarity = known / max(1, sum(int(lengths[new]) for new in fresh))
    dropped: list[int] = []
    for new in fresh:
        twin = _twin(schemas, new, dropped)
        support[new], schemas.blocks.live("typical_length")[new] = 1, float(lengths[new])
        if twin is None:
            dropped += _make_room(schemas, new, dropped)
        else:
            dropped.append(_merge(schemas, new, twin, familiarity))
    schemas.drop(torch.tensor(sorted(dropped), dtype=torch.int64, device=support.device))


def _kept(schemas: CompetingSchemas, new: int, dropped: list[int]) -> list[int]:
    """The other schemas that the node of this one keeps so far."""
    support, node = schemas.blocks.live("support"), int(schemas.blocks.live("node")[new])
    others = [old for old in schemas.schemas_of(node).tolist() if old not in (new, *dropped)]
    return [old for old in others if int(support[old]) != OPEN]


def _twin(schemas: CompetingSchemas, new: int, dropped: list[int]) -> int | None:
    """The kept schema of the same node that is most like this one, if it is like it at all."""
    distances = {old: _distance(schemas, new, old) for old in _kept(schemas, new, dropped)}
    twin = min(distances, key=lambda old: distances[old], default=None)
    if twin is None or math.exp(-distances[twin]) < schemas.config.alike_above:
        return None
    return twin


def _merge(schemas: CompetingSchemas, new: int, twin: int, familiarity: float) -> int:
    """One schema, seen once more: the better sequence stays for both; returns the other."""
    support, typical = schemas.blocks.live("support"), schemas.blocks.live("typical_length")
    seen = int(support[twin]) + 1
    length = float(typical[twin] * (typical[new] / typical[twin]) ** (1 / seen))
    renewed = _not_worse(schemas, new, twin, length, familiarity)
    stays, goes = (new, twin) if renewed else (twin, new)
    support[stays], typical[stays] = seen, length
    through = schemas.passes.live("schema")
    through[through == goes] = stays
    return goes


def _make_room(schemas: CompetingSchemas, new: int, dropped: list[int]) -> list[int]:
    """The schema that goes, if any must, for its node to keep one of another kind."""
    kept = _kept(schemas, new, dropped)
    if len(kept) < schemas.config.schemas_per_node:
        return []
    support = schemas.blocks.live("support")
    weakest = min(kept, key=lambda old: int(support[old]))
    if int(support[weakest]) > 1:  # nothing that was seen again gives way to what was seen once
        return [new]
    length = float(schemas.blocks.live("typical_length")[weakest])
    return [weakest if _not_worse(schemas, new, weakest, length) else new]


def _not_worse(
    schemas: CompetingSchemas, new: int, old: int, typical_length: float, familiarity: float = 1.0
) -> bool:
    qualities = _quality(schemas, new), _quality(schemas, old)
    return is_not_worse(*qualities, typical_length, schemas.config.worse_by, familiarity)


def _quality(schemas: CompetingSchemas, schema: int) -> Quality:
    fit, length = float(schemas.blocks.live("fit")[schema]), int(schemas.lengths[schema])
    return Quality(fit, roughness(schemas.targets(schema)), length)


def _distance(schemas: CompetingSchemas, one: int, other: int) -> float:
    """How unlike two schemas are, in scaled units: their cues, or what came after them."""
    shorter, longer = sorted((schemas.cues(one), schemas.cues(other)), key=len)
    cues = torch.cdist(shorter, longer).amin(dim=1).mean()
    after = schemas.blocks.live("continuation")
    return float(torch.maximum(cues, torch.linalg.vector_norm(after[one] - after[other])))


def _nearness(length: float, typical: float) -> float:
    return min(length, typical) / max(length, typical)
