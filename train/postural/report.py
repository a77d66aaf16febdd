"""The results of a run of Experiment 1: the paper's figures, a video, a table."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont
from tqdm import tqdm

from envs.physics import CONTROL_TIMESTEP
from pacnet import PACNet
from pacnet.datasets.demonstrations import Demonstrations
from pacnet.evaluation.map_figures import (
    map_on_components,
    percepts_on_components,
    winners_over_time,
)
from pacnet.evaluation.pca import PrincipalComponents
from train.common.video import write_gif, write_mp4
from train.postural.episodes import (
    FPS,
    Condition,
    RecallEpisode,
    make_environment,
    recall_episode,
)
from train.postural.figures import wrist_paths
from train.postural.scores import Scores, winners_of

FRAME_STEPS = 3  # steps from one frame of the film to the next
NAMES = (("demonstrator", 0.25), ("imitator", 0.75))  # and where, as shares of the width

PAPER = {"nodes": "12", "pca_variance_2": "0.78"}  # scores that the paper reports


def draw(
    network: PACNet, demonstrations: Demonstrations, recalled: RecallEpisode
) -> tuple[dict[str, Figure], Scores]:
    """Draw the paper's Figures 6a-c and 7; also return the number of nodes and the variance."""
    percepts = [demonstration.percepts.numpy() for demonstration in demonstrations]
    components = PrincipalComponents.fit(np.concatenate(percepts), network.sofm.scale.numpy())
    variance = components.explained_variance_ratio
    points = components.project(np.concatenate(percepts))
    times = np.concatenate([np.arange(len(episode)) for episode in percepts]) / FPS
    nodes = components.project(network.sofm.prototypes.numpy())
    figures = {
        "percepts": percepts_on_components(points, times, variance),
        "map": map_on_components(nodes, network.sofm.edges.live("ends").numpy(), points, variance),
        "winners": winners_over_time(
            recalled.winners, CONTROL_TIMESTEP, winners_of(network, percepts[-1])
        ),
        "wrists": wrist_paths(recalled.demonstrator_wrist, recalled.imitator_wrist),
    }
    return figures, {"nodes": len(nodes), "pca_variance_2": components.variance(2)}


def film(checkpoint: str | Path, seed: int, condition: Condition, folder: Path) -> None:
    """Write a video of one recall episode as `recall.mp4` and `recall.gif`."""
    environment = make_environment(condition, render=True)
    frames: list[NDArray[np.uint8]] = []
    with tqdm(desc="filming", unit="step") as progress:

        def take(step: int) -> None:
            progress.total = environment.episode_steps
            progress.update()
            if step % FRAME_STEPS == 0:
                frames.append(with_names(environment.render()))

        recall_episode(PACNet.from_pretrained(checkpoint), environment, seed, take)
    write_film(frames, folder / "recall", FPS / FRAME_STEPS)


def write_film(frames: list[NDArray[np.uint8]], path: Path, fps: float) -> None:
    """Write frames as `path.mp4`, and half as large as `path.gif`."""
    write_mp4(frames, path.with_suffix(".mp4"), fps)
    write_gif([frame[::2, ::2] for frame in frames], path.with_suffix(".gif"), fps)


def with_names(
    frame: NDArray[np.uint8] | None, names: Sequence[tuple[str, float]] = NAMES
) -> NDArray[np.uint8]:
    """Return a frame with names below the bodies, each with its share of the width."""
    assert frame is not None
    picture = Image.fromarray(frame)
    height, width = frame.shape[:2]
    font = ImageFont.load_default(size=height / 18)
    for name, share in names:
        place = (share * width, 0.98 * height)
        ImageDraw.Draw(picture).text(place, name, "white", font, anchor="mb")
    return np.asarray(picture)


def print_table(scores: Mapping[str, float | int]) -> None:
    """Print the scores beside those that the paper reports."""
    print(f"\n{'':32}{'paper':>8}{'measured':>12}")
    for name, value in scores.items():
        measured = f"{value:.4f}" if isinstance(value, float) else str(value)
        print(f"{name:32}{PAPER.get(name, '-'):>8}{measured:>12}")
