"""What the networks decide: one record from the winner to the action."""

from __future__ import annotations

from typing import Any, NamedTuple

from torch import Tensor

from pacnet.core.old_names import old_names, warn_renamed


@old_names(
    targets="target",
    commanded="has_target",
    novelty="is_novel",
    position="offset",
    given="has_action",
)
class Decision(NamedTuple):
    """What the network decides at one percept, or at each of T percepts.

    Of one percept (`PACNet.step`): numbers and float arrays, None for no target and no action.
    Of T percepts (`recall`, `act`): tensors.
    """

    target: Any
    """Motor target, `[A]` or `[T, A]`; a row of NaN where there is none."""
    has_target: Any
    """Whether there is a target: the percept matches and a schema is confident."""
    winner: Any
    """Nearest node, int64 `[T]`, or `NO_NODE`."""
    activation: Any
    """exp(−distance to the winner), `[T]`."""
    is_novel: Any
    """Whether the activation is under the novelty threshold, bool `[T]`."""
    offset: Any
    """Offset of the target in its schema's sequence, int64 `[T]`; −1 without a target."""
    schema: Any
    """Id of the target's schema, int64 `[T]`, or `NO_SCHEMA`. With one per node, the winner."""
    action: Any = None
    """`[U]` or `[T, U]`; a row of NaN where there is none; None without a forward model."""
    has_action: Any = False
    """Whether there is an action; without one the caller's default behaviour acts."""

    @property
    def abstained(self) -> Any:
        """Whether there is a target, but the forward model could not choose an action for it."""
        return (self.has_target ^ self.has_action) & self.has_target

    @property
    def recall(self) -> Decision:
        """Old name of the record itself."""
        warn_renamed("Action.recall", "Decision")
        return self


@old_names(position="offset")
class SchemaActivity(NamedTuple):
    """The state of S schemas for each of B percepts."""

    confidence: Tensor
    """Confidence of each perceptual schema, `[B, S]`, in [0, 1]."""
    active: Tensor
    """Whether the confidence reaches the threshold: the motor schema is active, bool `[B, S]`."""
    offset: Tensor
    """Index of the nearest percept in each schema's sequence, int64 `[B, S]`."""
    targets: Tensor
    """The target at that index, `[B, S, A]`; NaN where the motor schema is not active."""


@old_names(targets="target", commanded="has_target", given="has_action")
class SchemaDecision(NamedTuple):
    """The winning schema, its target and its action for each of T percepts."""

    target: Tensor
    """The winner's target, `[T, A]`; a row of NaN without a winner."""
    has_target: Tensor
    """Whether there is a winner, bool `[T]`."""
    winner: Tensor
    """Index of the winning schema, int64 `[T]`, or `NO_SCHEMA`."""
    activity: SchemaActivity
    """Of all schemas."""
    has_action: Tensor
    """Whether there is an action, bool `[T]`; without one the caller's default behaviour acts."""
    action: Any = None
    """The winner's command, `[T, U]`; a row of NaN without an action; None from `recall`."""
    candidates: Any = None
    """Commands of all schemas, `[T, S, U]`; NaN if inactive or without one; None from `recall`."""

    @property
    def recall(self) -> SchemaDecision:
        """Old name of the record itself."""
        warn_renamed("SchemaAction.recall", "SchemaDecision")
        return self
