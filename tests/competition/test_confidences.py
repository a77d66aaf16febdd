"""How confident a node's schemas are, against plain loops over passes and cues."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from torch import Tensor

from pacnet import NO_NODE, CompetingSchemas, CompetingSchemasConfig, RecognitionConfig
from pacnet.competition.confidences import SchemaConfidences
from pacnet.competition.recall import CompetingRecall

NODES, PLACES = 4, 16


def make_random(seed: int) -> CompetingSchemas:
    """Episodes of 10 to 60 samples; each begins and ends at a habituated node."""
    generator = torch.Generator().manual_seed(seed)
    config = CompetingSchemasConfig(
        1, percept_dimensions=2, lookahead_samples=2, recognition=RecognitionConfig(n_states=PLACES)
    )
    schemas = CompetingSchemas(config)
    for _ in range(NODES):
        schemas.add_node()
    for episode in range(10):
        schemas.begin(episode, "")
        stays = torch.randint(2, 13, (5,), generator=generator)
        nodes = torch.randint(NODES, (5,), generator=generator).repeat_interleave(stays)
        for node in nodes.tolist():
            cue = node + 0.1 * torch.randn(2, generator=generator)
            schemas.write(node, cue[:1], cue, activation=0.8, habituated=True)
    return schemas


def watched_by_hand(schemas: CompetingSchemas, schema: int, probability: Tensor) -> float:
    """The belief in all places of all passes through a schema."""
    columns = [
        schemas.visits.live(name).tolist() for name in ("schema", "episode", "first", "last")
    ]
    samples, watched = schemas.episodes.live("samples").tolist(), 0.0
    for through, episode, first, last in zip(*columns, strict=True):
        begin, end = (sample * PLACES / samples[episode] for sample in (first, last + 1))
        # Whole places up to its end; at least the one in which its last sample begins.
        stop = max(math.floor(end), math.floor(last * PLACES / samples[episode]) + 1)
        if through == schema:
            watched += float(probability[episode, math.floor(begin) : stop].sum())
    return watched


@pytest.mark.parametrize("seed", range(3))
def test_confidence_is_the_belief_in_the_passes_times_the_fit_of_the_nearest_cue(seed: int):
    schemas = make_random(seed)
    timeline = schemas.timeline()
    assert timeline is not None
    assert timeline.episode.tolist() == list(range(10))
    generator = torch.Generator().manual_seed(seed + 10)
    several = 0
    for node in range(NODES):
        numbers = schemas.schemas_of(node)
        here = SchemaConfidences(schemas, numbers, timeline)
        assert here.ids == numbers.tolist()
        several += len(schemas.lengths[numbers].unique()) > 1
        for _ in range(3):
            probability = torch.rand(10, PLACES, dtype=torch.float64, generator=generator) / 100
            percept = node + torch.randn(2, generator=generator)
            distances = CompetingRecall(schemas, schemas.config, timeline).distances(
                percept.numpy()
            )
            confidences = here.confidences(distances, probability.numpy())
            for schema, confidence in zip(here.ids, confidences.tolist(), strict=True):
                near = min((percept - cue).norm().item() for cue in schemas.cues(schema))
                watched = watched_by_hand(schemas, schema, probability)
                assert confidence == pytest.approx(watched * math.exp(-near), rel=1e-5)
    assert several == NODES  # short and long ones side by side


def test_no_confidence_is_over_one():
    schemas = make_random(0)
    timeline = schemas.timeline()
    assert timeline is not None
    here = SchemaConfidences(schemas, schemas.schemas_of(0), timeline)
    certain = np.ones(timeline.rows.shape)  # which rounding may exceed
    near = np.zeros(len(schemas.pool), np.float32)
    assert here.confidences(near, certain).tolist() == [1.0] * len(here.ids)


def test_the_place_of_a_schema_and_its_rows():
    schemas = make_random(0)
    timeline = schemas.timeline()
    assert timeline is not None
    here = SchemaConfidences(schemas, schemas.schemas_of(1), timeline)
    for place, schema in enumerate(here.ids):
        assert here.index_of(schema) == place
        assert torch.equal(schemas.pool.live("cue")[here.rows_of(place)], schemas.cues(schema))
    stranger = int(schemas.schemas_of(0)[0])
    assert here.index_of(stranger) == here.index_of(NO_NODE) == NO_NODE


def test_what_is_laid_out_for_more_than_it_is_given_is_refused():
    schemas = make_random(0)
    timeline = schemas.timeline()
    assert timeline is not None
    here = SchemaConfidences(schemas, schemas.schemas_of(0), timeline)
    near = np.zeros(len(schemas.pool), np.float32)
    with pytest.raises(ValueError, match="of all that is known"):
        here.confidences(near[:1], timeline.start)
    with pytest.raises(ValueError, match="of all that is known"):
        here.confidences(near, timeline.start[:, :1])
