"""What is seen in an episode: the median of looks, of the camera that can see."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from pacnet.vision.config import Told
from pacnet.vision.encoder import Look
from pacnet.vision.goals import SHARES
from pacnet.vision.sight import Sight, frames_of, steps_of

PICTURE = np.zeros((4, 4, 3), np.uint8)
GOALS = len(SHARES)


class Script:
    """An encoder that tells what is written, look after look."""

    def __init__(self, *looks: tuple[float, float], error: float = 1.0) -> None:
        self.looks, self.told, self.asked = list(looks), Told(error, 10.0, 0.0), 0
        self.config = type("Config", (), {"outputs": GOALS})

    def look(self, _picture: torch.Tensor, _shift: torch.Tensor | None) -> Look:
        """Return the next look: all goals at one place, and the doubt."""
        place, doubt = self.looks[min(self.asked, len(self.looks) - 1)]
        self.asked += 1
        return Look(torch.full((GOALS,), place), doubt, ())


def seen_by(*encoders: Script, at_once: int = 5, until: int = 100, frames: int = 8) -> list:
    sight = Sight(encoders, at_once, until)  # pyright: ignore[reportArgumentType]
    seen = []
    for _ in range(frames):
        seen.append(sight.last or sight([PICTURE] * len(encoders)))
        if seen[-1].doubt <= 1:
            sight.acted()
    return seen


def test_one_bad_look_is_outvoted():
    """Looks that are certain and wrong, as at an arm in the way."""
    seen = seen_by(Script((2, 0.1), (2.2, 0.1), (50, 0.2), (1.8, 0.1), (2, 0.1)))
    assert [one.goals[0] for one in seen[1:]] == pytest.approx(
        [2.1, 2.2, 2.1, 2, 2, 2, 2], abs=1e-6
    )


def test_a_look_in_doubt_does_not_count_and_alone_is_no_alarm():
    seen = seen_by(Script((2, 0.1), (2, 0.1), (50, 9.0), (2, 0.1)))
    assert [one.goals[0] for one in seen] == [2.0] * 8
    assert max(one.doubt for one in seen) <= 1


def test_doubt_that_stays_is_an_alarm_and_goes_when_it_is_over():
    seen = seen_by(Script((2, 0.1), (50, 9.0), (50, 9.0), (50, 9.0), (2, 0.1)), at_once=3)
    assert [one.doubt > 1 for one in seen] == [False, True, True, True, True, False, False, False]
    assert seen[-1].goals[0] == 2


def test_a_first_picture_that_is_bad_is_made_good():
    seen = seen_by(Script((50, 9.0), (2, 0.1)), at_once=3)
    assert seen[0].doubt > 1
    assert [one.doubt <= 1 for one in seen[2:]] == [True] * 6
    assert seen[-1].goals[0] == 2


def test_what_is_moved_is_seen_until_the_hand_may_be_in_the_way():
    script = Script(*[(2, 0.1)] * 6, (4, 0.1))
    seen = seen_by(script, at_once=3, until=9, frames=20)
    assert seen[9].goals[0] == 4
    assert script.asked == 10  # frames 0 to 9
    assert [one.goals[0] for one in seen[10:]] == [4.0] * 10
    late = Script(*[(2, 0.1)] * 15, (4, 0.1))
    assert seen_by(late, at_once=3, until=9, frames=20)[-1].goals[0] == 2


def test_a_doubt_in_the_second_half_is_the_hand_that_came_sooner():
    """With nine frames: in frame 4 an alarm, in frame 5 it goes on with what it saw before."""
    early = Script(*[(2, 0.1)] * 4, (50, 9.0))
    assert max(one.doubt for one in seen_by(early, at_once=1, until=9, frames=20)) == 9
    late = Script(*[(2, 0.1)] * 5, (50, 9.0))
    seen = seen_by(late, at_once=1, until=9, frames=20)
    assert [one.doubt for one in seen] == [0.1] * 20
    assert seen[-1].goals[0] == 2
    assert late.asked == 6


def test_frames_without_an_action_do_not_count_towards_it():
    script = Script(*[(50, 9.0)] * 6, (2, 0.1))
    seen = seen_by(script, at_once=1, until=2, frames=20)
    assert script.asked == 6 + 3
    assert seen[-1].goals[0] == 2


def test_looking_goes_on_while_nothing_is_done():
    """A robot that is held up elsewhere: the hand comes no nearer, and a doubt is an alarm."""
    script = Script(*[(2, 0.1)] * 50, (50, 9.0))
    sight = Sight([script], 1, 5)  # pyright: ignore[reportArgumentType]
    seen = [sight.last or sight([PICTURE]) for _ in range(60)]
    assert script.asked == 60
    assert seen[-1].doubt == 9


def test_the_exact_camera_has_the_say():
    """Errors of 1 and 3: the shares go with the inverse squares, 9 to 1."""
    seen = seen_by(Script((0, 0.1), error=1.0), Script((10, 0.1), error=3.0))
    assert seen[0].goals[0] == pytest.approx(1.0)


def test_the_camera_in_doubt_is_named():
    seen = seen_by(Script((0, 0.1)), Script((0, 3.0)), Script((0, 2.0)))
    assert seen[0].camera == 1
    assert seen[0].doubt == 3
    assert len(seen[0].looks) == 3


@pytest.mark.parametrize(
    ("seconds", "fps", "shortest", "expected"),
    [(0.5, 20, 200, 10), (0.5, 20, 60, 6), (0.5, 20, 5, 1), (0.01, 20, 200, 1)],
)
def test_a_beginning_is_a_tenth_at_most(seconds: float, fps: float, shortest: int, expected: int):
    assert frames_of(seconds, fps, shortest) == expected


def test_goals_one_by_one():
    goals = np.arange(2 * GOALS * 3).reshape(2, -1)
    assert steps_of(goals).shape == (2, GOALS, 3)
    assert steps_of(goals)[1, 2].tolist() == [18, 19, 20]
