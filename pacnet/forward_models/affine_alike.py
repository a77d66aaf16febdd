"""The law of a point that moves alike in all directions: three coefficients, two of them numbers.

Displacements or speeds that are commanded move a point equally far in each direction, along axes at
right angles. A hand that pushes against something moves less than that; such frames hardly count.
"""

from __future__ import annotations

import numpy as np

from pacnet.forward_models.affine_rows import Array

_ROUNDS = 10
_OUTLYING = 2.0  # times the median residual, from which one counts less
_TURNED = 0.4  # share of the error that is left with turned axes, for them to be turned


def fit_alike(sent: Array, before: Array, changes: Array) -> Array:
    """Return coefficients of N moments, `[K + S, S]`, with K = S.

    Args:
        sent: mean action of the K actions that move the point, `[N, K]`.
        before: last change, `[N, S]`.
        changes: to be explained, `[N, S]`.
    """
    straight = np.eye(changes.shape[1])
    (gain, lag), error = _fit(sent, before, changes, straight)
    axes = _turned(sent, before, changes)
    turned, error_turned = _fit(sent, before, changes, axes)
    if error_turned < _TURNED * error:
        (gain, lag), straight = turned, axes
    return np.concatenate([gain * straight, lag * np.eye(changes.shape[1])])


def _turned(sent: Array, before: Array, changes: Array) -> Array:
    """Return axes at right angles `[K, S]` along which actions explain most of the changes.

    What the last change says of either is taken away first: smooth actions are much like it.
    """
    both = np.concatenate([sent, changes], axis=1)
    known = np.linalg.lstsq(before, both, rcond=None)[0]
    sent, changes = np.split(both - before @ known, [sent.shape[1]], axis=1)
    left, _, right = np.linalg.svd(sent.T @ changes)  # orthogonal Procrustes problem
    return left @ right


def _fit(sent: Array, before: Array, changes: Array, axes: Array) -> tuple[Array, float]:
    """Return gain and lag along axes `[K, S]`, and the median error."""
    inputs = np.stack([(sent @ axes).ravel(), before.ravel()], axis=1)
    wanted = changes.ravel()
    weight = np.ones(len(wanted))
    found: Array = np.zeros(2)
    error = 0.0
    for _ in range(_ROUNDS):
        solved = np.linalg.lstsq(inputs * weight[:, None], wanted * weight, rcond=None)
        found = solved[0].astype(np.float64)
        residual = np.abs(wanted - inputs @ found)
        error = float(np.median(residual))
        limit = _OUTLYING * error + 1e-12 * float(np.abs(wanted).max(initial=0.0)) + 1e-300
        weight = np.sqrt(1 / np.maximum(1, residual / limit))
    return found, error
