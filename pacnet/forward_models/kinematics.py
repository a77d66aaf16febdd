"""A model of one's own body: where the hand is in each posture, learned by babbling.

The robot moves at random and sees where its hand goes. The pose of a hand at the end of a chain of
hinges is linear in the products of one of 1, sin q, cos q for each hinge, so the model is exact and
fitted in closed form (`kinematics_fit.py`); no network is trained. Its inverse takes the hand to a
place: damped least squares (Wampler 1986) from the posture to stay near to.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from pacnet.core.integrity import check_conditions, check_structure
from pacnet.core.validation import MAX_VALUE, describe
from pacnet.forward_models.config import KinematicModelConfig
from pacnet.forward_models.kinematic_arrays import (
    HandPose,
    KinematicArrays,
    KinematicFit,
    Reach,
)
from pacnet.forward_models.kinematic_checks import (
    check_array,
    check_postures,
    check_range,
    check_turns,
)
from pacnet.forward_models.kinematics_fit import Fitted, fit_products
from pacnet.forward_models.saved_model import WholeModel
from pacnet.forward_models.turn_matrices import nearest_turns

_UNTURNED = [3, 7, 11]  # of the outputs, the diagonal of the rotation matrix
_SHARE_OFF = 0.01  # of the extent of the places, by which a given function may be off


class KinematicModel(WholeModel):
    """Predicts where the hand is and how it is turned, and finds postures that take it somewhere.

    With K joints that move the hand,

        (place, rotation matrix) = coefficients · (1, sin q, cos q)₁ ⊗ … ⊗ (1, sin q, cos q)_K

    which is exact for hinges. The unit of places is that of the data. Make one by `fitted`, by
    `from_function` or by `from_pretrained`; before, the hand rests at the origin.

    Args:
        config: see `KinematicModelConfig`.

    Example:
        >>> angles = torch.linspace(-1, 1, 40, dtype=torch.float64)[:, None]
        >>> places = torch.cat([angles.cos(), angles.sin(), 0 * angles], dim=1)  # an arm of 1 m
        >>> turns = torch.cat([(angles / 2).cos(), 0 * places[:, :2], (angles / 2).sin()], dim=1)
        >>> model, fit = KinematicModel.fitted(("shoulder",), angles, places, turns)
        >>> model(torch.tensor([0.5])).place.round(decimals=2)
        tensor([0.8800, 0.4800, 0.0000], dtype=torch.float64)
        >>> reach = model.solve(np.zeros(1), np.array([0.8, 0.6, 0.0]))
        >>> round(float(reach.angles[0]), 3)  # the arc tangent of 0.6 / 0.8
        0.644
    """

    config_type = KinematicModelConfig
    float_tensor = checked_like = "coefficients"

    config: KinematicModelConfig
    coefficients: Tensor  # float64 [3**K, 12]; the last joint's factor changes soonest
    lowest: Tensor  # float64 [J], of the angles that were fitted [rad], as below
    highest: Tensor

    def __init__(self, config: KinematicModelConfig) -> None:
        super().__init__(config)
        joints, products = len(config.joints), 3 ** len(config.moving)
        coefficients = torch.zeros(products, 12, dtype=torch.float64)
        coefficients[0, _UNTURNED] = 1.0
        self.register_buffer("coefficients", coefficients)
        for name in ("lowest", "highest"):
            self.register_buffer(name, torch.zeros(joints, dtype=torch.float64))

    @classmethod
    def fitted(
        cls, joints: Sequence[str], angles: Any, places: Any, turns: Any
    ) -> tuple[KinematicModel, KinematicFit]:
        """Fit where the hand was seen in N postures; find which joints move it.

        Args:
            joints: names of the J angles.
            angles: array or tensor `[N, J]` [rad].
            places: of the hand, `[N, 3]`.
            turns: of the hand, unit quaternions w, x, y, z, `[N, 4]`.

        Raises:
            ValueError: not such rows of finite numbers, unequal numbers of rows, nothing that moves
                the hand, or too few postures for what moves it: there must be 4 · 3**K.
        """
        postures = check_postures(joints, angles, places, turns)
        fitted = fit_products(*postures)
        ends = postures.angles.min(axis=0), postures.angles.max(axis=0)
        return cls._made(joints, fitted, *ends)

    @classmethod
    def from_function(
        cls,
        function: Callable[[NDArray[np.float64]], tuple[Any, Any]],
        joints: Sequence[str],
        lowest: Any,
        highest: Any,
        seed: int = 0,
    ) -> KinematicModel:
        """Make one from a model of a body that is at hand, such as a simulator's.

        Args:
            function: from angles `[J]` [rad] to a place `[3]` and a turn, a unit quaternion w, x,
                y, z or a rotation matrix `[3, 3]`.
            joints: names of the J angles.
            lowest: of each angle, `[J]` [rad].
            highest: of each angle, `[J]` [rad].
            seed: of the postures for which the function is called.

        Raises:
            ValueError: no such range or function, nothing that moves the hand, or no chain of
                hinges: the fit is off by more than 1 % of the extent of the places.
        """
        from pacnet.forward_models.kinematic_function import postures_of

        low, high = check_range(joints, lowest, highest)
        moving, postures = postures_of(function, joints, low, high, np.random.default_rng(seed))
        fitted = fit_products(*postures, moving)
        extent = float(postures.places.std(axis=0).max())
        if fitted.place_rms > _SHARE_OFF * extent or fitted.turn_rms > _SHARE_OFF:
            raise ValueError(
                f"expected a chain of hinges, got places {fitted.place_rms:.2g} and turns "
                f"{fitted.turn_rms:.2g} rad off what products of sines and cosines predict"
            )
        return cls._made(joints, fitted, low, high)[0]

    @classmethod
    def _made(
        cls, joints: Sequence[str], fitted: Fitted, lowest: Any, highest: Any
    ) -> tuple[KinematicModel, KinematicFit]:
        model = cls(KinematicModelConfig(tuple(joints), fitted.moving))
        learned = {"coefficients": fitted.coefficients, "lowest": lowest, "highest": highest}
        model.load_state_dict({name: torch.from_numpy(one) for name, one in learned.items()})
        moving = tuple(joints[joint] for joint in fitted.moving)
        return model, KinematicFit(fitted.place_rms, fitted.turn_rms, moving)

    def forward(self, angles: Tensor) -> HandPose:
        """Return where the hand is in postures `[..., J]` [rad], in the dtype of the model.

        Raises:
            ValueError: not a floating-point tensor of so many angles, on the model's device, or not
                finite.
        """
        joints, like = len(self.config.joints), self.coefficients
        wanted = f"expected angles as a tensor [..., {joints}] of finite numbers on {like.device}"
        if not isinstance(angles, Tensor) or not angles.is_floating_point():
            raise ValueError(f"{wanted}, got {describe(angles)}")
        if angles.shape[-1:] != (joints,) or angles.device != like.device:
            raise ValueError(f"{wanted}, got {describe(angles)}")
        if not bool(angles.isfinite().all()):
            raise ValueError(f"{wanted}, got NaN or infinity")
        products = like.new_ones(*angles.shape[:-1], 1)
        for angle in angles[..., list(self.config.moving)].to(like.dtype).unbind(-1):
            waves = torch.stack([torch.ones_like(angle), angle.sin(), angle.cos()], dim=-1)
            products = (products[..., :, None] * waves[..., None, :]).flatten(-2)
        pose = products @ like
        matrices = pose[..., 3:].unflatten(-1, (3, 3))
        return HandPose(pose[..., :3], nearest_turns(matrices))

    def solve(self, near: Any, place: Any, turn: Any = None) -> Reach:
        """Return the posture nearest to another that takes the hand to a place.

        Joints that do not move the hand keep their angles; others stay within those fitted. A place
        that cannot be reached is approached as far as it goes; the distance says how far is left.

        Args:
            near: `[J]` [rad].
            place: `[3]`, in the unit that was fitted.
            turn: unit quaternion w, x, y, z, `[4]`; None for any.

        Raises:
            ValueError: not such arrays of finite numbers.
        """
        from pacnet.forward_models.kinematic_reach import nearest_posture  # imports numba

        start = check_array("near", near, (len(self.config.joints),))
        target = check_array("place", place, (3,))
        wanted = None if turn is None else check_turns(turn, (4,))
        return nearest_posture(self.arrays(), start, target, wanted)

    def arrays(self) -> KinematicArrays:
        """Return what compiled callers need, as copies."""
        learned = (one.double().numpy(force=True) for one in self.buffers())
        coefficients, lowest, highest = (one.copy() for one in learned)
        return KinematicArrays(
            coefficients, np.array(self.config.moving, np.int64), lowest, highest
        )

    def check_state(self, tensors: Mapping[str, Tensor]) -> None:
        """Raise a ValueError unless these tensors, of a `state_dict`, are the state of one."""
        check_structure(self, tensors)
        finite = {
            f"{name} within ±{MAX_VALUE:g}, finite": (one.abs() <= MAX_VALUE).all()
            for name, one in tensors.items()
        }
        order = {"lowest ≤ highest": (tensors["lowest"] <= tensors["highest"]).all()}
        check_conditions(finite | order)
