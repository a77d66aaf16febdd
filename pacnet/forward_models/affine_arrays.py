"""An `AffineForwardModel` as plain arrays, for compiled callers."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pacnet.forward_models.affine_rows import placed

if TYPE_CHECKING:
    from pacnet.forward_models.affine import AffineForwardModel


class AffineArrays(NamedTuple):
    """What compiled callers need of an `AffineForwardModel`; copies, float64 but where noted."""

    gain: NDArray[np.float64]
    """`[S, U]`."""
    inverse: NDArray[np.float64]
    """`[U, S]`."""
    lag: NDArray[np.float64]
    """`[S, S]`."""
    drift: NDArray[np.float64]
    """`[S]`."""
    follows: NDArray[np.int64]
    """`[U]`."""
    lowest: NDArray[np.float64]
    """`[U]`."""
    highest: NDArray[np.float64]
    """`[U]`."""
    mean_action: NDArray[np.float64]
    """`[U]`."""
    moves: NDArray[np.bool_]
    """`[U]`."""
    lead: int


def arrays_of(model: AffineForwardModel) -> AffineArrays:
    """Return copies of what a model has learned."""
    names = ("gain", "inverse", "lag", "drift", "lowest", "highest", "mean_action")
    learned = {name: model.get_buffer(name).double().numpy(force=True).copy() for name in names}
    moves = model.moves.numpy(force=True).copy()
    follows = np.array(model.config.follows, np.int64)
    return AffineArrays(**learned, follows=follows, moves=moves, lead=model.config.lead)


def action_for(
    arrays: AffineArrays,
    state: NDArray[np.float64],
    velocity: NDArray[np.float64],
    target: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Return the action `[U]` that leads from a state `[S]` to a target `[S]`.

    Args:
        arrays: of the model.
        state: present one.
        velocity: its change since the last frame, `[S]`.
        target: to be reached in `arrays.lead` frames.
    """
    action = arrays.inverse @ (target - state - arrays.lag @ velocity - arrays.drift)
    action += placed(state[None], arrays.follows)[0]
    return np.where(arrays.moves, action.clip(arrays.lowest, arrays.highest), arrays.mean_action)
