"""Scores on LASA shapes: each learner, each number of drawings shown, each disturbance."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from tqdm import tqdm

from benchmarks.harness import NOTHING, Table, factor, number
from benchmarks.lasa_data import Draw, draws, load_shape
from benchmarks.lasa_policies import IMITATOR, POLICIES, REPLAY
from benchmarks.lasa_protocol import (
    APPROACH,
    ARRIVED,
    BLOCK,
    CONDITIONS,
    PUSH,
    Condition,
    Policy,
    Score,
    plan_for,
    roll_out,
    score,
)

SHOWN = (1, 3)  # drawings
DRAWS, UNSEEN = 2, 3  # choices of them, and starts for each
RATES = (20, 50, 200)  # [1/s]
AT_EACH_RATE: tuple[Condition, ...] = ("undisturbed", "pushed")

TEXT = f"""`python -m benchmarks.lasa`: a point starts where a drawing starts that was not shown,
and approaches each action with a time constant of {1000 * APPROACH:g} ms, at {{hz:g}} steps a
second. Half-way in time it is pushed by {PUSH:g} mm across its path, or cannot move for {BLOCK:g}
s. Blended replay follows the mean of the drawings by time, from where it starts; the nearest
neighbour repeats the action of the nearest place. Area: between its path and that drawing, mean
over the shapes, {DRAWS} choices of drawings and {UNSEEN} starts. Ratio: of this mean to that of
blended replay. Arrived: share that ends within {ARRIVED:g} mm of the drawing's end. Held: share of
the steps without an action. Methods may be tuned on the shapes `development` alone. Shapes:
{{sizes}}; seed {{seed}}.
"""
RATES_TEXT = """`Imitator` at other rates, over {shapes} shapes: ratio of the area to that of
blended replay at the same rate, and arrivals. Tolerance: the deviation above which the imitator
takes a place for novel, mean over the undisturbed steps. Seed {seed}.
"""


class Case(NamedTuple):
    """What is scored together."""

    condition: Condition
    shown: int
    who: str


Scores = dict[Case, dict[str, Score]]
"""Case -> shape -> mean scores."""


def score_shapes(
    shapes: Sequence[str],
    hz: float,
    seed: int,
    learners: Sequence[str] = tuple(POLICIES),
    conditions: Sequence[Condition] = CONDITIONS,
) -> Scores:
    """Return the scores of each case on each shape.

    Args:
        shapes: out of `SHAPES`.
        hz: steps per second [1/s].
        seed: of the choice of drawings.
        learners: out of `POLICIES`.
        conditions: which to roll out.

    Raises:
        ValueError: no such shape.
        MissingDataError: see `load_shape`.
    """
    scores: Scores = {
        Case(condition, shown, who): {}
        for condition in conditions
        for shown in SHOWN
        for who in learners
    }
    for shape in tqdm(shapes, f"LASA at {hz:g} Hz", unit="shape", disable=None, leave=False):
        drawings = load_shape(shape, hz)
        chosen = {n: list(draws(drawings, n, DRAWS, UNSEEN, seed)) for n in SHOWN}
        for who in learners:
            for shown in SHOWN:
                learned = [(POLICIES[who](draw.shown), draw) for draw in chosen[shown]]
                for condition in conditions:
                    found = [s for pair in learned for s in score_starts(*pair, condition)]
                    scores[Case(condition, shown, who)][shape] = mean_of(found)
    return scores


def score_starts(policy: Policy, draw: Draw, condition: Condition) -> Iterator[Score]:
    """Yield the score from each unseen start; pushes alternate between right and left."""
    for count, drawn in enumerate(draw.unseen):
        plan = plan_for(condition, draw.shown, side=1.0 if count % 2 else -1.0)
        yield score(roll_out(policy, drawn.places[0], drawn.places[-1], plan), drawn)


def mean_of(scores: Sequence[Score]) -> Score:
    """Return the mean of each number."""
    return Score(*np.mean(scores, axis=0).tolist())


def mean_over(scores: Scores, case: Case, shapes: Sequence[str]) -> Score:
    """Return the mean over some shapes."""
    return mean_of([scores[case][shape] for shape in shapes])


def ratio(scores: Scores, case: Case, shapes: Sequence[str]) -> str:
    """Return the mean area over that of blended replay, as a cell."""
    if case.who == REPLAY:
        return NOTHING
    replay = mean_over(scores, case._replace(who=REPLAY), shapes)
    return factor(mean_over(scores, case, shapes).area / replay.area)


def scores_table(
    scores: Scores, groups: Mapping[str, Sequence[str]], hz: float, seed: int
) -> Table:
    """Return a row for each case, with columns for each group of shapes.

    Args:
        scores: of all shapes of the groups.
        groups: name -> shapes; area and time held are those of the first.
        hz: at which they were scored [1/s].
        seed: with which.
    """
    shapes = next(iter(groups.values()))
    columns = ["condition, drawings shown, learner", "area [mm²]", "held"]
    columns += [f"{what}, {name}" for name in groups for what in ("ratio", "arrived")]
    rows = []
    for case in scores:
        mean = mean_over(scores, case, shapes)
        row = [f"{case.condition}, {case.shown}, {case.who}", number(mean.area), f"{mean.held:.0%}"]
        for members in groups.values():
            arrived = mean_over(scores, case, members).arrived
            row += [ratio(scores, case, members), f"{arrived:.0%}"]
        rows.append(tuple(row))
    sizes = ", ".join(f"{name} {len(members)}" for name, members in groups.items())
    text = TEXT.format(hz=hz, sizes=sizes, seed=seed)
    return Table("LASA handwriting", text, tuple(columns), rows)


def rates_table(scores: Mapping[int, Scores], shapes: Sequence[str], seed: int) -> Table:
    """Return a row for each rate [1/s] and number of drawings shown."""
    rows = []
    for hz, found in scores.items():
        for shown in SHOWN:
            cases = [Case(condition, shown, IMITATOR) for condition in AT_EACH_RATE]
            means = [mean_over(found, case, shapes) for case in cases]
            row = [f"{hz:g} Hz, {shown}"]
            for case, mean in zip(cases, means, strict=True):
                row += [ratio(found, case, shapes), f"{mean.arrived:.0%}"]
            rows.append((*row, number(means[0].tolerance)))
    columns = ["rate, drawings shown"]
    columns += [f"{what}, {name}" for name in AT_EACH_RATE for what in ("ratio", "arrived")]
    text = RATES_TEXT.format(shapes=len(shapes), seed=seed)
    return Table("LASA handwriting at other rates", text, (*columns, "tolerance [mm]"), rows)
