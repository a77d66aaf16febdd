"""Episodic memory by itself: a store of schemas and visits, which neither learns nor recalls."""

from __future__ import annotations

import pytest
import torch

from pacnet.schemas.interface import Schemas
from pacnet.schemas.memory import EpisodicMemory, EpisodicMemoryConfig


def make_memory() -> EpisodicMemory:
    """Three nodes with two, one and one schema, and two episodes that visited them all.

    Schema s has s + 1 targets of value s.
    """
    memory = EpisodicMemory(EpisodicMemoryConfig(1, percept_dimensions=1))
    assert [memory.add_node() for _ in range(3)] == [0, 1, 2]
    memory.behaviours = ["tea"]
    for number in (3, 7):
        memory.episodes.append({"number": number, "behaviour": 0, "samples": 10, "last_cue": 0.0})
    for schema, node in enumerate((0, 1, 0, 2)):
        length, start = schema + 1, len(memory.pool)
        block = {"start": start, "length": length, "capacity": length, "node": node}
        memory.blocks.append({**block, "shown_in": 0, "support": 2, "typical_length": length})
        for frame in range(length):
            memory.pool.append({"target": schema, "cue": node, "frame": frame})
        for episode in range(2):
            visit = {"episode": episode, "schema": schema, "first": 0, "last": schema}
            memory.visits.append(visit)
    return memory


def contents(memory: EpisodicMemory) -> list[tuple[int, list[float]]]:
    """Node and targets of each schema."""
    nodes = memory.blocks.live("node").tolist()
    return [(node, memory.targets(schema)[:, 0].tolist()) for schema, node in enumerate(nodes)]


def test_a_memory_is_a_store_alone_and_its_state_a_valid_one():
    memory = make_memory()
    assert not isinstance(memory, Schemas)
    assert len(memory) == 3
    assert contents(memory) == [(0, [0]), (1, [1] * 2), (0, [2] * 3), (2, [3] * 4)]
    assert memory.frames(2).tolist() == [0, 1, 2]
    memory.check()
    loaded = EpisodicMemory(memory.config)
    loaded.load_state_dict(memory.state_dict())
    assert contents(loaded) == contents(memory)
    assert loaded.behaviours == ["tea"]


def test_schemas_of_a_node_are_found():
    memory = make_memory()
    memory.add_node()
    assert [memory.schemas_of(node).tolist() for node in range(4)] == [[0, 2], [1], [3], []]
    for node in (-1, 4):
        with pytest.raises(ValueError, match=f"node from 0 to 3, got {node}"):
            memory.schemas_of(node)


def test_dropped_schemas_go_with_their_visits_and_later_ones_move_down():
    memory = make_memory()
    memory.drop(torch.tensor([0, 1]))
    assert contents(memory) == [(0, [2] * 3), (2, [3] * 4)]
    assert memory.visits.live("schema").tolist() == [0, 0, 1, 1]
    assert memory.visits.live("last").tolist() == [2, 2, 3, 3]
    assert len(memory) == 3
    memory.check_state(memory.state_dict())


def test_a_deleted_node_goes_with_its_schemas_and_later_ones_move_down():
    memory = make_memory()
    memory.delete(torch.tensor([0]))
    assert len(memory) == 2
    assert contents(memory) == [(0, [1] * 2), (1, [3] * 4)]
    assert memory.visits.live("schema").tolist() == [0, 0, 1, 1]
    memory.check_state(memory.state_dict())


@pytest.mark.parametrize("which", [[1, 0], [4], [-1]])
def test_what_is_not_there_is_neither_dropped_nor_deleted(which: list[int]):
    memory = make_memory()
    for remove in (memory.drop, memory.delete):
        with pytest.raises(ValueError, match="expected"):
            remove(torch.tensor(which))
        assert len(contents(memory)) == 4
        assert len(memory) == 3
