"""Errors of demonstrations left out are those of fits without them; chance is recognised."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from torch import Tensor

from pacnet.vision.regression import (
    RIDGES,
    SIGNIFICANT,
    choose,
    choose_first,
    fit,
    left_out,
    left_out_of_mean,
)


def drawn(*shape: int, seed: int = 0) -> Tensor:
    generator = torch.Generator().manual_seed(seed)
    return torch.randn(*shape, generator=generator, dtype=torch.float64)


def refitted(features: Tensor, goals: Tensor, strength: float) -> Tensor:
    """Errors by N fits with numpy, each without one row: least squares of rows added for a ridge.

    The penalty is one number for all of them, and the mean is free of it.
    """
    z, y, errors = features.numpy(), goals.numpy(), []
    for row in range(len(z)):
        others = np.arange(len(z)) != row
        design = np.column_stack([z[others], np.ones(len(z) - 1)])
        penalty = np.column_stack([np.sqrt(strength) * np.eye(z.shape[1]), np.zeros(z.shape[1])])
        target = np.concatenate([y[others], np.zeros((z.shape[1], y.shape[1]))])
        weights, *_ = np.linalg.lstsq(np.concatenate([design, penalty]), target, rcond=None)
        errors.append(y[row] - np.append(z[row], 1) @ weights)
    return torch.from_numpy(np.stack(errors))


def strength_of(features: Tensor, ridge: float) -> float:
    return ridge * len(features) * float(features.var(dim=0, correction=0).mean())


@pytest.mark.parametrize("ridge", RIDGES)
@pytest.mark.parametrize(("rows", "columns"), [(5, 2), (12, 3), (4, 6), (3, 1)])
def test_errors_are_those_of_fits_without_each(rows: int, columns: int, ridge: float):
    features, goals = drawn(rows, columns), drawn(rows, 4, seed=1)
    expected = refitted(features, goals, strength_of(features, ridge))
    torch.testing.assert_close(left_out(features, goals, ridge), expected, atol=1e-8, rtol=1e-6)


def test_groups_of_features_are_judged_alike_at_once():
    groups, goals = drawn(7, 9, 2), drawn(9, 3, seed=1)
    together = left_out(groups, goals, 0.01)
    for number, group in enumerate(groups):
        torch.testing.assert_close(together[number], left_out(group, goals, 0.01))


def test_errors_of_the_mean_are_those_of_the_others_mean():
    goals = drawn(6, 3)
    expected = [goals[row] - goals[torch.arange(6) != row].mean(dim=0) for row in range(6)]
    torch.testing.assert_close(left_out_of_mean(goals), torch.stack(expected))


def test_a_fit_foretells_what_it_was_made_of():
    features, weights = drawn(20, 2), torch.tensor([[1.0, 0, 2], [0, -1, 3]]).double()
    goals = features @ weights + torch.tensor([5.0, 6, 7])
    mean, found, centre = fit(features, goals, 1e-6)
    torch.testing.assert_close((features - mean) @ found + centre, goals, atol=1e-4, rtol=0)


def test_features_that_never_change_foretell_the_mean():
    goals = drawn(5, 2)
    errors = left_out(torch.full((5, 2), 3.0, dtype=torch.float64), goals, 0.01)
    torch.testing.assert_close(errors, left_out_of_mean(goals))


def no_penalties(groups: Tensor) -> Tensor:
    return torch.zeros(len(groups), dtype=torch.float64)


def chance_of(seed: int, rows: int, telling: bool) -> float:
    """With one group of many that tells goals, or none."""
    groups, goals = drawn(60, rows, 2, seed=seed), drawn(rows, 3, seed=1000 + seed)
    if telling:
        groups[17] = goals[:, :2] + 0.1 * drawn(rows, 2, seed=2000 + seed)
        goals[:, 2] = goals[:, 0]
    return choose(groups, no_penalties(groups), goals, 3).chance


@pytest.mark.parametrize("rows", [5, 8, 20])
def test_what_foretells_by_chance_is_said_to_be_chance(rows: int):
    """The best of 60 random groups looks good in few rows; permutations do as well."""
    chances = [chance_of(seed, rows, telling=False) for seed in range(40)]
    assert np.mean([chance <= SIGNIFICANT for chance in chances]) <= 0.1
    assert np.mean(chances) == pytest.approx(0.5, abs=0.12)  # uniform, were it no ridge


@pytest.mark.parametrize("rows", [5, 8, 20])
def test_what_tells_is_found_among_much_that_does_not(rows: int):
    chances = [chance_of(seed, rows, telling=True) for seed in range(20)]
    assert np.mean([chance <= SIGNIFICANT for chance in chances]) >= 0.9


@pytest.mark.parametrize("rows", [3, 4])
def test_few_rows_are_never_more_than_chance(rows: int):
    """Of three rows one permutation in six leaves all as it is, of four one in 24."""
    chances = [chance_of(seed, rows, telling=True) for seed in range(60)]
    assert min(chances) >= {3: 0.1, 4: 0.02}[rows]


def test_the_groups_that_tell_are_chosen_and_no_more():
    groups, goals = drawn(30, 15, 2), drawn(15, 4, seed=1)
    groups[3], groups[21] = goals[:, :2], goals[:, 2:]
    choice = choose(groups, no_penalties(groups), goals, 5)
    assert {*choice.columns[:2]} == {3, 21}
    assert choice.error < 0.01
    only = choose(groups, no_penalties(groups), goals, 1)
    assert len(only.columns) == 1


def test_a_penalty_decides_between_equals():
    groups, goals = drawn(2, 10, 2), drawn(10, 2, seed=1)
    groups[1] = groups[0] = goals
    penalties = torch.tensor([0.1, 0.0], dtype=torch.float64)
    choice = choose(groups, penalties, goals, 1)
    assert choice.columns == (1,)
    assert choice.error == choose(groups[1:], penalties[1:], goals, 1).error  # told without it


def test_the_first_of_ordered_features_are_taken_as_far_as_they_tell():
    features = drawn(20, 5)
    goals = features[:, :2] @ drawn(2, 3, seed=4)
    choice = choose_first(features, goals)
    assert choice.columns == (0, 1)
    assert choice.chance <= SIGNIFICANT
