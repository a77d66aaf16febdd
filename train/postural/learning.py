"""What Experiment 1 learns: a map with motor schemas, from recorded demonstrations."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from envs.humanoid import JOINTS
from envs.postural_imitation import GLASS_NAMES, STATE_NAMES
from pacnet import MotorSchemasConfig, PACNet, PACNetConfig, SOFMConfig
from pacnet.datasets.demonstrations import Demonstrations
from pacnet.datasets.recorder import Recorder
from train.common.learning_log import LearningLog
from train.postural.episodes import (
    FPS,
    TASK,
    Condition,
    demonstration_seeds,
    make_environment,
    motor_targets,
    watch_demonstration,
)

FEATURES = {
    "observation.state": STATE_NAMES,  # perceived angles and velocities of the demonstrator
    "observation.environment_state": GLASS_NAMES,  # its glass, in its body frame
    "action": JOINTS,  # joint-angle targets
}
# Velocities [rad/s] weigh a third of angles [rad] and of the glass [m, rad]: they are noisier.
SCALE = (1.0,) * len(JOINTS) + (1 / 3,) * len(JOINTS) + (1.0,) * len(GLASS_NAMES)
NOVELTY_THRESHOLD = 0.55  # chosen with `python -m train.threshold_sweep`
WINNER_TAU = 5.0  # [wins] most nodes habituate (15 wins) within the first demonstration
CHUNK = 50  # samples learned between two points of the learning curves


def record(folder: Path, seed: int, count: int, behaviour: str = "drink", task: str = TASK) -> None:
    """Record demonstrations, as a resting imitator perceives them, into a LeRobot dataset.

    Args:
        folder: Of the dataset; appended to if it exists.
        seed: Of the demonstrations.
        count: Number of demonstrations.
        behaviour: One of `envs.behaviours.BEHAVIOURS`.
        task: The behaviour in words.
    """
    environment = make_environment(Condition(behaviour=behaviour))
    with Recorder(folder, FPS, FEATURES, "postural_imitation") as recorder:
        for episode_seed in tqdm(demonstration_seeds(seed, count), "recording", unit="episode"):
            percepts = watch_demonstration(environment, episode_seed)
            recorder.save_episode(task, frames_of(percepts))


def frames_of(percepts: NDArray[np.float32]) -> dict[str, NDArray[np.float32]]:
    """Return the features of a watched demonstration `[T, 28]`, as they are recorded."""
    state, glass = np.split(percepts, [len(STATE_NAMES)], axis=1)
    return {
        "observation.state": state,
        "observation.environment_state": glass,
        "action": motor_targets(percepts),
    }


def attention_config(novelty_threshold: float = NOVELTY_THRESHOLD) -> SOFMConfig:
    """Return the map's settings for percepts of a demonstrator and its glass."""
    return SOFMConfig.paper(
        len(SCALE), scale=SCALE, novelty_threshold=novelty_threshold, winner_tau=WINNER_TAU
    )


def make_network(novelty_threshold: float, recall_by: Literal["cue", "order"] = "cue") -> PACNet:
    """Return an untrained network with one schema per node, as in the paper."""
    schemas = MotorSchemasConfig(len(JOINTS), len(SCALE), recall_by)
    return PACNet(PACNetConfig(attention_config(novelty_threshold), schemas))


def learn(network: PACNet, demonstrations: Demonstrations, log: LearningLog | None = None) -> None:
    """Let the network observe each demonstration once, in order."""
    total = sum(len(demonstration.state) for demonstration in demonstrations)
    with tqdm(total=total, desc="learning", unit="sample") as progress:
        for demonstration in demonstrations:
            percepts = demonstration.percepts.split(CHUNK)
            for seen, done in zip(percepts, demonstration.action.split(CHUNK), strict=True):
                observed = network.observe(seen, done, demonstration.episode, demonstration.task)
                if log is not None:
                    log.observed(network.sofm, observed)
                progress.update(len(seen))
