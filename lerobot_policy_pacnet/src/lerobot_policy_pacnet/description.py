"""What the policy needs of LeRobot's metadata of the dataset it is trained on."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from lerobot.utils.constants import ACTION, OBS_ENV_STATE

from pacnet.datasets.format.info import listed_names

_SNAPSHOTS = "snapshots"  # folder of the Hub's cache, in which datasets are named by a digest


@dataclass(frozen=True)
class DatasetDescription:
    """The properties of a dataset that an imitator depends on.

    Attributes:
        source: name of the dataset.
        fps: frames per second [1/s].
        names: feature -> names of its dimensions, in the order of the percept, then the action.
        frames: number of frames.
        fingerprint: digest of its names, counts and statistics, to recognise the same data.
    """

    source: str
    fps: float
    names: Mapping[str, tuple[str, ...]]
    frames: int
    fingerprint: str

    def __post_init__(self) -> None:
        """Turn the lists that JSON reads into tuples."""
        names = {feature: tuple(parts) for feature, parts in self.names.items()}
        object.__setattr__(self, "names", names)

    @classmethod
    def of(cls, meta: Any, percepts: Iterable[str]) -> DatasetDescription:
        """Return the description of a dataset.

        Args:
            meta: LeRobot's metadata.
            percepts: the features of a percept, in their order.

        Raises:
            ValueError: a feature that the dataset does not have.
        """
        names = {name: _dimension_names(meta.features, name) for name in (*percepts, ACTION)}
        return cls(
            source=_name(meta),
            fps=meta.fps,
            names=names,
            frames=meta.total_frames,
            fingerprint=_fingerprint(meta, names),
        )

    @property
    def state_features(self) -> tuple[str, ...]:
        """The feature that is the robot's state; none if there is an environment state alone."""
        return tuple(name for name in [*self.names][:1] if name != OBS_ENV_STATE)

    @property
    def percepts(self) -> dict[str, tuple[str, ...]]:
        """Names of each feature of a percept and of its dimensions, in the percept's order."""
        return {name: parts for name, parts in self.names.items() if name != ACTION}

    @property
    def percept_dimensions(self) -> int:
        """Length of a percept."""
        return sum(map(len, self.percepts.values()))

    @property
    def action_dimensions(self) -> int:
        """Length of an action."""
        return len(self.names[ACTION])


def _name(meta: Any) -> str:
    """Return the folder's name, as `pacnet.datasets`; in the Hub's cache the repository's."""
    root = Path(meta.root).resolve()
    return Path(meta.repo_id).name if root.parent.name == _SNAPSHOTS else root.name


def _dimension_names(features: Mapping[str, Any], feature: str) -> tuple[str, ...]:
    """Return names as `pacnet.datasets` does: numbers where dimensions have no names."""
    if feature not in features:
        raise ValueError(f"expected the feature {feature!r}, the dataset has {', '.join(features)}")
    spec = {**features[feature], "shape": list(features[feature]["shape"])}
    return tuple(listed_names(spec) or map(str, range(spec["shape"][0])))


def _fingerprint(meta: Any, names: Mapping[str, tuple[str, ...]]) -> str:
    statistics = {
        feature: {name: np.asarray(value).tolist() for name, value in measures.items()}
        for feature, measures in (meta.stats or {}).items()
        if feature in names
    }
    counts = [meta.fps, meta.total_episodes, meta.total_frames]
    text = json.dumps([counts, names, statistics], sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()
