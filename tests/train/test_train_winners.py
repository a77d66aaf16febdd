"""The order of winners and their changes against sequences whose values are known by hand."""

import numpy as np
import pytest

from train.postural.winners import order_agreement, switches, winner_order

A, B, C, NONE = 0, 1, 2, -1


@pytest.mark.parametrize(
    ("winners", "order"),
    [
        ([A] * 4 + [B] + [A] * 4, (A,)),
        ([A] * 4 + [B, A] + [B] * 4, (A, B)),
        ([A] * 3 + [B] * 3 + [A] * 3, (A, B, A)),
        ([A] * 3 + [B] * 2 + [C] * 3, (A, C)),
        ([A, B] * 20, ()),
        ([A, A, NONE, NONE, A, B, B, B], (A, B)),
        ([NONE] * 9, ()),
        ([C], ()),
        ([], ()),
    ],
)
def test_winner_order_drops_flicker_then_merges(winners, order):
    assert winner_order(np.array(winners, dtype=int)) == order


def test_winner_order_with_every_run_counting():
    assert winner_order([A, A, B, NONE, B, A], min_run=1) == (A, B, A)


@pytest.mark.parametrize(
    ("one", "other", "agreement"),
    [
        ((0, 1, 2, 3), (0, 1, 2, 3), 1.0),
        ((0, 1, 2, 3), (3, 2, 1, 0), 0.25),
        ((0, 1, 2, 3), (0, 2, 3), 0.75),
        ((0, 1, 2), (0, 9, 1, 9, 2, 9), 0.5),
        ((5, 6), (7, 8), 0.0),
        ((5, 5), (5,), 0.5),
        ((1, 2, 3, 2, 4, 1, 2), (2, 4, 3, 1, 2, 1), 4 / 7),  # Cormen et al.'s example: 2 3 2 1
        ((), (1,), 0.0),
        ((), (), 1.0),
    ],
)
def test_order_agreement(one, other, agreement):
    assert order_agreement(one, other) == pytest.approx(agreement)
    assert order_agreement(other, one) == pytest.approx(agreement)


@pytest.mark.parametrize(
    ("winners", "count"),
    [
        ([A, A, B, A], 2),
        ([A, NONE, A], 0),
        ([A, NONE, B], 1),
        ([NONE, NONE], 0),
        ([A], 0),
        ([], 0),
    ],
)
def test_switches_counts_changes_of_winner(winners, count):
    assert switches(np.array(winners, dtype=int)) == count


@pytest.mark.parametrize("measure", [winner_order, switches, lambda w: order_agreement(w, w)])
@pytest.mark.parametrize("winners", [np.zeros(3), np.zeros((3, 1), dtype=int), 4, ["a"]])
def test_bad_winners_are_refused(measure, winners):
    with pytest.raises(ValueError, match="as integers"):
        measure(winners)


def test_a_run_has_at_least_one_sample():
    with pytest.raises(ValueError, match="min_run ≥ 1"):
        winner_order([A], min_run=0)
