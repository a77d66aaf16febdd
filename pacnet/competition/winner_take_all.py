"""Competition: of schemas that are confident enough, one wins.

Source: Maistros, Marom & Hayes (2001), Figure 1: "candidate commands compete in the competition
module and the one with the highest confidence wins". The hysteresis is ours: it keeps two nearly
equal schemas from taking turns.
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
        threshold: confidence under which a schema does not compete, in [0, 1].
        margin: by how much more confident than the incumbent a challenger must be, ≥ 0. Zero is
            the paper's winner-take-all, in which incumbents count for nothing; more is
            winner-take-all with hysteresis.
    """

    threshold: float = 0.0
    margin: float = 0.0

    def __post_init__(self) -> None:
        """Refuses values that have no meaning."""
        valid = is_number(self.threshold) and 0 <= self.threshold <= 1
        check_fields(
            self,
            {
                "threshold": (valid, "in [0, 1]"),
                "margin": (is_number(self.margin) and self.margin >= 0, "≥ 0 and finite"),
            },
        )


class Competition(nn.Module):
    """Picks one winner, or none, from the confidences of S schemas.

    The rules, in this order:

    1. A schema competes if its confidence is at least `threshold`. Where none competes, `NO_SCHEMA`
       wins.
    2. With a margin, an incumbent that competes stays, unless the confidence of the most confident
       schema is greater than its own plus `margin`. One that no longer competes counts for nothing.
    3. Otherwise the most confident schema wins, of exactly equal ones the lowest number.

    It keeps no state: who won last is the caller's to remember, or `over_time`'s.

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
        """B independent competitions.

        Args:
            confidences: `[B, S]`; S may be 0.
            incumbents: who won before, int64 `[B]`, `NO_SCHEMA` for nobody; nobody if left out.

        Returns:
            The winners, int64 `[B]`; `NO_SCHEMA` where none competes.

        Raises:
            ValueError: confidences that are no finite floating-point `[B ≥ 1, S]`, or incumbents
                that are not one `NO_SCHEMA` or number under S each.
        """
        _check_confidences(confidences)
        if incumbents is not None:
            _check_incumbents(incumbents, confidences)
        return self._winners(confidences, incumbents)

    def winner(self, confidences: NDArray[np.floating[Any]], incumbent: int = NO_SCHEMA) -> int:
        """One competition, for a control loop: nothing is checked.

        Args:
            confidences: an array `[S]`, finite; S ≥ 1.
            incumbent: who won before.

        Returns:
            The winner, or `NO_SCHEMA`.
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
        """One competition along time: each winner, or `NO_SCHEMA`, is the next one's incumbent.

        Args:
            confidences: `[T, S]`, in order of time; S may be 0.
            incumbent: who won before the first sample.

        Returns:
            The winners, int64 `[T]`.

        Raises:
            ValueError: confidences as in `forward`; an incumbent that is no `NO_SCHEMA` or number
                under S.
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
        """`forward` for checked input."""
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
    """A ValueError for anything but finite floating-point rows."""
    is_rows = isinstance(confidences, Tensor) and confidences.dim() == 2
    is_float = isinstance(confidences, Tensor) and confidences.is_floating_point()
    columns = confidences.shape[1] if is_rows else 1
    check_rows("confidences", confidences, columns, confidences if is_float else torch.empty(0))


def _check_incumbents(incumbents: Tensor, confidences: Tensor) -> None:
    """A ValueError for anything but one `NO_SCHEMA` or number of a schema for each row."""
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
