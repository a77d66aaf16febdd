"""Whether a node's schema is better replaced by what a new episode shows, or kept.

Maistros, Marom & Hayes (2001), "The Integrated System", overwrite a schema by each new episode and
call that crude. Here a new sequence of targets must not be worse than the old one.
"""

from __future__ import annotations

from typing import NamedTuple

from torch import Tensor

_SMOOTHEST = 1e-6  # [units of a target] roughness below which smoother is not better


class Quality(NamedTuple):
    """What speaks for a sequence of targets."""

    fit: float
    """Mean activation of its node by its cues, in (0, 1]."""
    roughness: float
    """How far its targets jump off their own course; see `roughness`."""
    length: int
    """Number of its targets."""


def roughness(targets: Tensor) -> float:
    """Root mean square distance of each target from the middle of both its neighbours in time.

    A tremor, lost tracking or a jump makes it large; a smooth movement of any speed leaves it
    small. It is the sequence's consistency with itself, in units of a target.

    Args:
        targets: `[L, A]`; fewer than three have no course to leave, and give 0.
    """
    if len(targets) < 3:
        return 0.0
    middle = (targets[:-2] + targets[2:]) / 2
    return float((targets[1:-1] - middle).square().sum(dim=1).mean().sqrt())


def is_not_worse(new: Quality, old: Quality, typical_length: float, worse_by: float) -> bool:
    """Whether the new sequence may take the old one's place.

    Three ratios are multiplied, each 1 where both are alike and above 1 where the new one is
    better: of their fits; of their roughness, the old one's over the new one's; and of how near
    their lengths are to the typical one, as shorter over longer. The product must be at least
    1 − `worse_by`.

    Args:
        new: of what the new episode shows.
        old: of what the node keeps.
        typical_length: mean length of all sequences seen on this occasion, the new one's included.
        worse_by: how much worse is still not worse, in [0, 1).
    """
    smoothness = max(old.roughness, _SMOOTHEST) / max(new.roughness, _SMOOTHEST)
    if min(new.length, old.length) < 3:
        smoothness = 1.0  # there is nothing to compare
    completeness = _nearness(new.length, typical_length) / _nearness(old.length, typical_length)
    return new.fit / old.fit * smoothness * completeness >= 1 - worse_by


def _nearness(length: float, typical: float) -> float:
    return min(length, typical) / max(length, typical)
