"""Scores of the paper's Figure 2: order of winners, alternations, duplicate targets."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from itertools import groupby, pairwise
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from pacnet import NO_NODE
from train.postural.schema_network.episodes import SCHEMAS, Episode
from train.postural.winners import switches, winner_order

SAME_TARGET = 1.0  # [degrees] largest RMS difference over the joints of equal targets
MIN_WINS = 10  # [samples] that a schema must win in an episode to count in the order
GRASPING = (2, 6)  # the schemas that alternate in the paper
SHOWN_PAIRS = 5  # the pairs that alternate most


def order_of_medians(winners: NDArray[np.int64], schemas: Sequence[int]) -> tuple[int, ...]:
    """Return a behaviour's own schemas in the order of the median time at which each wins.

    The median is robust against flicker and against a schema that wins again for a short time when
    a posture recurs.

    Args:
        winners: Schema that wins each sample `[T]`.
        schemas: To order; those that win fewer than `MIN_WINS` samples are left out.
    """
    times = {schema: np.flatnonzero(winners == schema) for schema in schemas}
    lasting = [schema for schema in schemas if len(times[schema]) >= MIN_WINS]
    return tuple(sorted(lasting, key=lambda schema: float(np.median(times[schema]))))


def strict_order(winners: NDArray[np.int64], schemas: Sequence[int]) -> tuple[int, ...]:
    """Return `winner_order` of all schemas, with schemas 2 and 6 merged.

    Runs of fewer than three samples are left out. Schemas 2 and 6 may alternate in the grasp: the
    one of the shown behaviour stands for both.
    """
    own = next((schema for schema in GRASPING if schema in schemas), NO_NODE)
    folded = [
        own if own != NO_NODE and node in GRASPING else node for node in winner_order(winners)
    ]
    return tuple(node for node, _ in groupby(folded))


def score_system(episodes: Sequence[Episode], system: str) -> dict[str, float]:
    """Return the mean scores over episodes, for any system.

    Returns:
        `switches`: changes of the winner, including flicker; `nobody_share`: samples without a
        winner; `task_success_rate`: of a system that acted.
    """
    winners = [episode.winners[system] for episode in episodes]
    scores = {
        "switches": _mean(map(switches, winners)),
        "nobody_share": _mean((won == NO_NODE).mean() for won in winners),
    }
    if all(system in episode.success for episode in episodes):
        scores["task_success_rate"] = _mean(episode.success[system] for episode in episodes)
    return scores


def score_schemas(episodes: Sequence[Episode], system: str) -> dict[str, Any]:
    """Return the mean scores over the episodes of one behaviour, for a schema network.

    Returns:
        `in_order_rate`: share of episodes in which the behaviour's own schemas win in order, by
        `order_of_medians`; `strictly_in_order_rate`: likewise by `strict_order`; `own_share`: of
        the samples with a winner, those that one of its own schemas wins; `alternations_2_6`:
        changes between 2 and 6, samples of others left out; `alternations_2_6_by_phase`: the same
        by the phase of the later one; `switches_by_phase`; `switching_pairs`: changes per episode
        between the pairs that alternate most.
    """
    own = SCHEMAS[episodes[0].behaviour]
    winners = [episode.winners[system] for episode in episodes]
    phases = [episode.shown.phases for episode in episodes]
    turns = [_changes(np.where(np.isin(won, GRASPING), won, NO_NODE)) for won in winners]
    every = [_changes(won) for won in winners]
    pairs = Counter("-".join(map(str, sorted(pair))) for changes in every for _, *pair in changes)
    return {
        "in_order_rate": _mean(order_of_medians(won, own) == own for won in winners),
        "strictly_in_order_rate": _mean(strict_order(won, own) == own for won in winners),
        "own_share": _mean(np.isin(won[won != NO_NODE], own).mean() for won in winners),
        "alternations_2_6": _mean(map(len, turns)),
        "alternations_2_6_by_phase": _by_phase(turns, phases),
        "switches_by_phase": _by_phase(every, phases),
        "switching_pairs": _per_episode(pairs.most_common(SHOWN_PAIRS), len(episodes)),
    }


def score_order(
    episodes: Sequence[Episode], system: str, order: tuple[int, ...]
) -> dict[str, float]:
    """Return how the schemas win in the episodes of one behaviour, in which some may win again.

    Args:
        episodes: Of the behaviour.
        system: Whose winners are scored.
        order: In which the schemas follow each other in the demonstration.

    Returns:
        `strictly_in_order_rate`: share of episodes in which all winners, runs of fewer than three
        samples left out, have this order; `own_share`: of the samples with a winner, those that a
        schema of the demonstration wins.
    """
    winners = [episode.winners[system] for episode in episodes]
    return {
        "strictly_in_order_rate": _mean(winner_order(won) == order for won in winners),
        "own_share": _mean(np.isin(won[won != NO_NODE], order).mean() for won in winners),
    }


def score_duplicates(schemas: Sequence[Tensor]) -> dict[str, float | int]:
    """Return how much motor schemas duplicate one another, for any system.

    Two targets are equal if the RMS of their differences over the joints is at most `SAME_TARGET`.

    Args:
        schemas: The targets of each motor schema `[L, A]` [rad].

    Returns:
        `motor_schemas`; `stored_targets`; `duplicate_pairs`: pairs in which the RMS distance of
        one schema's targets from the other's nearest ones is at most `SAME_TARGET`;
        `redundant_share`: share of targets that have an equal one in another schema.
    """
    nearest = [[_nearest(one, other) for other in schemas] for one in schemas]  # each [L]
    contained = [[bool(d.square().mean().sqrt() <= SAME_TARGET) for d in row] for row in nearest]
    numbers = range(len(schemas))
    pairs = sum(contained[i][j] or contained[j][i] for i in numbers for j in range(i))
    twice = [
        torch.stack([nearest[i][j] <= SAME_TARGET for j in numbers if j != i]).any(dim=0)
        for i in numbers
    ]
    return {
        "motor_schemas": len(schemas),
        "stored_targets": sum(map(len, schemas)),
        "duplicate_pairs": pairs,
        "redundant_share": float(torch.cat(twice).float().mean()),
    }


def _nearest(one: Tensor, other: Tensor) -> Tensor:
    """Return the RMS distance [degrees] from each target `[L, A]` to the nearest of the other's."""
    return torch.rad2deg(torch.cdist(one, other).amin(dim=1) / one.shape[1] ** 0.5)


def _changes(winners: NDArray[np.int64]) -> list[tuple[int, int, int]]:
    """Return each change of the winner: the sample, the winner before, the winner now."""
    won = np.flatnonzero(winners >= 0)
    steps = pairwise(won.tolist())
    return [(t, int(winners[s]), int(winners[t])) for s, t in steps if winners[s] != winners[t]]


def _by_phase(
    changes: Sequence[Sequence[tuple[int, int, int]]], phases: Sequence[Sequence[str]]
) -> dict[str, float]:
    """Return the changes per episode in each phase, in the order of the phases."""
    counts = Counter(
        shown[sample] for some, shown in zip(changes, phases, strict=True) for sample, *_ in some
    )
    order = dict.fromkeys(phase for shown in phases for phase in shown)
    return _per_episode([(phase, counts[phase]) for phase in order], len(phases))


def _per_episode(counts: Sequence[tuple[str, int]], episodes: int) -> dict[str, float]:
    return {name: count / episodes for name, count in counts}


def _mean(values: Any) -> float:
    return float(np.mean(list(values)))
