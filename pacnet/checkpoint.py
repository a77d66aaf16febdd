"""Checkpoints: a folder of `config.json` and `model.safetensors` that no kill can half replace.

Both files are written under temporary names and renamed, the tensors first: that rename is the
instant at which the new checkpoint takes the old one's place. `model.safetensors` carries the
digest of its `config.json`, so that a load between the two renames knows that the config still
under its temporary name is the right one.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from torch import Tensor

from pacnet.durable import NEW, flush_folder, written_through

CONFIG_FILE = "config.json"
TENSOR_FILE = "model.safetensors"
FORMAT = "pacnet"
VERSION = 1
_DIGEST = "config_sha256"


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
    contiguous = {name: tensor.contiguous().cpu() for name, tensor in tensors.items()}
    weights = save(contiguous, metadata={_DIGEST: _digest(text)})
    for name, content in ((CONFIG_FILE, text), (TENSOR_FILE, weights)):
        with written_through(folder / (name + NEW)) as file:
            file.write(content)
    for name in (TENSOR_FILE, CONFIG_FILE):
        (folder / (name + NEW)).replace(folder / name)
    flush_folder(folder)


def read_checkpoint(folder: str | Path) -> tuple[dict[str, Any], dict[str, Tensor]]:
    """Reads a checkpoint's config and tensors.

    Raises:
        FileNotFoundError: no checkpoint there.
        ValueError: a damaged file, another format, or a version that this release cannot read.
    """
    folder = Path(folder)
    if not (folder / TENSOR_FILE).is_file():
        raise FileNotFoundError(f"expected a checkpoint folder with {TENSOR_FILE}, got '{folder}'")
    tensors, digest = _read_tensors(folder / TENSOR_FILE)
    return _read_config(folder, digest), tensors


def _finish_interrupted_write(folder: Path) -> None:
    """Brings a config into force whose tensors already are, before its name is written again."""
    if not (folder / (CONFIG_FILE + NEW)).is_file() or not (folder / TENSOR_FILE).is_file():
        return
    try:
        _, digest = _read_tensors(folder / TENSOR_FILE)
    except ValueError:
        return  # a damaged checkpoint is about to be replaced
    if _digest((folder / (CONFIG_FILE + NEW)).read_bytes()) == digest:
        (folder / (CONFIG_FILE + NEW)).replace(folder / CONFIG_FILE)


def _read_tensors(path: Path) -> tuple[dict[str, Tensor], str | None]:
    from safetensors import SafetensorError, safe_open

    try:
        with safe_open(path, framework="pt") as file:
            tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
            return tensors, (file.metadata() or {}).get(_DIGEST)
    except SafetensorError as error:
        raise ValueError(f"expected a whole safetensors file, got '{path}': {error}") from error


def _read_config(folder: Path, digest: str | None) -> dict[str, Any]:
    path = folder / CONFIG_FILE
    interrupted = folder / (CONFIG_FILE + NEW)
    if interrupted.is_file() and _digest(interrupted.read_bytes()) == digest:
        path = interrupted
    if not path.is_file():
        raise FileNotFoundError(f"expected {CONFIG_FILE} beside {TENSOR_FILE} in '{folder}'")
    try:
        document = json.loads(path.read_bytes())
    except ValueError as error:
        raise ValueError(f"expected JSON, got '{path}': {error}") from error
    if not isinstance(document, dict) or document.get("format") != FORMAT:
        raise ValueError(f"expected a checkpoint of format '{FORMAT}', got '{path}' without it")
    if document.get("version") != VERSION:
        raise ValueError(
            f"expected checkpoint version {VERSION}, got {document.get('version')!r} in '{path}': "
            "a newer pacnet may read it"
        )
    if not isinstance(document.get("config"), dict):
        raise ValueError(f"expected an object under 'config', got none in '{path}'")
    return document["config"]


def _digest(text: bytes) -> str:
    return hashlib.sha256(text).hexdigest()
