"""Several motor schemas per node: different continuations are kept apart, and compete.

Beyond Maistros, Marom & Hayes (2001), whose footnote considers "hard-wiring more motor schemas to
a perceptual categorisation" and whose retraining overwrites. Here an episode is remembered as the
schemas it passed through, one after the other; a schema that several episodes share is stored once.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from pacnet.competition.belief import Timeline
from pacnet.competition.config import CompetingSchemasConfig
from pacnet.competition.explanation import Origin, Rival, origins_of
from pacnet.competition.recall import CompetingRecall
from pacnet.competition.timeline import lay_out
from pacnet.competition.winner_take_all import Competition, CompetitionConfig
from pacnet.core.drafts import adopt, draft_of, frozen
from pacnet.core.growable_rows import Column, GrowableRows, check_storage, copy_on_state_dict
from pacnet.core.integrity import check_forms, check_holds, check_on_load, within
from pacnet.core.validation import (
    batch_of_one,
    check_bounded,
    check_number,
    check_numbers,
    is_integer,
    is_number,
)
from pacnet.schemas.consolidation import settle
from pacnet.schemas.sequences import (
    NUMBER,
    RecalledRow,
    Samples,
    Sequences,
    as_array,
    compact,
)
from pacnet.schemas.state_checks import OPEN, episodes_hold, sequences_hold
from pacnet.schemas.visits import take_in


class CompetingSchemas(Sequences):
    """Motor schemas of which a node has several.

    A pass is a stretch of an episode at one habituated node. While the episode lasts, each pass has
    a schema of its own. When the next episode begins, each is compared with the schemas that its
    node keeps. One that is alike, in its cues and in what came after, is the same schema seen
    again: it gains support, and if the episode is not worse than what is known, the new sequence
    takes the old one's place (`pacnet.schemas.consolidation`). One that is unlike all is kept
    beside them; where a node is full, it takes the place of one that was also seen but once, if it
    is not worse than that, or is dropped. Until the next episode begins, and so in a network that
    learns no further, the last one's schemas stand beside the others as they are.

    At recall every schema of the winner has a confidence: the probability that what is watched is a
    pass through it, given all that was seen in this recall episode, times how well it fits the
    percept. The most confident gives the target whose cue is nearest. Where none is confident at
    all, the winner matches but does not belong to what is watched: a node that came with one
    behaviour may be nearest to a percept of another. Then all schemas compete that have a cue to
    which the percept is not novel; where none of these is confident either, nothing is recalled.

    Args:
        config: see `CompetingSchemasConfig`.
    """

    nodes: Tensor

    def __init__(self, config: CompetingSchemasConfig) -> None:
        cue = Column((config.percept_dimensions,), torch.float32)
        number = Column((), torch.float32)
        super().__init__(
            config.target_dimensions,
            config.percept_dimensions,
            of_sequence={
                "node": NUMBER,
                "shown_in": NUMBER,  # which of the episodes its sequence is from
                "support": NUMBER,  # passes that it stands for
                "typical_length": number,  # geometric mean of theirs
                "fit": number,  # mean activation of the node by its cues
                "continuation": cue,  # what came after
            },
            of_row={"frame": NUMBER},  # sample of its episode
        )
        self.config = config
        self.episodes = GrowableRows(
            {"number": NUMBER, "behaviour": NUMBER, "samples": NUMBER, "last_cue": cue}
        )
        self.passes = GrowableRows(
            {"episode": NUMBER, "schema": NUMBER, "first": NUMBER, "last": NUMBER}
        )
        self.competition = Competition(CompetitionConfig(config.threshold, config.margin))
        self.behaviours: list[str] = []  # names, in the order in which they were first shown
        self.register_buffer("nodes", torch.tensor(0))
        self.register_load_state_dict_post_hook(_start_afresh)
        copy_on_state_dict(self)
        check_on_load(self)
        self._changed()

    def __len__(self) -> int:
        """The number of nodes."""
        return int(check_storage("nodes", self.nodes))

    def extra_repr(self) -> str:
        """Return how much is stored, for `print`."""
        stored = f"schemas={len(self.blocks)}, episodes={len(self.episodes)}"
        return f"{super().extra_repr()}, {stored}, behaviours={self.behaviours}"

    def get_extra_state(self) -> Tensor:
        """The behaviours' names, as the bytes of a JSON list, uint8."""
        names = list(json.dumps(self.behaviours).encode())
        return torch.tensor(names, dtype=torch.uint8, device=self.nodes.device)

    def set_extra_state(self, state: Tensor) -> None:
        """Takes the behaviours' names from `get_extra_state`.

        Raises:
            ValueError: it is no list of different names.
        """
        self.behaviours = _names(state)

    def check_state(self, tensors: Mapping[str, Tensor]) -> None:
        """Raises a ValueError unless these tensors, of a `state_dict`, are the state of schemas."""
        check_forms(self, tensors)
        check_holds({"a number of nodes ≥ 0": tensors["nodes"] >= 0, **sequences_hold(tensors)})
        check_holds(episodes_hold(len(_names(tensors["_extra_state"])), tensors))

    def reset(self) -> None:
        """Starts a recall episode: what was seen in the last one is forgotten."""
        if self._recall is not None:
            self._recall.reset()

    def _changed(self) -> None:
        """After a change of what is remembered: a recall in progress starts afresh."""
        self._timeline: Timeline | None = None
        self._recall: CompetingRecall | None = None

    def _apply(self, fn: Callable[[Tensor], Tensor], recurse: bool = True) -> CompetingSchemas:
        super()._apply(fn, recurse)
        self._changed()  # the timeline does not move to another device with the buffers
        return self

    def schemas_of(self, node: int) -> Tensor:
        """Numbers of the node's schemas, int64 `[K]`.

        Raises:
            ValueError: no such node.
        """
        node = check_number("a node", node, len(self))
        return (self.blocks.live("node") == node).nonzero().flatten()

    def add_node(self) -> int:
        """Adds a node without schemas and returns its number."""
        self.nodes += 1
        return len(self) - 1

    def delete(self, nodes: Tensor) -> None:
        """Deletes nodes, int64 `[K]` ascending, with their schemas; the later ones move down.

        Raises:
            ValueError: not ascending, or no such nodes.
        """
        check_numbers("nodes", nodes, len(self))
        self.check()
        of_node = self.blocks.live("node")
        self.drop(torch.isin(of_node, nodes).nonzero().flatten())
        of_node = self.blocks.live("node")
        of_node -= torch.searchsorted(nodes, of_node)
        self.nodes -= len(nodes)
        self._changed()

    def share_recall(self, other: CompetingSchemas) -> None:
        """Begins a recall episode, which is also that of another one with the same tensors."""
        self._recall = other._recall = other.new_recall()
        self._timeline = other._timeline

    @torch.no_grad()
    def begin(self, number: int, behaviour: str) -> None:
        """Begins a learning episode; the last one's schemas are compared with the kept ones.

        Args:
            number: of the episode, ≥ 0; if it is the last one's, that one goes on.
            behaviour: what is shown, in words.

        Raises:
            ValueError: a number that is no int or before the last one's, or a behaviour that is no
                str, or another one than that of the episode that goes on; nothing has changed.
        """
        last = int(self.episodes.live("number")[-1]) if len(self.episodes) else 0
        if not is_integer(number, last) or number >= 2**63:
            raise ValueError(f"expected an episode's number as an int ≥ {last}, got {number!r}")
        if not isinstance(behaviour, str):
            raise ValueError(f"expected behaviour as a str, got {type(behaviour).__name__}")
        if not self.training:
            return
        draft = draft_of(self)
        draft.check()
        draft.begin_checked(number, behaviour)
        adopt(self, draft)

    def begin_checked(self, number: int, behaviour: str) -> None:
        """`begin` of what is checked, in place."""
        if self._goes_on(number, behaviour):
            return
        settle(self)
        if behaviour not in self.behaviours:
            self.behaviours = [*self.behaviours, behaviour]
        kind = self.behaviours.index(behaviour)
        row = {"number": number, "behaviour": kind, "samples": 0, "last_cue": 0.0}
        self.episodes.append(row)
        self._changed()

    def _goes_on(self, number: int, behaviour: str) -> bool:
        """Whether the episode is the last one still.

        Raises:
            ValueError: it is, but of another behaviour.
        """
        if len(self.episodes) == 0 or int(self.episodes.live("number")[-1]) != number:
            return False
        shown = self.behaviours[int(self.episodes.live("behaviour")[-1])]
        if shown != behaviour:
            raise ValueError(
                f"expected episode {number} to go on with {shown!r}, got {behaviour!r}"
            )
        return True

    @torch.no_grad()
    def write(
        self, node: int, target: Tensor, cue: Tensor, *, activation: float, habituated: bool
    ) -> None:
        """Takes in one sample of the episode that was begun last.

        Args:
            node: the winner.
            target: the current target, `[A]`.
            cue: the percept, scaled, `[D]`.
            activation: of the winner by the percept.
            habituated: whether the winner is fully habituated; if not, it keeps nothing.

        Raises:
            ValueError: no episode was begun, no such node, no such activation, or a target or cue
                of the wrong shape, dtype or device, or not finite; nothing has been written then.
        """
        if not self.training:
            return
        node = self._check(node, target, cue, activation)
        sample = Samples(
            node=torch.tensor([node], device=cue.device),
            activation=cue.new_tensor([activation]),
            habituated=torch.tensor([bool(habituated)], device=cue.device),
            target=target[None],
            cue=cue[None],
        )
        self._take_in(sample)

    @torch.no_grad()
    def write_samples(self, samples: Samples, _episode: int) -> None:
        """`write` for samples that the map has taken in, checked; nothing in eval mode."""
        if self.training:
            self._take_in(samples)

    def _take_in(self, samples: Samples) -> None:
        self._changed()
        take_in(self, samples)

    def _check(self, node: int, target: Tensor, cue: Tensor, activation: float) -> int:
        if len(self.episodes) == 0:
            raise ValueError("expected begin before write, no episode was begun")
        node = check_number("a node", node, len(self))
        if not (is_number(activation) and 0 <= activation <= 1):
            raise ValueError(f"expected an activation from 0 to 1, got {activation!r}")
        self.check_pair(batch_of_one(target), batch_of_one(cue))
        self.check()
        return node

    def check(self) -> None:
        """Checks what a user may have done to the buffers, before anything relies on them.

        Raises:
            ValueError: as `Sequences.check`, or rows that speak of others which are not there.
        """
        super().check()
        blocks, episodes, passes = self.blocks.live, self.episodes.live, self.passes.live
        if self.nodes.shape != () or self.nodes.dtype != torch.int64:
            raise ValueError(f"expected a number of nodes, got {self.nodes}")
        count, told = len(self.episodes), passes("episode")
        numbers = {
            "schemas of nodes that exist": within(blocks("node"), len(self)),
            "sequences of episodes that exist": within(blocks("shown_in"), count),
            "behaviours that have a name": within(episodes("behaviour"), len(self.behaviours)),
            "passes of episodes that exist": within(told, count),
            "passes through schemas that exist": within(passes("schema"), len(self.blocks)),
        }
        check_holds(numbers)
        first, last, support = passes("first"), passes("last"), blocks("support")
        ended = episodes("samples")[told]
        check_holds(
            {
                "passes within their episodes": within(last, ended) & (first <= last).all(),
                "passes that begin in their episodes": (first >= 0).all(),
                "schemas of at least one target": (self.lengths > 0).all(),
                "a typical length and support ≥ 0 of what is compared": (
                    (support == OPEN) | ((support > 0) & (blocks("typical_length") > 0))
                ).all(),
            }
        )

    def drop(self, schemas: Tensor) -> None:
        """Deletes schemas, int64 `[K]` ascending, and the passes through them.

        Raises:
            ValueError: not ascending, or no such schemas.
        """
        check_numbers("schemas", schemas, len(self.blocks))
        through = self.passes.live("schema")
        self.passes.delete(torch.isin(through, schemas).nonzero().flatten())
        self.blocks.delete(schemas)
        through = self.passes.live("schema")
        through -= torch.searchsorted(schemas, through)

    def timeline(self) -> Timeline | None:
        """What is expected when, in each of the known episodes; None if there is none."""
        if self._timeline is None and len(self.passes) > 0:
            self.check()
            compact(self)  # else saving would, and the timeline's rows would be others
            self._timeline = lay_out(self, self.config.recognition.places)
        return self._timeline

    def new_recall(self) -> CompetingRecall | None:
        """A recall episode beside the one of `recall`; None if there are no schemas."""
        timeline = self.timeline()
        if timeline is None:
            return None
        known = frozen(self)
        known._recall = None  # else it would keep the last one, and that the one before
        return CompetingRecall(known, timeline)

    @property
    def recall_in_progress(self) -> CompetingRecall | None:
        """The recall episode; None if there is none."""
        return self._recall

    def recall_checked(self, node: int, percept: NDArray[np.floating]) -> RecalledRow | None:
        """The current target of the winner's most confident schema.

        Called at each sample of a recall episode, in order of time; `reset` starts a new one.
        """
        if self._recall is None:
            self._recall = self.new_recall()
        return None if self._recall is None else self._recall.recall(node, percept)

    @torch.no_grad()
    def rivals(self, node: int, percept: Tensor) -> list[Rival]:
        """The schemas of a node that competed for a percept, after its `recall`; changes nothing.

        Args:
            node: the winner, or `NO_NODE`.
            percept: `[D]`, scaled; the one that was recalled last.

        Returns:
            The most confident first: the node's, and where none of these is confident, those of
            other nodes that are. With a margin, the incumbent may have won before the first.

        Raises:
            ValueError: nothing was recalled since `reset`.
        """
        if self._recall is None or not self._recall.belief.has_begun:
            raise ValueError("expected a percept that was recalled, got none since reset")
        node = self._check_winner(node)
        check_bounded("percept", batch_of_one(percept), *self._like_a_cue())
        return self._recall.rivals(node, as_array(percept))

    def origins(self, schema: int, position: int) -> list[Origin]:
        """The moments of demonstrations that a recalled target stands for.

        Args:
            schema: its number, as in `RecalledTarget` and `Decision`.
            position: of the target in it.

        Returns:
            First the moment at which the target itself was shown. Then those at the same share of
            the other passes through the schema, in order of time.

        Raises:
            ValueError: no such schema, or no such position.
        """
        return origins_of(self, schema, position)

    def frames(self, schema: int) -> Tensor:
        """The samples of their episode at which a schema's targets were shown, int64 `[L]`."""
        return self._rows("frame", schema)


def _names(state: Tensor) -> list[str]:
    try:
        names = json.loads(bytes(state.tolist()))
    except (RecursionError, ValueError) as error:
        raise ValueError(f"expected names of behaviours as JSON, got {error}") from error
    strings = isinstance(names, list) and all(isinstance(name, str) for name in names)
    if not strings or len(set(names)) < len(names):
        raise ValueError(f"expected a list of different names of behaviours, got {names}")
    return names


def _start_afresh(schemas: nn.Module, _incompatible_keys: object) -> None:
    assert isinstance(schemas, CompetingSchemas)
    schemas._changed()
