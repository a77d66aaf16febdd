"""Demonstrations become segments, each in the frame of its landmark."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scenes import carrying
from scipy.spatial.transform import Rotation

from pacnet.attention.cutting import cut, measure
from pacnet.forward_models.config import AffineForwardModelConfig
from pacnet.schemas.demonstration_memory import DemonstrationMemory, Shown
from pacnet.schemas.frames import FramesConfig
from pacnet.schemas.framing import framed, segments_of
from pacnet.schemas.points import Point, Points
from pacnet.schemas.segments import NO_SEGMENT, SegmentMemory, Segments

FPS = 80.0
HAND = Point("hand", (0, 1, 2), (3, 4, 5, 6))
CUP = Point("cup", (7, 8, 9), (10, 11, 12, 13))
PLATE = Point("plate", (14, 15, 16), (17, 18, 19, 20))
GRIPPER = 21  # the dimension that is no point
SIZE = measure([carrying(FPS)[:, 0]], FPS)
CONFIG = FramesConfig(
    Points(HAND, (CUP, PLATE)),
    SIZE,
    ((1.0, 1.0),) * 3,
    (GRIPPER,),
    (0.5,),
    AffineForwardModelConfig(6, 4, 5, (-1,) * 4),
)
MOVED, TURNED = np.array([0.3, -0.2, 0.1]), Rotation.from_rotvec([0.3, -0.5, 0.8])


def percepts_of(places: np.ndarray, seed: int = 0) -> np.ndarray:
    """Percepts `[T, 22]`: the hand turns slowly, cup and plate are turned somehow."""
    frames = len(places)
    rng = np.random.default_rng(seed)
    turning = Rotation.from_rotvec(np.linspace(0, 1, frames)[:, None] * rng.uniform(-1, 1, 3))
    percepts = np.zeros((frames, 22))
    for number, point in enumerate(CONFIG.points):
        still = Rotation.from_rotvec(np.tile(rng.uniform(-2, 2, 3), (frames, 1)))
        percepts[:, point.place] = places[:, number]
        turn = turning if number == 0 else still
        percepts[:, point.orientation] = np.roll(turn.as_quat(), 1, axis=1)
    percepts[:, GRIPPER] = np.linspace(0, 0.5, frames)
    return percepts


def elsewhere(percepts: np.ndarray, turn: Rotation, moved: np.ndarray) -> np.ndarray:
    """The same scene, turned and then moved as a whole."""
    percepts = percepts.copy()
    for point in CONFIG.points:
        percepts[:, point.place] = turn.apply(percepts[:, point.place]) + moved
        before = Rotation.from_quat(np.roll(percepts[:, point.orientation], -1, axis=1))
        percepts[:, point.orientation] = np.roll((turn * before).as_quat(), 1, axis=1)
    return percepts


def shown_of(
    lengths: list[int], task: list[int] | None = None, correction: list[bool] | None = None
) -> Shown:
    """Demonstrations of so many frames, of which only task and correction are looked at."""
    memory, count = DemonstrationMemory(1, 1), len(lengths)
    of = zip(lengths, task or [0] * count, correction or [False] * count, strict=True)
    for frames, number, is_correction in of:
        rows = np.zeros((frames, 1), np.float32)
        memory.append(rows, rows, rows, number, is_correction)
    return memory.shown()


def segments_from(
    *percepts: np.ndarray,
    labels: list[np.ndarray] | None = None,
    actions: np.ndarray | None = None,
    config: FramesConfig = CONFIG,
    **shown: list,
) -> Segments:
    """Segments of demonstrations, cut where labels say so, or else by attention."""
    memory, parts = SegmentMemory(2), []
    for number, one in enumerate(percepts):
        sent = np.zeros((len(one), 4)) if actions is None else actions
        parts.append(framed(one, sent, config, FPS, None))
        if labels is None:
            memory.append(number, cut(parts[-1].scene.places, config.size, FPS))
        else:
            memory.append(number, labels[number])
    lengths = [len(one) for one in percepts]
    return segments_of(parts, memory.columns(), shown_of(lengths, **shown), config)


def test_segments_are_those_of_the_cuts():
    percepts = percepts_of(carrying(FPS))
    frames = len(percepts)
    segments = segments_from(percepts, percepts[:100])
    middle = int(segments.end[0])
    assert segments.landmark.tolist() == [0, 1, 0]
    assert segments.first.tolist() == [0, middle, frames]
    assert segments.end.tolist() == [middle, frames, frames + 100]
    assert segments.demonstration.tolist() == [0, 0, 1]
    assert segments.order.tolist() == [0, 1, 0]
    assert segments.after.tolist() == [1, NO_SEGMENT, NO_SEGMENT]
    assert segments.usual.tolist() == [True, True, False]  # the other one is cut off


def test_places_are_those_that_the_landmark_sees():
    percepts = percepts_of(carrying(FPS))
    segments = segments_from(percepts)
    middle = int(segments.end[0])
    for rows, point in ((slice(0, middle), CUP), (slice(middle, None), PLATE)):
        turn = Rotation.from_quat(np.roll(percepts[rows, point.orientation], -1, axis=1))
        apart = percepts[rows][:, HAND.place] - percepts[rows][:, point.place]
        np.testing.assert_allclose(segments.place[rows], turn.inv().apply(apart), atol=1e-12)
        hand = Rotation.from_quat(np.roll(percepts[rows, HAND.orientation], -1, axis=1))
        seen = Rotation.from_quat(np.roll(segments.turn[rows], -1, axis=1))
        np.testing.assert_allclose(seen.as_matrix(), (turn.inv() * hand).as_matrix(), atol=1e-12)


def test_without_a_landmark_places_are_those_of_the_world():
    percepts = percepts_of(carrying(FPS))
    segments = segments_from(percepts, labels=[np.full(len(percepts), -1)])
    np.testing.assert_allclose(segments.place, percepts[:, HAND.place])
    assert segments.axes.tolist() == [[1, 0, 0, 0]] * len(percepts)


def test_a_scene_that_is_moved_and_turned_as_a_whole_looks_the_same_from_landmarks():
    percepts = percepts_of(carrying(FPS))
    here, there = segments_from(percepts), segments_from(elsewhere(percepts, TURNED, MOVED))
    for field in ("landmark", "first", "end", "carried", "others"):
        np.testing.assert_array_equal(getattr(there, field), getattr(here, field))
    for field in ("place", "velocity", "share"):
        np.testing.assert_allclose(getattr(there, field), getattr(here, field), atol=1e-9)
    same = np.abs((there.turn * here.turn).sum(axis=1))  # a quaternion and its negative are one
    np.testing.assert_allclose(same, 1)


def test_a_layout_says_nothing_of_where_the_scene_is():
    percepts = percepts_of(carrying(FPS))
    here = segments_from(percepts).layout
    there = segments_from(elsewhere(percepts, Rotation.identity(), MOVED)).layout
    np.testing.assert_allclose(there, here, atol=1e-12)
    other = percepts.copy()
    other[:, PLATE.place] += (0.1, 0, 0)
    assert np.abs(segments_from(other).layout[0] - here[0]).max() > 0.1


def test_velocities_are_changes_in_the_axes_of_the_landmark():
    percepts = percepts_of(carrying(FPS))
    segments = segments_from(percepts)
    row = 40
    turn = Rotation.from_quat(np.roll(percepts[row, CUP.orientation], -1))
    step = percepts[row, HAND.place] - percepts[row - 1, HAND.place]
    np.testing.assert_allclose(segments.velocity[row, :3], turn.inv().apply(step), atol=1e-12)
    hands = Rotation.from_quat(np.roll(percepts[[row - 1, row]][:, HAND.orientation], -1, axis=1))
    turned = (hands[1] * hands[0].inv()).as_rotvec()
    np.testing.assert_allclose(segments.velocity[row, 3:], turn.inv().apply(turned), atol=1e-12)
    assert not segments.velocity[0].any()


def test_shares_are_those_of_the_path_in_each_segment():
    percepts = percepts_of(carrying(FPS))[:6]
    percepts[:, HAND.place] = 0
    percepts[:, 0] = [0, 1, 4, 4, 5, 7]
    segments = segments_from(percepts, labels=[np.array([0, 0, 0, 1, 1, 1])])
    np.testing.assert_allclose(segments.share, [0, 1 / 4, 1, 0, 1 / 3, 1])
    percepts[:, 0] = 0  # without any movement
    still = segments_from(percepts, labels=[np.array([0, 0, 0, 1, 1, 1])])
    assert still.share.tolist() == [0] * 6


def test_what_is_no_point_is_in_shares_of_its_range():
    segments = segments_from(percepts_of(carrying(FPS)))
    np.testing.assert_allclose(segments.others[[0, -1], 0], [0, 1])


def test_actions_that_are_places_are_relative_and_all_are_averaged():
    """At 80 Hz over three frames."""
    percepts = percepts_of(carrying(FPS))
    model = replace(CONFIG.forward_model, follows=(0, 1, 2, -1))
    actions = np.zeros((len(percepts), 4))
    actions[:, :3] = percepts[:, HAND.place] + (0.01, 0.02, 0.03)
    actions[:, 3] = np.arange(len(percepts)) >= 50
    config = replace(CONFIG, forward_model=model)
    segments = segments_from(percepts, actions=actions, config=config)
    np.testing.assert_allclose(segments.action[:, :3], [[0.01, 0.02, 0.03]] * len(percepts))
    np.testing.assert_allclose(
        segments.action[[0, 48, 49, 50, 51, -1], 3], [0, 0, 1 / 3, 2 / 3, 1, 1]
    )


def test_what_is_carried_is_marked():
    segments = segments_from(percepts_of(carrying(FPS)))
    assert not segments.carried[:100].any()
    assert segments.carried[190].tolist() == [True, False]


@pytest.mark.parametrize(
    ("ways", "task", "correction", "usual"),
    [
        ([[0, 1], [0, 1], [0, 1, 0]], [0, 0, 0], None, [1, 1, 0]),
        ([[0, 1], [1], [0, 1], [0, 1]], [0] * 4, None, [1, 0, 1, 1]),
        ([[0, 1], [1]], [0, 0], None, [1, 1]),  # too few to tell
        ([[0, 1], [0]], [0, 0], None, [1, 0]),  # cut off
        ([[0, -1], [0, 1]], [0, 0], None, [0, 1]),
        ([[-1], [0, 1]], [0, 0], None, [0, 1]),  # reaches nothing
        ([[0], [0], [0, 1]], [0] * 3, None, [0, 0, 1]),  # although they are more
        ([[0], [0], [0], [0, 1]], [0] * 4, None, [1, 1, 1, 0]),  # too many to be all cut off
        ([[0, 1], [0, 1, 0]], [0, 0], None, [1, 1]),  # back to where it was
        ([[0], [0, 1]], [0, 1], None, [1, 1]),  # another task
        ([[0, 1], [0]], [0, 0], [False, True], [1, 1]),
        ([[0, 1], [0, 1], [1]], [0, 0, 1], None, [1, 1, 1]),  # another task
        ([[0, 1], [0, 1], [0, 1], [1]], [0] * 4, [False] * 3 + [True], [1, 1, 1, 1]),
        ([[0, 1], [0, 1], [1]], [0] * 3, [False, False, True], [1, 1, 1]),
        ([[0], [0], [1], [1], [1], [0]], [0, 0, 1, 1, 1, 0], None, [1] * 6),
    ],
)
def test_demonstrations_that_go_elsewhere_than_most_are_not_usual(ways, task, correction, usual):
    """Each landmark for three frames."""
    labels = [np.repeat(way, 3) for way in ways]
    percepts = [percepts_of(carrying(FPS))[: len(one)] for one in labels]
    segments = segments_from(*percepts, labels=labels, task=task, correction=correction)
    expected = [bool(one) for one, way in zip(usual, ways, strict=True) for _ in way]
    assert segments.usual.tolist() == expected


def test_the_frame_in_which_ends_agree_is_taken():
    """Attention says that the hand is on its way to the plate, but it ends at the cup."""
    rng = np.random.default_rng(0)
    percepts = []
    for seed in range(3):
        one = percepts_of(carrying(FPS), seed)[:100]
        one[:, CUP.orientation] = one[:, PLATE.orientation] = (1, 0, 0, 0)
        one[:, (*HAND.place, *CUP.place)] += np.tile(rng.uniform(-0.3, 0.3, 3), 2)
        percepts.append(one)
    segments = segments_from(*percepts, labels=[np.ones(100, np.int64)] * 3)
    assert segments.landmark.tolist() == [0, 0, 0]
    expected = percepts[0][:, HAND.place] - percepts[0][:, CUP.place]
    np.testing.assert_allclose(segments.place[:100], expected)
