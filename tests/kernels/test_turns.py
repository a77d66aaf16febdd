"""Turns: quaternions obey their algebra, in arrays and in kernels, and agree with SciPy's."""

from __future__ import annotations

import numpy as np
import pytest
from numba import njit
from scipy.spatial.transform import Rotation

from pacnet.kernels import turns as kernels
from pacnet.schemas import scene

HALF = np.sqrt(0.5)
QUARTERS = {
    "x": ((HALF, HALF, 0.0, 0.0), {"y": "z", "z": "-y"}),
    "y": ((HALF, 0.0, HALF, 0.0), {"z": "x", "x": "-z"}),
    "z": ((HALF, 0.0, 0.0, HALF), {"x": "y", "y": "-x"}),
}  # of a quarter of a turn about each axis: the quaternion, and where the other axes go
AXES = {"x": np.eye(3)[0], "y": np.eye(3)[1], "z": np.eye(3)[2]}
AXES |= {f"-{name}": -axis for name, axis in AXES.items()}


def turns(count: int, seed: int) -> np.ndarray:
    """Unit quaternions, uniform over all turns, `[N, 4]`."""
    four = np.random.default_rng(seed).standard_normal((count, 4))
    return four / np.linalg.norm(four, axis=1, keepdims=True)


def vectors(count: int, seed: int) -> np.ndarray:
    return np.random.default_rng(seed).standard_normal((count, 3))


def rotation(turn: np.ndarray) -> Rotation:
    return Rotation.from_quat(np.roll(turn, -1, axis=-1))  # the scalar is SciPy's last


@njit
def all_of(first, second, vector):
    """Return what each kernel gives for rows, one beside the other, `[N, 24]`."""
    out = np.empty((len(first), 24))
    for i in range(len(first)):
        a, b = kernels.turn_of(first, i), kernels.turn_of(second, i)
        v = kernels.vector_of(vector, i)
        row = (
            kernels.multiply(a, b)
            + kernels.inverse(a)
            + kernels.rotate(a, v)
            + kernels.to_vector(a)
            + kernels.from_vector(v)
            + kernels.minus(kernels.vector_of(first, i), v)
            + kernels.plus(kernels.vector_of(first, i), v, 2.0)
        )
        for k, value in enumerate(row):
            out[i, k] = value
    return out


@njit
def norms_of(vector):
    return np.array([kernels.norm(kernels.vector_of(vector, i)) for i in range(len(vector))])


def test_kernels_give_what_arrays_do():
    first, second, vector = turns(50, 0), turns(50, 1), vectors(50, 2)
    vector[0] = 0
    vector[1] *= 1e-13
    first[0] = (1, 0, 0, 0)
    first[1] = (-1, 0, 0, 0)
    got = np.split(all_of(first, second, vector), [4, 8, 11, 14, 18, 21], axis=1)
    expected = [
        scene.multiply(first, second),
        scene.conjugate(first),
        scene.rotate(first, vector),
        scene.to_vector(first),
        scene.from_vector(vector),
        first[:, :3] - vector,
        first[:, :3] + 2 * vector,
    ]
    for one, other in zip(got, expected, strict=True):
        np.testing.assert_allclose(one, other, atol=1e-14)
    np.testing.assert_allclose(norms_of(vector), np.linalg.norm(vector, axis=1))


@pytest.mark.parametrize("axis", QUARTERS)
def test_quarter_turns_take_one_axis_to_the_next(axis: str):
    quaternion, goes = QUARTERS[axis]
    turn = np.array(quaternion)
    np.testing.assert_allclose(scene.rotate(turn, AXES[axis]), AXES[axis], atol=1e-15)
    for before, after in goes.items():
        np.testing.assert_allclose(scene.rotate(turn, AXES[before]), AXES[after], atol=1e-15)
    np.testing.assert_allclose(scene.to_vector(turn), np.pi / 2 * AXES[axis])
    np.testing.assert_allclose(scene.from_vector(np.pi / 2 * AXES[axis]), turn)


def test_turns_agree_with_scipy():
    first, second, vector = turns(100, 3), turns(100, 4), vectors(100, 5)
    np.testing.assert_allclose(scene.rotate(first, vector), rotation(first).apply(vector))
    product = rotation(scene.multiply(first, second)).as_matrix()
    both = (rotation(first) * rotation(second)).as_matrix()
    np.testing.assert_allclose(product, both, atol=1e-14)
    np.testing.assert_allclose(scene.to_vector(first), rotation(first).as_rotvec(), atol=1e-14)
    of_vector = rotation(scene.from_vector(vector)).as_matrix()
    np.testing.assert_allclose(of_vector, Rotation.from_rotvec(vector).as_matrix(), atol=1e-14)


def test_the_conjugate_takes_a_turn_back():
    turn, vector = turns(20, 6), vectors(20, 7)
    one = np.broadcast_to((1.0, 0, 0, 0), turn.shape)
    np.testing.assert_allclose(scene.multiply(turn, scene.conjugate(turn)), one, atol=1e-15)
    back = scene.rotate(scene.conjugate(turn), scene.rotate(turn, vector))
    np.testing.assert_allclose(back, vector, atol=1e-14)


def test_products_turn_by_the_second_and_then_by_the_first():
    first, second, vector = turns(20, 8), turns(20, 9), vectors(20, 10)
    expected = scene.rotate(first, scene.rotate(second, vector))
    product = scene.multiply(first, second)
    np.testing.assert_allclose(scene.rotate(product, vector), expected, atol=1e-14)
    np.testing.assert_allclose(np.linalg.norm(product, axis=1), 1)


def test_a_quaternion_and_its_negative_are_one_turn():
    turn, vector = turns(20, 11), vectors(20, 12)
    np.testing.assert_allclose(scene.rotate(-turn, vector), scene.rotate(turn, vector))
    np.testing.assert_allclose(scene.to_vector(-turn), scene.to_vector(turn))


@pytest.mark.parametrize("angle", [0.0, 1e-14, 1e-7, 0.3, np.pi - 1e-6])
def test_rotation_vectors_of_any_length_survive(angle: float):
    axes = vectors(10, 13)
    vector = angle * axes / np.linalg.norm(axes, axis=1, keepdims=True)
    turn = scene.from_vector(vector)
    np.testing.assert_allclose(np.linalg.norm(turn, axis=1), 1)
    np.testing.assert_allclose(scene.to_vector(turn), vector, rtol=1e-9, atol=1e-20)


def test_more_than_half_a_turn_is_less_the_other_way():
    vector = np.array([0.0, 0.0, 1.5 * np.pi])
    back = scene.to_vector(scene.from_vector(vector))
    np.testing.assert_allclose(back, [0, 0, -0.5 * np.pi], atol=1e-14)
