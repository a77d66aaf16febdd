"""Rows that grow: their memory, what a state_dict holds, and what deleting does."""

import pytest
import torch

from pacnet.core.growable_rows import Column, GrowableRows


def make_rows(count: int) -> GrowableRows:
    rows = GrowableRows({"point": Column((2,), torch.float32), "number": Column((), torch.int64)})
    for number in range(count):
        rows.append({"point": torch.tensor([number, -number]), "number": number})
    return rows


def test_append_returns_dense_numbers_and_keeps_values_across_growth():
    rows = make_rows(0)
    assert [rows.append({"point": torch.ones(2) * n, "number": n}) for n in range(100)] == list(
        range(100)
    )
    assert rows.live("number").tolist() == list(range(100))
    assert rows.live("point")[:, 0].tolist() == list(range(100))


def test_memory_is_rarely_replaced_while_rows_are_appended():
    rows, places = make_rows(0), set()
    for number in range(1000):
        rows.append({"point": torch.zeros(2), "number": number})
        places.add((rows.live("point").data_ptr(), rows.live("number").data_ptr()))
    assert len(places) <= 4  # a capacity of at least 128, 256, 512, 1024
    assert rows.live("number").tolist() == list(range(1000))


def test_a_buffer_is_exactly_the_rows():
    rows = make_rows(3)
    assert rows.point.shape == (3, 2)
    assert rows.number.shape == (len(rows),)
    rows.delete(torch.tensor([0]))
    assert rows.point.shape == (2, 2)


@pytest.mark.parametrize("change", ["append", "delete", "swap_remove", "select", "load"])
@pytest.mark.parametrize("count", [7, 127, 128, 129])
def test_a_view_taken_before_keeps_its_rows(change: str, count: int):
    rows = make_rows(count)
    view = rows.live("number")
    some = torch.tensor([0, 3])
    if change == "append":
        for _ in range(300):
            rows.append({"point": torch.zeros(2), "number": -1})
        assert len(rows) == count + 300
    elif change == "load":
        rows.load_state_dict(make_rows(2 * count).state_dict())
    else:
        getattr(rows, change)(some)
        rows.append({"point": torch.zeros(2), "number": -1})  # where a row may have been
        rows.live("number").fill_(-1)
    assert view.tolist() == list(range(count))


def test_swap_remove_fills_the_gaps_with_the_last_rows():
    rows = make_rows(6)
    rows.swap_remove(torch.tensor([1, 4]))  # 5 takes the place of 4, and then that of 1
    assert rows.live("number").tolist() == [0, 5, 2, 3]
    assert rows.live("point")[:, 1].tolist() == [0, -5, -2, -3]


@pytest.mark.parametrize("rows_now", [0, 3])
def test_arrays_are_the_memory_of_the_rows_with_capacity_for_more(rows_now: int):
    rows = make_rows(rows_now)
    arrays = rows.arrays(2)
    assert len(rows) == rows_now
    arrays["number"][rows_now] = 77
    arrays["point"][rows_now] = 5, 6
    rows.set_length(rows_now + 1)
    assert rows.live("number").tolist() == [*range(rows_now), 77]
    assert rows.live("point")[-1].tolist() == [5, 6]
    rows.live("number")[0] = 8
    assert arrays["number"][0] == 8


@pytest.mark.parametrize("count", [0, 1, 128, 300])
def test_a_transposed_column_holds_one_dimension_after_the_other(count: int):
    rows = GrowableRows({"point": Column((3,), torch.float32, transposed=True)})
    for number in range(count):
        rows.append({"point": torch.arange(3.0) + 10 * number})
    for change in (lambda: None, lambda: rows.delete(torch.tensor([0])), lambda: rows.extend(200)):
        if count:
            change()
        array, length = rows.transposed("point")
        assert array.flags.c_contiguous
        assert length == len(rows)
        assert array[:, :length].T.tolist() == rows.live("point").tolist()
        if len(rows):
            assert array.ctypes.data == rows.live("point").data_ptr()
    memory = rows.arrays(1)["point"]
    assert memory.flags.c_contiguous
    assert memory.shape[0] == 3
    assert memory.shape[1] > len(rows)
    rows.point = rows.live("point").clone(memory_format=torch.contiguous_format)
    array, length = rows.transposed("point")  # of another tensor, a copy
    assert array.T.tolist() == rows.live("point").tolist()


def test_check_refuses_columns_that_do_not_fit_one_another():
    shorter, wide, gone, double = (make_rows(5) for _ in range(4))
    shorter.number = shorter.number[:3]
    with pytest.raises(ValueError, match=r"expected number of shape \[5\].*got \[3\]"):
        shorter.check()
    wide.point = torch.zeros(5, 3)
    with pytest.raises(ValueError, match=r"expected point of shape \[rows, 2\], got \[5, 3\]"):
        wide.check()
    gone.number = gone.number.clone()
    gone.number.untyped_storage().resize_(8)
    with pytest.raises(ValueError, match="elements in memory, got 8 bytes"):
        gone.check()
    double.double()
    with pytest.raises(ValueError, match=r"point as torch.float32 on the CPU, got torch.float64"):
        double.arrays(1)
    make_rows(5).check()


PARTS = {
    "point alone": (lambda state: {"point": state["point"]}, "expected number .*got none"),
    "fewer numbers": (
        lambda state: state | {"number": state["number"][:2]}, r"number of shape \[5\], got \[2\]",
    ),
    "wider": (lambda state: state | {"point": torch.zeros(5, 3)}, r"expected point.*got \[5, 3\]"),
    "flat": (lambda state: state | {"number": torch.tensor(5)}, r"expected number.*got \[\]"),
}  # fmt: skip


@pytest.mark.parametrize("strict", [True, False])
@pytest.mark.parametrize("part", PARTS)
def test_columns_that_do_not_fit_are_not_loaded(part: str, strict: bool):
    rows, (change, message) = make_rows(3), PARTS[part]
    before = rows.state_dict()
    with pytest.raises(ValueError, match=message):
        rows.load_state_dict(change(make_rows(5).state_dict()), strict=strict)
    assert len(rows) == 3
    assert all(torch.equal(rows.live(name), before[name]) for name in before)


def test_delete_moves_later_rows_down_in_order_in_every_column():
    rows = make_rows(6)
    rows.delete(torch.tensor([1, 4]))
    assert rows.live("number").tolist() == [0, 2, 3, 5]
    assert rows.live("point")[:, 1].tolist() == [0, -2, -3, -5]


def test_a_deleted_row_leaves_nothing_behind_in_the_next_one():
    rows = make_rows(3)
    rows.delete(torch.tensor([2]))
    rows.extend(1)
    assert rows.live("number").tolist() == [0, 1, 0]
    assert rows.live("point")[2].tolist() == [0, 0]


def test_state_dict_holds_live_rows_alone_and_its_own_memory():
    rows = make_rows(5)
    state = rows.state_dict()
    assert state["point"].shape == (5, 2)
    rows.live("point").zero_()
    assert state["point"][3].tolist() == [3, -3]


def test_loading_takes_any_number_of_rows_and_does_not_alias():
    state = make_rows(5).state_dict()
    for before in (0, 3, 9):
        rows = make_rows(before)
        rows.load_state_dict(state)
        assert len(rows) == 5
        rows.append({"point": torch.zeros(2), "number": 7})
        assert rows.live("number").tolist() == [0, 1, 2, 3, 4, 7]
        rows.live("number").zero_()
        assert state["number"].tolist() == [0, 1, 2, 3, 4]


@pytest.mark.parametrize("before", [0, 1, 100])
def test_extend_appends_any_number_of_rows_of_zeros(before: int):
    for count in range(1, 200):
        rows = make_rows(before)
        kept = {name: rows.live(name).clone() for name in rows.columns}
        assert rows.extend(count) == before
        assert len(rows) == before + count
        for name, values in kept.items():
            assert len(rows.live(name)) == before + count
            assert torch.equal(rows.live(name)[:before], values)
            assert not rows.live(name)[before:].any()


def test_a_fork_shares_its_rows_until_either_gets_more():
    rows = make_rows(5)
    fork = rows.fork()
    assert fork.live("point").data_ptr() == rows.live("point").data_ptr()
    versions = [fork.point._version, fork.number._version]
    rows.append({"point": torch.ones(2), "number": 50})
    fork.append({"point": torch.zeros(2), "number": 51})
    fork.live("number")[0] = 52  # in memory of its own by now
    assert rows.live("number").tolist() == [0, 1, 2, 3, 4, 50]
    assert fork.live("number").tolist() == [52, 1, 2, 3, 4, 51]
    assert versions == [0, 0]


def test_rows_that_are_appended_do_not_change_buffers_from_before():
    rows = make_rows(5)
    before, version = rows.point, rows.point._version
    rows.append({"point": torch.ones(2), "number": 5})
    assert rows.point.data_ptr() == before.data_ptr()
    assert before._version == version
    before[0, 0] = 7  # from outside, which counts
    assert before._version > version
