"""Images of a LeRobot dataset made into vectors by somebody's encoder; LeRobot decodes them.

Attention compares percepts by distance, which means nothing between pixels: what an encoder makes
of an image can be compared.
"""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from pacnet.datasets.format.errors import DatasetError
from pacnet.datasets.format.lerobot_files import PICTURES
from pacnet.datasets.format.places import check_data_path, check_video_path

Encoder = Callable[[Tensor], Tensor]
"""Makes a vector [F] of an image [channels, height, width], float32 from 0 to 1."""


@torch.no_grad()
def encode_images(
    root: Path, info: Mapping[str, Any], encoders: Mapping[str, Encoder]
) -> dict[str, Tensor]:
    """Decodes and encodes every image of these features, with a progress bar.

    Args:
        root: The dataset's folder.
        info: The content of its `meta/info.json`.
        encoders: Feature -> encoder of its images.

    Returns:
        Feature -> vectors of all frames, float32 [N, F].

    Raises:
        DatasetError: LeRobot is not installed, or the dataset names files outside of its folder.
        ValueError: A feature that the dataset lacks or that is no image or video, or an encoder
            that gives something else than finite vectors of one length.
    """
    for feature in encoders:
        description = info["features"].get(feature)
        if not isinstance(description, dict) or description.get("dtype") not in PICTURES:
            pictures = [
                name for name, told in info["features"].items()
                if isinstance(told, dict) and told.get("dtype") in PICTURES
            ]  # fmt: skip
            raise ValueError(
                f"expected encoders for images or videos of the dataset "
                f"({', '.join(pictures) or 'it has none'}), got one for {feature!r}"
            )
    _check_paths(info)
    vectors: dict[str, list[Tensor]] = {feature: [] for feature in encoders}
    for frame in _frames(root):
        for feature, encoder in encoders.items():
            vector = _checked(feature, encoder(frame[feature]), vectors[feature])
            vectors[feature].append(vector)
    return {feature: torch.stack(rows) for feature, rows in vectors.items()}


def _check_paths(info: Mapping[str, Any]) -> None:
    """Refuse templates of paths that lead LeRobot, which believes them, out of the dataset."""
    if info.get("data_path") is not None:
        check_data_path(info["data_path"])
    videos = [
        name
        for name, told in info["features"].items()
        if isinstance(told, dict) and told.get("dtype") == "video"
    ]
    if videos:
        check_video_path(info.get("video_path"), videos)


def _frames(root: Path) -> Any:
    """Every frame of the dataset as LeRobot gives it, with a progress bar."""
    try:
        from lerobot.datasets.lerobot_dataset import LeRobotDataset
        from tqdm import tqdm
    except ImportError as error:
        raise DatasetError(
            "expected LeRobot to decode images with: pip install 'pacnet[datasets]'"
        ) from error
    # Any other backend has LeRobot look for torchcodec, which fails noisily.
    dataset = LeRobotDataset(f"local/{root.name}", root=root, video_backend="pyav")
    numbers = tqdm(range(len(dataset)), "encoding images", unit="frame", leave=False)
    return (dataset[number] for number in numbers)


def _checked(feature: str, vector: object, before: list[Tensor]) -> Tensor:
    """An encoder's vector as float32 [F] on the CPU, or a ValueError."""
    wanted = f"expected the encoder of {feature!r} to give a finite vector"
    if before:
        wanted += f" of length {len(before[0])}"
    if not isinstance(vector, Tensor) or vector.dim() != 1 or len(vector) == 0:
        got = list(vector.shape) if isinstance(vector, Tensor) else type(vector).__name__
        raise ValueError(f"{wanted}, got {got}")
    if before and len(vector) != len(before[0]):
        raise ValueError(f"{wanted}, got one of length {len(vector)}")
    if not bool(vector.isfinite().all()):
        raise ValueError(f"{wanted}, got {vector.tolist()} in frame {len(before)}")
    return vector.to("cpu", torch.float32, copy=True)  # it may be a buffer of the encoder
