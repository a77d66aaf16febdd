"""The nearest row that was shown, found by boxes: the same as by comparing all."""

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


@pytest.mark.parametrize("dimensions", [1, 2, 12])
@pytest.mark.parametrize("lengths", [(1,), (200,), (100, 1, 33, 64, 250)])
@pytest.mark.parametrize("every", [1, 2])
def test_it_is_the_nearest_of_all_that_are_allowed(dimensions, lengths, every):
    shown = walks(lengths, dimensions, seed=0)
    allowed = np.arange(len(lengths)) % every == 0
    rows = np.repeat(allowed, np.diff(shown.first)).nonzero()[0]
    percepts = 5 * np.random.default_rng(1).standard_normal((300, dimensions)).astype(np.float32)
    nearest = np.empty(300, np.int64)
    nearest_rows(percepts, shown, allowed, nearest)
    apart = np.square(percepts[:, None].astype(np.float64) - shown.percepts[rows]).sum(axis=2)
    assert np.isin(nearest, rows).all()
    found = np.square(percepts.astype(np.float64) - shown.percepts[nearest]).sum(axis=1)
    np.testing.assert_allclose(found, apart.min(axis=1), rtol=1e-5)


@pytest.mark.parametrize("lengths", [(), (30, 30)])
def test_where_none_is_allowed_there_is_none(lengths):
    shown = walks(lengths, 2, seed=0)
    nearest = np.zeros(4, np.int64)
    nearest_rows(np.zeros((4, 2), np.float32), shown, np.zeros(len(lengths), bool), nearest)
    assert nearest.tolist() == [NO_ONE] * 4


def test_each_row_is_nearest_to_itself():
    shown = walks((50, 70), 3, seed=2)
    nearest = np.empty(120, np.int64)
    nearest_rows(shown.percepts.copy(), shown, np.ones(2, bool), nearest)
    assert nearest.tolist() == [*range(120)]
