"""A task that depends on how things are turned, from one demonstration: `benchmarks.turned`.

A mug is grasped by its handle, carried, and hung on a hook, wherever both are and however they are
turned.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable, Sequence
from statistics import fmean
from typing import NamedTuple

import numpy as np
import torch
from tqdm import tqdm

from benchmarks.harness import Table
from benchmarks.turned_expert import NOISE, demonstrations_of
from benchmarks.turned_learners import LEARNERS, Learner
from benchmarks.turned_world import (
    ALIGNED,
    FPS,
    NEAR,
    SQUARE,
    TURN,
    VARIANTS,
    Variant,
    World,
)

DRAWS, PLACEMENTS = 3, 50
SHOWN, HELD_OUT = 10_000, 1_000  # seeds: draw d is shown from SHOWN (d + 1) on
LONGEST = 8 * FPS  # frames of an episode
LEAST_HELD = 0.05  # share of steps without an action that is told
TEXT = f"""`python -m benchmarks.turned`: a hand that lags behind commanded velocities, at {FPS} Hz,
grasps a mug by its handle, carries it, and hangs it on a hook in front of a board. The mug stands
in a square of {100 * SQUARE:.0f} cm; mug and board are turned by up to {math.degrees(TURN):.0f}°
either way. The handle has to be within {100 * NEAR:.0f} cm of the hand where the gripper closes,
and within {100 * NEAR:.0f} cm of the hook's end where it opens. A mug that the hand runs into is
pushed away, and the board stops the hand. Where the hand turns too, a fourth action turns it; it
has to be within {math.degrees(ALIGNED):.0f}° of the mug to grasp it, and to take it to within
{math.degrees(ALIGNED):.0f}° of the board. Learned from one demonstration with noise of {NOISE:g} on
each action; then other places and turns. Success: share of {{episodes}} episodes, mean over
{{draws}} demonstrations, in brackets of those in which the mug was grasped, and the share of steps
without an action where there were many; the zero action is sent then. `Imitator` has its automatic
settings: place and orientation of mug and board are found by name. Places alone: it does not
perceive how they are turned. No points: nor does it know which numbers are places. 1-NN: the
nearest frame, described relative to the hand along the world's axes, or along the mug's and acting
along them.
"""


class Outcome(NamedTuple):
    """What a learner did in one scene."""

    grasped: bool
    hung: bool
    held: float
    """Share of the steps without an action."""


def outcome(learner: Learner, variant: Variant, seed: int) -> Outcome:
    """Let a learner act in the scene of a seed, until the mug hangs or it has been long enough."""
    world = World(variant, np.random.default_rng(seed))
    learner.reset()
    held, step = 0, 0
    while step < LONGEST and not world.hangs:
        action = learner.act(world.percept())
        world.step(np.zeros(len(variant.action_names)) if action is None else action)
        held, step = held + (action is None), step + 1
    return Outcome(world.was_held, world.hangs, held / step)


def outcomes(
    make: Callable[[Variant], Learner], variant: Variant, draws: int, placements: int
) -> list[Outcome]:
    """Return what a learner did after each demonstration, in all held-out scenes."""
    found = []
    for draw in range(draws):
        learner = make(variant)
        learner.learn(demonstrations_of(variant, SHOWN * (draw + 1)))
        found += [outcome(learner, variant, HELD_OUT + seed) for seed in range(placements)]
    return found


def cell(found: Sequence[Outcome]) -> str:
    """Return shares as in 97% (100%): hung, and in brackets grasped."""
    held = fmean(one.held for one in found)
    told = f", held {held:.0%}" if held >= LEAST_HELD else ""
    return f"{fmean(o.hung for o in found):.0%} ({fmean(o.grasped for o in found):.0%}{told})"


def measure(draws: int, placements: int) -> Table:
    """Measure every learner in every variant."""
    rows = []
    with tqdm(total=len(VARIANTS) * len(LEARNERS), desc="turned", disable=None) as bar:
        for variant in VARIANTS.values():
            cells = []
            for make in LEARNERS.values():
                cells.append(cell(outcomes(make, variant, draws, placements)))
                bar.update()
            rows.append((variant.title, *cells))
    text = TEXT.format(draws=draws, episodes=placements)
    title = "Turned objects: a mug and a hook, from one demonstration"
    return Table(title, text, ("variant", *LEARNERS), rows)


def parse_arguments(arguments: Sequence[str] | None = None) -> argparse.Namespace:
    """Parse the command line."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.turned",
        description="Hang a turned mug on a turned hook after one demonstration; print a table.",
    )
    parser.add_argument("--draws", type=int, default=DRAWS, help=f"of demonstrations ({DRAWS})")
    parser.add_argument(
        "--placements", type=int, default=PLACEMENTS, help=f"after each ({PLACEMENTS})"
    )
    parser.add_argument(
        "--write", action="store_true", help="also write the table into docs/benchmarks.md"
    )
    parsed = parser.parse_args(arguments)
    for name in ("draws", "placements"):
        if (given := getattr(parsed, name)) < 1:
            parser.error(f"argument --{name}: expected 1 or more, got {given}")
    return parsed


def main() -> None:
    """Measure, print and write."""
    arguments = parse_arguments()
    torch.set_num_threads(1)
    table = str(measure(arguments.draws, arguments.placements))
    print(table)
    if arguments.write:
        from benchmarks import results_page

        results_page.update("turned", table)


if __name__ == "__main__":
    main()
