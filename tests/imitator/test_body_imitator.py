"""A robot of joint angles does what it was shown once, wherever the object stands."""

from __future__ import annotations

import math

import numpy as np
import pytest
from arms import (
    MOUTH,
    OBJECT,
    START,
    ArmScene,
    ArmWorld,
    Seen,
    body,
    demonstrate,
    shown,
)

from pacnet.datasets.demonstrations import Demonstration
from pacnet.imitator import Imitator
from pacnet.imitator.records import ImitatorStep

SECONDS = 10.0  # the demonstration takes 7.3
PUT_BACK, PASSED = 0.01, 0.03  # [m] of the object in the end, and of its handle at the mouth
ELSEWHERE = [(0.4, 0.2, 0.15), (0.3, 0.2, 0.2), (0.45, -0.05, 0.15), (0.35, 0.0, 0.25)]
PLAIN = ArmWorld()


def taught(world: ArmWorld, *episodes: Demonstration, with_body: bool = True) -> Imitator:
    """An imitator that has learned these demonstrations; without any, one in the usual scene."""
    demonstrations = shown(world, *episodes)
    how = {"body": body(world.unit)} if with_body else {"points": None}
    imitator = Imitator.from_demonstrations(demonstrations, **how)
    imitator.learn(demonstrations)
    return imitator


def act(imitator: Imitator, now: ArmScene) -> list[ImitatorStep]:
    """Let it act from a new episode on, whatever it thinks of the scene."""
    imitator.reset()
    steps = []
    for _ in range(round(SECONDS * now.world.fps)):
        steps.append(imitator.step(now.percept))
        target = steps[-1].target
        assert target is not None
        now.move(target)
    return steps


def assert_done(imitator: Imitator, now: ArmScene) -> None:
    """The object was taken to the mouth and put back, and the hand has withdrawn."""
    steps = act(imitator, now)
    assert not any(step.is_novel for step in steps)
    assert now.passed() < PASSED
    assert now.held is None
    assert now.missed < PUT_BACK
    assert np.linalg.norm(now.hand - START) < 0.02
    assert steps[-1].is_done


@pytest.fixture(scope="module")
def plain() -> Imitator:
    return taught(PLAIN)


def test_it_is_cut_where_the_object_is_taken_and_where_it_is_put_back(plain: Imitator):
    (cut,) = plain.cuts
    assert cut.landmarks[:3] == ("object", "world", "object's place")
    assert cut.landmarks[-1] == "world"
    frames = plain.config.frames
    assert frames is not None
    assert frames.put_back == (0,)
    assert frames.points.names == ("hand", "object", "object's place")
    assert frames.others == (4,)  # the gripper
    begins = [segment.first_frame / PLAIN.fps for segment in cut.segments]
    assert begins[1] == pytest.approx(2.0, abs=0.3)  # it is taken, and put back by 5.3 s
    assert begins[2] == pytest.approx(3.7, abs=0.4)


@pytest.mark.parametrize("handle", [OBJECT, *ELSEWHERE])
def test_one_demonstration_is_enough_wherever_the_object_stands(
    plain: Imitator, handle: tuple[float, ...]
):
    assert_done(plain, ArmScene(PLAIN, np.array(handle)))


def test_without_a_body_it_is_taken_where_it_stood_only():
    blind = taught(PLAIN, with_body=False)
    now = ArmScene(PLAIN)
    act(blind, now)
    assert now.passed() < PASSED
    assert now.missed < PUT_BACK
    for handle in ELSEWHERE:
        now = ArmScene(PLAIN, np.array(handle))
        act(blind, now)
        assert now.passed() > 0.1


@pytest.mark.parametrize("angle", [-0.5, 0.1])
def test_the_object_may_be_turned(plain: Imitator, angle: float):
    assert_done(plain, ArmScene(PLAIN, np.array((0.4, 0.0, 0.15)), angle))


@pytest.mark.parametrize("fps", [20.0, 100.0])
def test_the_rate_does_not_matter(fps: float):
    world = ArmWorld(fps)
    imitator = taught(world)
    for handle in ELSEWHERE[:2]:
        assert_done(imitator, ArmScene(world, np.array(handle)))


@pytest.mark.parametrize("seen", ["place", "axis"])
def test_less_may_be_perceived_of_the_object(seen: Seen):
    """Its place alone, or how upright it is: then it does not matter how it is turned."""
    world = ArmWorld(seen=seen)
    imitator = taught(world)
    for handle in ELSEWHERE[:3]:
        assert_done(imitator, ArmScene(world, np.array(handle)))


@pytest.mark.parametrize("seen", ["place", "axis", "turn"])
def test_where_it_was_shown_it_is_done_as_it_was_shown(seen: Seen):
    world = ArmWorld(seen=seen)
    imitator, now, same = taught(world), ArmScene(world), ArmScene(world)
    demonstrate(same)
    act(imitator, now)
    assert now.passed() < 0.005
    path, expected = np.array(now.path), np.array(same.path)
    apart = np.linalg.norm(path[:, None] - expected, axis=2).min(axis=1)
    assert apart.max() < 0.01


@pytest.mark.parametrize("seen", ["axis", "turn"])
def test_noise_does_no_harm(seen: Seen):
    """Of 2 mm and 2 mrad, while it is shown and while it is done."""
    world = ArmWorld(seen=seen, noise=0.002)
    imitator = taught(world)
    for seed, handle in enumerate(ELSEWHERE[:3]):
        assert_done(imitator, ArmScene(world, np.array(handle), seed=seed))


def test_of_two_demonstrations_the_one_at_a_place_more_like_it_is_followed():
    handles = [(0.4, 0.1, 0.15), (0.3, -0.15, 0.25)]
    episodes = [
        demonstrate(ArmScene(PLAIN, np.array(handle)), number)
        for number, handle in enumerate(handles)
    ]
    imitator = taught(PLAIN, *episodes)
    assert [cut.is_usual for cut in imitator.cuts] == [True, True]
    for number, handle in enumerate([(0.42, 0.12, 0.15), (0.32, -0.13, 0.25)]):
        steps = act(imitator, ArmScene(PLAIN, np.array(handle)))
        assert steps[0].followed[0].demonstration == number
        assert_done(imitator, ArmScene(PLAIN, np.array(handle)))


def test_the_unit_of_places_changes_no_action(plain: Imitator):
    """On the way, that is; while the hand waits, rounding decides how fast it goes on."""
    millimetres = ArmWorld(unit=1000.0)
    other = taught(millimetres)
    now, same = (ArmScene(world, np.array(ELSEWHERE[1])) for world in (PLAIN, millimetres))
    plain.reset()
    other.reset()
    for _ in range(60):
        one, alike = plain.step(now.percept), other.step(same.percept)
        assert one.target is not None
        assert alike.target is not None
        np.testing.assert_allclose(one.target, alike.target, atol=1e-4)
        assert one.novelty == pytest.approx(alike.novelty, abs=1e-3)
        now.move(one.target)
        same.move(one.target)
    assert_done(other, ArmScene(millimetres, np.array(ELSEWHERE[1])))


@pytest.mark.parametrize(("shift", "tilt"), [((0.0, 0.0, 0.02), 0.0), ((0.0,) * 3, math.pi / 18)])
def test_what_was_grasped_otherwise_is_taken_where_it_is_to_be(
    plain: Imitator, shift: tuple[float, ...], tilt: float
):
    """By 2 cm, or by 10°: the hand goes elsewhere, so that the object goes where it was shown."""
    plain.reset()
    now = ArmScene(PLAIN)
    for _ in range(round(SECONDS * PLAIN.fps)):
        free = now.held is None
        step = plain.step(now.percept)
        assert step.target is not None
        now.move(step.target)
        if free and now.held is not None:
            place, turn = now.held
            slip = type(turn).from_rotvec([0, tilt, 0])
            now.held = place + shift, slip * turn
    nearest = np.linalg.norm(np.array(now.path) - MOUTH, axis=1).min()
    assert nearest < 0.008  # instead of 2 cm
    assert now.missed < 0.006


def test_an_object_that_is_moved_meanwhile_is_followed(plain: Imitator):
    """By 15 cm within half a second; it is put back where it was moved to."""
    plain.reset()
    now = ArmScene(PLAIN, np.array(ELSEWHERE[0]))
    for frame in range(round(SECONDS * PLAIN.fps)):
        if frame < 20:
            now.thing = now.thing + np.array((0.0, -0.0075, 0.0))
            now.stood = now.thing
        step = plain.step(now.percept)
        assert step.target is not None
        now.move(step.target)
    assert now.passed() < PASSED
    assert now.missed < PUT_BACK


def test_no_angle_is_commanded_twice_as_fast_as_was_shown(plain: Imitator):
    """Not when the object jumps, nor when the arm is elsewhere at the beginning."""
    shown_actions = plain.memory.shown().targets[:, :4]
    fastest = 2 * np.abs(np.diff(shown_actions, axis=0)).max()
    plain.reset()
    now = ArmScene(PLAIN, np.array(ELSEWHERE[0]))
    now.move(np.append(now.angles + 0.4, 1.0))
    commands = [now.angles]
    for frame in range(60):
        if frame == 30:
            now.thing = now.stood = np.array(ELSEWHERE[1])
        step = plain.step(now.percept)
        assert step.target is not None
        commands.append(step.target[:4])
        now.move(step.target)
    changes = np.abs(np.diff(commands, axis=0)).max(axis=1)
    assert changes.max() <= fastest + 1e-6
    assert changes.max() > 0.9 * fastest  # it would be faster otherwise


def test_what_it_holds_does_not_lead_the_hand_away(plain: Imitator):
    """An object that sticks to the hand from the moment that this is there.

    The segment still has its frame, in which the hand is to be where it was shown; if that went
    along with the hand, the hand would not stop.
    """
    plain.reset()
    now, hands = ArmScene(PLAIN, np.array(ELSEWHERE[0])), []
    for _ in range(round(3.5 * PLAIN.fps)):
        step = plain.step(now.percept)
        assert step.target is not None
        if step.landmark != "object":
            break
        now.move([*step.target[:4], 0.0])  # the gripper is shut early
        hands.append(now.hand)
    apart = np.linalg.norm(np.array(hands) - ELSEWHERE[0], axis=1)
    first = int((apart < 0.06).argmax())
    assert 0 < first < len(apart)
    assert apart[first:].max() < 0.09


def test_a_saved_one_does_the_same(plain: Imitator, tmp_path):
    plain.save_pretrained(tmp_path)
    loaded = Imitator.from_pretrained(tmp_path)
    assert loaded.config == plain.config
    one, other = ArmScene(PLAIN, np.array(ELSEWHERE[1])), ArmScene(PLAIN, np.array(ELSEWHERE[1]))
    for step, same in zip(act(plain, one), act(loaded, other), strict=True):
        np.testing.assert_array_equal(step.target, same.target)
        assert step.novelty == same.novelty


def test_episodes_and_forks_do_not_disturb_one_another(plain: Imitator):
    handle = np.array(ELSEWHERE[2])
    alone = act(plain, ArmScene(PLAIN, handle))
    other, now, elsewhere = plain.fork(), ArmScene(PLAIN, handle), ArmScene(PLAIN)
    plain.reset()
    for step in alone:
        twin, same = other.step(elsewhere.percept), plain.step(now.percept)
        np.testing.assert_array_equal(same.target, step.target)
        now.move(same.target)
        elsewhere.move(twin.target)
    assert elsewhere.missed < PUT_BACK


def test_the_moment_followed_can_be_compared_with_the_present(plain: Imitator):
    handle = np.array(ELSEWHERE[1])
    plain.reset()
    with pytest.raises(ValueError, match="expected an episode in which a segment is followed"):
        plain.followed_scene()
    now = ArmScene(PLAIN, handle)
    plain.step(now.percept)
    scene = plain.followed_scene()
    before = ArmScene(PLAIN)
    for row, one in enumerate((now, before)):
        np.testing.assert_allclose(scene.places[row, 0], one.hand, atol=1e-6)
        np.testing.assert_allclose(scene.places[row, 1], one.thing, atol=1e-6)
        np.testing.assert_allclose(scene.places[row, 2], one.stood, atol=1e-6)
        np.testing.assert_allclose(scene.turns[row, 2], [1, 0, 0, 0])
