"""An affine forward model, fitted in closed form to as little as one demonstration.

Over a few frames the state of a robot changes nearly linearly with what is commanded: with the way
from the present place to a commanded one, with a displacement or with a speed. It also goes on as
it has just moved. Such a model has few coefficients, so one demonstration is enough; its inverse is
the forward model.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from pacnet.core.drafts import BufferVersions, Lock
from pacnet.core.growable_rows import copy_on_state_dict
from pacnet.core.integrity import check_conditions, check_structure
from pacnet.core.interrupts import defer_sigint
from pacnet.core.validation import check_row
from pacnet.forward_models.affine_arrays import AffineArrays, action_for, arrays_of
from pacnet.forward_models.affine_fit import Law, fit_law
from pacnet.forward_models.affine_rows import mean_ahead
from pacnet.forward_models.config import AffineForwardModelConfig
from pacnet.forward_models.protocol import Command
from pacnet.forward_models.saved_model import WholeModel

_SHAPES = {
    "gain": "SU", "lag": "SS", "drift": "S", "inverse": "US", "moves": "U",
    "residual_variance": "S", "explained": "S", "lowest": "U", "highest": "U", "mean_action": "U",
}  # fmt: skip
_LEARNED = tuple(_SHAPES)


class AffineForwardModel(WholeModel):
    """Predicts the change of the state over `lead` frames; inverts the prediction.

    With states s, the mean action a over the frames t … t + L − 1, and u = a, or u = a − s[t] where
    an action is a place of the state:

        s[t + L] − s[t] = gain u + lag (s[t] − s[t − 1]) + drift

    `command` returns the action of the least error, each dimension's divided by its standard
    deviation on held-out frames, within the range of the actions shown. Actions that do not move
    the state, such as a gripper's beside a hand's place, are the mean of those shown; a caller that
    knows better replaces them, where `moves` is False. Before `fit` there is no action.

    It keeps the last state for the change since then: call it at every frame, and `reset` between
    episodes.

    Args:
        config: see `AffineForwardModelConfig`.

    Example:
        >>> push = torch.randn(60, 1, generator=torch.Generator().manual_seed(0))
        >>> place = torch.cat([torch.zeros(1, 1), 0.1 * push.cumsum(0)[:-1]])
        >>> model = AffineForwardModel(AffineForwardModelConfig(1, 1, lead=1, follows=(-1,)))
        >>> model.fit([place], [push]).round(decimals=2)
        tensor([1.])
        >>> model.command(torch.tensor([[0.5]]), torch.tensor([[0.6]])).action.round(decimals=1)
        tensor([[1.]])
    """

    config_type = AffineForwardModelConfig
    float_tensor = checked_like = "gain"

    config: AffineForwardModelConfig
    gain: Tensor  # [S, U]
    lag: Tensor  # [S, S]
    drift: Tensor  # [S]
    inverse: Tensor  # [U, S]
    moves: Tensor  # bool [U], whether an action moves the state
    residual_variance: Tensor  # [S], of held-out changes
    explained: Tensor  # [S], share of held-out changes
    lowest: Tensor  # [U], of the actions shown, as the two below
    highest: Tensor
    mean_action: Tensor
    last: Tensor  # [B, S], the last states; no rows at the beginning of an episode

    def __init__(self, config: AffineForwardModelConfig) -> None:
        super().__init__(config)
        sizes = {"S": config.state_dimensions, "U": config.action_dimensions}
        for name, letters in _SHAPES.items():
            shape = [sizes[letter] for letter in letters]
            dtype = torch.bool if name == "moves" else None
            self.register_buffer(name, torch.zeros(shape, dtype=dtype))
        self.register_buffer("last", torch.zeros(0, sizes["S"]), persistent=False)
        self._lock = Lock()  # held while learned tensors are read or replaced
        self._cache: tuple[BufferVersions, AffineArrays] | None = None
        copy_on_state_dict(self)

    @property
    def action_dimensions(self) -> int:
        """Length U of an action."""
        return self.config.action_dimensions

    def fit(self, states: Sequence[Tensor], actions: Sequence[Tensor]) -> Tensor:
        """Learn from episodes, in eval mode too; an earlier fit is replaced.

        Args:
            states: of each episode, `[T, S]`, one row a frame.
            actions: of each, `[T, U]`.

        Returns:
            The share of the changes over `lead` frames, in blocks of frames held out, that is
            predicted in each dimension, `[S]`; 0 for a prediction of no change.

        Raises:
            ValueError: fewer than `5 · lead + 1` frames of an episode, no episodes, a tensor of the
                wrong shape, dtype or device, or not finite, or unequal numbers of rows; nothing has
                been learned then.
        """
        if len(states) == 0 or len(states) != len(actions):
            raise ValueError(
                f"expected states and actions of one or more episodes, got {len(states)} and "
                f"{len(actions)}"
            )
        for state, action in zip(states, actions, strict=True):
            self._check(states=state, actions=action)
        places, sent = ([_array(one) for one in rows] for rows in (states, actions))
        config = self.config
        law = fit_law(places, sent, config.follows, config.lead, config.turns)
        with torch.inference_mode(False), defer_sigint(), self._lock:
            self._buffers.update(self._tensors(law, np.concatenate(sent)))
        return self.explained.clone()

    def _tensors(self, law: Law, actions: NDArray[np.float64]) -> dict[str, Tensor]:
        """Return the buffers of a law and of the actions shown, `[T, U]`."""
        learned: dict[str, NDArray[Any]] = law._asdict()
        learned["lowest"], learned["highest"] = actions.min(axis=0), actions.max(axis=0)
        learned["mean_action"] = actions.mean(axis=0)
        return {
            name: torch.from_numpy(array.copy()).to(self.get_buffer(name))
            for name, array in learned.items()
        }

    def forward(self, states: Tensor, velocities: Tensor, actions: Tensor) -> Tensor:
        """Predict the change over `lead` frames, `[B, S]`.

        Args:
            states: `[B, S]`.
            velocities: their change since the last frame, `[B, S]`.
            actions: held until then, or the mean of those, `[B, U]`.

        Raises:
            ValueError: as `command`.
        """
        self._check(states=states, velocities=velocities, actions=actions)
        return (actions - self._places(states)) @ self.gain.T + velocities @ self.lag.T + self.drift

    def residual(self, states: Tensor, actions: Tensor) -> Tensor:
        """Return by what an episode's changes over `lead` frames differ from those predicted.

        Args:
            states: `[T, S]`, one row a frame.
            actions: `[T, U]`.

        Returns:
            `[T, S]`, 0 in the last `lead` rows.

        Raises:
            ValueError: as `command`.
        """
        self._check(states=states, actions=actions)
        lead, residual = self.config.lead, torch.zeros_like(states)
        if len(states) > lead:
            now, sent = states[:-lead], mean_ahead(_array(actions), lead)
            velocities = torch.diff(now, dim=0, prepend=now[:1])
            predicted = self(now, velocities, torch.from_numpy(sent).to(states))
            residual[:-lead] = states[lead:] - now - predicted
        return residual

    @torch.no_grad()
    def command(self, states: Tensor, targets: Tensor) -> Command:
        """Return the actions that lead from states `[B, S]` to targets `[B, S]` in `lead` frames.

        Raises:
            ValueError: a tensor of the wrong shape, dtype or device, without rows, or not finite;
                unequal numbers of rows, or others than before without a `reset` between.
        """
        self._check(states=states, targets=targets)
        last = self.last if len(self.last) else states
        if last.shape != states.shape:
            raise ValueError(
                f"expected {len(last)} states, as before, or a reset between, got {len(states)}"
            )
        with self._lock:
            change = targets - states - (states - last) @ self.lag.T - self.drift
            action = (change @ self.inverse.T + self._places(states)).clamp(
                self.lowest, self.highest
            )
            action = action.where(self.moves, self.mean_action)
            has_action = self.moves.any().expand(len(states)).clone()
        self.last = states.detach().clone()
        return Command(action.where(has_action[:, None], torch.nan), has_action)

    def command_one(
        self, state: NDArray[np.float32] | Tensor, target: NDArray[np.float32] | Tensor
    ) -> NDArray[np.float32] | None:
        """Return the action `[U]` that `command` gives, in microseconds; None before `fit`.

        State and target are float32 `[S]`, arrays or tensors on the CPU.

        Raises:
            ValueError: a state or target of the wrong shape, dtype or device, or not finite.
        """
        columns, arrays = self.config.state_dimensions, self.arrays()
        rows = (check_row("state", state, columns), check_row("target", target, columns))
        now, end = (row.astype(np.float64) for row in rows)
        if not (np.isfinite(now).all() and np.isfinite(end).all()):
            raise ValueError(f"expected finite states and targets, got {now} and {end}")
        if not arrays.moves.any():
            return None
        last = self.last.double().numpy(force=True)
        velocity = now - last[0] if len(last) else np.zeros(columns)
        action = action_for(arrays, now, velocity, end)
        self.last = torch.from_numpy(now)[None].to(self.gain)
        return action.astype(np.float32)

    def explained_together(self, dimensions: int) -> float:
        """Return the share of the changes of the first dimensions, all in one unit, predicted.

        Each counts by how much it changes: one in which there is only noise hardly does.
        """
        with self._lock:
            left = self.residual_variance[:dimensions].double()
            share = 1 - self.explained[:dimensions].double()
        square = torch.where(left > 0, left / share, 0.0).sum()
        return float(1 - left.sum() / square) if square > 0 else 0.0

    def reset(self) -> None:
        """Start an episode, with any number of rows: forget the last states."""
        self.last = self.gain.new_zeros(0, self.config.state_dimensions)

    def arrays(self) -> AffineArrays:
        """Return what compiled callers need; the same object until a tensor changes."""
        with self._lock:
            cached = self._cache
            if cached is None or not cached[0].unchanged():
                versions = BufferVersions(single=[(self, name) for name in _LEARNED])
                self._cache = cached = versions, arrays_of(self)
        return cached[1]

    def _places(self, states: Tensor) -> Tensor:
        place = torch.tensor(self.config.follows, device=states.device)
        return states[:, place.clamp(min=0)].where(place >= 0, 0.0)

    def load_state_dict(
        self, state_dict: Mapping[str, Any], strict: bool = True, assign: bool = False
    ) -> Any:
        """Load tensors, all or none, while no other thread reads them."""
        with self._lock:
            return super().load_state_dict(state_dict, strict, assign)

    def check_state(self, tensors: Mapping[str, Tensor]) -> None:
        """Raise a ValueError unless these tensors, of a `state_dict`, are the state of one."""
        check_structure(self, tensors)
        floats = {name: tensors[name] for name in _LEARNED if name != "moves"}
        still = ~tensors["moves"]
        check_conditions(
            {f"a finite {name}": tensor.isfinite().all() for name, tensor in floats.items()}
            | {
                "a residual variance ≥ 0": (tensors["residual_variance"] >= 0).all(),
                "explained shares ≤ 1": (tensors["explained"] <= 1).all(),
                "lowest ≤ highest": (tensors["lowest"] <= tensors["highest"]).all(),
                "no gain of actions that move nothing": (tensors["gain"][:, still] == 0).all(),
                "no inverse of actions that move nothing": (tensors["inverse"][still] == 0).all(),
            }
        )


def _array(rows: Tensor) -> NDArray[np.float64]:
    return rows.detach().double().numpy(force=True)
