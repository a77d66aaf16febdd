"""Checkpoints: a folder of `config.json` and `model.safetensors` that no kill can half replace.

Both files are written under temporary names and renamed, the tensors first: that rename is the
instant at which the new checkpoint takes the old one's place. `model.safetensors` carries two
digests: that of its `config.json`, so that a load between the two renames knows that the config
still under its temporary name is the right one, and that of its own tensors, so that none that was
damaged is taken for sound. Digests tell of damage, not of who wrote a file: whoever changes a file
on purpose can change its digest as well.
"""

from __future__ import annotations

import hashlib
import json
import re
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import torch
from torch import Tensor

from pacnet.core.durable import NEW, flush_folder, written_through

CONFIG_FILE = "config.json"
TENSOR_FILE = "model.safetensors"
FORMAT = "pacnet"
VERSION = 1
# One entry for both, as safetensors writes several in an order that changes from run to run.
_DIGESTS = "sha256"  # "<of config.json> <of the tensors>"
_CONFIG_DIGEST = "config_sha256"  # the only one in checkpoints from before there were two
_OLD_ENTRIES = {_CONFIG_DIGEST, "format"}


class _Digests(NamedTuple):
    """What a tensor file says of its checkpoint; None where it says nothing."""

    config: str | None
    tensors: str | None


def write_checkpoint(
    folder: str | Path, config: Mapping[str, Any], tensors: Mapping[str, Tensor]
) -> None:
    """Writes a checkpoint, replacing the one that is there; other files in the folder stay.

    Args:
        folder: made if it is missing.
        config: what JSON can hold.
        tensors: by name.
    """
    from safetensors.torch import save

    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    _finish_interrupted_write(folder)
    document = {"format": FORMAT, "version": VERSION, "config": config}
    text = (json.dumps(document, indent=2) + "\n").encode()
    own = {name: _own(tensor) for name, tensor in tensors.items()}
    of_config = _digest(text)
    weights = save(own, metadata={_DIGESTS: f"{of_config} {_tensor_digest(of_config, own)}"})
    for name, content in ((CONFIG_FILE, text), (TENSOR_FILE, weights)):
        with written_through(folder / (name + NEW)) as file:
            file.write(content)
    for name in (TENSOR_FILE, CONFIG_FILE):
        (folder / (name + NEW)).replace(folder / name)
    flush_folder(folder)


def read_checkpoint(folder: str | Path) -> tuple[dict[str, Any], dict[str, Tensor]]:
    """Reads a checkpoint's config and tensors.

    A `UserWarning` says that the tensors have no digest, as before there was one, or that
    `config.json` is not the one that was written, as after somebody edited it.

    Raises:
        FileNotFoundError: no checkpoint there.
        ValueError: a damaged file, another format, or a version that this release cannot read.
    """
    folder = Path(folder)
    path = folder / TENSOR_FILE
    if not path.is_file():
        raise FileNotFoundError(f"expected a checkpoint folder with {TENSOR_FILE}, got '{folder}'")
    tensors, digests = _read_tensors(path)
    text, config = _read_config(folder, digests.config)
    if digests.tensors is None:
        _warn(f"'{path}' has no digest of its tensors: damage goes unseen until it is saved anew")
    if digests.config not in (None, _digest(text)):
        _warn(
            f"'{folder / CONFIG_FILE}' is not the one that was written with {TENSOR_FILE}: it was "
            "edited, which counts, or is damaged"
        )
    return config, tensors


def _warn(message: str) -> None:
    warnings.warn(message, UserWarning, stacklevel=3)  # at the caller of read_checkpoint


def _finish_interrupted_write(folder: Path) -> None:
    """Brings a config into force whose tensors already are, before its name is written again."""
    fresh, tensors = folder / (CONFIG_FILE + NEW), folder / TENSOR_FILE
    if fresh.is_symlink() or not fresh.is_file() or not tensors.is_file():
        return
    try:
        _, digests = _read_tensors(tensors)
    except ValueError:
        return  # a damaged checkpoint is about to be replaced
    if _digest(fresh.read_bytes()) == digests.config:
        fresh.replace(folder / CONFIG_FILE)


def _read_tensors(path: Path) -> tuple[dict[str, Tensor], _Digests]:
    """The tensors, which are those that were written, and what their file says.

    Safetensors compares the sizes in a file's header with the file's own before it takes memory.
    """
    from safetensors import SafetensorError, safe_open

    try:
        with safe_open(path, framework="pt") as file:
            digests = _read_digests(path, file.metadata() or {})
            tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
        found = digests.tensors and _tensor_digest(digests.config, tensors)
    except (SafetensorError, OverflowError, RuntimeError, TypeError) as error:
        reason = str(error).partition("\n")[0]  # torch lists its callers after it
        raise ValueError(f"expected a whole safetensors file, got '{path}': {reason}") from error
    if found != digests.tensors:
        raise ValueError(
            f"expected the tensors that were written to '{path}', got others: it is damaged"
        )
    return tensors, digests


def _read_digests(path: Path, metadata: Mapping[str, str]) -> _Digests:
    if metadata.keys() <= _OLD_ENTRIES:
        return _Digests(metadata.get(_CONFIG_DIGEST), None)
    if metadata.keys() != {_DIGESTS} or not re.fullmatch(
        "[0-9a-f]{64} [0-9a-f]{64}", metadata[_DIGESTS]
    ):
        raise ValueError(
            f"expected two digests under '{_DIGESTS}' in the header of '{path}', got {metadata}"
        )
    return _Digests(*metadata[_DIGESTS].split(" "))


def _read_config(folder: Path, digest: str | None) -> tuple[bytes, dict[str, Any]]:
    """The text of the config in force, and what it says."""
    path = folder / CONFIG_FILE
    interrupted = folder / (CONFIG_FILE + NEW)
    if interrupted.is_file() and _digest(interrupted.read_bytes()) == digest:
        path = interrupted
    if not path.is_file():
        raise FileNotFoundError(f"expected {CONFIG_FILE} beside {TENSOR_FILE} in '{folder}'")
    text = path.read_bytes()
    try:
        document = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise ValueError(f"expected JSON, got '{path}': {error}") from error
    _check_document(path, document)
    return text, document["config"]


def _check_document(path: Path, document: object) -> None:
    if not isinstance(document, dict) or document.get("format") != FORMAT:
        raise ValueError(f"expected a checkpoint of format '{FORMAT}', got '{path}' without it")
    version = document.get("version")
    if type(version) is not int or version != VERSION:
        raise ValueError(
            f"expected checkpoint version {VERSION}, got {version!r} in '{path}': "
            "a newer pacnet may read it"
        )
    if not isinstance(document.get("config"), dict):
        raise ValueError(f"expected an object under 'config', got none in '{path}'")


def _own(tensor: Tensor) -> Tensor:
    """A tensor's values in memory that it shares with no other, in their own order."""
    return tensor.detach().cpu().clone(memory_format=torch.contiguous_format)


def _digest(text: bytes) -> str:
    return hashlib.sha256(text).hexdigest()


def _tensor_digest(config: str | None, tensors: Mapping[str, Tensor]) -> str:
    """Of the config's digest and each tensor's name, dtype, shape and bytes, by name."""
    digest = hashlib.sha256(str(config).encode())
    for name, tensor in sorted(tensors.items()):
        digest.update(json.dumps([name, str(tensor.dtype), list(tensor.shape)]).encode())
        digest.update(tensor.contiguous().reshape(-1).view(torch.uint8).numpy().data)
    return digest.hexdigest()
