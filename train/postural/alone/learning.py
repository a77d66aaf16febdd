"""What acts alone: imitators with a body, taught by the demonstrations that PACNet watches."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from time import perf_counter

from pacnet.datasets.demonstrations import Demonstrations, load_demonstrations
from pacnet.forward_models.kinematics import KinematicModel
from pacnet.imitator.imitator import Imitator
from train.postural.alone.scenes import OURS, OURS_ONE, UNFRAMED

FOLDERS = {OURS: "imitator", OURS_ONE: "imitator_of_one", UNFRAMED: "imitator_without_frames"}


def load_body(folder: str | Path) -> KinematicModel:
    """Load what babbling has learned about the body; exit with one line if there is nothing."""
    try:
        return KinematicModel.from_pretrained(folder)
    except (OSError, ValueError) as error:
        raise SystemExit(f"error: {error}; `python -m train.babbling` makes one") from error


def teach(folder: Path, body: KinematicModel) -> float:
    """Teach an imitator for each row that has one, from `dataset` in a run's folder; save them.

    All perceive angles, velocities and the glass: the demonstrator's while they learn, and their
    own when they act.

    Args:
        folder: Of the run, to which their checkpoints go.
        body: Model of the own body, which resembles the demonstrator's.

    Returns:
        Seconds that the imitator of all demonstrations took to learn.
    """
    shown = load_demonstrations(folder / "dataset")
    first = replace(shown, episodes=shown.episodes[:1])
    imitators = {
        OURS: (shown, Imitator.from_demonstrations(shown, body=body)),
        OURS_ONE: (first, Imitator.from_demonstrations(first, body=body)),
        UNFRAMED: (shown, Imitator.from_demonstrations(shown, points=None)),
    }
    seconds = {row: _learn(*taught) for row, taught in imitators.items()}
    for row, (_, imitator) in imitators.items():
        imitator.warm_up()  # compiles once, not in each process that acts
        imitator.save_pretrained(folder / FOLDERS[row])
    return seconds[OURS]


def _learn(demonstrations: Demonstrations, imitator: Imitator) -> float:
    started = perf_counter()
    imitator.learn(demonstrations)
    return perf_counter() - started
