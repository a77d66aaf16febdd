"""The schema network, the paper's first system: perceptual-motor pairs that are given by hand.

Source: Maistros, Marom & Hayes (2001), section "Implementation", Figures 1 and 2. A perceptual
schema is a sequence of percepts; its confidence tells how well it matches the present percept. Its
motor schema is an equally long sequence of targets. The designer decides where the parts of a
behaviour begin and end; in `PACNet`, attention decides.
"""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path

import torch
from torch import Tensor, nn

from pacnet.competition.winner_take_all import NO_SCHEMA, Competition
from pacnet.core.checkpoint import load_checkpoint, save_checkpoint
from pacnet.core.growable_rows import Column, GrowableRows
from pacnet.core.integrity import check_structure
from pacnet.core.validation import check_index, check_rows, check_same_length
from pacnet.forward_models.protocol import ForwardModel
from pacnet.network.checks import FORWARD_MODEL, check_model_type, check_states
from pacnet.network.config import SchemaNetworkConfig
from pacnet.network.records import SchemaActivity, SchemaDecision

_SEARCH_ELEMENTS = 2**24  # differences held at once during a search: 64 MB


class SchemaNetwork(nn.Module):
    """Perceptual-motor pairs that compete to act.

    The confidence of a perceptual schema is exp(−d / width), where d is the Euclidean distance from
    the scaled percept to the nearest percept of its sequence; ties go to the lowest index.

    Args:
        config: see `SchemaNetworkConfig`.
        forward_model: turns targets into actions: a `PIDController`, or any other `ForwardModel`.
            It belongs to the robot and not to the schemas, so checkpoints do not contain it.

    Raises:
        ValueError: `forward_model` is not a `ForwardModel`.

    Example:
        >>> network = SchemaNetwork(SchemaNetworkConfig(1, 1))
        >>> first = network.add_schema(torch.tensor([[0.0], [1.0]]), torch.tensor([[5.0], [6.0]]))
        >>> second = network.add_schema(torch.tensor([[3.0]]), torch.tensor([[7.0]]))
        >>> decision = network.recall(torch.tensor([[1.0], [2.5]]))
        >>> decision.winner, decision.target.flatten()
        (tensor([0, 1]), tensor([6., 7.]))
    """

    scale: Tensor

    def __init__(
        self, config: SchemaNetworkConfig, forward_model: ForwardModel | None = None
    ) -> None:
        super().__init__()
        check_model_type(forward_model)
        self.config = config
        self.forward_model = forward_model
        self.competition = Competition(config.competition)
        self.pool = GrowableRows(  # the sequences of all schemas, concatenated
            {
                "percept": Column((config.percept_dimensions,), torch.float32),  # scaled
                "target": Column((config.target_dimensions,), torch.float32),
            }
        )
        self.sequences = GrowableRows({"length": Column((), torch.int64)})
        scale = (1.0,) * config.percept_dimensions if config.scale is None else config.scale
        self.register_buffer("scale", torch.tensor(scale), persistent=False)
        self.register_load_state_dict_post_hook(_reset_after_load)
        self._incumbent = NO_SCHEMA  # the last winner of this episode

    def __len__(self) -> int:
        """Return the number S of schemas."""
        return len(self.sequences)

    def extra_repr(self) -> str:
        """Return how much is stored, for `print`."""
        lengths = f"schemas={len(self)}, targets={int(self.lengths.sum())}"
        percepts, targets = self.config.percept_dimensions, self.config.target_dimensions
        return f"{lengths}, percept_dimensions={percepts}, target_dimensions={targets}"

    @property
    def lengths(self) -> Tensor:
        """Number of percepts, and of targets, of each schema, int64 `[S]`."""
        return self.sequences.live("length")

    def percepts(self, schema: int) -> Tensor:
        """Return the schema's percepts in order, in the percept's units, `[L, D]`."""
        return self._sequence("percept", schema) / self.scale

    def targets(self, schema: int) -> Tensor:
        """Return the schema's targets in order, `[L, A]`."""
        return self._sequence("target", schema)

    @torch.no_grad()
    def add_schema(self, percepts: Tensor, targets: Tensor) -> int:
        """Add a perceptual schema with its motor schema, and start a new episode.

        Args:
            percepts: what it recognises, `[L, D]`, in order of time.
            targets: the target that goes with each percept, `[L, A]`.

        Returns:
            The index of the schema.

        Raises:
            ValueError: percepts or targets of the wrong shape, dtype or device, empty, not finite,
                or not equally many; nothing has been added then.
        """
        scaled = self._scale(percepts)
        check_rows("targets", targets, self.config.target_dimensions, self.pool.live("target"))
        check_same_length(percepts=percepts, targets=targets)
        # Buffers made in a caller's inference mode could not be updated later.
        with torch.inference_mode(False):
            first = self.pool.extend(len(scaled))
            self.pool.live("percept")[first:] = scaled
            self.pool.live("target")[first:] = targets.detach()
            schema = self.sequences.append({"length": len(scaled)})
        self.reset()
        return schema

    def forward(self, percepts: Tensor) -> SchemaActivity:
        """Return confidence, offset and target of every schema for percepts `[B, D]`.

        Raises:
            ValueError: percepts of the wrong shape, dtype or device, empty, or not finite.
        """
        scaled = self._scale(percepts)
        with torch.no_grad():
            offset = self._nearest(scaled)  # [B, S]
        rows = self._starts() + offset
        difference = scaled[:, None] - self.pool.live("percept")[rows]  # [B, S, D]
        confidence = torch.exp(-torch.linalg.vector_norm(difference, dim=2) / self.config.width)
        active = confidence >= self.config.competition.threshold
        targets = self.pool.live("target")[rows].where(active[:, :, None], torch.nan)
        return SchemaActivity(confidence, active, offset, targets)

    @torch.no_grad()
    def recall(self, percepts: Tensor) -> SchemaDecision:
        """Return the winner and its target for each percept `[T, D]`, continuing the episode.

        If no schema is active there is no winner. `reset` starts a new episode.

        Raises:
            ValueError: percepts as in `forward`; the episode is unchanged then.
        """
        decision = self._compete(percepts)
        self._incumbent = int(decision.winner[-1])
        return decision

    @torch.no_grad()
    def act(self, percepts: Tensor, states: Tensor) -> SchemaDecision:
        """Return the command of every active motor schema, and the winner's as the action.

        The forward model is called once for each percept with a winner. It gets one row for each
        schema, in a fixed order, so a `PIDController` has an integral for each:

        - An active schema integrates the error of its own target. If it does not win, the error
          remains, and the integral grows up to `integral_limit`.
        - An inactive schema integrates the error of the winner's target, and its command is
          dropped. When it becomes active, its integral carries the same load and no old error.

        Args:
            percepts: `[T, D]`, in order of time; continues the episode, as `recall` does.
            states: the robot's state at each percept, from which the forward model starts,
                `[T, K]`; for a `PIDController` joint angles, then velocities.

        Raises:
            ValueError: no forward model; percepts as in `forward`; not one finite state for each
                percept; states that the forward model refuses. The episode is unchanged then.
        """
        model = self.forward_model
        if model is None:
            raise ValueError(
                "expected a forward model to act with, got SchemaNetwork(config) without one"
            )
        decision = self._compete(percepts)
        states = check_states(states, percepts)
        candidates, has_command = self._command(model, decision, states)
        winner = decision.winner
        self._incumbent = int(winner[-1])
        return decision._replace(
            has_action=_of_winner(winner, has_command, False),
            action=_of_winner(winner, candidates, torch.nan),
            candidates=candidates,
        )

    def reset(self) -> None:
        """Start a new episode, also of the forward model: there is no last winner."""
        self._incumbent = NO_SCHEMA
        if self.forward_model is not None:
            self.forward_model.reset()

    def save_pretrained(self, folder: str | Path) -> None:
        """Write `config.json` and `model.safetensors`.

        The write is atomic: after a crash the old or the new checkpoint is intact.

        Args:
            folder: created if missing; a checkpoint in it is replaced, other files stay.

        Raises:
            ValueError: a tensor that is not finite; nothing has been written.
        """
        own = self.state_dict()
        tensors = {n: tensor for n, tensor in own.items() if not n.startswith(FORWARD_MODEL)}
        save_checkpoint(folder, "SchemaNetwork", asdict(self.config), tensors)

    @classmethod
    def from_pretrained(
        cls, folder: str | Path, forward_model: ForwardModel | None = None
    ) -> SchemaNetwork:
        """Load what `save_pretrained` wrote, on the CPU.

        Args:
            folder: of the checkpoint.
            forward_model: as of the class.

        Raises:
            FileNotFoundError: no checkpoint there.
            ValueError: a damaged file, an unknown version, the checkpoint of something else, or a
                missing, extra or misshapen tensor, one of another dtype, not finite, or lengths
                that do not add up.
        """
        fields, tensors = load_checkpoint(folder, "SchemaNetwork")
        network = cls(SchemaNetworkConfig.from_dict(fields))
        check_structure(network, tensors)
        network.to(tensors["pool.percept"].dtype).load_state_dict(tensors)
        lengths = network.lengths
        if bool((lengths < 1).any()) or int(lengths.sum()) != len(network.pool):
            raise ValueError(
                f"expected lengths ≥ 1 of {len(network.pool)} rows in all in '{folder}', "
                f"got {lengths.tolist()}"
            )
        network.forward_model = forward_model
        return network

    def _scale(self, percepts: Tensor) -> Tensor:
        """Check percepts and scale them for distances."""
        columns = self.config.percept_dimensions
        scaled = check_rows("percepts", percepts, columns, self.scale) * self.scale
        return check_rows("scaled percepts", scaled, columns, self.scale)

    def _compete(self, percepts: Tensor) -> SchemaDecision:
        """Do what `recall` does, but do not remember the last winner."""
        activity = self(percepts)
        winner = self.competition.over_time(activity.confidence, self._incumbent)
        target, has_target = _of_winner(winner, activity.targets, torch.nan), winner != NO_SCHEMA
        return SchemaDecision(target, has_target, winner, activity, torch.zeros_like(has_target))

    def _command(
        self, model: ForwardModel, decision: SchemaDecision, states: Tensor
    ) -> tuple[Tensor, Tensor]:
        """Return the schemas' commands `[T, S, U]`, and whether they have one, bool `[T, S]`."""
        active = decision.activity.active
        targets = decision.activity.targets.where(active[:, :, None], decision.target[:, None])
        commands = states.new_full((*active.shape, model.action_dimensions), torch.nan)
        has_command = torch.zeros_like(active)
        # One sample after the other, because a forward model may have a state, as a PID has.
        for sample in decision.has_target.nonzero().flatten().tolist():
            state = states[sample].repeat(len(self), 1)
            commands[sample], has_command[sample] = model.command(state, targets[sample])
        has_command &= active
        return commands.where(has_command[:, :, None], torch.nan), has_command

    def _nearest(self, percepts: Tensor) -> Tensor:
        """Return the index in each sequence of the percept nearest to scaled ones, `[B, S]`."""
        if len(self) == 0:
            return torch.zeros(len(percepts), 0, dtype=torch.int64, device=percepts.device)
        pool, lengths = self.pool.live("percept"), self.lengths
        offsets = torch.arange(int(lengths.max()), device=percepts.device)
        # After a sequence's end its last row is repeated; `argmin` returns the first of them.
        rows = self._starts()[:, None] + offsets.minimum(lengths[:, None] - 1)  # [S, L]
        nearest = []
        for part in percepts.split(max(1, _SEARCH_ELEMENTS // pool.numel())):
            squared = (part[:, None] - pool).square().sum(dim=2)  # [part, rows]
            nearest.append(squared[:, rows].argmin(dim=2))
        return torch.cat(nearest)

    def _starts(self) -> Tensor:
        """Return the first row of each sequence in the pool, int64 `[S]`."""
        return self.lengths.cumsum(dim=0) - self.lengths

    def _sequence(self, column: str, schema: int) -> Tensor:
        index = check_index("a schema", schema, len(self))
        return self.pool.live(column).split(self.lengths.tolist())[index]


def _of_winner(winner: Tensor, values: Tensor, default: float | bool) -> Tensor:
    """Return the winner's row of values `[T, S, ...]`, or the default without a winner."""
    chosen = values.new_full((len(winner), *values.shape[2:]), default)
    has_winner = winner != NO_SCHEMA
    chosen[has_winner] = values[has_winner, winner[has_winner]]
    return chosen


def _reset_after_load(network: nn.Module, _incompatible_keys: object) -> None:
    # The index of the last winner means nothing among the loaded schemas.
    assert isinstance(network, SchemaNetwork)
    network.reset()
