"""What kernels do on vector registers and pointers, against numpy."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from numba import njit
from numpy.typing import NDArray
from torch import nn

from pacnet.lanes import (
    add_product,
    any_equal,
    any_up_to,
    difference,
    fill,
    first_ones,
    load,
    number_up_to,
    silu,
    store,
    sums,
    total,
    zeros,
)
from pacnet.pointers import doubles, floats, integers

SIZE = 64
each_count = pytest.mark.parametrize("count", [8, 16, 32])
each_summed_count = pytest.mark.parametrize("count", [8, 16])


def whole_numbers(seed: int, size: int = SIZE) -> NDArray[np.float32]:
    """Small ones, with which float32 computes exactly."""
    return np.random.default_rng(seed).integers(-99, 100, size).astype(np.float32)


@pytest.mark.parametrize(
    ("pointer", "kind"), [(floats, np.float32), (doubles, np.float64), (integers, np.int64)]
)
def test_a_pointer_reads_and_writes_what_lies_at_an_address(pointer, kind):
    @njit
    def swap(address, one, other):
        row = pointer(address)
        row[one], row[other] = row[other], row[one]

    row = np.array([2**20 + 1, 5, -3], kind)
    swap(row.ctypes.data, 0, 2)
    swap(row[1:].ctypes.data, -1, 1)  # no index counts from the end
    assert row.tolist() == [2**20 + 1, 5, -3]


@each_count
def test_lanes_are_loaded_filled_and_stored_where_told(count):
    @njit
    def run(numbers, out):
        read, write = floats(numbers.ctypes.data), floats(out.ctypes.data)
        store(write, 1, load(read, 3, count))
        store(write, 1 + count, fill(read, 2, count))

    numbers, out = whole_numbers(0), np.full(2 + 2 * count, 1000, np.float32)
    run(numbers, out)
    assert out.tolist() == [1000, *numbers[3 : 3 + count], *[numbers[2]] * count, 1000]


@each_count
def test_differences_and_sums_of_products(count):
    @njit
    def run(a, b, out):
        one, other = load(floats(a.ctypes.data), 0, count), load(floats(b.ctypes.data), 0, count)
        write = floats(out.ctypes.data)
        store(write, 0, difference(one, other))
        store(write, count, add_product(one, other, other))
        store(write, 2 * count, add_product(zeros(count), one, other))

    a, b, out = whole_numbers(0, count), whole_numbers(1, count), np.empty(3 * count, np.float32)
    run(a, b, out)
    assert out.tolist() == [*(a - b), *(a + b * b), *(a * b)]


@each_count
def test_the_first_ones_stay_and_the_others_are_nothing(count):
    @njit
    def run(numbers, out, number):
        lanes = load(floats(numbers.ctypes.data), 0, count)
        store(floats(out.ctypes.data), 0, first_ones(lanes, number))

    numbers, out = whole_numbers(0, count), np.empty(count, np.float32)
    numbers[-1] = np.nan  # as what lies beyond a buffer's end may be
    for number in range(count):
        run(numbers, out, number)
        assert out.tolist() == [*numbers[:number], *[0] * (count - number)]
    run(numbers[::-1].copy(), out, count)
    np.testing.assert_array_equal(out, numbers[::-1])


@each_summed_count
def test_sums_of_lanes(count):
    @njit
    def run(rows, out):
        a, w = floats(rows.ctypes.data), count
        of_each = sums(
            load(a, 0, w), load(a, w, w), load(a, 2 * w, w), load(a, 3 * w, w),
            load(a, 4 * w, w), load(a, 5 * w, w), load(a, 6 * w, w), load(a, 7 * w, w),
        )  # fmt: skip
        store(floats(out.ctypes.data), 0, of_each)
        return total(load(a, 0, w))

    rows, out = whole_numbers(0, 8 * count), np.empty(8, np.float32)
    assert run(rows, out) == rows[:count].sum()
    assert out.tolist() == rows.reshape(8, count).sum(axis=1).tolist()


@each_count
def test_whether_one_is_a_number_or_less(count):
    @njit
    def run(numbers, limit):
        return any_up_to(load(floats(numbers.ctypes.data), 0, count), limit)

    for place in range(count):
        numbers = np.full(count, np.nan, np.float32)
        assert not run(numbers, np.float32(np.inf))
        numbers[place] = 1.5
        limits = np.nextafter(np.float32(1.5), np.float32([-9, 1.5, 9]))
        assert [run(numbers, limit) for limit in limits] == [False, True, True]


@each_count
def test_how_many_are_a_number_or_less(count):
    @njit
    def run(numbers, limit):
        return number_up_to(load(floats(numbers.ctypes.data), 0, count), limit)

    numbers = whole_numbers(2, count)
    numbers[1] = np.nan
    for limit in np.arange(-100, 101, dtype=np.float32):
        assert run(numbers, limit) == (numbers <= limit).sum()


@each_count
def test_whether_a_number_is_among_integers(count):
    @njit
    def run(numbers, number):
        return any_equal(integers(numbers.ctypes.data), 3, count, number)

    numbers = np.arange(SIZE) + 2**40  # beyond what int32 holds
    for place, number in enumerate(numbers):
        assert run(numbers, number) == (3 <= place < 3 + count)
    assert not run(numbers, 5)


@each_count
def test_silu_is_right_to_float32_from_end_to_end(count):
    @njit
    def run(numbers):
        row = floats(numbers.ctypes.data)
        for at in range(0, numbers.size, count):
            store(row, at, silu(load(row, at, count)))

    exact = torch.cat([torch.linspace(-86, 86, 99_984, dtype=torch.float64), torch.zeros(16)])
    x = exact.float().double()
    got = x.float().numpy()
    run(got)
    wanted = nn.functional.silu(x)
    torch.testing.assert_close(torch.from_numpy(got).double(), wanted, rtol=2.5e-7, atol=0)
