"""Episodes of several behaviours: the imitator performs what it is shown, and says what it sees."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import torch
from numpy.typing import NDArray

from pacnet import PACNet, Recognition
from train.common.pool import share_out
from train.postural.episodes import Condition, RecallEpisode, make_environment, recall_episode

SEVERAL, ONE = "several schemas per node", "one schema per node, overwritten"
CHECKPOINTS = {SEVERAL: "checkpoint", ONE: "checkpoint_one_schema"}  # in the run's folder


@dataclass(frozen=True, eq=False)
class BehaviourEpisode:
    """One episode, and what was made of it.

    Attributes:
        behaviour: that was shown, of `envs.behaviours.BEHAVIOURS`.
        recalls: what the imitator did, by the system that it did it with.
        recognition: of the same percepts, acting on nothing.
    """

    behaviour: str
    recalls: dict[str, RecallEpisode]
    recognition: Recognition

    @property
    def shown(self) -> RecallEpisode:
        """Percepts, phases and the demonstrator's own movement; alike in all recalls."""
        return self.recalls[SEVERAL]

    @property
    def parting(self) -> int:
        """The sample at which the glass has been grasped and the behaviours part."""
        return self._end_of("grasp")

    @property
    def approached(self) -> int:
        """The first sample after the approach."""
        return self._end_of("approach")

    def _end_of(self, phase: str) -> int:
        return int((self.shown.phases == phase).nonzero()[0][-1]) + 1


def behaviour_episodes(folder: Path, tasks: Sequence[tuple[str, int]]) -> list[BehaviourEpisode]:
    """Episodes of a run's checkpoints, in the order of their tasks, on all cores.

    Args:
        folder: of the run.
        tasks: the behaviour and the seed of each.
    """
    return share_out(_Worker, (folder,), tasks, "recalling and recognising")


class _Worker:
    """The loaded checkpoints, and an environment for each behaviour that was asked for."""

    def __init__(self, folder: Path) -> None:
        self.networks = {
            system: PACNet.from_pretrained(folder / name).eval()
            for system, name in CHECKPOINTS.items()
        }
        self.environments = {}

    def run(self, task: tuple[str, int]) -> BehaviourEpisode:
        behaviour, seed = task
        if behaviour not in self.environments:
            self.environments[behaviour] = make_environment(Condition(behaviour=behaviour))
        environment = self.environments[behaviour]
        recalls = {
            system: recall_episode(network, environment, seed)
            for system, network in self.networks.items()
        }
        percepts: NDArray = recalls[SEVERAL].percepts
        recognition = self.networks[SEVERAL].recognise(torch.from_numpy(percepts))
        return BehaviourEpisode(behaviour, recalls, recognition)
