"""What `pacnet fit` prints of what was learned."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pacnet.cli.cameras import camera_pairs
from pacnet.cli.cuts import cut_pairs, describe_cuts
from pacnet.cli.points import describe_points, points_text
from pacnet.cli.printing import counted, print_pairs, size_text
from pacnet.cli.reports import (
    count_episodes,
    describe_forward_model,
    describe_reports,
    forward_model_text,
    print_reports,
)

if TYPE_CHECKING:
    from pacnet.imitator.imitator import Imitator


def print_learned(
    imitator: Imitator,
    before: int,
    seconds: float,
    folder: Path,
    cameras: Sequence[Mapping[str, Any]],
) -> None:
    """Print what was learned after the first `before` reports, and what the cameras tell."""
    from pacnet.cli.loading import size_of

    print_reports(describe_reports(imitator)[before:])
    print()
    new = imitator.reports[before:]
    episodes, frames = count_episodes(new), sum(report.frames for report in new)
    parts = f" in {len(new):,} parts" if len(new) > episodes else ""
    learned = (
        f"{counted(episodes, 'episode')}{parts}, {counted(frames, 'frame')} in {seconds:.1f} s"
    )
    if before:
        learned += f" ({counted(count_episodes(imitator.reports), 'episode')} in all)"
    points = describe_points(imitator.config)
    pairs = [
        ("learned", learned),
        ("nodes", f"{len(imitator.sofm):,}"),
        ("tasks", f"{len(imitator.tasks):,}"),
        ("targets", _targets(imitator)),
        ("points", points_text(points)),
        *camera_pairs(points | {"cameras": cameras}),
        *cut_pairs(points | describe_cuts(imitator)),
        ("checkpoint", f"{folder}, {size_text(size_of(folder))}"),
    ]
    model = describe_forward_model(imitator)
    if model is not None:
        pairs.insert(-1, ("forward model", forward_model_text(model)))
    print_pairs(pairs)


def _targets(imitator: Imitator) -> str:
    """Return how many targets are kept, and of what."""
    kept, shown = len(imitator.memory.rows), sum(report.frames for report in imitator.reports)
    of = "" if kept == shown else f" of {shown:,} shown"
    return f"{kept:,} {imitator.config.targets}s{of}"
