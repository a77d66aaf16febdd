"""What a compiled kernel reads of a learned forward model: arrays in the memory of its tensors."""

from __future__ import annotations

import itertools
from operator import attrgetter, itemgetter
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

if TYPE_CHECKING:
    from pacnet.forward_models.mlp import MLPForwardModel

NORMALISERS = (
    "state_mean", "state_std", "action_mean", "action_std", "change_mean", "change_std",
)  # fmt: skip
RANGE = ("state_low", "state_high")

_buffers_of = itemgetter("candidates", *NORMALISERS, *RANGE)
_shape_of = attrgetter("shape")


class Arrays(NamedTuple):
    """The first arguments of `kernels.decide`, all but a state and a target."""

    candidates: NDArray[np.float32]
    normalisers: tuple[NDArray[np.float64], ...]
    weights: tuple[NDArray[np.float32], ...]
    biases: tuple[NDArray[np.float32], ...]
    steps: int
    abstain_below: float


class MLPArrays:
    """Finds a model's arrays, anew whenever a tensor or a layer is another one or lies elsewhere.

    An array keeps its memory, whatever is done to the tensor: storage that numpy has seen cannot be
    resized.
    """

    def __init__(self) -> None:
        self._found: tuple[Any, Arrays | None] = None, None

    def of(self, model: MLPForwardModel) -> Arrays | None:
        """The arrays, or None where only torch can predict.

        That is where the model is not in float32 on the CPU, or its network is no longer what it
        was made as: linear layers with SiLU between them.

        Raises:
            ValueError: a tensor whose memory has been taken away.
        """
        # By attribute, a module's tensors would take as long to look up as to compute with.
        network: Any = model._modules["network"]
        layers = tuple(network._modules.values())
        parameters: list[Any] = []
        for layer in layers[::2]:
            parameters += layer._parameters.values()
        tensors = (*_buffers_of(model._buffers), *parameters)
        try:
            key = (
                (model.config, network, *layers),
                tuple(map(Tensor.data_ptr, tensors)),
                tuple(map(_shape_of, tensors)),
                tuple(map(Tensor.stride, (tensors[0], *parameters))),
            )
            found = self._found
            if found[0] != key:
                found = self._found = key, _view(key[0], tensors)
        except (TypeError, RuntimeError):  # a layer without a bias, a tensor without dimensions
            return None
        return found[1]

    def __reduce__(self) -> tuple[type[MLPArrays], tuple[()]]:
        """A copied or pickled model finds its own."""
        return MLPArrays, ()


def _view(parts: tuple[Any, ...], tensors: tuple[Tensor, ...]) -> Arrays | None:
    config, *modules = parts
    first = 1 + len(NORMALISERS) + len(RANGE)  # of the tensors, which is a layer's
    widths = [config.state_dimensions + config.action_dimensions, *map(len, tensors[first::2])]
    if (
        not _is_plain(modules)
        or len(tensors[0]) == 0
        or widths[-1] != config.state_dimensions
        or [_form(tensor) for tensor in tensors] != _forms(config, len(tensors[0]), widths)
    ):
        return None
    for tensor in tensors:
        held = tensor.untyped_storage().nbytes()
        if held < tensor.nbytes + tensor.storage_offset() * tensor.itemsize:
            raise ValueError(
                f"expected the memory of a {list(tensor.shape)} tensor, got {held} bytes"
            )
    candidates, *arrays = (tensor.detach().numpy() for tensor in tensors)
    weights, biases = tuple(arrays[first - 1 :: 2]), tuple(arrays[first::2])
    normalisers, threshold = tuple(arrays[: first - 1]), float(config.abstain_below)
    return Arrays(candidates, normalisers, weights, biases, config.steps, threshold)


def _is_plain(modules: list[nn.Module]) -> bool:
    """Whether a network and its layers are as made: linear layers with SiLU between them."""
    between = len(modules) // 2 - 1
    kinds = [nn.Sequential, nn.Linear, *(nn.SiLU, nn.Linear) * between]
    return [type(module) for module in modules] == kinds


def _form(tensor: Tensor) -> tuple[Any, ...]:
    return tensor.shape, tensor.dtype, tensor.is_cpu and tensor.is_contiguous()


def _forms(config: Any, candidates: int, widths: list[int]) -> list[tuple[Any, ...]]:
    """How the kernel expects the tensors to be."""
    actions, states = (config.action_dimensions,), (config.state_dimensions,)
    forms = [((candidates, *actions), torch.float32, True)]
    shapes = (*[states] * 2, *[actions] * 2, *[states] * 4)
    forms += [(shape, torch.float64, True) for shape in shapes]
    for inputs, outputs in itertools.pairwise(widths):
        forms += [((outputs, inputs), torch.float32, True), ((outputs,), torch.float32, True)]
    return forms
