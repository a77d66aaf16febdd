"""What an imitator makes of recorded episodes that it watches."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import torch
from torch import Tensor

from pacnet.cli.progress import frames_of, progress_bar
from pacnet.cli.reasons import reason_of
from pacnet.competition.recognition import Recognition
from pacnet.datasets.demonstrations import Demonstration, Demonstrations
from pacnet.evaluation.recognized import RecognizedEpisode, concatenate
from pacnet.imitator.imitator import Imitator, ImitatorStep
from pacnet.kernels.threads import use_one_thread

NOVEL_ABOVE = 1.0  # novelty of an imitator, over what is tolerated
_AT_ONCE = 50  # frames between two steps of the progress bar


@dataclass(frozen=True, eq=False)
class Seen:
    """An episode as an imitator saw it; T frames.

    Attributes:
        watched: what was recognised; its novelty is the imitator's, over what is tolerated.
        dimension: name of the dimension in which each frame departs most from what is known.
        acts: whether it would have acted, bool `[T]`.
        reasons: why it would have acted or held, in a few words.
    """

    watched: RecognizedEpisode
    dimension: tuple[str, ...]
    acts: Tensor
    reasons: tuple[str, ...]

    @property
    def holds_for(self) -> str | None:
        """The commonest reason to hold; None if it always acts."""
        reasons = (why for why, acts in zip(self.reasons, self.acts, strict=True) if not acts)
        ((reason, _),) = Counter(reasons).most_common(1) or ((None, 0),)
        return reason


def see(imitator: Imitator, demonstrations: Demonstrations) -> Iterator[Seen]:
    """Watches one episode after the other, each from its start, with a progress bar."""
    use_one_thread()
    with progress_bar("watching", frames_of(demonstrations)) as advance:
        for shown in demonstrations:
            yield _see_one(imitator, shown, advance)


def _see_one(imitator: Imitator, shown: Demonstration, advance: Callable[[int], None]) -> Seen:
    imitator.reset()
    parts: list[Recognition] = []
    steps: list[ImitatorStep] = []
    for percepts in shown.percepts.split(_AT_ONCE):
        parts.append(imitator.network.recognise(percepts))
        steps += map(imitator.step, percepts.numpy())
        advance(len(percepts))
    recognition = concatenate(parts)._replace(
        novelty=torch.tensor([step.novelty for step in steps]),
        is_novel=torch.tensor([step.is_novel for step in steps]),
    )
    return Seen(
        RecognizedEpisode(shown, recognition),
        tuple(step.dimension for step in steps),
        torch.tensor([step.action is not None for step in steps]),
        tuple(reason_of(step).short for step in steps),
    )
