"""`pacnet fit --held-out N`: how the imitator acts at episodes that were not learned."""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable
from typing import TYPE_CHECKING

from pacnet.cli.parsing import whole_number
from pacnet.cli.printing import NOTHING, counted, print_table, progress_bar

if TYPE_CHECKING:
    from pacnet.datasets.demonstrations import Demonstrations
    from pacnet.evaluation.held_out import HeldOutScores, Split
    from pacnet.imitator.imitator import Imitator

_LEGEND = (
    "error: root mean square of action − action shown, in standard deviations of the actions "
    "learned; where the imitator holds, its last action counts"
)

_WITH_POINTS = (
    "with points the imitator leads {moved} back to where it wants it, and waits for it; {moved} "
    "of a recording heeds neither, so this error is larger than on a robot"
)


def add_held_out(parser: argparse.ArgumentParser) -> None:
    """Add the option --held-out."""
    parser.add_argument(
        "--held-out", type=whole_number(2), metavar="N",
        help="learn without the last of each N episodes, at most ten of them, and compare the "
        "imitator there with nearest neighbours (one of them looks at first pictures) and with "
        "repeating the last action; fewer than 2 N episodes are each left out in turn, and the "
        "checkpoint learns them all",
    )  # fmt: skip


def to_learn(demonstrations: Demonstrations, parted: list[Split]) -> Demonstrations:
    """Return what the checkpoint learns: all, where each episode is left out in turn."""
    return parted[0].training if len(parted) == 1 else demonstrations


def compare(
    parted: list[Split],
    imitator: Imitator,
    untrained: Callable[[Demonstrations], Imitator],
) -> None:
    """Follow what is held out, with a progress bar, and print the scores.

    Args:
        parted: what is learned, and what is held out.
        imitator: it has learned what `to_learn` returned.
        untrained: makes an imitator with settings from demonstrations, which it has yet to learn.
    """
    from pacnet.evaluation.held_out import score

    in_turn = len(parted) > 1
    shown = [one for split in parted for one in split.held_out]
    if in_turn:
        shown += [one for split in parted for one in split.training]
    with progress_bar("comparing", sum(len(one.state) for one in shown)) as advance:

        def learn(training: Demonstrations) -> Imitator:
            if not in_turn:
                return imitator
            other = untrained(training)
            other.learn(training, advance)
            return other

        scores = score(parted, learn, advance)
    print()
    print(_what_is_held_out(parted, scores))
    _print(scores)
    points = imitator.config.points
    if points is not None:
        print(_WITH_POINTS.format(moved=points.moved.name))


def _what_is_held_out(parted: list[Split], scores: HeldOutScores) -> str:
    """Return a sentence about the episodes held out."""
    from pacnet.datasets.format.numbers import numbers_text

    frames = counted(scores.frames, "frame")
    if len(parted) > 1:
        return (
            f"{counted(scores.episodes, 'episode')}, {frames}: each was left out in turn, and "
            "compared with what the others teach; the checkpoint has learned all of them"
        )
    numbers = numbers_text({one.episode for one in parted[0].held_out})
    verb = "was" if scores.episodes == 1 else "were"
    return f"held out: episodes {numbers}, {frames}, which {verb} not learned"


def _print(scores: HeldOutScores) -> None:
    """Print a row for the imitator and one for each baseline."""
    rows = [("imitator", f"{scores.acted:.1%}", f"{scores.novel:.1%}", _error(scores.error))]
    rows += [(name, NOTHING, NOTHING, _error(error)) for name, error in scores.baselines.items()]
    print_table(("<compared", "acts", "novel", "error"), rows)
    print(_LEGEND)


def _error(error: float) -> str:
    return NOTHING if math.isnan(error) else f"{error:.3f}"
