"""An affine law of how the state changes, fitted in closed form and chosen on held-out blocks.

With one short demonstration some actions are hardly tried. Ridge regression draws their gains
towards what is usual of a robot. A place that is commanded is gone to, by the same share of the way
in each dimension. Speeds or displacements, as many as the state has dimensions, move it equally far
in directions at right angles. How strongly gains are drawn is chosen on blocks of frames held out.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pacnet.forward_models.affine_alike import fit_alike
from pacnet.forward_models.affine_rows import Array, Rows, rows_of

_RIDGES = (1e-4, 1e-3, 1e-2, 1e-1, 1.0)  # in shares of each input's variance
_WORSE = 0.02  # log of a held-out error's ratio, summed over the state; less is no difference
_TIE = 0.1  # mean log of the errors' ratio up to which the larger ridge is taken
_EFFECT_RIDGE = 0.1
_SIMPLER = 0.4  # mean log of the errors' ratio up to which the simpler law is taken
_SMALL, _TINY = 0.8, 0.2  # in shares of the median effect of all actions
_LEAST_ERROR = 1e-6  # in shares of the mean square of a dimension's change


class Law(NamedTuple):
    """An affine law for S dimensions of the state and U actions, see `AffineForwardModel`."""

    gain: Array
    """Change over the lead with each action, `[S, U]`."""
    lag: Array
    """Change with the last frame's change, `[S, S]`."""
    drift: Array
    """Change without either, `[S]`."""
    inverse: Array
    """Action for a change, `[U, S]`."""
    moves: NDArray[np.bool_]
    """Whether an action moves the state, `[U]`."""
    residual_variance: Array
    """Mean square of what is not predicted of held-out changes, a millionth at least, `[S]`."""
    explained: Array
    """Share of held-out changes that is predicted, `[S]`."""


class _Moments(NamedTuple):
    """Covariances of the inputs of interest, P, with themselves and with the changes."""

    inputs: Array  # [P, P]
    changes: Array  # [P, S]
    actions: int  # of the inputs, the first K

    def ridge(self, share: float, prior: Array, *, alike: bool) -> Array:
        """Return coefficients `[P, S]`, drawn towards a prior.

        Args:
            share: of an input's variance that is added to it.
            prior: `[P, S]`.
            alike: whether all actions have one unit, so that their mean variance counts.
        """
        variance = np.diag(self.inputs).copy()
        if alike:
            variance[: self.actions] = variance[: self.actions].mean()
        size = np.sqrt(np.where(variance > 0, variance, 1.0))
        scaled = self.inputs / np.outer(size, size) + share * np.eye(len(size))
        rest = (self.changes - self.inputs @ prior) / size[:, None]
        return prior + np.linalg.solve(scaled, rest) / size[:, None]


class _Fit(NamedTuple):
    """What was fitted to a part of the state, s of its dimensions."""

    coefficients: Array  # [U + s, s]
    drift: Array  # [s]
    kept: NDArray[np.bool_]  # [U]
    error: Array  # [s], held out


def fit_law(
    states: Sequence[Array],
    actions: Sequence[Array],
    follows: Sequence[int],
    lead: int,
    turns: int = 0,
) -> Law:
    """Fit the law to episodes, states `[T, S]` and actions `[T, U]` each.

    Args:
        states: of each episode.
        actions: of each.
        follows: for each action the dimension of the state that it is a place of, −1 for none.
        lead: frames.
        turns: how many of the state's last dimensions are turns; they are fitted apart, since a
            hand turns otherwise than it moves.

    Raises:
        ValueError: fewer frames than two blocks need; see `least_frames`.
    """
    rows = rows_of(states, actions, follows, lead)
    if rows.part.max(initial=0) < 1:
        raise ValueError(
            f"expected an episode of at least {least_frames(lead)} frames to fit {lead} frames "
            f"ahead, got {[len(one) for one in states]}"
        )
    count, size = len(follows), rows.changes.shape[1]
    gain, lag, drift = np.zeros((size, count)), np.zeros((size, size)), np.zeros(size)
    kept, error = np.zeros(count, bool), np.zeros(size)
    for part in filter(len, (range(size - turns), range(size - turns, size))):
        of = slice(part.start, part.stop)
        fit = _fit(*_part_of(rows, np.array(follows), part), is_place=part.start == 0)
        gain[of], lag[of, of] = fit.coefficients[:count].T, fit.coefficients[count:].T
        drift[of], error[of] = fit.drift, fit.error
        kept |= fit.kept
    square = np.square(rows.changes[rows.part >= 0]).mean(axis=0)
    error = np.maximum(error, _LEAST_ERROR * square)  # so that float32 tells it from none
    explained = np.where(square > 0, 1 - error / np.where(square > 0, square, 1), 0.0)
    spread = np.sqrt(np.square(rows.inputs[:, :count]).mean(axis=0))
    weight = np.where(square > 0, 1 / np.maximum(error, 1e-300), 0.0)
    return Law(gain, lag, drift, _invert(gain, weight, spread, kept), kept, error, explained)


def _part_of(rows: Rows, place: NDArray[np.int64], part: range) -> tuple[Rows, NDArray[np.int64]]:
    """Return the moments of some dimensions of the state, and what actions are places of there."""
    inside = (place >= part.start) & (place < part.stop)
    columns = [*range(len(place)), *(len(place) + dimension for dimension in part)]
    of_part = rows._replace(inputs=rows.inputs[:, columns], changes=rows.changes[:, [*part]])
    return of_part, np.where(inside, place - part.start, -1)


def _fit(rows: Rows, place: NDArray[np.int64], *, is_place: bool) -> _Fit:
    """Fit the law to moments; the simpler one, if that is hardly worse, where it may be."""
    regression = _Regression(rows, place)
    kept, ridge = _choose(regression, place)
    coefficients, drift = regression.solve(regression.everything, kept, ridge)
    error = regression.held_out_error(kept, ridge)
    first = np.arange(len(place)) < len(error)  # a hand's place before its gripper, as is usual
    for movers in (first, kept) if is_place else ():
        if _are_alike(movers, place, len(error)):
            simple = _held_out_alike(rows, movers)
            if _log_ratio(simple, error, rows) < _SIMPLER * len(error):
                coefficients, drift = _alike(rows, movers, slice(None)), np.zeros(len(error))
                kept, error = movers, simple
                break
    return _Fit(coefficients, drift, kept, error)


def _are_alike(kept: NDArray[np.bool_], place: NDArray[np.int64], states: int) -> bool:
    """Return whether these actions may move a point in a plane or in space."""
    return states in (2, 3) and int(kept.sum()) == states and not (place[kept] >= 0).any()


def _alike(rows: Rows, kept: NDArray[np.bool_], chosen: NDArray[np.bool_] | slice) -> Array:
    """Return the coefficients `[U + S, S]` of a point that moves alike in all directions."""
    inputs, count = rows.inputs[chosen], len(kept)
    found = fit_alike(inputs[:, :count][:, kept], inputs[:, count:], rows.changes[chosen])
    coefficients = np.zeros((rows.inputs.shape[1], rows.changes.shape[1]))
    coefficients[np.append(kept, np.ones(rows.changes.shape[1], bool))] = found
    return coefficients


def _held_out_alike(rows: Rows, kept: NDArray[np.bool_]) -> Array:
    """Return the mean squared error of each dimension, each part held out in turn, `[S]`."""
    squares = np.zeros(rows.changes.shape[1])
    for part in range(int(rows.part.max()) + 1):
        chosen = rows.part == part
        coefficients = _alike(rows, kept, (rows.part >= 0) & ~chosen)
        squares += np.square(rows.changes[chosen] - rows.inputs[chosen] @ coefficients).sum(axis=0)
    return squares / (rows.part >= 0).sum()


def _log_ratio(error: Array, other: Array, rows: Rows) -> float:
    """Return by how much larger an error is, as a sum of logs over the state."""
    floor = _LEAST_ERROR * np.square(rows.changes).mean(axis=0) + 1e-300
    return float(np.log(np.maximum(error, floor) / np.maximum(other, floor)).sum())


def least_frames(lead: int) -> int:
    """Return the frames of a single episode that are enough for two blocks."""
    return 5 * lead + 1


class _Regression:
    """Ridge regressions of some inputs, from sums over the parts that are not held out."""

    def __init__(self, rows: Rows, place: NDArray[np.int64]) -> None:
        self._rows, self._place = rows, place
        self.states = rows.changes.shape[1]
        used = range(int(rows.part.max()) + 1)
        self._of_part = [self._sums(rows.part == part) for part in used]
        self._in_parts = sum(self._of_part[1:], self._of_part[0])
        self.everything = self._sums(np.ones(len(rows.part), bool))

    def _sums(self, chosen: NDArray[np.bool_]) -> Array:
        """Return sums of products of inputs, changes and 1."""
        ones = np.ones((int(chosen.sum()), 1))
        columns = np.concatenate([self._rows.inputs[chosen], self._rows.changes[chosen], ones], 1)
        return columns.T @ columns

    def solve(self, sums: Array, kept: NDArray[np.bool_], ridge: float) -> tuple[Array, Array]:
        """Return coefficients `[U + S, S]`, 0 of actions that are not kept, and the constant."""
        mean = sums[:-1, -1] / sums[-1, -1]
        covariance = sums[:-1, :-1] / sums[-1, -1] - np.outer(mean, mean)
        count = len(mean) - self.states
        of = np.append(kept, np.ones(count - len(kept), bool)).nonzero()[0]
        moments = _Moments(covariance[np.ix_(of, of)], covariance[of, count:], int(kept.sum()))
        coefficients = np.zeros((count, self.states))
        place = self._place[kept]
        alike = len(place) == self.states and not (place >= 0).any()
        prior = _prior(moments, place)
        coefficients[of] = moments.ridge(ridge, prior, alike=alike)
        return coefficients, mean[count:] - mean[:count] @ coefficients

    def held_out_error(self, kept: NDArray[np.bool_], ridge: float) -> Array:
        """Return the mean squared error of each dimension, each part held out in turn, `[S]`."""
        squares, inputs, changes = np.zeros(self.states), self._rows.inputs, self._rows.changes
        for part, sums in enumerate(self._of_part):
            chosen = self._rows.part == part
            coefficients, constant = self.solve(self._in_parts - sums, kept, ridge)
            missed = changes[chosen] - inputs[chosen] @ coefficients - constant
            squares += np.square(missed).sum(axis=0)
        return squares / (self._rows.part >= 0).sum()

    def best(self, kept: NDArray[np.bool_]) -> tuple[float, float]:
        """Return the ridge of least error, and that error's logs summed over the state."""
        errors = {ridge: self.held_out_error(kept, ridge) for ridge in _RIDGES}
        floor = _LEAST_ERROR * np.square(self._rows.changes).mean(axis=0)
        logs = {
            ridge: float(np.log(np.maximum(error, floor) + 1e-300).sum())
            for ridge, error in errors.items()
        }
        best = min(logs.values())
        ridge = max(ridge for ridge, one in logs.items() if one - best <= _TIE * self.states)
        return ridge, best

    def effects(self, kept: NDArray[np.bool_]) -> Array:
        """Return the largest change of a dimension with each action, in standard deviations."""
        coefficients, _ = self.solve(self.everything, kept, _EFFECT_RIDGE)
        deviation = self._rows.changes.std(axis=0)
        relative = coefficients[: len(kept)] / np.where(deviation > 0, deviation, np.inf)
        return np.abs(relative).max(axis=1) * self._rows.inputs[:, : len(kept)].std(axis=0)


def _choose(regression: _Regression, place: NDArray[np.int64]) -> tuple[NDArray[np.bool_], float]:
    """Return which actions move the state, and the ridge.

    While there are more actions than dimensions to move, the one of least effect is left out if
    its effect is small beside the others' or held-out frames are predicted as well without it;
    later only if it has hardly any, and they are. A place moves the state that it is a place of.
    """
    kept = (place >= 0) | (regression.effects(np.ones(len(place), bool)) > 0)
    ridge, error = regression.best(kept)
    while (kept & (place < 0)).any():
        effect = regression.effects(kept)
        least = int(np.argmin(np.where(kept & (place < 0), effect, np.inf)))
        without = kept & (np.arange(len(place)) != least)
        other = regression.best(without)
        share = effect[least] / np.median(effect[kept])
        is_as_good = other[1] - error < _WORSE
        has_more = kept.sum() > regression.states
        if not (share < _SMALL or is_as_good if has_more else share < _TINY and is_as_good):
            break
        kept, (ridge, error) = without, other
    return kept, ridge


def _prior(moments: _Moments, place: NDArray[np.int64]) -> Array:
    """Return what the coefficients are drawn towards, `[P, S]`."""
    actions, (inputs, states) = moments.actions, moments.changes.shape
    prior = np.zeros((inputs, states))
    if not ((place >= 0).any() or actions == states):
        return prior
    # Of actions and changes alike, what the last change explains is taken away.
    known = moments.inputs[actions:, actions:]
    known = known + np.diag(1e-2 * np.diag(known) + 1e-300)
    across = moments.inputs[:actions, actions:]
    explained = np.linalg.solve(known, np.concatenate([across.T, moments.changes[actions:]], 1))
    products = moments.inputs[:actions, :actions] - across @ explained[:, :actions]
    responses = moments.changes[:actions] - across @ explained[:, actions:]
    if (place >= 0).any():
        directions = (place[:, None] == np.arange(states)).astype(float)
    else:  # orthogonal Procrustes problem
        left, _, right = np.linalg.svd(responses)
        directions = left @ right
    square = np.trace(products @ directions @ directions.T)
    if square > 0:
        prior[:actions] = (directions * responses).sum() / square * directions
    return prior


def _invert(gain: Array, weight: Array, spread: Array, kept: NDArray[np.bool_]) -> Array:
    """Return the likeliest actions for a change, `[U, S]`; 0 of those that move nothing.

    What is not predicted of a change has the variance 1 / weight, and an action the mean square
    that was shown, so that noise in a change that is hardly due to actions moves them little.
    """
    inverse = np.zeros(gain.T.shape)
    size = spread[kept]
    scaled = gain[:, kept] * size  # [S, K]
    products = scaled.T @ (weight[:, None] * scaled)
    solved = np.linalg.solve(products + np.eye(len(size)), scaled.T * weight)
    inverse[kept] = size[:, None] * solved
    return inverse
