"""Settings of the learned forward models."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from pacnet.core.validation import check_fields, is_integer, is_number


@dataclass(frozen=True)
class MLPForwardModelConfig:
    """Settings of an `MLPForwardModel`.

    Attributes:
        state_dimensions: length S of a state and of a target.
        action_dimensions: length U of an action.
        candidates: the K ≥ 1 actions that `command` chooses from.
        hidden: width of each hidden layer; if empty, the model is linear.
        steps: number of time steps for which an action is held. The model is fitted to one step;
            for more it continues from its own prediction.
        abstain_below: spread of the candidates' predicted states, in the state's unit, below which
            no action is given. A single candidate has spread 0.

    Raises:
        ValueError: a field of another type or out of range.
    """

    state_dimensions: int
    action_dimensions: int
    candidates: tuple[tuple[float, ...], ...]
    hidden: tuple[int, ...] = (64, 64)
    steps: int = 1
    abstain_below: float = 0.03

    def __post_init__(self) -> None:
        """Validate the fields and turn sequences into tuples (JSON has lists)."""
        _check_shared_fields(self)
        layers = isinstance(self.hidden, tuple | list)
        valid = layers and all(is_integer(width, 1) for width in self.hidden)
        check_fields(self, {"hidden": (valid, "to be a tuple of widths ≥ 1")})
        object.__setattr__(self, "hidden", tuple(self.hidden))


@dataclass(frozen=True)
class TransitionMatrixConfig:
    """Settings of a `TransitionMatrix`.

    Attributes:
        state_dimensions: length S of a state and of a target.
        action_dimensions: length U of an action.
        candidates: the K ≥ 1 actions that `command` chooses from. Every other action counts as
            the nearest of them (Euclidean); ties go to the lowest index.
        clusters: number C of clusters of states.
        steps: number of time steps for which an action is held.
        abstain_below: spread of the candidates' predicted states, in the state's unit, below which
            no action is given. A single candidate has spread 0.

    Raises:
        ValueError: a field of another type or out of range.
    """

    state_dimensions: int
    action_dimensions: int
    candidates: tuple[tuple[float, ...], ...]
    clusters: int = 60
    steps: int = 1
    abstain_below: float = 0.03

    def __post_init__(self) -> None:
        """Validate the fields and turn sequences into tuples (JSON has lists)."""
        _check_shared_fields(self)
        check_fields(self, {"clusters": (is_integer(self.clusters, 1), "≥ 1")})


@dataclass(frozen=True)
class AffineForwardModelConfig:
    """Settings of an `AffineForwardModel`.

    Attributes:
        state_dimensions: length S of a state and of a target.
        action_dimensions: length U of an action.
        lead: frames by which a target lies ahead.
        follows: for each action the dimension of the state that it is a place of, −1 for none.
        turns: how many of the state's last dimensions are turns, which are fitted apart from
            places.

    Raises:
        ValueError: a field of another type or out of range.
    """

    state_dimensions: int
    action_dimensions: int
    lead: int
    follows: tuple[int, ...]
    turns: int = 0

    def __post_init__(self) -> None:
        """Validate the fields and turn the sequence into a tuple (JSON has lists)."""
        states, follows = self.state_dimensions, self.follows
        sizes = ("state_dimensions", "action_dimensions", "lead")
        check_fields(self, {name: (is_integer(getattr(self, name), 1), "≥ 1") for name in sizes})
        fits = isinstance(follows, tuple | list) and len(follows) == self.action_dimensions
        valid = fits and all(is_integer(place, -1) and place < states for place in follows)
        wanted = f"as {self.action_dimensions} dimensions of {states}, or −1"
        some = is_integer(self.turns, 0) and self.turns < states
        checks = {"follows": (valid, wanted), "turns": (some, f"from 0 to {states - 1}")}
        check_fields(self, checks)
        object.__setattr__(self, "follows", tuple(follows))


MAX_MOVING = 7
"""Most joints that may move the hand of a `KinematicModel`: more take minutes."""


@dataclass(frozen=True)
class KinematicModelConfig:
    """Settings of a `KinematicModel`.

    Attributes:
        joints: names of the J angles of a posture.
        moving: which of them move the hand, ascending; K from 1 to 7.

    Raises:
        ValueError: a field of another type or out of range.
    """

    joints: tuple[str, ...]
    moving: tuple[int, ...]

    def __post_init__(self) -> None:
        """Validate the fields and turn sequences into tuples (JSON has lists)."""
        joints, moving = self.joints, self.moving
        named = isinstance(joints, tuple | list) and all(isinstance(one, str) for one in joints)
        named = named and 0 < len(joints) == len(set(joints))
        check_fields(self, {"joints": (named, "as one or more names, all different")})
        chosen = isinstance(moving, tuple | list) and 1 <= len(moving) <= MAX_MOVING
        chosen = chosen and all(is_integer(one, 0) and one < len(joints) for one in moving)
        chosen = chosen and list(moving) == sorted(set(moving))
        wanted = f"as 1 to {MAX_MOVING} ascending indices below {len(joints)}"
        check_fields(self, {"moving": (chosen, wanted)})
        object.__setattr__(self, "joints", tuple(joints))
        object.__setattr__(self, "moving", tuple(moving))


def _check_shared_fields(config: Any) -> None:
    """Validate the fields of both models; turn the candidates into tuples (JSON has lists)."""
    threshold, actions = config.abstain_below, config.candidates
    check_fields(
        config,
        {
            "state_dimensions": (is_integer(config.state_dimensions, 1), "≥ 1"),
            "action_dimensions": (is_integer(config.action_dimensions, 1), "≥ 1"),
            "steps": (is_integer(config.steps, 1), "≥ 1"),
            "abstain_below": (is_number(threshold) and threshold >= 0, "≥ 0 and finite"),
            "candidates": (
                _are_actions(actions, config.action_dimensions),
                "to be one or more actions, each of action_dimensions finite numbers",
            ),
        },
    )
    rows = tuple(tuple(float(value) for value in action) for action in actions)
    object.__setattr__(config, "candidates", rows)


def _are_actions(actions: Any, columns: int) -> bool:
    """Return whether these are one or more sequences of so many finite numbers."""
    return (
        isinstance(actions, tuple | list)
        and len(actions) > 0
        and all(isinstance(action, tuple | list) and len(action) == columns for action in actions)
        and all(is_number(value) for action in actions for value in action)
    )
