"""Following with a body: how things are held, where landmarks are, and the postures that result."""

from __future__ import annotations

import numpy as np
import pytest
from arms import ArmScene, ArmWorld, body, pose, shown
from scipy.spatial.transform import Rotation

from pacnet.competition.body_following import new_hold
from pacnet.competition.body_kernels import AT, follow_with_body
from pacnet.competition.framed_following import FramedFollower
from pacnet.imitator import Imitator
from pacnet.imitator.framed import FramedKnown
from pacnet.schemas.segments import NO_SEGMENT

WORLD, OBJECT, OPEN = -1, 0, np.array([1.0])  # the gripper's opening in shares of its range


@pytest.fixture(scope="module")
def imitator() -> Imitator:
    demonstrations = shown(ArmWorld())
    imitator = Imitator.from_demonstrations(demonstrations, body=body())
    imitator.learn(demonstrations)
    return imitator


class Episode:
    """A recall episode of the three points: hand, object, and where that stood."""

    def __init__(self, imitator: Imitator) -> None:
        known, frames = imitator.fork()._latest().framed, imitator.config.frames
        assert isinstance(known, FramedKnown)
        assert frames is not None
        self.known, self.segments, self.extent = known, known.segments, frames.size.extent
        self.follower: FramedFollower = known.follower
        hold = self.follower.hold
        assert hold is not None
        self.hold, self.state = hold, self.follower.state
        self.action = np.full(5, np.nan)

    def begin_in(self, landmark: int, moved: int) -> int:
        """Go on in the segment with this landmark in which this is moved; return its number."""
        number = next(
            number
            for number, of in enumerate(self.segments.landmark)
            if of == landmark and self.segments.moved[number] == moved
        )
        self.state.segment[0] = number
        self.state.row[0] = self.segments.first[number]
        self.state.offset[:] = 0.0
        self.state.offset_turn[:] = 0.0
        return number

    def step(self, places: np.ndarray, turns: np.ndarray, allowed: bool = True) -> None:
        """Take in one more percept."""
        follow_with_body(
            np.array(places, float), np.array(turns, float), OPEN, self.segments,
            np.full(len(self.segments.first), allowed), self.state, self.follower.settings,
            self.known.model, self.hold, self.action,
        )  # fmt: skip


def wxyz(turn: Rotation) -> np.ndarray:
    return np.roll(turn.as_quat(), 1, axis=-1)


def shown_at(episode: Episode, row: int) -> tuple[np.ndarray, np.ndarray]:
    """Where all points were in the demonstration."""
    return episode.segments.places[row].copy(), episode.segments.turns[row].copy()


def test_how_it_is_held_is_the_mean_since_it_was_taken(imitator: Imitator):
    episode, random = Episode(imitator), np.random.default_rng(0)
    first = episode.segments.first[episode.begin_in(WORLD, 1)]
    places, turns = shown_at(episode, first + 30)
    hand = Rotation.from_quat(np.roll(turns[0], -1))
    grips, grip_turns = [], []
    for _ in range(8):
        grip = np.array([0.01, -0.02, 0.03]) + random.normal(0, 0.004, 3)
        turn = Rotation.from_rotvec(np.add([0.2, 0.1, -0.3], random.normal(0, 0.03, 3)))
        places[1], turns[1] = places[0] + hand.apply(grip), wxyz(hand * turn)
        turns[1] *= random.choice([-1, 1])  # the same turn
        episode.step(places, turns)
        seen = episode.state.places
        grips.append(hand.inv().apply(seen[1] - seen[0]))
        grip_turns.append(turn.as_quat())
    np.testing.assert_allclose(episode.hold.place, np.mean(grips, axis=0), atol=1e-9)
    mean = Rotation.from_quat(np.roll(episode.hold.turns[0], -1))
    assert (mean.inv() * Rotation.from_quat(grip_turns).mean()).magnitude() < 1e-3
    episode.begin_in(OBJECT, 0)
    episode.step(places, turns)
    assert episode.hold.moved.tolist() == [0]
    episode.begin_in(WORLD, 1)  # it is taken anew
    episode.step(places, turns)
    assert episode.hold.frames.tolist() == [1]
    np.testing.assert_allclose(episode.hold.place, grips[-1], atol=1e-3)


@pytest.mark.parametrize(
    ("grip", "tilt"), [((0.0, 0.0, 0.0), 0.0), ((0.0, 0.01, 0.02), 0.0), ((0, 0, 0), 0.17)]
)
def test_what_is_carried_goes_where_it_was_shown_however_it_is_held(
    imitator: Imitator, grip: tuple[float, ...], tilt: float
):
    """By the arm's own trigonometry: the hand's place is another one then."""
    episode = Episode(imitator)
    first = episode.segments.first[episode.begin_in(WORLD, 1)]
    row = int(first) + 30
    episode.state.row[0] = row
    places, turns = shown_at(episode, row)
    hand = Rotation.from_quat(np.roll(turns[0], -1))
    held = hand.inv().apply(places[1] - places[0]) + grip
    held_turn = hand.inv() * Rotation.from_quat(np.roll(turns[1], -1))
    held_turn = Rotation.from_rotvec([0, tilt, 0]) * held_turn
    places[1], turns[1] = places[0] + hand.apply(held), wxyz(hand * held_turn)
    for _ in range(12):
        episode.state.row[0] = row
        episode.step(places, turns)
    row = int(episode.state.row[0])
    place, turn = pose(episode.action[:4])
    went = place + turn @ held
    np.testing.assert_allclose(went, episode.segments.goal[row], atol=0.004)
    wanted = Rotation.from_quat(np.roll(episode.segments.goal_turn[row], -1))
    off = (wanted.inv() * Rotation.from_matrix(turn) * held_turn).magnitude()
    assert off < 0.05
    np.testing.assert_allclose(episode.hold.off[:3], episode.segments.goal[row] - went, atol=1e-6)
    assert episode.hold.off[3] == pytest.approx(off, abs=1e-6)


def test_what_is_no_joint_is_done_as_it_was_shown(imitator: Imitator):
    episode, now = Episode(imitator), ArmScene(ArmWorld())
    places, turns = shown_at(episode, 0)
    assert np.linalg.norm(places[0] - now.hand) < 1e-6
    for _ in range(5):
        episode.step(places, turns)
    assert episode.action[4] == episode.segments.action[episode.state.row[0], 4]


def test_without_a_segment_there_is_no_action(imitator: Imitator):
    episode = Episode(imitator)
    episode.hold.miss[:] = 1.0
    episode.step(*shown_at(episode, 0), allowed=False)
    assert episode.state.segment.tolist() == [NO_SEGMENT]
    assert np.isnan(episode.action).all()
    assert episode.hold.miss.tolist() == [0.0] * 4


def test_a_landmark_is_followed_while_the_hand_is_away(imitator: Imitator):
    episode = Episode(imitator)
    places, turns = shown_at(episode, 0)
    for shift in np.linspace(0, 0.2, 20):
        places[1, 1] = 0.1 + shift
        turns[1] = wxyz(Rotation.from_rotvec([0, 0, shift]))
        episode.step(places, turns)
        np.testing.assert_allclose(episode.hold.places[1], episode.state.places[1])
    axes = episode.hold.axes[1] / np.linalg.norm(episode.hold.axes[1])
    np.testing.assert_allclose(axes, turns[1], atol=1e-6)


def test_a_landmark_at_the_hand_is_where_it_was(imitator: Imitator):
    """Within a tenth of the scene's size; one at the hand from the beginning is where it is."""
    episode = Episode(imitator)
    places, turns = shown_at(episode, 0)
    for share, frozen in ((1.4, False), (0.9, True), (0.5, True)):
        places[1] = places[0] + (share * AT * episode.extent, 0, 0)
        turns[1] = wxyz(Rotation.from_rotvec([0, 0, share]))
        before = episode.hold.places[1].copy(), episode.hold.axes[1].copy()
        for _ in range(3):
            episode.step(places, turns)
        kept = (episode.hold.places[1] == before[0]).all() and (
            episode.hold.axes[1] == before[1]
        ).all()
        assert kept == frozen
    episode = Episode(imitator)
    episode.step(places, turns)
    np.testing.assert_array_equal(episode.hold.places[1], places[1])


@pytest.mark.parametrize("slip", [(0.0, 0.0, 0.0), (0.02, 0.0, 0.02), (-0.02, 0.0, 0.0)])
def test_a_hand_that_holds_a_landmark_is_not_led_by_it(imitator: Imitator, slip: tuple[float, ...]):
    """Whatever the hand does, the object goes along; it is held otherwise than it was shown.

    It was shown 5 cm from the object's middle; the last slip makes that 7 cm, which is more than a
    tenth of the scene's size.
    """
    episode = Episode(imitator)
    number = episode.begin_in(OBJECT, 0)
    row = int(episode.segments.end[number]) - 1
    places, turns = shown_at(episode, row)
    grip, hands = places[1] - places[0] + slip, []
    for _ in range(30):
        episode.state.segment[0], episode.state.row[0], episode.state.tries[0] = number, row, 0
        places[1] = places[0] + grip
        episode.step(places, turns)
        places[0] = pose(episode.action[:4])[0]
        hands.append(places[0].copy())
    assert np.ptp(hands, axis=0).max() < 0.012


def test_a_new_hold_has_room_for_joints_and_points():
    hold = new_hold(4, 3)
    assert hold.posture.shape == hold.ahead.shape == hold.shown.shape == (4,)
    assert hold.places.shape == (3, 3)
    assert hold.axes.shape == (3, 4)
    assert hold.segment.tolist() == [NO_SEGMENT]
