"""Claims about one picture that is reduced: a mean over areas, of the same aspect."""

import numpy as np
import pytest

from pacnet.datasets.pictures import reduce, reduced_size


def shares(length: int, reduced: int) -> np.ndarray:
    """How much of each old pixel lies in each new one, in a row that sums to 1, `[new, old]`."""
    edges = np.linspace(0, length, reduced + 1)
    low = np.maximum(edges[:-1, None], np.arange(length))
    high = np.minimum(edges[1:, None], np.arange(1, length + 1))
    return np.maximum(high - low, 0) * reduced / length


@pytest.mark.parametrize(
    ("size", "expected"),
    [
        ((480, 640), (96, 128)),
        ((720, 1280), (72, 128)),
        ((640, 480), (128, 96)),
        ((256, 256), (128, 128)),
        ((301, 401), (96, 128)),  # 96.08
        ((300, 512), (75, 128)),
        ((129, 129), (128, 128)),
        ((2, 8000), (1, 128)),
        ((128, 100), (128, 100)),
        ((1, 1), (1, 1)),
    ],
)
def test_a_reduced_pixel_is_the_mean_of_what_it_covers(
    size: tuple[int, int], expected: tuple[int, int]
):
    picture = np.random.default_rng(0).integers(0, 256, (*size, 3), dtype=np.uint8)
    before = picture.copy()
    found = reduce(picture)
    assert found.shape == (*expected, 3)
    assert reduced_size(*size) == expected
    down, across = map(shares, size, expected)
    means = np.einsum("hH,HWc,wW->hwc", down, picture.astype(float), across, optimize=True)
    assert np.abs(found - means).max() <= 0.5 + 1e-9
    # Twice the picture in each direction has the same means, with exact sums.
    twice = picture.repeat(2, 0).repeat(2, 1)
    if max(size) > 128 and max(twice.shape) <= 8192:
        assert np.array_equal(reduce(twice), found)
    assert np.array_equal(picture, before)
    assert not np.shares_memory(found, picture)


def test_halves_are_rounded_up():
    picture = np.zeros((256, 256, 3), np.uint8)
    picture[::2, :, 0] = 1  # mean 1/2
    picture[::2, ::2, 1] = 1  # mean 1/4
    picture[..., 2] = 255
    assert (reduce(picture) == [1, 0, 255]).all()


def test_views_are_taken():
    picture = np.random.default_rng(0).integers(0, 256, (200, 300, 3), dtype=np.uint8)
    assert np.array_equal(reduce(picture[::-1, ::-1]), reduce(picture[::-1, ::-1].copy()))
    frozen = picture.copy()
    frozen.flags.writeable = False
    assert np.array_equal(reduce(frozen), reduce(picture))


@pytest.mark.parametrize(
    ("picture", "got"),
    [
        (np.zeros((4, 4, 3)), r"float64 \[4, 4, 3\]"),
        (np.zeros((4, 4), np.uint8), r"uint8 \[4, 4\]"),
        (np.zeros((3, 4, 4), np.uint8), r"uint8 \[3, 4, 4\]"),
        (np.zeros((0, 4, 3), np.uint8), r"uint8 \[0, 4, 3\]"),
        (np.zeros((1, 9000, 3), np.uint8), r"sides up to 8192, got \[1, 9000, 3\]"),
        ([[[0, 0, 0]]], "list"),
    ],
)
def test_what_is_no_picture_is_refused(picture: object, got: str):
    with pytest.raises(ValueError, match=f"expected a picture as uint8.*{got}"):
        reduce(picture)
