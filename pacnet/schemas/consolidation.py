"""Whether a node's schema is better replaced by what a new episode shows, or kept.

Maistros, Marom & Hayes (2001), "The Integrated System", overwrite a schema by each new episode and
call that crude. Here a new sequence of targets must not be worse than the old one.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import torch
from torch import Tensor

from pacnet.schemas.sequences import in_single
from pacnet.schemas.state_checks import OPEN

if TYPE_CHECKING:
    from pacnet.competition.competing_schemas import CompetingSchemas

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
    known = _Known(schemas)
    renews = _is_not_worse(known)
    dropped: set[int] = set()
    for new in known.fresh:
        twin = known.twin(new, dropped)
        known.support[new], known.typical_length[new] = 1, float(known.lengths[new])
        if twin is None:
            dropped |= _make_room(known, new, dropped)
        else:
            dropped.add(_merge(known, new, twin, renews))
    support = schemas.blocks.live("support")
    support.copy_(support.new_tensor(known.support))
    schemas.drop(support.new_tensor(sorted(dropped)))


class _Known:
    """All schemas at the end of an episode; what they are compared by is worked out once."""

    def __init__(self, schemas: CompetingSchemas) -> None:
        self.config = schemas.config
        self.through = schemas.passes.live("schema")
        self.typical_length = schemas.blocks.live("typical_length")
        self.lengths: list[int] = schemas.lengths.tolist()
        self.support: list[int] = schemas.blocks.live("support").tolist()
        self.fresh = [schema for schema, seen in enumerate(self.support) if seen == OPEN]
        self._schemas = schemas
        self._after = in_single(schemas.blocks.live("continuation"))
        self._alike = self._perhaps_alike()
        self._distances: dict[tuple[int, int], float] = {}
        self._qualities: dict[int, Quality] = {}

    def kept(self, new: int, dropped: set[int]) -> list[int]:
        """The other schemas that the node of this one keeps so far."""
        node = int(self._schemas.blocks.live("node")[new])
        return self._so_far(self._schemas.schemas_of(node).tolist(), new, dropped)

    def twin(self, new: int, dropped: set[int]) -> int | None:
        """The kept schema of the same node that is most like this one, if it is like it at all."""
        old = self._so_far(self._alike.get(new, []), new, dropped)
        twin = min(old, key=lambda old: self._distance(new, old), default=None)
        if twin is None or math.exp(-self._distance(new, twin)) < self.config.alike_above:
            return None
        return twin

    def quality(self, schema: int) -> Quality:
        """Of its sequence of targets."""
        if schema not in self._qualities:
            fit = float(self._schemas.blocks.live("fit")[schema])
            rough = roughness(self._schemas.targets(schema))
            self._qualities[schema] = Quality(fit, rough, self.lengths[schema])
        return self._qualities[schema]

    def _so_far(self, others: list[int], new: int, dropped: set[int]) -> list[int]:
        kept = [old for old in others if old != new and old not in dropped]
        return [old for old in kept if self.support[old] != OPEN]

    def _perhaps_alike(self) -> dict[int, list[int]]:
        """For each fresh schema those of its node with a like continuation, ascending."""
        node = self._schemas.blocks.live("node")
        mode = "donot_use_mm_for_euclid_dist"  # which is less exact
        apart = torch.cdist(self._after[self.fresh], self._after, compute_mode=mode)
        reach = -math.log(self.config.alike_above) * 1.001  # and rounding
        pairs = (apart <= reach) & (node[self.fresh][:, None] == node)
        alike: dict[int, list[int]] = {}
        for place, other in pairs.nonzero().tolist():
            alike.setdefault(self.fresh[place], []).append(other)
        return alike

    def _distance(self, one: int, other: int) -> float:
        """How unlike two schemas are, in scaled units: their cues, or what came after them."""
        if (one, other) not in self._distances:
            cues = self._schemas.cues(one), self._schemas.cues(other)
            shorter, longer = sorted(map(in_single, cues), key=len)
            apart = torch.cdist(shorter, longer).amin(dim=1).mean()
            after = torch.linalg.vector_norm(self._after[one] - self._after[other])
            self._distances[one, other] = float(torch.maximum(apart, after))
        return self._distances[one, other]


def _is_not_worse(known: _Known) -> bool:
    """Whether an episode may renew what it shares."""
    twins = {new: known.twin(new, set()) for new in known.fresh}
    shared = {new: twin for new, twin in twins.items() if twin is not None}
    targets = sum(known.lengths[new] for new in shared)
    if targets == 0:
        return False
    logarithms = [
        known.lengths[new] * math.log(max(_compare(known, new, twin), _SMOOTHEST))
        for new, twin in shared.items()
    ]
    familiarity = targets / sum(known.lengths[new] for new in known.fresh)
    worth = familiarity * math.exp(sum(logarithms) / targets)
    return worth >= 1 - known.config.worse_by


def _merge(known: _Known, new: int, twin: int, renews: bool) -> int:
    """One schema, seen once more: one sequence stays for both; returns the other."""
    seen, length = known.support[twin] + 1, _typical_length(known, new, twin)
    renewed = renews and _compare(known, new, twin) >= _FAR_WORSE
    stays, goes = (new, twin) if renewed else (twin, new)
    known.support[stays], known.typical_length[stays] = seen, length
    known.through[known.through == goes] = stays
    return goes


def _make_room(known: _Known, new: int, dropped: set[int]) -> set[int]:
    """The schema that goes, if any must, for its node to keep one of another kind."""
    kept = known.kept(new, dropped)
    if len(kept) < known.config.schemas_per_node:
        return set()
    weakest = min(kept, key=lambda old: known.support[old])
    if known.support[weakest] > 1:  # nothing that was seen again gives way to what was seen once
        return {new}
    typical = float(known.typical_length[weakest])
    worth = compare(known.quality(new), known.quality(weakest), typical)
    return {weakest if worth >= 1 - known.config.worse_by else new}


def _compare(known: _Known, new: int, twin: int) -> float:
    length = _typical_length(known, new, twin)
    return compare(known.quality(new), known.quality(twin), length)


def _typical_length(known: _Known, new: int, twin: int) -> float:
    """The geometric mean of the lengths of a kept schema's sequences and of a new one."""
    typical, seen = float(known.typical_length[twin]), known.support[twin] + 1
    return typical * (float(known.lengths[new]) / typical) ** (1 / seen)


def _nearness(length: float, typical: float) -> float:
    return min(length, typical) / max(length, typical)
