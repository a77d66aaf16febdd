"""One map for both: which nodes win while another is watched, and while the same is done alone.

The imitator perceives its own body and glass in the 28 dimensions in which it perceived the
demonstrator's. A node that stands for a grasp then wins in either case, as a mirror neuron does.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray

from pacnet import PACNet
from train.postural.alone.episodes import Outcome, Shown
from train.postural.alone.scenes import OURS, USUAL
from train.postural.alone.trials import Trial

BEFORE = 20  # [samples] before the hand takes the glass: 0.4 s, as long as a demonstrated grasp


class Mirror(NamedTuple):
    """The node of the demonstrator's grasps, and how often it wins in the imitator's own."""

    node: int
    watched: float  # share of the samples of the demonstrator's grasps that it wins
    own: float  # share of the samples of the imitator's grasps that it wins
    chance: float  # share of all samples of the imitator's episodes that it wins

    @property
    def shares(self) -> dict[str, float]:
        """Return the shares by their names."""
        return {"watched": self.watched, "own": self.own, "chance": self.chance}


def mirror(network: PACNet, trials: Sequence[Trial]) -> Mirror:
    """Return how the node that wins most in the demonstrators' grasps does in the imitator's own.

    Args:
        network: Whose map watched the demonstrations.
        trials: Those near the usual place count.

    Returns:
        The shares; the own one is 0 where the imitator never took a glass.
    """
    here = [trial for trial in trials if USUAL in trial.outcomes]
    watched = np.concatenate([_grasp_watched(network, trial.shown) for trial in here])
    done = [trial.outcomes[USUAL][OURS] for trial in here]
    own = [_grasp_done(network, outcome) for outcome in done if outcome.held.any()]
    everything = [nearest_nodes(network, outcome.percepts) for outcome in done]
    node = int(np.bincount(watched).argmax())
    return Mirror(node, *(_share(node, winners) for winners in ([watched], own, everything)))


def _share(node: int, winners: Sequence[NDArray[np.int64]]) -> float:
    """Return the share of samples that a node wins; 0 of none."""
    return float((np.concatenate(winners) == node).mean()) if winners else 0.0


def nearest_nodes(network: PACNet, percepts: NDArray[np.float32]) -> NDArray[np.int64]:
    """Return the winner at each percept `[T]`, whether or not it matches well."""
    return network(torch.from_numpy(percepts)).winner.numpy()


def grasp_begins(done: Outcome) -> int:
    """Return the step from which the imitator is about to take its glass."""
    return max(int(done.held.argmax()) - BEFORE, 0)


def _grasp_watched(network: PACNet, shown: Shown) -> NDArray[np.int64]:
    return nearest_nodes(network, shown.percepts)[shown.phases == "grasp"]


def _grasp_done(network: PACNet, done: Outcome) -> NDArray[np.int64]:
    first = grasp_begins(done)
    return nearest_nodes(network, done.percepts)[first : first + BEFORE]
