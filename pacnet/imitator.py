"""Learns from anybody's demonstrations, acts on what is like them, and says what is not.

What a person uses who brings a dataset: around the network of Maistros, Marom & Hayes (2001) it
chooses the settings that the network asks for, knows every dimension by its name, remembers which
demonstrations it learned, and gives no action where the percept is new.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from dataclasses import asdict
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from pacnet.competing_schemas import CompetingSchemas
from pacnet.demonstrations import Demonstration, Demonstrations
from pacnet.engine import Engine
from pacnet.familiarity import Familiarity
from pacnet.imitator_config import ImitatorConfig
from pacnet.imitator_settings import choose_settings
from pacnet.interrupts import interrupts_held_back
from pacnet.mlp_forward_model import MLPForwardModel
from pacnet.model_checkpoint import check_finite, read_model, save_model
from pacnet.network import Decision, PACNet
from pacnet.sequences import close_gaps
from pacnet.targets import targets_ahead


def exactly() -> AbstractContextManager[object]:
    """Computes in full precision within a caller's mixed precision: distances need their digits."""
    return torch.autocast("cpu", enabled=False)


class Lesson(NamedTuple):
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


class Imitator(nn.Module):
    """Imitation from demonstrations, one pass, on and on; see `untaught` for one to begin with.

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
        >>> imitator = Imitator.untaught(demonstrations)
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
        self.lessons: list[Lesson] = []
        self.register_buffer("first_action", torch.zeros(len(config.action)))
        self._scale = np.asarray(self.network.sofm.scale, dtype=np.float32)  # [D]

    @classmethod
    def untaught(
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
    ) -> list[Lesson]:
        """Learns each demonstration, in order, and goes on from what it knows.

        The map watches a demonstration first, so that its nodes have settled when its targets are
        kept. The scale of percepts stays what it is. A forward model is fitted to the first
        demonstrations and stays: it belongs to the body, not to what is shown. In eval mode nothing
        is learned. A Ctrl-C waits until the demonstration is learned.

        Args:
            demonstrations: of the same features and rate as all before.
            progress: called after each demonstration with the number of its frames.
            corrections: whether they show what to do where something was new. What is tolerated
                elsewhere, and the usual first action, stay what they are then, however many there
                are.

        Returns:
            A lesson for each demonstration; none in eval mode.

        Raises:
            ValueError: other features or another rate, a demonstration that is empty, not finite,
                or of unequal lengths, or too few frames to fit a forward model to; nothing has been
                learned then.
        """
        self._check(demonstrations)
        if not self.training:
            return []
        if self.forward_model is not None and not self.lessons:
            with exactly():
                self._fit(self.forward_model, demonstrations.episodes)
        before = len(self.lessons)
        for shown in demonstrations:
            with torch.inference_mode(False), exactly(), interrupts_held_back():
                self._learn_one(demonstrations.source, shown, corrections)
            if progress is not None:
                progress(len(shown.state))
        return self.lessons[before:]

    def step(self, percept: NDArray[np.float32] | Tensor) -> ImitatorStep:
        """What to do about one percept; goes on from the last call, and learns nothing.

        Args:
            percept: `[D]`, an array or a tensor on the CPU, float32.

        Raises:
            ValueError: of the wrong shape or dtype, or not finite; nothing has changed.
        """
        percept = percept.detach().numpy() if isinstance(percept, Tensor) else percept
        state = percept[: self.config.state_dimensions] if self.forward_model is not None else None
        decision = self.network.step(percept, state)
        judgement = self.familiarity.judge(percept * self._scale, self._cues())
        # What cannot be compared is new, too.
        is_novel, unit = not judgement.novelty <= 1, float(self._scale[judgement.dimension])
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
            cues = self._cues()
            known = cues[0] if len(cues) else np.zeros_like(self._scale)
            for _ in range(2):  # the belief moves on at the second
                self.step(known / self._scale)
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
        close_gaps(self._schemas)
        self.network.check_integrity()
        lessons = [lesson._asdict() for lesson in self.lessons]
        save_model(self, {**asdict(self.config), "lessons": lessons}, folder)

    @classmethod
    def from_pretrained(cls, folder: str | Path, engine: Engine = "auto") -> Imitator:
        """Loads what `save_pretrained` wrote, on the CPU, ready to act or to go on learning.

        Raises:
            FileNotFoundError: no checkpoint there.
            ValueError: a damaged file, an unknown version, the checkpoint of something else, or a
                missing, extra or misshapen tensor.
        """
        fields, tensors = read_model(folder, "Imitator")
        lessons = _lessons(fields.pop("lessons", None))
        imitator = cls(ImitatorConfig.from_dict(fields), engine)
        try:
            check_finite(tensors)
            imitator.load_state_dict(tensors)
            imitator.network.check_integrity()
            imitator.familiarity.check_integrity()
            imitator.lessons = lessons
            imitator._check_lessons()
        except (RuntimeError, ValueError) as error:
            told = " ".join(str(error).split())  # torch takes several lines
            raise ValueError(
                f"expected the tensors of an Imitator in '{folder}': {told}"
            ) from error
        return imitator

    def _check_lessons(self) -> None:
        """Refuses learning episodes of the network that no lesson tells about."""
        numbers = self._schemas.episodes.live("number")
        if len(numbers) and int(numbers[-1]) >= len(self.lessons):
            raise ValueError(
                f"expected a lesson for each of {int(numbers[-1]) + 1} learning episodes, "
                f"got {len(self.lessons)}"
            )

    def _cues(self) -> NDArray[np.float32]:
        """All percepts that targets are kept with, scaled, `[R, D]`."""
        return self._schemas.pool.live("cue").numpy()

    @property
    def _schemas(self) -> CompetingSchemas:
        schemas = self.network.schemas
        assert isinstance(schemas, CompetingSchemas)
        return schemas

    def _check(self, demonstrations: Demonstrations) -> None:
        """Refuses demonstrations of something else than what is known."""
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

    def _fit(self, model: MLPForwardModel, episodes: Sequence[Demonstration]) -> None:
        """Fits the forward model to all steps from one frame to the next."""
        model.fit(
            torch.cat([episode.state[:-1] for episode in episodes]),
            torch.cat([episode.action[:-1] for episode in episodes]),
            torch.cat([episode.state[1:] for episode in episodes]),
            seed=0,
        )

    def _learn_one(self, dataset: str, shown: Demonstration, correction: bool) -> None:
        percepts, number = shown.percepts, len(self.lessons)
        correction = correction and number > 0  # there is nothing to correct before
        unfamiliar = self._compare(percepts, correction)
        watched = self.network.attend(percepts)
        self.network.observe(percepts, self._targets(shown), number, shown.task)
        if not correction:
            before = sum(not lesson.correction for lesson in self.lessons)
            self.first_action += (shown.action[0] - self.first_action) / (before + 1)
        new, nodes = int(watched.inserted.sum()), len(self.network.sofm)
        share = float(watched.novelty.float().mean())
        told = (dataset, shown.episode, shown.task, len(percepts))
        self.lessons.append(Lesson(*told, new, nodes, share, unfamiliar, correction))

    def _targets(self, shown: Demonstration) -> Tensor:
        if self.config.targets == "action":
            return shown.action
        return targets_ahead(shown.state, self.config.lead)

    def _compare(self, percepts: Tensor, correction: bool) -> float | None:
        """How unfamiliar a demonstration is before it is learned; what is usual is learned."""
        close_gaps(self._schemas)  # else there would be rows that are nobody's cues
        cues = self._cues() if self.lessons else None
        scaled = percepts.numpy() * self._scale
        novelty = self.familiarity.learn(scaled, cues, correction=correction)
        return None if math.isnan(novelty) else novelty


def _lessons(told: object) -> list[Lesson]:
    """The lessons that a config tells of, as JSON has them."""
    try:
        return [Lesson(**lesson) for lesson in told]  # pyright: ignore[reportGeneralTypeIssues]
    except TypeError as error:
        raise ValueError(f"expected the lessons of an Imitator, got others: {error}") from error


def _check_one(shown: Demonstration) -> None:
    """Refuses a demonstration that is empty, of unequal lengths, or not finite."""
    lengths = {len(shown.percepts), len(shown.action)}
    if len(lengths) > 1 or 0 in lengths:
        raise ValueError(
            f"expected an action for each of at least one percept in episode {shown.episode}, "
            f"got {len(shown.action)} for {len(shown.percepts)}"
        )
    for name, rows in (("percepts", shown.percepts), ("actions", shown.action)):
        if not bool(rows.isfinite().all()):
            raise ValueError(f"expected finite {name} in episode {shown.episode}, got others")


def _listed(names: Sequence[str] | None) -> str:
    return "none" if names is None else ", ".join(names)
