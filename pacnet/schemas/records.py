"""What goes into motor schemas, and what comes out of them."""

from __future__ import annotations

from typing import Any, NamedTuple

from torch import Tensor


class Samples(NamedTuple):
    """T samples of an episode, in order of time, as the map passes them on."""

    node: Tensor
    """The winner, int64 `[T]`; used only where it is habituated."""
    activation: Tensor
    """Activation of the winner, `[T]`."""
    habituated: Tensor
    """Whether the winner is fully habituated, bool `[T]`."""
    target: Tensor
    """`[T, A]`."""
    cue: Tensor
    """The normalized percept, `[T, D]`."""


class Target(NamedTuple):
    """The current target of a motor schema, at one percept or at each of T percepts.

    Its fields are an array and two integers, or arrays or tensors of T rows. At one percept without
    a target there is no `Target`; among T, its row holds NaN, −1 and −1.
    """

    target: Any
    """`[A]`, or `[T, A]`."""
    offset: Any
    """Its place in the schema's sequence, or int64 `[T]`; with several nearest cues, of the
    nearest."""
    schema: Any
    """The schema's id, or int64 `[T]`."""
