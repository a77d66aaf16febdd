"""Points that a caller gives as texts."""

import pytest

from pacnet.imitator.points import parse_points
from pacnet.schemas.points import Point, Points

STATE, SURROUNDINGS, GOAL = "observation.state", "observation.environment_state", "goal"
# Dimensions 0 to 3, 4 to 13, 14 to 16 of a percept.
FEATURES = {
    STATE: ("x", "y", "z", "open"),
    SURROUNDINGS: tuple(map(str, range(10))),
    GOAL: ("x", "y", "z"),
}
HAND = "hand=observation.state[0:3]"


def test_the_first_point_is_moved_and_the_others_are_landmarks():
    texts = [HAND, "object=observation.environment_state[0:3]", "goal=goal"]
    points = parse_points(texts, FEATURES)
    expected = (Point("object", (4, 5, 6)), Point("goal", (14, 15, 16)))
    assert points == Points(Point("hand", (0, 1, 2)), expected)
    turned = parse_points(texts[::-1], FEATURES)
    assert turned.names == ("goal", "object", "hand")


def test_a_mapping_says_the_same():
    pairs = {"hand": "observation.state[0:3]", "goal": "goal"}
    assert parse_points(pairs, FEATURES) == parse_points([HAND, "goal=goal"], FEATURES)
    spaced = [" hand = observation.state[0:3] ", "goal=goal"]
    assert parse_points(spaced, FEATURES) == parse_points(pairs, FEATURES)


def test_an_orientation_stands_behind_a_plus():
    text = "box=observation.environment_state[0:3]+observation.environment_state{}"
    for numbers, expected in (
        ("[3:7]", (7, 8, 9, 10)),
        ("[3:6]", (7, 8, 9)),
        ("[9:10]", (13,)),
        ("[9]", (13,)),
        ("[3:7]:xyzw", (10, 7, 8, 9)),
        ("[3:7]:wxyz", (7, 8, 9, 10)),
        ("[3:7] : xyzw", (10, 7, 8, 9)),
    ):
        points = parse_points([HAND, text.format(numbers)], FEATURES)
        assert points.landmarks == (Point("box", (4, 5, 6), expected),)
    flat = parse_points(["a=observation.state[0:2]", "b=goal[0:2] + goal[2:3]"], FEATURES)
    assert flat.landmarks == (Point("b", (14, 15), (16,)),)


@pytest.mark.parametrize(
    ("names", "order"),
    [
        (("qx", "qy", "qz", "qw"), (6, 3, 4, 5)),
        (("a.QW", "a.QX", "a.QY", "a.QZ"), (3, 4, 5, 6)),
        (("rot_z", "rot_y", "rot_x", "rot_w"), (6, 5, 4, 3)),
        (("q0", "q1", "q2", "q3"), (3, 4, 5, 6)),
        (("0", "1", "2", "3"), (3, 4, 5, 6)),
    ],
)
def test_w_comes_first_in_a_quaternion(names, order):
    features = {"hand": ("x", "y", "z"), "turn": names, "box": ("x", "y", "z")}
    points = parse_points(["hand=hand+turn", "box=box"], features)
    assert points.moved == Point("hand", (0, 1, 2), order)


def test_a_text_says_the_order_of_a_quaternion_before_its_names_do():
    features = {"hand": ("x", "y", "z"), "turn": ("qw", "qx", "qy", "qz"), "box": ("x", "y", "z")}
    points = parse_points(["hand=hand+turn:xyzw", "box=box"], features)
    assert points.moved == Point("hand", (0, 1, 2), (6, 3, 4, 5))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("goal", r"expected a point as NAME=FEATURE\[FIRST:END\], .*, got 'goal'"),
        ("=goal", r"expected a point as NAME=.* got '=goal'"),
        ("goal=", r"expected a point as NAME=.* got 'goal='"),
        (7, r"expected a point as NAME=.* got 7"),
        ("goal=goal[0-3]", r"expected 'goal' as NAME=.* got 'goal\[0-3\]'"),
        ("goal=goal[x]", r"expected 'goal' as NAME=.* got 'goal\[x\]'"),
        ("goal=goal+", r"expected 'goal' as NAME=.* got ''"),
        (
            "goal=gaol",
            r"of the features observation.state \[4\], observation.environment_state \[10\], "
            r"goal \[3\], got 'gaol'",
        ),
        ("goal=goal[0:4]", r"within the 3 dimensions goal\[0:3\], got 'goal\[0:4\]'"),
        ("goal=goal[3:3]", r"within the 3 dimensions goal\[0:3\], got 'goal\[3:3\]'"),
        ("goal=goal[2:0]", r"within the 3 dimensions goal\[0:3\], got 'goal\[2:0\]'"),
        ("goal=goal[0:1]", r"expected 'goal' as 2 or 3 dimensions, got 1: 'goal\[0:1\]'"),
        ("box=observation.environment_state[0:4]", r"'box' as 2 or 3 dimensions, got 4: "),
        ("goal=goal[0:2]", r"expected 'goal' as 3 dimensions, as 'hand', got 2"),
        ("goal=goal+goal", r"expected place and orientation of 'goal' apart, got 'goal\+goal'"),
        (
            "goal=goal+observation.environment_state[0:2]",
            r"orientation of 'goal', a point in 3 dimensions, of length 1 or 3 or 4, got 2: ",
        ),
        ("goal=goal+goal+goal", r"expected 'goal' as a place \+ an orientation, got"),
        ("goal=goal:xyzw", r"expected xyzw behind 4 dimensions of 'goal', got 'goal:xyzw'"),
        ("goal=goal+observation.environment_state[0:3]:xyzw", r"expected xyzw behind 4 dim"),
        ("goal=goal:xwyz", r"got 'goal:xwyz'"),
        ("goal=goal[3]", r"within the 3 dimensions goal\[0:3\], got 'goal\[3\]'"),
        ("hand=goal", r"expected points of different names, got 'hand' twice"),
        ("goal=observation.state[1:4]", r"different dimensions, got 'hand' and 'goal' of 'y'"),
    ],
)
def test_what_is_no_point_is_refused(text, message: str):
    with pytest.raises(ValueError, match=message):
        parse_points([HAND, text], FEATURES)


def test_unnamed_dimensions_are_told_by_their_feature():
    both = ["a=observation.environment_state[0:3]", "b=observation.environment_state[2:5]"]
    with pytest.raises(ValueError, match=r"'a' and 'b' of 'observation.environment_state\[2\]'"):
        parse_points(both, FEATURES)


def test_a_flat_point_has_an_angle_alone():
    with pytest.raises(ValueError, match=r"a point in 2 dimensions, of length 1, got 3"):
        parse_points(["hand=observation.state[0:2]+goal", "goal=goal[0:2]"], FEATURES)


def test_there_is_a_landmark():
    for texts, got in (([HAND], "hand"), ([], "none"), ({}, "none")):
        with pytest.raises(ValueError, match=f"and a landmark at least, each as .*, got {got}"):
            parse_points(texts, FEATURES)


@pytest.mark.parametrize("texts", [HAND, "none", 3, None])
def test_a_text_alone_is_no_list(texts):
    with pytest.raises(ValueError, match="expected points as a list of NAME="):
        parse_points(texts, FEATURES)
