"""Experiment 2 in a world that changes: from some step on, one reading is half of what it was.

A robot follows its teacher along left and right walls in turn. The same percepts, targets and
held-out walks are learned and predicted by every row.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from envs.khepera import INFRARED_NAMES
from envs.wall_behaviours import Side
from pacnet import MotorSchemasConfig, PACNet, PACNetConfig, SOFMConfig, targets_ahead
from train.walls.episodes import TAUGHT_SIDES, follow, seeds_for
from train.walls.learning import EPISODE, NEAREST_CUES, NOVELTY_THRESHOLD

SENSOR, GAIN = INFRARED_NAMES.index("left_90"), 0.5  # whose gain drops, and to what
LEAD = 3  # [steps] from a percept to its target; nobody acts on these
BEFORE, BEFORE_STEPS = 8, 750  # episodes before the change, and their steps of 0.1 s
AFTER_STEPS = 300  # of an episode after it
HELD_OUT = 2  # episodes of BEFORE_STEPS, not learned
TIMES = (300, 600, 1200, 2400, 3600)  # [steps] after the change
TWO_MINUTES = 1200  # [steps]

INTERVALS = (300, 600, 1200, 2400)  # [steps] of forgetting, and of sliding windows
NEVER, ANEW = "no forgetting", "learned anew"
NEAREST, HOLDING = "50-NN over all frames", "the percept itself"
FORGETTING = {f"forgetting after {interval}": interval for interval in INTERVALS}
WINDOWS = {f"sliding window of {window}": window for window in INTERVALS}
ROWS = (*FORGETTING, NEVER, *WINDOWS, ANEW, NEAREST, HOLDING)

_CHANGING = 4  # purpose for which seeds are drawn

Predict = Callable[[Tensor], Tensor]  # percepts [T, 6] -> predicted targets [T, 6]


class Shown(NamedTuple):
    """Percepts and targets of following, in order of time."""

    percepts: Tensor  # [T, 6]
    targets: Tensor  # [T, 6]

    def last(self, count: int) -> Shown:
        """Return the last of them."""
        return Shown(self.percepts[-count:], self.targets[-count:])


class World(NamedTuple):
    """What one replicate sees."""

    before: list[Shown]  # episodes
    after: list[Shown]  # with the other gain
    held_out: list[Shown]  # with the other gain
    held_out_before: list[Shown]  # the same walks with the first gain


def with_gain(percepts: Tensor, gain: float) -> Shown:
    """Return an episode as it is seen with this gain of one sensor; targets are percepts, too."""
    seen = percepts.clone()
    seen[:, SENSOR] *= gain
    return Shown(seen, targets_ahead(seen, LEAD))


def make_world(seed: int) -> World:
    """Follow a teacher, before the change and after it."""
    counts = (BEFORE, TIMES[-1] // AFTER_STEPS, HELD_OUT)
    seeds = iter(seeds_for(seed, _CHANGING, sum(counts)))
    parts = []
    for count, steps in zip(counts, (BEFORE_STEPS, AFTER_STEPS, BEFORE_STEPS), strict=True):
        sides: list[Side] = [TAUGHT_SIDES[number % len(TAUGHT_SIDES)] for number in range(count)]
        walks = [follow("paper", side, next(seeds), steps).percepts for side in sides]
        parts.append([torch.from_numpy(walk) for walk in walks])
    before, after, held_out = parts
    return World(
        [with_gain(walk, 1.0) for walk in before],
        [with_gain(walk, GAIN) for walk in after],
        [with_gain(walk, GAIN) for walk in held_out],
        [with_gain(walk, 1.0) for walk in held_out],
    )


def make_network(forgetting_interval: int | None) -> PACNet:
    """Return an untrained network of Experiment 2 with another forgetting interval [steps]."""
    dimensions = len(INFRARED_NAMES)
    attention = SOFMConfig.paper(
        dimensions, novelty_threshold=NOVELTY_THRESHOLD, forgetting_interval=forgetting_interval
    )
    schemas = MotorSchemasConfig(dimensions, dimensions, nearest_cues=NEAREST_CUES)
    return PACNet(PACNetConfig(attention, schemas))


def score(world: World) -> dict[str, float]:
    """Return "row | time | score" -> value, of every row at every time after the change.

    Scores: `error`, the mean distance of a predicted reading from the one that came, with the new
    gain; `error_before`, the same with the first gain, which is what is lost of the old; `targets`
    that are kept. Where nothing is recalled, the percept itself is the prediction.
    """
    scores = {}
    for time, predictors in _learn(world):
        for row, (predict, kept) in predictors.items():
            cell = f"{row} | {time}"
            scores[f"{cell} | error"] = _error(predict, world.held_out)
            scores[f"{cell} | error_before"] = _error(predict, world.held_out_before)
            scores[f"{cell} | targets"] = float(kept)
    return scores


def _learn(world: World) -> Iterator[tuple[int, dict[str, tuple[Predict, int]]]]:
    """Yield each time after the change with what predicts in each row, and its targets."""
    growing = {row: make_network(interval) for row, interval in FORGETTING.items()}
    growing[NEVER] = make_network(None)
    for network in growing.values():
        for shown in world.before:
            network.observe(*shown, EPISODE)
    growing[ANEW] = make_network(None)
    seen = list(world.before)
    for number, shown in enumerate(world.after, 1):
        seen.append(shown)
        for network in growing.values():
            network.observe(*shown, EPISODE)
        if (time := number * AFTER_STEPS) in TIMES:
            everything = Shown(*map(torch.cat, zip(*seen, strict=True)))
            yield time, _predictors(growing, everything)


def _predictors(growing: dict[str, PACNet], seen: Shown) -> dict[str, tuple[Predict, int]]:
    networks = dict(growing)
    for row, window in WINDOWS.items():
        networks[row] = make_network(None)
        networks[row].observe(*seen.last(window), EPISODE)
    found = {row: (_recalling(n), int(n.schemas.lengths.sum())) for row, n in networks.items()}
    found[NEAREST] = _nearest(seen), len(seen.targets)
    found[HOLDING] = _hold, 0
    return found


def _recalling(network: PACNet) -> Predict:
    def predict(percepts: Tensor) -> Tensor:
        network.reset()
        recalled = network.recall(percepts)
        return recalled.target.where(recalled.has_target[:, None], percepts)

    return predict


def _nearest(seen: Shown) -> Predict:
    def predict(percepts: Tensor) -> Tensor:
        distance = torch.cdist(percepts, seen.percepts)
        rows = distance.topk(min(NEAREST_CUES, len(seen.targets)), largest=False).indices
        return seen.targets[rows].mean(dim=1)

    return predict


def _hold(percepts: Tensor) -> Tensor:
    return percepts


def _error(predict: Predict, episodes: Sequence[Shown]) -> float:
    errors = [(predict(shown.percepts) - shown.targets).abs().mean() for shown in episodes]
    return float(np.mean([float(error) for error in errors]))
