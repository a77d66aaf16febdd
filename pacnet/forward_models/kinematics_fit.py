"""Which joints move a hand, and how: a fit in closed form to where the hand was seen.

The pose of a hand at the end of a chain of hinges, its place and its rotation matrix, is linear in
the products of one of 1, sin q, cos q for each hinge. So least squares finds it, without a model of
the body. As 3 joints have 27 such products and 11 have 177147, the joints that move the hand are
found first: one at a time, by an F-test of the joint's own sine and cosine and of their products
with those of each other joint, beyond all products of the joints found so far. At the end a joint
is dropped if the products of the others do as well.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray

from pacnet.forward_models.config import MAX_MOVING
from pacnet.forward_models.turn_matrices import angles_between, matrices_of, nearest_turns

Array = NDArray[np.float64]

_PER_PRODUCT = 4  # postures for each product that is fitted
_PER_JOINT = 8  # postures for each joint, before it is known which move the hand
_SIGNIFICANT = 6.0  # standard deviations; chance alone gives as many once in 1e9 tests
_LEAST_NOISE = 1e-8  # in shares of an output's standard deviation; less is rounding
_SINGULAR = 1e-12  # in mean squares of a product; what varies less was not shown


class Fitted(NamedTuple):
    """What was fitted to N postures, K of whose J angles move the hand."""

    moving: tuple[int, ...]
    coefficients: Array
    """`[3**K, 12]`, see `KinematicModel`."""
    place_rms: float
    """Of the distance of a place from the one predicted without it, in the unit given."""
    turn_rms: float
    """Of the angle between a turn and the one predicted without it [rad]."""


def least_postures(joints: int, moving: int = 0) -> int:
    """Return how many postures a fit needs, for so many joints of which so many move the hand."""
    return max(_PER_JOINT * joints, _PER_PRODUCT * 3**moving)


def fit_products(
    angles: Array, places: Array, turns: Array, moving: tuple[int, ...] | None = None
) -> Fitted:
    """Fit the pose of a hand to N postures.

    Args:
        angles: `[N, J]` [rad].
        places: `[N, 3]`.
        turns: unit quaternions, `[N, 4]`.
        moving: the joints that move the hand, if known; else they are found.

    Raises:
        ValueError: too few postures, or nothing moves the hand.
    """
    outputs = np.concatenate([places, matrices_of(torch.from_numpy(turns)).reshape(-1, 9)], axis=1)
    bases = [_Basis(column) for column in angles.T]
    chosen = _find(bases, outputs) if moving is None else list(moving)
    _check_enough(len(angles), chosen)
    fit = _Regression(_products(bases, chosen), outputs)
    missed = fit.missed / np.maximum(1 - fit.leverage, 1e-9)[:, None]  # each row left out in turn
    expected = torch.from_numpy(outputs - missed)
    off = angles_between(nearest_turns(expected[:, 3:].reshape(-1, 3, 3)), torch.from_numpy(turns))
    return Fitted(
        tuple(chosen),
        _unscaled(fit.coefficients, [bases[joint].scale for joint in chosen]),
        float(np.sqrt(np.square(missed[:, :3]).sum(axis=1).mean())),
        float(off.square().mean().sqrt()),
    )


class _Basis:
    """1, sin q and cos q of one angle, turned into three columns that are uncorrelated.

    So products have all one size, and those of an angle that hardly changes can be fitted too.
    """

    def __init__(self, angle: Array) -> None:
        ones = np.ones_like(angle)
        waves = np.stack([np.sin(angle), np.cos(angle)], axis=1)  # [N, 2]
        mean = waves.mean(axis=0)
        _, size, axes = np.linalg.svd((waves - mean) / np.sqrt(len(angle)), full_matrices=False)
        self.moves = size[0] > 1e-9
        shown = size > 1e-9
        turn = axes.T * np.where(shown, 1 / np.where(shown, size, 1.0), 0.0)  # [2, 2]
        self.values = np.concatenate([ones[:, None], (waves - mean) @ turn], axis=1)  # [N, 3]
        self.scale = np.zeros((3, 3))  # values = (1, sin, cos) @ scale
        self.scale[0] = 1.0, *(-mean @ turn)
        self.scale[1:, 1:] = turn


class _Regression:
    """Least squares of outputs `[N, O]` on columns `[N, P]`; of least length if there are many."""

    def __init__(self, columns: Array, outputs: Array) -> None:
        value, vector = np.linalg.eigh(columns.T @ columns)
        shown = value > _SINGULAR * len(columns)
        self._whiten = vector[:, shown] / np.sqrt(value[shown])  # [P, rank]
        self._white = columns @ self._whiten  # [N, rank]
        self.rank = int(shown.sum())
        self.coefficients = self._whiten @ (self._white.T @ outputs)
        self.missed = self.rest(outputs)

    def rest(self, columns: Array) -> Array:
        """Return what the regression does not explain of other columns `[N, O]`."""
        return columns - self._white @ (self._white.T @ columns)

    @property
    def leverage(self) -> Array:
        """How far each row determines its own prediction, `[N]`."""
        return np.square(self._white).sum(axis=1)


def _find(bases: list[_Basis], outputs: Array) -> list[int]:
    """Return the joints that move the hand, ascending."""
    spread = outputs.std(axis=0)
    changing = spread > 1e-9 * max(spread.max(), 1e-30)
    outputs = (outputs[:, changing] - outputs[:, changing].mean(axis=0)) / spread[changing]
    others = [joint for joint, basis in enumerate(bases) if basis.moves]
    found: list[int] = []
    while others and changing.any():
        base = _Regression(_products(bases, sorted(found)), outputs)
        effects = [_effect_beyond(base, bases, joint, others + found) for joint in others]
        best = int(np.argmax(effects))
        if effects[best] < _SIGNIFICANT:
            break
        found.append(others.pop(best))
        _check_enough(len(outputs), found)
    return _without_idle(sorted(found), bases, outputs)


def _effect_beyond(base: _Regression, bases: list[_Basis], joint: int, among: list[int]) -> float:
    """Return how surely a joint has an effect that a regression lacks [standard deviations]."""
    own = bases[joint].values[:, 1:]
    pairs = [_pairs(own, bases[other].values[:, 1:]) for other in among if other != joint]
    fit = _Regression(base.rest(np.concatenate([own, *pairs], axis=1)), base.missed)
    return _significance(base.missed, fit.missed, fit.rank, base.rank + fit.rank)


def _without_idle(found: list[int], bases: list[_Basis], outputs: Array) -> list[int]:
    """Drop, one at a time, joints without which all products of the others do as well."""
    while found:
        whole = _Regression(_products(bases, found), outputs)
        effects = []
        for joint in found:
            others = [other for other in found if other != joint]
            part = _Regression(_products(bases, others), outputs)
            more = whole.rank - part.rank
            effects.append(_significance(part.missed, whole.missed, more, whole.rank))
        least = int(np.argmin(effects))
        if effects[least] >= _SIGNIFICANT:
            return found
        found = found[:least] + found[least + 1 :]
    raise ValueError("expected one or more angles that move the hand, got none")


def _significance(less: Array, more: Array, columns: int, rank: int) -> float:
    """Return how surely some columns have an effect, as a standard normal deviate.

    It is that of the largest F of all outputs, which are in units of their standard deviations
    (Paulson's approximation of F, 1942).

    Args:
        less: what is missed without the columns, `[N, O]`.
        more: what is missed with them, `[N, O]`.
        columns: their rank.
        rank: of all columns that were fitted.
    """
    free = len(less) - rank
    if columns == 0 or free < 1:
        return 0.0
    without, missed = np.square(less).sum(axis=0), np.square(more).sum(axis=0)
    noise = missed / free + _LEAST_NOISE**2
    ratio = np.cbrt(float(((without - missed) / columns / noise).max()))
    above, below = 2 / (9 * columns), 2 / (9 * free)
    return ((1 - below) * ratio - (1 - above)) / np.sqrt(below * ratio**2 + above)


def _products(bases: list[_Basis], joints: list[int]) -> Array:
    """Return all products of one column of each joint, `[N, 3**K]`; the last changes soonest."""
    product = np.ones((len(bases[0].values), 1))
    for joint in joints:
        product = _pairs(product, bases[joint].values)
    return product


def _pairs(first: Array, second: Array) -> Array:
    """Return the products of each column of the first with each of the second, `[N, A · B]`."""
    return (first[:, :, None] * second[:, None, :]).reshape(len(first), -1)


def _unscaled(coefficients: Array, scales: list[Array]) -> Array:
    """Return coefficients of products of 1, sin and cos, `[3**K, O]`, from those of the bases."""
    whole: NDArray[Any] = coefficients.reshape(*[3] * len(scales), -1)
    for axis, scale in enumerate(scales):
        whole = np.moveaxis(np.tensordot(scale, whole, axes=(1, axis)), 0, axis)
    return whole.reshape(coefficients.shape)


def _check_enough(postures: int, moving: list[int]) -> None:
    if len(moving) > MAX_MOVING:
        raise ValueError(f"expected at most {MAX_MOVING} angles that move the hand, got more")
    needed = _PER_PRODUCT * 3 ** len(moving)
    if postures < needed:
        raise ValueError(
            f"expected at least {needed} postures, as angles {sorted(moving)} move the hand, "
            f"got {postures}"
        )
