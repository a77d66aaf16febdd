"""Scores of an imitator that pauses when a percept is novel, and their table."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from statistics import median
from typing import Any

import numpy as np

from envs.scene import CONTROL_TIMESTEP
from train.postural.correction.episodes import Attempt, Pause, Turn

_SHOWN = ("episodes", "success_rate", "paused_share", "paused_in_time_share", "novelty_median")


def score_attempts(attempts: Sequence[Attempt]) -> dict[str, Any]:
    """Return the scores of episodes of one kind."""
    pauses = [attempt.pause for attempt in attempts if attempt.pause is not None]
    largest = [float(attempt.novelty.max()) for attempt in attempts]
    return {
        "episodes": len(attempts),
        "success_rate": float(np.mean([attempt.success for attempt in attempts])),
        "paused_share": len(pauses) / len(attempts),
        "paused_in_time_share": float(np.mean([attempt.paused_in_time for attempt in attempts])),
        "paused_after_s": _seconds(median(p.step for p in pauses)) if pauses else None,
        "paused_for": sorted({pause.dimension for pause in pauses}),
        "novelty_median": median(largest),
        "novelty_max": max(largest),
    }


def score_alone(attempts: Sequence[Attempt]) -> dict[str, Any]:
    """Return the scores of episodes of one kind, and what was named and asked in them."""
    pauses = [attempt.pause for attempt in attempts if attempt.pause is not None]
    after = [int((a.novelty[a.pause.step :] <= 1).sum()) for a in attempts if a.pause is not None]
    return score_attempts(attempts) | {
        "named": {name: _named(name, pauses) for name in sorted({p.dimension for p in pauses})},
        "actions_after_pause_max": max(after, default=None),
        "asks": pauses[0].asks if pauses else None,
    }


def print_questions(scores: Mapping[str, Mapping[str, Any]]) -> None:
    """Print what was asked first in each kind of episodes -> scores, where anything was."""
    print()
    for kind, score in scores.items():
        if score["asks"] is not None:
            print(f"{kind}: {score['asks']}")


def score_turn(turn: Turn) -> dict[str, Any]:
    """Return what happened at one attempt during the corrections."""
    pause = turn.attempt.pause
    return {
        "place": turn.place,
        "success": turn.attempt.success,
        "paused_at_s": None if pause is None else _seconds(pause.step),
        "dimension": None if pause is None else pause.dimension,
        "deviation": None if pause is None else pause.deviation,
        "tolerated": None if pause is None else pause.tolerated,
        "learning_s": turn.learning,
    }


def print_turn(turn: Turn) -> None:
    """Print what the imitator did, why it paused and how long it learned."""
    where = f"place {turn.place}" if turn.place else "usual place"
    print(f"{where:12}  {_describe(turn.attempt)}{_learned(turn.learning)}")


def print_scores(scores: Mapping[str, Mapping[str, Any]]) -> None:
    """Print kind of episodes -> scores as a table."""
    print(f"\n{'':28}" + "".join(f"{name:>22}" for name in _SHOWN))
    for kind, score in scores.items():
        numbers = (score[name] for name in _SHOWN)
        cells = (f"{n:22d}" if isinstance(n, int) else f"{n:22.3f}" for n in numbers)
        print(f"{kind:28}" + "".join(cells))


def _named(dimension: str, pauses: Sequence[Pause]) -> dict[str, Any]:
    """Return in how many episodes a dimension was novel, and by how much it was off there."""
    off = [pause.deviation for pause in pauses if pause.dimension == dimension]
    tolerated = max(pause.tolerated for pause in pauses if pause.dimension == dimension)
    return {
        "episodes": len(off),
        "deviation_min": min(off),
        "deviation_median": median(off),
        "deviation_max": max(off),
        "tolerated": tolerated,
    }


def _describe(attempt: Attempt) -> str:
    pause, end = attempt.pause, "with success" if attempt.success else "without success"
    if pause is None:
        return f"acted, {end}"
    return (
        f"paused after {_seconds(pause.step):.2f} s, {end}: {pause.dimension} is "
        f"{pause.deviation:+.3f} off, {pause.tolerated:.3f} is tolerated"
    )


def _learned(seconds: float | None) -> str:
    return "" if seconds is None else f"; shown, and learned in {seconds:.3f} s"


def _seconds(step: float) -> float:
    return round(float(step) * CONTROL_TIMESTEP, 6)
