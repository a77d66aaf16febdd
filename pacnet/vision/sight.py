"""What an imitator has seen in an episode: the goals, told by several looks and all cameras."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from pacnet.vision.encoder import ImageEncoder, Look
from pacnet.vision.goals import SHARES

_CERTAIN = 1.0  # doubt up to which a look counts
_LATE = 0.5  # of the frames until the hand may be in the way: it may come sooner than was shown


class Seen(NamedTuple):
    """What all cameras tell at one moment."""

    goals: NDArray[np.float32]
    """Where the hand will be, `[G · S]`."""
    doubt: float
    """How unlike what was shown pictures are, of the camera where that is most; above 1 new."""
    camera: int
    """Number of that camera."""
    looks: tuple[Look, ...]
    """The last look of each camera."""


class Sight:
    """Looks at the pictures of an episode, one after the other.

    A goal is the median of the last looks that were certain, so a bad picture does no harm, and
    what is moved is seen. Once the hand may be in the way it looks no longer: after as many frames
    as were shown, or at the first doubt after half of them.

    Args:
        encoders: of the cameras.
        at_once: looks of which the median is taken.
        until: frames in which something is done after which the hand may be in the way; `acted`
            counts them.
    """

    def __init__(self, encoders: Sequence[ImageEncoder], at_once: int, until: int) -> None:
        self._encoders, self._until, self._frames = encoders, until, 0
        self._certain = [deque[NDArray[np.float32]](maxlen=at_once) for _ in encoders]
        self._doubts = [deque[float](maxlen=at_once) for _ in encoders]
        self._shifts: list[Tensor | None] = [None] * len(encoders)
        self._last: Seen | None = None
        self._shares = _shares_of(encoders)

    @property
    def last(self) -> Seen | None:
        """What was seen last, once the hand may be in the way; None before: look."""
        return self._last if self._frames > self._until else None

    def __call__(self, pictures: Sequence[NDArray[np.uint8]]) -> Seen:
        """Return what is seen now, from one reduced picture `[h, w, 3]` of each camera."""
        looks = [
            encoder.look(torch.from_numpy(np.ascontiguousarray(picture)), shift)
            for encoder, picture, shift in zip(self._encoders, pictures, self._shifts, strict=True)
        ]
        # A camera may be nudged while nothing is certain.
        self._shifts = [look.shift if look.doubt <= _CERTAIN else None for look in looks]
        goals = np.stack([self._take(*one) for one in enumerate(looks)])
        doubts = [float(np.median(own)) for own in self._doubts]
        camera = int(np.argmax(doubts))
        is_certain = doubts[camera] <= _CERTAIN
        if self._last is not None and not is_certain and self._frames > _LATE * self._until:
            self._frames = self._until + 1
            return self._last
        fused = (self._shares * goals).sum(axis=0).astype(np.float32)
        self._last = Seen(fused, doubts[camera], camera, tuple(looks))
        return self._last

    def acted(self) -> None:
        """Take note that something is done in this frame, by which the hand comes nearer."""
        self._frames += 1

    def _take(self, camera: int, look: Look) -> NDArray[np.float32]:
        """Take in one camera's look; return the goals that it tells by now."""
        certain = self._certain[camera]
        self._doubts[camera].append(look.doubt)
        if look.doubt <= _CERTAIN:
            certain.append(look.goals.numpy())
        return np.median(certain, axis=0) if certain else look.goals.numpy()


def _shares_of(encoders: Sequence[ImageEncoder]) -> NDArray[np.float64]:
    """Return the say of each camera, `[C, 1]`: by its error when left out."""
    exact = np.array([1 / max(1e-12, encoder.told.error) ** 2 for encoder in encoders])
    return (exact / exact.sum())[:, None]


def frames_of(seconds: float, fps: float, shortest: int) -> int:
    """Return how many frames a beginning has: those of some time, or a tenth of the shortest."""
    return max(1, min(round(seconds * fps), shortest // 10))


def steps_of(goals: NDArray[np.floating]) -> NDArray[np.floating]:
    """Return goals `[..., G · S]` one by one, `[..., G, S]`."""
    count = len(SHARES)
    return goals.reshape(*goals.shape[:-1], count, goals.shape[-1] // count)
