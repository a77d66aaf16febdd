"""How an action changes with where the robot is beside what was shown, in closed form.

A position target is a place of the robot's own, such as a joint angle: it moves with the robot.
Any other action (a speed, a displacement, a torque) is corrected linearly: the differences of two
demonstrations' actions at neighbouring percepts are fitted by those of the percepts. With a single
demonstration the neighbours are its own frames at other times.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from pacnet.core.growable_rows import copy_on_state_dict
from pacnet.core.integrity import check_conditions, check_on_load, check_structure

NO_PLACE = -1
"""Stands for an action that is not a place of the robot's own."""
_RIDGE = 0.1  # in shares of the mean square of the percepts' differences
_SAME = 0.7  # RMS of action − state, in standard deviations of the action, of a position target
_LONGEST_LEAD = 0.5  # [s] that a position target lies ahead


class Correction(NamedTuple):
    """What kernels need: D dimensions of a percept, U of an action."""

    follows: NDArray[np.int64]
    """The dimension of the percept that each action is a place of, or `NO_PLACE`, `[U]`."""
    unit: NDArray[np.float64]
    """What one of a scaled percept is in its own unit, `[D]`."""
    lead: int
    """Frames that position targets lie ahead."""
    gain: NDArray[np.float64]
    """Change of each other action with each dimension of a scaled percept, `[D, U]`."""


class LinearCorrection(nn.Module):
    """Ridge regression of differences of actions on differences of percepts, kept as sums.

    Args:
        percept_dimensions: D.
        action_dimensions: U.
    """

    products: Tensor  # [2, D, D], of the percepts' differences; first among demonstrations
    responses: Tensor  # [2, D, U], of them with the actions'; then within the only one

    def __init__(self, percept_dimensions: int, action_dimensions: int) -> None:
        super().__init__()
        self._widths = {"products": percept_dimensions, "responses": action_dimensions}
        for name, width in self._widths.items():
            self.register_buffer(name, torch.zeros(2, percept_dimensions, width))
        copy_on_state_dict(self)
        check_on_load(self)

    def add(
        self, percepts: NDArray[np.float32], actions: NDArray[np.float32], *, within: bool
    ) -> None:
        """Take in differences of neighbouring percepts `[P, D]` and of their actions `[P, U]`.

        Args:
            percepts: scaled.
            actions: of as many pairs.
            within: whether both of a pair are of the same demonstration.
        """
        x, kind = percepts.astype(np.float64), int(within)
        self.products[kind] += torch.from_numpy(x.T @ x).float()
        self.responses[kind] += torch.from_numpy(x.T @ actions.astype(np.float64)).float()

    def gain(self) -> NDArray[np.float64]:
        """Return the change of each action with each dimension of a percept, `[D, U]`."""
        among = bool(self.products[0].any())
        products = self.products[int(not among)].double().numpy()
        responses = self.responses[int(not among)].double().numpy()
        ridge = _RIDGE * np.trace(products) / len(products)
        if not ridge > 0:
            return np.zeros_like(responses)
        return np.linalg.solve(products + ridge * np.eye(len(products)), responses)

    def check_state(self, tensors: Mapping[str, Tensor]) -> None:
        """Raise a ValueError unless these tensors, of a `state_dict`, are the state of one."""
        check_structure(self, tensors)
        for name, width in self._widths.items():  # its buffers may be others by now
            got, wanted = [*tensors[name].shape], [2, self._widths["products"], width]
            if got != wanted:
                raise ValueError(f"expected {name} of shape {wanted}, got {got}")
        sums = tensors["products"]
        check_conditions(
            {
                "finite sums": sums.isfinite().all() and tensors["responses"].isfinite().all(),
                "products of differences": _are_products(sums),
            }
        )


def _are_products(sums: Tensor) -> bool:
    """Return whether these may be sums of products, `[2, D, D]`: symmetric, without a negative."""
    if not bool(sums.isfinite().all() and torch.allclose(sums, sums.mT, rtol=1e-4)):
        return False
    values = torch.linalg.eigvalsh(sums.double())
    return bool((values[:, 0] >= -1e-4 * values.abs().amax(dim=1)).all())


def find_position_targets(
    states: Sequence[Tensor],
    actions: Sequence[Tensor],
    state_names: Sequence[str],
    action_names: Sequence[str],
    fps: float,
) -> tuple[tuple[int, ...], int]:
    """Find which actions are places that the robot's state then goes to.

    Args:
        states: of each demonstration, `[T, S]`.
        actions: of each, `[T, U]`.
        state_names: of the S dimensions; a state with an action's name is the only one that the
            action may be a place of.
        action_names: of the U dimensions.
        fps: frames per second [1/s].

    Returns:
        For each action the dimension of the state, or `NO_PLACE`, and the frames by which these
        actions lie ahead.
    """
    state, action = torch.cat([*states]).double(), torch.cat([*actions]).double()
    deviation = action.std(dim=0, correction=0)
    follows = []
    for j, name in enumerate(action_names):
        named = [i for i, other in enumerate(state_names) if other == name]
        candidates = named or range(len(state_names))
        apart = {i: float((action[:, j] - state[:, i]).square().mean().sqrt()) for i in candidates}
        nearest = min(apart, key=lambda i: apart[i], default=NO_PLACE)
        is_place = nearest != NO_PLACE and apart[nearest] < _SAME * float(deviation[j])
        follows.append(nearest if is_place else NO_PLACE)
    return tuple(follows), _lead(states, actions, follows, round(_LONGEST_LEAD * fps))


def _lead(
    states: Sequence[Tensor], actions: Sequence[Tensor], follows: Sequence[int], longest: int
) -> int:
    """Return the number of frames after which the state is nearest to the action."""
    places = [(j, i) for j, i in enumerate(follows) if i != NO_PLACE]
    if not places:
        return 0
    js, of = [j for j, _ in places], [i for _, i in places]
    errors = []
    for lead in range(longest + 1):
        apart = [
            (action[: len(action) - lead, js] - state[lead:, of]).double().square()
            for state, action in zip(states, actions, strict=True)
            if len(state) > lead
        ]
        errors.append(float(torch.cat(apart).mean()) if apart else float("inf"))
    return int(np.argmin(errors))
