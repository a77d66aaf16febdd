"""Keyframes: corners are more important than what lies on the line between others; noise is not."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from pacnet.schemas.keyframes import fitted, importance, keyframes, most_important

Array = NDArray[np.float64]
FPS, MOVEMENT = 10, 0.3  # percepts are averaged over 3 frames, more than 0.8 · 0.3 / √3 is no noise
CORNERS = {0: 0.0, 10: 10.0, 20: 0.0, 30: 2.0, 40: 0.0}  # frame -> value


def polyline() -> Array:
    return np.interp(np.arange(41), [*CORNERS], [*CORNERS.values()])[:, None]


def farthest_first(rows: Array, frame: Array) -> Array:
    """The second method: recursion over the rows between two, with one interpolation each."""
    out = np.zeros(len(rows))
    out[[0, -1]] = np.inf

    def split(begin: int, end: int) -> None:
        line = [np.interp(frame[begin:end], frame[[begin, end]], rows[[begin, end], d])
                for d in range(rows.shape[1])]  # fmt: skip
        apart = np.linalg.norm(rows[begin:end] - np.transpose(line), axis=1)
        apart[0] = 0
        if apart.max() > 1e-12:
            middle = begin + int(apart.argmax())
            out[middle] = min(apart.max(), out[begin], out[end])
            split(begin, middle)
            split(middle, end)

    split(0, len(rows) - 1)
    return out


def hats(frames: int, kept: list[int]) -> Array:
    """Column k is 1 at keyframe k, 0 at the others, and linear in between, `[T, K]`."""
    return np.transpose([np.interp(np.arange(frames), kept, one) for one in np.eye(len(kept))])


def test_the_corners_of_a_polyline_are_important_in_order():
    important = importance(polyline(), np.arange(41))
    # From the line between the ends, 0, frame 10 is 10 away. From the line from there to the end,
    # 10 · 20 / 30 at frame 20, that is 20 / 3 away, and from the next line, 0, frame 30 is 2 away.
    expected = dict(zip(CORNERS, (np.inf, 10, 20 / 3, 2, np.inf), strict=True))
    assert important[[*expected]] == pytest.approx([*expected.values()])
    others = np.delete(important, [*expected])
    assert others.max() < 1e-12
    for most in range(6):
        kept = sorted([0, 40, 10, 20, 30][:most])
        assert most_important(important, most).tolist() == kept


def test_nothing_is_more_important_than_what_it_is_compared_with():
    rows = np.interp(np.arange(31), [0, 10, 20, 30], [0, 3, -3, 0])[:, None]
    # Both corners are 3 from the line between the ends; then the second is 4.5 from the next one.
    assert importance(rows, np.arange(31))[[10, 20]] == pytest.approx([3, 3])


@pytest.mark.parametrize("seed", range(5))
def test_importance_is_that_of_a_recursion_of_plain_interpolations(seed: int):
    rng = np.random.default_rng(seed)
    rows, frame = rng.standard_normal((60, 3)).cumsum(axis=0), rng.integers(1, 9, 60).cumsum()
    important = importance(rows.astype(np.float32), frame)
    np.testing.assert_allclose(important, farthest_first(rows, frame), atol=1e-5)


@pytest.mark.parametrize("frames", [1, 2, 3, 50])
def test_of_what_never_changes_only_the_ends_are_kept(frames: int):
    rows = np.full((frames, 2), 0.1, np.float32)
    kept, important = keyframes(rows, 10, FPS, MOVEMENT)
    assert kept.tolist() == sorted({0, frames - 1})
    assert np.isinf(important).all()
    assert keyframes(rows, 1, FPS, MOVEMENT)[0].tolist() == [0]
    assert len(importance(rows[:0], np.arange(0))) == 0


def test_noise_is_not_kept_but_what_is_above_it_is():
    rng = np.random.default_rng(0)
    noise = 0.05 * rng.standard_normal((41, 1))
    assert keyframes(noise, 40, FPS, MOVEMENT)[0].tolist() == [0, 40]
    kept, important = keyframes(polyline() + noise, 40, FPS, MOVEMENT)
    apart = np.abs(kept[:, None] - [*CORNERS])
    assert apart.min(axis=0).max() <= 1  # every corner is kept,
    assert apart.min(axis=1).max() <= 1  # and nothing but what averages make of corners
    assert keyframes(polyline() + noise, 3, FPS, MOVEMENT)[0] == pytest.approx([0, 10, 40], abs=1)
    assert (important > 0.8 * MOVEMENT / 3**0.5).all()


@pytest.mark.parametrize("kept", [[0, 40], [0, 3, 4, 17, 40], [0, 1, 2, 40], [*range(41)]])
def test_values_are_fitted_by_least_squares(kept: list[int]):
    values = np.random.default_rng(1).standard_normal((41, 3))
    best = np.linalg.lstsq(hats(41, kept), values, rcond=None)[0]
    inside = best.clip(values.min(axis=0), values.max(axis=0))
    np.testing.assert_allclose(fitted(values, np.array(kept)), inside, atol=1e-6)


def test_a_polyline_is_what_is_fitted_at_its_corners():
    frames = np.array([*CORNERS])
    np.testing.assert_allclose(fitted(polyline(), frames)[:, 0], [*CORNERS.values()], atol=1e-6)


def test_nothing_is_fitted_beyond_what_was_shown():
    values = np.where(np.arange(41) < 20, -1.0, 1.0)[:, None]  # a step
    kept = np.array([0, 15, 25, 40])
    assert np.abs(np.linalg.lstsq(hats(41, [*kept]), values, rcond=None)[0]).max() > 1.05
    assert np.abs(fitted(values, kept)).max() == 1
    huge = np.where(np.arange(41)[:, None] < 20, -3e38, 3e38).astype(np.float32)
    assert np.isfinite(fitted(huge, kept)).all()


def test_of_fewer_than_two_keyframes_values_are_those_shown():
    values = np.arange(6.0).reshape(3, 2)
    np.testing.assert_array_equal(fitted(values, np.array([1])), values[1:2])
    assert fitted(values, np.array([], np.int64)).shape == (0, 2)
