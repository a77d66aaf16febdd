"""What anybody could write in ten lines: nearest neighbours, and repeating the last action."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from numpy.typing import NDArray
from torch import Tensor

from pacnet.core.validation import is_integer, is_number
from pacnet.datasets.demonstrations import Demonstration, Demonstrations
from pacnet.evaluation.first_pictures import FirstPictures

_BLOCK_BYTES = 2**25  # of distances at a time
_LEAST_DEVIATION = 1e-5  # below it a dimension does not move


class NearestNeighbours:
    """The mean action of the k training frames whose percepts are nearest.

    Distances are Euclidean, each dimension in units of its standard deviation in the training
    data. A dimension that does not move there is scaled by the median factor of the others. With a
    history, a frame is its percept and what that has changed by since `history_s` before, or since
    the first frame; both are scaled. With cameras, the first pictures of both episodes count as
    much, on average. Nothing is compared across gaps in time.

    Args:
        k: number of neighbours; all frames where there are fewer.
        history_s: how far back the history reaches [s], rounded to frames and at least one; 0 for
            no history.
        cameras: whose first pictures are compared.

    Example:
        >>> state, none = torch.tensor([[0.0], [1.0], [2.0]]), torch.empty(3, 0)
        >>> shown = Demonstration(0, "pull", state, none, state * 10)
        >>> names = {"observation.state": ("x",), "action": ("x",)}
        >>> baseline = NearestNeighbours(2).fit(Demonstrations(50, names, (shown,)))
        >>> baseline.predict(shown.part(0, 1))
        array([[5.]], dtype=float32)
    """

    def __init__(self, k: int, history_s: float = 0.0, cameras: Sequence[str] = ()) -> None:
        if not is_integer(k, 1):
            raise ValueError(f"expected k as an integer ≥ 1, got {k!r}")
        if not is_number(history_s) or history_s < 0:
            raise ValueError(f"expected history_s ≥ 0 [s], got {history_s!r}")
        self.k = k
        self.history_s = history_s
        self.cameras = tuple(cameras)
        self._lag = 0  # [frames]
        self._center = self._factors = torch.empty(0, dtype=torch.float64)  # [D or 2 D]
        self._frames = torch.empty(0, 0, dtype=torch.float64)  # [N, D or 2 D], scaled
        self._actions = torch.empty(0, 0)  # [N, U]
        self._pictures: FirstPictures | None = None

    def fit(self, demonstrations: Demonstrations) -> NearestNeighbours:
        """Keep all frames of the training data; return itself.

        Raises:
            ValueError: no frames, or no pictures of a camera.
        """
        parts = _parts(demonstrations)
        self._lag = max(1, round(self.history_s * demonstrations.fps)) if self.history_s else 0
        frames = self._describe(parts)
        self._center, self._factors = frames.mean(dim=0), _factors(frames, bool(self._lag))
        self._frames = (frames - self._center) * self._factors
        self._actions = torch.cat([part.action for part in parts])
        if self.cameras:
            spread = self._frames.var(dim=0, correction=0).sum().item()
            self._pictures = FirstPictures(parts, self.cameras, spread)
        return self

    def predict(self, demonstration: Demonstration) -> NDArray:
        """Return the action at each frame, float32 `[T, U]`.

        Raises:
            ValueError: before `fit`, percepts of another width, or no pictures of a camera.
        """
        if not len(self._frames):
            raise ValueError("expected a call of fit before predict, got none")
        width, got = len(self._center) // (2 if self._lag else 1), demonstration.percepts.shape[1]
        if got != width:
            raise ValueError(f"expected percepts of {width} dimensions, as fitted, got {got}")
        nearest = torch.cat([self._nearest(part) for part in demonstration.continuous()])
        return self._actions[nearest].mean(dim=1).numpy()

    def _describe(self, parts: Sequence[Demonstration]) -> Tensor:
        """Return what is compared of each frame `[N, D or 2 D]`, unscaled."""
        percepts = [part.percepts.double() for part in parts]
        if not self._lag:
            return torch.cat(percepts)
        return torch.cat([torch.cat([x, _change(x, self._lag)], dim=1) for x in percepts])

    def _nearest(self, part: Demonstration) -> Tensor:
        """Return the indices `[T, k]` of the frames nearest to each of a part.

        The squared distance is |q|² + |x|² − 2 q·x, of which |q|² changes no order.
        """
        queries = (self._describe([part]) - self._center) * self._factors
        lengths, k = self._frames.square().sum(dim=1), min(self.k, len(self._frames))
        if self._pictures is not None and len(queries):
            lengths += self._pictures.apart(part)
        rows = max(1, _BLOCK_BYTES // (8 * len(lengths)))
        # One buffer for all blocks: blocks of their own would stay with the allocator.
        buffer = torch.empty(min(rows, len(queries)), len(lengths), dtype=torch.float64)
        nearest = torch.empty(len(queries), k, dtype=torch.int64)
        for first in range(0, len(queries), rows):
            block = queries[first : first + rows]
            distances = buffer[: len(block)]
            torch.addmm(lengths, block, self._frames.T, alpha=-2, out=distances)
            nearest[first : first + rows] = distances.topk(k, dim=1, largest=False).indices
        return nearest


class RepeatLast:
    """The action shown one frame before.

    The first frame, also after a gap in time, gets the mean first action of the training data.
    """

    def __init__(self) -> None:
        self._first: Tensor | None = None  # [U]

    def fit(self, demonstrations: Demonstrations) -> RepeatLast:
        """Learn the mean first action; return itself.

        Demonstrations that begin with their episode count, or all where there are none.

        Raises:
            ValueError: no frames.
        """
        parts = _parts(demonstrations)
        starts = [part.action[0] for part in parts if part.first_frame == 0]
        self._first = torch.stack(starts or [part.action[0] for part in parts]).mean(dim=0)
        return self

    def predict(self, demonstration: Demonstration) -> NDArray:
        """Return the action at each frame, float32 `[T, U]`.

        Raises:
            ValueError: before `fit`.
        """
        if self._first is None:
            raise ValueError("expected a call of fit before predict, got none")
        repeated = torch.roll(demonstration.action, 1, dims=0)
        repeated[[0, *demonstration.gaps][: len(repeated)]] = self._first
        return repeated.numpy()


def _parts(demonstrations: Demonstrations) -> list[Demonstration]:
    """Return the parts between gaps that hold frames."""
    parts = [part for part in demonstrations.continuous() if len(part.action)]
    if not parts:
        raise ValueError("expected demonstrations with at least one frame, got none")
    return parts


def _change(percepts: Tensor, lag: int) -> Tensor:
    """Return the change `[T, D]` since `lag` frames before, or since the first frame."""
    before = (torch.arange(len(percepts)) - lag).clamp(min=0)
    return percepts - percepts[before]


def _factors(frames: Tensor, halves: bool) -> Tensor:
    """Return the factor of each dimension of frames `[N, D]`; with `halves`, of each half alone."""
    if halves:
        return torch.cat([_factors(half, halves=False) for half in frames.chunk(2, dim=1)])
    deviations = frames.std(dim=0, correction=0)
    moves, factors = deviations >= _LEAST_DEVIATION, 1 / deviations
    usual = factors[moves].quantile(0.5) if moves.any() else torch.ones_like(factors)
    return torch.where(moves, factors, usual)
