"""The tensors of an `MLPForwardModel` as the arrays that its compiled kernel reads."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from operator import attrgetter, itemgetter
from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from pacnet.core.growable_rows import check_storage

NORMALISERS = (
    "state_mean", "state_std", "action_mean", "action_std", "change_mean", "change_std",
    "state_low", "state_high",
)  # fmt: skip

_read_buffers = itemgetter("candidates", *NORMALISERS)
_read_shape = attrgetter("shape")


class MLPArrays(NamedTuple):
    """The arguments of `kernels.decide` but for the state and the target."""

    candidates: NDArray[np.float32]
    normalisers: tuple[NDArray[np.float64], ...]
    weights: tuple[NDArray[np.float32], ...]
    biases: tuple[NDArray[np.float32], ...]
    steps: int
    abstain_below: float


class MLPArraysCache:
    """A cache of the arrays, valid until a tensor or layer is replaced or a tensor moves.

    The arrays share the tensors' memory, which torch cannot resize while they exist.
    """

    def __init__(self) -> None:
        self._cached: tuple[Any, MLPArrays | None] = None, None

    def get(
        self, config: Any, network: nn.Module, buffers: Mapping[str, Tensor | None]
    ) -> MLPArrays | None:
        """Return the arrays, or None if only torch can predict.

        That is so unless the tensors are float32 (normalisers float64) on the CPU and the network
        consists of linear layers with SiLU between them.

        Raises:
            ValueError: a tensor that is no longer in memory.
        """
        # Looking up tensors as attributes of a module would take as long as the prediction.
        layers = tuple(network._modules.values())
        parameters: list[Any] = []
        for layer in layers[::2]:
            parameters += layer._parameters.values()  # pyright: ignore[reportOptionalMemberAccess]
        tensors: Any = (*_read_buffers(buffers), *parameters)
        try:
            key = (
                (config, network, *layers),
                tuple(map(Tensor.data_ptr, tensors)),
                tuple(map(_read_shape, tensors)),
                tuple(map(Tensor.stride, (tensors[0], *parameters))),
            )
            cached = self._cached
            if cached[0] != key:
                arrays = _view(config, tensors) if _is_plain(network, layers) else None
                cached = self._cached = key, arrays
        except (TypeError, RuntimeError):  # a layer without a bias, a tensor without dimensions
            return None
        return cached[1]

    def __reduce__(self) -> tuple[type[MLPArraysCache], tuple[()]]:
        """Start empty in a copied or unpickled model."""
        return MLPArraysCache, ()


def _is_plain(network: nn.Module, layers: Sequence[nn.Module | None]) -> bool:
    """Whether the network consists of linear layers with SiLU between them."""
    kinds = [nn.Linear, *(nn.SiLU, nn.Linear) * (len(layers) // 2)]
    return type(network) is nn.Sequential and [type(layer) for layer in layers] == kinds


def _view(config: Any, tensors: Sequence[Tensor]) -> MLPArrays | None:
    """View tensors as arrays if they have the shapes and types that the kernel expects."""
    first = 1 + len(NORMALISERS)  # of the layers' tensors
    states, actions = config.state_dimensions, config.action_dimensions
    widths = (states + actions, *map(len, tensors[first::2]))
    rows = len(tensors[0])
    forms: list[Any] = [((rows, actions), torch.float32)]
    sizes = (states, states, actions, actions, *[states] * 4)  # of the normalisers
    forms += [((size,), torch.float64) for size in sizes]
    for inputs, outputs in itertools.pairwise(widths):
        forms += [((outputs, inputs), torch.float32), ((outputs,), torch.float32)]
    if (
        rows == 0
        or widths[-1] != states
        or [(tensor.shape, tensor.dtype) for tensor in tensors] != forms
        or not all(tensor.is_cpu and tensor.is_contiguous() for tensor in tensors)
    ):
        return None
    candidates, *arrays = (
        check_storage("a tensor of the forward model", tensor).detach().numpy()
        for tensor in tensors
    )
    normalisers, layers = tuple(arrays[: first - 1]), arrays[first - 1 :]
    weights, biases = tuple(layers[::2]), tuple(layers[1::2])
    return MLPArrays(
        candidates, normalisers, weights, biases, config.steps, float(config.abstain_below)
    )
