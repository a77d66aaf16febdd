"""Acting step by step; where the imitator gives no action, asking for one or holding still."""

from __future__ import annotations

import re
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from lerobot_policy_pacnet.pictures import Pictures
from pacnet.imitator.imitator import Imitator
from pacnet.imitator.records import ImitatorStep, task_name

# Names of actions that keep moving a robot while they are repeated: speeds (x.vel, mobile_base.vx,
# linear_velocity) and displacements (delta_x).
MOVING = re.compile(r"(^|[._])((vel|velocity|speed|v[xyz]|vtheta|omega)$|delta[._])")

Ask = Callable[[ImitatorStep, NDArray[np.float32]], NDArray[np.float32] | None]


class Actor:
    """One robot of a batch, with its own recall episode and its last action.

    Where a percept is novel and no action is supplied, it holds, and goes on as soon as percepts
    are known again. Holding repeats the last action, except for speeds and displacements
    (`MOVING`), which are set to 0: a mobile base would drive on. Where a forward model finds no
    action at a known percept, the whole last action is repeated.

    Args:
        imitator: a trained one, with which the actor shares what it knows now.
    """

    def __init__(self, imitator: Imitator) -> None:
        self.imitator = imitator.fork()
        self._original = imitator
        self._moves = np.array([bool(MOVING.search(name)) for name in imitator.config.action])
        self.imitator.warm_up()
        self.reset()

    def is_of(self, imitator: Imitator) -> bool:
        """Return whether it knows what this imitator knows now."""
        return self._original is imitator and len(self.imitator.reports) == len(imitator.reports)

    def reset(self) -> None:
        """Start a new recall episode."""
        self.imitator.reset()
        self._task: str | None = None
        self._last: NDArray[np.float32] | None = None

    def pursue(self, task: str | None) -> None:
        """Follow only what was shown for a task; another than before starts a recall episode.

        Args:
            task: in the words of the demonstrations; None for whatever fits.

        Raises:
            ValueError: a task that was not shown.
        """
        task = None if task is None else task_name(task)
        if task != self._task:
            self.imitator.reset(task)
            self._task = task

    def act(
        self,
        percept: NDArray[np.float32],
        ask: Ask | None,
        pictures: Pictures | None = None,
    ) -> tuple[NDArray[np.float32], ImitatorStep]:
        """Return what to do at a percept: the imitator's action, else the one asked for, else hold.

        Args:
            percept: `[D]`.
            ask: called with the step and the percept where the imitator gives no action.
            pictures: of the cameras, while the imitator looks at them; None without any.

        Returns:
            The action `[U]`, and the imitator's step.

        Raises:
            ValueError: a percept or an answer has the wrong shape or is not finite.
        """
        step = self.imitator.step(percept, pictures)
        action = step.action
        if action is None and ask is not None:
            action = self._checked(ask(step, percept.copy()))
        if action is None:
            action = self._last_or_first(percept)
            if step.is_novel:
                action = np.where(self._moves, np.float32(0), action)
        self._last = action
        return action, step

    def _last_or_first(self, percept: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return the last action; before the first, one that keeps the robot in place if known."""
        if self._last is not None:
            return self._last
        config = self.imitator.config
        state = config.state_names
        action = self.imitator.first_action.numpy()
        has_names = not any(name.isdecimal() for name in config.action)
        if has_names and set(config.action) <= set(state):  # joint angles as actions
            action = percept[[state.index(name) for name in config.action]]
        return np.where(self._moves, np.float32(0), action)

    def _checked(self, answer: NDArray[np.float32] | None) -> NDArray[np.float32] | None:
        if answer is None:
            return None
        dimensions = len(self.imitator.config.action)
        refusal = f"expected {dimensions} finite numbers as the answer to ask, got {answer!r}"
        try:
            action = np.array(answer, dtype=np.float32)
        except (TypeError, ValueError, RuntimeError) as error:  # text, a tensor with a gradient
            raise ValueError(refusal) from error
        if action.shape != (dimensions,) or not np.isfinite(action).all():
            raise ValueError(refusal)
        return action
