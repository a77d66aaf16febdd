"""Imitating with the demonstrator present: how far off is the target of the nearest cue kept?"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from numpy.typing import NDArray

from pacnet import Imitator, MotorSchemasConfig, PACNet, PACNetConfig
from pacnet.datasets.demonstrations import Demonstrations
from train.postural.learning import SCALE, attention_config
from train.remembering.alone import ALL, OURS
from train.remembering.pairs import kept_pairs, nearest_cues
from train.remembering.rules import RULES, Choice
from train.remembering.streams import Stream, numbers_of, show

PACNET = "PACNet (budget=)"
FEW = 8  # nearest cues whose targets are averaged, chosen on seeds 1001 and 1002
MEAN_OF_ALL = f"all frames, {FEW}-NN"
ROWS = (OURS, PACNET, *RULES, ALL, MEAN_OF_ALL)

_HELD_OUT = 2  # demonstrations whose targets are looked for
_OTHERS = 100_000  # from a replicate's seed to that of what is held out

Array = NDArray[np.float64]


def score_cues(stream: Stream, budgets: Sequence[int], seed: int) -> dict[str, float]:
    """Return "budget | row" -> root-mean-square error of a target [deg] in drinks not learned.

    Args:
        stream: That was shown.
        budgets: Numbers of targets.
        seed: Of the replicate.
    """
    shown = show(stream, seed)
    unseen = show(Stream((stream.wanted,) * _HELD_OUT), seed + _OTHERS)
    cues, targets = _rows(shown)
    asked, wanted = _rows(unseen)
    of, task = numbers_of(shown)
    everything = {
        ALL: _nearest(cues, targets, asked),
        MEAN_OF_ALL: _nearest(cues, targets, asked, FEW),
    }
    scores = {}
    for budget in budgets:
        choice = Choice(cues, of, task, budget, seed)
        kept = {row: kept_pairs(row, choice, targets) for row in RULES}
        found = {row: _nearest(*pair, asked) for row, pair in kept.items()}
        found[OURS] = _nearest(*_interpolated(shown, budget), asked)
        found[PACNET] = _recalled(shown, unseen, budget)
        for row, guess in (found | everything).items():
            error = np.rad2deg(np.sqrt(np.square(guess - wanted).mean()))
            scores[f"{budget} | {row}"] = float(error)
    return scores


def _rows(shown: Demonstrations) -> tuple[Array, Array]:
    """Return all scaled percepts `[N, 28]` and targets `[N, 11]`."""
    percepts = torch.cat([one.percepts for one in shown]).double().numpy() * np.array(SCALE)
    targets = torch.cat([one.action for one in shown]).double().numpy()
    return percepts, targets


def _interpolated(shown: Demonstrations, budget: int) -> tuple[Array, Array]:
    """Return the scaled percepts and the targets that an imitator interpolates."""
    imitator = Imitator.from_demonstrations(shown, budget=budget, points=None)
    imitator.learn(shown)
    whole = imitator.memory.whole()
    factor = np.array(SCALE) / imitator.config.scaling.array
    return whole.percepts * factor, whole.targets.astype(np.float64)


def _recalled(shown: Demonstrations, unseen: Demonstrations, budget: int) -> Array:
    """Return what PACNet recalls, taught in one pass, `[N, 11]`; without a target 0."""
    schemas = MotorSchemasConfig(unseen.episodes[0].action.shape[1], len(SCALE), budget=budget)
    network = PACNet(PACNetConfig(attention_config(), schemas))
    for one in shown:
        network.observe(one.percepts, one.action, one.episode)
    network.eval()
    recalled = [network.recall(one.percepts).target for one in unseen]
    return np.nan_to_num(torch.cat(recalled).double().numpy())


def _nearest(cues: Array, targets: Array, asked: Array, count: int = 1) -> Array:
    """Return the mean target of so many nearest cues for each percept."""
    return targets[nearest_cues(cues, asked, count)].mean(axis=1)
