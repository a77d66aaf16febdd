"""Acting step by step, and holding still, or asking, where the imitator does not act."""

from __future__ import annotations

import copy
import re
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from pacnet.imitator.imitator import Imitator, ImitatorStep

# Names of actions that go on moving a robot while they are repeated: speeds (x.vel, mobile_base.vx,
# linear_velocity) and displacements (delta_x).
MOVING = re.compile(r"(^|[._])((vel|velocity|speed|v[xyz]|vtheta|omega)$|delta[._])")

Ask = Callable[[ImitatorStep, NDArray[np.float32]], NDArray[np.float32] | None]


class Actor:
    """One robot of a batch: where it is in its recall episode, and its last action.

    Where something is new and nobody answers, it holds until the episode ends: halfway through a
    task may look known again, but what came before it was not done. To hold is to repeat the last
    action, but for speeds and displacements (`MOVING`), which are 0 then: a base that repeated them
    would drive on. Where nothing is recalled for a moment, though nothing is new, all of the last
    action is repeated.

    Args:
        imitator: a taught one; the actor keeps a copy, whose recall episode is its own.
    """

    def __init__(self, imitator: Imitator) -> None:
        self.imitator = copy.deepcopy(imitator)
        self._taught = imitator
        self._moves = np.array([bool(MOVING.search(name)) for name in imitator.config.action])
        self.imitator.warm_up()
        self.reset()

    def knows(self, imitator: Imitator) -> bool:
        """Whether it is this imitator's, which has learned nothing since."""
        return self._taught is imitator and len(self.imitator.lessons) == len(imitator.lessons)

    def reset(self) -> None:
        """Starts a new recall episode."""
        self.imitator.reset()
        self._last: NDArray[np.float32] | None = None
        self._holds = False  # for the rest of the episode

    def act(
        self, percept: NDArray[np.float32], ask: Ask | None
    ) -> tuple[NDArray[np.float32], ImitatorStep]:
        """What to do about a percept: what was learned, else what is answered, else hold.

        Args:
            percept: `[D]`.
            ask: called with the step and the percept where the imitator does not act.

        Returns:
            The action `[U]`, and the imitator's step.

        Raises:
            ValueError: a percept or an answer of the wrong shape, or not finite.
        """
        step = self.imitator.step(percept)
        action = None if self._holds else step.action
        if action is None and ask is not None:
            action = self._checked(ask(step, percept.copy()))
        if action is None:
            self._holds |= step.is_novel
            action = self._last_or_first(percept)
            if self._holds:
                action = np.where(self._moves, np.float32(0), action)
        self._last = action
        return action, step

    def _last_or_first(self, percept: NDArray[np.float32]) -> NDArray[np.float32]:
        """The last action; before any, one that leaves the robot where it is, if that is known."""
        if self._last is not None:
            return self._last
        config = self.imitator.config
        state = next(iter(config.percepts.values()))
        action = self.imitator.first_action.numpy()
        are_named = not any(name.isdecimal() for name in config.action)
        if are_named and set(config.action) <= set(state):  # joints commanded by their angles
            action = percept[[state.index(name) for name in config.action]]
        return np.where(self._moves, np.float32(0), action)

    def _checked(self, answer: NDArray[np.float32] | None) -> NDArray[np.float32] | None:
        if answer is None:
            return None
        dimensions = len(self.imitator.config.action)
        refusal = f"expected {dimensions} finite numbers as the answer to ask, got {answer!r}"
        try:
            action = np.array(answer, dtype=np.float32)
        except (TypeError, ValueError, RuntimeError) as error:  # words, a tensor with a gradient
            raise ValueError(refusal) from error
        if action.shape != (dimensions,) or not np.isfinite(action).all():
            raise ValueError(refusal)
        return action
