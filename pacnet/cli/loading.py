"""Loading of imitators, and of datasets for them."""

from __future__ import annotations

import json
from pathlib import Path

from pacnet.core.checkpoint import CONFIG_FILE, TENSOR_FILE, read_checkpoint
from pacnet.datasets.demonstrations import Demonstrations, load_demonstrations
from pacnet.imitator.imitator import Imitator

_POLICY = "imitator"  # folder of the checkpoint within that of a LeRobot policy


def checkpoint_folder(folder: str | Path) -> Path:
    """Return the folder of the checkpoint itself, which may lie within that of a LeRobot policy.

    Raises:
        ValueError: an empty name.
    """
    if not str(folder):
        raise ValueError("expected the folder of a checkpoint, got an empty name")
    folder = Path(folder)
    try:
        config = json.loads((folder / CONFIG_FILE).read_bytes())
    except (OSError, ValueError):
        config = None
    is_policy = isinstance(config, dict) and config.get("type") == "pacnet"
    return folder / _POLICY if is_policy else folder


def kind_of(folder: Path) -> str:
    """Return the name of the class that a checkpoint is of.

    Raises:
        FileNotFoundError: no checkpoint there.
        ValueError: a damaged file, another format, or a version that this release cannot read.
    """
    fields, _ = read_checkpoint(folder)
    return str(fields.get("model", "PACNet" if "attention" in fields else "something else"))


def size_of(folder: Path) -> int:
    """Return the size of a checkpoint [bytes]."""
    return sum((folder / name).stat().st_size for name in (CONFIG_FILE, TENSOR_FILE))


def load_imitator(checkpoint: str | Path) -> Imitator:
    """Load an imitator, also from a LeRobot policy.

    Raises:
        FileNotFoundError: no checkpoint there.
        ValueError: it is damaged, or of something else.
    """
    folder = checkpoint_folder(checkpoint)
    kind = kind_of(folder)
    if kind != Imitator.__name__:
        raise ValueError(
            f"expected the checkpoint of an Imitator, as `pacnet fit` writes it, in '{folder}', "
            f"got that of a {kind}"
        )
    return Imitator.from_pretrained(folder)


def feature_names(imitator: Imitator) -> dict[str, str | None]:
    """Return the features of its percepts, as `load_demonstrations` takes them.

    Raises:
        ValueError: some are encoded images, and the command line has no encoder.
    """
    features = list(imitator.config.percepts)
    if len(features) > 2:
        raise ValueError(
            "expected percepts of a state and an environment state alone, got "
            f"{', '.join(features)}: images need their encoder, use pacnet.Imitator in Python"
        )
    return {"state": features[0], "environment_state": features[1] if features[1:] else None}


def load_percepts(imitator: Imitator, dataset: str) -> Demonstrations:
    """Load the percepts of a dataset for an imitator; the dataset needs no actions.

    Raises:
        DatasetError: the dataset cannot be read.
        ValueError: its features or its rate are not the imitator's.
    """
    features = feature_names(imitator)
    state, environment_state = str(features["state"]), features["environment_state"]
    demonstrations = load_demonstrations(
        dataset, state=state, environment_state=environment_state, action=state
    )
    for feature, names in imitator.config.percepts.items():
        got = demonstrations.names.get(feature, ())
        if got != names:
            raise ValueError(
                f"expected {feature!r} with the dimensions {', '.join(names)}, as learned, "
                f"got {', '.join(got) or 'none'} in {dataset}"
            )
    if demonstrations.fps != imitator.config.fps:
        raise ValueError(
            f"expected {imitator.config.fps:g} frames per second, as learned, "
            f"got {demonstrations.fps:g} in {dataset}"
        )
    return demonstrations
