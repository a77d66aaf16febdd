"""Why an imitator acts at a percept or holds."""

from __future__ import annotations

from typing import NamedTuple

from pacnet.imitator.imitator import ImitatorStep


class Reason(NamedTuple):
    """In two lengths."""

    short: str
    """A few words, the same at all frames that share them."""
    sentence: str
    """With the names and numbers of this frame."""


def reason_of(step: ImitatorStep) -> Reason:
    """What decided whether there is an action."""
    decision = step.decision
    if step.is_novel:
        return Reason("new percept", f"the percept is new in {step.dimension}")
    if decision.is_novel:
        return Reason("no match", "no node of the map matches the percept")
    if decision.target is None:
        told = (
            f"no motor schema of node {decision.winner} is confident, nor another near the percept"
        )
        return Reason("no confident schema", told)
    if step.action is None:
        told = "the forward model cannot tell which action leads to the target"
        return Reason("no known action", told)
    return Reason("known", "the percept is known, and a motor schema is confident")
