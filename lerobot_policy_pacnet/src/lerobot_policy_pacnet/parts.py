"""The parts of a policy's folder, so that an incomplete copy is refused when it is loaded.

The header of `model.safetensors`, which LeRobot always needs, lists the others.
"""

from __future__ import annotations

import json
from pathlib import Path

from pacnet.core.durable import write_atomically
from pacnet.core.parts import REMEDY, check_part, read_json_part

ANCHOR, CONFIG = "model.safetensors", "config.json"
IMITATOR, BASE, STATE = "imitator", "base", "training.safetensors"
_ENTRY = "pacnet_parts"  # in the header; policies saved before it was introduced lack it


def record_parts(folder: Path, parts: list[str]) -> None:
    """List the parts that the folder must have, in the header of its `model.safetensors`."""
    from safetensors.torch import load, save

    tensors = load((folder / ANCHOR).read_bytes())
    write_atomically(folder / ANCHOR, save(tensors, {_ENTRY: json.dumps(parts)}))


def check_policy(folder: Path, needs_config: bool) -> None:
    """Check that a policy's folder lacks no part.

    Args:
        folder: of the policy.
        needs_config: whether its `config.json` is used.

    Raises:
        FileNotFoundError: a part is missing.
        ValueError: a part is damaged, or a Git LFS pointer.
    """
    if needs_config:
        read_json_part(folder, CONFIG)
    recorded = _recorded(folder)
    present = {name for name in (IMITATOR, BASE) if (folder / name).exists()}
    if STATE in recorded or present or (folder / STATE).exists():
        check_part(folder, STATE)
    for name in (IMITATOR, BASE):
        if name in recorded:
            check_subfolder(folder, name)
    for path in folder.glob("policy_*processor.json"):
        _check_processor(folder, path.name)


def check_subfolder(folder: Path, name: str) -> None:
    """Raise a FileNotFoundError unless a policy's folder has this one."""
    if not (folder / name).is_dir():
        raise FileNotFoundError(
            f"expected the folder {name} in '{folder}', as this policy has learned, got none: "
            f"{REMEDY}"
        )


def read_tensors_part(folder: Path, name: str) -> tuple[dict, dict[str, str]]:
    """Return the tensors and the header's entries of a safetensors file.

    Raises:
        FileNotFoundError: it is missing.
        ValueError: it is damaged, or a Git LFS pointer.
    """
    from safetensors import SafetensorError, safe_open

    path = check_part(folder, name)
    try:
        with safe_open(path, framework="pt") as file:
            tensors = {key: file.get_tensor(key) for key in file.keys()}  # noqa: SIM118
            return tensors, file.metadata() or {}
    except (SafetensorError, RuntimeError) as error:
        reason = str(error).partition("\n")[0]
        raise ValueError(
            f"expected a whole safetensors file, got '{path}': {reason}: {REMEDY}"
        ) from error


def _recorded(folder: Path) -> list[str]:
    """Return the parts that the header lists; none where it lists nothing."""
    _, entries = read_tensors_part(folder, ANCHOR)
    try:
        parts = json.loads(entries.get(_ENTRY, "[]"))
    except (ValueError, RecursionError):
        parts = None
    if not isinstance(parts, list) or not all(part in (IMITATOR, BASE, STATE) for part in parts):
        raise ValueError(f"expected a list of parts in the header of '{folder / ANCHOR}'")
    return parts


def _check_processor(folder: Path, name: str) -> None:
    """Check a processor's config, and that the files it names are there."""
    steps = read_json_part(folder, name).get("steps")
    for step in steps if isinstance(steps, list) else []:
        file = step.get("state_file") if isinstance(step, dict) else None
        if isinstance(file, str) and Path(file).name == file:
            check_part(folder, file)
