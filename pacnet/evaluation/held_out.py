"""How near an imitator's actions are to those of episodes that it has not learned."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import chain
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray

from pacnet.core.validation import is_integer
from pacnet.datasets.demonstrations import Demonstration, Demonstrations
from pacnet.evaluation.neighbours import NearestNeighbours, RepeatLast
from pacnet.imitator.imitator import Imitator
from pacnet.imitator.records import task_name

HISTORY_S = 0.3  # [s]
Baselines = Mapping[str, Callable[[], NearestNeighbours | RepeatLast]]
BASELINES: Baselines = {
    "1-NN": lambda: NearestNeighbours(1),
    "5-NN": lambda: NearestNeighbours(5),
    "5-NN with history": lambda: NearestNeighbours(5, HISTORY_S),
    "repeating the last action": RepeatLast,
}
"""Name -> what an imitator is compared with."""
WITH_PICTURE = "1-NN with the first picture"
"""What it is compared with beside these where all episodes have pictures."""

_IMITATOR = "imitator"
_LEAST_DEVIATION = 1e-4  # of an action's dimension; below it nothing is compared


class Split(NamedTuple):
    """What is learned, and what is held out."""

    training: Demonstrations
    held_out: Demonstrations
    scale: Demonstrations | None = None
    """In standard deviations of whose actions errors are measured; None for the training data."""


class HeldOutScores(NamedTuple):
    """What an imitator does at the frames held out, and how near it is to what was shown.

    An error is the root mean square of (action − action shown) / standard deviation of the actions
    in `Split.scale`, over all dimensions that move there; NaN where none does.
    """

    episodes: int
    """Number of episodes held out."""
    frames: int
    """Number of their frames."""
    acted: float
    """Share of the frames with an action."""
    novel: float
    """Share of the frames whose percepts are novel."""
    error: float
    """Of the imitator; where it holds, its last action counts, and before it `first_action`."""
    baselines: dict[str, float]
    """Name, as in `BASELINES`, and `WITH_PICTURE` -> its error."""


class ActedEpisode(NamedTuple):
    """What an imitator does at each of T frames."""

    sent: NDArray[np.float32]
    """The action, the last one where it holds `[T, U]`."""
    acted: NDArray[np.bool_]
    """Whether it acts `[T]`."""
    novel: NDArray[np.bool_]
    """Whether the percept is novel `[T]`."""


def splits(demonstrations: Demonstrations, every: int = 5, most: int = 10) -> list[Split]:
    """Return what to learn and what to hold out.

    The last of each `every` episodes is held out, `most` of them at most; the rest is learned.
    Where there are fewer than two of these, each episode is held out in turn, and all others are
    learned. Parts of one episode stay together.

    Raises:
        ValueError: fewer than two episodes, `every` under 2 or `most` under 1.
    """
    if not is_integer(every, 2) or not is_integer(most, 1):
        raise ValueError(f"expected every ≥ 2 and most ≥ 1 as integers, got {every!r}, {most!r}")
    episodes = _whole_episodes(demonstrations)
    count = len(episodes)
    if count < 2:
        raise ValueError(
            f"expected at least 2 episodes, one to learn and one to hold out, got {count}"
        )
    if count < 2 * every:
        return [_split(demonstrations, episodes, {number}) for number in range(count)]
    held_out = range(every - 1, count, every)[:most]
    return [_split(demonstrations, episodes, {*held_out})]


def learned(training: Demonstrations) -> Imitator:
    """Return an imitator that has learned the demonstrations."""
    imitator = Imitator.from_demonstrations(training)
    imitator.learn(training)
    return imitator


def score(
    parted: Sequence[Split],
    learn: Callable[[Demonstrations], Imitator] = learned,
    progress: Callable[[int], object] | None = None,
) -> HeldOutScores:
    """Compare imitators with what anybody could write, on all that is held out.

    Each continuous part of an episode is followed from its own beginning.

    Args:
        parted: what to learn, and what to hold out of it.
        learn: makes the imitator of a split's training data.
        progress: called after each continuous part with the number of its frames.

    Raises:
        ValueError: nothing is held out.
    """
    if not any(len(shown.action) for split in parted for shown in split.held_out):
        raise ValueError("expected splits with frames that are held out, got none")
    baselines = _baselines(parted)
    compared = [one for split in parted for one in _compare(split, learn, baselines, progress)]
    acted = np.concatenate([one.followed.acted for one in compared])
    novel = np.concatenate([one.followed.novel for one in compared])
    errors = {
        name: _root_mean([one.squares[name] for one in compared]) for name in compared[0].squares
    }
    return HeldOutScores(
        sum(len(_whole_episodes(split.held_out)) for split in parted),
        len(acted),
        float(acted.mean()),
        float(novel.mean()),
        errors.pop(_IMITATOR),
        errors,
    )


def follow(imitator: Imitator, shown: Demonstration) -> ActedEpisode:
    """Return what an imitator does at the percepts of an episode, from its beginning.

    Args:
        imitator: begins a recall episode.
        shown: as it was recorded, with pictures if the imitator has cameras; what these tell comes
            from the pictures, not from the episode.
    """
    begin(imitator, shown.task)
    sent = np.empty(shown.action.shape, np.float32)
    acted, novel = np.empty((2, len(sent)), np.bool_)
    last = imitator.first_action.numpy()
    for frame, step in enumerate(imitator.follow(shown)):
        sent[frame] = last if step.action is None else step.action
        last, acted[frame], novel[frame] = sent[frame], step.action is not None, step.is_novel
    return ActedEpisode(sent, acted, novel)


def begin(imitator: Imitator, task: str) -> None:
    """Start a new recall episode of a task; of any, if this one was not shown."""
    imitator.reset(task if task_name(task) in imitator.tasks else None)


class _Compared(NamedTuple):
    """A continuous part of an episode, with squared errors over all its frames and dimensions."""

    followed: ActedEpisode
    squares: dict[str, NDArray[np.float64]]  # name -> [N]


def _baselines(parted: Sequence[Split]) -> Baselines:
    """Return what an imitator is compared with, also one that sees where it can."""
    shown = [one for split in parted for data in (split.training, split.held_out) for one in data]
    first, *others = [one.pictures for one in shown]
    cameras = [name for name in first if all(name in one for one in others)]
    seeing = {WITH_PICTURE: lambda: NearestNeighbours(1, cameras=cameras)}
    return {**BASELINES, **seeing} if cameras else BASELINES


def _compare(
    split: Split,
    learn: Callable[[Demonstrations], Imitator],
    baselines: Baselines,
    progress: Callable[[int], object] | None,
) -> Iterator[_Compared]:
    """Learn, then yield each continuous part of what is held out."""
    imitator = learn(split.training)
    others = {name: make().fit(split.training) for name, make in baselines.items()}
    known = [shown.action for shown in split.scale or split.training]
    deviations = torch.cat(known).double().numpy().std(axis=0)
    moves = deviations >= _LEAST_DEVIATION
    for shown in split.held_out.continuous():
        followed = follow(imitator, shown)
        actions = {_IMITATOR: followed.sent}
        actions |= {name: other.predict(shown) for name, other in others.items()}
        wanted = shown.action.double().numpy()
        yield _Compared(
            followed,
            {
                name: np.square((got - wanted)[:, moves] / deviations[moves]).ravel()
                for name, got in actions.items()
            },
        )
        if progress is not None:
            progress(len(wanted))


def _root_mean(squares: Sequence[NDArray[np.float64]]) -> float:
    """Return the root of the mean of all squares; NaN if there are none."""
    every = np.concatenate(squares)
    return math.sqrt(every.mean()) if len(every) else math.nan


def _split(
    demonstrations: Demonstrations, episodes: Sequence[Sequence[Demonstration]], out: set[int]
) -> Split:
    """Return the split that holds these episodes out."""
    training = [episode for number, episode in enumerate(episodes) if number not in out]
    held_out = [episodes[number] for number in sorted(out)]
    return Split(
        replace(demonstrations, episodes=tuple(chain.from_iterable(training))),
        replace(demonstrations, episodes=tuple(chain.from_iterable(held_out))),
    )


def _whole_episodes(demonstrations: Demonstrations) -> list[list[Demonstration]]:
    """Return the demonstrations of each episode, several where parts of it are left out."""
    episodes: list[list[Demonstration]] = []
    for shown in demonstrations:
        before = episodes[-1][-1] if episodes else None
        continues = (
            before is not None
            and shown.episode == before.episode
            and shown.first_frame > before.first_frame
        )
        if continues:
            episodes[-1].append(shown)
        else:
            episodes.append([shown])
    return episodes
