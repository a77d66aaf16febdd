"""Checks of demonstrations, before an imitator learns the first of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise

import numpy as np
import torch
from torch import Tensor

from pacnet.attention.sofm import HabituatingSOFM
from pacnet.core.validation import check_bounded, check_index, check_rows, is_integer
from pacnet.datasets.demonstrations import Demonstration, Demonstrations
from pacnet.imitator.config import ImitatorConfig
from pacnet.vision.cameras_config import CamerasConfig

_LIKE = torch.empty(0)  # float32 on the CPU, as all of a demonstration's tensors must be


def check_demonstrations(
    demonstrations: object, config: ImitatorConfig, sofm: HabituatingSOFM
) -> None:
    """Raise a ValueError unless an imitator can learn all of these demonstrations."""
    demonstrations = _checked(demonstrations)
    if not isinstance(demonstrations.source, str):
        raise ValueError(f"expected their source as a str, got {demonstrations.source!r}")
    _check_features(demonstrations, config, config.percepts)
    if demonstrations.fps != config.fps:
        raise ValueError(
            f"expected {config.fps} frames per second, as learned before, got {demonstrations.fps}"
        )
    for shown in demonstrations:
        try:
            _check_one(shown, config, sofm)
        except ValueError as error:
            raise ValueError(f"episode {shown.episode}: {error}") from None


def check_pictured(demonstrations: object, config: ImitatorConfig) -> None:
    """Raise a ValueError unless an imitator's cameras can look at all of these demonstrations."""
    demonstrations = _checked(demonstrations)
    _check_features(demonstrations, config, config.perceived)
    state, cameras = config.state_dimensions, config.cameras
    for shown in demonstrations:
        rest = config.perceived_dimensions - state
        rest -= 0 if shown.encoded is None else shown.encoded.shape[1]
        try:
            check_rows("state", shown.state, state, _LIKE)
            check_rows("environment_state", shown.environment_state, rest, _LIKE)
            if cameras is not None:
                _check_pictures(shown, cameras)
        except ValueError as error:
            raise ValueError(f"episode {shown.episode}: {error}") from None


def _check_pictures(shown: Demonstration, cameras: CamerasConfig) -> None:
    """Raise a ValueError unless the pictures of each camera that there are fit what it learned."""
    for name, one in zip(cameras.features, cameras.encoders, strict=True):
        if name not in shown.pictures:
            continue
        pictures, wanted = shown.pictures[name], (len(shown.state), one.height, one.width, 3)
        dtype, shape = getattr(pictures, "dtype", None), getattr(pictures, "shape", ())
        if dtype != np.uint8 or tuple(shape) != wanted:
            raise ValueError(
                f"expected pictures of {name!r} as uint8 {[*wanted]}, got {dtype} {[*shape]}"
            )


def _checked(demonstrations: object) -> Demonstrations:
    if not isinstance(demonstrations, Demonstrations):
        raise ValueError(f"expected Demonstrations, got {type(demonstrations).__name__}")
    return demonstrations


def _check_features(
    demonstrations: Demonstrations,
    config: ImitatorConfig,
    wanted: Mapping[str, tuple[str, ...]],
) -> None:
    """Raise a ValueError unless percepts and actions have the dimensions learned before."""
    got = demonstrations.percept_features
    names = dict.fromkeys((*wanted, *got))
    pairs = [(name, wanted.get(name), got.get(name)) for name in names]
    for name, expected, found in (*pairs, ("action", config.action, demonstrations.action_names)):
        if expected != found:
            raise ValueError(
                f"expected {name!r} with the dimensions {_listed(expected)}, as learned before, "
                f"got {_listed(found)}"
            )
    expected, found = config.state_features, demonstrations.state_features
    if expected != found:
        raise ValueError(
            f"expected the state {_listed(expected)}, as learned before, got {_listed(found)}"
        )


def _check_one(shown: Demonstration, config: ImitatorConfig, sofm: HabituatingSOFM) -> None:
    """Raise a ValueError unless a demonstration has the right types, sizes and finite values."""
    check_index("the episode's number", shown.episode, 2**63)
    check_index("the first frame's number", shown.first_frame, 2**63)
    if not isinstance(shown.task, str):
        raise ValueError(f"expected a task as a str, got {shown.task!r}")
    encoded, state, action = shown.encoded, config.state_dimensions, len(config.action)
    width = encoded.shape[1] if isinstance(encoded, Tensor) and encoded.dim() == 2 else 0
    environment = len(config.percept_names) - state - width
    check_state = check_bounded if config.targets == "state" else check_rows
    rows = [
        check_state("state", shown.state, state, _LIKE),
        check_rows("environment_state", shown.environment_state, environment, _LIKE),
        check_bounded("action", shown.action, action, _LIKE),
    ]
    if encoded is not None:
        rows.append(check_rows("encoded", encoded, width, _LIKE))
    if len(set(map(len, rows))) > 1:
        raise ValueError(
            f"expected one action for each percept, got {len(shown.action)} actions, "
            f"{len(shown.state)} states and {len(shown.environment_state)} environment states"
        )
    sofm.normalize(shown.percepts)  # refuses percepts that are too large
    scale = shown.percepts.new_tensor(config.scaling.scale)
    check_bounded("scaled percepts", shown.percepts * scale, len(scale), _LIKE)
    _check_gaps(shown)


def _check_gaps(shown: Demonstration) -> None:
    """Raise a ValueError unless gaps lie in order within a demonstration."""
    gaps, end = shown.gaps, len(shown.state)
    whole = all(is_integer(gap, 1) and gap < end for gap in gaps)
    if not whole or any(gap >= later for gap, later in pairwise(gaps)):
        raise ValueError(f"expected gaps in order, from 1 to {end - 1}, got {gaps!r}")


def _listed(names: Sequence[str] | None) -> str:
    return ", ".join(names) if names else "none"
