"""What imitators do at held-out episodes of LeRobot datasets, beside nearest neighbours.

Run it with `python -m benchmarks.real_data DATASET...`, on any folders of datasets.
"""

from __future__ import annotations

import argparse
import sys
import warnings
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from benchmarks import real_budget, results_page
from benchmarks.harness import NOTHING, Table, factor
from benchmarks.real_budget import Budgeted, under_budget
from pacnet import Imitator, load_demonstrations
from pacnet.datasets.demonstrations import Demonstrations
from pacnet.datasets.format import DatasetWarning
from pacnet.evaluation import HeldOutScores, Split, score, splits
from pacnet.evaluation.held_out import BASELINES, begin, learned

NEIGHBOURS = tuple(name for name in BASELINES if "NN" in name)
MOVED = 3  # [training deviations], of percepts that should be called novel
SETTLED = 10  # frames of an episode after which they should be
LEAST_DEVIATION = 1e-5  # of a dimension of percepts that moves

HELD_OUT = """`python -m benchmarks.real_data DATASET...` measures any folders of datasets. The last
of each five episodes is held out, ten at most; where there are fewer than ten, each is left out in
turn. An error is the root mean square of action − action shown, in standard deviations of the
actions learned, over all frames held out; where the imitator holds, its last action counts. The
neighbours are the nearest frame learned (1-NN), the mean of five, and of five that also moved alike
in the last 0.3 s. The last column repeats the action that was shown one frame before.
"""
ONE = """The first episode of the training data is learned alone, and compared at the same held-out
episodes with its own nearest frame. Standard deviations are those of all training data.
"""
NEW = f"""The share of frames called novel: of the held-out episodes as they are; of the same moved
as a whole by {MOVED} training deviations in one dimension, in each that moves, up and down in turn,
without the first {SETTLED} frames of an episode; and of the held-out episodes of the other datasets
here whose percepts have as many dimensions.
"""


class Refused(NamedTuple):
    """A dataset that cannot be measured."""

    name: str
    reason: str


class Measured(NamedTuple):
    """What was measured with one dataset."""

    name: str
    demonstrations: Demonstrations
    parted: list[Split]
    imitators: list[Imitator]
    """One for each split."""
    scores: HeldOutScores
    from_one: HeldOutScores
    """After one demonstration."""
    moved: float
    """Share of moved frames that are called novel."""
    budgeted: Budgeted
    """With fewer frames kept."""

    @property
    def width(self) -> int:
        """Number of dimensions of a percept."""
        return self.demonstrations.episodes[0].percepts.shape[1]


def measure(folders: Iterable[str]) -> list[Table]:
    """Return the tables of some folders of datasets."""
    results = [_measure_one(folder) for folder in folders]
    shape = ("dataset", "state / action", "episodes", "frames", "fps")
    errors = ("acts", "error", "of the best neighbours'", *BASELINES)
    new = ("dataset", "moving dimensions", "as they are", "moved", "of other datasets")
    measured = [one for one in results if isinstance(one, Measured)]
    return [
        _table("Real datasets: held-out episodes", HELD_OUT, (*shape, *errors), results, _held_out),
        _table(
            "Real datasets: from one demonstration", ONE, ("dataset", "acts", "error", "of 1-NN's"),
            results, _from_one,
        ),
        _table(
            "Real datasets: under a budget", real_budget.TEXT, real_budget.COLUMNS, results,
            lambda one: real_budget.row(one.budgeted, one.scores.baselines["1-NN"]),
        ),
        _table("Real datasets: what is new", NEW, new, results, lambda one: _new(one, measured)),
    ]  # fmt: skip


def _measure_one(folder: str) -> Measured | Refused:
    """Measure one dataset; what its files contradict is not told here."""
    name = Path(folder).name or folder
    print(f"{name} ...", file=sys.stderr, flush=True)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", DatasetWarning)
            demonstrations = load_demonstrations(folder)
        learn = cache(learned)
        parted = splits(demonstrations)
        scores = score(parted, learn)
        from_one = score([_first_alone(split) for split in parted])
        budgeted = under_budget(parted)
    except (OSError, ValueError) as error:
        return Refused(name, " ".join(str(error).replace(folder, name).replace("|", "/").split()))
    imitators = [learn(split.training) for split in parted]
    moved = _moved_share(imitators, parted)
    return Measured(name, demonstrations, parted, imitators, scores, from_one, moved, budgeted)


def _first_alone(split: Split) -> Split:
    """Return the split with the first training episode alone."""
    first = split.training.episodes[:1]
    return Split(replace(split.training, episodes=first), split.held_out, split.training)


def _moved_share(imitators: Sequence[Imitator], parted: Sequence[Split]) -> float:
    """Return the share of frames called novel where whole episodes are moved."""
    called, number = [], 0
    for imitator, split in zip(imitators, parted, strict=True):
        deviations = _deviations(split.training)
        for shown in split.held_out.continuous():
            called += [
                novel(imitator, percepts, shown.task)[SETTLED:]
                for percepts in moved(shown.percepts, deviations, number)
            ]
            number += 1
    return float(np.concatenate(called).mean())


def moved(percepts: Tensor, deviations: Tensor, number: int) -> Iterator[Tensor]:
    """Yield the percepts of an episode `[T, D]` moved in each dimension that moves, in turn.

    Args:
        percepts: of the episode.
        deviations: of each dimension, in the training data `[D]`.
        number: of the episode; the first dimension moves up in even ones, down in odd ones.
    """
    for dimension in (deviations >= LEAST_DEVIATION).nonzero().ravel().tolist():
        changed = percepts.clone()
        changed[:, dimension] += (-1) ** number * MOVED * deviations[dimension]
        yield changed
        number += 1


def novel(imitator: Imitator, percepts: Tensor, task: str) -> NDArray[np.bool_]:
    """Return which of the percepts `[T, D]` are called novel, from the beginning of an episode."""
    begin(imitator, task)
    return np.array([imitator.step(percept).is_novel for percept in percepts.numpy()], np.bool_)


def _deviations(demonstrations: Demonstrations) -> Tensor:
    """Return the standard deviation of each dimension of percepts `[D]`."""
    return torch.cat([shown.percepts for shown in demonstrations]).double().std(0, correction=0)


def _table(
    title: str,
    text: str,
    columns: tuple[str, ...],
    results: Sequence[Measured | Refused],
    row: Callable[[Measured], tuple[str, ...]],
) -> Table:
    """Return a table with a row for each dataset; that of a refused one says why."""
    blank = (NOTHING,) * (len(columns) - 2)
    rows = [
        (one.name, one.reason, *blank) if isinstance(one, Refused) else (one.name, *row(one))
        for one in results
    ]
    return Table(title, text, columns, rows)


def _held_out(one: Measured) -> tuple[str, ...]:
    shown, scores = one.demonstrations, one.scores
    best = min(scores.baselines[name] for name in NEIGHBOURS)
    episodes = len({part.episode for part in shown})
    return (
        f"{one.width} / {len(shown.action_names)}",
        f"{episodes:,}",
        f"{sum(len(part.state) for part in shown):,}",
        f"{shown.fps:g}",
        f"{scores.acted:.1%}",
        f"{scores.error:.3f}",
        factor(scores.error / best),
        *(f"{error:.3f}" for error in scores.baselines.values()),
    )


def _from_one(one: Measured) -> tuple[str, ...]:
    scores = one.from_one
    ratio = scores.error / scores.baselines["1-NN"]
    return (f"{scores.acted:.1%}", f"{scores.error:.3f}", factor(ratio))


def _new(one: Measured, measured: Sequence[Measured]) -> tuple[str, ...]:
    called = [
        novel(imitator, shown.percepts, shown.task)
        for other in measured
        if other is not one and other.width == one.width
        for split in other.parted
        for shown in split.held_out.continuous()
        for imitator in one.imitators
    ]
    others = f"{np.concatenate(called).mean():.1%}" if called else NOTHING
    moving = int((_deviations(one.demonstrations) >= LEAST_DEVIATION).sum())
    return (f"{moving}", f"{one.scores.novel:.1%}", f"{one.moved:.1%}", others)


def main() -> None:
    """Measure, print and, if asked, write."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.real_data", description=(__doc__ or "").splitlines()[0]
    )
    parser.add_argument(
        "datasets", nargs="+", metavar="DATASET", help="folder of a LeRobot dataset"
    )
    parser.add_argument(
        "--write", action="store_true", help="also write the tables into docs/benchmarks.md"
    )
    arguments = parser.parse_args()
    torch.set_num_threads(1)
    text = "\n\n".join(map(str, measure(arguments.datasets)))
    print(text)
    if arguments.write:
        results_page.update("real_data", text)


if __name__ == "__main__":
    main()
