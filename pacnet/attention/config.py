"""Every choice of the growing map in one place, with the two presets `paper` and `gwr`."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from pacnet.core.validation import MAX_SAMPLES, MAX_VALUE, check_fields, is_integer, is_number

LARGEST_PERCEPT = MAX_VALUE
"""Of a scaled percept, in any dimension."""


@dataclass(frozen=True)
class SOFMConfig:
    """The growing map's settings; the defaults are the preset `paper`.

    Public Grow-When-Required codes differ silently in these choices, so each is a field, or is
    stated here: the activation is exp(−distance), not exp(−distance²); only the winner's edges
    age; a node moves before it habituates; pruning follows every ageing.

    Attributes:
        dimensions: length of a percept.
        scale: factor on each dimension before distances are taken, one a dimension, in 1/unit of
            that dimension; None stands for ones.
        novelty_threshold: activation under which a percept is novel, in (0, 1). A smaller one
            makes fewer nodes.
        insert_only_when_habituated: a novel percept makes a node only where the winner is fully
            habituated (GWR); else every novel percept does (the paper's case 1).
        insert_at: a new node stands at the `percept`, joined to the winner, or at the `midpoint`
            between winner and percept, joined to winner and runner-up, whose own edge goes (GWR).
        ignore_when_habituated: a fully habituated node no longer responds (the paper's case 3);
            otherwise it goes on learning at its habituation's small rate (GWR).
        habituation_scales_learning: the moved fraction is multiplied by the node's habituation
            (GWR); else it is constant (the paper's case 2).
        winner_rate: fraction of the way to the percept that the winner moves, in (0, 1].
        neighbour_rate: the same for the winner's neighbours, in [0, 1].
        habituated_below: habituation under which a node is fully habituated, in
            (1 − 1/alpha, 1).
        alpha: α of Stanley's habituation equation.
        winner_tau: τ of the winner, in firings.
        neighbour_tau: τ of the neighbours, in firings.
        forgetting_interval: samples after which a fully habituated node is dishabituated; None
            for never (GWR).
        max_edge_age: an edge older than this goes, counted in the attended wins of the nodes it
            joins since they were last best and second best together.
    """

    dimensions: int
    scale: tuple[float, ...] | None = None
    novelty_threshold: float = 0.5
    insert_only_when_habituated: bool = False
    insert_at: Literal["percept", "midpoint"] = "percept"
    ignore_when_habituated: bool = True
    habituation_scales_learning: bool = False
    winner_rate: float = 0.1
    neighbour_rate: float = 0.01
    habituated_below: float = 0.1
    alpha: float = 1.05
    winner_tau: float = 3.33
    neighbour_tau: float = 14.3
    forgetting_interval: int | None = 10_000
    max_edge_age: int = 50

    @classmethod
    def paper(cls, dimensions: int, **fields: object) -> SOFMConfig:
        """The three cases of Maistros, Marom & Hayes (2001).

        Args:
            dimensions: length of a percept.
            fields: fields to set otherwise than the preset.
        """
        return cls(dimensions, **fields)  # pyright: ignore[reportArgumentType]

    @classmethod
    def gwr(cls, dimensions: int, **fields: object) -> SOFMConfig:
        """Grow When Required (Marsland, Shapiro & Nehmzow 2002).

        Args:
            dimensions: length of a percept.
            fields: fields to set otherwise than the preset.
        """
        preset = {
            "insert_only_when_habituated": True,
            "insert_at": "midpoint",
            "ignore_when_habituated": False,
            "habituation_scales_learning": True,
            "forgetting_interval": None,
        }
        return cls(dimensions, **{**preset, **fields})  # pyright: ignore[reportArgumentType]

    @property
    def resting_habituation(self) -> float:
        """Habituation of a node that has never fired, h₀."""
        return 1.0

    @property
    def floor_habituation(self) -> float:
        """Habituation that endless firing tends to, h₀ − 1/α."""
        return self.resting_habituation - 1.0 / self.alpha

    def decay(self, tau: float) -> float:
        """Factor by which one firing brings habituation nearer to its floor, e^{−α/τ}."""
        return math.exp(-self.alpha / tau)

    def __post_init__(self) -> None:
        """Refuses values that have no meaning."""
        if isinstance(self.scale, list):  # as JSON gives it
            object.__setattr__(self, "scale", tuple(self.scale))
        check_fields(self, {"dimensions": (is_integer(self.dimensions, 1), "≥ 1")})
        check_fields(self, {"alpha": (is_number(self.alpha) and self.alpha > 0, "> 0")})
        check_fields(self, self._checks())

    def _checks(self) -> dict[str, tuple[bool, str]]:
        interval, floor = self.forgetting_interval, max(self.floor_habituation, 0.0)
        switches = (
            "insert_only_when_habituated",
            "ignore_when_habituated",
            "habituation_scales_learning",
        )
        return {
            "scale": (self._scale_is_valid(), f"to be {self.dimensions} positive finite factors"),
            "novelty_threshold": (_within(self.novelty_threshold, 0, 1), "in (0, 1)"),
            "insert_at": (self.insert_at in ("percept", "midpoint"), "'percept' or 'midpoint'"),
            "winner_rate": (
                _within(self.winner_rate, 0, 1) or self.winner_rate == 1,
                "in (0, 1]",
            ),
            "neighbour_rate": (
                _within(self.neighbour_rate, 0, 1) or self.neighbour_rate in (0, 1),
                "in [0, 1]",
            ),
            "habituated_below": (
                _within(self.habituated_below, floor, 1),
                f"in ({floor:.3f}, 1), above the floor 1 − 1/alpha",
            ),
            "winner_tau": (_within(self.winner_tau, 0, math.inf), "> 0 firings"),
            "neighbour_tau": (_within(self.neighbour_tau, 0, math.inf), "> 0 firings"),
            "forgetting_interval": (
                interval is None or (is_integer(interval, 1) and interval <= MAX_SAMPLES),
                f"to be an integer from 1 to {MAX_SAMPLES} samples or None",
            ),
            "max_edge_age": (
                is_integer(self.max_edge_age, 1) and self.max_edge_age <= MAX_SAMPLES,
                f"to be an integer from 1 to {MAX_SAMPLES}",
            ),
            **{
                name: (isinstance(getattr(self, name), bool), "to be true or false")
                for name in switches
            },
        }

    def _scale_is_valid(self) -> bool:
        if self.scale is None:
            return True
        return (
            isinstance(self.scale, tuple)
            and len(self.scale) == self.dimensions
            and all(_within(factor, 0, math.inf) for factor in self.scale)
        )


def _within(value: object, low: float, high: float) -> bool:
    """Whether a field holds a finite number between both, without them."""
    return is_number(value) and low < value < high  # pyright: ignore[reportOperatorIssue]
