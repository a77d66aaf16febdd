"""Drawings with a pause: whether a learner gets past it."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from tqdm import tqdm

from benchmarks.harness import Table
from benchmarks.lasa_data import (
    PAUSE_NOISE,
    Array,
    Drawing,
    draws,
    frame_after,
    load_shape,
    with_pause,
)
from benchmarks.lasa_policies import IMITATOR, NEAREST, POLICIES
from benchmarks.lasa_protocol import ARRIVED, PATIENCE, Plan, roll_out

SECONDS = (0.0, 0.5, 1.0, 2.0, 5.0)  # of pauses [s]
PLACES = (0.1, 0.3, 0.5, 0.7, 0.9)  # of pauses, in shares of the path's length
ALLOWED = 2  # times the duration of the drawing with its pause

TEXT = f"""Share of the rollouts that end within {ARRIVED:g} mm of the end of a drawing with a
pause, which was shown alone or as the first of three. They begin where that drawing begins, at
{{hz:g}} steps a second, and may take {ALLOWED} times as long. In the pause the pen stays where it
is, up to noise of {PAUSE_NOISE} mm. One drawing of each of {{shapes}} shapes, seed {{seed}}.
"""


class Row(NamedTuple):
    """Who gets past which pauses."""

    who: str
    shown: int
    """Number of drawings, of which the first has the pause."""
    seconds: float

    def __str__(self) -> str:
        """Return it in words."""
        among = "alone" if self.shown == 1 else f"in one of {self.shown}"
        return f"{self.who}, {among}, {self.seconds:g} s"


ROWS = [
    Row(who, shown, seconds)
    for who, shown in ((IMITATOR, 1), (IMITATOR, 3), (NEAREST, 1))
    for seconds in SECONDS
]


def gets_past(row: Row, shown: Sequence[Drawing], place: Array) -> bool:
    """Return whether a learner reaches the end of the first drawing, which pauses at a place `[2]`.

    Where the place is close to the end, the point has to come closer than that.
    """
    first, goal = shown[0], shown[0].places[-1]
    near = min(ARRIVED, math.dist(place, goal) / 2)
    steps, patience = ALLOWED * len(first.places), PATIENCE + row.seconds
    plan = Plan(first.hz, steps, patience=patience, near=near)
    path = roll_out(POLICIES[row.who](shown), first.places[0], goal, plan).path
    return math.dist(path[-1], goal) < near


def _results(row: Row, shape: str, hz: float, seed: int) -> Iterator[bool]:
    """Yield whether it gets past a pause at each of `PLACES`."""
    (draw,) = draws(load_shape(shape, hz), row.shown, 1, 0, seed)
    for share in PLACES:
        first, *others = draw.shown
        paused = with_pause(first, share, row.seconds, np.random.default_rng(seed))
        place = first.places[frame_after(first.places, share)]
        yield gets_past(row, [paused, *others], place)


def pauses_table(shapes: Sequence[str], hz: float, seed: int) -> Table:
    """Roll out every learner, pause and place; return the shares that get past.

    Args:
        shapes: out of `SHAPES`.
        hz: steps per second [1/s].
        seed: of the choice of drawings and of the noise.

    Raises:
        ValueError: no such shape.
        MissingDataError: see `load_shape`.
    """
    rows = []
    with tqdm(total=len(ROWS) * len(shapes), desc="pauses", disable=None, leave=False) as bar:
        for row in ROWS:
            past = []  # [shapes, places]
            for shape in shapes:
                past.append(list(_results(row, shape, hz, seed)))
                bar.update()
            shares = [*np.mean(past, axis=0), np.mean(past)]
            rows.append((str(row), *(f"{share:.0%}" for share in shares)))
    columns = ("learner, shown, pause", *(f"at {place:.0%}" for place in PLACES), "all")
    text = TEXT.format(hz=hz, shapes=len(shapes), seed=seed)
    return Table("LASA handwriting with pauses", text, columns, rows)
