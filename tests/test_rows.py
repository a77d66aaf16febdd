"""Rows that grow: what is alive, what a state_dict holds, and what deleting does."""

import torch

from pacnet.rows import Column, GrowableRows


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


def test_capacity_grows_seldom():
    rows = make_rows(0)
    capacities = []
    for number in range(1000):
        rows.append({"point": torch.zeros(2), "number": number})
        capacities.append(rows.capacity)
    assert len(set(capacities)) == 4  # 128, 256, 512, 1024


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
