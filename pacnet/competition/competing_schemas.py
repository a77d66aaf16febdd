"""Several motor schemas per node, one for each different continuation; they compete.

Beyond Maistros, Marom & Hayes (2001), whose footnote considers "hard-wiring more motor schemas to
a perceptual categorisation" and whose retraining overwrites.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from pacnet.attention.records import NO_NODE
from pacnet.competition.config import CompetingSchemasConfig
from pacnet.competition.recall import CompetingRecall
from pacnet.competition.recognition import Recognizer
from pacnet.competition.timeline import Timeline, build_timeline
from pacnet.core.drafts import adopt, draft_of, snapshot_of
from pacnet.core.growable_rows import as_array
from pacnet.core.old_names import old_names
from pacnet.core.validation import as_batch, check_index, is_number
from pacnet.schemas.consolidation import consolidate
from pacnet.schemas.interface import Samples, Schemas, Target, check_episode
from pacnet.schemas.memory import EpisodicMemory
from pacnet.schemas.sequences import compact
from pacnet.schemas.visits import add_samples


@old_names(passes="visits")
class CompetingSchemas(EpisodicMemory, Schemas):
    """Motor schemas of which a node has several.

    Learning: while an episode lasts, each of its visits (`pacnet.schemas.visits`) has a schema of
    its own. When the next episode begins, each is compared with the schemas that its node keeps
    (`pacnet.schemas.consolidation`). If its cues and its continuation are similar to those of one
    of them, it is the same schema seen again: that one gains support, and the new sequence replaces
    the old one if the episode is not worse. Otherwise it is kept as a further schema. If the node
    is full, it replaces one that was also seen only once, if it is not worse, or is dropped.

    Recall: the confidence of a schema is the probability that the present percept belongs to a
    visit to it, given the recall episode so far, times how well the schema fits the percept. The
    most confident schema of the winner gives the target whose cue is nearest. If none of them is
    confident, the winner may be a node of another behaviour; then all schemas compete that have a
    cue to which the percept is not novel. If none of these is confident, nothing is recalled.

    Args:
        config: see `CompetingSchemasConfig`.
    """

    config: CompetingSchemasConfig  # pyright: ignore[reportIncompatibleVariableOverride]

    def __init__(self, config: CompetingSchemasConfig) -> None:
        super().__init__(config)
        self.register_load_state_dict_post_hook(_restart_recall)
        self._forget_recall()

    def reset(self) -> None:
        """Start a new recall episode; what was learned stays."""
        if self._recall is not None:
            self._recall.reset()

    def _forget_recall(self) -> None:
        """Drop what was derived from the memory, which has changed."""
        self._timeline: Timeline | None = None
        self._recall: CompetingRecall | None = None

    def _apply(self, fn: Callable[[Tensor], Tensor], recurse: bool = True) -> CompetingSchemas:
        super()._apply(fn, recurse)
        self._forget_recall()  # the timeline does not move to another device with the buffers
        return self

    def delete(self, nodes: Tensor) -> None:
        """See `Schemas.delete`; a recall episode in progress starts again."""
        super().delete(nodes)
        self._forget_recall()

    @torch.no_grad()
    def begin(self, number: int, behaviour: str) -> None:
        """Begin a learning episode, and consolidate the last one.

        Args:
            number: of the episode, ≥ 0; the last one's number continues that episode.
            behaviour: what is shown, in words.

        Raises:
            ValueError: not an int or before the last one's, a behaviour that is not a str, or
                another one than that of the episode that continues; nothing has changed.
        """
        last = int(self.episodes.live("number")[-1]) if len(self.episodes) else 0
        number = check_episode(number, behaviour, last)
        if not self.training:
            return
        draft = draft_of(self)
        draft.check()
        draft.begin_episode(number, behaviour)
        adopt(self, draft)

    def begin_episode(self, number: int, behaviour: str) -> None:
        """See `Schemas.begin_episode`.

        Raises:
            ValueError: the episode continues, but with another behaviour.
        """
        if len(self.episodes) > 0 and int(self.episodes.live("number")[-1]) == number:
            shown = self.behaviours[int(self.episodes.live("behaviour")[-1])]
            if shown != behaviour:
                raise ValueError(
                    f"expected episode {number} to go on with {shown!r}, got {behaviour!r}"
                )
            return
        consolidate(self)
        if behaviour not in self.behaviours:
            self.behaviours = [*self.behaviours, behaviour]
        kind = self.behaviours.index(behaviour)
        row = {"number": number, "behaviour": kind, "samples": 0, "last_cue": 0.0}
        self.episodes.append(row)
        self._forget_recall()

    @torch.no_grad()
    def write(
        self, node: int, target: Tensor, cue: Tensor, *, activation: float, habituated: bool
    ) -> None:
        """Learn one sample of the episode that was begun last.

        Args:
            node: the winner.
            target: the current target, `[A]`.
            cue: the normalized percept, `[D]`.
            activation: of the winner by the percept.
            habituated: whether the winner is fully habituated; if not, it keeps nothing.

        Raises:
            ValueError: no episode was begun, no such node, no such activation, or a target or cue
                of the wrong shape, dtype or device, or not finite; nothing has been written then.
        """
        if not self.training:
            return
        if len(self.episodes) == 0:
            raise ValueError("expected begin before write, no episode was begun")
        node = check_index("a node", node, len(self))
        if not (is_number(activation) and 0 <= activation <= 1):
            raise ValueError(f"expected an activation from 0 to 1, got {activation!r}")
        self.check_pair(as_batch(target), as_batch(cue))
        sample = Samples(
            node=torch.tensor([node], device=cue.device),
            activation=cue.new_tensor([activation]),
            habituated=torch.tensor([bool(habituated)], device=cue.device),
            habituated_at=torch.tensor([NO_NODE], device=cue.device),
            target=target[None],
            cue=cue[None],
        )
        self.add_samples(sample, int(self.episodes.live("number")[-1]))

    @torch.no_grad()
    def add_samples(self, samples: Samples, episode: int) -> None:  # noqa: ARG002
        """See `Schemas.add_samples`; the episode is the one that was begun last."""
        if self.training:
            self._forget_recall()
            add_samples(self, samples)

    def timeline(self) -> Timeline | None:
        """Return the timeline of the known episodes; None without episodes."""
        if self._timeline is None and len(self.visits) > 0:
            self.check()
            compact(self)  # saving compacts, after which the timeline would refer to other rows
            self._timeline = build_timeline(self, self.config.recognition.n_states)
        return self._timeline

    def new_recall(self) -> CompetingRecall | None:
        """Return a recall episode of its own; None without schemas."""
        timeline = self.timeline()
        if timeline is None:
            return None
        memory = snapshot_of(self)
        memory._recall = None  # otherwise each recall episode would keep the one before
        return CompetingRecall(memory, memory.config, timeline)

    def for_recall(self) -> CompetingSchemas:
        """See `Schemas.for_recall`; a new recall episode begins, for both modules."""
        schemas = snapshot_of(self)
        schemas._recall = self._recall = self.new_recall()
        schemas._timeline = self._timeline
        return schemas

    def recall_one(self, node: int, percept: NDArray[np.floating]) -> Target | None:
        """Return the current target of the most confident schema.

        Call it at each sample of a recall episode, in order of time; `reset` starts a new one.
        """
        if self._recall is None:
            self._recall = self.new_recall()
        return None if self._recall is None else self._recall.recall(node, percept)

    def recognizer(self) -> Recognizer:
        """Return a recognizer of an episode that begins with the next percept.

        Raises:
            ValueError: no schemas yet.
        """
        timeline = self.timeline()
        if timeline is None:
            raise ValueError(
                "expected a network that has learned schemas, got one without any: no node has "
                "habituated and kept targets; show it more, or look at SOFMConfig.scale"
            )
        self.check()
        known = torch.from_numpy(timeline.episode)
        return Recognizer(
            timeline,
            self.arrays("cue"),
            self.episodes.live("behaviour").cpu()[known].numpy(),
            len(self.behaviours),
            as_array(self.episodes.live("last_cue").cpu()[known]),
            self.config.recognition,
        )


def _restart_recall(schemas: nn.Module, _incompatible_keys: object) -> None:
    assert isinstance(schemas, CompetingSchemas)
    schemas._forget_recall()
