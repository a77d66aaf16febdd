"""The substeps of a control step, without Python between them.

dm_control's `Physics.step` does the same, but takes twentieths of a control step to look up names
and to compare warnings.
"""

from dm_control.mujoco import Physics
from dm_control.rl.control import PhysicsError
from mujoco import mj_step, mj_step1, mj_step2  # pyright: ignore[reportAttributeAccessIssue]


def run_substeps(physics: Physics, n_substeps: int) -> None:
    """Advances a simulation, after which positions and sensors are those of its new state.

    Args:
        physics: whose positions and sensors are those of its state.
        n_substeps: at least 2.

    Raises:
        PhysicsError: MuJoCo warned, for example that the simulation diverged.
    """
    model, data = physics.model.ptr, physics.data.ptr
    warnings = data.warning.number  # how often it has warned of what, a view
    before = warnings.tobytes()
    mj_step2(model, data)  # the rest of a step whose first half ran when the last one ended
    mj_step(model, data, n_substeps - 1)
    mj_step1(model, data)
    if warnings.tobytes() != before:
        raise PhysicsError(f"MuJoCo warned; its counts of `mjtWarning` are now {warnings}")
