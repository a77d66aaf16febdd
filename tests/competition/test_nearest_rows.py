"""The nearest rows that were shown, found by boxes: the same as by comparing all."""

import numpy as np
import pytest

from pacnet.competition.following_kernels import NO_ONE, nearest_rows
from pacnet.schemas.demonstration_memory import DemonstrationMemory, Shown


def walks(lengths: tuple[int, ...], dimensions: int, seed: int) -> Shown:
    """Demonstrations that are random walks."""
    rng, memory = np.random.default_rng(seed), DemonstrationMemory(dimensions, 1)
    for frames in lengths:
        path = np.cumsum(rng.standard_normal((frames, dimensions)), axis=0).astype(np.float32)
        memory.append(path, path, path[:, :1], 0, correction=False)
    return memory.shown()


def found(percepts: np.ndarray, shown: Shown, allowed: np.ndarray, count: int) -> np.ndarray:
    """The nearest rows `[T, count]`."""
    nearest = np.full((len(percepts), count), 1_000_000)
    nearest_rows(percepts, shown, allowed, nearest)
    return nearest


@pytest.mark.parametrize("count", [1, 5])
@pytest.mark.parametrize("dimensions", [1, 2, 12])
@pytest.mark.parametrize("lengths", [(1,), (3,), (200,), (100, 1, 33, 64, 250)])
@pytest.mark.parametrize("every", [1, 2])
def test_they_are_the_nearest_of_all_that_are_allowed(dimensions, lengths, every, count):
    shown = walks(lengths, dimensions, seed=0)
    allowed = np.arange(len(lengths)) % every == 0
    rows = np.repeat(allowed, np.diff(shown.first)).nonzero()[0]
    percepts = 5 * np.random.default_rng(1).standard_normal((300, dimensions)).astype(np.float32)
    nearest = found(percepts, shown, allowed, count)
    there = min(count, len(rows))
    assert (nearest[:, there:] == NO_ONE).all()
    assert np.isin(nearest[:, :there], rows).all()
    assert all(len(set(some)) == there for some in nearest[:, :there].tolist())
    every_row = np.square(percepts[:, None].astype(np.float64) - shown.percepts[rows]).sum(axis=2)
    apart = percepts[:, None].astype(np.float64) - shown.percepts[nearest[:, :there]]
    np.testing.assert_allclose(
        np.square(apart).sum(axis=2), np.sort(every_row)[:, :there], rtol=1e-5
    )


@pytest.mark.parametrize("lengths", [(), (30, 30)])
def test_where_none_is_allowed_there_is_none(lengths):
    shown = walks(lengths, 2, seed=0)
    none = np.zeros(len(lengths), bool)
    assert (found(np.zeros((4, 2), np.float32), shown, none, 5) == NO_ONE).all()


def test_each_row_is_nearest_to_itself():
    shown = walks((50, 70), 3, seed=2)
    nearest = found(shown.percepts.copy(), shown, np.ones(2, bool), 5)
    assert nearest[:, 0].tolist() == [*range(120)]


@pytest.mark.parametrize("dimensions", [1, 3, 7, 12, 28])
def test_of_rows_that_are_as_near_as_one_another_so_many_are_found(dimensions):
    rng, memory = np.random.default_rng(3), DemonstrationMemory(dimensions, 1)
    still = np.tile(rng.standard_normal(dimensions).astype(np.float32), (100, 1))
    memory.append(still, still, still[:, :1], 0, correction=False)
    percepts = rng.standard_normal((300, dimensions)).astype(np.float32)
    nearest = found(percepts, memory.shown(), np.ones(1, bool), 5)
    assert (nearest != NO_ONE).all()
    assert all(len(set(some)) == 5 for some in nearest.tolist())
