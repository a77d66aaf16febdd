"""Following walls on a few targets, taught by a teacher that stops for a minute now and then."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from pacnet import MLPForwardModel, PACNet, PACNetConfig
from train.remembering.rules import RULES, Choice
from train.walls.drivers import Driver, Recalling
from train.walls.episodes import Place, act_alone, alone_seed
from train.walls.learning import Episode, follow_both_sides, frames, make_network, teach
from train.walls.nearest import NearestTargets
from train.walls.scores import tight, wf
from train.walls.variants import learn

PLAIN, RESTS = "no rests", "rests of a minute"
STREAMS = (PLAIN, RESTS)
SCORES = ("wf", "tight")
BUDGET = 30  # targets
ONE, FEW, MANY = 1, 8, 50  # nearest cues whose targets are averaged
STEPS = 2500  # of a run alone

PACNET, ALL = "PACNet (budget=)", f"{MANY}-NN over all frames"
RESERVOIR = "random frames (a reservoir)"
RESERVOIR_ONE = f"{RESERVOIR}, {ONE}-NN"
ROWS = (PACNET, *RULES, RESERVOIR_ONE, ALL)  # k-NN over FEW of what rules keep, but for one row


def score(stream: str, seed: int) -> dict[str, float]:
    """Return "score | row" -> value of robots that act alone.

    Args:
        stream: One of STREAMS.
        seed: Of the replicate.
    """
    learned = learn(seed, "paper")
    episodes = [*learned.episodes]
    if stream == RESTS:
        episodes = follow_both_sides("paper", seed, rests=True)
    cues, targets = frames(episodes)
    steps = [len(one.percepts) for one in episodes]
    of, side = (
        np.repeat(one, steps) for one in (range(len(steps)), [one.side for one in episodes])
    )
    model = learned.network.forward_model
    assert isinstance(model, MLPForwardModel)
    network = _within_budget(model, episodes)
    drivers: dict[str, Driver] = {PACNET: Recalling(network, seed)}
    for row, rule in RULES.items():
        kept = rule(Choice(cues.double().numpy(), of, side, BUDGET, seed))
        count = min(FEW, len(kept))
        drivers[row] = NearestTargets(cues[kept], targets[kept], count, model, seed)
        if row == RESERVOIR:
            drivers[RESERVOIR_ONE] = NearestTargets(cues[kept], targets[kept], ONE, model, seed)
    drivers[ALL] = NearestTargets(cues, targets, MANY, model, seed)
    scores = {}
    for row, driver in drivers.items():
        run = act_alone(driver, Place("paper"), alone_seed(seed), STEPS)
        scores |= {f"wf | {row}": wf(run), f"tight | {row}": tight(run)}
    return scores


def _within_budget(model: MLPForwardModel, episodes: Sequence[Episode]) -> PACNet:
    """Return PACNet taught within the budget; its targets are means already."""
    unbounded = make_network(model).config
    schemas = replace(unbounded.schemas, budget=BUDGET, nearest_cues=ONE)
    network = PACNet(PACNetConfig(unbounded.attention, schemas), model)
    teach(network, episodes, leave_bar=False)
    return network
