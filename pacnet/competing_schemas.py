"""Several motor schemas per node: different continuations are kept apart, and compete.

Beyond Maistros, Marom & Hayes (2001), whose footnote considers "hard-wiring more motor schemas to
a perceptual categorisation" and whose retraining overwrites. Here an episode is remembered as the
schemas it passed through, one after the other; a schema that several episodes share is stored once.
"""

from __future__ import annotations

import json
from dataclasses import dataclass, field

import torch
from torch import Tensor, nn

from pacnet.belief import Belief, RecognitionConfig, Timeline
from pacnet.competition import Competition, CompetitionConfig
from pacnet.retraining import Quality, is_not_worse, roughness
from pacnet.rows import Column, GrowableRows
from pacnet.schemas import RecalledTarget
from pacnet.sequences import NUMBER, Sequences
from pacnet.sofm import NOBODY
from pacnet.timeline import lay_out
from pacnet.validation import check_fields, check_rows, is_integer, is_number

_OPEN = 0  # support of a schema whose episode is not over


@dataclass(frozen=True)
class CompetingSchemasConfig:
    """How schemas are told apart, retrained and recalled.

    Attributes:
        target_dimensions: length A of a target.
        percept_dimensions: length D of a cue.
        schemas_per_node: how many different schemas a node keeps.
        alike_above: two schemas of a node are the same, seen twice, where exp(−distance) is at
            least this: the distance between their cues, and between what came after them.
        continuation: samples after a schema's last at which is seen what came after it. A node
            that wins again within as many goes on with its schema.
        worse_by: how much worse than the old sequence a new one may be and still take its place,
            in [0, 1); see `is_not_worse`.
        nearest_cues: over how many of the nearest cues a recalled target is averaged.
        margin: by how much more confident a challenger must be; see `Competition`.
        recognition: of what is being watched.
    """

    target_dimensions: int
    percept_dimensions: int
    schemas_per_node: int = 8
    alike_above: float = 0.75
    continuation: int = 25
    worse_by: float = 0.2
    nearest_cues: int = 1
    margin: float = 0.1
    recognition: RecognitionConfig = field(default_factory=RecognitionConfig)

    def __post_init__(self) -> None:
        """Refuses values that have no meaning."""
        if isinstance(self.recognition, dict):  # as JSON gives it
            object.__setattr__(self, "recognition", RecognitionConfig(**self.recognition))
        integers = ("target_dimensions", "percept_dimensions", "schemas_per_node", "nearest_cues")
        checks = {name: (is_integer(getattr(self, name), 1), "≥ 1") for name in integers}
        alike, worse = self.alike_above, self.worse_by
        checks["alike_above"] = (is_number(alike) and 0 < alike < 1, "in (0, 1)")
        checks["continuation"] = (is_integer(self.continuation, 1), "≥ 1 samples")
        checks["worse_by"] = (is_number(worse) and 0 <= worse < 1, "in [0, 1)")
        checks["margin"] = (is_number(self.margin) and self.margin >= 0, "≥ 0 and finite")
        wanted = "to be a RecognitionConfig"
        checks["recognition"] = (isinstance(self.recognition, RecognitionConfig), wanted)
        check_fields(self, checks)


class CompetingSchemas(Sequences):
    """Motor schemas of which a node has several.

    A pass is a stretch of an episode at one habituated node. While the episode lasts, each pass has
    a schema of its own. When the next episode begins, each is compared with the schemas that its
    node keeps. One that is alike, in its cues and in what came after, is the same schema seen
    again: it gains support, and the better sequence stays (`is_not_worse`). One that is unlike all
    is kept beside them; where a node is full, it takes the place of the least supported if it is
    not worse.

    At recall every schema of the winner has a confidence: the probability of the episodes that pass
    through it, given all that was seen in this recall episode, times how well it fits the percept.
    The most confident gives the target whose cue is nearest.

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
                "typical_length": number,  # mean of theirs
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
        self.competition = Competition(CompetitionConfig(margin=config.margin))
        self.behaviours: list[str] = []  # names, in the order in which they were first shown
        self.register_buffer("nodes", torch.tensor(0))
        self.register_load_state_dict_post_hook(_start_recall_afresh)
        self.reset()

    def __len__(self) -> int:
        """The number of nodes."""
        return int(self.nodes)

    def get_extra_state(self) -> Tensor:
        """The behaviours' names, as the bytes of a JSON list, uint8."""
        return torch.tensor(list(json.dumps(self.behaviours).encode()), dtype=torch.uint8)

    def set_extra_state(self, state: Tensor) -> None:
        """Takes the behaviours' names from `get_extra_state`."""
        self.behaviours = json.loads(bytes(state.tolist()))

    def reset(self) -> None:
        """Starts a recall episode: what was seen in the last one is forgotten."""
        self._timeline: Timeline | None = None
        self._belief: Belief | None = None
        self._incumbent = NOBODY

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
        self._drop(torch.isin(of_node, nodes).nonzero().flatten())
        of_node = self.blocks.live("node")
        of_node -= torch.searchsorted(nodes, of_node)
        self.nodes -= len(nodes)
        self.reset()

    @torch.no_grad()
    def begin(self, number: int, behaviour: str) -> None:
        """Begins a learning episode; the last one's schemas are compared with the kept ones.

        Args:
            number: of the episode; if it is the last one's, that one goes on.
            behaviour: what is shown, in words.
        """
        if not self.training or self._goes_on(number, behaviour):
            return
        self._settle()
        if behaviour not in self.behaviours:
            self.behaviours.append(behaviour)
        kind = self.behaviours.index(behaviour)
        row = {"number": number, "behaviour": kind, "samples": 0, "last_cue": 0.0}
        self.episodes.append(row)
        self.reset()

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
            ValueError: no episode was begun, no such node, or a target or cue of the wrong shape,
                dtype or device, or not finite; nothing has been written then.
        """
        self._check(node, target, cue)
        if not self.training:
            return
        frame = int(self.episodes.live("samples")[-1])
        self.episodes.live("samples")[-1] += 1
        self.episodes.live("last_cue")[-1] = cue
        recent = self._recent_passes(frame)
        self.blocks.live("continuation")[self.passes.live("schema")[recent]] = cue
        if not habituated:
            return
        here = recent[self.blocks.live("node")[self.passes.live("schema")[recent]] == node]
        number = int(here[0]) if len(here) else self._open(node, cue, frame)
        schema = int(self.passes.live("schema")[number])
        self._append(schema, {"target": target, "cue": cue, "frame": frame})
        fit = self.blocks.live("fit")[schema]
        fit += (activation - fit) / self.lengths[schema]
        self.passes.live("last")[number] = frame

    def _check(self, node: int, target: Tensor, cue: Tensor) -> None:
        if len(self.episodes) == 0:
            raise ValueError("expected begin before write, no episode was begun")
        if not 0 <= node < len(self):
            raise ValueError(f"expected a node from 0 to {len(self) - 1}, got {node}")
        check_rows("targets", target[None], self.config.target_dimensions, self.pool.live("target"))
        check_rows("cues", cue[None], self.config.percept_dimensions, self.pool.live("cue"))

    def _recent_passes(self, frame: int) -> Tensor:
        """Numbers of this episode's passes of which it is still seen what comes after."""
        this = self.passes.live("episode") == len(self.episodes) - 1
        since = frame - self.passes.live("last")
        return (this & (since <= self.config.continuation)).nonzero().flatten()

    def _open(self, node: int, cue: Tensor, frame: int) -> int:
        """A new pass with a schema of its own; returns the number of the pass."""
        row = {"start": 0, "length": 0, "room": 0, "node": node, "support": _OPEN}
        row |= {"typical_length": 0.0, "fit": 0.0, "continuation": cue}
        schema, episode = self.blocks.append(row), len(self.episodes) - 1
        return self.passes.append(
            {"episode": episode, "schema": schema, "first": frame, "last": frame}
        )

    def _settle(self) -> None:
        """Compares each schema of the episode that is over with those that its node keeps."""
        dropped: list[int] = []
        for schema in (self.blocks.live("support") == _OPEN).nonzero().flatten().tolist():
            rivals = [
                rival
                for rival in self.schemas_of(int(self.blocks.live("node")[schema])).tolist()
                if rival not in dropped and int(self.blocks.live("support")[rival]) != _OPEN
            ]
            dropped += self._settle_one(schema, rivals)
        self._drop(torch.tensor(sorted(dropped), dtype=torch.int64, device=self.nodes.device))

    def _settle_one(self, schema: int, rivals: list[int]) -> list[int]:
        """Closes a schema; returns the number of the one that goes, if any must."""
        support, typical = self.blocks.live("support"), self.blocks.live("typical_length")
        support[schema], typical[schema] = 1, float(self.lengths[schema])
        distances = {rival: self._distance(schema, rival) for rival in rivals}
        twin = min(rivals, key=lambda rival: distances[rival], default=NOBODY)
        if twin != NOBODY and torch.exp(-distances[twin]) >= self.config.alike_above:
            seen = int(support[twin]) + 1
            length = float(typical[twin] + (typical[schema] - typical[twin]) / seen)
            stays, goes = (
                (schema, twin) if self._not_worse(schema, twin, length) else (twin, schema)
            )
            support[stays], typical[stays] = seen, length
            through = self.passes.live("schema")
            through[through == goes] = stays
            return [goes]
        if len(rivals) < self.config.schemas_per_node:
            return []
        weakest = min(rivals, key=lambda rival: int(support[rival]))
        return [weakest if self._not_worse(schema, weakest, float(typical[weakest])) else schema]

    def _not_worse(self, new: int, old: int, typical_length: float) -> bool:
        return is_not_worse(
            self.quality(new), self.quality(old), typical_length, self.config.worse_by
        )

    def quality(self, schema: int) -> Quality:
        """What speaks for a schema; see `is_not_worse`."""
        fit = float(self.blocks.live("fit")[schema])
        return Quality(fit, roughness(self.targets(schema)), int(self.lengths[schema]))

    def _distance(self, one: int, other: int) -> Tensor:
        """How unlike two schemas are, in scaled units: their cues, or what came after."""
        shorter, longer = sorted((self.cues(one), self.cues(other)), key=len)
        cues = torch.cdist(shorter, longer).amin(dim=1).mean()
        after = self.blocks.live("continuation")
        return torch.maximum(cues, torch.linalg.vector_norm(after[one] - after[other]))

    def _drop(self, schemas: Tensor) -> None:
        """Deletes schemas, int64 `[K]` ascending, and the passes through them."""
        through = self.passes.live("schema")
        self.passes.delete(torch.isin(through, schemas).nonzero().flatten())
        self.blocks.delete(schemas)
        through = self.passes.live("schema")
        through -= torch.searchsorted(schemas, through)

    def timeline(self) -> Timeline | None:
        """What is expected when, in each of the known episodes; None if there is none."""
        if self._timeline is None and len(self.passes) > 0:
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
        return self._target(self._incumbent, distances)

    def _compete(self, schemas: Tensor, distances: Tensor, belief: Belief) -> int:
        """Number of the most confident of these schemas."""
        starts, lengths = self.blocks.live("start")[schemas], self.lengths[schemas]
        nearest = [
            distances[start : start + length].amin()
            for start, length in zip(starts.tolist(), lengths.tolist(), strict=True)
        ]
        fit = torch.exp(-torch.stack(nearest))  # [K]
        # Probability that the episode watched is one that passes through the schema.
        known, through = self.passes.live("episode"), self.passes.live("schema")
        passes = torch.zeros(len(schemas), len(self.episodes), dtype=fit.dtype, device=fit.device)
        for place, schema in enumerate(schemas.tolist()):
            passes[place, known[through == schema]] = 1
        of_episode = passes.new_zeros(len(self.episodes))
        of_episode[belief.timeline.episode] = belief.of_episodes().to(fit.dtype)
        confidence = (passes @ of_episode) * fit
        incumbent = (schemas == self._incumbent).nonzero().flatten()
        place = incumbent if len(incumbent) else torch.tensor([NOBODY], device=fit.device)
        return int(schemas[self.competition(confidence[None], place)])

    def _target(self, schema: int, distances: Tensor) -> RecalledTarget:
        start, length = int(self.blocks.live("start")[schema]), int(self.lengths[schema])
        nearest = distances[start : start + length].argsort(stable=True)
        nearest = nearest[: self.config.nearest_cues]
        target = self.targets(schema)[nearest].mean(dim=0)
        return RecalledTarget(target, int(nearest[0]), schema)


def _start_recall_afresh(schemas: nn.Module, _incompatible_keys: object) -> None:
    assert isinstance(schemas, CompetingSchemas)
    schemas.reset()
