"""Scores of recognized episodes against the tasks that they were recorded as, and their table.

An episode is named by the most probable behaviour at its last frame. The true progress of a frame
is its share of the episode's length, from 0 at the first frame to 1 at the last.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import torch

from pacnet.evaluation.recognized import RecognizedEpisode

_LONGEST_NAME = 30  # letters of a behaviour's name in the table


def score_episode(
    episode: RecognizedEpisode, behaviours: Sequence[str], fps: float
) -> dict[str, Any]:
    """Return the scores of one episode.

    Args:
        episode: To score.
        behaviours: Name of each behaviour that the network knows.
        fps: Frames per second [1/s].

    Returns:
        The named behaviour and its probability at the last frame; the time [s] and the share of the
        episode from which on no other was the most probable; mean novelty; share of novel frames;
        mean absolute error of progress, None for an episode of an unknown task.
    """
    recognition, task = episode.recognition, episode.demonstration.task
    named, stable_from = int(recognition.behaviour[-1]), episode.stable_from
    return {
        "episode": episode.demonstration.episode,
        "task": task,
        "named": behaviours[named],
        "probability": float(recognition.probability[-1, named]),
        "named_from_s": stable_from / fps,
        "named_from_share": stable_from / len(recognition.behaviour),
        "novelty_mean": float(recognition.novelty.mean()),
        "novel_share": float(recognition.is_novel.float().mean()),
        "progress_error_mean": (
            float(_progress_errors(episode).mean()) if task in behaviours else None
        ),
    }


def score_all(episodes: Sequence[RecognizedEpisode], behaviours: Sequence[str]) -> dict[str, Any]:
    """Return the scores of all episodes together; None where there is nothing to score.

    Args:
        episodes: To score.
        behaviours: Name of each behaviour that the network knows.

    Returns:
        The number of episodes, and of those recorded as a behaviour that the network knows; of the
        latter the share named as recorded, the mean absolute error of progress over all frames and
        the share of novel frames (false alarms); the share of novel frames of the others.
    """
    known = [episode for episode in episodes if episode.demonstration.task in behaviours]
    others = [episode for episode in episodes if episode.demonstration.task not in behaviours]
    right = [
        behaviours[int(episode.recognition.behaviour[-1])] == episode.demonstration.task
        for episode in known
    ]
    return {
        "watched": len(episodes),
        "of_known_tasks": len(known),
        "named_as_recorded_share": _mean([torch.tensor(right)]) if known else None,
        "progress_error_mean": _mean([_progress_errors(episode) for episode in known]),
        "novel_share_of_known_tasks": _mean([episode.recognition.is_novel for episode in known]),
        "novel_share_of_other_tasks": _mean([episode.recognition.is_novel for episode in others]),
    }


def print_table(episodes: Sequence[dict[str, Any]], totals: dict[str, Any]) -> None:
    """Print a row of scores for each episode, then the scores of all together."""
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


def _progress_errors(episode: RecognizedEpisode) -> torch.Tensor:
    """Return the absolute error of progress at each frame `[T]`."""
    progress = episode.recognition.progress
    return (progress - torch.linspace(0, 1, len(progress), dtype=progress.dtype)).abs()


def _mean(parts: Sequence[torch.Tensor]) -> float | None:
    """Return the mean over all elements of all parts, None without any."""
    return float(torch.cat([part.double() for part in parts]).mean()) if parts else None
