"""What of the trials is drawn: the mirror, the places, and the path at the furthest place."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from envs.physics import CONTROL_TIMESTEP
from pacnet import PACNet
from train.postural.alone.figures import mirror_winners, places_tried
from train.postural.alone.mirror import BEFORE, grasp_begins, mirror, nearest_nodes
from train.postural.alone.scenes import ALONE, OURS, REPLAY, USUAL
from train.postural.alone.trials import Trial
from train.postural.figures import wrist_paths

WATCHING, DOING = "Watching the demonstrator", "Doing it alone"


def draw(network: PACNet, trials: Sequence[Trial]) -> dict[str, Figure]:
    """Draw the winners of PACNet's map for both bodies, places tried, and paths at one of them."""
    far = furthest(trials)
    figures = {
        "alone": _places(trials),
        "alone_wrists": wrist_paths(far.shown.wrist, far.outcomes[ALONE][OURS].wrist),
    }
    first = next(trial for trial in trials if USUAL in trial.outcomes)
    if first.outcomes[USUAL][OURS].held.any():
        figures["mirror"] = _mirror(network, trials, first)
    return figures


def furthest(trials: Sequence[Trial]) -> Trial:
    """Return the trial whose glasses stand furthest from the usual place."""
    return max(trials, key=lambda trial: math.hypot(*trial.offset))


def _mirror(network: PACNet, trials: Sequence[Trial], trial: Trial) -> Figure:
    shown, done = trial.shown, trial.outcomes[USUAL][OURS]
    winners = {WATCHING: shown.percepts, DOING: done.percepts[: len(shown.percepts)]}
    grasp, begins = np.flatnonzero(shown.phases == "grasp"), grasp_begins(done)
    return mirror_winners(
        {title: nearest_nodes(network, percepts) for title, percepts in winners.items()},
        {WATCHING: (int(grasp[0]), int(grasp[-1]) + 1), DOING: (begins, begins + BEFORE)},
        mirror(network, trials).node,
        CONTROL_TIMESTEP,
    )


def _places(trials: Sequence[Trial]) -> Figure:
    here = [trial for trial in trials if ALONE in trial.outcomes]
    offsets = np.array([trial.offset for trial in here])
    titles = {"Ours, alone": OURS, "Replay of the nearest": REPLAY}
    return places_tried(
        {
            title: (offsets, np.array([trial.outcomes[ALONE][row].success for trial in here]))
            for title, row in titles.items()
        }
    )
