"""Networks with weights of others, from what is on this machine: nothing is downloaded.

- `torchvision:NAME`: a convolutional network such as `resnet18`, with the weights in torch's cache.
- `timm:NAME`: such as `resnet18.a1_in1k`, with a safetensors file in Hugging Face's cache.
- `hf:NAME`: such as `facebook/dinov2-small`, in Hugging Face's cache; or a folder.
- `file:PATH`: a network of torchvision with weights of one's own, a safetensors file whose name
  begins with the network's: `resnet18.safetensors` or `resnet18-anything.safetensors`.

No file may run code. Safetensors hold tensors alone. torchvision's own files are pickles, and are
read by `torch.load(weights_only=True)`, which makes nothing but tensors. Whole networks in a file
are refused: those of `torch.jit` are programs of a stranger, which can write files, and
`torch.export.load` may unpickle.
"""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from math import isqrt
from pathlib import Path
from pickle import UnpicklingError
from typing import Any, NamedTuple

import torch
from torch import Tensor, nn
from torch.nn import functional

_SIZE = 224  # pixels of a side that weights for ImageNet want
_MEAN, _STD = (0.485, 0.456, 0.406), (0.229, 0.224, 0.225)  # of ImageNet's colours, 0 to 1
_SAFE = ".safetensors"
_HEADS = ("avgpool", "classifier", "fc")  # of torchvision's networks, after the maps


class Network(NamedTuple):
    """A network, and which pictures it wants."""

    module: nn.Module
    """Turns pictures `[N, 3, h, w]` into maps of features `[N, C, h', w']`."""
    size: tuple[int, int] | None = None
    """Height and width [pixels] to which pictures are brought; None for those they have."""
    mean: tuple[float, ...] = (0.0, 0.0, 0.0)
    """Of each colour, which is subtracted."""
    std: tuple[float, ...] = (1.0, 1.0, 1.0)
    """Of each colour, by which it is divided."""

    def __call__(self, pictures: Tensor) -> Tensor:
        """Return maps of features of pictures from 0 to 1, `[N, 3, h, w]`."""
        if self.size is not None:
            pictures = functional.interpolate(pictures, self.size, mode="bilinear", antialias=True)
        mean, std = (torch.tensor(one)[:, None, None] for one in (self.mean, self.std))
        return self.module((pictures - mean) / std)


def network_of(kind: str) -> Network:
    """Return a network with its weights, ready to be used.

    Args:
        kind: one of those above.

    Raises:
        ValueError: its package, its weights or the network itself are not there.
    """
    source, _, name = kind.partition(":")
    makers: dict[str, Callable[[str, str], Network]] = {
        "torchvision": _torchvision,
        "timm": _timm,
        "hf": _transformers,
        "file": _file,
    }
    with torch.random.fork_rng(devices=[]), torch.inference_mode(False):
        network = makers[source](kind, name)
        network.module.float().eval().requires_grad_(False)
    return network


def _torchvision(kind: str, name: str) -> Network:
    models = _package("torchvision.models", kind)
    try:
        url = str(models.get_model_weights(name).DEFAULT.url)
    except (AttributeError, ValueError) as error:
        raise ValueError(f"expected a network of torchvision, got {name!r}") from error
    path = Path(torch.hub.get_dir()) / "checkpoints" / url.rpartition("/")[2]
    if not path.is_file():
        raise ValueError(f"expected the weights of {kind!r} in '{path}': put {url} there")
    try:
        weights = torch.load(path, map_location="cpu", weights_only=True)
    except (UnpicklingError, RuntimeError, EOFError) as error:
        raise ValueError(f"expected tensors alone in '{path}', got something else") from error
    return _maps_of_torchvision(kind, models, name, weights)


def _file(kind: str, name: str) -> Network:
    from safetensors import SafetensorError
    from safetensors.torch import load_file

    path = Path(name)
    if path.suffix != _SAFE:
        raise ValueError(
            f"expected a file of tensors alone, such as resnet18{_SAFE}, got {path.name!r}"
        )
    if not path.is_file():
        raise ValueError(f"expected the weights of {kind!r} in a file, got none there")
    try:
        weights = load_file(path)
    except (OSError, SafetensorError) as error:
        raise ValueError(f"expected safetensors in '{path}': {error}") from error
    models = _package("torchvision.models", kind)
    return _maps_of_torchvision(kind, models, path.stem.partition("-")[0], weights)


def _maps_of_torchvision(kind: str, models: Any, name: str, weights: dict[str, Tensor]) -> Network:
    """Return what a network of torchvision does before it averages its maps."""
    try:
        whole = models.get_model(name, weights=None)
    except ValueError as error:
        raise ValueError(f"expected a network of torchvision in {kind!r}, got {name!r}") from error
    _load(kind, whole, weights)
    parts = dict(whole.named_children())
    heads = [number for number, part in enumerate(parts) if part in _HEADS]
    if not heads:
        raise ValueError(f"expected a network of torchvision that makes maps, got {name!r}")
    maps = nn.Sequential(*[*parts.values()][: heads[0]])
    return Network(maps, (_SIZE, _SIZE), _MEAN, _STD)


def _timm(kind: str, name: str) -> Network:
    from safetensors.torch import load_file

    timm, hub = _package("timm", kind), _package("huggingface_hub", kind)
    try:
        whole = timm.create_model(name, pretrained=False)
    except RuntimeError as error:
        raise ValueError(f"expected a network of timm, got {name!r}") from error
    about = whole.pretrained_cfg
    place, file = about.get("hf_hub_id"), f"model{_SAFE}"
    path = hub.try_to_load_from_cache(place, file) if place else None
    if not isinstance(path, str):
        raise ValueError(
            f"expected the weights of {kind!r} in Hugging Face's cache: run "
            f"`hf download {place} {file}`"
        )
    _load(kind, whole, load_file(path))
    size = tuple(about["input_size"][1:])
    return Network(_TimmMaps(whole), size, tuple(about["mean"]), tuple(about["std"]))


class _TimmMaps(nn.Module):
    """The maps of a network of timm."""

    def __init__(self, whole: nn.Module) -> None:
        super().__init__()
        self.whole = whole

    def forward(self, pictures: Tensor) -> Tensor:
        features = self.whole.forward_features(pictures)  # pyright: ignore[reportCallIssue]
        if features.dim() == 3:
            return _maps_of_tokens(features)
        last = features.shape[3] == self.whole.num_features != features.shape[1]
        return features.permute(0, 3, 1, 2) if last else features


def _transformers(kind: str, name: str) -> Network:
    package = _package("transformers", kind)
    try:
        whole = package.AutoModel.from_pretrained(
            name, local_files_only=True, use_safetensors=True, trust_remote_code=False
        )
    except (OSError, ValueError) as error:
        raise ValueError(
            f"expected the weights of {kind!r} in a folder or in Hugging Face's cache: run "
            f"`hf download {name}`"
        ) from error
    try:
        about, _ = package.ImageProcessingMixin.get_image_processor_dict(
            name, local_files_only=True
        )
    except OSError:
        about = {}
    mean, std = about.get("image_mean") or _MEAN, about.get("image_std") or _STD
    return Network(_TransformerMaps(whole), (_SIZE, _SIZE), tuple(mean), tuple(std))


class _TransformerMaps(nn.Module):
    """The maps of a model of transformers, or of the part of it that sees."""

    def __init__(self, whole: nn.Module) -> None:
        super().__init__()
        self.whole: Any = getattr(whole, "vision_model", whole)

    def forward(self, pictures: Tensor) -> Tensor:
        features = self.whole(pixel_values=pictures).last_hidden_state
        return _maps_of_tokens(features) if features.dim() == 3 else features


def _maps_of_tokens(tokens: Tensor) -> Tensor:
    """Return tokens `[N, T, C]` as maps `[N, C, h, h]`; those of the whole picture are first."""
    side = isqrt(tokens.shape[1])
    return tokens[:, -(side**2) :].transpose(1, 2).unflatten(2, (side, side))


def _package(name: str, kind: str) -> Any:
    try:
        return import_module(name)
    except ImportError as error:
        package = name.partition(".")[0]
        raise ValueError(
            f"expected the package {package} for {kind!r}: pip install {package}"
        ) from error


def _load(kind: str, module: nn.Module, weights: dict[str, Tensor]) -> None:
    try:
        module.load_state_dict(weights)
    except (RuntimeError, TypeError) as error:
        reason = " ".join(str(error).split())  # torch's messages have several lines
        raise ValueError(f"expected the weights of {kind!r}, got others: {reason[:300]}") from error
