"""Which numbers are the angles of a body is told by the joints' names; the rest is checked."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from arms import JOINTS, LIMITS, ArmWorld, body, shown

from pacnet.datasets.demonstrations import Demonstrations
from pacnet.imitator import Imitator
from pacnet.imitator.auto_config import choose_settings
from pacnet.imitator.body import body_config
from pacnet.imitator.config import ImitatorConfig
from pacnet.imitator.point_names import find_landmarks
from pacnet.imitator.points import PointsChoice, parse_landmarks
from pacnet.schemas.frames import FramesConfig
from pacnet.schemas.points import Point

STATE, AROUND = "observation.state", "observation.environment_state"
GRIPPER = 4  # of a percept; the object's place and quaternion follow


@pytest.fixture(scope="module")
def demonstrations() -> Demonstrations:
    return shown(ArmWorld())


def renamed(demonstrations: Demonstrations, **names: tuple[str, ...]) -> Demonstrations:
    features = {"state": STATE, "around": AROUND, "action": "action"}
    changed = {features[key]: value for key, value in names.items()}
    return replace(demonstrations, names={**demonstrations.names, **changed})


def with_state(demonstrations: Demonstrations, state: torch.Tensor, names: tuple[str, ...]):
    episodes = (replace(demonstrations.episodes[0], state=state),)
    return renamed(replace(demonstrations, episodes=episodes), state=names)


def settings_of(demonstrations: Demonstrations, points: PointsChoice) -> ImitatorConfig:
    return choose_settings(
        demonstrations, points, None, targets="action", lead=1, budget=None, body=body()
    )


def frames_of(demonstrations: Demonstrations, points: PointsChoice = "auto") -> FramesConfig:
    config = settings_of(demonstrations, points)
    assert config.frames is not None
    return config.frames


@pytest.mark.parametrize("end", ["", ".pos", ".position", ".angle", ".q"])
def test_angles_are_found_by_the_names_of_joints(demonstrations: Demonstrations, end: str):
    """In the order of the body's joints, wherever they are."""
    order = ("wrist", "base", "elbow", "shoulder")
    state = tuple(f"{joint}{end}" for joint in order)
    found = body_config(
        body(),
        renamed(demonstrations, state=(*state, "gripper"), action=("grip", *state)),
    )
    assert found.angles == (1, 3, 2, 0)
    assert found.commands == (2, 4, 3, 1)
    assert found.model.joints == JOINTS


@pytest.mark.parametrize("where", ["state", "action"])
def test_a_joint_without_an_angle_is_refused(demonstrations: Demonstrations, where: str):
    names = {"state": ("base", "shoulder", "elbow.speed", "wrist", "gripper")}
    names["action"] = ("base", "shoulder", "wrist_elbow", "wrist", "grip")
    wanted = "percepts" if where == "state" else "actions"
    with pytest.raises(ValueError, match=f"expected {wanted} with an angle of each.*none of 'elb"):
        body_config(body(), renamed(demonstrations, **{where: names[where]}))


def test_a_joint_with_two_angles_is_refused(demonstrations: Demonstrations):
    names = ("base", "shoulder", "elbow", "wrist", "elbow.pos")
    with pytest.raises(ValueError, match="got 2 of 'elbow' among"):
        body_config(body(), renamed(demonstrations, state=names))


def test_angles_in_degrees_are_refused(demonstrations: Demonstrations):
    one = demonstrations.episodes[0]
    degrees = one.state.clone()
    degrees[:, :4] = torch.rad2deg(degrees[:, :4])
    changed = with_state(demonstrations, degrees, demonstrations.names[STATE])
    with pytest.raises(ValueError, match=r"expected the angle 'base' .* -2\.80 to 2\.80 rad, got"):
        Imitator.from_demonstrations(changed, body=body())


def test_actions_that_are_changes_of_angles_are_refused(demonstrations: Demonstrations):
    (one,) = demonstrations
    changes = one.action.clone()
    changes[:, :4] -= one.state[:, :4]
    wrong = replace(demonstrations, episodes=(replace(one, action=changes),))
    with pytest.raises(ValueError, match="expected actions that are the angles to go to, got"):
        frames_of(wrong)


@pytest.mark.parametrize(("beyond", "valid"), [(0.9, True), (1.1, False)])
def test_angles_may_be_a_little_beyond_those_of_the_body(
    demonstrations: Demonstrations, beyond: float, valid: bool
):
    """By as much as they range, which is 5.6."""
    state = demonstrations.episodes[0].state.clone()
    state[7, 1] = -LIMITS - beyond * 2 * LIMITS
    changed = with_state(demonstrations, state, demonstrations.names[STATE])
    if valid:
        body_config(body(), changed)
    else:
        with pytest.raises(ValueError, match="expected the angle 'shoulder' of the body within"):
            body_config(body(), changed)


def test_rounding_of_an_angle_that_was_never_moved_is_no_matter(demonstrations: Demonstrations):
    """A gripper that kept still while the body was learned; 0.1 is another number in float32."""
    angles = np.random.default_rng(0).uniform(-1, 1, (40, 2))
    angles[:, 1] = 0.1
    places = np.stack([np.cos(angles[:, 0]), np.sin(angles[:, 0]), 0 * angles[:, 0]], axis=1)
    half = angles[:, 0] / 2
    turns = np.stack([np.cos(half), 0 * half, 0 * half, np.sin(half)], axis=1)
    arm, _ = type(body()).fitted(("base", "gripper"), angles, places, turns)
    state = demonstrations.episodes[0].state.clone()
    state[:, GRIPPER] = 0.1
    changed = with_state(demonstrations, state, demonstrations.names[STATE])
    assert body_config(arm, renamed(changed, action=(*JOINTS, "gripper"))).angles == (0, GRIPPER)


def test_a_gripper_in_the_state_is_waited_for_and_velocities_of_joints_are_not(
    demonstrations: Demonstrations,
):
    assert frames_of(demonstrations).others == (GRIPPER,)
    state = demonstrations.episodes[0].state
    speeds = torch.diff(state[:, :4], dim=0, prepend=state[:1, :4])
    names = (*demonstrations.names[STATE], *(f"{joint}.vel" for joint in JOINTS))
    frames = frames_of(with_state(demonstrations, torch.cat([state, speeds], dim=1), names))
    assert frames.others == (GRIPPER,)
    assert frames.points.landmarks[0].place == (9, 10, 11)


def test_the_hand_and_former_places_follow_the_percept(demonstrations: Demonstrations):
    """Of twelve numbers: five of the state, the object's seven."""
    config = settings_of(demonstrations, "auto")
    frames = config.frames
    assert frames is not None
    assert frames.points.moved == Point("hand", (12, 13, 14), (15, 16, 17, 18))
    assert frames.points.landmarks == (
        Point("object", (5, 6, 7), (8, 9, 10, 11)),
        Point("object's place", (19, 20, 21)),
    )
    assert frames.forward_model is None
    assert config.point_dimensions[12:15] == ("hand.x", "hand.y", "hand.z")
    assert config.point_dimensions[19:] == tuple(f"object's place.{axis}" for axis in "xyz")
    assert config.percept_names == config.point_dimensions[:12]


@pytest.mark.parametrize(
    ("points", "orientation"),
    [
        ([f"thing={AROUND}[0:3]"], ()),
        ([f"thing={AROUND}[0:3]+{AROUND}[3:7]"], (8, 9, 10, 11)),
        ({"thing": f"{AROUND}[0:3]"}, ()),
    ],
)
def test_landmarks_may_be_given(demonstrations: Demonstrations, points, orientation):
    landmark = frames_of(demonstrations, points).points.landmarks[0]
    assert landmark == Point("thing", (5, 6, 7), orientation)


def test_without_a_landmark_a_body_is_of_no_use(demonstrations: Demonstrations):
    nameless = renamed(demonstrations, around=tuple("0123456"))
    for changed, points in ((nameless, "auto"), (demonstrations, None)):
        with pytest.raises(ValueError, match="expected a landmark beside"):
            frames_of(changed, points)
    with pytest.raises(ValueError, match=r"expected landmarks .* got none"):
        frames_of(demonstrations, [])
    given = frames_of(demonstrations).points
    with pytest.raises(ValueError, match="expected landmarks as texts with a body, got Points"):
        frames_of(demonstrations, given)


def test_a_body_is_used_with_targets_that_are_actions(demonstrations: Demonstrations):
    wanted = "expected a body with targets of 'action', got targets of 'state'"
    with pytest.raises(ValueError, match=wanted):
        Imitator.from_demonstrations(demonstrations, "state", points="auto", body=body())


FEATURES = {STATE: ("elbow.pos", "tip.x", "tip.y"), AROUND: ("cup.x", "cup.y", "cup.z", "cup.rx",
            "cup.ry", "cup.rz", "ball.x", "ball.y")}  # fmt: skip


def test_landmarks_are_found_in_space_only():
    assert find_landmarks(FEATURES) == (Point("cup", (3, 4, 5), (6, 7, 8)),)
    assert find_landmarks({STATE: ("elbow.pos",)}) == ()


def test_landmarks_in_a_plane_are_refused():
    assert parse_landmarks([f"cup={AROUND}[0:3]"], FEATURES) == (Point("cup", (3, 4, 5)),)
    with pytest.raises(ValueError, match=r"expected landmarks of 3 dimensions .* got ball"):
        parse_landmarks([f"ball={AROUND}[6:8]"], FEATURES)
    with pytest.raises(ValueError, match="expected 'cup' to be of the features"):
        parse_landmarks(["cup=nowhere"], FEATURES)
