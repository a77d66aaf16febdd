"""Episodes of several behaviours: the imitator imitates and recognizes the one that is shown."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import torch
from numpy.typing import NDArray

from pacnet import PACNet, Recognition
from train.common.pool import share_out
from train.postural.episodes import (
    TASK,
    Condition,
    RecallEpisode,
    make_environment,
    recall_episode,
)

TASKS = {  # of each behaviour, in words
    "drink": TASK,
    "toast": "toast, then drink a glass of beer",
    "move": "move a glass over the table",
}
SEVERAL, ONE = "several schemas per node", "one schema per node, overwritten"
CHECKPOINTS = {SEVERAL: "checkpoint", ONE: "checkpoint_one_schema"}  # in the run's folder


@dataclass(frozen=True, eq=False)
class BehaviourEpisode:
    """One episode: what each system did and recognized.

    Attributes:
        behaviour: That was shown, one of `envs.behaviours.BEHAVIOURS`.
        recalls: System -> what the imitator did with it.
        recognition: Of the same percepts, without acting.
    """

    behaviour: str
    recalls: dict[str, RecallEpisode]
    recognition: Recognition

    @property
    def shown(self) -> RecallEpisode:
        """Return percepts, phases and the demonstrator's movement, equal in all recalls."""
        return self.recalls[SEVERAL]

    @property
    def parting(self) -> int:
        """Return the sample at which the glass has been grasped and the behaviours diverge."""
        return self._end_of("grasp")

    @property
    def approached(self) -> int:
        """Return the first sample after the approach."""
        return self._end_of("approach")

    def _end_of(self, phase: str) -> int:
        return int((self.shown.phases == phase).nonzero()[0][-1]) + 1


def behaviour_episodes(folder: Path, tasks: Sequence[tuple[str, int]]) -> list[BehaviourEpisode]:
    """Return episodes of a run's checkpoints, in the order of their tasks, run on all cores.

    Args:
        folder: Of the run.
        tasks: Behaviour and seed of each episode.
    """
    return share_out(_Worker, (folder,), tasks, "recalling and recognizing")


class _Worker:
    """Run episodes with the loaded checkpoints and an environment for each behaviour."""

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
