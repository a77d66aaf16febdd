"""What is made of a picture before it is projected: small colours, or the grid of a network.

A network with weights of others is made once in a process, when it is first asked for, and nothing
is downloaded. Its weights are not part of a checkpoint. Their digest is, and other weights are
refused.
"""

from __future__ import annotations

import hashlib
import threading
from collections.abc import Callable, Mapping

import torch
from torch import Tensor, nn
from torch.nn import functional

from pacnet.vision.config import CUSTOM, PCA, ImageEncoderConfig
from pacnet.vision.correlation import as_tensor
from pacnet.vision.networks import Network, network_of
from pacnet.vision.projection import SIDE, small

Backbone = Callable[[Tensor], Tensor]
"""Turns pictures, uint8 `[N, h, w, 3]`, into features, float32 `[N, F]`."""

_GRID = 8  # cells of a side, at most
_AT_ONCE = 8  # pictures
_own: dict[str, Callable[[], nn.Module]] = {}  # name -> what makes it
_made: dict[str, _Grid] = {}  # kind -> its network
_making = threading.RLock()


def register_backbone(name: str, make: Callable[[], nn.Module]) -> None:
    """Make a network of one's own known, as the kind of encoder `custom:NAME`.

    Whoever loads a checkpoint with it registers it before.

    Args:
        name: what to call it; a network of the same name is replaced.
        make: makes it, with its weights. It turns pictures, red, green and blue from 0 to 1,
            float32 `[N, 3, h, w]` as reduced (see `pacnet.datasets.pictures.reduce`), into maps of
            features, float32 `[N, C, h', w']`.

    Raises:
        ValueError: a name that is none.

    Example:
        >>> register_backbone("edges", lambda: nn.Conv2d(3, 4, 3, stride=16))
        >>> features_of("custom:edges", 96, 128)[0]
        192
    """
    if not isinstance(name, str) or not name:
        raise ValueError(f"expected a name of a backbone, got {name!r}")
    with _making:
        _own[name] = make
        _made.pop(CUSTOM + name, None)


def features_of(kind: str, height: int, width: int) -> tuple[int, str | None]:
    """Return the number of features that a kind makes of a picture, and its weights' digest.

    Args:
        kind: of an encoder that projects features.
        height: of the pictures [pixels].
        width: of them [pixels].

    Raises:
        ValueError: the network, its weights or its package are not there.
    """
    if kind == PCA:
        return 3 * SIDE**2, None
    grid = _grid_of(kind)
    return grid.length(height, width), grid.digest


def backbone_of(config: ImageEncoderConfig) -> Backbone:
    """Return what makes features of pictures for an encoder that projects them.

    Raises:
        ValueError: the network, its weights or its package are not there, or the weights are others
            than those that the encoder was fitted with.
    """
    if config.kind == PCA:
        return small
    grid = _grid_of(config.kind)
    if grid.digest != config.digest:
        raise ValueError(
            f"expected the weights of {config.kind!r} with which the encoder was fitted, of "
            f"SHA-256 {config.digest}, got {grid.digest}"
        )
    features = grid.length(config.height, config.width)
    if features != config.features:
        raise ValueError(
            f"expected {features} features of {config.kind!r} in the config, got {config.features}"
        )
    return grid


class _Grid:
    """A network's maps of features, pooled to 8 × 8 cells at most and flattened."""

    def __init__(self, kind: str, network: Network) -> None:
        self._kind, self._network = kind, network
        self._lengths: dict[tuple[int, int], int] = {}  # of pictures of a size
        self.digest = _digest(network.module.state_dict())

    def length(self, height: int, width: int) -> int:
        """Return the number of features of a picture of some size [pixels]."""
        size = height, width
        if size not in self._lengths:
            self._lengths[size] = self(torch.zeros(1, *size, 3, dtype=torch.uint8)).shape[1]
        return self._lengths[size]

    def __call__(self, pictures: Tensor) -> Tensor:
        with torch.no_grad():
            return torch.cat([self._features(part) for part in pictures.split(_AT_ONCE)])

    def _features(self, pictures: Tensor) -> Tensor:
        maps = self._network(as_tensor(pictures))
        if not isinstance(maps, Tensor) or maps.dim() != 4 or len(maps) != len(pictures):
            got = [*maps.shape] if isinstance(maps, Tensor) else type(maps).__name__
            raise ValueError(
                f"expected maps of features [{len(pictures)}, C, h, w] of {self._kind!r}, got {got}"
            )
        rows, columns = (min(_GRID, side) for side in maps.shape[2:])
        return functional.adaptive_avg_pool2d(maps, (rows, columns)).flatten(1).float()


def _grid_of(kind: str) -> _Grid:
    """Return a network by the name of its kind, made if it is asked for the first time."""
    with _making:
        if kind not in _made:
            name = kind.removeprefix(CUSTOM)
            network = network_of(kind) if name == kind else Network(_custom(name))
            _made[kind] = _Grid(kind, network)
        return _made[kind]


def _custom(name: str) -> nn.Module:
    if name not in _own:
        raise ValueError(
            f"expected {CUSTOM + name!r} to be registered before it is used, with "
            f"pacnet.vision.register_backbone({name!r}, ...), got "
            f"{', '.join(map(repr, _own)) or 'none'}"
        )
    with torch.random.fork_rng(devices=[]), torch.inference_mode(False):
        module = _own[name]()
    if not isinstance(module, nn.Module):
        raise ValueError(
            f"expected {CUSTOM + name!r} to make an nn.Module, got {type(module).__name__}"
        )
    return module.eval().requires_grad_(False)


def _digest(weights: Mapping[str, Tensor]) -> str:
    """Return the SHA-256 of tensors with their names, types and shapes, whatever file held them."""
    digest = hashlib.sha256()
    for name, tensor in sorted(weights.items()):
        digest.update(f"{name} {tensor.dtype} {[*tensor.shape]} ".encode())
        digest.update(tensor.detach().cpu().contiguous().flatten().view(torch.uint8).numpy().data)
    return digest.hexdigest()
