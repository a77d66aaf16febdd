"""Scores of several behaviours: imitation, recognition and novelty."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from envs.humanoid import JOINTS
from envs.kinematics import BodyKinematics
from pacnet.evaluation.arrays import finite_array
from train.postural.behaviours.episodes import ONE, SEVERAL, BehaviourEpisode
from train.postural.learning import SCALE
from train.postural.scores import score_episodes

NAMING_SHARE = 0.1  # of an episode, after the parting: time within which to name the behaviour
RECALLED = ("task_success_rate", "wrist_distance_mean_m", "wrist_distance_max_m", "commanded_share")


def score_recall(
    episodes: Sequence[BehaviourEpisode], taught: Sequence[str]
) -> dict[str, dict[str, dict[str, Any]]]:
    """Return system -> taught behaviour -> scores of its imitation."""
    scores: dict[str, dict[str, dict[str, Any]]] = {}
    for system in (SEVERAL, ONE):
        scores[system] = {}
        for behaviour in taught:
            own = [episode for episode in episodes if episode.behaviour == behaviour]
            whole = score_episodes([episode.recalls[system] for episode in own])
            parting = [_wrist_distance_at_parting(episode, system) for episode in own]
            scores[system][behaviour] = {name: whole[name] for name in RECALLED} | {
                "wrist_distance_at_parting_m": float(np.mean(parting)),
                "wrist_distance_at_parting_max_m": float(np.max(parting)),
            }
    return scores


def score_recognition(
    episodes: Sequence[BehaviourEpisode], taught: Sequence[str]
) -> dict[str, float | int]:
    """Return the scores of recognition in episodes of the taught behaviours.

    Args:
        episodes: Of these behaviours.
        taught: The behaviours, in the order of the network.

    Returns:
        The scores, defined in `docs/behaviours.md`.
    """
    rights = [e.recognition.behaviour.numpy() == taught.index(e.behaviour) for e in episodes]
    deadlines = [e.parting + int(NAMING_SHARE * len(e.shown.phases)) for e in episodes]
    named = [right[at:] for right, at in zip(rights, deadlines, strict=True)]
    waits = [_until_right(r[e.parting :]) / len(r) for r, e in zip(rights, episodes, strict=True)]
    progress = np.concatenate([_progress_errors(e) for e in episodes])
    ends = _end_errors(episodes)
    expected, unchanged = np.sqrt(np.mean([_next_errors(e) for e in episodes], axis=0))
    return {
        "episodes": len(episodes),
        "named_within_a_tenth_share": float(np.mean([right[0] for right in named])),
        "named_after_a_tenth_samples_share": float(np.concatenate(named).mean()),
        "named_after_share_of_episode_median": float(np.median(waits)),
        "named_after_share_of_episode_max": float(np.max(waits)),
        "progress_error_mean": float(progress.mean()),
        "progress_error_max": float(progress.max()),
        "end_wrist_error_mean_m": float(ends.mean()),
        "end_wrist_error_max_m": float(ends.max()),
        "next_percept_error_to_persistence": float(expected / unchanged),
    }


def score_novelty(
    known: Sequence[BehaviourEpisode], new: Sequence[BehaviourEpisode]
) -> dict[str, float | int]:
    """Return how well novelty separates episodes of another behaviour from taught ones."""
    novelty = [[e.recognition.novelty.numpy() for e in some] for some in (known, new)]
    means = [[float(each.mean()) for each in some] for some in novelty]
    later = [np.concatenate([_later(e) for e in some]) for some in (known, new)]
    return {
        "episodes_known": len(known),
        "episodes_new": len(new),
        "auroc_per_episode": area_under_roc(*means),
        "auroc_per_frame_after_approach": area_under_roc(*later),
        "false_alarm_share": float(np.concatenate([_alarms(e) for e in known]).mean()),
        "alarm_share_new_after_approach": float(
            np.concatenate([_alarms(e)[e.approached :] for e in new]).mean()
        ),
        "new_commanded_share": float(np.mean([e.shown.commanded.mean() for e in new])),
    }


def area_under_roc(known: ArrayLike, new: ArrayLike) -> float:
    """Return how well a score separates the new from the known, from 0 to 1; 0.5 is chance.

    The probability that the new one of a random pair has the higher score, counting half where both
    are equal: the area under the receiver operating characteristic (Hanley & McNeil 1982).

    Args:
        known: Scores of what is known `[N ≥ 1]`.
        new: Scores of what is new `[M ≥ 1]`.

    Raises:
        ValueError: Scores that are not one or more finite numbers.
    """
    below = np.sort(finite_array("known", known, ("N",)))
    above = finite_array("new", new, ("M",))
    if not (len(below) and len(above)):
        raise ValueError(f"expected one or more scores, got {len(below)} known, {len(above)} new")
    wins = np.searchsorted(below, above, "left") + np.searchsorted(below, above, "right")
    return float(wins.mean() / (2 * len(below)))


def _wrist_distance_at_parting(episode: BehaviourEpisode, system: str) -> float:
    """Return the mean distance [m] of both wrists in the tenth of an episode after the parting."""
    recall = episode.recalls[system]
    apart = np.linalg.norm(recall.demonstrator_wrist - recall.imitator_wrist, axis=1)
    until = episode.parting + int(NAMING_SHARE * len(apart))
    return float(apart[episode.parting : until].mean())


def _later(episode: BehaviourEpisode) -> NDArray[np.float32]:
    return episode.recognition.novelty.numpy()[episode.approached :]


def _alarms(episode: BehaviourEpisode) -> NDArray[np.bool_]:
    return episode.recognition.is_novel.numpy()


def _until_right(right: NDArray[np.bool_]) -> int:
    """Return the samples until the right behaviour is named for the first time."""
    return int(right.argmax()) if right.any() else len(right)


def _progress_errors(episode: BehaviourEpisode) -> NDArray[np.float64]:
    progress = episode.recognition.progress.numpy()
    return np.abs(progress - np.linspace(0, 1, len(progress)))


def _end_errors(episodes: Sequence[BehaviourEpisode]) -> NDArray[np.float64]:
    """Return the errors [m] of the final wrist position expected halfway."""
    body, errors = BodyKinematics(), []
    for episode in episodes:
        halfway = len(episode.shown.phases) // 2
        angles = episode.recognition.end_percept[halfway, : len(JOINTS)].numpy()
        errors.append(body.pose(angles).wrist - episode.shown.demonstrator_wrist[-1])
    return np.linalg.norm(errors, axis=1)


def _next_errors(episode: BehaviourEpisode) -> tuple[float, float]:
    """Return the mean squares of the next percept's error and of its change, scaled."""
    percepts = episode.shown.percepts * np.array(SCALE)
    expected = episode.recognition.next_percept.numpy() * np.array(SCALE)
    return (
        float(np.square(expected[:-1] - percepts[1:]).mean()),
        float(np.square(percepts[:-1] - percepts[1:]).mean()),
    )
