"""Scores of Experiment 1: from recall episodes to the numbers of `metrics.json`."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from numpy.typing import NDArray

from pacnet import NO_NODE, PACNet
from pacnet.evaluation.metrics import area_between_curves, path_distances
from train.postural.episodes import RecallEpisode
from train.postural.winners import order_agreement, switches, winner_order

Scores = dict[str, float | int]


def winners_of(network: PACNet, percepts: NDArray[np.float32]) -> NDArray[np.int64]:
    """Return the winner at each percept `[T]`; `NO_NODE` where the match is not good enough."""
    reading = network(torch.from_numpy(percepts))
    return torch.where(reading.novelty, NO_NODE, reading.winner).numpy()


def score_order(episodes: Sequence[RecallEpisode], demonstration: NDArray[np.int64]) -> float:
    """Return the mean agreement of the winners' order with that of a demonstration.

    Args:
        episodes: Of recall.
        demonstration: Winners of the same map in a demonstration `[S]`.
    """
    taught = winner_order(demonstration)
    return _mean([order_agreement(taught, winner_order(e.winners)) for e in episodes])


def score_episodes(episodes: Sequence[RecallEpisode]) -> Scores:
    """Return means over one or more episodes, and the largest of all maxima.

    `docs/experiments.md` defines each.
    """
    distances = [path_distances(e.demonstrator_wrist, e.imitator_wrist) for e in episodes]
    areas = [area_between_curves(e.demonstrator_wrist, e.imitator_wrist) for e in episodes]
    errors = [np.degrees(e.demonstrator_angles - e.imitator_angles) for e in episodes]
    return {
        "recall_episodes": len(episodes),
        "task_success_rate": _mean([e.success for e in episodes]),
        "demonstrator_success_rate": _mean([e.demonstrator_success for e in episodes]),
        "wrist_distance_mean_m": _mean([d.mean for d in distances]),
        "wrist_distance_max_m": max(d.maximum for d in distances),
        "wrist_distance_max_typical_m": _mean([d.maximum for d in distances]),
        "area_between_curves_m2": _mean(areas),
        "joint_rms_deg": _mean([float(np.sqrt(np.mean(error**2))) for error in errors]),
        "switches_per_episode": _mean([switches(e.winners) for e in episodes]),
        "commanded_share": _mean([e.commanded.mean() for e in episodes]),
        "rim_to_mouth_mean_m": _mean([e.rim_to_mouth for e in episodes]),
        "glass_from_place_mean_m": _mean([e.glass_from_place for e in episodes]),
    }


def _mean(values: Sequence[float]) -> float:
    return float(np.mean(values))
