"""The table of episode reports, which `pacnet fit` and `pacnet info` print."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from itertools import pairwise
from typing import TYPE_CHECKING, Any

from pacnet.cli.printing import NOTHING, counted, print_table

if TYPE_CHECKING:
    from pacnet.imitator.imitator import Imitator
    from pacnet.imitator.records import EpisodeReport

_HEADS = (
    "<dataset", "episode", "<task", "frames", "new nodes", "nodes", "stored", "novelty",
)  # fmt: skip
_LEGEND = """stored: share of the frames that are kept: all, or with a budget the keyframes, if any
novelty: largest novelty before the episode was learned; above 1 it was novel"""


def describe_reports(imitator: Imitator) -> list[dict[str, Any]]:
    """Return the report of each episode learned, with the share of frames stored, for JSON."""
    kept = imitator.memory.demonstrations.live("rows").tolist()
    return [
        report._asdict() | {"stored_share": rows / report.frames}
        for report, rows in zip(imitator.reports, kept, strict=True)
    ]


def count_episodes(reports: Sequence[EpisodeReport]) -> int:
    """Return the number of episodes; those that are learned in parts have several reports."""
    places = [(report.dataset, report.episode, report.first_frame) for report in reports]
    continued = sum(
        before[:2] == after[:2] and before[2] < after[2] for before, after in pairwise(places)
    )
    return len(places) - continued


def forward_model_text(fields: Mapping[str, Any]) -> str:
    """Return which forward model finds the actions, and how well each one that was tried predicts.

    Args:
        fields: `model`, `explained` and `lead`, as `describe_forward_model` returns them.
    """
    model, shares = fields["model"], fields["explained"]
    if not shares:  # of an older checkpoint
        return str(model)
    others = [f"; {name}: {share:.0%}" for name, share in shares.items() if name != model]
    over = f"the change over {counted(fields['lead'], 'frame')}, in frames held out"
    return f"{model}, which predicts {shares[model]:.0%} of {over}{''.join(others)}"


def describe_forward_model(imitator: Imitator) -> dict[str, Any] | None:
    """Return which forward model an imitator has, for JSON; None without one."""
    from pacnet.imitator.forward_model import AFFINE, NETWORK, AffineForwardModelConfig

    config = imitator.config
    if config.forward_model is None:
        return None
    is_affine = isinstance(config.forward_model, AffineForwardModelConfig)
    return {
        "model": AFFINE if is_affine else NETWORK,
        "explained": dict(config.explained),
        "lead": config.lead,
        "still_actions": [config.action[number] for number in config.still_actions],
    }


def print_reports(rows: Iterable[Mapping[str, Any]]) -> None:
    """Print what `describe_reports` returned, and what the columns mean."""
    print_table(_HEADS, map(_cells, rows))
    print(_LEGEND)


def _cells(row: Mapping[str, Any]) -> tuple[str, ...]:
    novelty = row["max_novelty"]
    return (
        row["dataset"],
        place_text(row["episode"], row["first_frame"]),
        row["task"] or "untitled",
        f"{row['frames']:,}",
        f"{row['new_nodes']}",
        f"{row['nodes']}",
        f"{row['stored_share']:.1%}",
        NOTHING if novelty is None else f"{novelty:.2f}",
    )


def place_text(episode: int, first_frame: int) -> str:
    """Return an episode's number, with the frame from which a later part of it begins."""
    return f"{episode} from frame {first_frame:,}" if first_frame else f"{episode}"
