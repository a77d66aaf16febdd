"""The tables of those who act alone, as they are printed."""

from __future__ import annotations

from collections.abc import Mapping

from train.common.summary import Summary, mean_and_std
from train.common.typical import Typical, beside
from train.postural.alone.scenes import ROWS, SCENES, STRANGE

_OTHER = "another demonstrator"


def print_tables(
    summary: Mapping[str, Mapping[str, Summary]], typical: Typical | None = None
) -> None:
    """Print success and distance of each row in each scene, novelty, mirror and times.

    Args:
        summary: Of a run, group by group.
        typical: The same over replicates run before, put in brackets beside each.
    """
    success = _texts("success", summary, typical)
    _print_grid("success", success, ROWS)
    distance = _texts("distance_m", summary, typical, 100)
    _print_grid("path from the demonstrator's [cm]", distance, (*ROWS, _OTHER))
    print("\ncalled new, share of episodes")
    for name, share in _texts("novelty", summary, typical).items():
        what = "before the hand is there" if name in STRANGE else "in any step, a false alarm"
        label = f"{'glass ' if name in STRANGE else ''}{name}, {what}"
        print(f"{label:<52}{share}")
    shares = _texts("mirror", summary, typical)
    print(f"\nthe node of the other's grasp wins {shares['own']} of the own grasp, ", end="")
    print(f"{shares['watched']} of the other's, {shares['chance']} of all")
    learning = mean_and_std(summary["timing"]["learning_s"])
    step = mean_and_std(summary["timing"]["step_s"], factor=1e3)
    print(f"\nlearning {learning} s, a step {step} ms")
    if typical is not None:
        print(f"\nin brackets: {typical.about}")


def _texts(
    group: str,
    summary: Mapping[str, Mapping[str, Summary]],
    typical: Typical | None,
    factor: float = 1,
) -> dict[str, str]:
    """Return each score of a group as text, in brackets what is typical."""
    known = typical.scores.get(group, {}) if typical is not None else {}
    return {
        name: beside(score, known.get(name), factor=factor)
        for name, score in summary[group].items()
    }


def _print_grid(title: str, cells: Mapping[str, str], rows: tuple[str, ...]) -> None:
    print(f"\n{title:<34}" + "".join(f"{scene:>24}" for scene in SCENES))
    for row in rows:
        values = (cells.get(f"{scene} | {row}", "-") for scene in SCENES)
        print(f"{row:<34}" + "".join(f"{value:>24}" for value in values))
