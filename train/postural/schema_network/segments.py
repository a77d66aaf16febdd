"""Schemas divided by attention: all that one node of a map wins is one schema.

A schema made by hand is a stretch of one demonstration, so a posture that recurs is stored again
in the next stretch. A node wins wherever its posture recurs, in every demonstration.
"""

from __future__ import annotations

from collections.abc import Mapping
from itertools import groupby, pairwise
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray

from pacnet import NO_NODE, PACNet
from pacnet.attention.cutting import runs
from pacnet.network.schema_network import SchemaNetwork
from train.postural.episodes import motor_targets
from train.postural.schema_network.episodes import Shown, empty_schema_network, smooth
from train.postural.scores import winners_of

SHORTEST = 5  # [samples] that a node must win in a row; fewer are flicker at a border


class Stretch(NamedTuple):
    """A part of a demonstration."""

    first: int  # sample
    end: int  # sample after the last
    node: int  # that wins


class Division(NamedTuple):
    """Schemas, and how the demonstrations consist of them."""

    network: SchemaNetwork
    orders: dict[str, tuple[int, ...]]  # behaviour -> its schemas in their order, from 1


def divide(shown: Mapping[str, Shown], pacnet: PACNet) -> Division:
    """Return a schema for each node that wins a stretch of the demonstrations.

    Args:
        shown: Behaviour -> its demonstration.
        pacnet: Has learned them.
    """
    percepts = {name: smooth(one.percepts) for name, one in shown.items()}
    targets = {name: motor_targets(one.percepts) for name, one in shown.items()}
    parts = {name: stretches(winners_of(pacnet, seen)) for name, seen in percepts.items()}
    nodes = list(dict.fromkeys(part.node for some in parts.values() for part in some))
    network = empty_schema_network()
    for node in nodes:
        own = [(name, part) for name, some in parts.items() for part in some if part.node == node]
        sequences = (
            np.concatenate([rows[name][part.first : part.end] for name, part in own])
            for rows in (percepts, targets)
        )
        network.add_schema(*map(torch.from_numpy, sequences))
    orders = {
        name: tuple(1 + nodes.index(node) for node, _ in groupby(part.node for part in some))
        for name, some in parts.items()
    }
    return Division(network, orders)


def stretches(winners: NDArray[np.int64]) -> list[Stretch]:
    """Return the stretches of a demonstration that a node wins; together they are all of it.

    Samples that no node wins for long enough belong to the stretch before them.

    Args:
        winners: Node that wins each sample, `NO_NODE` for none `[T]`.
    """
    lasting = [
        first
        for first, end in runs(winners)
        if winners[first] != NO_NODE and end - first >= SHORTEST
    ]
    bounds = pairwise([0, *lasting[1:], len(winners)])
    return [
        Stretch(*bound, int(winners[first])) for bound, first in zip(bounds, lasting, strict=True)
    ]
