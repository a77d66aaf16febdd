"""What the map's kernels read and write: the config's numbers, and the record of T samples."""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from pacnet.attention import kernels
from pacnet.attention.config import SOFMConfig
from pacnet.attention.records import NO_NODE, Attention, MapUpdate, observation_of

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
"""The config's numbers, rounded to float32 as torch rounds a Python number."""


def rules_of(config: SOFMConfig) -> NDArray[np.void]:
    """Return the config as one row of `RULES`, `[1]`."""
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
    """Return the smallest float32 distance at which torch's exp(−distance) is under the threshold.

    The eager engine compares activations. The kernels compare distances with this one, so that both
    decide alike where two exponential functions differ in the last digit.
    """
    near, far = 0, int(np.float32(np.inf).view(np.int32))  # floats ≥ 0 are ordered as their bits
    while far - near > 1:
        middle = (near + far) // 2
        distance = torch.from_numpy(np.array([middle], np.int32).view(np.float32))
        is_novel = bool(torch.exp(-distance) < threshold)
        near, far = (near, middle) if is_novel else (middle, far)
    return float(np.int32(far).view(np.float32))


class Record(NamedTuple):
    """What the kernels write about T samples."""

    winner: NDArray[np.int64]  # [T]
    runner_up: NDArray[np.int64]  # [T]
    activation: NDArray[np.float32]  # [T]
    events: NDArray[np.uint8]  # [T], bits
    since: NDArray[np.int64]  # [T], `MapUpdate.habituated_at`

    @classmethod
    def empty(cls, samples: int) -> Record:
        """Return a record of so many samples, to be written."""
        winner, runner_up, since = np.empty((3, samples), np.int64)
        activation, events = np.empty(samples, np.float32), np.empty(samples, np.uint8)
        return cls(winner, runner_up, activation, events, since)


def map_update(record: Record, deleted: dict[int, Tensor]) -> MapUpdate:
    """Return what the kernels wrote, and the nodes deleted after each sample, as tensors."""
    novelty, inserted, ignored, dishabituated, habituated = (
        torch.from_numpy((record.events & event) != 0)
        for event in (
            kernels.NOVEL, kernels.INSERTED, kernels.IGNORED,
            kernels.DISHABITUATED, kernels.HABITUATED,
        )
    )  # fmt: skip
    winner, runner_up, activation = map(torch.from_numpy, record[:3])
    attention = Attention(winner, runner_up, activation, novelty)
    observation = observation_of(attention, inserted, ignored, dishabituated, deleted)
    return MapUpdate(observation, habituated, torch.from_numpy(record.since), deleted)
