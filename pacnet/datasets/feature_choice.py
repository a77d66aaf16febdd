"""Which features of a dataset are the state, the environment state and the action."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from typing import NamedTuple

from pacnet.datasets.format import DatasetWarning, MissingFeature

STATE, ENVIRONMENT_STATE = "observation.state", "observation.environment_state"

Choice = str | Sequence[str] | None
"""A feature, or several in their order, or none."""


class Features(NamedTuple):
    """The features of each kind, in their order."""

    state: tuple[str, ...]
    environment_state: tuple[str, ...]
    action: tuple[str, ...]

    @property
    def percepts(self) -> tuple[str, ...]:
        """The features of a percept, in its order."""
        return self.state + self.environment_state

    def and_also(self, *others: str) -> list[str]:
        """Return all of them and others, each once."""
        return list(dict.fromkeys((*self.percepts, *self.action, *others)))


def choose_features(
    there: Sequence[str],
    state: Choice,
    environment_state: Choice,
    action: Choice,
) -> Features:
    """Return the features asked for; those that are only defaults may be missing.

    Args:
        there: the vectors of the dataset.
        state: one feature or several, or none; and so for the others.
        environment_state: as `state`.
        action: as `state`.

    Raises:
        ValueError: a feature is given twice.
    """
    states, surroundings, actions = map(_as_tuple, (state, environment_state, action))
    if surroundings == (ENVIRONMENT_STATE,) and (
        ENVIRONMENT_STATE not in there or ENVIRONMENT_STATE in states
    ):
        surroundings = ()
    if states == (STATE,) and STATE not in there and surroundings:
        states = ()
        warnings.warn(
            f"the dataset has no {STATE!r}: percepts are {', '.join(surroundings)} alone; its "
            f"vectors are {', '.join(there)}, choose another state with --state NAME",
            DatasetWarning,
            stacklevel=3,
        )
    percepts = states + surroundings
    for features in (percepts, actions):
        if len(set(features)) < len(features):
            raise ValueError(f"expected different features, got {', '.join(features)}")
    return Features(states, surroundings, actions)


def _as_tuple(choice: Choice) -> tuple[str, ...]:
    if choice is None:
        return ()
    return (choice,) if isinstance(choice, str) else tuple(choice)


def explain_missing(
    error: MissingFeature, features: Features, only_where: str | None
) -> MissingFeature:
    """Return the error with the options to choose other features by."""
    kinds = [
        kind
        for kind, names in features._asdict().items()
        if any(name in names for name in error.features)
    ]
    if only_where in error.features:
        kinds.append("only_where")
    names = dict.fromkeys(kinds, "NAME") | {"environment_state": "NAME or none"}
    options = " and ".join(f"--{kind.replace('_', '-')} {names[kind]}" for kind in kinds)
    arguments = ", ".join(f"{kind}=NAME" for kind in kinds)
    hint = f": choose with {options} ({arguments} in Python)"
    return MissingFeature(error.problem, error.features, hint)
