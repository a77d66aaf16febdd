"""The humanoids' joints driven by MuJoCo's PID plugin, or by torques from `PIDController`.

Both bodies follow one demonstration. `python -m benchmarks.postural_control` prints the tracking
error and the speed of each drive, as medians of interleaved runs.
"""

import argparse
import itertools
import statistics
import time
from collections.abc import Callable
from typing import NamedTuple

import mujoco
import numpy as np
import torch

import envs  # noqa: F401  chooses the OpenGL backend before dm_control is imported
from envs import humanoid
from envs.demonstrator import plan_demonstration
from envs.humanoid import JOINTS
from envs.kinematics import BodyKinematics
from envs.physics import Physics
from envs.scene import CONTROL_TIMESTEP, GLASS_PLACE
from pacnet import PIDConfig, PIDController

# A drive takes the targets [2, 11] [rad] of the last and of this control step, and steps.
Drive = Callable[[np.ndarray, np.ndarray], None]


class Result(NamedTuple):
    """One run of a drive through the demonstration."""

    rms: float  # [degrees] over all joints and steps
    worst: float  # [degrees] RMS of the worst joint
    speed: float  # control steps per second


def plugin_drive(physics: Physics) -> Drive:
    """Return a drive by MuJoCo's PID, with new targets once per control step."""

    def drive(_: np.ndarray, targets: np.ndarray) -> None:
        physics.data.ctrl[:] = targets.ravel()
        physics.step(round(CONTROL_TIMESTEP / physics.timestep()))

    return drive


def torque_drive(
    physics: Physics, joint_damping: float | None, kd_per_kp: float, n_updates: int
) -> Drive:
    """Return a drive by `PIDController`, with its torques as external joint forces.

    Args:
        physics: The scene; its own actuators are switched off.
        joint_damping: Of every joint [N m s/rad], or None for the scene's.
        kd_per_kp: Derivative gain over proportional gain [s].
        n_updates: Updates of the torques per control step.
    """
    physics.model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_ACTUATION
    dofs = physics.velocity_at
    if joint_damping is not None:
        physics.model.dof_damping[dofs] = joint_damping
    controller = make_controller(kd_per_kp, CONTROL_TIMESTEP / n_updates)
    load = torch.tensor(physics.data.qfrc_bias[dofs], dtype=torch.float32)
    controller.integral = load / controller.ki  # start with an integral that holds the arms up
    n_substeps = round(CONTROL_TIMESTEP / n_updates / physics.timestep())

    def drive(before: np.ndarray, targets: np.ndarray) -> None:
        wanted = torch.tensor(targets, dtype=torch.float32)
        wanted_velocity = torch.tensor((targets - before) / CONTROL_TIMESTEP, dtype=torch.float32)
        for _ in range(n_updates):
            angles = torch.tensor(physics.data.qpos[physics.angle_at], dtype=torch.float32)
            velocities = torch.tensor(physics.data.qvel[dofs], dtype=torch.float32)
            torque = controller.step(angles, velocities, wanted, wanted_velocity)
            physics.data.qfrc_applied[dofs] = torque.numpy()
            physics.step(n_substeps)

    return drive


def make_controller(kd_per_kp: float, dt: float) -> PIDController:
    """Return the library's controller with the scene's proportional and integral gains."""
    kp = [humanoid.stiffness(joint) for joint in JOINTS]
    ki = [humanoid.KI_PER_KP * gain for gain in kp]  # [N m/(rad s)]
    return PIDController(
        PIDConfig(
            kp=tuple(kp),
            ki=tuple(ki),
            kd=tuple(kd_per_kp * gain for gain in kp),
            dt=dt,
            # One limit for all joints: equal to the plugin's at the shoulders, lower elsewhere.
            integral_limit=humanoid.MAX_INTEGRAL_TORQUE / max(ki),  # [rad s]
            torque_limit=humanoid.MAX_TORQUE,
        )
    )


DRIVES: dict[str, Callable[[Physics], Drive]] = {
    "mujoco.pid, fed with targets every 20 ms": plugin_drive,
    "PIDController every 4 ms, same damping in the joints": lambda p: torque_drive(p, None, 0, 5),
    "PIDController every 4 ms, derivative term instead": lambda p: torque_drive(
        p, 1.0, humanoid.DAMPING_PER_KP, 5
    ),
    "PIDController every 20 ms, same damping in the joints": lambda p: torque_drive(p, None, 0, 1),
}


def measure(make_drive: Callable[[Physics], Drive], plan: np.ndarray) -> Result:
    """Run one drive through a plan `[T, 11]` [rad] for both bodies."""
    physics = Physics.build()
    targets = np.stack([plan, plan], axis=1)  # [T, 2, 11]
    physics.begin(targets[0], np.array(GLASS_PLACE))
    drive = make_drive(physics)
    errors, start = [], time.perf_counter()
    for before, wanted in itertools.pairwise(targets):
        drive(before, wanted)
        errors.append(physics.data.qpos[physics.angle_at] - wanted)
    speed = len(errors) / (time.perf_counter() - start)
    mean_square = np.square(np.rad2deg(errors)).mean(axis=(0, 1))
    return Result(float(np.sqrt(mean_square.mean())), float(np.sqrt(mean_square.max())), speed)


def main() -> None:
    """Measure and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--repeats", type=int, default=5, help="runs of each drive")
    parser.add_argument("--seed", type=int, default=0, help="seed of the demonstration")
    arguments = parser.parse_args()
    torch.set_num_threads(1)
    rng = np.random.default_rng(arguments.seed)
    plan = plan_demonstration(BodyKinematics(), np.array(GLASS_PLACE), rng).angles
    results: dict[str, list[Result]] = {name: [] for name in DRIVES}
    for _ in range(arguments.repeats):
        for name, make_drive in DRIVES.items():
            results[name].append(measure(make_drive, plan))
    print(f"{'drive':<56}{'RMS [deg]':>10}{'worst joint':>13}{'steps/s':>9}")
    for name, runs in results.items():
        rms, worst, speed = (statistics.median(column) for column in zip(*runs, strict=True))
        print(f"{name:<56}{rms:>10.2f}{worst:>13.2f}{speed:>9.0f}")


if __name__ == "__main__":
    main()
