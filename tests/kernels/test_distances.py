"""Distances, compared with plain numpy."""

from __future__ import annotations

import numpy as np
import pytest

from pacnet.kernels.distances import distances_of


@pytest.mark.parametrize("dimensions", [1, 3, 8, 9, 16, 17, 28, 40])
def test_distances_are_those_of_the_rows_and_ignore_memory_beyond(dimensions: int):
    rng = np.random.default_rng(dimensions)
    percept = rng.standard_normal(dimensions).astype(np.float32)
    for rows in range(1, 40):
        memory = np.full((rows + 3, dimensions), np.nan, np.float32)  # as in a pool that has grown
        cues = memory[:rows]
        cues[:] = rng.standard_normal((rows, dimensions))
        cues[rows // 2] = percept
        distances = distances_of(percept, cues)
        expected = np.linalg.norm(cues.astype(np.float64) - percept, axis=1)
        assert distances.shape == (rows,)
        np.testing.assert_allclose(distances, expected, rtol=1e-6)
        assert distances[rows // 2] == 0


def test_strided_rows_are_read_correctly():
    rng = np.random.default_rng(0)
    table = rng.standard_normal((12, 20)).astype(np.float32)
    expected = np.linalg.norm(table.T[:, ::2] - table[::2, 3], axis=1)
    np.testing.assert_allclose(distances_of(table[::2, 3], table.T[:, ::2]), expected, rtol=1e-6)


@pytest.mark.parametrize("rows", [1, 3, 4, 50])
def test_doubles_are_not_rounded_to_single_precision(rows: int):
    rng = np.random.default_rng(rows)
    percept, cues = rng.standard_normal(9), rng.standard_normal((rows, 9))
    expected = np.linalg.norm(cues - percept, axis=1)
    np.testing.assert_allclose(distances_of(percept, cues), expected, rtol=1e-14)
