"""The schema network, the paper's first system: perceptual-motor pairs that are given by hand.

Source: Maistros, Marom & Hayes (2001), section "Implementation", Figures 1 and 2. A perceptual
schema is a sequence of percepts and has a confidence in what it sees; its motor schema is a
sequence of internal targets, as long. Where the parts of a behaviour begin and end is the
designer's arbitrary choice, which is what attention (`PACNet`) does away with.
"""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import NamedTuple

import torch
from torch import Tensor, nn

from pacnet.competition.winner_take_all import NO_SCHEMA, Competition
from pacnet.core.checkpoint import load_checkpoint, save_checkpoint
from pacnet.core.growable_rows import Column, GrowableRows
from pacnet.core.integrity import check_structure
from pacnet.core.validation import check_rows
from pacnet.forward_models.candidates import check_equally_many
from pacnet.forward_models.protocol import ForwardModel
from pacnet.network.schema_network_config import SchemaNetworkConfig

_SEARCH_ELEMENTS = 2**24  # differences held at once while searching: 64 MB


class SchemaActivity(NamedTuple):
    """What S schemas make of each of B percepts."""

    confidence: Tensor
    """Of each perceptual schema, `[B, S]`, in [0, 1]."""
    active: Tensor
    """Whether it is confident enough for its motor schema to be active, bool `[B, S]`."""
    position: Tensor
    """Place of the nearest percept in each schema's sequence, int64 `[B, S]`."""
    targets: Tensor
    """The internal target at that place, `[B, S, A]`; NaN where the motor schema is not active."""


class SchemaRecall(NamedTuple):
    """What the network recalls for each percept. T percepts."""

    targets: Tensor
    """The winner's internal target, `[T, A]`; a row of NaN where nobody wins."""
    commanded: Tensor
    """Whether somebody wins, bool `[T]`."""
    winner: Tensor
    """The schema that wins, int64 `[T]`, or `NO_SCHEMA`."""
    activity: SchemaActivity
    """Of all schemas."""


class SchemaAction(NamedTuple):
    """What the network would do on each percept. T percepts."""

    action: Tensor
    """The winner's command, `[T, U]`; NaN where none is given and the caller's default acts."""
    given: Tensor
    """Whether there is an action, bool `[T]`."""
    candidates: Tensor
    """The command of every schema, `[T, S, U]`; NaN where it is not active or has none."""
    recall: SchemaRecall
    """What was recalled."""


class SchemaNetwork(nn.Module):
    """Perceptual-motor pairs that compete for the body.

    The confidence of a perceptual schema is exp(−d / width), d the Euclidean distance from the
    scaled percept to the nearest one of its sequence; of equally near ones the first.

    Args:
        config: see `SchemaNetworkConfig`.
        forward_model: turns targets into commands. It belongs to the body and not to the schemas,
            so checkpoints of the network leave it out.

    Raises:
        ValueError: a forward model that is none.

    Example:
        >>> network = SchemaNetwork(SchemaNetworkConfig(1, 1))
        >>> first = network.add_schema(torch.tensor([[0.0], [1.0]]), torch.tensor([[5.0], [6.0]]))
        >>> second = network.add_schema(torch.tensor([[3.0]]), torch.tensor([[7.0]]))
        >>> recall = network.recall(torch.tensor([[1.0], [2.5]]))
        >>> recall.winner, recall.targets.flatten()
        (tensor([0, 1]), tensor([6., 7.]))
    """

    scale: Tensor

    def __init__(
        self, config: SchemaNetworkConfig, forward_model: ForwardModel | None = None
    ) -> None:
        super().__init__()
        if forward_model is not None and not isinstance(forward_model, ForwardModel):
            got = type(forward_model).__name__
            raise ValueError(f"expected forward_model as a ForwardModel or None, got {got}")
        self.config = config
        self.forward_model = forward_model
        self.competition = Competition(config.competition)
        self.pool = GrowableRows(  # all sequences, one after the other
            {
                "percept": Column((config.percept_dimensions,), torch.float32),  # scaled
                "target": Column((config.target_dimensions,), torch.float32),
            }
        )
        self.sequences = GrowableRows({"length": Column((), torch.int64)})
        scale = (1.0,) * config.percept_dimensions if config.scale is None else config.scale
        self.register_buffer("scale", torch.tensor(scale), persistent=False)
        self.register_load_state_dict_post_hook(_start_afresh)
        self._incumbent = NO_SCHEMA

    def __len__(self) -> int:
        """The number S of schemas."""
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
        """The schema's percepts in order, in the percept's units, `[L, D]`."""
        return self.pool.live("percept")[self._rows(schema)] / self.scale

    def targets(self, schema: int) -> Tensor:
        """The schema's internal targets in order, `[L, A]`."""
        return self.pool.live("target")[self._rows(schema)]

    @torch.no_grad()
    def add_schema(self, percepts: Tensor, targets: Tensor) -> int:
        """Adds one perceptual schema with its motor schema, and starts a new episode.

        Args:
            percepts: what it recognises, `[L, D]`, in order of time.
            targets: the internal target that goes with each percept, `[L, A]`.

        Returns:
            The schema's number.

        Raises:
            ValueError: percepts or targets of the wrong shape, dtype or device, empty, not finite,
                or not equally many; nothing has been added then.
        """
        scaled = self._scaled(percepts)
        check_rows("targets", targets, self.config.target_dimensions, self.pool.live("target"))
        check_equally_many(percepts=percepts, targets=targets)
        # Growing inside a caller's inference mode would make buffers nobody can update later.
        with torch.inference_mode(False):
            first = self.pool.extend(len(scaled))
            self.pool.live("percept")[first:] = scaled
            self.pool.live("target")[first:] = targets.detach()
            schema = self.sequences.append({"length": len(scaled)})
        self.reset()
        return schema

    def forward(self, percepts: Tensor) -> SchemaActivity:
        """Reads the schemas: confidence, place and current target of each for each percept.

        Args:
            percepts: `[B, D]` in the units that `config.scale` expects.

        Raises:
            ValueError: percepts of the wrong shape, dtype or device, empty, or not finite.
        """
        scaled = self._scaled(percepts)
        with torch.no_grad():
            position = self._nearest(scaled)  # [B, S]
        rows = self._starts() + position
        apart = scaled[:, None] - self.pool.live("percept")[rows]  # [B, S, D]
        confidence = torch.exp(-torch.linalg.vector_norm(apart, dim=2) / self.config.width)
        active = confidence >= self.config.competition.threshold
        targets = self.pool.live("target")[rows].where(active[:, :, None], torch.nan)
        return SchemaActivity(confidence, active, position, targets)

    @torch.no_grad()
    def recall(self, percepts: Tensor) -> SchemaRecall:
        """The winner and its current target for each percept, going on from the last call.

        Where no schema is active nothing is commanded. `reset` starts a new episode.

        Args:
            percepts: `[T, D]`, in order of time.

        Raises:
            ValueError: percepts as in `forward`; the episode is where it was then.
        """
        recall = self._compete(percepts)
        self._incumbent = int(recall.winner[-1])
        return recall

    @torch.no_grad()
    def act(self, percepts: Tensor, states: Tensor) -> SchemaAction:
        """The candidate command of every active motor schema, and the winner's as the action.

        The forward model is asked once a sample, for S states and targets: a row a schema, always
        the same one, so that a model with a memory has one for each schema. A `PIDController`
        then has an integral for each schema, which behaves so:

        - of an active schema it sums the error of that schema's own target. Where another one wins,
          nothing removes this error, and it sums up to `integral_limit`; the schema takes over with
          at most `ki * integral_limit` of it in its command.
        - an inactive schema is asked for the winner's target, and its answer is dropped. So its
          integral keeps pace with the winner's, holding what the body's weight asks for, and it
          does not take over with an error of its own from long ago.
        - where nobody wins, no command is asked for and all integrals stay.

        Args:
            percepts: `[T, D]`, in order of time; goes on from the last call, as `recall` does.
            states: the robot's state at each percept, from which the forward model starts,
                `[T, K]`; for a `PIDController` joint angles, then velocities.

        Raises:
            ValueError: no forward model; percepts as in `forward`; not one finite state for each
                percept; states that the forward model refuses. The episode is where it was then.
        """
        model = self.forward_model
        if model is None:
            raise ValueError(
                "expected a forward model to act with, got SchemaNetwork(config) without one"
            )
        recall = self._compete(percepts)
        columns = states.shape[1] if isinstance(states, Tensor) and states.dim() == 2 else 1
        check_rows("states", states, columns, like=percepts)
        check_equally_many(percepts=percepts, states=states)
        candidates, given = self._candidates(model, recall, states)
        self._incumbent = int(recall.winner[-1])
        action = _of_winner(recall.winner, candidates, torch.nan)
        return SchemaAction(action, _of_winner(recall.winner, given, False), candidates, recall)

    def reset(self) -> None:
        """Starts a new episode: nobody has won yet; the forward model starts afresh too."""
        self._incumbent = NO_SCHEMA
        if self.forward_model is not None:
            self.forward_model.reset()

    def save_pretrained(self, folder: str | Path) -> None:
        """Writes `config.json` and `model.safetensors`; a kill leaves the old or the new ones.

        Args:
            folder: made if it is missing; a checkpoint in it is replaced, other files stay.

        Raises:
            ValueError: a tensor that is not finite; nothing has been written.
        """
        bare = SchemaNetwork(self.config).to(self.scale.dtype)  # without the forward model
        own = self.state_dict()
        bare.load_state_dict({n: t for n, t in own.items() if not n.startswith("forward_model.")})
        save_checkpoint(folder, "SchemaNetwork", asdict(self.config), bare.state_dict())

    @classmethod
    def from_pretrained(
        cls, folder: str | Path, forward_model: ForwardModel | None = None
    ) -> SchemaNetwork:
        """Loads what `save_pretrained` wrote, on the CPU.

        Args:
            folder: of the checkpoint.
            forward_model: to act with.

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

    def _scaled(self, percepts: Tensor) -> Tensor:
        """Checks percepts and brings them to the units in which distances are taken."""
        checked = check_rows("percepts", percepts, self.config.percept_dimensions, self.scale)
        scaled = checked * self.scale
        return check_rows("scaled percepts", scaled, self.config.percept_dimensions, self.scale)

    def _compete(self, percepts: Tensor) -> SchemaRecall:
        """`recall` without remembering who won."""
        activity = self(percepts)
        winner = self.competition.over_time(activity.confidence, self._incumbent)
        targets = _of_winner(winner, activity.targets, torch.nan)
        return SchemaRecall(targets, winner != NO_SCHEMA, winner, activity)

    def _candidates(
        self, model: ForwardModel, recall: SchemaRecall, states: Tensor
    ) -> tuple[Tensor, Tensor]:
        """Commands `[T, S, U]`, and which schemas have one, bool `[T, S]`."""
        active, own = recall.activity.active, recall.activity.targets
        wanted = own.where(active[:, :, None], recall.targets[:, None])  # [T, S, A]
        commands = states.new_full((*active.shape, model.action_dimensions), torch.nan)
        given = torch.zeros_like(active)
        # One sample after the other: a forward model may have a memory, as a PID has.
        for sample in recall.commanded.nonzero().flatten().tolist():
            here = states[sample].repeat(len(self), 1)
            commands[sample], given[sample] = model.command(here, wanted[sample])
        given &= active
        return commands.where(given[:, :, None], torch.nan), given

    def _nearest(self, percepts: Tensor) -> Tensor:
        """Place of the percept nearest to each of scaled ones in each sequence, int64 `[B, S]`."""
        if len(self) == 0:
            return torch.zeros(len(percepts), 0, dtype=torch.int64, device=percepts.device)
        pool, lengths = self.pool.live("percept"), self.lengths
        places = torch.arange(int(lengths.max()), device=percepts.device)
        # Past a sequence's end its last row again, which never comes before itself.
        rows = self._starts()[:, None] + places.minimum(lengths[:, None] - 1)  # [S, L]
        chunk = max(1, _SEARCH_ELEMENTS // pool.numel())
        nearest = []
        for part in percepts.split(chunk):
            distance = (part[:, None] - pool).square().sum(dim=2)  # [chunk, rows], squared
            nearest.append(distance[:, rows].argmin(dim=2))
        return torch.cat(nearest)

    def _starts(self) -> Tensor:
        """First row of each sequence in the pool, int64 `[S]`."""
        return self.lengths.cumsum(dim=0) - self.lengths

    def _rows(self, schema: int) -> slice:
        if not 0 <= schema < len(self):
            raise ValueError(f"expected a schema from 0 to {len(self) - 1}, got {schema}")
        start, length = int(self._starts()[schema]), int(self.lengths[schema])
        return slice(start, start + length)


def _of_winner(winner: Tensor, values: Tensor, nobodys: float | bool) -> Tensor:
    """The winner's of values `[T, S, ...]`, and `nobodys` where nobody wins, `[T, ...]`."""
    chosen = values.new_full((len(winner), *values.shape[2:]), nobodys)
    won = winner != NO_SCHEMA
    chosen[won] = values[won, winner[won]]
    return chosen


def _start_afresh(network: nn.Module, _incompatible_keys: object) -> None:
    """Who won among the schemas that were here before means nothing among the loaded ones."""
    assert isinstance(network, SchemaNetwork)
    network.reset()
