"""The protocol of a forward model: from the present state and a target state to an action.

Source: Maistros, Marom & Hayes (2001), Experiment 2: "The forward model should suggest to the robot
how to attain a particular target state, given the current state, and the possible actions available
to the robot."
"""

from __future__ import annotations

from typing import NamedTuple, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from pacnet.core.old_names import old_arguments, old_names


@old_arguments(given="has_action")
@old_names(given="has_action")
class Command(NamedTuple):
    """The actions of a forward model in B states."""

    action: Tensor
    """`[B, U]`; a row of NaN where the model gives no action."""
    has_action: Tensor
    """Whether the model gives an action, bool `[B]`."""


@runtime_checkable
class ForwardModel(Protocol):
    """The interface of a forward model of `PACNet` and `SchemaNetwork`, for classes of users too.

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
        """Return the action that leads from each state `[B, S]` towards its target `[B, A]`."""
        ...

    def reset(self) -> None:
        """Start an episode: forget the state of the last one."""
        ...


@runtime_checkable
class OneStateForwardModel(ForwardModel, Protocol):
    """A forward model that also takes single states as arrays, which is faster in control loops."""

    def command_one(
        self, state: NDArray[np.float32] | Tensor, target: NDArray[np.float32] | Tensor
    ) -> NDArray[np.float32] | None:
        """Return the action `[U]` for a state `[S]` and target `[A]`, or None if there is none.

        Raises:
            ValueError: a state or target of the wrong shape, dtype or device, or not finite.
        """
        ...
