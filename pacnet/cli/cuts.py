"""How demonstrations were cut, and how well the movement is predicted, in words."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from pacnet.cli.reports import place_text

if TYPE_CHECKING:
    from pacnet.imitator.cuts import ShownCut
    from pacnet.imitator.imitator import Imitator

_MOST_NAMED = 5  # episodes that are listed by number


def describe_cuts(imitator: Imitator) -> dict[str, Any]:
    """Return how demonstrations were cut, for JSON.

    Returns:
        `explained`: share of the moved point's change of place, in frames held out, that is
        predicted from actions and momentum; None without points, with a body, which says where that
        point is, and before anything was learned;
        `cuts`: for each report, its segments, and whether it is followed.
    """
    from pacnet.imitator.cuts import WORLD_NAME

    cuts, frames = imitator.cuts, imitator.frames
    if frames is None or not cuts:
        return {"explained": None, "cuts": []}
    model, dimensions = frames.forward_model, frames.config.points.dimensions
    explained = None if model is None else model.explained_together(dimensions)
    rows = [
        {
            "dataset": report.dataset,
            "episode": report.episode,
            "first_frame": report.first_frame,
            "task": report.task,
            "is_followed": cut.is_usual,
            "reaches_nothing": _landmarks(cut) == {WORLD_NAME},
            "segments": [segment._asdict() for segment in cut.segments],
        }
        for report, cut in zip(imitator.reports, cuts, strict=False)
    ]
    return {"explained": explained, "cuts": rows}


def _landmarks(cut: ShownCut) -> set[str]:
    """Return the landmarks that a demonstration goes to, and in whose frames it is kept."""
    return {name for part in cut.segments for name in (part.landmark, part.reference)}


def cut_pairs(document: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Return in words what `describe_cuts` returned; nothing without points.

    Args:
        document: with `points`, as of `pacnet.cli.points.describe_points`, too.
    """
    if not document["cuts"]:
        return []
    moved, explained = next(iter(document["points"])), document["explained"]
    movement = f"{moved} is where the body has it with the angles perceived"
    if explained is not None:
        movement = (
            f"{explained:.0%} of how {moved} moves is predicted from actions and momentum, in "
            "frames held out"
        )
    texts = list(_texts(document["cuts"]))
    return [("movement", movement), ("segments", texts[0]), *[("", text) for text in texts[1:]]]


def _texts(cuts: Sequence[Mapping[str, Any]]) -> Iterator[str]:
    """Yield a text for each task."""
    tasks = list(dict.fromkeys(" ".join(one["task"].split()) for one in cuts))
    for task in tasks:
        own = [one for one in cuts if " ".join(one["task"].split()) == task]
        name = f"“{task or 'untitled'}”: " if len(tasks) > 1 else ""
        yield name + _text(own, several=len({one["dataset"] for one in cuts}) > 1)


def _text(cuts: Sequence[Mapping[str, Any]], several: bool) -> str:
    """Return what most demonstrations of a task go to, and which ones go elsewhere."""
    ways = [_way(one) for one in cuts]
    (most, count), *others = Counter(ways).most_common()
    noun = "part" if any(one["first_frame"] for one in cuts) else "episode"
    if len(cuts) == 1:
        return most
    share = f"all {count:,}" if not others else f"{count:,} of {len(cuts):,}"
    texts = [f"{most} ({share} {noun}s)"]
    for way, _ in others:
        alike = [one for one, own in zip(cuts, ways, strict=True) if own == way]
        texts.append(f"{_names(alike, several)}: {way}")
    return "; ".join(texts)


def _way(cut: Mapping[str, Any]) -> str:
    """Return where one demonstration goes: object, goal."""
    if cut["reaches_nothing"]:
        way = "no landmark (world)"
    else:
        way = ", ".join(
            segment["landmark"]
            if segment["landmark"] == segment["reference"]
            else f"{segment['landmark']} (kept in the frame of {segment['reference']})"
            for segment in cut["segments"]
        )
    return way if cut["is_followed"] else f"{way} (not followed)"


def _names(cuts: Sequence[Mapping[str, Any]], several: bool) -> str:
    """Return which demonstrations these are: episode 3, or episodes 3, 5."""
    names = [
        place_text(one["episode"], one["first_frame"])
        + (f" of {one['dataset']}" if several else "")
        for one in cuts
    ]
    if len(names) > _MOST_NAMED:
        names = [*names[:_MOST_NAMED], f"{len(names) - _MOST_NAMED:,} more"]
    return f"episode{'s' if len(cuts) > 1 else ''} {', '.join(names)}"
