"""The substeps of a control step, without Python between them.

dm_control's `Physics.step` does the same, but spends about 5 % of a control step on looking up
names and comparing warnings.
"""

from dm_control.mujoco import Physics
from dm_control.rl.control import PhysicsError
from mujoco import mj_step, mj_step1, mj_step2  # pyright: ignore[reportAttributeAccessIssue]


def run_substeps(physics: Physics, n_substeps: int) -> None:
    """Advance a simulation; afterwards positions and sensors match the new state.

    Args:
        physics: With positions and sensors that match its state.
        n_substeps: At least 2.

    Raises:
        PhysicsError: MuJoCo warned, for example that the simulation diverged.
    """
    model, data = physics.model.ptr, physics.data.ptr
    warnings = data.warning.number  # counts of each kind of warning, a view
    before = warnings.tobytes()
    mj_step2(model, data)  # second half of a step whose first half ran at the end of the last call
    mj_step(model, data, n_substeps - 1)
    mj_step1(model, data)
    if warnings.tobytes() != before:
        raise PhysicsError(f"MuJoCo warned; its counts of `mjtWarning` are now {warnings}")
