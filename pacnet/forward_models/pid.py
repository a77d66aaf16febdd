"""A joint-space PID controller, the forward model of the paper's postural experiment.

It turns target joint angles into joint torques. One row of a batch is one robot at one instant.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from numbers import Real

import torch
from torch import Tensor, nn

from pacnet.core.validation import check_fields, check_rows
from pacnet.forward_models.protocol import Command

_GAINS = ("kp", "ki", "kd")


@dataclass(frozen=True, kw_only=True)
class PIDConfig:
    """Gains and limits of a `PIDController`, one gain per joint.

    Attributes:
        kp: proportional gains [N m / rad].
        ki: integral gains [N m / (rad s)].
        kd: derivative gains [N m s / rad].
        dt: time between two updates [s].
        integral_limit: bound on the magnitude of each joint's integrated error [rad s].
        torque_limit: bound on the magnitude of each joint's torque [N m].

    Raises:
        ValueError: a field of another type or out of range; no gains, or not equally many. A
            limit may be infinite.
    """

    kp: tuple[float, ...]
    ki: tuple[float, ...]
    kd: tuple[float, ...]
    dt: float
    integral_limit: float
    torque_limit: float

    def __post_init__(self) -> None:
        """Validate the fields and turn sequences into tuples (JSON has lists)."""
        joints = len(self.kp) if isinstance(self.kp, tuple | list) else 0
        gains = "to be one finite gain ≥ 0 for each of one or more joints, as many as kp"
        check_fields(
            self,
            {name: (_are_gains(getattr(self, name), joints), gains) for name in _GAINS}
            | {
                "dt": (_is_positive(self.dt) and self.dt < math.inf, "> 0 and finite [s]"),
                "integral_limit": (_is_positive(self.integral_limit), "> 0 [rad s]"),
                "torque_limit": (_is_positive(self.torque_limit), "> 0 [N m]"),
            },
        )
        for name in _GAINS:
            object.__setattr__(self, name, tuple(float(gain) for gain in getattr(self, name)))


def _are_gains(value: object, joints: int) -> bool:
    return (
        isinstance(value, tuple | list)
        and len(value) == joints > 0
        and all(isinstance(gain, Real) and 0 <= float(gain) < math.inf for gain in value)
    )


def _is_positive(value: object) -> bool:
    return isinstance(value, Real) and float(value) > 0


class PIDController(nn.Module):
    """Batched joint PID with a clamped integral.

    With the error e = target - angle [rad]:

        integral <- clamp(integral + e dt, +- integral_limit)
        torque    = clamp(kp e + ki integral + kd (target velocity - velocity), +- torque_limit)

    The derivative acts on measured velocities, not on differences of e, so a jump of the target
    causes no spike of torque. `forward` only reads; `step` keeps the integral between calls.

    Args:
        config: see `PIDConfig`.
    """

    kp: Tensor  # [J]
    ki: Tensor  # [J]
    kd: Tensor  # [J]
    integral: Tensor  # [B, J] [rad s]; no rows before the first step of an episode

    def __init__(self, config: PIDConfig) -> None:
        super().__init__()
        self.config = config
        for name in _GAINS:
            self.register_buffer(name, torch.tensor(getattr(config, name)))
        self.register_buffer("integral", torch.zeros(0, len(config.kp)), persistent=False)

    @property
    def action_dimensions(self) -> int:
        """Number J of joints, each with a torque."""
        return len(self.config.kp)

    def forward(
        self,
        angles: Tensor,
        velocities: Tensor,
        targets: Tensor,
        integral: Tensor,
        target_velocities: Tensor | None = None,
    ) -> tuple[Tensor, Tensor]:
        """Compute one update without keeping anything.

        Args:
            angles: measured joint angles `[B, J]` [rad].
            velocities: measured joint velocities `[B, J]` [rad/s].
            targets: target joint angles `[B, J]` [rad].
            integral: integrated error before this update `[B, J]` [rad s].
            target_velocities: target joint velocities `[B, J]` [rad/s]; default: 0.

        Returns:
            The torque `[B, J]` [N m] and the integrated error after this update `[B, J]` [rad s].

        Raises:
            ValueError: a tensor of the wrong shape, dtype or device, without rows, or not finite;
                unequal numbers of rows.
        """
        batch = {
            "angles": angles, "velocities": velocities, "targets": targets, "integral": integral,
        }  # fmt: skip
        if target_velocities is not None:
            batch["target_velocities"] = target_velocities
        for name, value in batch.items():
            check_rows(name, value, columns=len(self.kp), like=self.kp)
        rows = {name: len(value) for name, value in batch.items()}
        if len(set(rows.values())) > 1:
            raise ValueError(f"expected equally many rows (or a reset between), got {rows}")
        limit, torque_limit = self.config.integral_limit, self.config.torque_limit
        error = targets - angles  # [B, J] [rad]
        integral = (integral + error * self.config.dt).clamp(-limit, limit)
        damping = self.kd * ((0.0 if target_velocities is None else target_velocities) - velocities)
        torque = self.kp * error + self.ki * integral + damping  # [B, J] [N m]
        return torque.clamp(-torque_limit, torque_limit), integral

    def step(
        self,
        angles: Tensor,
        velocities: Tensor,
        targets: Tensor,
        target_velocities: Tensor | None = None,
    ) -> Tensor:
        """Compute one update, keep the integral for the next one, return the torque `[B, J]` [N m].

        The arguments are those of `forward`.

        Raises:
            ValueError: as `forward`, and if the number of rows changes without a `reset`.
        """
        integral = self.integral
        if len(integral) == 0:
            check_rows("angles", angles, columns=len(self.kp), like=self.kp)
            integral = torch.zeros_like(angles)
        torque, integral = self(angles, velocities, targets, integral, target_velocities)
        self.integral = integral.detach()
        return torque

    def command(self, states: Tensor, targets: Tensor) -> Command:
        """Compute one update as a `ForwardModel`: `step` with angles and velocities in one tensor.

        Args:
            states: measured joint angles [rad], then velocities [rad/s], `[B, 2 J]`.
            targets: target joint angles `[B, J]` [rad].

        Raises:
            ValueError: as `step`.
        """
        joints = len(self.kp)
        check_rows("states", states, columns=2 * joints, like=self.kp)
        torque = self.step(states[:, :joints], states[:, joints:], targets)
        return Command(torque, torch.ones(len(torque), dtype=torch.bool, device=torque.device))

    def reset(self) -> None:
        """Start an episode, with any number of rows: forget the integral."""
        self.integral = self.kp.new_zeros(0, len(self.kp))
