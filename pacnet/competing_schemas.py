"""Several motor schemas per node: different continuations are kept apart, and compete.

Beyond Maistros, Marom & Hayes (2001), whose footnote considers "hard-wiring more motor schemas to
a perceptual categorisation" and whose retraining overwrites. Here an episode is remembered as the
schemas it passed through, one after the other; a schema that several episodes share is stored once.
"""

from __future__ import annotations

import json
from collections.abc import Callable

import torch
from torch import Tensor, nn

from pacnet.attention import NOBODY
from pacnet.belief import Belief, Timeline
from pacnet.competing_schemas_config import CompetingSchemasConfig
from pacnet.competition import Competition, CompetitionConfig
from pacnet.retraining import OPEN, settle
from pacnet.rows import Column, GrowableRows
from pacnet.sequences import NUMBER, RecalledTarget, Samples, Sequences, close_gaps
from pacnet.timeline import lay_out
from pacnet.validation import check_rows


class CompetingSchemas(Sequences):
    """Motor schemas of which a node has several.

    A pass is a stretch of an episode at one habituated node. While the episode lasts, each pass has
    a schema of its own. When the next episode begins, each is compared with the schemas that its
    node keeps. One that is alike, in its cues and in what came after, is the same schema seen
    again: it gains support, and if the episode is not worse than what is known, the new sequence
    takes the old one's place (`pacnet.retraining`). One that is unlike all is kept beside them;
    where a node is full, it takes the place of one that was also seen but once, if it is not worse
    than that, or is dropped. Until the next episode begins, and so in a network that learns no
    further, the last one's schemas stand beside the others as they are.

    At recall every schema of the winner has a confidence: the probability that what is watched is a
    pass through it, given all that was seen in this recall episode, times how well it fits the
    percept. The most confident gives the target whose cue is nearest. Where none is confident at
    all, the winner matches but does not belong to what is watched, and nothing is recalled.

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
        self._changed()

    def __len__(self) -> int:
        """The number of nodes."""
        return int(self.nodes)

    def get_extra_state(self) -> Tensor:
        """The behaviours' names, as the bytes of a JSON list, uint8."""
        names = list(json.dumps(self.behaviours).encode())
        return torch.tensor(names, dtype=torch.uint8, device=self.nodes.device)

    def set_extra_state(self, state: Tensor) -> None:
        """Takes the behaviours' names from `get_extra_state`.

        Raises:
            ValueError: it is no list of different names.
        """
        names = json.loads(bytes(state.tolist()))
        strings = isinstance(names, list) and all(isinstance(name, str) for name in names)
        if not strings or len(set(names)) < len(names):
            raise ValueError(f"expected a list of different names of behaviours, got {names}")
        self.behaviours = names

    def reset(self) -> None:
        """Starts a recall episode: what was seen in the last one is forgotten."""
        self._belief: Belief | None = None
        self._incumbent = NOBODY

    def _changed(self) -> None:
        """After a change of what is remembered: a recall in progress starts afresh."""
        self._timeline: Timeline | None = None
        self.reset()

    def _apply(self, fn: Callable[[Tensor], Tensor], recurse: bool = True) -> CompetingSchemas:
        super()._apply(fn, recurse)
        self._changed()  # the timeline does not move to another device with the buffers
        return self

    def schemas_of(self, node: int) -> Tensor:
        """Numbers of the node's schemas, int64 `[K]`."""
        return (self.blocks.live("node") == node).nonzero().flatten()

    def add_node(self) -> int:
        """Adds a node without schemas and returns its number."""
        self.nodes += 1
        return len(self) - 1

    def delete(self, nodes: Tensor) -> None:
        """Deletes nodes, int64 `[K]`, with their schemas; the later ones move down."""
        of_node = self.blocks.live("node")
        self.drop(torch.isin(of_node, nodes).nonzero().flatten())
        of_node = self.blocks.live("node")
        of_node -= torch.searchsorted(nodes, of_node)
        self.nodes -= len(nodes)
        self._changed()

    @torch.no_grad()
    def begin(self, number: int, behaviour: str) -> None:
        """Begins a learning episode; the last one's schemas are compared with the kept ones.

        Args:
            number: of the episode; if it is the last one's, that one goes on.
            behaviour: what is shown, in words.
        """
        if not self.training or self._goes_on(number, behaviour):
            return
        settle(self)
        if behaviour not in self.behaviours:
            self.behaviours.append(behaviour)
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
        self._check(node, target, cue, activation)
        self._changed()
        self._write(node if habituated else NOBODY, target, cue, activation)

    @torch.no_grad()
    def write_samples(self, samples: Samples, _episode: int) -> None:
        """`write` for samples that the map has taken in, checked; nothing in eval mode."""
        if not self.training:
            return
        self._changed()
        nodes = samples.node.where(samples.habituated, NOBODY).tolist()
        rows = zip(nodes, samples.target, samples.cue, samples.activation.tolist(), strict=True)
        for row in rows:
            self._write(*row)

    def _write(self, node: int, target: Tensor, cue: Tensor, activation: float) -> None:
        """One sample; the node is `NOBODY` where it is not habituated and keeps nothing."""
        frame = int(self.episodes.live("samples")[-1])
        self.episodes.live("samples")[-1] += 1
        self.episodes.live("last_cue")[-1] = cue
        recent = self._recent_passes(frame)
        self.blocks.live("continuation")[self.passes.live("schema")[recent]] = cue
        if node == NOBODY:
            return
        here = recent[self.blocks.live("node")[self.passes.live("schema")[recent]] == node]
        number = int(here[0]) if len(here) else self._open(node, cue, frame)
        schema = int(self.passes.live("schema")[number])
        frames = torch.tensor([frame], device=cue.device)
        self._append(schema, {"target": target[None], "cue": cue[None], "frame": frames})
        fit = self.blocks.live("fit")[schema]
        fit += (activation - fit) / self.lengths[schema]
        self.passes.live("last")[number] = frame

    def _check(self, node: int, target: Tensor, cue: Tensor, activation: float) -> None:
        if len(self.episodes) == 0:
            raise ValueError("expected begin before write, no episode was begun")
        if not 0 <= node < len(self):
            raise ValueError(f"expected a node from 0 to {len(self) - 1}, got {node}")
        if not 0 <= activation <= 1:
            raise ValueError(f"expected an activation from 0 to 1, got {activation}")
        check_rows("targets", target[None], self.config.target_dimensions, self.pool.live("target"))
        check_rows("cues", cue[None], self.config.percept_dimensions, self.pool.live("cue"))

    def _recent_passes(self, frame: int) -> Tensor:
        """Numbers of this episode's passes of which it is still seen what comes after."""
        this = self.passes.live("episode") == len(self.episodes) - 1
        since = frame - self.passes.live("last")
        return (this & (since <= self.config.continuation)).nonzero().flatten()

    def _open(self, node: int, cue: Tensor, frame: int) -> int:
        """A new pass with a schema of its own; returns the number of the pass."""
        row = {"start": 0, "length": 0, "room": 0, "node": node, "support": OPEN}
        row |= {"typical_length": 0.0, "fit": 0.0, "continuation": cue}
        schema, episode = self.blocks.append(row), len(self.episodes) - 1
        return self.passes.append(
            {"episode": episode, "schema": schema, "first": frame, "last": frame}
        )

    def drop(self, schemas: Tensor) -> None:
        """Deletes schemas, int64 `[K]` ascending, and the passes through them."""
        through = self.passes.live("schema")
        self.passes.delete(torch.isin(through, schemas).nonzero().flatten())
        self.blocks.delete(schemas)
        through = self.passes.live("schema")
        through -= torch.searchsorted(schemas, through)

    def timeline(self) -> Timeline | None:
        """What is expected when, in each of the known episodes; None if there is none."""
        if self._timeline is None and len(self.passes) > 0:
            close_gaps(self)  # else saving would, and the timeline's rows would be others
            self._timeline = lay_out(self, self.config.recognition.places)
        return self._timeline

    def distances(self, percept: Tensor) -> Tensor:
        """Of a percept, scaled, `[D]`, from every cue of the pool, `[R]`."""
        return torch.linalg.vector_norm(self.pool.live("cue") - percept, dim=1)

    @torch.no_grad()
    def recall(self, node: int, percept: Tensor) -> RecalledTarget | None:
        """The current target of the winner's most confident schema.

        Called at each sample of a recall episode, in order of time; `reset` starts a new one.

        Args:
            node: the winner, or `NOBODY`.
            percept: `[D]`, scaled.

        Returns:
            The target, with its place in its schema; None if there is none.
        """
        timeline = self.timeline()
        if timeline is None:
            return None
        distances = self.distances(percept)
        if self._belief is None:
            self._belief = Belief(timeline, self.config.recognition)
        self._belief.update(distances)
        schemas = self.schemas_of(node)
        if len(schemas) == 0:
            return None
        self._incumbent = self._compete(schemas, distances, self._belief)
        return None if self._incumbent == NOBODY else self._target(self._incumbent, distances)

    def _compete(self, schemas: Tensor, distances: Tensor, belief: Belief) -> int:
        """Number of the most confident of these schemas, or `NOBODY`."""
        starts, lengths = self.blocks.live("start")[schemas], self.lengths[schemas]
        nearest = [
            distances[start : start + length].amin()
            for start, length in zip(starts.tolist(), lengths.tolist(), strict=True)
        ]
        fit = torch.exp(-torch.stack(nearest))  # [K]
        through = self.passes.live("schema")
        watched = belief.probability.new_zeros(len(self.blocks))
        watched.index_add_(0, through, self._of_passes(belief))
        confidence = watched[schemas].to(fit.dtype).clamp(max=1) * fit
        incumbent = (schemas == self._incumbent).nonzero().flatten()
        place = incumbent if len(incumbent) else torch.tensor([NOBODY], device=fit.device)
        winner = int(self.competition(confidence[None], place))
        return NOBODY if winner == NOBODY else int(schemas[winner])

    def _of_passes(self, belief: Belief) -> Tensor:
        """The probability that what is watched is within each pass, `[passes]`."""
        episode = self.passes.live("episode")
        known = torch.searchsorted(belief.timeline.episode, episode)
        samples, places = self.episodes.live("samples")[episode], belief.probability.shape[1]
        first, last = self.passes.live("first"), self.passes.live("last")
        first, end = first * places // samples, (last + 1) * places // samples - 1
        last = torch.maximum(end, last * places // samples)  # a sample may span many places or none
        until = torch.nn.functional.pad(belief.probability.cumsum(dim=1), (1, 0))
        return until[known, last + 1] - until[known, first]

    def _target(self, schema: int, distances: Tensor) -> RecalledTarget:
        start, length = int(self.blocks.live("start")[schema]), int(self.lengths[schema])
        nearest = distances[start : start + length].argsort(stable=True)
        nearest = nearest[: self.config.nearest_cues]
        target = self.targets(schema)[nearest].mean(dim=0)
        return RecalledTarget(target, int(nearest[0]), schema)


def _start_afresh(schemas: nn.Module, _incompatible_keys: object) -> None:
    assert isinstance(schemas, CompetingSchemas)
    schemas._changed()
