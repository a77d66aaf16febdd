"""Settings of an imitator: its features by name, and the settings of its parts."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Literal

from pacnet.attention.config import SOFMConfig
from pacnet.core.old_names import with_new_names
from pacnet.core.validation import MAX_SAMPLES, check_fields, is_integer, is_number
from pacnet.datasets.demonstrations import ACTION, dimension_names
from pacnet.forward_models.config import AffineForwardModelConfig, MLPForwardModelConfig
from pacnet.imitator.scaling import Scaling
from pacnet.schemas.frames import FramesConfig
from pacnet.schemas.points import Points
from pacnet.vision.cameras_config import CAMERAS, CamerasConfig

_FASTEST = 100_000  # frames per second [1/s]; memory for the last of them is made beforehand


@dataclass(frozen=True)
class ImitatorConfig:
    """Settings of an `Imitator`; `Imitator.from_demonstrations` chooses them from data.

    Attributes:
        percepts: feature -> names of its dimensions, in the order of the percept.
        action: names of the action's dimensions.
        fps: frames per second of the demonstrations [1/s], up to 100,000.
        targets: what motor schemas store: the demonstrated `action`, or the `state` `lead` frames
            later, to which a forward model finds the action.
        lead: frames that a `state` lies ahead, ≥ 1.
        scaling: of percepts.
        attention: of the map; its scale is that of percepts, up to a common factor.
        follows: for each dimension of a target the dimension of the state that it is a place of,
            −1 for none; see `pacnet.forward_models.correction`.
        follows_after: frames by which such targets lie ahead of the state, ≥ 0.
        budget: number of targets that are kept, at most; None for all.
        forward_model: None if targets are actions.
        explained: forward model that was tried -> share of the change of state that it predicted,
            in frames held out; of those the best is used.
        still_actions: numbers of the actions that do not move the state, such as a gripper's
            beside a hand's place; a target that is a state ends with them.
        state: the features that are the robot's state, with which a percept begins; () for none,
            None for the first feature.
        action_features: the features that are the action, in its order.
        frames: how targets are kept in frames of reference; None for none.
        cameras: which cameras tell where the hand will be; None for none.
    """

    percepts: Mapping[str, tuple[str, ...]]
    action: tuple[str, ...]
    fps: float
    targets: Literal["action", "state"]
    lead: int
    scaling: Scaling
    attention: SOFMConfig
    follows: tuple[int, ...]
    follows_after: int
    budget: int | None = None
    forward_model: AffineForwardModelConfig | MLPForwardModelConfig | None = None
    state: tuple[str, ...] | None = None
    action_features: tuple[str, ...] = (ACTION,)
    frames: FramesConfig | None = None
    explained: Mapping[str, float] = field(default_factory=dict)
    still_actions: tuple[int, ...] = ()
    cameras: CamerasConfig | None = None

    def __post_init__(self) -> None:
        """Turn the lists that JSON reads into tuples, and check the fields."""
        percepts = {feature: tuple(names) for feature, names in self.percepts.items()}
        object.__setattr__(self, "percepts", percepts)
        for name in ("action", "follows", "action_features", "still_actions"):
            object.__setattr__(self, name, tuple(getattr(self, name)))
        if self.state is not None:
            object.__setattr__(self, "state", tuple(self.state))
        dimensions, width = self.attention.dimensions, len(self.scaling.scale)
        first = tuple(percepts)[: len(self.state_features)]
        same = len(self.percept_names) == dimensions == width
        checks = {
            "percepts": (same, f"of {dimensions} dimensions (attention), {width} (scaling)"),
            "state": (self.state_features == first, f"as the first of {', '.join(percepts)}"),
            "action_features": (all(map(_is_name, self.action_features)), "as names"),
            "fps": (is_number(self.fps) and 0 < self.fps <= _FASTEST, f"> 0, ≤ {_FASTEST}"),
            "targets": (self.targets in ("action", "state"), '"action" or "state"'),
            "lead": (is_integer(self.lead, 1), "≥ 1"),
            "follows_after": (
                is_integer(self.follows_after, 0) and self.follows_after <= MAX_SAMPLES,
                f"from 0 to {MAX_SAMPLES}",
            ),
            "budget": (self.budget is None or is_integer(self.budget, 1), "≥ 1, or None"),
            "forward_model": (
                (self.targets == "state") == (self.forward_model is not None),
                "where targets are states, and only there",
            ),
        }
        check_fields(self, {**checks, **self._model_checks()})
        count, most = self.target_dimensions, self.state_dimensions
        fits = len(self.follows) == count and all(is_integer(i, -1) for i in self.follows)
        wanted = f"as {count} dimensions of {most}, or −1"
        checks = {
            "follows": (fits and max(self.follows, default=-1) < most, wanted),
            "frames": (
                self._fits(self.frames),
                f"of {dimensions} dimensions, with targets that are actions",
            ),
            "cameras": (self._tells(self.cameras), "that tell the last percepts, or the state"),
        }
        check_fields(self, checks)

    def _model_checks(self) -> dict[str, tuple[bool, str]]:
        """Return whether what is kept about the forward model is valid, and what is."""
        still, shares = self.still_actions, self.explained
        numbers = all(is_integer(number, 0) and number < len(self.action) for number in still)
        ascends = numbers and list(still) == sorted(set(still))
        with_states = self.targets == "state" or not still
        are_shares = isinstance(shares, Mapping) and all(
            _is_name(name) and is_number(share) and share <= 1 for name, share in shares.items()
        )
        return {
            "still_actions": (ascends and with_states, "as ascending numbers, of state targets"),
            "explained": (are_shares, "as shares ≤ 1 by name"),
        }

    def _tells(self, cameras: object) -> bool:
        """Return whether cameras tell places that percepts end with, or else the robot's state."""
        if cameras is None:
            return True
        if not isinstance(cameras, CamerasConfig):
            return False
        if self.tells_places:
            return [*self.percepts.items()][-1] == (CAMERAS, cameras.names)
        return CAMERAS not in self.percepts and cameras.hand == self.state_names

    def _fits(self, frames: object) -> bool:
        """Return whether frames are of these percepts and actions, none of which are dropped."""
        if frames is None:
            return True
        if not isinstance(frames, FramesConfig):
            return False
        dimensions, model, body = self.attention.dimensions, frames.forward_model, frames.body
        perceived, implied = frames.parted
        seen = (*frames.others, *perceived, *(() if body is None else body.angles))
        within = max(seen) < dimensions
        within &= implied == tuple(range(dimensions, dimensions + len(frames.added)))
        actions = len(self.action)
        moved = model is None or model.action_dimensions == actions
        commanded = body is None or max(body.commands) < actions
        return self.targets == "action" and within and moved and commanded

    @property
    def points(self) -> Points | None:
        """Which dimensions of a percept are points; None for none."""
        return None if self.frames is None else self.frames.points

    @property
    def perceived(self) -> dict[str, tuple[str, ...]]:
        """The features of a percept without what cameras tell, and their dimensions."""
        told = CAMERAS if self.tells_places else None
        return {name: parts for name, parts in self.percepts.items() if name != told}

    @property
    def tells_places(self) -> bool:
        """Whether what cameras tell is a part of the percept: where the hand will be.

        Without frames of reference they tell postures, to which demonstrations are warped.
        """
        return self.cameras is not None and self.frames is not None

    @property
    def perceived_dimensions(self) -> int:
        """Length of a percept without what cameras tell."""
        return len(self.percept_names) - len(self.percepts[CAMERAS] if self.tells_places else ())

    @property
    def target_dimensions(self) -> int:
        """Length A of a target."""
        if self.targets == "action":
            return len(self.action)
        return self.state_dimensions + len(self.still_actions)

    @property
    def state_features(self) -> tuple[str, ...]:
        """The features that are the robot's state."""
        return tuple(self.percepts)[:1] if self.state is None else self.state

    @cached_property
    def state_dimensions(self) -> int:
        """Length S of the robot's state, with which a percept begins; 0 without one."""
        return sum(len(self.percepts[feature]) for feature in self.state_features)

    @property
    def state_names(self) -> tuple[str, ...]:
        """Names of the S dimensions of the robot's state, as if there were no other features."""
        return dimension_names({name: self.percepts[name] for name in self.state_features})

    @cached_property  # needed at every step of a control loop
    def percept_names(self) -> tuple[str, ...]:
        """Names of a percept's D dimensions."""
        return dimension_names(self.percepts)

    @cached_property
    def point_dimensions(self) -> tuple[str, ...]:
        """Names of a percept's D dimensions, and of what it implies where there are points."""
        return (*self.percept_names, *(() if self.frames is None else self.frames.added))

    @classmethod
    def from_dict(cls, fields: dict[str, Any]) -> ImitatorConfig:
        """Return the config that `dataclasses.asdict` turned into these fields, after JSON.

        Raises:
            ValueError: a field is missing, unknown or out of range.
        """
        try:
            model, parts = fields["forward_model"], {}
            if model is not None:
                kind = MLPForwardModelConfig if "candidates" in model else AffineForwardModelConfig
                parts["forward_model"] = kind(**with_new_names(kind, model))
            parts["scaling"] = Scaling(**fields["scaling"])
            parts["attention"] = SOFMConfig(**fields["attention"])
            if fields.get("frames") is not None:
                parts["frames"] = FramesConfig.from_dict(fields["frames"])
            if fields.get("cameras") is not None:
                parts["cameras"] = CamerasConfig.from_dict(fields["cameras"])
            return cls(**{**fields, **parts})
        except (AttributeError, KeyError, TypeError) as error:
            raise ValueError(f"expected the fields of ImitatorConfig, got {error!r}") from error


def _is_name(value: object) -> bool:
    return isinstance(value, str) and value != ""
