"""Demonstrations with what a camera beside the demonstrator's head sees, each glass elsewhere."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from tqdm import tqdm

from envs.head_camera import SIZE
from envs.humanoid import JOINTS
from envs.postural_imitation import STATE_NAMES, PosturalImitationEnv
from envs.scene import DEMONSTRATOR
from pacnet.datasets import Picture, Recorder
from pacnet.datasets.demonstrations import Demonstration, Demonstrations
from train.postural.alone.scenes import draw_place
from train.postural.episodes import (
    FPS,
    TASK,
    Condition,
    demonstration_seeds,
    make_environment,
    watch_demonstration,
)
from train.postural.learning import FEATURES, frames_of

CAMERA = "observation.images.head"
RADIUS = 0.1  # [m] from the usual place, within which a glass is drawn


def watch(
    environment: PosturalImitationEnv, seed: int, radius: float
) -> tuple[NDArray[np.float32], NDArray[np.uint8]]:
    """Watch a demonstrator whose glass stands within a radius of the usual place.

    Args:
        environment: To watch in.
        seed: Of the demonstration; decides where the glass stands.
        radius: [m].

    Returns:
        Percepts `[T, 28]`, and what the camera beside its head sees `[T, 128, 128, 3]`.
    """
    pictures = list[NDArray[np.uint8]]()
    percepts = watch_demonstration(
        environment,
        seed,
        offset=draw_place(seed, radius),
        at_sample=lambda: pictures.append(environment.look(DEMONSTRATOR)),
    )
    return percepts, np.stack(pictures)


def record(
    folder: Path,
    seed: int,
    count: int,
    behaviour: str = "drink",
    task: str = TASK,
    *,
    radius: float = RADIUS,
) -> None:
    """Record demonstrations with pictures, and without the glass, into a LeRobot dataset.

    Args:
        folder: Of the dataset; appended to if it exists.
        seed: Of the demonstrations.
        count: Number of demonstrations.
        behaviour: One of `envs.behaviours.BEHAVIOURS`.
        task: The behaviour in words.
        radius: Largest distance of each one's glass from the usual place [m].
    """
    environment = make_environment(Condition(behaviour=behaviour))
    features = {"observation.state": STATE_NAMES, CAMERA: Picture(SIZE, SIZE)}
    features |= {"action": JOINTS}
    with Recorder(folder, FPS, features, "postural_imitation") as recorder:
        for episode_seed in tqdm(demonstration_seeds(seed, count), "recording", unit="episode"):
            percepts, pictures = watch(environment, episode_seed, radius)
            frames = frames_of(percepts) | {CAMERA: pictures}
            recorder.save_episode(task, {name: frames[name] for name in features})
    environment.close()


def told(seed: int, count: int, radius: float = RADIUS) -> Demonstrations:
    """Return the demonstrations of `record` without pictures, but told where the glass is."""
    environment = make_environment(Condition())
    episodes = []
    for number, episode_seed in enumerate(demonstration_seeds(seed, count)):
        place = draw_place(episode_seed, radius)
        percepts = watch_demonstration(environment, episode_seed, offset=place)
        state, glass, action = map(torch.from_numpy, frames_of(percepts).values())
        episodes.append(Demonstration(number, TASK, state, glass, action))
    environment.close()
    return Demonstrations(FPS, FEATURES, tuple(episodes))
