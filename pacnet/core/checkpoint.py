"""Checkpoints: a folder with `config.json` and `model.safetensors`, replaced atomically.

Both files are written under temporary names and then renamed, the tensors first: that rename makes
the new checkpoint valid. The header of `model.safetensors` holds two SHA-256 digests: that of the
config tells which config belongs to the tensors, also between the two renames; that of the tensors
detects damage. Digests do not protect against deliberate changes.
"""

from __future__ import annotations

import hashlib
import json
import re
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeVar

import torch
from torch import Tensor

from pacnet.core.durable import NEW, open_synced, sync_folder
from pacnet.core.integrity import check_finite
from pacnet.core.old_names import with_new_names
from pacnet.core.parts import REMEDY, check_part, parse_json

CONFIG_FILE = "config.json"
TENSOR_FILE = "model.safetensors"
FORMAT = "pacnet"
VERSION = 1
_KIND = "model"  # field of the config that names the model's class
_UNNAMED_KIND = "PACNet"  # the only class whose older checkpoints lack that field
# One entry for both digests: safetensors writes several in an order that changes between runs.
_DIGESTS = "sha256"  # "<of config.json> <of the tensors>"
_CONFIG_DIGEST = "config_sha256"  # the only digest in older checkpoints
_OLD_ENTRIES = {_CONFIG_DIGEST, "format"}

_Config = TypeVar("_Config")


def save_checkpoint(
    folder: str | Path, kind: str, fields: Mapping[str, Any], tensors: Mapping[str, Tensor]
) -> None:
    """Write the checkpoint of a model, replacing the one in the folder; other files stay.

    Args:
        folder: created if missing.
        kind: name of the model's class.
        fields: fields of the config, in types that JSON can hold.
        tensors: the model's `state_dict`.

    Raises:
        ValueError: a tensor is not finite; nothing has been written.
    """
    check_finite(tensors)
    write_checkpoint(folder, {_KIND: kind, **fields}, tensors)


def load_checkpoint(folder: str | Path, kind: str) -> tuple[dict[str, Any], dict[str, Tensor]]:
    """Return the config's fields and the tensors of a model of the named class.

    Raises:
        FileNotFoundError: no checkpoint there.
        ValueError: a damaged file, an unknown version, the checkpoint of another class, or a tensor
            that is not finite.
    """
    fields, tensors = read_checkpoint(folder)
    found = fields.pop(_KIND, _UNNAMED_KIND)
    if found != kind:
        raise ValueError(f"expected a checkpoint of {kind} in '{folder}', got one of {found!r}")
    check_finite(tensors, f" in '{folder}'")
    return fields, tensors


def rebuild_config(kind: type[_Config], fields: Mapping[str, Any]) -> _Config:
    """Return the config dataclass from the output of `dataclasses.asdict`, after JSON.

    Raises:
        ValueError: a field is missing, unknown or out of range.
    """
    try:
        return kind(**with_new_names(kind, fields))
    except (TypeError, OverflowError) as error:
        raise ValueError(
            f"expected the fields of {kind.__name__}, got {fields}: {error}"
        ) from error


def write_checkpoint(
    folder: str | Path, config: Mapping[str, Any], tensors: Mapping[str, Tensor]
) -> None:
    """Write a config, in types that JSON can hold, and tensors; see `save_checkpoint`."""
    from safetensors.torch import save

    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    _finish_interrupted_write(folder)
    document = {"format": FORMAT, "version": VERSION, "config": config}
    text = (json.dumps(document, indent=2) + "\n").encode()
    # Copies, because safetensors refuses tensors that share memory.
    copies = {
        name: tensor.detach().cpu().clone(memory_format=torch.contiguous_format)
        for name, tensor in tensors.items()
    }
    digest = _digest(text)
    weights = save(copies, metadata={_DIGESTS: f"{digest} {_tensor_digest(digest, copies)}"})
    for name, content in ((CONFIG_FILE, text), (TENSOR_FILE, weights)):
        with open_synced(folder / (name + NEW)) as file:
            file.write(content)
    for name in (TENSOR_FILE, CONFIG_FILE):
        (folder / (name + NEW)).replace(folder / name)
    sync_folder(folder)


def read_checkpoint(folder: str | Path) -> tuple[dict[str, Any], dict[str, Tensor]]:
    """Return a checkpoint's config and tensors.

    A `UserWarning` says that an older checkpoint has no digest of its tensors, or that
    `config.json` has been edited.

    Raises:
        FileNotFoundError: no checkpoint there.
        ValueError: a damaged file, another format, or a version that this release cannot read.
    """
    folder = Path(folder)
    if not (folder / TENSOR_FILE).exists():
        got = f"without it: {REMEDY}" if folder.is_dir() else "which is no folder"
        raise FileNotFoundError(
            f"expected a checkpoint folder with {TENSOR_FILE}, got '{folder}', {got}"
        )
    path = check_part(folder, TENSOR_FILE)
    tensors, config_digest, tensor_digest = _read_tensors(path)
    text, config = _read_config(folder, config_digest)
    if tensor_digest is None:
        warnings.warn(
            f"'{path}' has no digest of its tensors, so damage is not detected; "
            "save the model again to add one",
            UserWarning,
            stacklevel=2,
        )
    if config_digest not in (None, _digest(text)):
        warnings.warn(
            f"'{folder / CONFIG_FILE}' is not the one that was written with {TENSOR_FILE}: it was "
            "edited or is damaged, and is used as it is",
            UserWarning,
            stacklevel=2,
        )
    return config, tensors


def _finish_interrupted_write(folder: Path) -> None:
    """Rename the config that belongs to the tensors before its temporary name is used again."""
    new, tensors = folder / (CONFIG_FILE + NEW), folder / TENSOR_FILE
    if new.is_symlink() or not new.is_file() or not tensors.is_file():
        return
    try:
        _, config_digest, _ = _read_tensors(tensors)
    except ValueError:
        return  # a damaged checkpoint is about to be replaced
    if _digest(new.read_bytes()) == config_digest:
        new.replace(folder / CONFIG_FILE)


def _read_tensors(path: Path) -> tuple[dict[str, Tensor], str | None, str | None]:
    """Return the tensors, the digest of the config and the checked digest of the tensors."""
    from safetensors import SafetensorError, safe_open

    try:
        # Safetensors compares the sizes in the header with the file's before it allocates memory.
        with safe_open(path, framework="pt") as file:
            config_digest, tensor_digest = _read_digests(path, file.metadata() or {})
            tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
        found = tensor_digest and _tensor_digest(config_digest, tensors)
    except (SafetensorError, OverflowError, RuntimeError, TypeError) as error:
        reason = str(error).partition("\n")[0]  # without torch's list of callers
        raise ValueError(
            f"expected a whole safetensors file, got '{path}': {reason}: {REMEDY}"
        ) from error
    if found != tensor_digest:
        raise ValueError(
            f"expected the tensors that were written to '{path}', got others: {REMEDY}"
        )
    return tensors, config_digest, tensor_digest


def _read_digests(path: Path, metadata: Mapping[str, str]) -> tuple[str | None, str | None]:
    """Return the digests of config and tensors, None for a missing one."""
    if metadata.keys() <= _OLD_ENTRIES:
        return metadata.get(_CONFIG_DIGEST), None
    digests = metadata.get(_DIGESTS, "")
    if len(metadata) > 1 or not re.fullmatch("[0-9a-f]{64} [0-9a-f]{64}", digests):
        raise ValueError(
            f"expected two digests under '{_DIGESTS}' in the header of '{path}', got {metadata}"
        )
    return digests[:64], digests[65:]


def _read_config(folder: Path, digest: str | None) -> tuple[bytes, dict[str, Any]]:
    """Return the text that belongs to the tensors, or else the latest, and its config."""
    path, new = folder / CONFIG_FILE, folder / (CONFIG_FILE + NEW)
    if new.is_file() and _digest(new.read_bytes()) == digest:
        path = new
    if not path.exists():
        raise FileNotFoundError(
            f"expected {CONFIG_FILE} beside {TENSOR_FILE} in '{folder}', got none: {REMEDY}"
        )
    text = check_part(folder, path.name).read_bytes()
    document = parse_json(path, text)
    if document.get("format") != FORMAT:
        raise ValueError(f"expected a checkpoint of format '{FORMAT}', got '{path}' without it")
    version = document.get("version")
    if type(version) is not int or version != VERSION:
        raise ValueError(
            f"expected checkpoint version {VERSION}, got {version!r} in '{path}': "
            "a newer pacnet may read it"
        )
    if not isinstance(document.get("config"), dict):
        raise ValueError(f"expected an object under 'config', got none in '{path}'")
    return text, document["config"]


def _digest(text: bytes) -> str:
    return hashlib.sha256(text).hexdigest()


def _tensor_digest(config_digest: str | None, tensors: Mapping[str, Tensor]) -> str:
    """Return the digest of the config's digest and each tensor's name, dtype, shape and bytes."""
    digest = hashlib.sha256(str(config_digest).encode())
    for name, tensor in sorted(tensors.items()):
        digest.update(json.dumps([name, str(tensor.dtype), list(tensor.shape)]).encode())
        digest.update(tensor.contiguous().reshape(-1).view(torch.uint8).numpy().data)
    return digest.hexdigest()
