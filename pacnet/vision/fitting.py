"""Chooses which cameras help, and what looks at their pictures, by leaving each episode out."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray

from pacnet.datasets.records import Demonstration, Demonstrations
from pacnet.vision.backbones import features_of
from pacnet.vision.cameras import Cameras, Hands, pictures_of
from pacnet.vision.cameras_config import CamerasConfig
from pacnet.vision.config import (
    KINDS_TEXT,
    NONE,
    PATCHES,
    PCA,
    ImageEncoderConfig,
    Told,
    is_kind,
)
from pacnet.vision.encoder import LEAST, ImageEncoder
from pacnet.vision.goals import goal_names, goals_of
from pacnet.vision.regression import SIGNIFICANT
from pacnet.vision.sight import frames_of, steps_of

AUTO = "auto"
_BEGINNING = 0.5  # [s] of an episode, in which looks count as one
_MOST_AT_ONCE = 15  # looks
_TELLS = 0.7  # share of the error without a camera that is left by one that helps, at most
_LOOKS = 16  # times in an episode at which it is tried whether the hand is in the way
_EARLY = 0.2  # share of the demonstrations in which it may be in the way sooner
_OFF = 3.0  # times the error when left out: farther, what is told is wrong
_SMALLEST = 8  # pixels of a side
_PATCH = 7 / 128  # of the picture's longer side


class CameraReport(NamedTuple):
    """What one camera tells."""

    feature: str
    kind: str
    told: Told

    @property
    def helps(self) -> bool:
        """Whether the camera is used."""
        return self.kind != NONE


def fit_cameras(
    demonstrations: Demonstrations,
    hands: Hands,
    hand_names: tuple[str, ...],
    encoder: str = AUTO,
) -> tuple[Cameras | None, tuple[CameraReport, ...]]:
    """Return the cameras that help, fitted, None for none; and what each of them tells.

    Args:
        demonstrations: whole episodes.
        hands: where the hand is in them.
        hand_names: names of its S dimensions.
        encoder: the kind, for all cameras; "auto" for the first built-in one that tells goals.

    Raises:
        ValueError: an unknown kind; pictures that are none, or not one for each frame, or not
            reduced, as those that it acts on are.
    """
    if encoder != AUTO and not is_kind(encoder):
        raise ValueError(f"expected an encoder out of auto, {KINDS_TEXT}, got {encoder!r}")
    whole = [
        (number, shown, hand)
        for number, (shown, hand) in enumerate(zip(demonstrations, hands, strict=True))
        if shown.first_frame == 0 and len(hand)
    ]
    for _, shown, _ in whole:
        _check_pictures(shown)
    features = _everywhere([shown for _, shown, _ in whole])
    for feature in features:
        _check_reduced(feature, whole[0][1].pictures[feature])
    shortest = min((len(hand) for _, _, hand in whole), default=1)
    at_once = min(_MOST_AT_ONCE, frames_of(_BEGINNING, demonstrations.fps, shortest))
    reports, used = [], {}
    for feature in features:
        best = _best(
            [(n, s.pictures[feature], h) for n, s, h in whole],
            hand_names,
            encoder,
            demonstrations.fps,
        )
        helps = best.config.kind != NONE and (encoder != AUTO or _tells(best))
        reports.append(CameraReport(feature, best.config.kind if helps else NONE, best.told))
        if helps:
            used[feature] = best
    if not used:
        return None, tuple(reports)
    config = CamerasConfig(
        tuple(used), tuple(one.config for one in used.values()), hand_names, at_once, until=0
    )
    until = min(_until(one, feature, whole) for feature, one in used.items())
    cameras = Cameras(CamerasConfig(**{**vars(config), "until": until}))
    for own, fitted in zip(cameras.parts, used.values(), strict=True):
        own.load_state_dict(fitted.state_dict())
    return cameras, tuple(reports)


def _tells(encoder: ImageEncoder) -> bool:
    """Return whether an encoder tells goals, and not by chance alone."""
    told = encoder.told
    return told.chance <= SIGNIFICANT and told.error <= _TELLS * told.alone


def _everywhere(episodes: Sequence[Demonstration]) -> tuple[str, ...]:
    """Return the cameras that all episodes have, with pictures of one size that is not tiny."""
    if not episodes:
        return ()
    return tuple(
        feature
        for feature in episodes[0].pictures
        if len(
            {one.pictures[feature].shape[1:] if feature in one.pictures else () for one in episodes}
        )
        == 1
        and min(episodes[0].pictures[feature].shape[1:3]) >= _SMALLEST
    )


def _check_pictures(shown: Demonstration) -> None:
    for feature, pictures in shown.pictures.items():
        dtype, shape = getattr(pictures, "dtype", None), tuple(getattr(pictures, "shape", ()))
        if dtype != np.uint8 or len(shape) != 4 or shape[::3] != (len(shown.state), 3):
            raise ValueError(
                f"episode {shown.episode}: expected pictures of {feature!r} as uint8 "
                f"[{len(shown.state)}, height, width, 3], got {dtype} {[*shape]}"
            )


def _check_reduced(feature: str, pictures: NDArray[np.uint8]) -> None:
    from pacnet.datasets.pictures import MAX_SIDE  # imports numba

    height, width = pictures.shape[1:3]
    if max(height, width) > MAX_SIDE:
        raise ValueError(
            f"expected pictures of {feature!r} with sides up to {MAX_SIDE} pixels, as "
            f"pacnet.datasets.pictures.reduce makes them, got {width} x {height}"
        )


def _best(
    shown: Sequence[tuple[int, NDArray[np.uint8], NDArray[np.floating]]],
    hand_names: tuple[str, ...],
    encoder: str,
    fps: float,
) -> ImageEncoder:
    """Return the fitted encoder of the first kind that tells goals, patches before eigenimages.

    Eigenimages are of all that is in the picture: another light, or the hand, is new to them.
    """
    if encoder != AUTO:
        return _fitted(encoder, shown, hand_names, fps)
    if len(shown) < LEAST:
        return _fitted(NONE, shown, hand_names, fps)
    tried = []
    for kind in (PATCHES, PCA):
        tried.append(_fitted(kind, shown, hand_names, fps))
        if _tells(tried[-1]):
            return tried[-1]
    return min(tried, key=lambda one: one.told.chance)


def _fitted(
    kind: str,
    shown: Sequence[tuple[int, NDArray[np.uint8], NDArray[np.floating]]],
    hand_names: tuple[str, ...],
    fps: float,
) -> ImageEncoder:
    height, width = shown[0][1].shape[1:3]
    features, digest = (0, None)
    if kind not in (NONE, PATCHES):
        features, digest = features_of(kind, height, width)
    patch = max(3, min(round(_PATCH * max(height, width)), min(height, width) // 2))
    encoder = ImageEncoder(
        ImageEncoderConfig(
            kind, height, width, len(goal_names(hand_names)), patch, features, digest
        )
    )
    for number, pictures, hand in shown:
        encoder.add(*pictures_of(pictures, fps), torch.from_numpy(goals_of(hand, fps)), number)
    encoder.fit()
    return encoder


def _until(
    encoder: ImageEncoder,
    feature: str,
    whole: Sequence[tuple[int, Demonstration, NDArray[np.floating]]],
) -> int:
    """Return for how many frames of most demonstrations what is told stays the same."""
    frames = []
    for _, shown, _ in whole:
        pictures = shown.pictures[feature]
        times = np.unique(np.linspace(0, len(pictures) - 1, _LOOKS).round().astype(int)).tolist()
        first, last = None, 0
        for time in times:
            look = encoder.look(torch.from_numpy(np.array(pictures[time])))
            goals = steps_of(look.goals.numpy())
            first = goals if first is None else first
            apart = np.linalg.norm(goals - first, axis=1).mean()
            if look.doubt > 1 or apart > _OFF * encoder.told.error:
                break
            last = time
        frames.append(last)
    return int(np.quantile(frames, _EARLY))
