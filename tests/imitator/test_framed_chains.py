"""Episodes with gaps, corrections from the middle, and what was cut off, in frames of reference."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from picking import Scene, World, act, demonstrate, scene, shown, somewhere, taught

from pacnet.cli.cuts import cut_pairs, describe_cuts
from pacnet.cli.points import describe_points
from pacnet.datasets.demonstrations import Demonstration
from pacnet.imitator import Imitator
from pacnet.imitator.records import ImitatorStep

PLAIN = World()
SEEDS = range(5)  # of scenes in which something is done
MIDDLE, FRAMES = 70, 132  # in the demonstration the object is held, and all is over


@pytest.fixture(scope="module")
def whole() -> Demonstration:
    one = demonstrate(scene(PLAIN))
    assert len(one.state) == FRAMES
    return one


def elsewhere(episode: int) -> Demonstration:
    return demonstrate(scene(PLAIN, (0.4, -0.2), (-0.2, 0.4)), episode)


def with_gaps(shown: Demonstration, *gaps: tuple[int, int]) -> Demonstration:
    """The same without some stretches of frames, each from a first to before an end."""
    keep = torch.ones(len(shown.state), dtype=torch.bool)
    for first, end in gaps:
        keep[first:end] = False
    before = [int(keep[:end].sum()) for _, end in gaps]
    return replace(
        shown,
        state=shown.state[keep],
        environment_state=shown.environment_state[keep],
        action=shown.action[keep],
        gaps=tuple(before),
    )


def corrected(first: list[Demonstration], *corrections: Demonstration) -> Imitator:
    imitator = taught(PLAIN, *first)
    imitator.learn(shown(PLAIN, *corrections), corrections=True)
    return imitator


def begins_of(imitator: Imitator) -> dict[int, int]:
    """How each demonstration begins."""
    assert imitator.frames is not None
    kept = imitator.frames.segments.columns()
    return dict(zip(kept["demonstration"].tolist(), kept["begins"].tolist(), strict=True))


def successes(imitator: Imitator) -> list[bool]:
    return [act(imitator, somewhere(PLAIN, seed)) for seed in SEEDS]


def steps_of(imitator: Imitator, now: Scene, frames: int = 250) -> list[ImitatorStep]:
    imitator.reset()
    steps = []
    for _ in range(frames):
        steps.append(imitator.step(now.percept))
        assert steps[-1].action is not None
        now.move(steps[-1].action)
    return steps


def followed(steps: list[ImitatorStep]) -> list[int]:
    """Which demonstrations, in order, each change."""
    numbers = [step.followed[0].demonstration for step in steps]
    return [one for one, before in zip(numbers, [-1, *numbers], strict=False) if one != before]


@pytest.mark.parametrize("gap", [(5, 8), (20, 23), (MIDDLE, 72), (74, 77), (90, 95), (110, 112)])
def test_an_episode_with_a_gap_is_followed_to_its_end(whole: Demonstration, gap: tuple[int, int]):
    """The gap lies before the hand approaches anything, on each of its ways, or between them."""
    imitator = taught(PLAIN, with_gaps(whole, gap))
    assert [report.first_frame for report in imitator.reports] == [0, gap[0]]
    assert all(successes(imitator))


def test_several_gaps_are_passed_beside_other_demonstrations(whole: Demonstration):
    parted = with_gaps(whole, (20, 23), (40, 44), (90, 95))
    assert all(successes(taught(PLAIN, parted)))
    imitator = taught(PLAIN, parted, elsewhere(1))
    assert followed(steps_of(imitator, scene(PLAIN))) == [0, 1, 2, 3]
    assert all(successes(imitator))
    assert all(cut.is_usual for cut in imitator.cuts)


def test_an_episode_with_a_gap_is_done_only_at_its_end(whole: Demonstration):
    imitator = taught(PLAIN, with_gaps(whole, (40, 44)))
    now = scene(PLAIN)
    steps = steps_of(imitator, now)
    assert now.is_done
    assert {step.followed[0].demonstration for step in steps if step.is_done} == {1}
    progress = np.array([step.progress for step in steps])
    assert (np.diff(progress) >= 0).all()
    assert progress[-1] == 1
    for step in steps:
        assert step.segment is not None
        cut = imitator.cuts[step.followed[0].demonstration].segments[step.segment]
        assert cut.reference == step.landmark


def test_an_object_that_is_lost_after_a_gap_is_picked_up_again(whole: Demonstration):
    imitator = taught(PLAIN, with_gaps(whole, (20, 23), (90, 95)))
    lost = []

    def lose(number: int, now: Scene) -> None:
        if now.held is not None and now.hand[0] < -0.15 and not lost:
            now.held, now.thing = None, now.thing + np.array([0.25, -0.15])
            lost.append(number)

    assert act(imitator, scene(PLAIN), frames=400, meanwhile=lose)
    assert lost


def test_episodes_go_by_all_their_parts(whole: Demonstration):
    """One of three is parted, and goes where the others do; one goes elsewhere."""
    parted, odd = with_gaps(whole, (MIDDLE, 72)), demonstrate(scene(PLAIN), 3, carry=False)
    imitator = taught(PLAIN, parted, elsewhere(1), demonstrate(somewhere(PLAIN, 1), 2), odd)
    assert [cut.is_usual for cut in imitator.cuts] == [True, True, True, True, False]
    parted_odd = with_gaps(odd, (20, 22))
    others = [replace(whole, episode=number) for number in range(2)]
    imitator = taught(PLAIN, *others, elsewhere(2), parted_odd)
    assert [cut.is_usual for cut in imitator.cuts] == [True, True, True, False, False]
    (_, segments) = cut_pairs(describe_points(imitator.config) | describe_cuts(imitator))
    assert segments[1] == (
        "object, goal (3 of 5 parts); episodes 3, 3 from frame 20: goal (not followed)"
    )


@pytest.mark.parametrize(("gap", "reference"), [((5, 8), "object"), ((80, 83), "goal")])
def test_what_no_landmark_was_seen_for_before_a_gap_is_on_the_way_to_the_one_after_it(
    whole: Demonstration, gap: tuple[int, int], reference: str
):
    imitator = taught(PLAIN, with_gaps(whole, gap), elsewhere(1), demonstrate(somewhere(PLAIN, 1)))
    last = imitator.cuts[0].segments[-1]
    assert (last.landmark, last.reference) == ("world", reference)
    assert all(cut.is_usual for cut in imitator.cuts)


@pytest.mark.parametrize("begin", [30, 60, MIDDLE, 90])
@pytest.mark.parametrize("is_apart", [False, True])
def test_a_correction_from_the_middle_does_no_harm(
    whole: Demonstration, begin: int, is_apart: bool
):
    """Cut out of its episode, or recorded as one of its own."""
    correction = elsewhere(1).part(begin, FRAMES)
    if is_apart:
        correction = replace(correction, first_frame=0)
    imitator = corrected([whole], correction)
    assert all(successes(imitator))
    imitator.reset()
    assert imitator.step(somewhere(PLAIN, 0).percept).followed[0].demonstration == 0


def test_a_correction_from_the_middle_is_followed_where_it_is_needed(whole: Demonstration):
    """It begins as the second way does, with the goal elsewhere."""
    there = ((0.3, 0.1), (0.4, 0.5))
    correction = demonstrate(scene(PLAIN, *there), 1)
    imitator = corrected([whole], correction.part(60, len(correction.state)))
    now = scene(PLAIN, *there)
    assert followed(steps_of(imitator, now)) == [0, 1]
    assert now.is_done
    here = scene(PLAIN)
    assert followed(steps_of(imitator, here)) == [0]
    assert here.is_done


@pytest.mark.parametrize("end", [56, 66])
def test_after_a_correction_what_is_left_of_the_task_is_done(whole: Demonstration, end: int):
    """It shows the way to the object only; the way to the goal is the other's segment 1."""
    before = elsewhere(1)
    imitator = corrected([whole], before.part(10, end))
    known = imitator._latest().framed
    assert known is not None
    after = known.segments.after.tolist()
    assert after[:2] == [1, -1]
    assert after[-1] == 1


def test_what_begins_in_the_middle_is_followed_if_there_is_nothing_else(whole: Demonstration):
    imitator = taught(PLAIN, whole.part(30, FRAMES))
    now = scene(PLAIN)
    assert imitator.step(now.percept).followed == ((0, 0, 1.0),)
    assert act(imitator, now)


def test_corrections_of_one_episode_are_apart_unless_only_time_is_missing(whole: Demonstration):
    one = elsewhere(1)
    parts = one.part(20, 40), replace(one, gaps=(90,)).part(MIDDLE, FRAMES)
    assert begins_of(corrected([whole], *parts)) == {0: 0, 1: 2, 2: 2, 3: 1}
    assert begins_of(taught(PLAIN, whole, *parts)) == {0: 0, 1: 2, 2: 1, 3: 1}


@pytest.mark.parametrize("end", [5, 40, 60, 90, 110])
@pytest.mark.parametrize("several", [False, True])
def test_a_demonstration_that_is_cut_off_has_no_say(whole: Demonstration, end: int, several: bool):
    more = [demonstrate(scene(PLAIN, (-0.2, 0.3), (0.4, 0.2)), 2)] * several
    imitator = taught(PLAIN, elsewhere(1).part(0, end), replace(whole, episode=0), *more)
    assert [cut.is_usual for cut in imitator.cuts] == [False, True, *[True] * several]
    assert all(successes(imitator))
