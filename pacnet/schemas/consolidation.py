"""Consolidation: decide whether a new episode's schemas replace those kept.

Maistros, Marom & Hayes (2001), "The Integrated System", overwrite a schema by each new episode and
call that crude. Here a new sequence of targets must not be worse than the old one.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import torch
from torch import Tensor

from pacnet.core.growable_rows import in_single
from pacnet.schemas.memory import EpisodicMemory
from pacnet.schemas.state_checks import OPEN

_SMOOTHEST = 1e-4  # [units of a target] roughness below which smoother is not better
_FAR_WORSE = 0.5  # a sequence of lower quality is not renewed even where its episode renews others


class Quality(NamedTuple):
    """Quality measures of a sequence of targets."""

    fit: float
    """Mean activation of its node by its cues, in (0, 1]."""
    roughness: float
    """See `roughness`."""
    length: int
    """Number of its targets."""


def roughness(targets: Tensor) -> float:
    """Return the RMS distance of each target from the middle of its neighbours in time.

    Tremor, lost tracking and jumps make it large. A smooth movement of any speed leaves it small.

    Args:
        targets: `[L, A]`; fewer than three give 0.
    """
    if len(targets) < 3:
        return 0.0
    middle = (targets[:-2] + targets[2:]) / 2
    return float((targets[1:-1] - middle).square().sum(dim=1).mean().sqrt())


def compare(new: Quality, old: Quality, typical_length: float) -> float:
    """Return how good a new sequence is relative to an old one: 1 where they are alike.

    The product of three ratios: of their fits; of their roughness, old over new, at most 1 (a
    target that does not move is smooth, but not better); and of how near their lengths are to the
    typical one, as shorter over longer.

    Args:
        new: of the sequence from the new episode.
        old: of the sequence that the node keeps.
        typical_length: geometric mean length of all sequences of this schema.
    """
    smoothness = max(old.roughness, _SMOOTHEST) / max(new.roughness, _SMOOTHEST)
    if min(new.length, old.length) < 3:
        smoothness = 1.0  # roughness is not defined
    completeness = _nearness(new.length, typical_length) / _nearness(old.length, typical_length)
    fit = new.fit / max(old.fit, _SMOOTHEST)
    return fit * min(smoothness, 1.0) * completeness


def consolidate(memory: EpisodicMemory) -> None:
    """Compare each schema of a finished episode with those that its node keeps, in place.

    The sequences of one episode belong together: a glass is put down where the hand that took it
    expects it. An episode therefore renews all schemas that it shares with earlier ones, or none.
    It renews them if its quality has not dropped by more than `max_quality_drop`. The quality is
    the geometric mean of `compare` over the targets of all shared schemas, times the share of the
    episode's targets that lie in shared schemas. The share matters because a hand that misses the
    glass moves as smoothly as one that does not: only the rest of the episode shows the error.
    """
    known = _Comparison(memory)
    renews = _is_not_worse(known)
    evicted: set[int] = set()
    for new in known.new:
        match = known.match(new, evicted)
        known.support[new], known.typical_length[new] = 1, float(known.lengths[new])
        if match is None:
            evicted |= _evict_weakest(known, new, evicted)
        else:
            evicted.add(_merge(known, new, match, renews))
    support = memory.blocks.live("support")
    support.copy_(support.new_tensor(known.support))
    memory.drop(support.new_tensor(sorted(evicted)))


class _Comparison:
    """All schemas at the end of an episode, and the values they are compared by."""

    def __init__(self, memory: EpisodicMemory) -> None:
        self.config = memory.config
        self.visited = memory.visits.live("schema")
        self.typical_length = memory.blocks.live("typical_length")
        self.lengths: list[int] = memory.lengths.tolist()
        self.support: list[int] = memory.blocks.live("support").tolist()
        self.new = [schema for schema, seen in enumerate(self.support) if seen == OPEN]
        self._memory = memory
        self._after = in_single(memory.blocks.live("continuation"))
        self._candidates = self._with_like_continuation()
        self._distances: dict[tuple[int, int], float] = {}
        self._qualities: dict[int, Quality] = {}

    def kept(self, new: int, evicted: set[int]) -> list[int]:
        """Return the other schemas that its node keeps so far."""
        node = int(self._memory.blocks.live("node")[new])
        return self._remaining(self._memory.schemas_of(node).tolist(), new, evicted)

    def match(self, new: int, evicted: set[int]) -> int | None:
        """Return the kept schema of the same node that is the same one, seen before, if any."""
        old = self._remaining(self._candidates.get(new, []), new, evicted)
        match = min(old, key=lambda old: self._distance(new, old), default=None)
        if match is None:
            return None
        similarity = math.exp(-self._distance(new, match))
        return None if similarity < self.config.same_schema_similarity else match

    def compare(self, new: int, old: int) -> float:
        """Return how good a new schema's sequence is relative to an old one's."""
        return compare(self.quality(new), self.quality(old), self.joint_length(new, old))

    def joint_length(self, new: int, old: int) -> float:
        """Return the geometric mean of the lengths of a kept schema's sequences and a new one."""
        typical, seen = float(self.typical_length[old]), self.support[old] + 1
        return typical * (float(self.lengths[new]) / typical) ** (1 / seen)

    def quality(self, schema: int) -> Quality:
        """Return the quality of a schema's sequence."""
        if schema not in self._qualities:
            fit = float(self._memory.blocks.live("fit")[schema])
            rough = roughness(self._memory.targets(schema))
            self._qualities[schema] = Quality(fit, rough, self.lengths[schema])
        return self._qualities[schema]

    def _remaining(self, others: list[int], new: int, evicted: set[int]) -> list[int]:
        kept = [old for old in others if old != new and old not in evicted]
        return [old for old in kept if self.support[old] != OPEN]

    def _with_like_continuation(self) -> dict[int, list[int]]:
        """Return for each new schema those of its node with a like continuation, ascending."""
        node = self._memory.blocks.live("node")
        exact = "donot_use_mm_for_euclid_dist"
        apart = torch.cdist(self._after[self.new], self._after, compute_mode=exact)
        reach = -math.log(self.config.same_schema_similarity) * 1.001  # and rounding
        pairs = (apart <= reach) & (node[self.new][:, None] == node)
        alike: dict[int, list[int]] = {}
        for index, other in pairs.nonzero().tolist():
            alike.setdefault(self.new[index], []).append(other)
        return alike

    def _distance(self, one: int, other: int) -> float:
        """Return the distance of two schemas, normalized: of their cues or continuations."""
        if (one, other) not in self._distances:
            cues = self._memory.cues(one), self._memory.cues(other)
            shorter, longer = sorted(map(in_single, cues), key=len)
            apart = torch.cdist(shorter, longer).amin(dim=1).mean()
            after = torch.linalg.vector_norm(self._after[one] - self._after[other])
            self._distances[one, other] = float(torch.maximum(apart, after))
        return self._distances[one, other]


def _is_not_worse(known: _Comparison) -> bool:
    """Return whether an episode may renew the schemas it shares."""
    matches = {new: known.match(new, set()) for new in known.new}
    shared = {new: old for new, old in matches.items() if old is not None}
    targets = sum(known.lengths[new] for new in shared)
    if targets == 0:
        return False
    logarithms = [
        known.lengths[new] * math.log(max(known.compare(new, old), _SMOOTHEST))
        for new, old in shared.items()
    ]
    share = targets / sum(known.lengths[new] for new in known.new)
    quality = share * math.exp(sum(logarithms) / targets)
    return quality >= 1 - known.config.max_quality_drop


def _merge(known: _Comparison, new: int, match: int, renews: bool) -> int:
    """Make one schema of two, with the sequence of one of them; return the other."""
    support, length = known.support[match] + 1, known.joint_length(new, match)
    renewed = renews and known.compare(new, match) >= _FAR_WORSE
    stays, goes = (new, match) if renewed else (match, new)
    known.support[stays], known.typical_length[stays] = support, length
    known.visited[known.visited == goes] = stays
    return goes


def _evict_weakest(known: _Comparison, new: int, evicted: set[int]) -> set[int]:
    """Return the schema to delete, if any, so that the node keeps `schemas_per_node` at most."""
    kept = known.kept(new, evicted)
    if len(kept) < known.config.schemas_per_node:
        return set()
    weakest = min(kept, key=lambda old: known.support[old])
    if known.support[weakest] > 1:
        return {new}  # a schema seen once does not replace one seen again
    typical = float(known.typical_length[weakest])
    quality = compare(known.quality(new), known.quality(weakest), typical)
    return {weakest if quality >= 1 - known.config.max_quality_drop else new}


def _nearness(length: float, typical: float) -> float:
    return min(length, typical) / max(length, typical)
