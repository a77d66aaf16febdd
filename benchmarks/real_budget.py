"""What imitators do at held-out episodes with a twentieth of the frames, chosen in several ways."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pacnet import Imitator
from pacnet.datasets.demonstrations import Demonstrations
from pacnet.evaluation import Split, score

SHARE = 20  # of how many frames learned one is kept
SEEDS = range(40, 50)  # of random choices

COLUMNS = (
    "dataset", "frames learned", "kept", "all", "keyframes", "every n-th", "random",
    "1-NN, all frames",
)  # fmt: skip
TEXT = f"""The error at the same held-out episodes when one of {SHARE} frames learned is kept:
keyframes, as `pacnet fit --budget` keeps them; as many at equal distances; as many at random, mean
of {len(SEEDS)} choices. An imitator goes along the line between two frames that are kept. Points
are not used.
"""


class Budgeted(NamedTuple):
    """Errors, all in the same unit, by what is kept."""

    learned: int
    """Number of frames of the training data of all splits."""
    kept: int
    """How many keyframes are kept of them."""
    all: float
    keyframes: float
    evenly: float
    randomly: float


def under_budget(parted: Sequence[Split]) -> Budgeted:
    """Return the errors with different frames kept, of some splits of one dataset."""
    whole, keyframes = cache(_taught), cache(lambda training: _taught(training, SHARE))

    def chosen(training: Demonstrations, seed: int | None) -> Imitator:
        count = len(keyframes(training).memory.rows)
        return _with_rows(whole(training), _choose(_frames(training), count, seed))

    training = [split.training for split in parted]
    random = [score(parted, lambda one, seed=seed: chosen(one, seed)).error for seed in SEEDS]
    return Budgeted(
        sum(map(_frames, training)),
        sum(len(keyframes(one).memory.rows) for one in training),
        score(parted, whole).error,
        score(parted, keyframes).error,
        score(parted, lambda one: chosen(one, None)).error,
        float(np.mean(random)),
    )


def row(one: Budgeted, nearest: float) -> tuple[str, ...]:
    """Return the cells after the dataset's name; `nearest` is the error of 1-NN."""
    errors = (one.all, one.keyframes, one.evenly, one.randomly, nearest)
    return (f"{one.learned:,}", f"{one.kept:,}", *(f"{error:.3f}" for error in errors))


def _frames(training: Demonstrations) -> int:
    return sum(len(shown.state) for shown in training)


def _taught(training: Demonstrations, share: int | None = None) -> Imitator:
    """Return an imitator that has learned, and keeps one of so many frames, or all."""
    budget = None if share is None else max(1, _frames(training) // share)
    imitator = Imitator.from_demonstrations(training, budget=budget, points=None)
    imitator.learn(training)
    return imitator


def _choose(frames: int, count: int, seed: int | None) -> NDArray[np.bool_]:
    """Return which of the frames are kept, at random, or at equal distances without a seed."""
    if seed is None:
        rows = np.linspace(0, frames - 1, count).round().astype(np.int64)
    else:
        rows = np.random.default_rng(seed).choice(frames, count, replace=False)
    return np.isin(np.arange(frames), rows)


def _with_rows(imitator: Imitator, rows: NDArray[np.bool_]) -> Imitator:
    """Return a fork that keeps only these rows of the memory."""
    fork = imitator.fork()
    fork.memory.select(rows)
    return fork
