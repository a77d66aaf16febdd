"""Goals read from features: linear, or with squares where enough was shown to tell a bend."""

from __future__ import annotations

from collections.abc import Mapping

import torch
from torch import Tensor, nn

from pacnet.core.growable_rows import Column, GrowableRows, copy_on_state_dict
from pacnet.core.integrity import check_conditions, check_on_load, check_structure
from pacnet.vision.goals import SHARES
from pacnet.vision.regression import RIDGES, fit, left_out, left_out_of_mean

_BENT = 2  # the first features, whose squares and product are tried
_ENOUGH = 2  # demonstrations for each number that is fitted, to try them
_FALLS = 0.9  # of the error that is left, at most, with squares


class Readout(nn.Module):
    """A ridge regression of goals on features.

    Args:
        outputs: number m of the goals' dimensions.
    """

    centre: Tensor  # [m], mean of the goals
    lowest: Tensor  # [m], of what is told, as the next
    highest: Tensor

    def __init__(self, outputs: int) -> None:
        super().__init__()
        number = Column((), torch.float32)
        self.inputs = GrowableRows({"mean": number, "scale": number})
        self.terms = GrowableRows({"mean": number, "weight": Column((outputs,), torch.float32)})
        for name in ("centre", "lowest", "highest"):
            self.register_buffer(name, torch.zeros(outputs))
        copy_on_state_dict(self)
        check_on_load(self)

    def keep_mean(self, goals: Tensor) -> None:
        """Tell the mean of goals `[N, m]`, whatever the features are; 0 of none."""
        for rows in (self.inputs, self.terms):
            rows.select(torch.empty(0, dtype=torch.int64))
        goals = goals if len(goals) else goals.new_zeros(1, goals.shape[1])
        lowest, highest = goals.amin(dim=0), goals.amax(dim=0)
        span = highest - lowest  # farther beyond what was shown nothing is told
        told = {"centre": goals.mean(dim=0), "lowest": lowest - span, "highest": highest + span}
        for name, values in told.items():
            setattr(self, name, values.to(self.centre))

    def fit(self, features: Tensor, goals: Tensor) -> Tensor:
        """Fit to N demonstrations; return the errors of the goals, with each left out, `[N, m]`.

        Args:
            features: `[N, d]`, float64; two of them belong together where places are told.
            goals: `[N, m]`, float64.
        """
        self.keep_mean(goals)
        mean = features.mean(dim=0)
        scale = (features - mean).square().mean().sqrt().clamp(min=1e-12).expand(features.shape[1])
        self.inputs.replace({"mean": mean, "scale": scale})
        linear = (features - mean) / scale
        terms, ridge, errors = _best(linear, goals)
        if len(goals) >= _ENOUGH * (linear.shape[1] + 1 + _BENT * (_BENT + 1) // 2):
            bent = _best(torch.cat([linear, _squares(linear)], dim=1), goals)
            if bent[2].square().mean() < _FALLS * errors.square().mean():
                terms, ridge, errors = bent
        centre, weights, _ = fit(terms, goals, ridge)
        mean_errors = left_out_of_mean(goals)
        untold = _by_goal(errors) >= _by_goal(mean_errors)  # the mean foretells them as well
        self.terms.replace({"mean": centre, "weight": weights.masked_fill(untold, 0.0)})
        return torch.where(untold, mean_errors, errors)

    def forward(self, features: Tensor) -> Tensor:
        """Return the goals `[m]` that features `[≥ d]` tell, float32."""
        mean, scale = self.inputs.live("mean"), self.inputs.live("scale")
        terms = (features[: len(mean)].to(mean) - mean) / scale
        centre, weight = self.terms.live("mean"), self.terms.live("weight")
        if len(centre) > len(terms):
            terms = torch.cat([terms, _squares(terms[None])[0]])
        told = (terms - centre) @ weight + self.centre
        return told.clamp(self.lowest, self.highest)

    def check_state(self, tensors: Mapping[str, Tensor]) -> None:
        """Raise a ValueError unless these tensors, of a `state_dict`, are the state of one."""
        check_structure(self, tensors)
        features, terms = len(tensors["inputs.mean"]), len(tensors["terms.mean"])
        squares = min(features, _BENT) * (min(features, _BENT) + 1) // 2
        check_conditions(
            {
                "finite numbers": all(bool(one.isfinite().all()) for one in tensors.values()),
                "scales > 0": bool((tensors["inputs.scale"] > 0).all()),
                "terms of the features": terms in (features, features + squares),
            }
        )


def _by_goal(errors: Tensor) -> Tensor:
    """Return the mean square error of the goal that each dimension belongs to, `[m]`."""
    squares = errors.square().mean(dim=0).unflatten(0, (len(SHARES), -1)).mean(dim=1, keepdim=True)
    return squares.expand(-1, errors.shape[1] // len(SHARES)).flatten()


def _squares(terms: Tensor) -> Tensor:
    """Return squares and products of the first terms `[N, ≥ 1]`."""
    first = terms[:, :_BENT]
    pairs = torch.triu_indices(first.shape[1], first.shape[1])
    return first[:, pairs[0]] * first[:, pairs[1]]


def _best(terms: Tensor, goals: Tensor) -> tuple[Tensor, float, Tensor]:
    """Return the terms, the ridge of the least error, and the errors when left out."""
    errors = {ridge: left_out(terms, goals, ridge) for ridge in RIDGES}
    ridge = min(errors, key=lambda one: errors[one].square().mean().item())
    return terms, ridge, errors[ridge]
