"""The whole network, from percept to action.

A percept wins a node of the map, the node's motor schemas compete, the winning one gives a target,
and a forward model gives the action that leads there.

Source: Maistros, Marom & Hayes (2001), section "The Integrated System", Figure 4.
"""

from __future__ import annotations

from typing import Any, cast

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from pacnet.attention.records import NO_NODE, Attention, MapUpdate, Observation, ignored
from pacnet.competition.recognition import Recognition
from pacnet.core.growable_rows import as_array, check_storage
from pacnet.core.interrupts import defer_sigint
from pacnet.core.validation import as_batch
from pacnet.forward_models.protocol import OneStateForwardModel
from pacnet.network.checks import check_pair, check_states
from pacnet.network.records import Decision
from pacnet.network.snapshot import check_nodes
from pacnet.network.state import NetworkState
from pacnet.schemas.interface import NO_EPISODE, Samples, check_episode


class PACNet(NetworkState):
    """Perception-action coupling: learns by watching (`observe`), acts on what it sees.

    `recall` gives the motor targets that go with a percept; `act` also turns them into actions.

    One thread may recall and act while another learns: it works on the state before a call of
    `attend` or `observe`, or on the state after it. A refused call or a Ctrl-C changes nothing.

    Args:
        config: see `PACNetConfig`.
        forward_model: turns targets into actions: a `PIDController`, an `MLPForwardModel`, a
            `TransitionMatrix`, or any other `ForwardModel`. It depends on the body and not on the
            demonstrations, so checkpoints of the network do not contain it.
        engine: as of `HabituatingSOFM`, for the map. Recall runs compiled, on the CPU, on any
            device.

    Raises:
        ValueError: a forward model that is not a `ForwardModel`, or no such engine.

    Example:
        >>> config = PACNetConfig(SOFMConfig.paper(2), MotorSchemasConfig(1, percept_dimensions=2))
        >>> net = PACNet(config)
        >>> percepts, targets = torch.zeros(20, 2), torch.ones(20, 1)
        >>> int(net.observe(percepts, targets, episode=0).inserted.sum())
        1
        >>> net.recall(percepts[:1]).target
        tensor([[1.]])
    """

    def forward(self, percepts: Tensor) -> Attention:
        """Read the map; see `HabituatingSOFM.forward`."""
        return self.sofm(percepts)

    # Learning

    @torch.no_grad()
    def attend(self, percepts: Tensor) -> Observation:
        """Let the map alone learn: nodes grow and habituate, and keep no targets.

        A node keeps targets only once it is fully habituated. Call `attend` before `observe` to
        keep an episode from its first sample on. In eval mode nothing is learned.

        Args:
            percepts: `[T, D]`, in order of time.

        Raises:
            ValueError: wrong shape, dtype or device, empty, or not finite.
        """
        return self._learn(self.sofm.normalize(percepts).detach())

    @torch.no_grad()
    def observe(
        self, percepts: Tensor, targets: Tensor, episode: int, behaviour: str = ""
    ) -> Observation:
        """Learn a demonstration: the map learns the percepts, habituated nodes keep the targets.

        In eval mode nothing is learned. Observing a sequence at once equals observing it sample
        by sample, bit for bit.

        Args:
            percepts: `[T, D]`, in order of time.
            targets: `[T, A]`, the target that goes with each percept.
            episode: number of the learning episode, ≥ 0. The last one's number continues it; a
                larger one starts a new episode.
            behaviour: name of what is shown, for `recognise`; with one schema per node, names are
                not kept.

        Raises:
            ValueError: wrong shape, dtype or device, empty, not finite, unequal lengths, an episode
                before the last one, or one that continues with another behaviour; nothing has been
                learned then.
        """
        last = int(check_storage("episode", self.episode))
        episode = check_episode(episode, behaviour, last)
        percepts, targets = check_pair(self.sofm, self.schemas, percepts, targets)
        return self._learn(percepts.detach(), targets.detach(), episode, behaviour)

    def _learn(self, percepts: Tensor, *demonstration: Any) -> Observation:
        """Learn on a draft what `update` takes, then adopt it; in eval mode only read the map."""
        if not self.training:
            return ignored(self.sofm.read(percepts))
        with self.learning() as draft:
            observation = draft.update(percepts, *demonstration)
            with defer_sigint(), self.state_lock:
                self.adopt(draft)
        return observation

    def update(
        self,
        percepts: Tensor,
        targets: Tensor | None = None,
        episode: int = NO_EPISODE,
        behaviour: str = "",
    ) -> Observation:
        """Learn checked and normalized percepts in place, on a draft; without targets, `attend`."""
        check_nodes(self.sofm, self.schemas)
        self.schemas.check()
        cues = self.schemas.pool.live("cue")
        if percepts.dtype != cues.dtype:
            raise ValueError(f"expected schemas in {percepts.dtype}, as the map, got {cues.dtype}")
        if targets is not None:
            # Again, because another thread may have learned an episode since.
            check_episode(episode, behaviour, int(self.episode))
            self.schemas.begin_episode(episode, behaviour)
            self.episode.fill_(episode)
        update = self.sofm.update(percepts)
        self._update_schemas(update, percepts, targets, episode)
        return update.observation

    def _update_schemas(
        self, update: MapUpdate, percepts: Tensor, targets: Tensor | None, episode: int
    ) -> None:
        """Add the map's new nodes and habituated samples, and delete schemas of deleted nodes."""
        observed = update.observation
        for part, gone in update.between_deletions():
            for _ in range(int(observed.inserted[part].sum())):
                self.schemas.add_node()
            if targets is not None:
                samples = Samples(
                    node=observed.winner[part],
                    activation=observed.activation[part],
                    habituated=update.habituated[part],
                    habituated_at=update.habituated_at[part],
                    target=targets[part],
                    cue=percepts[part],
                )
                self.schemas.add_samples(samples, episode)
            if len(gone):
                self.schemas.delete(gone)

    # Recall

    @torch.no_grad()
    def recall(self, percepts: Tensor) -> Decision:
        """Recall the winner's current target for each percept; continues from the last call.

        Where the match is not good enough, or the winner has no targets yet, there is no target and
        the caller's default behaviour acts. `reset` starts a new recall episode.

        Args:
            percepts: `[T, D]`, in order of time.

        Raises:
            ValueError: percepts of the wrong shape, dtype or device, empty, or not finite; the
                recall episode is unchanged then.
        """
        percepts, now = self.sofm.normalize(percepts), self.snapshot()
        attention = now.sofm.read(percepts)
        matching = torch.where(attention.novelty, NO_NODE, attention.winner)
        target, offset, schema = now.schemas.recall_samples(matching, percepts)
        has_target = offset != NO_NODE
        return Decision(
            target, has_target, attention.winner, attention.activation, attention.novelty, offset,
            schema, has_action=torch.zeros_like(has_target),
        )  # fmt: skip

    @torch.no_grad()
    def act(self, percepts: Tensor, states: Tensor | None = None) -> Decision:
        """Recall, and choose the actions that lead towards the targets.

        There is no action where there is no target and where the forward model abstains.

        Args:
            percepts: `[T, D]`, in order of time; continues from the last call, as `recall` does.
            states: `[T, S]`, the robot's state at each percept, from which the forward model
                starts; the percepts themselves if left out.

        Raises:
            ValueError: no forward model; as `recall`; not one state for each percept; states that
                the forward model refuses.
        """
        model = self.forward_model
        if model is None:
            raise ValueError("expected a forward model to act with, got PACNet(config) without one")
        self.sofm.normalize(percepts)  # refuses bad ones before anything changes
        states = percepts if states is None else check_states(states, percepts)
        recalled = self.recall(percepts)
        action = percepts.new_full((len(percepts), model.action_dimensions), torch.nan)
        given = torch.zeros_like(recalled.has_target)
        # One sample after the other: a forward model may have a state, as a PID has.
        for sample in recalled.has_target.nonzero().flatten().tolist():
            here = slice(sample, sample + 1)
            action[here], given[here] = model.command(states[here], recalled.target[here])
        return recalled._replace(action=action, has_action=given)

    def step(
        self,
        percept: NDArray[np.float32] | Tensor,
        state: NDArray[np.float32] | Tensor | None = None,
    ) -> Decision:
        """Do what `act` does, or `recall` without a forward model, for one percept.

        It takes microseconds, for a control loop. Nothing is learned, in either mode.

        Args:
            percept: `[D]`, an array or tensor of the network's dtype; arrays are on the CPU.
                Continues from the last call, as `recall` does.
            state: `[S]`, the robot's state, from which the forward model starts; the percept
                itself if left out.

        Raises:
            ValueError: as `act`; after a bad percept the recall episode is unchanged.
        """
        now = self.snapshot()
        seen, normalized = now.sofm.read_one(percept)
        winner = NO_NODE if seen.novelty else seen.winner
        recalled = now.schemas.recall_one(winner, normalized)
        attention = seen.winner, seen.activation, seen.novelty
        if recalled is None:
            return Decision(None, False, *attention, -1, NO_NODE)
        target, offset, schema = recalled
        action = self._command(percept if state is None else state, target)
        return Decision(target, True, *attention, offset, schema, action, action is not None)

    def _command(
        self, state: NDArray[np.float32] | Tensor, target: NDArray[np.float32]
    ) -> NDArray[np.float32] | None:
        model = self.forward_model
        if model is None:
            return None
        single = target.dtype == np.float32 and getattr(state, "is_cpu", True)
        if single and hasattr(model, "command_one"):  # isinstance takes 20 µs
            return cast(OneStateForwardModel, model).command_one(state, target)
        # Copies, so that the caller may change its arrays.
        states = check_states(as_batch(state, arrays=True), self.sofm.scale[None])
        with torch.no_grad():
            action, given = model.command(states, as_batch(target, arrays=True).to(states))
        return action[0].numpy(force=True).copy() if bool(given) else None

    @torch.no_grad()
    def recognise(self, percepts: Tensor) -> Recognition:
        """Recognize the observed behaviour, without acting; continues from the last call.

        `reset` starts a new episode. A recall episode about the same percepts is not affected.

        Args:
            percepts: `[T, D]`, in order of time.

        Raises:
            ValueError: one schema per node, or nothing learned yet, so that nothing can be
                recognized; percepts of the wrong shape, dtype or device, empty, or not finite.
        """
        normalized, now = self.sofm.normalize(percepts), self.snapshot()
        recognizer = now.recognizer()
        attention = now.sofm.read(normalized)
        columns = recognizer.columns(as_array(normalized))
        probability, behaviour, progress, soon, end, novelty = (
            column.to(normalized if column.is_floating_point() else normalized.device)
            for column in columns
        )
        return Recognition(
            probability,
            behaviour,
            progress,
            soon / self.sofm.scale,
            end / self.sofm.scale,
            novelty,
            novelty > recognizer.novel_above,
            torch.where(attention.novelty, NO_NODE, attention.winner),
        )

    def reset(self) -> None:
        """Start a new recall episode; what was learned stays."""
        self.schemas.reset()
        if self._snapshot is not None:
            self._snapshot.reset()
        if self.forward_model is not None:
            self.forward_model.reset()
