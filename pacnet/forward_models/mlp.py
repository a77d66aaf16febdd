"""A forward model learned from wandering: a small network predicts how an action changes the state.

Source: Maistros, Marom & Hayes (2001), Experiment 2, where a matrix of state transitions does it
(`TransitionMatrix`). A network generalises between states. It predicts the change, because the
next state is mostly the present one again, and a model could be nearly right without the action.
"""

from __future__ import annotations

import functools
import itertools
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from pacnet.core.interrupts import defer_sigint
from pacnet.core.validation import check_fields, check_rows, is_integer
from pacnet.forward_models.candidates import (
    CandidateModel,
    check_candidate_config,
    check_equally_many,
    kernels,
)
from pacnet.forward_models.fitting import (
    FitReport,
    Progress,
    check_transitions,
    mean_and_std,
    r2_of_change,
    split_by_blocks,
    train,
)
from pacnet.forward_models.mlp_arrays import NORMALISERS, RANGE, MLPArrays
from pacnet.kernels.engine import check_row

_UNBOUNDED = torch.finfo(torch.float32).max


@dataclass(frozen=True)
class MLPForwardModelConfig:
    """Settings of an `MLPForwardModel`.

    Attributes:
        state_dimensions: length S of a state and of a target.
        action_dimensions: length U of an action.
        candidates: the K ≥ 1 actions that `command` chooses from.
        hidden: width of each hidden layer; none makes the model linear.
        steps: number of time steps for which an action is held; the model is fitted to one step
            and goes on from its own prediction.
        abstain_below: spread of the candidates' predicted states, in the state's unit, under
            which no action is given. A single candidate has no spread: it is given only if this
            is 0.

    Raises:
        ValueError: a field of another type or out of range.
    """

    state_dimensions: int
    action_dimensions: int
    candidates: tuple[tuple[float, ...], ...]
    hidden: tuple[int, ...] = (64, 64)
    steps: int = 1
    abstain_below: float = 0.03

    def __post_init__(self) -> None:
        """Turns sequences (JSON reads lists) into tuples and refuses values without meaning."""
        check_candidate_config(self)
        layers = isinstance(self.hidden, tuple | list)
        valid = layers and all(is_integer(width, 1) for width in self.hidden)
        check_fields(self, {"hidden": (valid, "to be a tuple of widths ≥ 1")})
        object.__setattr__(self, "hidden", tuple(self.hidden))


class MLPForwardModel(CandidateModel):
    """Predicts the change of the state; chooses the action predicted to come nearest to a target.

    A predicted state stays within the range of the states that the model was fitted to: beyond it
    nothing is known, and going on from there over several steps would lead farther and farther out.

    Untrained it runs, with unit normalisers and random weights. States, actions and targets have
    the dtype of the weights; the normalisers stay float64 whatever the module is cast to.

    Args:
        config: see `MLPForwardModelConfig`.
        seed: draws the untrained weights.

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

    state_mean: Tensor  # float64 [S]; and so on
    state_std: Tensor
    action_mean: Tensor
    action_std: Tensor
    change_mean: Tensor
    change_std: Tensor
    state_low: Tensor  # float64 [S], of the range
    state_high: Tensor

    def __init__(self, config: MLPForwardModelConfig, *, seed: int = 0) -> None:
        super().__init__(config)
        self.network = _make_network(config, torch.Generator().manual_seed(seed))
        widths = {"action": config.action_dimensions}
        for name in NORMALISERS:
            width = widths.get(name.split("_")[0], config.state_dimensions)
            start = torch.zeros if name.endswith("mean") else torch.ones
            self.register_buffer(name, start(width, dtype=torch.float64))
        for name, bound in zip(RANGE, (-_UNBOUNDED, _UNBOUNDED), strict=True):
            start = torch.full((config.state_dimensions,), bound, dtype=torch.float64)
            self.register_buffer(name, start)
        self._arrays = MLPArrays()

    def forward(self, states: Tensor, actions: Tensor) -> Tensor:
        """Predicts the change of the state in one time step.

        Args:
            states: `[B, S]`.
            actions: `[B, U]`.

        Returns:
            The changes, `[B, S]`.

        Raises:
            ValueError: a tensor of the wrong shape, dtype or device, without rows, or not finite;
                unequal numbers of rows.
        """
        self._check(states, actions)
        return self._change(states, actions)

    def predict(self, states: Tensor, actions: Tensor) -> Tensor:
        """Predicts the states `[B, S]` after each action was held for `config.steps` steps.

        Args:
            states: `[B, S]`.
            actions: `[B, U]`.

        Raises:
            ValueError: as `forward`.
        """
        self._check(states, actions)
        return self._after(states, actions)

    def outcomes(self, states: Tensor, candidates: Tensor) -> Tensor:
        """Predicted states `[B, K, S]`, see `CandidateModel`."""
        repeated = states.repeat_interleave(len(candidates), dim=0)
        after = self._after(repeated, candidates.repeat(len(states), 1))
        return after.reshape(len(states), len(candidates), -1)

    def command_one(
        self, state: NDArray[np.float32] | Tensor, target: NDArray[np.float32] | Tensor
    ) -> NDArray[np.float32] | None:
        """`command` for one state of a control loop, in microseconds, without tensors.

        Args:
            state: `[S]`, float32, an array, or a tensor on the CPU.
            target: `[S]`, as the state.

        Returns:
            The action, `[U]`, or None where it abstains.

        Raises:
            ValueError: a row of the wrong shape, dtype or device, or not finite.
        """
        columns = self.config.state_dimensions
        # Copies, for a kernel is compiled anew for every other layout.
        start = check_row("state", state, columns).copy()
        end = check_row("target", target, columns).astype(np.float64)
        with self._lock:
            arrays = self._arrays.of(self)
            if arrays is not None:
                best, _, _, abstained = kernels().decide(*arrays, start, end)
                if best >= 0:
                    return None if abstained else arrays.candidates[best].copy()
            rows = (torch.from_numpy(row)[None].to(self.candidates) for row in (start, end))
            action, given = self.command(*rows)  # which refuses what is not finite
        return action[0].float().numpy(force=True) if bool(given) else None

    def _choose(self, states: Tensor, targets: Tensor, candidates: Tensor) -> list[Any]:
        with self._lock:
            arrays = self._arrays.of(self)
            if arrays is None:
                return super()._choose(states, targets, candidates)
            # Contiguous, for a kernel is compiled anew for every other layout.
            given = (candidates, states, targets.double())
            plain = [rows.detach().contiguous().numpy() for rows in given]
            kernel = functools.partial(kernels().decide, *arrays._replace(candidates=plain[0]))
            return [kernel(*pair) for pair in zip(*plain[1:], strict=True)]

    def check_learned(self, tensors: Mapping[str, Tensor]) -> None:
        """Raises a ValueError if a std is not positive, or the range ends before it begins."""
        for name in NORMALISERS[1::2]:
            if bool((tensors[name] <= 0).any()):
                raise ValueError(f"expected {name} > 0, got {tensors[name].tolist()}")
        low, high = (tensors[name] for name in RANGE)
        if bool((low > high).any()):
            raise ValueError(
                f"expected state_low ≤ state_high, got {low.tolist()}, {high.tolist()}"
            )

    def fit(
        self,
        states: Tensor,
        actions: Tensor,
        next_states: Tensor,
        *,
        seed: int,
        progress: Progress | None = None,
    ) -> FitReport:
        """Learns from transitions, afresh: what was learned before is replaced, in eval mode too.

        A fifth of the blocks of 50 successive transitions is held out. The fit ends when their
        loss has not fallen for 20 epochs, or after 200, and the best weights stay. It computes in
        float32 on the CPU, where so small a network is fastest and the same seed gives the same
        bytes. A Ctrl-C leaves the model as it was.

        Args:
            states: `[T, S]`, in order of time.
            actions: `[T, U]`.
            next_states: `[T, S]`, one time step later.
            seed: draws the weights, the blocks and the minibatches.
            progress: see `pacnet.forward_models.fitting.Progress`.

        Raises:
            ValueError: fewer than 100 transitions, wrong shape, dtype or device, not finite, or
                unequal numbers of rows; nothing has been learned then.
        """
        columns = self.config.state_dimensions, self.config.action_dimensions
        check_transitions(states, actions, next_states, columns, self.candidates)
        # A caller's inference mode would keep gradients from being computed.
        with torch.inference_mode(False), torch.enable_grad():
            before, actions, after = (
                rows.detach().to("cpu", torch.float64, copy=True)
                for rows in (states, actions, next_states)
            )
            fitted, generator = MLPForwardModel(self.config), torch.Generator().manual_seed(seed)
            report = fitted._fit_afresh((before, actions), after - before, generator, progress)
            with defer_sigint():
                self.load_state_dict(fitted.state_dict())
        return report

    def _check(self, states: Tensor, actions: Tensor) -> None:
        check_rows("states", states, self.config.state_dimensions, self.candidates)
        check_rows("actions", actions, self.config.action_dimensions, self.candidates)
        check_equally_many(states=states, actions=actions)

    def _change(self, states: Tensor, actions: Tensor) -> Tensor:
        change = self.network(self._inputs(states, actions))
        return (change * self.change_std + self.change_mean).to(states.dtype)

    def _after(self, states: Tensor, actions: Tensor) -> Tensor:
        low, high = self.state_low.to(states.dtype), self.state_high.to(states.dtype)
        for _ in range(self.config.steps):
            states = (states + self._change(states, actions)).clamp(low, high)
        return states

    def _inputs(self, states: Tensor, actions: Tensor) -> Tensor:
        """Normalised in float64, then rounded to the dtype of the weights, `[B, S + U]`."""
        state = (states - self.state_mean) / self.state_std
        action = (actions - self.action_mean) / self.action_std
        return torch.cat([state, action], dim=1).to(self.candidates.dtype)

    def _fit_afresh(
        self,
        inputs: tuple[Tensor, Tensor],
        changes: Tensor,
        generator: torch.Generator,
        progress: Progress | None,
    ) -> FitReport:
        """Fits this untrained model; the transitions come as float64 on the CPU."""
        self.network = _make_network(self.config, generator)
        learning, held_out = split_by_blocks(len(changes), generator)
        for name, rows in zip(("state", "action", "change"), (*inputs, changes), strict=True):
            mean, std = mean_and_std(rows[learning])  # of those held out nothing is known
            self.get_buffer(f"{name}_mean").copy_(mean)
            self.get_buffer(f"{name}_std").copy_(std)
        before = inputs[0][learning]
        states = torch.cat([before, before + changes[learning]])
        self.state_low.copy_(states.amin(dim=0))
        self.state_high.copy_(states.amax(dim=0))
        x = self._inputs(*inputs)
        y = ((changes - self.change_mean) / self.change_std).to(x.dtype)
        trained = train(
            self.network,
            (x[learning], y[learning]),
            (x[held_out], y[held_out]),
            generator,
            progress,
        )
        with torch.no_grad():
            predicted = self._change(*(rows[held_out] for rows in inputs))
        return FitReport(*trained, held_out, r2_of_change(changes[held_out], predicted))

    def _apply(self, fn: Callable[[Tensor], Tensor], recurse: bool = True) -> MLPForwardModel:
        """What `to`, `float` and their like call: normalisers move between devices, undegraded."""
        exact = {name: self.get_buffer(name) for name in (*NORMALISERS, *RANGE)}
        super()._apply(fn, recurse)
        for name, buffer in exact.items():
            moved = self.get_buffer(name)
            if moved.dtype != buffer.dtype:
                setattr(self, name, buffer.to(moved.device))
        return self


def _make_network(config: MLPForwardModelConfig, generator: torch.Generator) -> nn.Sequential:
    """Linear layers, orthogonal at first, with SiLU between them."""
    inputs = config.state_dimensions + config.action_dimensions
    layers: list[nn.Module] = []
    for width in itertools.pairwise((inputs, *config.hidden, config.state_dimensions)):
        # A layer made in memory at once would draw from the caller's global generator.
        linear = nn.Linear(*width, device="meta").to_empty(device=torch.get_default_device())
        nn.init.orthogonal_(linear.weight, generator=generator)
        nn.init.zeros_(linear.bias)
        layers += [linear, nn.SiLU()]
    return nn.Sequential(*layers[:-1])
