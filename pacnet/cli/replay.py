"""Run an imitator over recorded episodes: recognition, novelty, and where it would act."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import NamedTuple

import torch
from torch import Tensor

from pacnet.cli.cameras import short_name
from pacnet.cli.printing import progress_bar
from pacnet.datasets.demonstrations import Demonstration, Demonstrations
from pacnet.evaluation.recognized import RecognizedEpisode
from pacnet.imitator.imitator import Imitator
from pacnet.imitator.records import ImitatorStep
from pacnet.kernels.threads import use_one_thread
from pacnet.vision.cameras import Cameras
from pacnet.vision.config import PATCHES

_BLOCK = 50  # frames between two updates of the progress bar


class Reason(NamedTuple):
    """Why an imitator acts at a percept or holds."""

    short: str
    """A few words, the same for all frames of one kind."""
    sentence: str
    """With the names and numbers of this frame."""


@dataclass(frozen=True, eq=False)
class ReplayedEpisode:
    """The result of an imitator's run over an episode of T frames.

    Attributes:
        recognized: the episode and its recognition, with the novelty of the imitator's steps.
        dimension: for each frame, the name of the dimension with the largest novelty.
        acts: whether it would have acted, bool `[T]`.
        reasons: for each frame, why it would have acted or held.
        progress: share of what it follows that is over after the last frame, from 0 to 1.
    """

    recognized: RecognizedEpisode
    dimension: tuple[str, ...]
    acts: Tensor
    reasons: tuple[str, ...]
    progress: float

    @property
    def holds_because(self) -> str | None:
        """The commonest reason for not acting; None if it always acts."""
        reasons = (why for why, acts in zip(self.reasons, self.acts, strict=True) if not acts)
        ((reason, _),) = Counter(reasons).most_common(1) or ((None, 0),)
        return reason


def replay(
    imitator: Imitator, demonstrations: Demonstrations, task: str | None = None
) -> Iterator[ReplayedEpisode]:
    """Run over one episode after the other, each from its start, with a progress bar.

    Args:
        imitator: it begins recall episodes.
        demonstrations: of the imitator's features.
        task: as of `Imitator.reset`; what is recognised may be any.
    """
    use_one_thread()
    seen = imitator.seen(demonstrations)
    frames = sum(len(shown.state) for shown in demonstrations)
    with progress_bar("watching", frames) as advance:
        for shown, own in zip(demonstrations, seen, strict=True):
            yield _replay_one(imitator, shown, own.percepts, task, advance)


def _replay_one(
    imitator: Imitator,
    shown: Demonstration,
    percepts: Tensor,
    task: str | None,
    advance: Callable[[int], object],
) -> ReplayedEpisode:
    imitator.reset(task)
    recognition = imitator.recognise(percepts)
    steps: list[ImitatorStep] = []
    for step in imitator.follow(shown):
        steps.append(step)
        if len(steps) % _BLOCK == 0 or len(steps) == len(shown.state):
            advance(len(steps) % _BLOCK or _BLOCK)
    recognition = recognition._replace(  # the steps know only what was shown for the task
        novelty=torch.tensor([step.novelty for step in steps]),
        is_novel=torch.tensor([step.is_novel for step in steps]),
    )
    return ReplayedEpisode(
        RecognizedEpisode(shown, recognition),
        tuple(step.dimension for step in steps),
        torch.tensor([step.action is not None for step in steps]),
        tuple(reason_of(step, imitator.cameras).short for step in steps),
        steps[-1].progress,
    )


def reason_of(step: ImitatorStep, cameras: Cameras | None = None) -> Reason:
    """Return why there is an action, or none.

    Args:
        step: of an imitator.
        cameras: of that imitator; None for none.
    """
    encoders = {} if cameras is None else cameras.encoders
    if step.is_novel and step.dimension in encoders:
        camera = short_name(step.dimension)
        if encoders[step.dimension].config.kind == PATCHES:
            return Reason("not found", f"{camera}: what is attended to is not found")
        return Reason("novel picture", f"{camera}: the picture is unlike those that were shown")
    if not step.followed:
        return Reason("nothing to follow", "no demonstration is kept that could be followed")
    if step.is_novel:
        return Reason("novel percept", f"the percept is novel in {step.dimension}")
    if step.action is None:
        sentence = "the forward model finds no action that leads to the target"
        return Reason("no action found", sentence)
    return Reason("known", "the percept is known")
