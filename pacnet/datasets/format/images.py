"""Images of a dataset turned into vectors by the user's encoders; LeRobot decodes the images.

Attention compares percepts by distance, which is meaningful between encodings, not between pixels.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from pacnet.datasets.format import DatasetError
from pacnet.datasets.format.info import FORMAT_VERSION, image_features
from pacnet.datasets.format.paths import check_data_path, check_video_path

Encoder = Callable[[Tensor], Tensor]
"""Turns an image [channels, height, width], float32 from 0 to 1, into a vector [F]."""


@torch.no_grad()
def encode_images(
    root: Path, info: Mapping[str, Any], encoders: Mapping[str, Encoder], frames: Sequence[int]
) -> dict[str, Tensor]:
    """Decode and encode the images of the encoders' features, with a progress bar.

    Args:
        root: the dataset's folder.
        info: its description.
        encoders: image or video feature -> its encoder.
        frames: N rows of all data files, one after the other, as LeRobot counts them.

    Returns:
        Feature -> vectors of these frames, float32 `[N, F]`.

    Raises:
        DatasetError: LeRobot is not installed, or the dataset names files outside of its folder.
        ValueError: a feature is missing or no image or video, or an encoder's vectors are not
            finite or not of one length.
    """
    found = image_features(info)
    for feature in encoders:
        if feature not in found:
            raise ValueError(
                f"expected encoders for images or videos of the dataset "
                f"({', '.join(found) or 'it has none'}), got one for {feature!r}"
            )
    if info.get("codebase_version", FORMAT_VERSION) != FORMAT_VERSION:
        raise DatasetError(
            f"expected a dataset of format {FORMAT_VERSION} to decode images of, found "
            f"{info['codebase_version']}: `pacnet export` copies it to {FORMAT_VERSION}"
        )
    # LeRobot opens whatever files these templates lead it to.
    if info.get("data_path") is not None:
        check_data_path(info["data_path"])
    videos = image_features(info, "video")
    if videos:
        check_video_path(info.get("video_path"), videos)
    vectors: dict[str, list[Tensor]] = {feature: [] for feature in encoders}
    for frame in _decoded_frames(root, frames):
        for feature, encoder in encoders.items():
            rows = vectors[feature]
            rows.append(_checked_vector(feature, encoder(frame[feature]), rows))
    return {feature: torch.stack(rows) for feature, rows in vectors.items()}


def _decoded_frames(root: Path, frames: Sequence[int]) -> Iterator[dict[str, Tensor]]:
    try:
        from lerobot.datasets.lerobot_dataset import LeRobotDataset
        from tqdm import tqdm
    except ImportError as error:
        raise DatasetError(
            "expected LeRobot to decode images with: pip install 'pacnet[datasets]'"
        ) from error
    # Any other backend makes LeRobot look for torchcodec, which fails noisily.
    dataset = LeRobotDataset(f"local/{root.name}", root=root, video_backend="pyav")
    for index in tqdm(frames, "encoding images", unit="frame", leave=False):
        yield dataset[index]


def _checked_vector(feature: str, vector: object, before: list[Tensor]) -> Tensor:
    """Return an encoder's vector as float32 `[F]` on the CPU."""
    expected = f"expected the encoder of {feature!r} to give a finite vector"
    if before:
        expected += f" of length {len(before[0])}"
    if not isinstance(vector, Tensor) or vector.dim() != 1 or len(vector) == 0:
        got = list(vector.shape) if isinstance(vector, Tensor) else type(vector).__name__
        raise ValueError(f"{expected}, got {got}")
    if before and len(vector) != len(before[0]):
        raise ValueError(f"{expected}, got one of length {len(vector)}")
    if not bool(vector.isfinite().all()):
        raise ValueError(f"{expected}, got {vector.tolist()} in frame {len(before)}")
    return vector.to("cpu", torch.float32, copy=True)  # it may be a buffer of the encoder
