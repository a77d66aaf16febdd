"""Whether a recording fits the dataset that it is to be appended to."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pacnet.datasets.format.features import RESERVED, STORED, Feature, Picture, Recording
from pacnet.datasets.format.info import VIDEO, listed_names


def check_same(root: Path, info: dict[str, Any], recording: Recording) -> None:
    """Raise a ValueError unless a dataset has the features, `fps` and robot of a recording."""
    features = {name: entry for name, entry in info["features"].items() if name not in RESERVED}
    for name, entry in features.items():
        if entry["dtype"] not in (*STORED, VIDEO):
            raise ValueError(
                f"expected a dataset of {', '.join((*STORED, VIDEO))}, which is what Recorder "
                f"stores: with {name!r} being {entry['dtype']}, {root} cannot be appended to with "
                "it"
            )
    if recording.fps != info["fps"]:
        raise ValueError(f"expected fps {info['fps']} as in {root}, got {recording.fps}")
    got = {*recording.features, *recording.cameras}
    if set(features) != got:
        raise ValueError(
            f"expected the features {sorted(features)} as in {root}, got {sorted(got)}"
        )
    for name, picture in recording.cameras.items():
        _check_camera(root, name, features[name], picture)
    for name, feature in recording.features.items():
        _check_feature(root, name, features[name], feature)
    robot = info.get("robot_type")
    if recording.robot_type not in (None, robot):
        raise ValueError(
            f"expected robot_type {robot!r} as in {root}, got {recording.robot_type!r}"
        )


def _check_feature(root: Path, name: str, entry: Mapping[str, Any], feature: Feature) -> None:
    names, dtype, shape = list(feature.names), entry["dtype"], entry["shape"]
    # Without names in the dataset, any names fit that are as many as its dimensions.
    unnamed = names if shape == [len(names)] else [f"shape {shape}"]
    expected = listed_names(entry) or unnamed
    if (dtype, expected) != (feature.dtype, names):
        raise ValueError(
            f"expected {name!r} as {dtype} of {expected} as in {root}, "
            f"got {feature.dtype} of {names}"
        )


def _check_camera(root: Path, name: str, entry: Mapping[str, Any], picture: Picture) -> None:
    if (entry["dtype"], entry["shape"]) != (VIDEO, [*picture.shape]):
        raise ValueError(
            f"expected {name!r} as {entry['dtype']} of shape {entry['shape']} as in {root}, got "
            f"pictures of shape {[*picture.shape]}"
        )
