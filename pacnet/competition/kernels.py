"""Kernels of the belief and of the schemas' confidences."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from pacnet.kernels.caching import cached_njit

OUT_OF_REACH = -1.0
"""A confidence under every threshold."""


@cached_njit()
def predict(probability, advance, predicted):
    """Write the belief one sample later, `[E, P]`, from the last and the chances `[E, K]`."""
    episodes, states = probability.shape
    predicted[:] = 0.0
    for episode in range(episodes):
        now, then, end = probability[episode], predicted[episode], states - 1
        for step in range(advance.shape[1]):
            chance = advance[episode, step]
            for state in range(end - step):
                then[state + step] += chance * now[state]
            for state in range(max(0, end - step), states):
                then[end] += chance * now[state]  # an episode stays at its end
    _normalize(predicted)


@cached_njit()
def weight(
    predicted, start, restart_prob, rows, distances, obs_std, outlier_likelihood, probability
):
    """Write the belief `[E, P]` after a percept; return whether each row has a distance `[R]`."""
    episodes, states = rows.shape
    for row in rows.flat:
        if not 0 <= row < len(distances):
            return False
    for episode in range(episodes):
        for state in range(states):
            deviation = np.float64(distances[rows[episode, state]]) / obs_std
            expected = (
                restart_prob * start[episode, state]
                + (1 - restart_prob) * predicted[episode, state]
            )
            probability[episode, state] = (
                math.exp(-deviation * deviation / 2) + outlier_likelihood
            ) * expected
    _normalize(probability)
    return True


@cached_njit()
def confidences_of(  # noqa: C901 - checks and loops, none of them deep
    probability, visits, distances, spans, reach, confidences
):
    """Write the confidences `[K]` of schemas; return whether all indices are in range.

    Args:
        probability: of every state of every known episode, flat.
        visits: first and last state of each, and the index of its schema, `[N, 3]`.
        distances: of the percept from every row, `[R]`.
        spans: first row of each schema and the row after its last, `[K, 2]`.
        reach: distance from its nearest row beyond which a schema does not compete.
        confidences: the output.
    """
    for visit in range(len(visits)):
        first, last, schema = visits[visit, 0], visits[visit, 1], visits[visit, 2]
        if not (first >= 0 and last < len(probability) and 0 <= schema < len(spans)):
            return False
    for schema in range(len(spans)):
        if not 0 <= spans[schema, 0] <= spans[schema, 1] <= len(distances):
            return False
    watched = np.zeros(len(spans), np.float64)
    for visit in range(len(visits)):
        schema = visits[visit, 2]
        for state in range(visits[visit, 0], visits[visit, 1] + 1):
            watched[schema] += probability[state]
    for schema in range(len(spans)):
        nearest = np.float32(np.inf)
        for row in range(spans[schema, 0], spans[schema, 1]):
            nearest = min(nearest, distances[row])
        confidences[schema] = min(watched[schema], 1.0) * math.exp(-nearest)
        if nearest > reach:
            confidences[schema] = OUT_OF_REACH
    return True


@njit
def _normalize(probability):
    total = probability.sum()
    for episode in range(len(probability)):
        for state in range(probability.shape[1]):
            probability[episode, state] /= total
