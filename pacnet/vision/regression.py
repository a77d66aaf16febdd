"""Ridge regression of goals on few features, judged by leaving each demonstration out.

With features Z `[N, d]` of mean m, and goals Y of mean b, the weights W minimise
|Y − b − (Z − m) W|² + r |W|², with r = ridge · N · the mean variance of the features. The error of
a row that is left out follows from the whole fit (Allen's PRESS): its residual over 1 − its
leverage.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

RIDGES = (1e-3, 1e-2)
PERMUTATIONS = 199
SIGNIFICANT = 0.05
"""Share of permutations that foretell goals as well, up to which features tell something."""


class Choice(NamedTuple):
    """Features that were chosen, and how well they foretell goals."""

    columns: tuple[int, ...]
    """Numbers of the features."""
    ridge: float
    error: float
    """Mean square error with each row left out, over that of the mean of the others."""
    chance: float
    """Share of permutations of the goals that the best single feature foretells as well."""


def left_out(features: Tensor, goals: Tensor, ridge: float) -> Tensor:
    """Return the errors of the goals of each row, foretold by the others, `[..., N, m]`.

    Args:
        features: `[..., N, d]`, float64.
        goals: `[N, m]`.
        ridge: in shares of the features' mean variance, > 0.
    """
    hat = _hat(features, ridge)
    leverage = hat.diagonal(dim1=-2, dim2=-1)[..., None]
    return (goals - hat @ goals) / (1 - leverage).clamp(min=1e-9)


def left_out_of_mean(goals: Tensor) -> Tensor:
    """Return the errors of the goals `[N ≥ 2, m]` of each row, foretold by the others' mean."""
    count = len(goals)
    return (goals - goals.mean(dim=0)) * (count / (count - 1))


def choose(groups: Tensor, penalties: Tensor, goals: Tensor, most: int) -> Choice:
    """Choose groups of features one after the other, as long as the error falls.

    The guard against chance: the goals are permuted among the rows, and the best single group found
    again.

    Args:
        groups: K groups of d features in N rows, `[K, N, d]`, float64.
        penalties: added to the error of each, `[K]`.
        goals: `[N ≥ 3, m]`, float64.
        most: groups to choose, at most.
    """
    scale = left_out_of_mean(goals).square().mean().clamp(min=1e-30)
    best, ridge = _best_single(groups, penalties, goals, scale)
    chosen, error = [int(best.argmin())], float(best.min())
    chance = _chance(groups, penalties, goals, scale, error)
    while len(chosen) < most:
        sets = [groups[chosen].transpose(0, 1).flatten(1).expand(len(groups), -1, -1), groups]
        errors = _relative(torch.cat(sets, dim=2), goals, ridge, scale) + penalties
        errors[chosen] = np.inf
        if float(errors.min()) > _FALLS * error:
            break
        chosen.append(int(errors.argmin()))
        error = float(errors.min())
    told = float(_relative(groups[chosen].transpose(0, 1).flatten(1), goals, ridge, scale))
    return Choice(tuple(chosen), ridge, told, chance)


_FALLS = 0.9  # of the error, at least, for one more group
_ROUNDING = 1e-9  # share of the error


def _relative(features: Tensor, goals: Tensor, ridge: float, scale: Tensor) -> Tensor:
    """Return the mean square error over that of the mean, `[...]`."""
    return left_out(features, goals, ridge).square().mean(dim=(-2, -1)) / scale


def _best_single(
    groups: Tensor, penalties: Tensor, goals: Tensor, scale: Tensor
) -> tuple[Tensor, float]:
    """Return the errors of each group alone `[K]` with the ridge that is best for one of them."""
    errors = {ridge: _relative(groups, goals, ridge, scale) + penalties for ridge in RIDGES}
    ridge = min(errors, key=lambda one: float(errors[one].min()))
    return errors[ridge], ridge


def _chance(groups: Tensor, penalties: Tensor, goals: Tensor, scale: Tensor, error: float) -> float:
    """Return the share of permutations of the goals that some group foretells as well.

    The group and the ridge are chosen anew each time, as they were for the goals.
    """
    generator = torch.Generator().manual_seed(0)
    orders = [torch.randperm(len(goals), generator=generator) for _ in range(PERMUTATIONS)]
    permuted = torch.cat([goals[order] for order in orders], dim=1)
    best = goals.new_full((PERMUTATIONS,), np.inf)
    for ridge in RIDGES:
        squares = left_out(groups, permuted, ridge).square().mean(dim=-2)  # [K, P · m]
        errors = squares.unflatten(-1, (PERMUTATIONS, -1)).mean(dim=-1) / scale
        best = torch.minimum(best, (errors + penalties[:, None]).min(dim=0).values)
    # The order of the goals as they are is drawn, too, and foretells as well but for rounding.
    as_good = (best <= error * (1 + _ROUNDING)).sum().item()
    return (1 + as_good) / (1 + PERMUTATIONS)


def _hat(features: Tensor, ridge: float) -> Tensor:
    """Return the matrix that makes fitted goals of goals, `[..., N, N]`."""
    centred = features - features.mean(dim=-2, keepdim=True)
    own = _with_ridge(centred, ridge)
    solved = torch.linalg.solve(own, centred.transpose(-1, -2))
    return centred @ solved + 1 / features.shape[-2]


def _with_ridge(centred: Tensor, ridge: float) -> Tensor:
    rows, count = centred.shape[-2:]
    least = (ridge * rows * centred.square().mean(dim=(-2, -1))).clamp(min=1e-12)
    unit = torch.eye(count, dtype=centred.dtype)
    return centred.transpose(-1, -2) @ centred + least[..., None, None] * unit


def fit(features: Tensor, goals: Tensor, ridge: float) -> tuple[Tensor, Tensor, Tensor]:
    """Return the mean of the features `[d]`, the weights `[d, m]` and the mean of the goals `[m]`.

    Args:
        features: `[N, d]`, float64.
        goals: `[N, m]`, float64.
        ridge: as of `left_out`.
    """
    mean, centre = features.mean(dim=0), goals.mean(dim=0)
    centred = features - mean
    weights = torch.linalg.solve(_with_ridge(centred, ridge), centred.T @ (goals - centre))
    return mean, weights, centre


def choose_first(features: Tensor, goals: Tensor) -> Choice:
    """Choose how many of ordered features to use: the first 1, 2, ... of them.

    Args:
        features: `[N, D]`, float64, the most telling first.
        goals: `[N ≥ 3, m]`, float64.
    """
    none = torch.zeros(1, dtype=features.dtype)
    choices = [
        choose(features[None, :, : number + 1], none, goals, 1)
        for number in range(features.shape[1])
    ]
    number = min(range(len(choices)), key=lambda one: choices[one].error)
    best = choices[number]
    chance = min(1.0, best.chance * len(choices))  # Bonferroni: the best of several
    return best._replace(columns=tuple(range(number + 1)), chance=chance)
