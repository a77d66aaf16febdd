"""What a hand carries in a segment, and how it holds that on average."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pacnet.attention.cutting import Size
from pacnet.forward_models.config import AffineForwardModelConfig, KinematicModelConfig
from pacnet.schemas.body import BodyConfig
from pacnet.schemas.frames import FramesConfig
from pacnet.schemas.holding import Held, held_in, mean_turn
from pacnet.schemas.points import Point, Points
from pacnet.schemas.scene import Scene

CUP, STONE = 0, 1  # the cup's orientation is perceived, the stone's is not
CONFIG = FramesConfig(
    Points(
        Point("hand", (0, 1, 2), (3, 4, 5, 6)),
        (Point("cup", (7, 8, 9), (10, 11, 12)), Point("stone", (13, 14, 15))),
    ),
    Size(1.0, 0.01),
    ((1.0, 1.0),) * 3,
    (),
    (),
    None,
    BodyConfig(KinematicModelConfig(("elbow",), (0,)), (16,), (0,)),
)
GRIP, GRIP_TURN = np.array([0.02, -0.01, 0.05]), Rotation.from_rotvec([0.4, 0.1, -0.2])
FRAMES = 40


def wxyz(turn: Rotation) -> np.ndarray:
    return np.roll(turn.as_quat(), 1, axis=-1)


def rotation(turn: np.ndarray) -> Rotation:
    return Rotation.from_quat(np.roll(turn, -1, axis=-1))


def carrying(of: int, seed: int = 0, seen: Rotation | None = None) -> Scene:
    """A hand that goes and turns anyhow, and holds a landmark; of its turn another one is seen."""
    rng = np.random.default_rng(seed)
    places, turns = np.zeros((FRAMES, 3, 3)), np.tile([1.0, 0, 0, 0], (FRAMES, 3, 1))
    hand = Rotation.from_rotvec(rng.uniform(-1, 1, (FRAMES, 3)))
    places[:, 0], turns[:, 0] = rng.uniform(-1, 1, (FRAMES, 3)), wxyz(hand)
    places[:, 1 + of] = places[:, 0] + hand.apply(GRIP)
    if of == CUP:
        turns[:, 1] = wxyz(hand * GRIP_TURN if seen is None else seen)
    return Scene(places, turns)


def held(scene: Scene, moves: np.ndarray, config: FramesConfig = CONFIG) -> Held:
    """Of one segment."""
    return held_in(scene, moves, np.array([0]), np.array([len(moves)]), config)


def carried(of: int, frames: slice = slice(None)) -> np.ndarray:
    moves = np.zeros((FRAMES, 2), bool)
    moves[frames, of] = True
    return moves


def test_what_is_carried_is_held_somewhere_in_the_hand():
    found = held(carrying(CUP), carried(CUP))
    assert found.moved.tolist() == [1 + CUP]
    np.testing.assert_allclose(found.place, [GRIP], atol=1e-12)
    assert (rotation(found.turn[0]).inv() * GRIP_TURN).magnitude() < 1e-9
    assert found.about_axis.tolist() == [False]


def test_what_has_no_orientation_turns_with_the_hand():
    """Else it would seem to turn against the hand, which never turns it."""
    found = held(carrying(STONE), carried(STONE))
    assert found.moved.tolist() == [1 + STONE]
    np.testing.assert_allclose(found.place, [GRIP], atol=1e-12)
    assert found.turn.tolist() == [[1, 0, 0, 0]]
    assert found.about_axis.tolist() == [False]


def test_only_frames_in_which_it_is_carried_count():
    scene = carrying(CUP)
    scene.places[:15, 1] += 0.3
    found = held(scene, carried(CUP, slice(15, None)))
    np.testing.assert_allclose(found.place, [GRIP], atol=1e-12)


@pytest.mark.parametrize(("frames", "moved"), [(FRAMES // 2, 0), (FRAMES // 2 + 1, 1 + CUP)])
def test_a_segment_is_about_what_is_carried_in_most_of_it(frames: int, moved: int):
    found = held(carrying(CUP), carried(CUP, slice(-frames, None)))
    assert found.moved.tolist() == [moved]
    if not moved:
        assert found.place.tolist() == [[0, 0, 0]]
        assert found.turn.tolist() == [[1, 0, 0, 0]]


def test_segments_are_told_apart():
    scene, moves = carrying(CUP), carried(CUP, slice(10, 30))
    first, end = np.array([0, 10, 30]), np.array([10, 30, 40])
    assert held_in(scene, moves, first, end, CONFIG).moved.tolist() == [0, 1, 0]


def test_without_a_body_nothing_is_held():
    model = AffineForwardModelConfig(6, 1, 1, (-1,))
    config = replace(CONFIG, body=None, forward_model=model)
    assert held(carrying(CUP), carried(CUP), config).moved.tolist() == [0]


def test_a_mean_turn_is_the_one_in_the_middle():
    """Of 10° and 30° about one axis it is 20°, whatever the signs of the quaternions."""
    axis = np.array([1.0, 2.0, -2.0]) / 3
    turns = wxyz(Rotation.from_rotvec(np.deg2rad([10, 30])[:, None] * axis))
    expected = Rotation.from_rotvec(np.deg2rad(20) * axis)
    for sign in (1.0, -1.0):
        mean = mean_turn(turns * [[1.0], [sign]])
        assert np.linalg.norm(mean) == pytest.approx(1)
        assert (rotation(mean).inv() * expected).magnitude() < 1e-9


def test_a_mean_of_many_turns_is_that_of_another_library():
    turns = GRIP_TURN * Rotation.from_rotvec(np.random.default_rng(0).normal(0, 0.3, (50, 3)))
    assert (rotation(mean_turn(wxyz(turns))).inv() * turns.mean()).magnitude() < 1e-9


def swung(tilt: float, spin: float, seed: int = 0) -> Rotation:
    """A cup upright, but for deviations of its axis and of its turn about it [rad]."""
    rng = np.random.default_rng(seed)
    about = Rotation.from_rotvec(rng.normal(0, spin, FRAMES)[:, None] * [0, 0, 1.0])
    return Rotation.from_rotvec(rng.normal(0, tilt, (FRAMES, 3)) * [1, 1, 0]) * about


@pytest.mark.parametrize(
    ("tilt", "spin", "expected"),
    [
        (0.0, 0.5, True),  # its turns about its axis are not known
        (0.02, 0.5, True),
        (0.4, 0.4, False),  # neither is how its axis points
        (0.0, 0.03, False),  # noise: all is known
        (0.03, 0.03, False),
    ],
)
def test_an_object_whose_turns_about_its_axis_are_not_known(tilt: float, spin: float, expected):
    """Of a hand that does not turn, so that how the cup turns in it is how it is turned."""
    scene = carrying(CUP, seen=swung(tilt, spin))
    scene.turns[:, 0] = (1, 0, 0, 0)
    assert held(scene, carried(CUP)).about_axis.tolist() == [expected]


def test_an_axis_keeps_still_in_the_hand_though_only_its_tilt_is_perceived():
    """As a tilt vector tells of it: the shortest turn that takes the third axis there."""
    rng = np.random.default_rng(4)
    hand = Rotation.from_euler("ZY", rng.uniform(-0.9, 0.9, (FRAMES, 2)))
    axis = (hand * GRIP_TURN).apply([0, 0, 1])
    across = np.cross([0, 0, 1], axis)
    sine = np.linalg.norm(across, axis=1, keepdims=True)
    tilt = Rotation.from_rotvec(across * np.arctan2(sine, axis[:, 2:]) / sine)
    scene = carrying(CUP, seen=tilt)
    scene.turns[:, 0] = wxyz(hand)
    found = held(scene, carried(CUP))
    assert found.about_axis.tolist() == [True]
    mean = rotation(found.turn[0]).apply([0, 0, 1])
    np.testing.assert_allclose(mean, GRIP_TURN.apply([0, 0, 1]), atol=1e-6)
