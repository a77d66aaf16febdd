"""The choice among candidate actions by where a learned model predicts that each of them leads."""

from __future__ import annotations

from typing import NamedTuple, Protocol

import torch
from torch import Tensor

from pacnet.forward_model import Command, Selection
from pacnet.validation import batch_of_one, check_fields, check_rows, is_integer, is_number


class Outcomes(NamedTuple):
    """Where each of K candidate actions leads from each of B states, as far as a model knows."""

    states: Tensor
    """Predicted states, `[B, K, S]`."""
    known: Tensor
    """Whether the model can predict this candidate here, bool `[B, K]`; what it cannot is NaN."""


class CandidateConfig(Protocol):
    """The settings that every model with candidates has."""

    @property
    def state_dimensions(self) -> int:
        """Length S of a state and of a target."""
        ...

    @property
    def action_dimensions(self) -> int:
        """Length U of an action."""
        ...

    @property
    def candidates(self) -> tuple[tuple[float, ...], ...]:
        """K actions to choose from."""
        ...

    @property
    def steps(self) -> int:
        """Number of time steps for which an action is held."""
        ...

    @property
    def abstain_below(self) -> float:
        """Spread of the predicted states under which no action is given."""
        ...


class CandidateModel(Protocol):
    """What a model must offer so that `select` and `command` can choose with it."""

    @property
    def config(self) -> CandidateConfig:
        """Its settings."""
        ...

    @property
    def candidates(self) -> Tensor:
        """The config's candidates as a tensor, `[K, U]`."""
        ...

    def outcomes(self, states: Tensor, candidates: Tensor) -> Outcomes:
        """Where the candidates `[K, U]` lead from the states `[B, S]`, both checked there."""
        ...


class _Choice(NamedTuple):
    costs: Tensor  # [B, K]
    best: Tensor  # int64 [B]
    spread: Tensor  # [B]
    abstained: Tensor  # bool [B]


def check_candidate_config(config: CandidateConfig) -> None:
    """Turns the candidates into tuples (JSON reads lists) and checks the fields all models share.

    Raises:
        ValueError: naming the first field that is out of range.
    """
    check_fields(
        config,
        {
            "state_dimensions": (is_integer(config.state_dimensions, 1), "≥ 1"),
            "action_dimensions": (is_integer(config.action_dimensions, 1), "≥ 1"),
            "steps": (is_integer(config.steps, 1), "≥ 1"),
            "abstain_below": (
                is_number(config.abstain_below) and config.abstain_below >= 0,
                "≥ 0 and finite",
            ),
            "candidates": (
                _are_actions(config.candidates, config.action_dimensions),
                "to be one or more actions, each of action_dimensions finite numbers",
            ),
        },
    )
    rows = tuple(tuple(float(value) for value in action) for action in config.candidates)
    object.__setattr__(config, "candidates", rows)


@torch.no_grad()
def select(
    model: CandidateModel, state: Tensor, target: Tensor, candidates: Tensor | None
) -> Selection:
    """Chooses in one state `[S]`; see the models' own methods of this name.

    Raises:
        ValueError: a tensor of the wrong shape, dtype or device, or not finite.
    """
    offered = model.candidates if candidates is None else candidates
    target = check_rows(
        "target", batch_of_one(target), model.config.state_dimensions, model.candidates
    )
    choice = _choose(
        model.outcomes(batch_of_one(state), offered), target, model.config.abstain_below
    )
    index = int(choice.best)
    return Selection(
        offered[index].clone(), index, choice.costs[0], float(choice.spread), bool(choice.abstained)
    )


@torch.no_grad()
def command(model: CandidateModel, states: Tensor, targets: Tensor) -> Command:
    """Chooses among the config's candidates in each state `[B, S]`; NaN rows where it abstains.

    Raises:
        ValueError: a tensor of the wrong shape, dtype or device, without rows, or not finite.
    """
    check_rows("targets", targets, model.config.state_dimensions, model.candidates)
    outcomes = model.outcomes(states, model.candidates)
    check_equally_many(states=states, targets=targets)
    choice = _choose(outcomes, targets, model.config.abstain_below)
    given = ~choice.abstained
    return Command(model.candidates[choice.best].where(given[:, None], torch.nan), given)


def check_equally_many(**rows: Tensor) -> None:
    """Raises a ValueError unless the named tensors have equally many rows."""
    counts = {name: len(value) for name, value in rows.items()}
    if len(set(counts.values())) > 1:
        raise ValueError(f"expected equally many rows, got {counts}")


def _choose(outcomes: Outcomes, targets: Tensor, abstain_below: float) -> _Choice:
    """The known candidate nearest to the target, of exactly equal ones the first.

    It abstains where the known candidates are fewer than two (or than all, of a single one), or
    their spread is under the threshold.
    """
    known = outcomes.known  # [B, K]
    distance = torch.linalg.vector_norm(outcomes.states - targets[:, None], dim=2)  # [B, K]
    costs = distance.where(known, torch.inf)
    number = known.sum(dim=1)  # [B]
    divisor = number.clamp(min=1)[:, None]  # [B, 1]
    mean = outcomes.states.where(known[:, :, None], 0).sum(dim=1) / divisor  # [B, S]
    apart = (outcomes.states - mean[:, None]).square().sum(dim=2).where(known, 0)  # [B, K]
    spread = (apart.sum(dim=1) / divisor[:, 0]).sqrt()  # [B]
    too_few = number < min(2, known.shape[1])
    return _Choice(costs, costs.argmin(dim=1), spread, too_few | (spread < abstain_below))


def _are_actions(rows: object, columns: int) -> bool:
    if not isinstance(rows, tuple | list) or len(rows) == 0:
        return False
    return all(
        isinstance(row, tuple | list) and len(row) == columns and all(map(is_number, row))
        for row in rows
    )
