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


@dataclass(frozen=True, kw_only=True)
class PIDConfig:
    """Gains and limits of a `PIDController`, one gain per joint.

    Attributes:
        kp: Proportional gains [N m / rad].
        ki: Integral gains [N m / (rad s)].
        kd: Derivative gains [N m s / rad].
        dt: Time between two updates [s].
        integral_limit: Bound on the magnitude of each joint's integrated error [rad s].
        torque_limit: Bound on the magnitude of each joint's torque [N m].

    Raises:
        ValueError: A field of another type; gains that are negative, not finite, none or not
            equally many; a time step that is not positive and finite; a limit that is not
            positive (infinity: no limit).
    """

    kp: tuple[float, ...]
    ki: tuple[float, ...]
    kd: tuple[float, ...]
    dt: float
    integral_limit: float
    torque_limit: float

    def __post_init__(self) -> None:
        """Turn sequences (JSON reads lists) into tuples and check every field."""
        self._check_types()
        for name in ("kp", "ki", "kd"):
            object.__setattr__(self, name, tuple(float(gain) for gain in getattr(self, name)))
        joints = len(self.kp)
        checks = {
            name: (
                len(gains) == joints > 0 and all(0 <= gain < math.inf for gain in gains),
                "to be one finite gain ≥ 0 for each of one or more joints, as many as kp",
            )
            for name, gains in (("kp", self.kp), ("ki", self.ki), ("kd", self.kd))
        }
        checks["dt"] = (0 < self.dt < math.inf, "> 0 and finite [s]")
        checks["integral_limit"] = (self.integral_limit > 0, "> 0 [rad s]")
        checks["torque_limit"] = (self.torque_limit > 0, "> 0 [N m]")
        check_fields(self, checks)

    def _check_types(self) -> None:
        checks = {}
        for name in ("kp", "ki", "kd"):
            gains = getattr(self, name)
            numbers = isinstance(gains, tuple | list) and all(isinstance(g, Real) for g in gains)
            checks[name] = (numbers, "to be a tuple of floats")
        for name in ("dt", "integral_limit", "torque_limit"):
            checks[name] = (isinstance(getattr(self, name), Real), "to be a float")
        check_fields(self, checks)


class PIDController(nn.Module):
    """Batched joint PID with a clamped integral.

    With the error e = target - angle [rad]:

        integral <- clamp(integral + e dt, +- integral_limit)
        torque    = clamp(kp e + ki integral + kd (target velocity - velocity), +- torque_limit)

    The derivative acts on measured velocities, not on differences of e, so a jump of the target
    gives no spike of torque. `forward` only reads; `step` remembers the integral from call to call.
    """

    kp: Tensor  # [J]
    ki: Tensor  # [J]
    kd: Tensor  # [J]
    integral: Tensor  # [B, J] [rad s]; no rows before the first step of an episode

    def __init__(self, config: PIDConfig) -> None:
        """Hold the gains of `config` as buffers."""
        super().__init__()
        self.config = config
        for name in ("kp", "ki", "kd"):
            self.register_buffer(name, torch.tensor(getattr(config, name)))
        self.register_buffer("integral", torch.zeros(0, len(config.kp)), persistent=False)

    @property
    def action_dimensions(self) -> int:
        """Number J of joints, a torque each."""
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
            angles: Measured joint angles [B, J] [rad].
            velocities: Measured joint velocities [B, J] [rad/s].
            targets: Wanted joint angles [B, J] [rad].
            integral: Integrated error before this update [B, J] [rad s].
            target_velocities: Wanted joint velocities [B, J] [rad/s]; at rest if left out.

        Returns:
            The torque [B, J] [N m] and the integrated error after this update [B, J] [rad s].

        Raises:
            ValueError: A tensor of the wrong shape, dtype or device, without rows, or not finite.
        """
        batch = {
            "angles": angles,
            "velocities": velocities,
            "targets": targets,
            "integral": integral,
        }
        if target_velocities is not None:
            batch["target_velocities"] = target_velocities
        self._check(batch)
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
        """Compute one update and remember the integral for the next one.

        Args:
            angles: Measured joint angles [B, J] [rad].
            velocities: Measured joint velocities [B, J] [rad/s].
            targets: Wanted joint angles [B, J] [rad].
            target_velocities: Wanted joint velocities [B, J] [rad/s]; at rest if left out.

        Returns:
            The torque [B, J] [N m].

        Raises:
            ValueError: As `forward`, and when the number of rows changes without a `reset`.
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
            states: Measured joint angles [rad], then velocities [rad/s] [B, 2 J].
            targets: Wanted joint angles [B, J] [rad].

        Returns:
            The torque [B, J] [N m], given in every row.

        Raises:
            ValueError: As `step`.
        """
        joints = len(self.kp)
        check_rows("states", states, columns=2 * joints, like=self.kp)
        torque = self.step(states[:, :joints], states[:, joints:], targets)
        return Command(torque, torch.ones(len(torque), dtype=torch.bool, device=torque.device))

    def reset(self) -> None:
        """Forget the integral: a new episode begins, with any number of rows."""
        self.integral = self.kp.new_zeros(0, len(self.kp))

    def _check(self, batch: dict[str, Tensor]) -> None:
        """Refuse anything but finite [B, J] tensors of the gains' dtype, equally many rows each."""
        for name, value in batch.items():
            check_rows(name, value, columns=len(self.kp), like=self.kp)
        rows = {name: len(value) for name, value in batch.items()}
        if len(set(rows.values())) > 1:
            raise ValueError(f"expected equally many rows (or a reset between), got {rows}")
