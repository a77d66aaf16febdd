"""Following walls on a few targets, taught by a teacher that stops for a minute now and then."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from pacnet import MLPForwardModel, PACNet, PACNetConfig
from train.remembering.pairs import kept_pairs
from train.remembering.rules import RULES, Choice
from train.walls.drivers import Driver, Recalling
from train.walls.episodes import Place, act_alone, alone_seed
from train.walls.learning import Episode, follow_both_sides, frames, make_network, teach
from train.walls.nearest import NearestTargets
from train.walls.scores import tight, wf
from train.walls.variants import learn

RESTS = "rests of a minute"
SCORES = ("wf", "tight")
BUDGET = 30  # targets
COUNTS = (1, 8)  # nearest cues whose targets are averaged, of few targets
MANY = 50  # the same of all
STEPS = 2500  # of a run alone

PACNET, ALL = "PACNet (budget=)", f"all frames, {MANY}-NN"
ROWS = (PACNET, *RULES, ALL)


def score(seed: int) -> dict[str, float]:
    """Return "k-NN score | row" -> value of robots that act alone, for each k of COUNTS."""
    model = learn(seed, "paper").network.forward_model
    assert isinstance(model, MLPForwardModel)
    episodes = follow_both_sides("paper", seed, rests=True)
    cues, targets = frames(episodes)
    kept = _kept(episodes, seed)
    everything = _run(NearestTargets(cues, targets, MANY, model, seed), seed)
    scores = {}
    for count in COUNTS:
        network = Recalling(_within_budget(model, episodes, count), seed)
        runs = {PACNET: _run(network, seed), ALL: everything}
        for row, (own, of) in kept.items():
            few = min(count, len(own))
            runs[row] = _run(NearestTargets(own, of, few, model, seed), seed)
        for row, values in runs.items():
            scores |= {f"{count}-NN {name} | {row}": value for name, value in values.items()}
    return scores


def _kept(episodes: Sequence[Episode], seed: int) -> dict[str, tuple[Tensor, Tensor]]:
    """Return row -> the cues and targets that its rule keeps."""
    cues, targets = (rows.double().numpy() for rows in frames(episodes))
    steps = [len(one.percepts) for one in episodes]
    of, side = np.arange(len(steps)).repeat(steps), np.repeat([one.side for one in episodes], steps)
    choice = Choice(cues, of, side, BUDGET, seed)
    pairs = {row: kept_pairs(row, choice, targets) for row in RULES}
    return {row: (_tensor(own), _tensor(of)) for row, (own, of) in pairs.items()}


def _tensor(rows: NDArray[np.float64]) -> Tensor:
    return torch.from_numpy(rows.astype(np.float32))


def _run(driver: Driver, seed: int) -> dict[str, float]:
    """Let somebody act alone from a replicate's place; return the scores."""
    run = act_alone(driver, Place("paper"), alone_seed(seed), STEPS)
    return {"wf": wf(run), "tight": tight(run)}


def _within_budget(model: MLPForwardModel, episodes: Sequence[Episode], count: int) -> PACNet:
    """Return PACNet taught within the budget, which averages over so many nearest cues."""
    unbounded = make_network(model).config
    schemas = replace(unbounded.schemas, budget=BUDGET, nearest_cues=count)
    network = PACNet(PACNetConfig(unbounded.attention, schemas), model)
    teach(network, episodes, leave_bar=False)
    return network
