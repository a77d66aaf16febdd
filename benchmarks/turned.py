"""A task that depends on how things are turned, from one demonstration: `benchmarks.turned`.

A mug is grasped by its handle, carried, and hung on a hook, wherever both are and however they are
turned.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable, Sequence
from statistics import fmean

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
LONGEST = 12 * FPS  # frames of an episode
TEXT = f"""`python -m benchmarks.turned`: a hand that lags behind commanded velocities, at {FPS} Hz,
grasps a mug by its handle, carries it, and hangs it on a hook in front of a board. The mug stands
in a square of {100 * SQUARE:.0f} cm; mug and board are turned by up to {math.degrees(TURN):.0f}°
either way. The handle has to be within {100 * NEAR:.0f} cm of the hand where the gripper closes,
and within {100 * NEAR:.0f} cm of the hook's end where it opens. A mug that the hand runs into is
pushed away, and the board stops the hand. Where the hand turns too, a fourth action turns it; it
has to be within {math.degrees(ALIGNED):.0f}° of the mug to grasp it, and to take it to within
{math.degrees(ALIGNED):.0f}° of the board. Learned from one demonstration with noise of {NOISE:g} on
each action; then other places and turns. Success: share of {{episodes}} episodes, mean over
{{draws}} demonstrations. `Imitator` has its automatic settings: place and orientation of hand, mug
and board. Beside it: places alone declared as points; no points; the nearest frame, described
relative to the hand, along the world's axes or the mug's; replay. Where a learner holds, the zero
action is sent.
"""


def succeeds(learner: Learner, variant: Variant, seed: int) -> bool:
    """Return whether a learner hangs the mug up in the scene of a seed."""
    world = World(variant, np.random.default_rng(seed))
    learner.reset()
    for _ in range(LONGEST):
        action = learner.act(world.percept())
        world.step(np.zeros(len(variant.action_names)) if action is None else action)
        if world.hangs:
            return True
    return False


def success(
    make: Callable[[Variant], Learner], variant: Variant, draws: int, placements: int
) -> float:
    """Return a learner's success over demonstrations and held-out placements."""
    shares = []
    for draw in range(draws):
        learner = make(variant)
        learner.learn(demonstrations_of(variant, SHOWN * (draw + 1)))
        seeds = range(HELD_OUT, HELD_OUT + placements)
        shares.append(fmean(succeeds(learner, variant, seed) for seed in seeds))
    return fmean(shares)


def measure(draws: int, placements: int) -> Table:
    """Measure every learner in every variant."""
    rows = []
    with tqdm(total=len(VARIANTS) * len(LEARNERS), desc="turned", disable=None) as bar:
        for variant in VARIANTS.values():
            shares = []
            for make in LEARNERS.values():
                shares.append(f"{success(make, variant, draws, placements):.0%}")
                bar.update()
            rows.append((variant.title, *shares))
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
