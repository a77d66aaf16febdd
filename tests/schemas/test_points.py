"""Points of a percept: what they are made of, and what they are not."""

import json
from dataclasses import asdict, replace

import pytest

from pacnet.schemas.points import Point, Points

HAND = Point("hand", (0, 1, 2))
OBJECT = Point("object", (3, 4, 5), (6, 7, 8, 9))
GOAL = Point("goal", (12, 11, 10), (13,))


def test_points_say_which_dimensions_they_use():
    points = Points(HAND, (OBJECT, GOAL))
    assert points.dimensions == 3
    assert points.names == ("hand", "object", "goal")
    assert points.used == (0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 12, 11, 10, 13)
    assert [*points] == [HAND, OBJECT, GOAL]
    assert OBJECT.used == (3, 4, 5, 6, 7, 8, 9)
    flat = Points(Point("hand", (0, 1)), (Point("box", (2, 3), (4,)),))
    assert (flat.dimensions, flat.used) == (2, (0, 1, 2, 3, 4))


def test_points_survive_json():
    points = Points(HAND, (OBJECT, GOAL))
    assert Points.from_dict(json.loads(json.dumps(asdict(points)))) == points
    assert Points(HAND, [OBJECT]) == Points(HAND, (OBJECT,))
    assert hash(Point("hand", [0, 1, 2])) == hash(HAND)


@pytest.mark.parametrize("length", [0, 1, 4])
def test_a_place_has_two_or_three_coordinates(length: int):
    with pytest.raises(ValueError, match=r"expected Point\.place as 2 or 3 different dimensions"):
        Point("hand", tuple(range(length)))


@pytest.mark.parametrize("place", [(0, 0), (0, -1), (0, 1.0), (0, True), "01"])
def test_coordinates_are_different_indices(place):
    with pytest.raises(ValueError, match=r"expected Point\.place as 2 or 3 different dimensions"):
        Point("hand", place)


@pytest.mark.parametrize(
    ("place", "lengths"), [((10, 11), {0, 1}), ((10, 11, 12), {0, 1, 3, 4})], ids=["2-D", "3-D"]
)
def test_an_orientation_is_an_angle_a_rotation_vector_or_a_quaternion(place, lengths):
    for length in range(6):
        turn = tuple(range(length))
        if length in lengths:
            assert Point("box", place, turn).orientation == turn
        else:
            with pytest.raises(ValueError, match=f"dimensions of a point in {len(place)}, got"):
                Point("box", place, turn)


def test_no_dimension_is_used_twice():
    with pytest.raises(ValueError, match=r"Point\.orientation of other dimensions than \(0, 1\)"):
        Point("hand", (0, 1), (1,))
    with pytest.raises(ValueError, match=r"Point\.orientation as 0 or 1 or 3 or 4 different"):
        Point("hand", (0, 1, 2), (3, 4, 4))
    for other in (Point("goal", (2, 10, 11)), Point("goal", (10, 11, 12), (6,))):
        with pytest.raises(ValueError, match=r"Points\.landmarks with different dimensions"):
            Points(HAND, (OBJECT, other))


@pytest.mark.parametrize("name", ["", " ", 3, None])
def test_a_point_has_a_name(name):
    with pytest.raises(ValueError, match=r"expected Point\.name as a name"):
        Point(name, (0, 1))


def test_points_have_different_names():
    for landmarks in ((replace(OBJECT, name="hand"),), (OBJECT, replace(GOAL, name="object"))):
        with pytest.raises(ValueError, match=r"Points\.landmarks of different names"):
            Points(HAND, landmarks)


def test_all_places_have_as_many_coordinates():
    with pytest.raises(ValueError, match=r"with places of 3 dimensions, as of 'hand'"):
        Points(HAND, (OBJECT, Point("goal", (10, 11))))


def test_there_is_a_landmark():
    for landmarks in ((), (None,), ("goal",)):
        with pytest.raises(ValueError, match=r"expected Points\.landmarks as Points"):
            Points(HAND, landmarks)
    with pytest.raises(ValueError, match=r"expected Points\.moved as a Point"):
        Points(None, (OBJECT,))


@pytest.mark.parametrize(
    "fields",
    [
        None,
        [],
        {},
        {"moved": {"name": "hand", "place": [0, 1, 2]}},
        {"moved": None, "landmarks": []},
        {"moved": {"name": "hand", "place": 3}, "landmarks": [{"name": "a", "place": [3, 4, 5]}]},
        {"moved": {"name": "hand"}, "landmarks": [{"name": "a", "place": [3, 4, 5]}]},
        {"moved": asdict(HAND), "landmarks": [asdict(OBJECT)], "frames": 1},
        {"moved": asdict(HAND), "landmarks": [asdict(OBJECT) | {"colour": 1}]},
        {"moved": asdict(HAND), "landmarks": ["object"]},
    ],
)
def test_damaged_fields_are_refused(fields):
    with pytest.raises(ValueError, match="expected the fields of Points, got"):
        Points.from_dict(fields)
