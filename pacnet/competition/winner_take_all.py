"""Competition: the most confident schema wins.

Source: Maistros, Marom & Hayes (2001), Figure 1: "candidate commands compete in the competition
module and the one with the highest confidence wins". The hysteresis is ours: without it, two nearly
equal schemas would alternate.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from pacnet.core.validation import check_fields, check_rows, is_number

NO_SCHEMA = -1
"""Stands for "no schema": the winner where no schema competes."""


@dataclass(frozen=True)
class CompetitionConfig:
    """The rules of a `Competition`.

    Attributes:
        threshold: confidence below which a schema does not compete, in [0, 1].
        margin: how much the confidence of a challenger must exceed that of the incumbent, ≥ 0.
            Zero is the paper's winner-take-all, without incumbents; more adds hysteresis.
    """

    threshold: float = 0.0
    margin: float = 0.0

    def __post_init__(self) -> None:
        """Validate the fields."""
        is_threshold = is_number(self.threshold) and 0 <= self.threshold <= 1
        is_margin = is_number(self.margin) and self.margin >= 0
        checks = {
            "threshold": (is_threshold, "in [0, 1]"),
            "margin": (is_margin, "≥ 0 and finite"),
        }
        check_fields(self, checks)


class Competition(nn.Module):
    """The choice of one winner, or none, from the confidences of S schemas.

    The rules, in this order:

    1. A schema competes if its confidence is at least `threshold`. If none competes, the winner is
       `NO_SCHEMA`.
    2. With a margin, an incumbent that competes wins again, unless the highest confidence is
       greater than its own plus `margin`.
    3. Otherwise the most confident schema wins; ties go to the lowest index.

    It keeps no state: the caller passes the last winner.

    Args:
        config: see `CompetitionConfig`.

    Example:
        >>> rivals = torch.tensor([[0.6, 0.5], [0.5, 0.6], [0.3, 0.9]])
        >>> Competition(CompetitionConfig()).over_time(rivals)
        tensor([0, 1, 1])
        >>> Competition(CompetitionConfig(margin=0.25)).over_time(rivals)
        tensor([0, 0, 1])
    """

    def __init__(self, config: CompetitionConfig) -> None:
        super().__init__()
        self.config = config

    @torch.no_grad()
    def forward(self, confidences: Tensor, incumbents: Tensor | None = None) -> Tensor:
        """Return the winners of B independent competitions, int64 `[B]`.

        Args:
            confidences: `[B, S]`; S may be 0.
            incumbents: the last winners, int64 `[B]`, or `NO_SCHEMA`; by default none.

        Raises:
            ValueError: confidences that are not finite floats `[B ≥ 1, S]`, or incumbents that are
                not `NO_SCHEMA` or an index of a schema.
        """
        _check_confidences(confidences)
        if incumbents is not None:
            _check_incumbents(incumbents, confidences)
        return self._winners(confidences, incumbents)

    def winner(self, confidences: NDArray[np.floating[Any]], incumbent: int = NO_SCHEMA) -> int:
        """Return the winner of one competition, for a control loop; nothing is checked.

        Args:
            confidences: an array `[S]`, finite; S ≥ 1.
            incumbent: the last winner, or `NO_SCHEMA`.
        """
        number = confidences.dtype.type  # rounded as torch rounds a number beside a tensor
        threshold, margin = number(self.config.threshold), number(self.config.margin)
        winner = int(confidences.argmax())
        highest = confidences[winner]
        if margin > 0 and incumbent not in (NO_SCHEMA, winner):
            own = confidences[incumbent]
            if own >= threshold and highest <= own + margin:
                return incumbent
        return winner if highest >= threshold else NO_SCHEMA

    @torch.no_grad()
    def over_time(self, confidences: Tensor, incumbent: int = NO_SCHEMA) -> Tensor:
        """Return the winners over time, int64 `[T]`; each is the incumbent of the next sample.

        Args:
            confidences: `[T, S]`, in order of time; S may be 0.
            incumbent: the winner before the first sample, or `NO_SCHEMA`.

        Raises:
            ValueError: as `forward`.
        """
        _check_confidences(confidences)
        here = torch.tensor([incumbent], device=confidences.device)
        _check_incumbents(here, confidences[:1])
        if self.config.margin == 0:
            return self._winners(confidences, None)
        winners = []
        for sample in confidences.split(1):
            here = self._winners(sample, here)
            winners.append(here)
        return torch.cat(winners)

    def _winners(self, confidences: Tensor, incumbents: Tensor | None) -> Tensor:
        """Do the same as `forward`, for checked input."""
        if confidences.shape[1] == 0:
            return confidences.new_full((len(confidences),), NO_SCHEMA, dtype=torch.int64)
        highest, winners = confidences.amax(dim=1), confidences.argmax(dim=1)  # [B]
        if incumbents is not None and self.config.margin > 0:
            own = confidences.gather(1, incumbents.clamp(min=0)[:, None])[:, 0]  # [B]
            competes = (incumbents != NO_SCHEMA) & (own >= self.config.threshold)
            stays = competes & (highest <= own + self.config.margin)
            winners = incumbents.where(stays, winners)
        return winners.where(highest >= self.config.threshold, NO_SCHEMA)


def _check_confidences(confidences: Tensor) -> None:
    """Raise a ValueError unless these are finite floating-point rows."""
    is_rows = isinstance(confidences, Tensor) and confidences.dim() == 2
    is_float = isinstance(confidences, Tensor) and confidences.is_floating_point()
    columns = confidences.shape[1] if is_rows else 1
    check_rows("confidences", confidences, columns, confidences if is_float else torch.empty(0))


def _check_incumbents(incumbents: Tensor, confidences: Tensor) -> None:
    """Raise a ValueError unless these are `NO_SCHEMA` or an index of a schema for each row."""
    rows, schemas = confidences.shape
    wanted = f"expected incumbents as an int64 tensor of shape [{rows}] on {confidences.device}"
    if not isinstance(incumbents, Tensor):
        raise ValueError(f"{wanted}, got {type(incumbents).__name__}")
    if incumbents.dtype != torch.int64 or incumbents.shape != (rows,):
        raise ValueError(f"{wanted}, got {incumbents.dtype} of shape {list(incumbents.shape)}")
    if incumbents.device != confidences.device:
        raise ValueError(f"{wanted}, got one on {incumbents.device}")
    if bool(((incumbents < NO_SCHEMA) | (incumbents >= schemas)).any()):
        raise ValueError(
            f"expected incumbents from {NO_SCHEMA} to {schemas - 1}, got {incumbents.tolist()}"
        )
