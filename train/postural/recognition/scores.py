"""Scores of recognised episodes against the tasks that they were recorded as, and their table.

Behaviour: the one named is the most probable at the episode's last frame. Progress: a frame's true
progress is its share of the episode's length, from 0 at the first frame to 1 at the last.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import torch

from pacnet.evaluation.recognised import Watched

_LONGEST_NAME = 30  # letters of a behaviour's name in the table


def score_episode(watched: Watched, behaviours: Sequence[str], fps: float) -> dict[str, Any]:
    """The scores of one episode.

    Args:
        watched: the episode.
        behaviours: name of each behaviour that the network knows.
        fps: frames per second [1/s].

    Returns:
        The behaviour named and its probability at the last frame; the time [s] and the share of the
        episode from which on no other was the most probable; mean novelty; share of novel frames;
        mean absolute error of progress, None for an episode of another task.
    """
    recognition, task = watched.recognition, watched.demonstration.task
    named, for_good = int(recognition.behaviour[-1]), watched.named_since
    known = watched.known_as(behaviours)
    return {
        "episode": watched.demonstration.episode,
        "task": task,
        "named": behaviours[named],
        "probability": float(recognition.probability[-1, named]),
        "named_from_s": for_good / fps,
        "named_from_share": for_good / len(recognition.behaviour),
        "novelty_mean": float(recognition.novelty.mean()),
        "novel_share": float(recognition.is_novel.float().mean()),
        "progress_error_mean": float(_progress_errors(watched).mean()) if known else None,
    }


def score_all(watched: Sequence[Watched], behaviours: Sequence[str]) -> dict[str, Any]:
    """The scores of all episodes together; None where there is nothing to score.

    Args:
        watched: the episodes.
        behaviours: name of each behaviour that the network knows.

    Returns:
        The number of episodes, and of those recorded as a behaviour that the network knows; of the
        latter the share named as recorded, the mean absolute error of progress over all frames and
        the share of novel frames (false alarms); the share of novel frames of the others.
    """
    known = [one for one in watched if one.known_as(behaviours)]
    others = [one for one in watched if not one.known_as(behaviours)]
    right = [
        behaviours[int(one.recognition.behaviour[-1])] == one.demonstration.task for one in known
    ]
    return {
        "watched": len(watched),
        "of_known_tasks": len(known),
        "named_as_recorded_share": _mean([torch.tensor(right)]) if known else None,
        "progress_error_mean": _mean([_progress_errors(one) for one in known]),
        "novel_share_of_known_tasks": _mean([one.recognition.is_novel for one in known]),
        "novel_share_of_other_tasks": _mean([one.recognition.is_novel for one in others]),
    }


def print_table(episodes: Sequence[dict[str, Any]], totals: dict[str, Any]) -> None:
    """The scores, a row an episode, then of all together."""
    longest = max(len(row[name]) for row in episodes for name in ("task", "named"))
    width = min(max(longest, len("recorded as")), _LONGEST_NAME)
    print(
        f"\n{'episode':>7}  {'recorded as':<{width}}  {'named':<{width}}  {'at the end':>10}"
        f"  {'for good from':>15}  {'novelty':>7}  {'novel frames':>12}"
    )
    for row in episodes:
        task, named = (row[name][:width] or "(untitled)" for name in ("task", "named"))
        since = f"{row['named_from_s']:.2f} s ({row['named_from_share']:.0%})"
        print(
            f"{row['episode']:>7}  {task:<{width}}  {named:<{width}}  {row['probability']:>10.1%}"
            f"  {since:>15}  {row['novelty_mean']:>7.3f}  {row['novel_share']:>12.1%}"
        )
    print()
    for name, value in totals.items():
        shown = "no such episode" if value is None else f"{value:.4g}"
        print(f"{name:<28}{shown:>16}")


def _progress_errors(watched: Watched) -> torch.Tensor:
    """Absolute error of progress at each frame [T]."""
    progress = watched.recognition.progress
    return (progress - torch.linspace(0, 1, len(progress), dtype=progress.dtype)).abs()


def _mean(parts: Sequence[torch.Tensor]) -> float | None:
    """Mean over all elements of all parts, None without any."""
    return float(torch.cat([part.double() for part in parts]).mean()) if parts else None
