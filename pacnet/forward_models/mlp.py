"""A forward model learned from random actions: a small network predicts how the state changes.

Source: Maistros, Marom & Hayes (2001), Experiment 2, which uses a matrix of state transitions
(`TransitionMatrix`). A network generalises between states. It predicts the change and not the next
state: that is nearly the present state, so a model of it could be nearly right without the action.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from pacnet.core.interrupts import defer_sigint
from pacnet.core.validation import check_row
from pacnet.forward_models.candidates import CandidateModel, kernels
from pacnet.forward_models.config import MLPForwardModelConfig
from pacnet.forward_models.fitting import (
    FitReport,
    Progress,
    mean_and_std,
    r2_of_change,
    split_by_blocks,
    train,
)
from pacnet.forward_models.mlp_arrays import NORMALISERS, MLPArrays, MLPArraysCache

_UNBOUNDED = torch.finfo(torch.float32).max


class MLPForwardModel(CandidateModel):
    """Predicts the change of the state; chooses the action predicted to come nearest to a target.

    Predicted states are clamped to the range of the states in the training data, because a
    prediction of several steps would drift away outside of it.

    Before `fit`, the weights are random, the normalisers 0 and 1, and the range unbounded. States,
    actions and targets have the dtype of the weights; the normalisers stay float64 if the module
    is cast.

    Args:
        config: see `MLPForwardModelConfig`.
        seed: of the initial weights.

    Example:
        >>> states, actions = torch.rand(200, 1), torch.rand(200, 1)
        >>> config = MLPForwardModelConfig(1, 1, candidates=((0.0,), (1.0,)), hidden=())
        >>> model = MLPForwardModel(config)
        >>> report = model.fit(states, actions, states + 2 * actions, seed=0)
        >>> model.select(torch.tensor([0.5]), torch.tensor([2.4])).action
        tensor([1.])
    """

    config_type = MLPForwardModelConfig
    float_tensor = "network.0.weight"

    state_mean: Tensor  # float64 [S], as all below but for the action's, [U]
    state_std: Tensor
    action_mean: Tensor
    action_std: Tensor
    change_mean: Tensor
    change_std: Tensor
    state_low: Tensor
    state_high: Tensor

    def __init__(self, config: MLPForwardModelConfig, *, seed: int = 0) -> None:
        super().__init__(config)
        self.network = _make_network(config, torch.Generator().manual_seed(seed))
        starts = {"mean": 0.0, "std": 1.0, "low": -_UNBOUNDED, "high": _UNBOUNDED}
        for name in NORMALISERS:
            of, kind = name.split("_")
            size = config.action_dimensions if of == "action" else config.state_dimensions
            self.register_buffer(name, torch.full((size,), starts[kind], dtype=torch.float64))
        self._arrays = MLPArraysCache()

    def forward(self, states: Tensor, actions: Tensor) -> Tensor:
        """Predict the change `[B, S]` of states `[B, S]` in one time step of actions `[B, U]`.

        Raises:
            ValueError: as `command`.
        """
        self._check(states=states, actions=actions)
        return self._predict_change(states, actions)

    def predict(self, states: Tensor, actions: Tensor) -> Tensor:
        """Predict the states `[B, S]` after `config.steps` time steps of actions `[B, U]`.

        Raises:
            ValueError: as `forward`.
        """
        self._check(states=states, actions=actions)
        return self._predict(states, actions)

    def outcomes(self, states: Tensor, candidates: Tensor) -> Tensor:
        """Predict the states `[B, K, S]` after each candidate, see `CandidateModel`."""
        repeated = states.repeat_interleave(len(candidates), dim=0)
        after = self._predict(repeated, candidates.repeat(len(states), 1))
        return after.reshape(len(states), len(candidates), -1)

    def command_one(
        self, state: NDArray[np.float32] | Tensor, target: NDArray[np.float32] | Tensor
    ) -> NDArray[np.float32] | None:
        """Return the action `[U]` that `command` gives, in microseconds; None if it abstains.

        State and target are float32 `[S]`, arrays or tensors on the CPU.

        Raises:
            ValueError: a state or target of the wrong shape, dtype or device, or not finite.
        """
        columns = self.config.state_dimensions
        # Copies, because numba compiles a kernel again for every other layout.
        start = check_row("state", state, columns).copy()
        end = check_row("target", target, columns).astype(np.float64)
        with self._lock:
            arrays = self._get_arrays()
            if arrays is not None:
                best, _, _, abstained = kernels().decide(*arrays, start, end)
                if best >= 0:
                    return None if abstained else arrays.candidates[best].copy()
            # Without a best candidate: `command` refuses rows that are not finite.
            rows = (torch.from_numpy(row)[None].to(self.candidates) for row in (start, end))
            action, has_action = self.command(*rows)
        return action[0].float().numpy(force=True) if bool(has_action) else None

    def _choose(self, states: Tensor, targets: Tensor, candidates: Tensor) -> list[Any]:
        with self._lock:
            arrays = self._get_arrays()
            if arrays is None:
                return super()._choose(states, targets, candidates)
            # Contiguous, because numba compiles a kernel again for every other layout.
            offered, starts, ends = (
                rows.detach().contiguous().numpy()
                for rows in (candidates, states, targets.double())
            )
            arrays, decide = arrays._replace(candidates=offered), kernels().decide
            return [decide(*arrays, *pair) for pair in zip(starts, ends, strict=True)]

    def _get_arrays(self) -> MLPArrays | None:
        return self._arrays.get(self.config, self.network, self._buffers)

    def check_values(self, tensors: Mapping[str, Tensor]) -> None:
        """Raise a ValueError if a std is not positive, or the range ends before it begins."""
        for name in ("state_std", "action_std", "change_std"):
            if bool((tensors[name] <= 0).any()):
                raise ValueError(f"expected {name} > 0, got {tensors[name].tolist()}")
        low, high = tensors["state_low"], tensors["state_high"]
        if bool((low > high).any()):
            got = f"{low.tolist()}, {high.tolist()}"
            raise ValueError(f"expected state_low ≤ state_high, got {got}")

    def fit(
        self,
        states: Tensor,
        actions: Tensor,
        next_states: Tensor,
        *,
        seed: int,
        progress: Progress | None = None,
    ) -> FitReport:
        """Learn from transitions, in eval mode too; an earlier fit is replaced.

        A fifth of the blocks of 50 successive transitions is held out. The fit ends when their
        loss has not fallen for 20 epochs, or after 200 epochs, and the best weights are kept. It
        runs in float32 on the CPU, which is fastest for such small networks; the same seed gives
        the same bytes. A Ctrl-C leaves the model unchanged.

        Args:
            states: `[T, S]`, in order of time.
            actions: `[T, U]`.
            next_states: `[T, S]`, one time step later.
            seed: of the weights, the blocks and the minibatches.
            progress: see `pacnet.forward_models.fitting.Progress`.

        Raises:
            ValueError: fewer than 100 transitions, wrong shape, dtype or device, not finite, or
                unequal numbers of rows; nothing has been learned then.
        """
        self._check(states=states, actions=actions, next_states=next_states)
        # A caller's inference mode would keep gradients from being computed.
        with torch.inference_mode(False), torch.enable_grad():
            before, actions, after = (
                rows.detach().to("cpu", torch.float64, copy=True)
                for rows in (states, actions, next_states)
            )
            fitted, generator = MLPForwardModel(self.config), torch.Generator().manual_seed(seed)
            report = fitted._fit((before, actions, after - before), generator, progress)
            with defer_sigint():
                self.load_state_dict(fitted.state_dict())
        return report

    def _fit(
        self, transitions: tuple[Tensor, ...], generator: torch.Generator, progress: Progress | None
    ) -> FitReport:
        """Fit this new model to states, actions and changes, float64 on the CPU."""
        self.network = _make_network(self.config, generator)
        states, actions, changes = transitions
        learning, held_out = split = split_by_blocks(len(changes), generator)
        for name, rows in zip(("state", "action", "change"), transitions, strict=True):
            mean, std = mean_and_std(rows[learning])
            self.get_buffer(f"{name}_mean").copy_(mean)
            self.get_buffer(f"{name}_std").copy_(std)
        seen = torch.cat([states[learning], states[learning] + changes[learning]])
        self.state_low.copy_(seen.amin(dim=0))
        self.state_high.copy_(seen.amax(dim=0))
        x = self._normalise(states, actions)
        y = ((changes - self.change_mean) / self.change_std).to(x.dtype)
        trained = train(self.network, (x, y), split, generator, progress)
        with torch.no_grad():
            predicted = self._predict_change(states[held_out], actions[held_out])
        return FitReport(*trained, held_out, r2_of_change(changes[held_out], predicted))

    def _normalise(self, states: Tensor, actions: Tensor) -> Tensor:
        """Normalise in float64, then round to the dtype of the weights, `[B, S + U]`."""
        state = (states - self.state_mean) / self.state_std
        action = (actions - self.action_mean) / self.action_std
        return torch.cat([state, action], dim=1).to(self.candidates.dtype)

    def _predict_change(self, states: Tensor, actions: Tensor) -> Tensor:
        change = self.network(self._normalise(states, actions))
        return (change * self.change_std + self.change_mean).to(states.dtype)

    def _predict(self, states: Tensor, actions: Tensor) -> Tensor:
        low, high = self.state_low.to(states.dtype), self.state_high.to(states.dtype)
        for _ in range(self.config.steps):
            states = (states + self._predict_change(states, actions)).clamp(low, high)
        return states

    def _apply(self, fn: Callable[[Tensor], Tensor], recurse: bool = True) -> MLPForwardModel:
        """Move or cast the module, as `to` and `float` do, but keep the normalisers in float64."""
        exact = {name: self.get_buffer(name) for name in NORMALISERS}
        super()._apply(fn, recurse)
        for name, buffer in exact.items():
            moved = self.get_buffer(name)
            if moved.dtype != buffer.dtype:
                setattr(self, name, buffer.to(moved.device))
        return self


def _make_network(config: MLPForwardModelConfig, generator: torch.Generator) -> nn.Sequential:
    """Make linear layers with orthogonal weights and SiLU between them."""
    inputs = config.state_dimensions + config.action_dimensions
    layers: list[nn.Module] = []
    for width in itertools.pairwise((inputs, *config.hidden, config.state_dimensions)):
        # A layer made in memory at once would draw from the caller's global generator.
        linear = nn.Linear(*width, device="meta").to_empty(device=torch.get_default_device())
        nn.init.orthogonal_(linear.weight, generator=generator)
        nn.init.zeros_(linear.bias)
        layers += [linear, nn.SiLU()]
    return nn.Sequential(*layers[:-1])
