"""The growing map's settings as its kernels read them."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import torch
from numpy.typing import NDArray

from pacnet.attention.config import SOFMConfig
from pacnet.attention.records import NO_NODE

_FLOAT, _INTEGER, _SWITCH = np.float32, np.int64, np.bool_

RULES = np.dtype(
    [
        ("novel_from", _FLOAT),  # distance from which a percept is novel
        ("habituated_below", _FLOAT),
        ("resting_habituation", _FLOAT),
        ("floor_habituation", _FLOAT),
        ("winner_rate", _FLOAT),
        ("neighbour_rate", _FLOAT),
        ("winner_decay", _FLOAT),
        ("neighbour_decay", _FLOAT),
        ("forgetting_interval", _INTEGER),  # NO_NODE for never
        ("max_edge_age", _INTEGER),
        ("insert_only_when_habituated", _SWITCH),
        ("insert_at_percept", _SWITCH),
        ("ignore_when_habituated", _SWITCH),
        ("habituation_scales_learning", _SWITCH),
    ],
    align=True,
)
"""The settings as the kernels read them, rounded to float32 as torch rounds a number it meets."""


def rules_of(config: SOFMConfig) -> NDArray[np.void]:
    """The settings as one row of `RULES`, `[1]`."""
    rules = np.zeros(1, RULES)
    for name in RULES.names or ():
        if hasattr(config, name):
            value = getattr(config, name)
            rules[name] = NO_NODE if value is None else value
    rules["novel_from"] = novel_from(config.novelty_threshold)
    rules["winner_decay"] = config.decay(config.winner_tau)
    rules["neighbour_decay"] = config.decay(config.neighbour_tau)
    rules["insert_at_percept"] = config.insert_at == "percept"
    return rules


@lru_cache
def novel_from(threshold: float) -> float:
    """The smallest float32 distance at which torch's exp(−distance) is under the threshold.

    The eager engine compares activations; so that both decide alike at the very edge, where two
    exponential functions differ in the last digit, the kernels compare distances with this one.
    """
    # Floats ≥ 0 are ordered as their bits: bisection between bits, from around where it must lie.
    guess = int(np.float32(-np.log(threshold)).view(np.int32))
    reach, near, far = 1, guess, guess
    while near > 0 and _is_under(near, threshold):
        far, near, reach = near, max(0, near - reach), 2 * reach
    while far < _INFINITE and not _is_under(far, threshold):
        near, far, reach = far, min(_INFINITE, far + reach), 2 * reach
    while far - near > 1:
        middle = (near + far) // 2
        near, far = (near, middle) if _is_under(middle, threshold) else (middle, far)
    return float(np.int32(far).view(np.float32))


_INFINITE = int(np.float32(np.inf).view(np.int32))


def _is_under(bits: int, threshold: float) -> bool:
    distance = torch.from_numpy(np.array([bits], np.int32).view(np.float32))
    return bool(torch.exp(-distance) < threshold)
