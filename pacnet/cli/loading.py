"""Loading of imitators, and of datasets for them."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

from pacnet.cli.notes import show_notes
from pacnet.core.checkpoint import CONFIG_FILE, TENSOR_FILE, read_checkpoint
from pacnet.core.parts import REMEDY, read_json_part
from pacnet.datasets.demonstrations import Demonstrations, load_demonstrations
from pacnet.datasets.format import MissingFeature
from pacnet.datasets.pictures.camera_choice import UnknownCamera
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
    except (OSError, ValueError, RecursionError):
        config = None
    is_policy = isinstance(config, dict) and config.get("type") == "pacnet"
    return folder / _POLICY if is_policy else folder


def existing_checkpoint(checkpoint: str | Path) -> Path:
    """Return the folder of a checkpoint, as `checkpoint_folder`, that is to be read.

    Raises:
        FileNotFoundError: a LeRobot policy without a checkpoint or without its config.
        ValueError: an empty name, or a policy with a damaged config.
    """
    folder = checkpoint_folder(checkpoint)
    if (Path(checkpoint) / _POLICY).is_dir():
        read_json_part(Path(checkpoint), CONFIG_FILE)
    if folder != Path(checkpoint) and not folder.is_dir():
        raise FileNotFoundError(
            f"expected the folder {_POLICY} of a trained policy in '{checkpoint}', got none: it "
            f"has learned nothing yet, or its copy is incomplete; then {REMEDY}"
        )
    return folder


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


def load_imitator(checkpoint: str | Path, task: str | None = None) -> Imitator:
    """Load an imitator, also from a LeRobot policy.

    Args:
        checkpoint: its folder.
        task: what it is to do, as of `Imitator.reset`.

    Raises:
        FileNotFoundError: no checkpoint there.
        ValueError: it is damaged, or of something else; or an unknown task.
    """
    folder = existing_checkpoint(checkpoint)
    kind = kind_of(folder)
    if kind != Imitator.__name__:
        raise ValueError(
            f"expected the checkpoint of an Imitator, as `pacnet fit` writes it, in '{folder}', "
            f"got that of a {kind}"
        )
    imitator = Imitator.from_pretrained(folder)
    imitator.reset(task)
    return imitator


def feature_names(imitator: Imitator) -> dict[str, tuple[str, ...]]:
    """Return the imitator's features of each kind, as `load_demonstrations` takes them."""
    config = imitator.config
    state = config.state_features
    rest = tuple(feature for feature in config.perceived if feature not in state)
    return {"state": state, "environment_state": rest, "action": config.action_features}


def load_dataset(
    arguments: argparse.Namespace, imitator: Imitator | None, **options: Any
) -> Demonstrations:
    """Load the episodes of a dataset that the arguments of `parsing.add_dataset` ask for.

    What its files contradict is printed on stderr from now on.

    Args:
        arguments: of the command.
        imitator: whose features are loaded where the options name no others; None for the usual.
        options: as `load_demonstrations` takes them.

    Raises:
        DatasetError: the dataset cannot be read.
        ValueError: it lacks a feature that the imitator has learned, or a feature is given twice.
    """
    show_notes()
    learned: dict[str, Any] = {} if imitator is None else {**feature_names(imitator)}
    try:
        return load_demonstrations(
            arguments.dataset,
            episodes=arguments.episodes,
            exclude=arguments.exclude,
            skip_damaged=arguments.skip_damaged,
            **learned | options,
        )
    except UnknownCamera as error:
        if imitator is None:
            raise
        raise ValueError(
            f"{error}: the imitator has learned to look at "
            f"{' and '.join(map(repr, options['cameras']))}"
        ) from None
    except MissingFeature as error:
        percepts = {} if imitator is None else imitator.config.perceived
        if not any(name in percepts for name in error.features):
            raise
        raise ValueError(
            f"{error.problem}: the imitator has learned {' and '.join(map(repr, percepts))}"
        ) from None


def load_percepts(imitator: Imitator, arguments: argparse.Namespace) -> Demonstrations:
    """Load the percepts of a dataset for an imitator; the dataset needs no actions.

    Raises:
        DatasetError: the dataset cannot be read.
        ValueError: its features or its rate are not the imitator's.
    """
    dataset = arguments.dataset
    cameras = None if imitator.cameras is None else imitator.cameras.features
    demonstrations = load_dataset(arguments, imitator, action=None, cameras=cameras)
    for feature, names in imitator.config.perceived.items():
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
