"""The compiled engine of the learned forward model: tells the kernels where its tensors lie.

Imported only where it runs, for it brings numba.
"""

from __future__ import annotations

import itertools
from operator import itemgetter
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from pacnet import mlp_kernels as kernels
from pacnet.engine import Memory

if TYPE_CHECKING:
    from pacnet.mlp_forward_model import MLPForwardModel, MLPForwardModelConfig

_buffers_of = itemgetter(*kernels.BUFFERS)


class CompiledMLP:
    """Chooses for a model in one state, by the tensors that it has at that moment."""

    def __init__(self) -> None:
        self._memory = Memory()
        self._parts: tuple[Any, ...] = ()  # config and modules that were looked up last
        self._candidates: NDArray[np.float32] | None = None  # [K, U]; None if kernels cannot run

    def command_one(
        self, model: MLPForwardModel, state: NDArray[np.float32], target: NDArray[np.float32]
    ) -> NDArray[np.float32] | None:
        """As `MLPForwardModel.command_one`, of rows that are checked but for being finite.

        The model's `command` answers where the kernels cannot: the model is not in float32 on the
        CPU, its network has become another one, or a number is not finite.
        """
        # By attribute, a module's tensors would take as long to look up as to compute with.
        network: Any = model._modules["network"]
        layers = tuple(network._modules.values())
        tensors: list[Tensor] = [*_buffers_of(model._buffers)]
        for layer in layers[::2]:
            tensors += [tensor for tensor in layer._parameters.values() if tensor is not None]
        parts = model.config, network, *layers
        if parts != self._parts or not self._memory.holds(tuple(map(Tensor.data_ptr, tensors))):
            self._look_up(parts, tensors)
        if self._candidates is None:
            return _by_command(model, state, target)
        chosen = kernels.choose(
            state if state.flags.carray else state.copy(),  # another kind would be compiled anew
            target if target.flags.carray else target.copy(),
            self._memory.held[0],
            len(layers) // 2 + 1,
            model.config.steps,
            float(model.config.abstain_below),
        )
        if chosen == kernels.UNDECIDED:
            return _by_command(model, state, target)
        return None if chosen == kernels.ABSTAINED else self._candidates[chosen].copy()

    def _look_up(self, parts: tuple[Any, ...], tensors: list[Tensor]) -> None:
        config, *modules = self._parts = parts
        self._candidates = None
        candidates, weights = tensors[0], tensors[len(kernels.BUFFERS) :: 2]
        widths = [config.state_dimensions + config.action_dimensions, *map(len, weights)]
        if (
            _is_plain(modules)
            and widths[-1] == config.state_dimensions
            and [_form(tensor) for tensor in tensors] == _forms(config, len(candidates), widths)
        ):
            self._memory.keep(tuple(tensors), (len(candidates), *widths))
            self._candidates = candidates.numpy()


def _is_plain(modules: list[nn.Module]) -> bool:
    """Whether a network and its layers are as made: linear layers with SiLU between them."""
    between = len(modules) // 2 - 1
    kinds = [nn.Sequential, nn.Linear, *(nn.SiLU, nn.Linear) * between]
    return [type(module) for module in modules] == kinds


def _form(tensor: Tensor) -> tuple[tuple[int, ...], torch.dtype, bool]:
    return tuple(tensor.shape), tensor.dtype, tensor.is_cpu and tensor.is_contiguous()


def _forms(
    config: MLPForwardModelConfig, candidates: int, widths: list[int]
) -> list[tuple[tuple[int, ...], torch.dtype, bool]]:
    """How the kernels expect the tensors to be."""
    actions, states = (config.action_dimensions,), (config.state_dimensions,)
    forms = [((candidates, *actions), torch.float32, True)]
    forms += [(shape, torch.float64, True) for shape in (*[actions] * 2, *[states] * 6)]
    for inputs, outputs in itertools.pairwise(widths):
        forms += [((outputs, inputs), torch.float32, True), ((outputs,), torch.float32, True)]
    return forms


def _by_command(
    model: MLPForwardModel, state: NDArray[np.float32], target: NDArray[np.float32]
) -> NDArray[np.float32] | None:
    like = model.candidates
    rows = (torch.from_numpy(row.copy())[None].to(like) for row in (state, target))
    action, given = model.command(*rows)
    return action[0].float().cpu().numpy() if bool(given) else None
