"""Points that are found by the names of a percept's dimensions."""

import pytest

from pacnet.imitator.point_names import find_points, unordered_quaternions
from pacnet.schemas.points import Point, Points

STATE, SURROUNDINGS = "observation.state", "observation.environment_state"
HAND, BOX = Point("hand", (0, 1, 2)), Point("box", (3, 4, 5))


def found(state: str, surroundings: str = "", **others: str) -> Points | None:
    """The points of a percept whose dimensions have these names, parted by blanks."""
    texts = {STATE: state, SURROUNDINGS: surroundings, **others}
    features = {name: tuple(text.split()) for name, text in texts.items() if text}
    return find_points(features, (STATE,)).points


def axes(*names: str, end: str = "xyz") -> str:
    return " ".join(f"{name}.{axis}" for name in names for axis in end)


@pytest.mark.parametrize(
    ("state", "surroundings"),
    [
        ("hand.x hand.y hand.z", "box.x box.y box.z"),
        ("hand_x hand_y hand_z", "box_X box_Y box_Z"),
        ("hand_pos.x hand_pos.y hand_pos.z", "box.position.x box.position.y box.position.z"),
        ("x y z", "box_x box_y box_z"),
    ],
)
def test_dimensions_called_like_coordinates_are_points(state: str, surroundings: str):
    assert found(state, surroundings) == Points(HAND, (BOX,))


def test_points_are_named_for_a_feature_where_they_are_all_of_it():
    assert found("x y", "x y") == Points(Point("hand", (0, 1)), (Point("object", (2, 3)),))
    features = {STATE: ("x", "y"), "observation.ball_pos": ("x", "y"), "goal": ("y", "x")}
    landmarks = (Point("ball", (2, 3)), Point("goal", (5, 4)))
    assert find_points(features, (STATE,)).points == Points(Point("hand", (0, 1)), landmarks)


@pytest.mark.parametrize("names", [("0", "1", "2"), ("ee_0", "ee_1", "ee_2")])
@pytest.mark.parametrize("end", ["_pos", ".pos", "_position", "_xyz"])
def test_a_whole_feature_called_a_place_is_a_point(end: str, names: tuple[str, ...]):
    features = {f"observation.ee{end}": names, f"observation.box{end}": ("0", "1", "2")}
    points = find_points(features, (f"observation.ee{end}",)).points
    assert points == Points(Point("ee", (0, 1, 2)), (BOX,))


@pytest.mark.parametrize(
    ("feature", "names"),
    [
        ("observation.joint_pos", ("0", "1", "2")),
        ("observation.arm_pos", ("joint_0", "joint_1", "joint_2")),
        ("observation.arm_pos", ("shoulder", "elbow", "wrist")),
        ("observation.arm_pos", ("0", "1", "2", "3")),
        ("observation.qpos", ("0", "1", "2")),
        ("observation.pos", ("0", "1", "2")),
        ("observation.hand_vel", ("0", "1", "2")),
    ],
)
def test_parts_of_an_arm_are_no_coordinates(feature: str, names: tuple[str, ...]):
    features = {feature: names, SURROUNDINGS: ("box.x", "box.y", "box.z")}
    assert find_points(features, (feature,)).points is None


@pytest.mark.parametrize(
    "names",
    [
        "hand.vx hand.vy hand.vz",
        "hand.qx hand.qy hand.qz hand.qw",
        "hand.rx hand.ry hand.rz",
        "hand.vel.x hand.vel.y hand.vel.z",
        "hand_velocity_x hand_velocity_y hand_velocity_z",
        "hand.rot.x hand.rot.y hand.rot.z",
        "hand.quat.x hand.quat.y hand.quat.z hand.quat.w",
        "delta_x delta_y delta_z",
        "tip.x tip.z",
        "motor_0 motor_1",
        "0 1 2",
    ],
)
def test_speeds_and_rotations_are_no_points(names: str):
    assert found(names, axes("box", "goal")) is None
    points = found(f"{names} {axes('hand')}", axes("box"))  # beside a place they do not matter
    assert points is not None
    first = len(names.split())
    assert points.moved.place == (first, first + 1, first + 2)


@pytest.mark.parametrize("name", ["eef_to_cube_", "hand_to_object.", "cube_from_hand.pos."])
def test_differences_of_places_are_no_points(name: str):
    between = " ".join(f"{name}{axis}" for axis in "xyz")
    assert found(axes("hand"), between) is None
    assert found(axes("hand"), f"{axes('box')} {between}") == Points(HAND, (BOX,))
    assert found(axes("hand"), axes("tomato")) is not None  # which only begins like a "to"
    feature = f"observation.{name.rstrip('._').removesuffix('.pos')}_pos"
    features = {STATE: ("hand.x", "hand.y", "hand.z"), feature: ("0", "1", "2")}
    assert find_points(features, (STATE,)).points is None


def test_bare_coordinates_of_a_speed_are_no_point():
    features = {STATE: ("x", "y"), "observation.velocity": ("x", "y")}
    assert find_points(features, (STATE,)).points is None


@pytest.mark.parametrize(
    ("beside", "orientation"),
    [
        ("box.qx box.qy box.qz box.qw", (9, 6, 7, 8)),
        ("box.qw box.qx box.qy box.qz", (6, 7, 8, 9)),
        ("box_quat.qx box_quat.qy box_quat.qz box_quat.qw", (9, 6, 7, 8)),
        ("box.rx box.ry box.rz", (6, 7, 8)),
        ("box_quat_w box_quat_x box_quat_y box_quat_z", (6, 7, 8, 9)),
        ("box.orientation.x box.orientation.y box.orientation.z box.orientation.w", (9, 6, 7, 8)),
        ("box.rotation.x box.rotation.y box.rotation.z", ()),
        ("box.angle", (6,)),
        ("box.yaw", (6,)),
        ("box.theta", (6,)),
        ("box.roll box.pitch box.yaw", ()),
        ("box.qx box.qy", ()),
        ("lid.yaw", ()),
    ],
)
def test_an_orientation_stands_beside_a_place(beside: str, orientation: tuple[int, ...]):
    points = found(axes("hand"), f"{axes('box')} {beside}")
    assert points == Points(HAND, (Point("box", (3, 4, 5), orientation),))


@pytest.mark.parametrize(
    ("names", "orientation"),
    [
        (("qw", "qx", "qy", "qz"), (6, 7, 8, 9)),
        (("box_x", "box_y", "box_z", "box_w"), (9, 6, 7, 8)),
        (("0", "1", "2", "3"), ()),
    ],
)
@pytest.mark.parametrize("end", ["quat", "orientation"])
@pytest.mark.parametrize("place", [("0", "1", "2"), ("x", "y", "z")])
def test_a_quaternion_may_be_a_feature_beside_a_place(names, orientation, end: str, place):
    """It is one if its names say in which order it is, else it is told of."""
    features = {
        STATE: ("hand.x", "hand.y", "hand.z"),
        "observation.box_pos": place,
        f"observation.box_{end}": names,
    }
    points = find_points(features, (STATE,)).points
    assert points == Points(HAND, (Point("box", (3, 4, 5), orientation),))
    left_out = {} if orientation else {"box": f"observation.box_{end}"}
    assert unordered_quaternions(features, points) == left_out


def test_a_flat_point_is_turned_by_an_angle():
    flat = "box.x box.y box.rx box.ry box.rz box.theta"
    points = found("hand.x hand.y", flat)
    assert points == Points(Point("hand", (0, 1)), (Point("box", (2, 3), (7,)),))


def test_the_only_point_of_the_state_is_moved():
    points = found(axes("ball"), axes("hand", "goal"))
    assert points is not None
    assert points.names == ("ball", "hand", "goal")


@pytest.mark.parametrize(
    "name",
    ["left_hand", "gripper", "ee", "robot0_eef", "end_effector", "tcp", "tool", "Wrist", "agent"],
)
def test_of_several_in_the_state_the_hand_is_moved(name: str):
    points = found(axes("box", name), axes("goal"))
    assert points is not None
    assert points.names == (name, "box", "goal")


def test_what_a_hand_aims_at_is_no_hand():
    points = found(axes("target_hand", "hand", "handle"))
    assert points is not None
    assert points.names == ("hand", "target_hand", "handle")


def test_points_of_other_dimensions_are_left_out():
    points = found(f"{axes('hand')} screen.x screen.y", f"{axes('box')} mouse.x mouse.z")
    assert points == Points(HAND, (Point("box", (5, 6, 7)),))


def test_equal_names_of_two_features_get_the_feature_in_front():
    features = {STATE: ("hand.x", "hand.y"), "a": ("box.x", "box.y"), "b": ("box.x", "box.y")}
    points = find_points(features, (STATE,)).points
    assert points is not None
    assert points.names == ("hand", "a.box", "b.box")
    features = {STATE: ("hand.x", "hand.y"), "goal": ("goal.x", "goal.y", "x", "y")}
    points = find_points(features, (STATE,)).points  # the second is all of the feature
    assert points is not None
    assert points.names == ("hand", "goal.goal.2", "goal.goal.4")


def test_blank_names_are_no_names():
    features = {STATE: ("\t.x", " .y"), "observation.": ("\n_x", "y")}
    points = find_points(features, (STATE,)).points
    assert points == Points(Point("hand", (0, 1)), (Point("observation.", (2, 3)),))
    features = {STATE: ("x", "y"), "\t": ("x", "y")}
    points = find_points(features, (STATE,)).points
    assert points == Points(Point("hand", (0, 1)), (Point("point", (2, 3)),))


@pytest.mark.parametrize(
    ("state", "surroundings", "reason"),
    [
        ("elbow.pos elbow.vel", "", "no dimensions are called like coordinates"),
        ("elbow.pos", axes("glass"), "the robot's state has no point, such as hand.x"),
        (axes("hand"), "glass.x", "hand alone: no landmark in as many dimensions"),
        (axes("hand"), "glass.x glass.y", "hand alone: no landmark in as many dimensions"),
        (axes("a", "b"), "", "a, b: say with --points which the robot's actions move"),
        (axes("a", "left_hand", "right_hand"), "", "left_hand, right_hand: say with --points"),
    ],
)
def test_where_there_are_none_a_reason_is_given(state: str, surroundings: str, reason: str):
    features = {STATE: tuple(state.split())}
    if surroundings:
        features[SURROUNDINGS] = tuple(surroundings.split())
    points, text = find_points(features, (STATE,))
    assert points is None
    assert text.startswith(reason)


def test_without_a_state_nothing_is_moved():
    features = {SURROUNDINGS: tuple(axes("hand", "box").split())}
    assert find_points(features, ()).points is None


def test_where_there_are_some_no_reason_is_given():
    features = {STATE: ("hand.x", "hand.y"), "goal": ("x", "y")}
    assert find_points(features, (STATE,)).reason == ""
    assert find_points({}, ()).points is None


def test_the_scenes_of_the_experiments_have_none():
    """A humanoid's joint angles beside its glass, and a robot's sensors."""
    pytest.importorskip("dm_control")
    from train.postural.learning import FEATURES as DRINKING
    from train.walls.learning import FEATURES as WALLS

    for names in (DRINKING, WALLS):
        features = {feature: parts for feature, parts in names.items() if feature != "action"}
        points, reason = find_points(features, (STATE,))
        assert points is None
        assert reason.startswith("the robot's state has no point" if names is DRINKING else "no d")
