"""The network on percepts with which float32 computes exactly: cues equally near, and parts."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import torch
from numpy.typing import NDArray
from torch import Tensor

from pacnet import CompetingSchemasConfig, MotorSchemasConfig, PACNet, PACNetConfig, SOFMConfig

GRID = 1 / 64  # [unit] on multiples of it distances and sums of targets are exact in float32


def on_the_grid(rows: Tensor) -> Tensor:
    return (rows / GRID).round() * GRID


def crowd(samples: int, seed: int, dimensions: int = 5) -> Tensor:
    """Percepts `[T, D]` around four places, of few different coordinates: many are equally far."""
    generator = torch.Generator().manual_seed(seed)
    places = 4.0 * torch.eye(dimensions)[:4]
    at = places[torch.randint(4, (samples,), generator=generator)]
    apart = torch.randint(-1, 2, (samples, dimensions), generator=generator)
    return on_the_grid(at + apart / 8)


def aims(samples: int, seed: int) -> Tensor:
    """Targets `[T, 5]`, hardly two alike, so that any other choice among them would show."""
    generator = torch.Generator().manual_seed(seed)
    return on_the_grid(16 * torch.rand(samples, 5, generator=generator))


def mean_of_nearest(
    cues: NDArray[np.float32],
    targets: NDArray[np.float32],
    percept: NDArray[np.float32],
    count: int,
) -> tuple[NDArray[np.float32], int, bool]:
    """The mean target of the nearest cues, the place of the first, whether there are more as near.

    In float64, by a sort that keeps the order of equals.
    """
    distance = np.square(cues.astype(np.float64) - percept).sum(axis=1)
    order = np.argsort(distance, kind="stable")
    tied = count < len(order) and distance[order[count - 1]] == distance[order[count]]
    return targets[order[:count]].mean(axis=0, dtype=np.float64), int(order[0]), bool(tied)


@pytest.mark.parametrize("nearest_cues", [1, 2, 50, 1000])
def test_of_cues_equally_near_the_first_count(nearest_cues: int):
    # Nodes go all the way to a percept, and so stay on the grid.
    attention = SOFMConfig.paper(5, winner_rate=1.0, neighbour_rate=0.0, novelty_threshold=0.3)
    schemas = MotorSchemasConfig(5, 5, nearest_cues=nearest_cues)
    network = PACNet(PACNetConfig(attention, schemas))
    network.observe(crowd(1500, 0), aims(1500, 0), episode=0)
    assert network.schemas.lengths.max() > 200
    percepts, ties = crowd(200, 1), 0
    recall = network.recall(percepts)
    assert recall.has_target.all()
    for sample, percept in enumerate(percepts.numpy()):
        node = int(recall.winner[sample])
        rows = network.schemas.cues(node).numpy(), network.schemas.targets(node).numpy()
        target, first, tied = mean_of_nearest(*rows, percept, nearest_cues)
        np.testing.assert_allclose(recall.target[sample], target, rtol=2e-7)
        assert int(recall.offset[sample]) == first
        ties += tied
    assert ties > 50 or nearest_cues == 1000  # which is all there are


@pytest.mark.parametrize("schemas", [MotorSchemasConfig(2, 2), CompetingSchemasConfig(2, 2)])
@pytest.mark.parametrize("preset", ["paper", "gwr"])
def test_parts_of_an_episode_add_up_to_it_with_both_engines_of_the_map(
    preset: str, schemas: Any, monkeypatch: pytest.MonkeyPatch
):
    """Nodes are made, deleted and moved down in between; Ctrl-C has a chance every few samples."""
    monkeypatch.setattr("pacnet.attention.compiled._WORK", 100)
    generator = torch.Generator().manual_seed(1)
    way = (0.3 * torch.randn(366, 2, generator=generator)).cumsum(0) % 3
    percepts = on_the_grid(way).repeat_interleave(3, dim=0)  # [1098, 2]
    targets = torch.arange(2.0 * len(percepts)).reshape(-1, 2)
    fields = {"novelty_threshold": 0.5, "winner_rate": 1.0, "winner_tau": 1.5, "max_edge_age": 3}
    fields |= {"neighbour_rate": 0.0, "habituation_scales_learning": False}
    fields |= {"insert_at": "percept", "ignore_when_habituated": False}
    config = PACNetConfig(getattr(SOFMConfig, preset)(2, **fields), schemas)

    whole, parts = PACNet(config, engine="compiled"), PACNet(config, engine="compiled")
    eager = PACNet(config, engine="eager")
    observed = whole.observe(percepts, targets, 0)
    assert observed.deleted.sum() > 10
    assert eager.observe(percepts, targets, 0).deleted.equal(observed.deleted)
    for start, stop in ((0, 1), (1, 7), (7, 1000), (1000, 1098)):
        parts.observe(percepts[start:stop], targets[start:stop], 0)
    expected = whole.state_dict()
    assert expected["schemas.blocks.length"].sum() > 200
    for other in (parts, eager):
        for name, tensor in other.state_dict().items():
            if name == "schemas.blocks.fit":  # of activations, which engines round differently
                torch.testing.assert_close(tensor, expected[name], rtol=1e-5, atol=0)
            else:
                assert torch.equal(tensor, expected[name]), name
