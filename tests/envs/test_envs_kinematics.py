"""The body made from the CMU humanoid, its kinematics, and the plan of a drink."""

import numpy as np
import pytest

import envs  # noqa: F401  chooses the OpenGL backend before dm_control is imported
from envs.behaviours import REST_POSTURE
from envs.demonstrator import plan_demonstration, solve_postures
from envs.held_glass import HeldGlass, nearest_on_rim
from envs.humanoid import JOINTS
from envs.kinematics import RIGHT_ARM, BodyKinematics
from envs.scene import GLASS_HEIGHT, GLASS_PLACE, GLASS_REST_Z, GRIP_HEIGHT


@pytest.fixture(scope="module")
def body():
    return BodyKinematics()


def posture(**degrees):
    angles = np.zeros(len(JOINTS))
    for joint, value in degrees.items():
        angles[JOINTS.index(joint)] = np.deg2rad(value)
    return angles


def test_joints_are_eleven_within_reasonable_ranges(body):
    assert len(JOINTS) == 11
    assert body.joint_range.shape == (11, 2)
    assert (body.joint_range[:, 0] < REST_POSTURE).all()
    assert (body.joint_range[:, 1] > REST_POSTURE).all()


def test_bending_the_elbow_keeps_its_distance_to_the_wrist(body):
    """The forearm turns about the elbow, 0.2178 m (0.1815 m times 1.2) from the wrist."""
    angles = np.linspace(0, 2, 9)
    wrists = np.array([body.pose(posture(right_elbow=np.rad2deg(a))).wrist for a in angles])
    chords = np.linalg.norm(wrists - wrists[0], axis=1)
    assert chords == pytest.approx(2 * 0.2178432 * np.sin(angles / 2), abs=1e-6)


def test_the_neck_moves_the_mouth_and_not_the_hand(body):
    straight, bent = body.pose(posture()), body.pose(posture(neck_rx=20))
    assert np.array_equal(straight.wrist, bent.wrist)
    assert bent.mouth[2] < straight.mouth[2] - 0.02  # looks down
    assert straight.mouth[0] > 0.1  # in front of the pelvis


def test_the_left_arm_does_not_move_the_right_hand(body):
    assert np.array_equal(body.pose(posture()).grip, body.pose(posture(left_elbow=60)).grip)


def test_inverse_kinematics_finds_the_posture_of_a_pose(body):
    rng = np.random.default_rng(0)
    low, high = body.joint_range.T
    for _ in range(5):
        known = rng.uniform(low * 0.6, high * 0.6)
        target = body.pose(known).grip
        start = known + rng.normal(0, 0.15, 11)
        found = body.solve(start, lambda pose, target=target: pose.grip - target)
        assert np.linalg.norm(body.pose(found).grip - target) < 0.003
        others = [i for i in range(11) if i not in RIGHT_ARM]
        assert np.array_equal(found[others], start[others])
        assert (found[list(RIGHT_ARM)] >= low[list(RIGHT_ARM)]).all()
        assert (found[list(RIGHT_ARM)] <= high[list(RIGHT_ARM)]).all()


@pytest.mark.parametrize("seed", range(5))
def test_postures_meet_the_glass_and_the_mouth(body, seed):
    rng = np.random.default_rng(seed)
    place = np.array(GLASS_PLACE) + rng.uniform(-0.01, 0.01, 2)
    standing = np.array([*place, GLASS_REST_Z])
    postures = solve_postures(body, place, rng)
    grasp = body.pose(postures["grasp"])
    assert np.linalg.norm(grasp.grip - standing - (0, 0, GRIP_HEIGHT)) < 0.002
    held = HeldGlass.from_grasp(grasp, standing)
    for name, most in (("mouth", 0.01), ("drink", 0.01)):
        pose = body.pose(postures[name])
        axis = pose.hand @ held.axis
        rim = pose.grip + pose.hand @ held.centre + GLASS_HEIGHT / 2 * axis
        assert np.linalg.norm(nearest_on_rim(rim, axis, pose.mouth) - pose.mouth) < most
        assert axis[0] < -0.3  # tilted towards the face
    put = body.pose(postures["put"])
    assert np.linalg.norm(put.grip + put.hand @ held.centre - standing) < 0.005
    assert (put.hand @ held.axis)[2] > 0.999


def test_a_plan_is_decided_by_its_generator(body):
    first, second, other = (
        plan_demonstration(body, np.array(GLASS_PLACE), np.random.default_rng(seed))
        for seed in (1, 1, 2)
    )
    assert first.angles.tobytes() == second.angles.tobytes()
    assert not np.array_equal(first.angles[:100], other.angles[:100])


def test_a_plan_begins_and_ends_at_rest_within_the_joint_ranges(body):
    plan = plan_demonstration(body, np.array(GLASS_PLACE), np.random.default_rng(0))
    assert plan.angles.shape == (len(plan.phases), 11)
    assert np.array_equal(plan.angles[0], plan.angles[-1])
    assert np.abs(plan.angles[0] - REST_POSTURE).max() < 0.15
    assert (plan.angles >= body.joint_range[:, 0]).all()
    assert (plan.angles <= body.joint_range[:, 1]).all()
