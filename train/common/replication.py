"""Experiments of several replicates: run on all cores, summarised, written and logged."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TypeVar

from matplotlib.figure import Figure
from tqdm import tqdm

from train.common.learning_log import LearningLog
from train.common.pool import processes
from train.common.runs import command_line, positive, save_figures, write_metrics
from train.common.summary import Summary, summarise

Scores = dict[str, dict[str, Summary]]  # experiment -> score -> over the replicates
Name = TypeVar("Name")


def add_arguments(parser: argparse.ArgumentParser, replicates: int) -> None:
    """Add the number of replicates, and the body model of those who act alone.

    Args:
        parser: Of the command line.
        replicates: How many there are unless it is given.
    """
    parser.add_argument(
        "--replicates",
        type=positive,
        default=replicates,
        help="repetitions; each learns everything anew from the next seed",
    )
    parser.add_argument(
        "--body", default="checkpoints/body", help="folder of the body model, from train.babbling"
    )


def seeds_of(arguments: argparse.Namespace) -> range:
    """Return the seed of each replicate."""
    return range(arguments.seed, arguments.seed + arguments.replicates)


def run_parts(
    replicates: Sequence[Mapping[Name, Callable[[], dict[str, float]]]],
) -> Iterator[dict[Name, dict[str, float]]]:
    """Yield the results of each replicate's parts, run on all cores, with a progress bar.

    Args:
        replicates: Name of a part -> what scores it, for each replicate; parts can be pickled.
    """
    with processes() as pool, tqdm(total=sum(map(len, replicates)), unit="part") as progress:
        submitted = [{name: pool.submit(part) for name, part in one.items()} for one in replicates]
        for part in (part for one in submitted for part in one.values()):
            part.add_done_callback(lambda _: progress.update())
        for one in submitted:
            yield {name: part.result() for name, part in one.items()}


def record_replicates(
    module: str,
    arguments: argparse.Namespace,
    folder: Path,
    replicates: Iterable[Mapping[str, Mapping[str, float]]],
    draw: Callable[[Scores], Mapping[str, Figure]],
) -> Scores:
    """Write the scores of replicates after each of them, so that none is lost, then draw and log.

    Args:
        module: That is run, for the command in `metrics.json`.
        arguments: Of the command line.
        folder: Of the run.
        replicates: Experiment -> score -> value, of each.
        draw: Returns name -> figure from all scores.
    """
    command, done, scores = command_line(module, arguments), [], Scores()
    for replicate in replicates:
        done.append(replicate)
        scores = {name: summarise([one[name] for one in done]) for name in replicate}
        write_metrics(folder / "metrics.json", command, arguments.seed, scores)
    figures = draw(scores)
    save_figures(folder / "figures", figures)
    with LearningLog(folder / "tensorboard") as log:
        for name, values in scores.items():
            log.scores({cell: score["mean"] for cell, score in values.items()}, name)
        log.pictures(*(folder / "figures" / f"{name}.png" for name in figures))
    return scores


def print_places(folder: Path) -> None:
    """Print where the results of a run are."""
    print(f"\nscores    {folder / 'metrics.json'}\nfigure    {folder / 'figures'}")
    print(f"to browse tensorboard --logdir {folder / 'tensorboard'}")
