"""The law of a point that moves alike in all directions: three coefficients, two of them numbers.

Displacements or speeds that are commanded move a point equally far in each direction, along axes at
right angles. A hand that pushes against something moves less than that; such frames hardly count.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pacnet.forward_models.affine_rows import Array

_ROUNDS = 12
_OUTLYING = 2.0  # times the median residual, from which a moment counts less
_BETTER = 0.85  # share of the error that is left with turned axes, for them to be turned
_TURNED = 20.0  # angle of axes that are turned, at least [degrees]


def fit_alike(sent: Array, before: Array, changes: Array) -> Array:
    """Return coefficients of N moments, `[K + S, S]`, with K = S.

    Args:
        sent: mean action of the K actions that move the point, `[N, K]`.
        before: last change, `[N, S]`.
        changes: to be explained, `[N, S]`.
    """
    moments = _Moments(sent, before, changes)
    plain, other = _fit(moments, turned=False), _fit(moments, turned=True)
    angle = np.degrees(np.arccos(np.clip(_cosine(other.axes), -1, 1)))
    best = other if angle > _TURNED and other.error < _BETTER * plain.error else plain
    return np.concatenate([best.gain * best.axes, best.lag * np.eye(changes.shape[1])])


class _Moments(NamedTuple):
    sent: Array  # [N, K]
    before: Array  # [N, S]
    changes: Array  # [N, S]


class _Law(NamedTuple):
    gain: float
    lag: float
    axes: Array  # [K, S], at right angles
    error: float  # median


def _fit(moments: _Moments, *, turned: bool) -> _Law:
    """Return the law along the percept's axes, or along those that explain most."""
    sent, before, changes = moments
    axes, weight = np.eye(changes.shape[1]), np.ones((len(sent), 1))
    gain = lag = error = 0.0
    for _ in range(_ROUNDS):
        if turned:
            axes = _explaining(moments, weight)
        inputs = np.stack([(weight * (sent @ axes)).ravel(), (weight * before).ravel()], axis=1)
        solved = np.linalg.lstsq(inputs, (weight * changes).ravel(), rcond=None)[0]
        gain, lag = solved.tolist()
        residual = np.linalg.norm(changes - gain * sent @ axes - lag * before, axis=1)
        error = float(np.median(residual))
        limit = _OUTLYING * error + 1e-12 * float(np.abs(changes).max(initial=0.0)) + 1e-300
        weight = 1 / np.maximum(1, residual / limit)[:, None]
    return _Law(gain, lag, axes, error)


def _explaining(moments: _Moments, weight: Array) -> Array:
    """Return axes at right angles `[K, S]` along which actions explain most of the changes.

    What the last change says of either is taken away first: smooth actions are much like it.
    """
    sent, before, changes = moments
    both = weight * np.concatenate([sent, changes], axis=1)
    known = weight * before
    both = both - known @ np.linalg.lstsq(known, both, rcond=None)[0]
    sent, changes = np.split(both, [sent.shape[1]], axis=1)
    left, _, right = np.linalg.svd(sent.T @ changes)  # orthogonal Procrustes problem
    return left @ right


def _cosine(axes: Array) -> float:
    """Return the cosine of the angle by which axes in a plane or in space are turned."""
    free = len(axes) - 2
    return float(np.trace(axes) - free) / 2
