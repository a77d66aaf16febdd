"""The rules of motor schemas within a budget, target by target: a specification for tests."""

from __future__ import annotations

import itertools
from dataclasses import dataclass, field

from torch import Tensor

from pacnet.attention.records import NO_NODE
from pacnet.schemas.interface import NO_EPISODE, Samples


@dataclass
class Shown:
    """A target that is kept."""

    target: Tensor
    cue: Tensor
    count: int = 1


@dataclass
class Node:
    """A node's sequence, and what is known of it."""

    kept: list[Shown] = field(default_factory=list)
    episode: int = NO_EPISODE
    habituated_at: int = NO_NODE
    forgotten: int = 0


class SlowSchemas:
    """Targets of nodes within a budget, in lists."""

    def __init__(self, nodes: int, budget: int) -> None:
        self.nodes = [Node() for _ in range(nodes)]
        self.budget = budget

    def add_samples(self, samples: Samples, episode: int) -> None:
        """Add the habituated samples, one after the other."""
        for sample in samples.habituated.nonzero().flatten().tolist():
            node = self.nodes[int(samples.node[sample])]
            shown = Shown(samples.target[sample].clone(), samples.cue[sample].clone())
            self._add(node, shown, int(samples.habituated_at[sample]), episode)
            if sum(len(one.kept) for one in self.nodes) > self.budget:
                self._make_room(node)

    def _add(self, node: Node, shown: Shown, since: int, episode: int) -> None:
        if node.episode != episode:
            node.kept, node.forgotten, node.episode = [], 0, episode
        if node.habituated_at != since and NO_NODE not in (node.habituated_at, since):
            node.forgotten = len(node.kept)
        node.habituated_at = since
        node.kept.append(shown)
        self._drop_forgotten(node)

    def _make_room(self, added: Node) -> None:
        node = max(self.nodes, key=lambda one: len(one.kept))  # the first of several
        if len(node.kept) < 2:
            others = [one for one in self.nodes if one.kept and one is not added]
            min(others, key=lambda one: one.habituated_at).kept.clear()
        elif node.forgotten:
            self._drop_forgotten(node)
        else:
            _merge(node.kept)

    @staticmethod
    def _drop_forgotten(node: Node) -> None:
        if node.forgotten:
            del node.kept[0]
            node.forgotten -= 1


def _merge(kept: list[Shown]) -> None:
    pairs = itertools.combinations(kept, 2)
    one, other = min(pairs, key=lambda pair: float(_apart(*pair)))  # the first of several
    share = other.count / (one.count + other.count)
    for name in ("target", "cue"):
        first, second = getattr(one, name).double(), getattr(other, name).double()
        setattr(one, name, (first + share * (second - first)).to(one.target))
    one.count += other.count
    kept[:] = [shown for shown in kept if shown is not other]


def _apart(one: Shown, other: Shown) -> Tensor:
    return (one.cue.double() - other.cue.double()).square().sum()
