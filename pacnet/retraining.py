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
_FAR_WORSE = 0.5  # a sequence that compares worse is a stub: it stays behind when the others renew


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


def compare(new: Quality, old: Quality, typical_length: float) -> float:
    """How good a new sequence is beside the old one: 1 where both are alike.

    Three ratios are multiplied: of their fits; of their roughness, the old one's over the new
    one's, at most 1, for a target that stands still is smooth and nothing more; and of how near
    their lengths are to the typical one, as shorter over longer.

    Args:
        new: of what the new episode shows.
        old: of what the node keeps.
        typical_length: geometric mean length of all sequences seen on this occasion.
    """
    smoothness = max(old.roughness, _SMOOTHEST) / max(new.roughness, _SMOOTHEST)
    if min(new.length, old.length) < 3:
        smoothness = 1.0  # there is nothing to compare
    completeness = _nearness(new.length, typical_length) / _nearness(old.length, typical_length)
    fit = new.fit / max(old.fit, _SMOOTHEST)
    return fit * min(smoothness, 1.0) * completeness


def settle(schemas: CompetingSchemas) -> None:
    """Compares each schema of an episode that is over with those that its node keeps.

    The sequences of one episode belong together: a glass is put down where the hand that took it
    thinks it stood. So an episode renews all schemas that it shares, or none. It does if, over all
    of them, it is not worse (`compare`, geometric mean over their targets) times the share of its
    targets that are in schemas it shares: a hand that misses the glass moves as smoothly as one
    that does not, and that something went wrong is seen in the rest of the episode alone.

    Args:
        schemas: changed; those of the episode are the ones whose support is `OPEN`.
    """
    support, lengths = schemas.blocks.live("support"), schemas.lengths
    fresh = (support == OPEN).nonzero().flatten().tolist()
    renews = _is_not_worse(schemas, fresh)
    dropped: list[int] = []
    for new in fresh:
        twin = _twin(schemas, new, dropped)
        support[new], schemas.blocks.live("typical_length")[new] = 1, float(lengths[new])
        if twin is None:
            dropped += _make_room(schemas, new, dropped)
        else:
            dropped.append(_merge(schemas, new, twin, renews))
    schemas.drop(torch.tensor(sorted(dropped), dtype=torch.int64, device=support.device))


def _is_not_worse(schemas: CompetingSchemas, fresh: list[int]) -> bool:
    """Whether an episode of these schemas may renew what it shares."""
    twins = {new: _twin(schemas, new, []) for new in fresh}
    shared = {new: twin for new, twin in twins.items() if twin is not None}
    targets = sum(int(schemas.lengths[new]) for new in shared)
    if targets == 0:
        return False
    logarithms = [
        int(schemas.lengths[new]) * math.log(max(_compare(schemas, new, twin), _SMOOTHEST))
        for new, twin in shared.items()
    ]
    familiarity = targets / sum(int(schemas.lengths[new]) for new in fresh)
    worth = familiarity * math.exp(sum(logarithms) / targets)
    return worth >= 1 - schemas.config.worse_by


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


def _merge(schemas: CompetingSchemas, new: int, twin: int, renews: bool) -> int:
    """One schema, seen once more: one sequence stays for both; returns the other."""
    support, typical = schemas.blocks.live("support"), schemas.blocks.live("typical_length")
    seen, length = int(support[twin]) + 1, _typical_length(schemas, new, twin)
    renewed = renews and _compare(schemas, new, twin) >= _FAR_WORSE
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
    worth = compare(
        _quality(schemas, new),
        _quality(schemas, weakest),
        float(schemas.blocks.live("typical_length")[weakest]),
    )
    return [weakest if worth >= 1 - schemas.config.worse_by else new]


def _compare(schemas: CompetingSchemas, new: int, twin: int) -> float:
    length = _typical_length(schemas, new, twin)
    return compare(_quality(schemas, new), _quality(schemas, twin), length)


def _typical_length(schemas: CompetingSchemas, new: int, twin: int) -> float:
    """The geometric mean of the lengths of a kept schema's sequences and of a new one."""
    typical = float(schemas.blocks.live("typical_length")[twin])
    seen = int(schemas.blocks.live("support")[twin]) + 1
    return typical * (float(schemas.lengths[new]) / typical) ** (1 / seen)


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
