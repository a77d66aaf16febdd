"""What a forward model is: it turns where the robot is and where it should be into an action.

Source: Maistros, Marom & Hayes (2001), Experiment 2: "The forward model should suggest to the robot
how to attain a particular target state, given the current state, and the possible actions available
to the robot."
"""

from __future__ import annotations

from typing import NamedTuple, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray
from torch import Tensor


class Command(NamedTuple):
    """What a forward model would do in each of B states."""

    action: Tensor
    """`[B, U]`; a row of NaN where none is given."""
    given: Tensor
    """Whether there is an action, bool `[B]`."""


class Selection(NamedTuple):
    """The choice among K candidate actions in one state."""

    action: Tensor
    """The candidate predicted to come nearest to the target, `[U]`; also when abstaining."""
    index: int  # pyright: ignore[reportIncompatibleMethodOverride]
    """Its place among the candidates."""
    costs: Tensor
    """Distance of each candidate's predicted state from the target, `[K]`; infinite if unknown."""
    spread: float
    """How far apart the predicted states are: root mean square distance from their mean."""
    abstained: bool
    """Whether the candidates cannot be told apart, so that no action should be taken."""


@runtime_checkable
class ForwardModel(Protocol):
    """All that the library asks of a forward model, its own or a user's.

    Example:
        >>> import torch
        >>> class TowardsTarget:
        ...     action_dimensions = 2
        ...
        ...     def command(self, states, targets):
        ...         return Command(targets - states, torch.ones(len(states), dtype=torch.bool))
        ...
        ...     def reset(self):
        ...         pass
        >>> isinstance(TowardsTarget(), ForwardModel)
        True
    """

    @property
    def action_dimensions(self) -> int:
        """Length U of an action."""
        ...

    def command(self, states: Tensor, targets: Tensor) -> Command:
        """The action that should lead from each state `[B, S]` to its target `[B, A]`."""
        ...

    def reset(self) -> None:
        """Starts an episode: what was remembered of the last one is forgotten."""
        ...


@runtime_checkable
class OneStateForwardModel(ForwardModel, Protocol):
    """A forward model that also answers in one state at a time without tensors, for control loops.

    Example:
        >>> from pacnet import MLPForwardModel, MLPForwardModelConfig
        >>> model = MLPForwardModel(MLPForwardModelConfig(1, 1, candidates=((0.0,), (1.0,))))
        >>> isinstance(model, OneStateForwardModel)
        True
    """

    def command_one(
        self, state: NDArray[np.float32] | Tensor, target: NDArray[np.float32] | Tensor
    ) -> NDArray[np.float32] | None:
        """What `command` would do for a state `[S]` and target `[A]`: `[U]`, or None for nothing.

        Raises:
            ValueError: a row that it cannot use.
        """
        ...
