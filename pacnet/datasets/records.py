"""Demonstrations: the episodes of a dataset as tensors, with their names, rate and gaps."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

ACTION = "action"


@dataclass(frozen=True, eq=False)
class Demonstration:
    """One episode in which a task is demonstrated, or a part of it.

    Attributes:
        episode: index of the episode in its dataset.
        task: the task in words; where it changes within the episode, that of the first frame.
        state: measured state of the demonstrator, `[T, S]`; S is 0 without it.
        environment_state: measured state of the surroundings, `[T, E]`; E is 0 without it.
        action: the demonstrator's actions or the targets aimed at, `[T, A]`.
        encoded: what encoders make of its pictures, `[T, F]`; None without encoders.
        first_frame: the frame of the episode with which it begins, from 0.
        gaps: its frames, counted from 0, before which time is missing; see `continuous`.
        pictures: camera, as its feature is called -> red, green and blue of its frames,
            `[T, H, W, 3]`, with the longer side reduced to 128 pixels; possibly a read-only map of
            a file. A camera that the episode lacks is missing.
    """

    episode: int
    task: str
    state: Tensor  # [T, S] float32
    environment_state: Tensor  # [T, E] float32
    action: Tensor  # [T, A] float32
    encoded: Tensor | None = None  # [T, F] float32
    first_frame: int = 0
    gaps: tuple[int, ...] = ()
    pictures: Mapping[str, NDArray[np.uint8]] = field(default_factory=dict)

    @property
    def percepts(self) -> Tensor:
        """State, environment state and encoded pictures side by side, [T, S + E + F]."""
        parts = [self.state, self.environment_state]
        return torch.cat(parts if self.encoded is None else [*parts, self.encoded], dim=1)

    def continuous(self) -> tuple[Demonstration, ...]:
        """Return its parts between the gaps; itself if there are none."""
        if not self.gaps:
            return (self,)
        bounds = (0, *self.gaps, len(self.state))
        return tuple(self.part(first, end) for first, end in pairwise(bounds))

    def part(self, first: int, end: int) -> Demonstration:
        """Return the frames from `first` to before `end`, counted from 0."""
        return replace(
            self,
            state=self.state[first:end],
            environment_state=self.environment_state[first:end],
            action=self.action[first:end],
            encoded=None if self.encoded is None else self.encoded[first:end],
            first_frame=self.first_frame + first,
            gaps=tuple(gap - first for gap in self.gaps if first < gap < end),
            pictures={camera: frames[first:end] for camera, frames in self.pictures.items()},
        )


@dataclass(frozen=True, eq=False)
class Demonstrations:
    """The episodes of a dataset, in the order in which they were recorded.

    Attributes:
        fps: frames per second [1/s].
        names: feature name -> names of its dimensions, in the order of the percepts.
        episodes: the demonstrations.
        source: name of the dataset.
        action: the feature that is the action, or several in their order; all others belong to the
            percept.
        state: the features that are the robot's state, with which a percept begins; None for the
            percept's first feature, () for none.
    """

    fps: float
    names: Mapping[str, tuple[str, ...]]
    episodes: tuple[Demonstration, ...]
    source: str = "demonstrations"
    action: str | tuple[str, ...] = ACTION
    state: tuple[str, ...] | None = None

    @property
    def action_features(self) -> tuple[str, ...]:
        """The features that are the action."""
        return (self.action,) if isinstance(self.action, str) else self.action

    @property
    def state_features(self) -> tuple[str, ...]:
        """The features that are the robot's state."""
        return tuple(self.percept_features)[:1] if self.state is None else self.state

    @property
    def percept_features(self) -> dict[str, tuple[str, ...]]:
        """Names of each feature of a percept and of its dimensions, in the percept's order."""
        return {
            name: parts for name, parts in self.names.items() if name not in self.action_features
        }

    @property
    def action_names(self) -> tuple[str, ...]:
        """Names of an action's dimensions."""
        return dimension_names({name: self.names[name] for name in self.action_features})

    def continuous(self) -> Demonstrations:
        """Return them with every episode cut at its gaps, so that nothing is learned across one."""
        parts = tuple(part for shown in self.episodes for part in shown.continuous())
        return replace(self, episodes=parts)

    def __iter__(self) -> Iterator[Demonstration]:
        """Iterate over the demonstrations."""
        return iter(self.episodes)

    def __len__(self) -> int:
        """Return the number of demonstrations."""
        return len(self.episodes)


def dimension_names(features: Mapping[str, tuple[str, ...]]) -> tuple[str, ...]:
    """Return the names of all dimensions, with the feature's name in front if two are the same."""
    pairs = [(feature, name) for feature, names in features.items() for name in names]
    names = tuple(name for _, name in pairs)
    if len(set(names)) < len(names):
        return tuple(f"{feature}.{name}" for feature, name in pairs)
    return names
