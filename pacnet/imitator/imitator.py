"""Learns from anybody's demonstrations, acts on what is like them, and says what is not.

What a person uses who brings a dataset: around the network of Maistros, Marom & Hayes (2001) it
chooses the settings that the network asks for, knows every dimension by its name, remembers which
demonstrations it learned, and gives no action where the percept is new.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import asdict
from operator import index
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from pacnet.competition.competing_schemas import CompetingSchemas
from pacnet.core.checkpoint import load_checkpoint, save_checkpoint
from pacnet.core.drafts import adopt, draft_of, snapshot_of
from pacnet.core.growable_rows import as_array, check_storage, copy_on_state_dict
from pacnet.core.integrity import (
    check_conditions,
    check_model,
    check_on_load,
    check_structure,
    part_of,
)
from pacnet.core.interrupts import defer_sigint
from pacnet.core.old_names import rename_on_load
from pacnet.core.validation import MAX_VALUE, check_index, check_row
from pacnet.datasets.demonstrations import Demonstration, Demonstrations
from pacnet.forward_models.mlp import MLPForwardModel
from pacnet.imitator.auto_config import choose_settings
from pacnet.imitator.config import ImitatorConfig
from pacnet.imitator.novelty import Familiarity
from pacnet.kernels.engine import Engine
from pacnet.network.checks import FORWARD_MODEL, check_dimensions
from pacnet.network.network import PACNet
from pacnet.network.records import Decision
from pacnet.network.snapshot import Snapshot
from pacnet.schemas.sequences import OLD_TENSORS, compact
from pacnet.schemas.targets import targets_ahead


def exactly() -> AbstractContextManager[object]:
    """Computes in full precision within a caller's mixed precision: distances need their digits."""
    return torch.autocast("cpu", enabled=False)


class EpisodeReport(NamedTuple):
    """One demonstration, learned."""

    dataset: str
    """Name of the dataset that it is from."""
    episode: int
    """Its number there."""
    task: str
    """What was shown, in words."""
    frames: int
    """Number of frames, T."""
    new_nodes: int
    """Nodes that the map grew by."""
    nodes: int
    """Nodes that the map had then."""
    novel_share: float
    """Of its frames that were novel to the map when they came."""
    unfamiliar: float | None
    """Its largest novelty before it was learned, as of `ImitatorStep`; None for the first."""
    correction: bool = False
    """Whether it showed what to do where something was new."""


class ImitatorStep(NamedTuple):
    """What the imitator does at one percept of a control loop."""

    action: NDArray[np.float32] | None
    """`[U]`; None where it does not act: the caller holds, or asks somebody."""
    is_novel: bool
    """Whether the percept is unlike all that was learned."""
    novelty: float
    """How far it is from what was learned, in the dimension in which it is farthest, over what is
    usual there; more than 1 is new."""
    dimension: str
    """The name of that dimension."""
    deviation: float
    """By how much this percept is more than what was learned there, in the dimension's own unit."""
    tolerated: float
    """How far off percepts may be there, for a while, in the same unit."""
    decision: Decision
    """Of the network: which node won, what it recalled."""


class _Known(NamedTuple):
    """What `step` works on: all that was learned at one moment."""

    network: Snapshot
    familiarity: Familiarity
    cues: NDArray[np.float32]  # [R, D], all percepts that targets are kept with, scaled
    scale: NDArray[np.float32]  # [D], of percepts

    def is_of(self, network: Snapshot, familiarity: Familiarity) -> bool:
        """Whether these are still the ones."""
        return self.network is network and self.familiarity.usual is familiarity.usual


class Imitator(nn.Module):
    """Learns from demonstrations, one after the other; `from_demonstrations` makes one.

    One thread may `step` while another learns: it acts on what was known before a demonstration, or
    on all that is known after it.

    Args:
        config: see `ImitatorConfig`.
        engine: as of `PACNet`.

    Attributes:
        lessons: what was learned; the network's learning episode number k is `lessons[k]`.

    Example:
        >>> phase = torch.linspace(0, 1.5, 200)[:, None]
        >>> shown = Demonstration(0, "wave", phase.sin(), torch.empty(200, 0), phase.cos())
        >>> names = {"observation.state": ("elbow",), "action": ("motor",)}
        >>> demonstrations = Demonstrations(50, names, (shown,), "waving")
        >>> imitator = Imitator.from_demonstrations(demonstrations)
        >>> [lesson.new_nodes for lesson in imitator.learn(demonstrations)]
        [2]
        >>> imitator.step(np.float32([0.5])).action.round(1)
        array([0.8], dtype=float32)
        >>> imitator.step(np.float32([3.0])).action is None
        True
    """

    first_action: Tensor  # [U]

    def __init__(self, config: ImitatorConfig, engine: Engine = "auto") -> None:
        super().__init__()
        self.config = config
        model = None if config.forward_model is None else MLPForwardModel(config.forward_model)
        self.network = PACNet(config.network, model, engine)
        self.familiarity = Familiarity(config.network.attention.dimensions)
        self.lessons: list[EpisodeReport] = []
        self.register_buffer("first_action", torch.zeros(len(config.action)))
        self._known: _Known | None = None
        copy_on_state_dict(self)
        rename_on_load(self, OLD_TENSORS)
        check_on_load(self)

    @classmethod
    def from_demonstrations(
        cls,
        demonstrations: Demonstrations,
        targets: Literal["action", "state"] = "action",
        lead: int = 1,
        engine: Engine = "auto",
    ) -> Imitator:
        """One that has learned nothing, with the settings that suit these demonstrations.

        Args:
            demonstrations: to take the scale of percepts and the rate from.
            targets: what the schemas keep; see `ImitatorConfig`.
            lead: frames that a target lies ahead, where it is a state.
            engine: as of `PACNet`.

        Raises:
            ValueError: no demonstrations, percepts that never change, or actions that never do
                where a forward model has to choose among them.
        """
        return cls(choose_settings(demonstrations, targets, lead), engine)

    def extra_repr(self) -> str:
        """Return the number of demonstrations learned and the dimensions, for `print`."""
        percepts, actions = len(self.percept_names), len(self.config.action)
        lengths = f"percept_dimensions={percepts}, action_dimensions={actions}"
        return f"demonstrations={len(self.lessons)}, {lengths}, fps={self.config.fps}"

    @property
    def percept_names(self) -> tuple[str, ...]:
        """Names of a percept's D dimensions."""
        return self.config.percept_names

    @property
    def forward_model(self) -> MLPForwardModel | None:
        """What finds the action that leads to a state; None where targets are actions."""
        model = self.network.forward_model
        assert model is None or isinstance(model, MLPForwardModel)
        return model

    @torch.no_grad()
    def learn(
        self,
        demonstrations: Demonstrations,
        progress: Callable[[int], object] | None = None,
        *,
        corrections: bool = False,
    ) -> list[EpisodeReport]:
        """Learns each demonstration, in order, and goes on from what it knows.

        The map watches a demonstration first, so that its nodes have settled when its targets are
        kept. The scale of percepts stays what it is. A forward model is fitted to the first
        demonstrations and stays: it belongs to the body, not to what is shown. In eval mode nothing
        is learned. A Ctrl-C waits until the demonstration is learned; an error on the way leaves
        what was known before it.

        Args:
            demonstrations: of the same features and rate as all before.
            progress: called after each demonstration with the number of its frames.
            corrections: whether they show what to do where something was new. What is tolerated
                elsewhere, and the usual first action, stay what they are then, however many there
                are.

        Returns:
            A lesson for each demonstration; none in eval mode.

        Raises:
            ValueError: other features or another rate, a demonstration that is empty, not finite or
                too large, of another type or width, or of unequal lengths, a task that is no text,
                or too few frames to fit a forward model to; nothing has been learned then, of no
                demonstration.
        """
        self._check(demonstrations)
        if not self.training:
            return []
        if self.forward_model is not None and not self.lessons:
            with exactly():
                self._fit(self.forward_model, demonstrations.episodes)
        lessons = []
        for shown in demonstrations:
            with exactly(), defer_sigint():
                lessons.append(self._learn_one(demonstrations.source, shown, corrections))
            if progress is not None:
                progress(len(shown.state))
        return lessons

    def step(self, percept: NDArray[np.float32] | Tensor) -> ImitatorStep:
        """What to do about one percept; goes on from the last call, and learns nothing.

        Args:
            percept: `[D]`, an array or a tensor on the CPU, float32.

        Raises:
            ValueError: of the wrong shape or dtype, or not finite; nothing has changed.
        """
        percept, known = check_row("percept", percept, len(self.percept_names)), self._now()
        state = percept[: self.config.state_dimensions] if self.forward_model is not None else None
        decision = self.network.step_on(known.network, percept, state)
        judgement = known.familiarity.judge(percept * known.scale, known.cues)
        # What cannot be compared is new, too.
        is_novel, unit = not judgement.novelty <= 1, float(known.scale[judgement.dimension])
        if unit == 0:
            raise ValueError(f"expected a scale without zeros, got {known.scale.tolist()}")
        wanted = decision.target if self.forward_model is None else decision.action
        return ImitatorStep(
            None if is_novel else wanted,
            is_novel,
            judgement.novelty,
            self.percept_names[judgement.dimension],
            judgement.deviation / unit,
            judgement.tolerated / unit,
            decision,
        )

    def warm_up(self) -> None:
        """Does what a process's first two steps take seconds for; then begins a recall episode."""
        with torch.inference_mode(False):
            _, _, cues, scale = self._now()
            known = cues[0] if len(cues) else np.zeros_like(scale)
            for _ in range(2):  # the belief moves on at the second
                self.step(known / scale)
        self.reset()

    def reset(self) -> None:
        """Starts a new recall episode; what was learned stays."""
        self.network.reset()
        self.familiarity.reset()

    def save_pretrained(self, folder: str | Path) -> None:
        """Writes `config.json` and `model.safetensors`; a kill leaves the old or the new ones.

        Args:
            folder: made if it is missing; a checkpoint in it is replaced, other files stay.

        Raises:
            ValueError: tensors that contradict one another; nothing has been written.
        """
        with self.network.changing:
            tensors, lessons = self.state_dict(), [lesson._asdict() for lesson in self.lessons]
        self.check_state(tensors)
        fields = {**asdict(self.config), "lessons": lessons}
        save_checkpoint(folder, "Imitator", fields, tensors)

    @classmethod
    def from_pretrained(cls, folder: str | Path, engine: Engine = "auto") -> Imitator:
        """Loads what `save_pretrained` wrote, on the CPU, ready to act or to go on learning.

        Raises:
            FileNotFoundError: no checkpoint there.
            ValueError: a damaged file, an unknown version, the checkpoint of something else, or a
                missing, extra or misshapen tensor.
        """
        fields, tensors = load_checkpoint(folder, "Imitator")
        lessons = _lessons(fields.pop("lessons", None))
        config = ImitatorConfig.from_dict(fields)
        try:
            check_dimensions(config.network, tensors, "network.")  # before memory is taken for them
            if config.forward_model is not None:
                model = part_of(tensors, "network." + FORWARD_MODEL)
                MLPForwardModel.check_sizes(config.forward_model, model)
            imitator = cls(config, engine)
            imitator.load_state_dict(tensors)
            imitator.lessons = lessons
            imitator._check_lessons()
        except (RuntimeError, ValueError) as error:
            told = " ".join(str(error).split())  # torch takes several lines
            raise ValueError(
                f"expected the tensors of an Imitator in '{folder}': {told}"
            ) from error
        return imitator

    def state_dict(self, *args: Any, **kwargs: Any) -> Any:
        """As of any module; where another thread learns, of before or after a demonstration."""
        with self.network.changing:
            return super().state_dict(*args, **kwargs)

    def load_state_dict(
        self, state_dict: Mapping[str, Any], strict: bool = True, assign: bool = False
    ) -> Any:
        """As of any module, all or nothing; what another thread is learning is finished before."""
        models = part_of(state_dict, "network." + FORWARD_MODEL)
        with self.network.no_learning(), self.network.changing:
            check_model(self.forward_model, models, strict)
            return super().load_state_dict(state_dict, strict, assign)

    def check_state(self, tensors: Mapping[str, Tensor]) -> None:
        """Raises a ValueError unless these tensors, of a `state_dict`, are the state of one."""
        check_structure(self, tensors)
        check_conditions({"a finite first action": tensors["first_action"].isfinite().all()})

    def _check_lessons(self) -> None:
        """Refuses learning episodes of the network that no lesson tells about."""
        self._schemas.episodes.check()
        numbers = self._schemas.episodes.live("number")
        if len(numbers) and int(numbers[-1]) >= len(self.lessons):
            raise ValueError(
                f"expected a lesson for each of {int(numbers[-1]) + 1} learning episodes, "
                f"got {len(self.lessons)}"
            )

    def _now(self) -> _Known:
        """What was learned, all of it at one moment."""
        network, known = self.network.snapshot(), self._known
        if known is None or not known.is_of(network, self.familiarity):
            with self.network.changing:
                self._known = known = self._look_up(self.network.snapshot())
        return known

    def _look_up(self, network: Snapshot) -> _Known:
        schemas = network.schemas
        assert isinstance(schemas, CompetingSchemas)
        recall = schemas.recall_in_progress
        cues = schemas.arrays("cue") if recall is None else recall.cues
        scale = as_array(network.sofm.scale)
        return _Known(network, snapshot_of(self.familiarity), cues, scale)

    def __getstate__(self) -> dict[str, Any]:
        """A copy looks up itself what it acts on."""
        return {**self.__dict__, "_known": None}

    @property
    def _schemas(self) -> CompetingSchemas:
        schemas = self.network.schemas
        assert isinstance(schemas, CompetingSchemas)
        return schemas

    def _check(self, demonstrations: Demonstrations) -> None:
        """Refuses demonstrations of something else than what is known."""
        if not isinstance(demonstrations, Demonstrations):
            raise ValueError(f"expected Demonstrations, got {type(demonstrations).__name__}")
        if not isinstance(demonstrations.source, str):
            raise ValueError(f"expected their source as a str, got {demonstrations.source!r}")
        self._check_lessons()
        if check_storage("first_action", self.first_action).shape != (len(self.config.action),):
            raise ValueError(
                f"expected a first action [{len(self.config.action)}], "
                f"got {list(self.first_action.shape)}"
            )
        wanted = {**self.config.percepts, "action": self.config.action}
        got = {**demonstrations.percept_features, "action": demonstrations.action_names}
        for name in wanted.keys() | got.keys():
            if wanted.get(name) != got.get(name):
                raise ValueError(
                    f"expected {name!r} with the dimensions {_listed(wanted.get(name))}, as "
                    f"learned before, got {_listed(got.get(name))}"
                )
        if demonstrations.fps != self.config.fps:
            raise ValueError(
                f"expected {self.config.fps} frames per second, as learned before, "
                f"got {demonstrations.fps}"
            )
        for shown in demonstrations:
            _check_one(shown)
            self._check_size(shown)

    def _check_size(self, shown: Demonstration) -> None:
        """Refuses rows of another width, or so large that distances would not be finite."""
        widths = {
            "percepts": (shown.percepts, len(self.percept_names)),
            "states": (shown.state, self.config.state_dimensions),
            "actions": (shown.action, len(self.config.action)),
        }
        for name, (rows, width) in widths.items():
            if rows.shape[1] != width:
                raise ValueError(
                    f"expected {name} of {width} dimensions in episode {shown.episode}, "
                    f"got {rows.shape[1]}"
                )
        try:
            self.network.sofm.normalize(shown.percepts)
        except ValueError as error:
            raise ValueError(f"episode {shown.episode}: {error}") from None
        largest = max(float(rows.abs().max()) for rows in (shown.action, self._targets(shown)))
        if largest > MAX_VALUE:
            raise ValueError(
                f"expected actions and targets within ±{MAX_VALUE:g} in episode "
                f"{shown.episode}, got {largest:g}"
            )

    def _fit(self, model: MLPForwardModel, episodes: Sequence[Demonstration]) -> None:
        """Fits the forward model to all steps from one frame to the next."""
        model.fit(
            torch.cat([episode.state[:-1] for episode in episodes]),
            torch.cat([episode.action[:-1] for episode in episodes]),
            torch.cat([episode.state[1:] for episode in episodes]),
            seed=0,
        )

    def _learn_one(self, dataset: str, shown: Demonstration, correction: bool) -> EpisodeReport:
        """Learns on drafts, which then take the place of what was known, all at once."""
        with self.network.learning() as draft:  # from here on nobody else learns
            number, first_action = len(self.lessons), self.first_action
            correction = correction and number > 0  # there is nothing to correct before
            familiarity, percepts = draft_of(self.familiarity), draft.sofm.normalize(shown.percepts)
            unfamiliar = _compare(draft, familiarity, percepts, number, correction)
            watched = draft.update(percepts)
            draft.update(percepts, self._targets(shown), number, shown.task)
            if not correction:
                before = sum(not lesson.correction for lesson in self.lessons)
                first_action = first_action + (shown.action[0] - first_action) / (before + 1)
            new, nodes = int(watched.inserted.sum()), len(draft.sofm)
            share = float(watched.novelty.float().mean())
            told = (dataset, index(shown.episode), shown.task, len(percepts))
            lesson = EpisodeReport(*told, new, nodes, share, unfamiliar, correction)
            with self.network.changing:
                self.network.adopt(draft)
                adopt(self.familiarity, familiarity)
                self._buffers["first_action"] = first_action
                acting = self.network._snapshot
                self._known = None if acting is None else self._look_up(acting)
                self.lessons.append(lesson)
        return lesson

    def _targets(self, shown: Demonstration) -> Tensor:
        if self.config.targets == "action":
            return shown.action
        return targets_ahead(shown.state, self.config.lead)


def _compare(
    network: PACNet, familiarity: Familiarity, percepts: Tensor, number: int, correction: bool
) -> float | None:
    """How unfamiliar scaled percepts are before they are learned; what is usual is learned."""
    compact(network.schemas)  # else there would be rows that are nobody's cues
    cues = network.schemas.arrays("cue") if number > 0 else None
    novelty = familiarity.learn(percepts.numpy(), cues, correction=correction)
    return None if math.isnan(novelty) else novelty


def _lessons(told: object) -> list[EpisodeReport]:
    """The lessons that a config tells of, as JSON has them."""
    try:
        return [EpisodeReport(**lesson) for lesson in told]  # pyright: ignore[reportGeneralTypeIssues]
    except TypeError as error:
        raise ValueError(f"expected the lessons of an Imitator, got others: {error}") from error


def _check_one(shown: Demonstration) -> None:
    """Refuses a demonstration that is empty, not finite, of unequal lengths, or of other types."""
    where = f"in episode {shown.episode}"
    check_index("an episode", shown.episode, 2**63)
    if not isinstance(shown.task, str):
        raise ValueError(f"expected a task in words {where}, got {shown.task!r}")
    rows = {"state": shown.state, "environment_state": shown.environment_state}
    rows |= {} if shown.encoded is None else {"encoded": shown.encoded}
    rows |= {"action": shown.action}
    for name, values in rows.items():
        if not isinstance(values, Tensor) or values.dim() != 2 or values.dtype != torch.float32:
            got = values.dtype if isinstance(values, Tensor) else type(values).__name__
            raise ValueError(
                f"expected {name} as a torch.float32 tensor [T, ...] {where}, got {got}"
            )
        if not values.is_cpu or values.layout != torch.strided:
            raise ValueError(
                f"expected {name} on the CPU {where}, got it {values.layout} on {values.device}"
            )
    lengths = {name: len(values) for name, values in rows.items()}
    if len(set(lengths.values())) > 1 or 0 in lengths.values():
        raise ValueError(
            f"expected an action for each of at least one percept {where}, "
            f"got {len(shown.action)} for {len(shown.state)}"
        )
    for name, values in (("percepts", shown.percepts), ("actions", shown.action)):
        if not bool(values.isfinite().all()):
            raise ValueError(f"expected finite {name} {where}, got others")


def _listed(names: Sequence[str] | None) -> str:
    return "none" if names is None else ", ".join(names)
