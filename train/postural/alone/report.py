"""The tables of those who act alone, as they are printed."""

from __future__ import annotations

from collections.abc import Mapping

from train.common.summary import Summary
from train.postural.alone.scenes import ROWS, SCENES, STRANGE

_OTHER = "another demonstrator"


def print_tables(summary: Mapping[str, Mapping[str, Summary]]) -> None:
    """Print success and distance of each row in each scene, novelty and times."""
    _print_grid("success", summary["success"], ROWS, 1)
    _print_grid("path from the demonstrator's [cm]", summary["distance_m"], (*ROWS, _OTHER), 100)
    print("\ncalled new, share of episodes")
    for name, share in summary["novelty"].items():
        what = "before the hand is there" if name in STRANGE else "in any step, a false alarm"
        label = f"{'glass ' if name in STRANGE else ''}{name}, {what}"
        print(f"{label:<52}{_text(share, 1)}")
    shares = summary["mirror"]
    print(
        f"\nthe node of the other's grasp wins {_text(shares['own'], 1)} of the own grasp, ", end=""
    )
    print(f"{_text(shares['watched'], 1)} of the other's, {_text(shares['chance'], 1)} of all")
    timing = summary["timing"]
    print(
        f"\nlearning {_text(timing['learning_s'], 1)} s, a step {_text(timing['step_s'], 1e3)} ms"
    )


def _print_grid(
    title: str, cells: Mapping[str, Summary], rows: tuple[str, ...], unit: float
) -> None:
    print(f"\n{title:<34}" + "".join(f"{scene:>24}" for scene in SCENES))
    for row in rows:
        values = (cells.get(f"{scene} | {row}") for scene in SCENES)
        print(f"{row:<34}" + "".join(f"{_text(value, unit):>24}" for value in values))


def _text(score: Summary | None, factor: float) -> str:
    """Return a mean, with the standard deviation where there are replicates."""
    if score is None:
        return "-"
    spread = f" ± {factor * score['std']:.2f}" if len(score["values"]) > 1 else ""
    return f"{factor * score['mean']:.2f}{spread}"
