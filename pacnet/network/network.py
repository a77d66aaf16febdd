"""The whole: attention decides what a percept is, motor schemas keep the targets that go with it.

Source: Maistros, Marom & Hayes (2001), section "The Integrated System", Figure 4.
"""

from __future__ import annotations

import copy
from collections.abc import Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager
from dataclasses import asdict
from operator import index
from pathlib import Path
from typing import Any, NamedTuple, cast

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from pacnet.attention.records import NO_NODE, Attention, MapUpdate, Observation, ignored
from pacnet.attention.sofm import HabituatingSOFM
from pacnet.competition.competing_schemas import CompetingSchemas
from pacnet.competition.config import CompetingSchemasConfig
from pacnet.competition.recognition import Recognition
from pacnet.core.checkpoint import read_checkpoint, write_checkpoint
from pacnet.core.drafts import Lock, adopt, draft_of, short_turns
from pacnet.core.growable_rows import check_storage, copy_on_state_dict
from pacnet.core.integrity import check_forms, check_holds, check_model, check_on_load, part_of
from pacnet.core.interrupts import defer_sigint
from pacnet.core.validation import batch_of_array, check_bounded, check_rows
from pacnet.forward_models.protocol import ForwardModel, OneStateForwardModel
from pacnet.kernels.engine import Engine
from pacnet.network.acting import Acting, check_nodes
from pacnet.network.config import PACNetConfig
from pacnet.schemas.motor_schemas import NO_EPISODE, MotorSchemas, MotorSchemasConfig
from pacnet.schemas.sequences import Samples, as_array

FORWARD_MODEL = "forward_model."
_LAST_EPISODE = 2**63 - 1  # that an int64 holds


class Recall(NamedTuple):
    """What the network recalls for each percept. T percepts."""

    targets: Tensor
    """Motor targets, `[T, A]`; a row of NaN where nothing is commanded."""
    commanded: Tensor
    """Whether there is a target, bool `[T]`: the match is good and the winner has a schema."""
    winner: Tensor
    """Nearest node, int64 `[T]`, or `NO_NODE`."""
    activation: Tensor
    """exp(−distance to the winner), `[T]`."""
    novelty: Tensor
    """Whether the activation is under the novelty threshold, bool `[T]`."""
    position: Tensor
    """Place of the target in its schema, int64 `[T]`; −1 where nothing is commanded."""
    schema: Tensor
    """Number of the schema it is from, int64 `[T]`, or `NO_NODE`. With one a node, the winner."""


class Action(NamedTuple):
    """What the network would do on each percept. T percepts."""

    action: Tensor
    """`[T, U]`; a row of NaN where none is given and the caller's default behaviour acts."""
    given: Tensor
    """Whether there is an action, bool `[T]`."""
    recall: Recall
    """What was recalled. Where it is commanded and no action given, the forward model abstained."""

    @property
    def abstained(self) -> Tensor:
        """Whether a target was recalled but the forward model could not reach for it, `[T]`."""
        return self.recall.commanded & ~self.given


class Decision(NamedTuple):
    """What the network would do on one percept of a control loop."""

    action: NDArray[np.float32] | None
    """`[U]`; None where none is given and the caller's default behaviour acts."""
    target: NDArray[np.float32] | None
    """The motor target, `[A]`; None where nothing is commanded."""
    winner: int
    """Nearest node, or `NO_NODE`."""
    activation: float
    """exp(−distance to the winner)."""
    novelty: bool
    """Whether the activation is under the novelty threshold."""
    position: int
    """Place of the target in its schema; −1 where nothing is commanded."""
    schema: int
    """Number of the schema it is from, or `NO_NODE`."""


class PACNet(nn.Module):
    """Perception-action coupling: learns by watching (`observe`), acts on what it sees.

    `recall` gives the motor targets that go with a percept, `act` also turns them into actions.

    One thread may recall and act while another learns: it works on what was known before a call of
    `attend` or `observe`, or on all that is known after it. A refusal or a Ctrl-C leaves what was
    known before.

    Args:
        config: see `PACNetConfig`.
        forward_model: turns targets into actions: a `PIDController`, an `MLPForwardModel`, a
            `TransitionMatrix`, or anything else that is a `ForwardModel`. It belongs to the body
            and not to what was watched, so checkpoints of the network leave it out.
        engine: as of `HabituatingSOFM`, for the map. Recall runs compiled on the CPU, wherever the
            network is.

    Raises:
        ValueError: a forward model that is none, or no such engine.

    Example:
        >>> config = PACNetConfig(SOFMConfig.paper(2), MotorSchemasConfig(1, percept_dimensions=2))
        >>> net = PACNet(config)
        >>> percepts, targets = torch.zeros(20, 2), torch.ones(20, 1)
        >>> int(net.observe(percepts, targets, episode=0).inserted.sum())
        1
        >>> net.recall(percepts[:1]).targets
        tensor([[1.]])
    """

    episode: Tensor

    def __init__(
        self,
        config: PACNetConfig,
        forward_model: ForwardModel | None = None,
        engine: Engine = "auto",
    ) -> None:
        super().__init__()
        if forward_model is not None and not isinstance(forward_model, ForwardModel):
            got = type(forward_model).__name__
            raise ValueError(f"expected forward_model as a ForwardModel or None, got {got}")
        self.config = config
        self.forward_model = forward_model
        self.sofm = HabituatingSOFM(config.attention, engine)
        self.schemas = _make_schemas(config.schemas)
        self._learning, self.changing = Lock(), Lock()  # the second for no longer than a moment
        self.acting: Acting | None = None  # what the recall episode in progress works on
        self.register_buffer("episode", torch.tensor(NO_EPISODE))  # the last one observed
        copy_on_state_dict(self)
        check_on_load(self)

    def extra_repr(self) -> str:
        """Return the lengths of percepts and targets, for `print`."""
        percepts, targets = self.config.attention.dimensions, self.config.schemas.target_dimensions
        return f"percept_dimensions={percepts}, target_dimensions={targets}"

    @property
    def behaviours(self) -> tuple[str, ...]:
        """Names of what was shown, in the order of their first time; () with one schema a node."""
        return tuple(self.schemas.behaviours if isinstance(self.schemas, CompetingSchemas) else ())

    def forward(self, percepts: Tensor) -> Attention:
        """Reads the map; see `HabituatingSOFM.forward`."""
        return self.sofm(percepts)

    @torch.no_grad()
    def attend(self, percepts: Tensor) -> Observation:
        """The map alone learns: nodes come and settle, and keep no targets.

        An episode that is attended to before it is observed is kept from its first sample on, where
        else each node keeps targets only once it is fully habituated. In eval mode nothing is
        learned.

        Args:
            percepts: `[T, D]`, in order of time.

        Raises:
            ValueError: wrong shape, dtype or device, empty, or not finite.
        """
        percepts = self.sofm.scaled(percepts).detach()
        if not self.training:
            return ignored(self.sofm.read(percepts)).observation
        return self._learn(percepts)

    @torch.no_grad()
    def observe(
        self, percepts: Tensor, targets: Tensor, episode: int, behaviour: str = ""
    ) -> Observation:
        """Learning phase: the map learns the percepts, habituated nodes take the targets.

        In eval mode nothing is learned. Observing a sequence at once equals observing it sample
        by sample, bit for bit.

        Args:
            percepts: `[T, D]`, in order of time.
            targets: `[T, A]`, the target that goes with each percept.
            episode: number of the learning episode, ≥ 0; a call with the last one's number
                goes on with it, a larger one starts a new episode.
            behaviour: what is shown, in words, for `recognise` to name; with one schema a node,
                names are not kept.

        Raises:
            ValueError: wrong shape, dtype or device, empty, not finite, unequal lengths, an episode
                before the last one, or one that goes on with another behaviour; nothing has been
                learned then.
        """
        episode = self._check_episode(episode)
        percepts, targets = (rows.detach() for rows in self._check_pair(percepts, targets))
        if not isinstance(behaviour, str):
            raise ValueError(f"expected behaviour as a str, got {type(behaviour).__name__}")
        if not self.training:
            return ignored(self.sofm.read(percepts)).observation
        return self._learn(percepts, targets, episode, behaviour)

    def _learn(self, *lesson: Any) -> Observation:
        with self.learning() as draft:
            observation = draft.learn_checked(*lesson)
            with defer_sigint(), self.changing:
                self.adopt(draft)
        return observation

    @contextmanager
    def learning(self) -> Iterator[PACNet]:
        """A draft of this network to learn on, for `adopt`; who learns waits until others have."""
        # Growing inside a caller's inference mode would make buffers nobody can update later.
        with self.waiting(), short_turns(), torch.inference_mode(False):
            with self.changing:  # who reads may be closing the gaps between the schemas' sequences
                draft = self.draft()
            yield draft

    def waiting(self) -> AbstractContextManager[object]:
        """Waits until no other thread learns, and keeps others from it."""
        return self._learning

    def draft(self) -> PACNet:
        """A network that learns apart from this one; it shares the forward model."""
        twin = copy.copy(self)
        parts = {"sofm": draft_of(self.sofm), "schemas": draft_of(self.schemas)}
        twin._modules = {**self._modules, **parts}
        twin._buffers = {"episode": check_storage("episode", self.episode).clone()}
        return twin

    def adopt(self, draft: PACNet) -> None:
        """Puts what a draft has learned in the place of what was known; `changing` is held."""
        acting = None if self.acting is None else Acting(draft.sofm, draft.schemas)
        adopt(self.sofm, draft.sofm)
        adopt(self.schemas, draft.schemas)
        self._buffers["episode"] = draft.episode
        if acting is not None:
            acting.follow(self.sofm, self.schemas)
        self.acting = acting

    def now(self) -> Acting:
        """What the recall episode works on; a new one, if what was known has changed."""
        acting, parts = self.acting, self._modules  # as attributes they would take a microsecond
        if acting is None or not acting.is_of(parts["sofm"], parts["schemas"]):
            with self.changing:
                acting = self.acting
                if acting is None or not acting.is_of(self.sofm, self.schemas):
                    self.acting = acting = Acting(self.sofm, self.schemas)
        return acting

    def learn_checked(
        self,
        percepts: Tensor,
        targets: Tensor | None = None,
        episode: int = NO_EPISODE,
        behaviour: str = "",
    ) -> Observation:
        """`observe` of what is checked and scaled, in place; without targets, `attend`."""
        check_nodes(self.sofm, self.schemas)
        self.schemas.check()
        cues = self.schemas.pool.live("cue")
        if percepts.dtype != cues.dtype:
            raise ValueError(f"expected schemas in {percepts.dtype}, as the map, got {cues.dtype}")
        if targets is not None:
            self._check_episode(episode)  # again: another thread may have learned one since
            if isinstance(self.schemas, CompetingSchemas):
                self.schemas.begin_checked(episode, behaviour)
            self.episode.fill_(episode)
        update = self.sofm.learn(percepts)
        self._add_samples(update, percepts, targets, episode)
        return update.observation

    def _add_samples(
        self, update: MapUpdate, percepts: Tensor, targets: Tensor | None, episode: int
    ) -> None:
        """Takes the motor schemas, which do not influence the map, to where the map is.

        Args:
            update: what the map did.
            percepts: `[T, D]`, scaled.
            targets: `[T, A]`; None where none are to be kept.
            episode: number of the learning episode.
        """
        observed = update.observation
        for part, gone in update.between_deletions():
            for _ in range(int(observed.inserted[part].sum())):
                self.schemas.add_node()
            if targets is not None:
                samples = Samples(
                    node=observed.winner[part],
                    activation=observed.activation[part],
                    habituated=update.habituated[part],
                    target=targets[part],
                    cue=percepts[part],
                )
                self.schemas.write_samples(samples, episode)
            if len(gone):
                self.schemas.delete(gone)

    @torch.no_grad()
    def recall(self, percepts: Tensor) -> Recall:
        """Recall phase: the winner's current target for each percept, going on from the last call.

        Where the match is not good enough, or the winner has no targets yet, nothing is
        commanded and the caller's default behaviour acts. `reset` starts a new recall episode.

        Args:
            percepts: `[T, D]`, in order of time.

        Raises:
            ValueError: percepts of the wrong shape, dtype or device, empty, or not finite; the
                recall episode is where it was then.
        """
        percepts, acting = self.sofm.scaled(percepts), self.now()
        attention = acting.sofm.read(percepts)
        matching = torch.where(attention.novelty, NO_NODE, attention.winner)
        targets, position, schema = acting.schemas.recall_samples(matching, percepts)
        return Recall(
            targets, position != NO_NODE, attention.winner, attention.activation,
            attention.novelty, position, schema,
        )  # fmt: skip

    def step(
        self,
        percept: NDArray[np.float32] | Tensor,
        state: NDArray[np.float32] | Tensor | None = None,
    ) -> Decision:
        """`act`, or without a forward model `recall`, for one percept of a control loop.

        It takes microseconds. Nothing is learned, in no mode.

        Args:
            percept: `[D]`, an array or tensor of the network's dtype; arrays are on the CPU. Goes
                on from the last call, as `recall` does.
            state: `[S]`, the robot's state, from which the forward model starts; the percept
                itself if left out.

        Raises:
            ValueError: as `act`; the recall episode is where it was then, if it is the percept.
        """
        return self.step_on(self.now(), percept, state)

    def step_on(
        self,
        acting: Acting,
        percept: NDArray[np.float32] | Tensor,
        state: NDArray[np.float32] | Tensor | None,
    ) -> Decision:
        """`step` of a recall episode that `now` gave."""
        seen, scaled = acting.sofm.look(percept)
        recalled = acting.schemas.recall_checked(NO_NODE if seen.novelty else seen.winner, scaled)
        if recalled is None:
            return Decision(None, None, seen.winner, seen.activation, seen.novelty, -1, NO_NODE)
        target, position, schema = recalled
        action = self._command_one(percept if state is None else state, target)
        return Decision(
            action, target, seen.winner, seen.activation, seen.novelty, position, schema
        )

    def _command_one(
        self, state: NDArray[np.float32] | Tensor, target: NDArray[np.float32]
    ) -> NDArray[np.float32] | None:
        model = self.forward_model
        if model is None:
            return None
        single = target.dtype == np.float32 and getattr(state, "is_cpu", True)
        if single and hasattr(model, "command_one"):  # what isinstance takes 20 µs to say
            return cast(OneStateForwardModel, model).command_one(state, target)
        # Copies: what the caller does with its arrays is nothing to the forward model.
        states = _checked_states(batch_of_array(state), self.sofm.scale[None])
        with torch.no_grad():
            action, given = model.command(states, batch_of_array(target).to(states))
        return action[0].numpy(force=True).copy() if bool(given) else None

    @torch.no_grad()
    def recognise(self, percepts: Tensor) -> Recognition:
        """Watches and does nothing: says what is being done, going on from the last call.

        `reset` starts a new episode. What `recall` is about is not touched: both can be asked about
        the same percepts.

        Args:
            percepts: `[T, D]`, in order of time.

        Raises:
            ValueError: one schema a node, or nothing learned yet, so that there is nothing to
                recognise; percepts of the wrong shape, dtype or device, empty, or not finite.
        """
        scaled, acting = self.sofm.scaled(percepts), self.now()
        watcher = acting.watcher()
        attention = acting.sofm.read(scaled)
        rows = map(watcher.see, as_array(scaled))
        understood = (np.stack(column) for column in zip(*rows, strict=True))
        probability, behaviour, progress, soon, end, novelty = (
            torch.from_numpy(column).to(scaled.device) for column in understood
        )
        probability, progress, soon, end, novelty = (
            column.to(scaled.dtype) for column in (probability, progress, soon, end, novelty)
        )
        return Recognition(
            probability,
            behaviour,
            progress,
            soon / self.sofm.scale,
            end / self.sofm.scale,
            novelty,
            novelty > watcher.novel_above,
            torch.where(attention.novelty, NO_NODE, attention.winner),
        )

    @torch.no_grad()
    def act(self, percepts: Tensor, states: Tensor | None = None) -> Action:
        """Recall phase with a forward model: the action that leads towards the recalled target.

        No action is given where nothing is recalled and where the forward model abstains.

        Args:
            percepts: `[T, D]`, in order of time; goes on from the last call, as `recall` does.
            states: `[T, S]`, the robot's state at each percept, from which the forward model
                starts; the percepts themselves if left out.

        Raises:
            ValueError: no forward model; as `recall`; not one state for each percept; states that
                the forward model refuses.
        """
        model = self.forward_model
        if model is None:
            raise ValueError("expected a forward model to act with, got PACNet(config) without one")
        self.sofm.scaled(percepts)  # refuses bad ones before anything moves
        states = percepts if states is None else _checked_states(states, percepts)
        recall = self.recall(percepts)
        action = percepts.new_full((len(percepts), model.action_dimensions), torch.nan)
        given = torch.zeros_like(recall.commanded)
        # One sample after the other: a forward model may have a memory, as a PID has.
        for sample in recall.commanded.nonzero().flatten().tolist():
            here = slice(sample, sample + 1)
            action[here], given[here] = model.command(states[here], recall.targets[here])
        return Action(action, given, recall)

    def reset(self) -> None:
        """Starts a new recall episode; what was learned stays."""
        self.schemas.reset()
        if self.acting is not None:
            self.acting.reset()
        if self.forward_model is not None:
            self.forward_model.reset()

    def save_pretrained(self, folder: str | Path) -> None:
        """Writes `config.json` and `model.safetensors`; a kill leaves the old or the new ones.

        Args:
            folder: made if it is missing; a checkpoint in it is replaced, other files stay.

        Raises:
            ValueError: the network's tensors contradict one another; nothing has been written.
        """
        tensors = self.state_dict()  # which closes the gaps between the schemas' sequences
        own = {name: t for name, t in tensors.items() if not name.startswith(FORWARD_MODEL)}
        self.check_state(own)
        write_checkpoint(folder, asdict(self.config), own)

    @classmethod
    def from_pretrained(
        cls,
        folder: str | Path,
        forward_model: ForwardModel | None = None,
        engine: Engine = "auto",
    ) -> PACNet:
        """Loads what `save_pretrained` wrote, on the CPU, ready to recall or to go on learning.

        Args:
            folder: of the checkpoint.
            forward_model: to act with.
            engine: as of `PACNet`.

        Raises:
            FileNotFoundError: no checkpoint there.
            ValueError: a damaged file, an unknown version, or a missing, extra or misshapen tensor.
        """
        fields, tensors = read_checkpoint(folder)
        config = PACNetConfig.from_dict(fields)
        try:
            check_dimensions(config, tensors, "")  # before memory is taken for them
            network = cls(config, engine=engine)
            network.to(tensors["sofm.nodes.prototype"].dtype)
            network.load_state_dict(tensors)
        except ValueError as error:
            raise ValueError(f"expected the tensors of a PACNet in '{folder}': {error}") from error
        network.forward_model = forward_model
        return network

    def state_dict(self, *args: Any, **kwargs: Any) -> Any:
        """As of any module; where another thread learns, of before or after it."""
        with self.changing:
            return super().state_dict(*args, **kwargs)

    def load_state_dict(
        self, state_dict: Mapping[str, Any], strict: bool = True, assign: bool = False
    ) -> Any:
        """As of any module, all or nothing; what another thread is learning is finished before."""
        with self.waiting(), self.changing:
            check_model(self.forward_model, part_of(state_dict, FORWARD_MODEL), strict)
            return super().load_state_dict(state_dict, strict, assign)

    def check_state(self, tensors: Mapping[str, Tensor]) -> None:
        """Raises a ValueError unless these tensors, of a `state_dict`, are the state of a network.

        A forward model checks its own.
        """
        own = {name: t for name, t in tensors.items() if not name.startswith(FORWARD_MODEL)}
        check_forms(self, own)
        self.sofm.check_state(part_of(own, "sofm."))
        self.schemas.check_state(part_of(own, "schemas."))
        nodes, kept = len(own["sofm.nodes.prototype"]), _nodes_of(self.schemas, own)
        if nodes != kept:
            raise ValueError(f"expected motor schemas for each node, got {kept} for {nodes} nodes")
        last = own.get("schemas.episodes.number", own.get("schemas.blocks.episode"))
        holds = {"an episode ≥ −1, the last of all": (own["episode"] >= NO_EPISODE)}
        if last is not None:
            holds["an episode ≥ −1, the last of all"] &= (last <= own["episode"]).all()
        check_holds(holds)

    def _check_episode(self, episode: int) -> int:
        try:
            number = None if isinstance(episode, bool) else index(episode)
        except TypeError:
            number = None
        if number is None:
            raise ValueError(f"expected episode as an int, got {type(episode).__name__}")
        if number > _LAST_EPISODE:
            raise ValueError(f"expected episode ≤ {_LAST_EPISODE}, got {episode}")
        last = max(0, int(check_storage("episode", self.episode)))
        if number < last:
            raise ValueError(f"expected episode ≥ {last}, the last one observed, got {episode}")
        return number

    def _check_pair(self, percepts: Tensor, targets: Tensor) -> tuple[Tensor, Tensor]:
        """Checks both and hands back scaled percepts `[T, D]` and targets `[T, A]`."""
        percepts = self.sofm.scaled(percepts)
        wanted = self.schemas.pool.live("target")  # alone: another thread may be learning
        if wanted.dim() != 2:
            raise ValueError(f"expected stored targets [rows, A], got {list(wanted.shape)}")
        targets = check_bounded("targets", targets, wanted.shape[1], wanted)
        if len(percepts) != len(targets):
            raise ValueError(
                f"expected one target for each of {len(percepts)} percepts, got {len(targets)}"
            )
        return percepts, targets


def check_dimensions(config: PACNetConfig, tensors: Mapping[str, Tensor], prefix: str) -> None:
    """Raises a ValueError unless percepts and targets are as long as the config says."""
    widths = {
        "sofm.nodes.prototype": config.attention.dimensions,
        "schemas.pool.cue": config.schemas.percept_dimensions,
        "schemas.pool.target": config.schemas.target_dimensions,
    }
    for name, width in widths.items():
        tensor = tensors.get(prefix + name)
        if tensor is None or tuple(tensor.shape[1:]) != (width,):
            got = "none" if tensor is None else list(tensor.shape)
            raise ValueError(f"expected {prefix}{name} of shape [rows, {width}], got {got}")


def _nodes_of(schemas: MotorSchemas | CompetingSchemas, tensors: Mapping[str, Tensor]) -> int:
    """How many nodes there are schemas for."""
    if isinstance(schemas, CompetingSchemas):
        return int(tensors["schemas.nodes"])
    return len(tensors["schemas.blocks.length"])


def _make_schemas(
    config: MotorSchemasConfig | CompetingSchemasConfig,
) -> MotorSchemas | CompetingSchemas:
    if isinstance(config, CompetingSchemasConfig):
        return CompetingSchemas(config)
    return MotorSchemas(config)


def _checked_states(states: Tensor, percepts: Tensor) -> Tensor:
    """States [T, S], one for each percept, or a ValueError."""
    columns = states.shape[1] if isinstance(states, Tensor) and states.dim() == 2 else 1
    check_rows("states", states, columns, like=percepts)
    if len(states) != len(percepts):
        raise ValueError(
            f"expected one state for each of {len(percepts)} percepts, got {len(states)}"
        )
    return states
