"""What the commands read: imitators, and datasets that one of them is to watch."""

from __future__ import annotations

import json
from pathlib import Path

from pacnet.core.checkpoint import CONFIG_FILE, read_checkpoint
from pacnet.datasets.demonstrations import Demonstrations, load_demonstrations
from pacnet.imitator.imitator import Imitator

POLICY = "imitator"  # folder within that of a LeRobot policy


def checkpoint_folder(folder: str | Path) -> Path:
    """The folder of the checkpoint itself, where a LeRobot policy holds it.

    Raises:
        ValueError: an empty name.
    """
    if not str(folder):
        raise ValueError("expected the folder of a checkpoint, got an empty name")
    folder = Path(folder)
    return folder / POLICY if _is_policy(folder) else folder


def _is_policy(folder: Path) -> bool:
    """Whether LeRobot wrote the folder, for a policy of pacnet's."""
    try:
        config = json.loads((folder / CONFIG_FILE).read_bytes())
    except (OSError, ValueError):
        return False
    return isinstance(config, dict) and config.get("type") == "pacnet"


def kind_of(folder: Path) -> str:
    """The class of which there is a checkpoint.

    Raises:
        FileNotFoundError: no checkpoint there.
        ValueError: a damaged file, another format, or a version that this release cannot read.
    """
    fields, _ = read_checkpoint(folder)
    return str(fields.get("model", "PACNet" if "attention" in fields else "something else"))


def load_imitator(checkpoint: str | Path) -> Imitator:
    """Loads an imitator, also from within a LeRobot policy.

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
    """The features of its percepts, as `load_demonstrations` takes them.

    Raises:
        ValueError: they hold what an encoder made of images, which there is no way to name here.
    """
    features = list(imitator.config.percepts)
    if len(features) > 2:
        raise ValueError(
            "expected percepts of a state and an environment state alone, got "
            f"{', '.join(features)}: images need their encoder, use pacnet.Imitator in Python"
        )
    return {"state": features[0], "environment_state": features[1] if features[1:] else None}


def load_percepts(imitator: Imitator, dataset: str) -> Demonstrations:
    """What there is for an imitator to watch in a dataset; nobody needs to have acted in it.

    Raises:
        DatasetError: the dataset cannot be read.
        ValueError: its percepts or its rate are others than the imitator's.
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
                f"expected {feature!r} with the dimensions {_listed(names)}, as the imitator "
                f"learned it, got {_listed(got)} in {dataset}"
            )
    if demonstrations.fps != imitator.config.fps:
        raise ValueError(
            f"expected {imitator.config.fps:g} frames per second, as the imitator learned them, "
            f"got {demonstrations.fps:g} in {dataset}"
        )
    return demonstrations


def _listed(names: tuple[str, ...]) -> str:
    return f"{len(names)}: {', '.join(names)}" if names else "none"
