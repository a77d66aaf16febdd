"""The results of a run of Experiment 2: the paper's figures, a video, a table."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray
from tqdm import tqdm

from envs.arena import make_arena
from envs.arena_scene import CONTROL_TIMESTEP
from envs.wall_following import WallFollowingEnv
from pacnet import PACNet
from pacnet.evaluation.map_figures import percepts_on_components
from pacnet.evaluation.pca import PrincipalComponents
from train.common.summary import Summary, mean_and_std
from train.common.typical import load_typical
from train.common.video import write_gif, write_mp4
from train.walls.drivers import Recalling
from train.walls.episodes import Place, act_alone, alone_seed
from train.walls.figures import (
    activations_over_time,
    clusters_on_components,
    conditions,
    trajectory,
)
from train.walls.learning import FPS, Episode
from train.walls.scores import SIDES, WallRun, name_clusters

PRINTED = ("wf", "tight", "energy")  # scores
FILM_STEPS = 400
FRAME_STEPS = 2  # steps from one frame of the film to the next
PATH_STEPS = 10_000  # drawn as a path: some places on both sides
WANTED = {
    name: {"wf": 0.95, "tight": 0.85}
    for name in (
        "recall",
        "recall in unseen arenas",
        "recall beside a left wall",
        "recall beside a right wall",
    )
}


def draw(
    network: PACNet, episodes: Sequence[Episode], recalled: WallRun, arena: str | int
) -> tuple[dict[str, Figure], dict[str, float | int]]:
    """Draw the paper's Figures 9a-c and the path; also return nodes and variance."""
    percepts = np.concatenate([episode.percepts.numpy() for episode in episodes])
    components = PrincipalComponents.fit(percepts)
    variance = components.explained_variance_ratio
    points = components.project(percepts)
    times = np.concatenate([np.arange(len(e.percepts)) for e in episodes]) * CONTROL_TIMESTEP
    prototypes = network.sofm.prototypes.numpy()
    names = name_clusters(prototypes)
    edges = network.sofm.edges.live("ends").numpy()
    drawn = slice(PATH_STEPS)
    walls = [obstacle.outline for obstacle in make_arena(arena).obstacles]
    figures = {
        "percepts": percepts_on_components(points, times, variance),
        "map": clusters_on_components(
            components.project(prototypes), edges, points, names, variance
        ),
        "activations": activations_over_time(recalled.winners, names, CONTROL_TIMESTEP),
        "path": trajectory(
            walls, recalled.poses[drawn], recalled.wall_side[drawn], recalled.commanded[drawn]
        ),
    }
    scores = {
        "nodes": len(names),
        **{f"nodes_{name.replace(' ', '_')}": names.count(name) for name in SIDES},
        "pca_variance_2": components.variance(2),
    }
    return figures, scores


def film(network: PACNet, arena: str | int, seed: int, folder: Path) -> None:
    """Film the beginning of a recall, from above and by the chase camera."""
    frames: dict[str, list[NDArray[np.uint8]]] = {"top": [], "chase": []}
    with tqdm(total=2 * FILM_STEPS, desc="filming", unit="step") as progress:
        for camera, taken in frames.items():

            def take(environment: WallFollowingEnv, taken: list = taken) -> None:
                progress.update()
                if progress.n % FRAME_STEPS == 0:
                    taken.append(environment.render())

            driver = Recalling(network, seed)
            act_alone(driver, Place(arena), alone_seed(seed), FILM_STEPS, take, camera)
    both = [np.hstack(pair) for pair in zip(*frames.values(), strict=True)]
    rate = 4 * FPS / FRAME_STEPS  # four times as fast as the robot
    write_mp4(both, folder / "recall.mp4", rate)
    write_gif([frame[::2, ::2] for frame in both], folder / "recall.gif", rate)


def draw_conditions(summary: Mapping[str, Mapping[str, Summary]]) -> Figure:
    """Draw bars of wf and tight under every condition."""
    table = {
        condition: {name: (scores[name]["mean"], scores[name]["std"]) for name in ("wf", "tight")}
        for condition, scores in summary.items()
    }
    return conditions(table, {name: goals for name, goals in WANTED.items() if name in table})


def print_conditions(summary: Mapping[str, Mapping[str, Summary]]) -> None:
    """Print the table of conditions."""
    count = len(next(iter(summary.values()))["wf"]["values"])
    title = f"{count} replicates, mean ± std" if count > 1 else "one replicate"
    print(f"\n{title:32}" + "".join(f"{name:>15}" for name in PRINTED))
    for condition, scores in summary.items():
        print(f"{condition:32}" + "".join(f"{mean_and_std(scores[name]):>15}" for name in PRINTED))


def print_typical(metrics: Path) -> None:
    """Print what recall scored over the replicates of a file of metrics; nothing without it."""
    typical = load_typical(metrics, "conditions")
    if typical is None:
        return
    recall = typical.scores["recall"]
    title = f"typical recall ({len(recall['wf']['values'])} longer runs)"
    print(f"{title:32}" + "".join(f"{mean_and_std(recall[name]):>15}" for name in PRINTED))
