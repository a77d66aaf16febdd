"""The affine forward model as frames of reference use it: with the plain inverse of its gain."""

from __future__ import annotations

import numpy as np

from pacnet.forward_models.affine_arrays import AffineArrays
from pacnet.schemas.frames import FramesConfig
from pacnet.schemas.scene import pose_dimensions
from pacnet.schemas.segments import Segments

_LEAST_GAIN = 0.02  # of the largest: what actions move less is not corrected
_FIRST_TURN = 3  # the first of a pose's dimensions that says how it is turned


def for_frames(model: AffineArrays, segments: Segments, config: FramesConfig) -> AffineArrays:
    """Return the model with the plain inverse of its gain, which makes good all of a deviation.

    What moves the pose may be as large as it was in any direction, since another landmark may lie
    in another one. Moving and turning have units of their own, and are inverted apart. Before a
    fit there is no correction, and shown actions have no limits.
    """
    if not model.moves.any():
        unlimited = np.full(len(model.lowest), np.inf)
        return model._replace(lowest=-unlimited, highest=unlimited)
    turns = np.array(pose_dimensions(config.points.moved)) >= _FIRST_TURN
    lowest, highest, inverse = model.lowest.copy(), model.highest.copy(), model.gain.T.copy()
    of_places = model.follows >= 0
    largest = np.maximum(np.abs(lowest), np.abs(highest))
    largest[of_places] = np.abs(segments.action[:, of_places]).max(axis=0)
    moving = (model.gain[~turns] != 0).any(axis=0)
    for dimensions, actions in ((turns, ~moving), (~turns, moving)):
        inverse[:, dimensions] = np.linalg.pinv(model.gain[dimensions], rcond=_LEAST_GAIN)
        for alike in (model.moves & actions & of_places, model.moves & actions & ~of_places):
            highest[alike] = largest[alike].max(initial=0.0)
            lowest[alike] = -highest[alike]
    return model._replace(inverse=inverse, lowest=lowest, highest=highest)
