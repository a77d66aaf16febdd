"""The settings of the growing map, with the two presets `paper` and `gwr`."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from pacnet.core.validation import MAX_SAMPLES, check_fields, is_integer, is_number


@dataclass(frozen=True)
class SOFMConfig:
    """Settings of the growing map; the defaults are the preset `paper`.

    Implementations of Grow When Required differ in such choices. Those without a field: the
    activation is exp(−distance), not exp(−distance²); only the winner's edges age; a node moves
    before it habituates; old edges are deleted after every ageing.

    Attributes:
        dimensions: length of a percept.
        scale: factor for each dimension before distances are taken, [1/unit of the dimension];
            None stands for ones.
        novelty_threshold: activation under which a percept is novel, in (0, 1). A smaller one
            makes fewer nodes.
        insert_only_when_habituated: a novel percept makes a node only if the winner is fully
            habituated (GWR); else every novel percept does (the paper's case 1).
        insert_at: a new node is put at the `percept` and joined to the winner, or at the `midpoint`
            of winner and percept and joined to winner and runner-up, whose edge is deleted (GWR).
        ignore_when_habituated: a fully habituated node no longer responds (the paper's case 3);
            otherwise it keeps learning, at a small rate (GWR).
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
            for never (GWR). Once it is habituated again, new targets replace its old ones.
        max_edge_age: an edge older than this is deleted; its age counts the attended wins of its
            two nodes since they were last winner and runner-up together.
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
        """Return the three cases of Maistros, Marom & Hayes (2001), with other fields as given."""
        return cls(dimensions, **fields)  # pyright: ignore[reportArgumentType]

    @classmethod
    def gwr(cls, dimensions: int, **fields: object) -> SOFMConfig:
        """Return Grow When Required (Marsland et al. 2002), with other fields as given."""
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
        """Limit of habituation after endless firing, h₀ − 1/α."""
        return self.resting_habituation - 1.0 / self.alpha

    def decay(self, tau: float) -> float:
        """Return the factor that one firing applies to habituation above its floor, e^{−α/τ}."""
        return math.exp(-self.alpha / tau)

    def __post_init__(self) -> None:
        """Validate the fields."""
        if isinstance(self.scale, list):  # as JSON gives it
            object.__setattr__(self, "scale", tuple(self.scale))
        check_fields(self, {"dimensions": (is_integer(self.dimensions, 1), "≥ 1")})
        check_fields(self, {"alpha": (_within(self.alpha, 0, math.inf), "> 0")})
        check_fields(self, self._checks())

    def _checks(self) -> dict[str, tuple[bool, str]]:
        floor, scale = max(self.floor_habituation, 0.0), self.scale
        scale_valid = scale is None or (
            isinstance(scale, tuple)
            and len(scale) == self.dimensions
            and all(_within(factor, 0, math.inf) for factor in scale)
        )
        winner_rate, neighbour_rate = self.winner_rate, self.neighbour_rate
        interval, count = self.forgetting_interval, f"to be an integer from 1 to {MAX_SAMPLES}"
        switches = (
            "insert_only_when_habituated", "ignore_when_habituated", "habituation_scales_learning",
        )  # fmt: skip
        return {
            "scale": (scale_valid, f"to be {self.dimensions} positive finite factors"),
            "novelty_threshold": (_within(self.novelty_threshold, 0, 1), "in (0, 1)"),
            "insert_at": (self.insert_at in ("percept", "midpoint"), "'percept' or 'midpoint'"),
            "winner_rate": (_within(winner_rate, 0, 1) or winner_rate == 1, "in (0, 1]"),
            "neighbour_rate": (
                _within(neighbour_rate, 0, 1) or neighbour_rate in (0, 1), "in [0, 1]",
            ),
            "habituated_below": (
                _within(self.habituated_below, floor, 1),
                f"in ({floor:.3f}, 1), above the floor 1 − 1/alpha",
            ),
            "winner_tau": (_within(self.winner_tau, 0, math.inf), "> 0 firings"),
            "neighbour_tau": (_within(self.neighbour_tau, 0, math.inf), "> 0 firings"),
            "forgetting_interval": (
                interval is None or _is_count(interval), f"{count} samples or None",
            ),
            "max_edge_age": (_is_count(self.max_edge_age), count),
            **{
                name: (isinstance(getattr(self, name), bool), "to be true or false")
                for name in switches
            },
        }  # fmt: skip


def _within(value: object, low: float, high: float) -> bool:
    """Return whether a field holds a finite number between both, exclusive."""
    return is_number(value) and low < value < high  # pyright: ignore[reportOperatorIssue]


def _is_count(value: object) -> bool:
    """Return whether a field holds an integer from 1 to `MAX_SAMPLES`."""
    return is_integer(value, 1) and value <= MAX_SAMPLES  # pyright: ignore[reportOperatorIssue]
