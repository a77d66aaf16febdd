"""Which cameras of a dataset are read."""

from collections.abc import Mapping, Sequence
from typing import Any, Literal

from pacnet.datasets.format import DatasetError
from pacnet.datasets.format.info import image_features

CameraChoice = Literal["all"] | str | Sequence[str]
"""All cameras, or some by their features or the last parts of these, such as "top"."""

ALL = "all"


class UnknownCamera(DatasetError):  # noqa: N818 — it is a kind of DatasetError
    """A camera was asked for that the dataset does not have, or that could be several."""


def choose_cameras(info: Mapping[str, Any], cameras: CameraChoice) -> list[str]:
    """Return the features of the cameras asked for, each once.

    Raises:
        UnknownCamera: the dataset has no such camera, or several.
    """
    there = image_features(info)
    if cameras == ALL:
        return there
    asked = [cameras] if isinstance(cameras, str) else [*cameras]
    return [*dict.fromkeys(_camera(there, name) for name in asked)]


def _camera(there: Sequence[str], name: object) -> str:
    if name in there:
        return str(name)
    found = [camera for camera in there if camera.split(".")[-1] == name]
    if len(found) == 1:
        return found[0]
    expected = ", ".join(found or there) or "it has none"
    which = "one of the cameras" if found else "a camera of the dataset"
    raise UnknownCamera(f"expected {which} ({expected}), got {name!r}")


def shows_depth(info: Mapping[str, Any], camera: str) -> bool:
    """Return whether a camera is said to measure distances."""
    feature = info["features"][camera]
    every = (feature, feature.get("info"), feature.get("video_info"))
    return any(
        details.get(name) is True
        for details in every
        if isinstance(details, dict)
        for name in ("is_depth_map", "video.is_depth_map")
    )
