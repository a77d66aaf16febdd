"""The store of cuts: what is appended is kept, and what is damaged is refused."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from pacnet.schemas.segments import SegmentMemory

CUTS = [[0, 0, 0, 1, 1], [-1], [1, 0, 0, 1]]  # the landmark of each frame of demonstrations


def memory_of(cuts: list[list[int]], landmarks: int = 2) -> SegmentMemory:
    memory = SegmentMemory(landmarks)
    for number, labels in enumerate(cuts):
        memory.append(number, np.array(labels), number)
    return memory


def test_cuts_are_kept_as_segments():
    columns = {name: column.tolist() for name, column in memory_of(CUTS).columns().items()}
    assert columns == {
        "demonstration": [0, 0, 1, 2, 2, 2],
        "frames": [3, 2, 1, 1, 2, 1],
        "landmark": [0, 1, -1, 1, 0, 1],
        "begins": [0, 0, 1, 2, 2, 2],
    }


def test_columns_are_copies():
    memory = memory_of(CUTS)
    memory.columns()["landmark"][:] = 9
    assert memory.columns()["landmark"].tolist() == [0, 1, -1, 1, 0, 1]


def test_many_cuts_are_kept():
    memory = memory_of([[number % 3 - 1] * 2 for number in range(200)])
    assert memory.columns()["demonstration"].tolist() == [*range(200)]
    assert (memory.columns()["frames"] == 2).all()


def test_a_state_survives_and_more_can_be_appended():
    memory, other = memory_of(CUTS), SegmentMemory(2)
    other.load_state_dict(memory.state_dict())
    memory.append(3, np.array([1]))
    other.append(3, np.array([1]))
    for name, column in memory.columns().items():
        assert other.columns()[name].tolist() == column.tolist()


def test_changes_are_noticed():
    memory = memory_of(CUTS)
    versions = memory.versions()
    assert versions.unchanged()
    memory.append(3, np.array([0]))
    assert not versions.unchanged()


@pytest.mark.parametrize(
    ("name", "row", "value", "message"),
    [
        ("landmark", 0, 2, "landmarks there are"),
        ("landmark", 0, -2, "landmarks there are"),
        ("frames", 2, 0, "segments of frames"),
        ("frames", 2, -1, "segments of frames"),
        ("demonstration", 0, -1, "demonstrations in order"),
        ("demonstration", 1, 3, "demonstrations in order"),
        ("begins", 0, 1, "beginnings there are"),
        ("begins", 2, 3, "beginnings there are"),
        ("begins", 2, -1, "beginnings there are"),
        ("begins", 4, 1, "beginnings there are"),
    ],
)
def test_damaged_numbers_are_refused(name: str, row: int, value: int, message: str):
    memory = memory_of(CUTS)
    state = {key: tensor.clone() for key, tensor in memory.state_dict().items()}
    state[f"rows.{name}"][row] = value
    with pytest.raises(ValueError, match=message):
        memory.load_state_dict(state)
    with pytest.raises(ValueError, match=message):
        SegmentMemory(2).load_state_dict(state)
    assert memory.columns()["landmark"].tolist() == [0, 1, -1, 1, 0, 1]
    assert memory.columns()["frames"].tolist() == [3, 2, 1, 1, 2, 1]


@pytest.mark.parametrize(
    "damaged", [torch.zeros(6), torch.zeros(5, dtype=torch.int64), torch.zeros(6, 1).long(), None]
)
def test_damaged_tensors_are_refused(damaged: torch.Tensor | None):
    memory = memory_of(CUTS)
    state = memory.state_dict()
    if damaged is None:
        del state["rows.frames"]
    else:
        state["rows.frames"] = damaged
    with pytest.raises((ValueError, RuntimeError), match=r"rows\.?.*"):
        memory.load_state_dict(state)
    assert memory.columns()["frames"].tolist() == [3, 2, 1, 1, 2, 1]


def test_cuts_must_be_of_whole_demonstrations():
    memory = memory_of(CUTS)
    memory.check_cuts(np.array([5, 1, 4]))
    SegmentMemory(2).check_cuts(np.array([], np.int64))
    for frames in ([5, 1, 5], [5, 1], [5, 1, 4, 1], [4, 2, 4]):
        with pytest.raises(ValueError, match="segments of whole demonstrations"):
            memory.check_cuts(np.array(frames))
