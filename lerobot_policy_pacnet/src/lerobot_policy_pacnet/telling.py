"""What training logs of an imitator: how novel batches are to it, and what its cameras tell."""

from __future__ import annotations

import logging

import torch
from torch import Tensor

from pacnet.imitator.imitator import Imitator
from pacnet.vision.config import NONE

logger = logging.getLogger(__name__)


def novelty_of(imitator: Imitator, percepts: Tensor) -> float:
    """Return how far percepts `[B, P]` are from the map on average, from 0 to 1.

    What cameras tell is left out of it.
    """
    sofm, width = imitator.sofm, percepts.shape[1]
    if imitator.cameras is None:
        return float(1 - sofm(percepts).activation.mean())
    scale = sofm.scale[:width]
    apart = torch.cdist(percepts * scale, sofm.prototypes[:, :width] * scale)
    return float(1 - torch.exp(-apart.min(dim=1).values).mean())


def tell_cameras(imitator: Imitator | None) -> None:
    """Log what each camera tells."""
    for feature, kind, told in () if imitator is None else imitator.camera_reports:
        about = "does not help" if kind == NONE else f"is used ({kind})"
        logger.info(
            "%s %s: where the hand will go within %.3g; state alone %.3g",
            feature, about, told.error, told.alone,
        )  # fmt: skip
