"""Both engines of the whole network: they learn the same, recall the same and do the same."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import torch
from numpy.typing import NDArray
from torch import Tensor

from pacnet import (
    CompetingSchemasConfig,
    ForwardModel,
    MLPForwardModel,
    MLPForwardModelConfig,
    MotorSchemasConfig,
    PACNet,
    PACNetConfig,
    SOFMConfig,
)
from pacnet.competing_recall import CompetingRecall
from pacnet.compiled_recall import CompiledRecall

GRID = 1 / 64  # [unit] on multiples of it distances and sums of targets are exact in float32
CANDIDATES = tuple((x, y, 0.0, 0.0, 0.0) for x in (-0.3, 0.0, 0.35) for y in (-0.25, 0.0, 0.3))


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


def both(schemas: Any, model: ForwardModel | None = None) -> list[PACNet]:
    """An eager and a compiled one; nodes go all the way to a percept, and so stay on the grid."""
    attention = SOFMConfig.paper(5, winner_rate=1.0, neighbour_rate=0.0, novelty_threshold=0.3)
    config = PACNetConfig(attention, schemas)
    return [PACNet(config, model, engine) for engine in ("eager", "compiled")]


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
def test_of_cues_equally_near_the_first_count_in_both_engines(nearest_cues: int):
    networks = both(MotorSchemasConfig(5, 5, nearest_cues=nearest_cues))
    for network in networks:
        network.observe(crowd(1500, 0), aims(1500, 0), episode=0)
    eager, compiled = networks
    assert eager.schemas.lengths.max() > 200
    percepts, ties = crowd(200, 1), 0
    one, other = eager.recall(percepts), compiled.recall(percepts)
    assert one.commanded.all()
    for recall in (one, other):
        for sample, percept in enumerate(percepts.numpy()):
            node = int(recall.winner[sample])
            rows = eager.schemas.cues(node).numpy(), eager.schemas.targets(node).numpy()
            target, first, tied = mean_of_nearest(*rows, percept, nearest_cues)
            np.testing.assert_allclose(recall.targets[sample], target, rtol=2e-7)
            assert int(recall.position[sample]) == first
            ties += tied
    assert ties > 100 or nearest_cues == 1000  # which is all there are
    for name, value in one._asdict().items():
        torch.testing.assert_close(getattr(other, name), value, rtol=2e-6, atol=0)


SCHEMAS = {
    "nearest cue": MotorSchemasConfig(5, 5),
    "fifty nearest cues": MotorSchemasConfig(5, 5, nearest_cues=50),
    "order": MotorSchemasConfig(5, 5, recall_by="order"),
    "several schemas": CompetingSchemasConfig(5, 5, nearest_cues=7),
    "several that stay": CompetingSchemasConfig(5, 5, margin=0.1, threshold=0.2),
}


@pytest.mark.parametrize("schemas", SCHEMAS)
def test_both_engines_act_the_same(schemas: str):
    config = MLPForwardModelConfig(5, 5, CANDIDATES, hidden=(8,), abstain_below=0.14)
    networks = both(SCHEMAS[schemas], MLPForwardModel(config, seed=1))
    for episode in range(2):
        percepts, targets = crowd(400, episode), aims(400, episode)
        for network in networks:
            network.observe(percepts, targets, episode, f"way {episode}")
    asked = torch.cat([crowd(60, 7), torch.full((2, 5), 9.0), crowd(60, 8)])
    states = asked + 0.5 * torch.randn(asked.shape, generator=torch.Generator().manual_seed(2))
    one, other = (network.act(asked, states) for network in networks)
    assert one.given.sum() > 30
    assert one.abstained.sum() > 30
    assert one.recall.novelty.sum() == 2
    assert torch.equal(one.given, other.given)
    assert torch.equal(one.action.nan_to_num(99), other.action.nan_to_num(99))
    for name, value in one.recall._asdict().items():
        got = getattr(other.recall, name)
        torch.testing.assert_close(got, value, rtol=2e-6, atol=0, equal_nan=True)


@pytest.mark.parametrize("schemas", [MotorSchemasConfig(2, 2), CompetingSchemasConfig(2, 2)])
@pytest.mark.parametrize("preset", ["paper", "gwr"])
def test_more_than_is_learned_at_once_equals_parts_of_it_in_both_engines(preset: str, schemas: Any):
    """Chunks end at 1,024 samples; nodes are made, deleted and moved down in between."""
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


def test_both_engines_recognise_the_same():
    networks = both(CompetingSchemasConfig(5, 5))
    for episode in range(4):
        for network in networks:
            percepts, targets = crowd(300, episode), aims(300, episode)
            network.observe(percepts, targets, episode, f"way {episode % 2}")
    watched = torch.cat([crowd(40, 1), crowd(40, 9)]) + GRID
    one, other = (network.recognise(watched) for network in networks)
    assert len(one.behaviour.unique()) == 2
    for name, value in one._asdict().items():
        torch.testing.assert_close(getattr(other, name), value, rtol=2e-5, atol=2e-6)


def test_schemas_that_compete_are_compiled_only_where_kernels_run():
    network = PACNet(PACNetConfig(SOFMConfig.paper(5), CompetingSchemasConfig(5, 5)))
    network.observe(crowd(300, 0), aims(300, 0), episode=0)
    assert isinstance(network.schemas.new_recall(), CompiledRecall)
    network.double()
    assert type(network.schemas.new_recall()) is CompetingRecall
    assert network.recall(crowd(20, 1).double()).commanded.any()
    network.schemas.engine = "compiled"
    with pytest.raises(ValueError, match=r"expected float32 on the CPU .*, got torch\.float64"):
        network.schemas.new_recall()
