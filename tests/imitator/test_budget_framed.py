"""A budget in frames of reference and with a body: as few frames, the same deeds."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from lifting import CUP, arm, hand_of, lift, lifts
from picking import FPS, World, act, demonstrate, shown, somewhere
from reaching import assert_same

from pacnet.datasets.demonstrations import Demonstration, Demonstrations
from pacnet.imitator import Imitator
from pacnet.schemas.segments import MIDDLE

PLAIN = World()
SEEDS = range(5)  # of scenes in which something is done


def taught(budget: int | None, *episodes: Demonstration) -> Imitator:
    demonstrations = shown(PLAIN, *episodes)
    imitator = Imitator.from_demonstrations(demonstrations, points=PLAIN.points, budget=budget)
    imitator.learn(demonstrations)
    return imitator


def picked(*seeds: int) -> list[Demonstration]:
    return [demonstrate(somewhere(PLAIN, seed), number) for number, seed in enumerate(seeds)]


def successes(imitator: Imitator) -> list[bool]:
    return [act(imitator, somewhere(PLAIN, 1_000 + seed)) for seed in SEEDS]


def rows_of(imitator: Imitator) -> list[int]:
    return imitator.memory.demonstrations.live("rows").tolist()


def rested(one: Demonstration, frames: int) -> Demonstration:
    """The same after so many frames in which nothing moves."""
    size = one.state.shape[1]
    still = one.percepts[:1].repeat(frames, 1)
    actions = torch.zeros(frames, one.action.shape[1])
    actions[:, -1] = one.action[0, -1]
    rows = torch.cat([still, one.percepts])
    return replace(
        one,
        state=rows[:, :size],
        environment_state=rows[:, size:],
        action=torch.cat([actions, one.action]),
    )


@pytest.mark.parametrize("count", [1, 3])
def test_a_twentieth_of_the_frames_is_enough(count: int):
    episodes = picked(*range(count))
    frames = sum(len(one.state) for one in episodes)
    few, whole = taught(frames // 20, *episodes), taught(None, *episodes)
    assert 0 < len(few.memory.rows) <= frames // 20
    assert successes(few) == successes(whole) == [True] * len(SEEDS)


def test_a_minute_of_rest_before_each_demonstration_does_not_matter():
    minute, before = 60 * FPS, taught(60, *picked(0, 1, 2))
    imitator = Imitator(before.config)
    assert before.frames is not None
    assert imitator.frames is not None
    model = before.frames.forward_model  # fitted to movements
    assert model is not None
    assert imitator.frames.forward_model is not None
    imitator.frames.forward_model.load_state_dict(model.state_dict())
    imitator.learn(shown(PLAIN, *(rested(one, minute) for one in picked(0, 1, 2))))
    assert len(imitator.memory.rows) <= 60
    assert imitator.memory.whole().frames.max() < 300
    assert all(successes(imitator))


def test_cuts_are_told_as_they_were_shown():
    episodes = picked(0, 1)
    few, whole = taught(40, *episodes), taught(None, *episodes)
    for one, other, shown_one in zip(few.cuts, whole.cuts, episodes, strict=True):
        assert one.landmarks == other.landmarks
        assert [segment.first_frame for segment in one.segments] == [
            segment.first_frame for segment in other.segments
        ]
        assert sum(segment.frames for segment in one.segments) == len(shown_one.state)
    late = taught(40, *(rested(one, 500) for one in episodes))
    for one, other in zip(late.cuts, whole.cuts, strict=True):
        ends = [segment.first_frame + segment.frames for segment in one.segments]
        assert ends[-1] == 500 + sum(segment.frames for segment in other.segments)
        assert [segment.first_frame for segment in one.segments] == [0, *ends[:-1]]
    few.reset()
    frames = [few.step(percept).followed[0].frame for percept in episodes[1].percepts]
    assert np.abs(np.diff(frames)).max() < 20
    assert frames[-1] > len(frames) - 10


def test_what_is_forgotten_has_no_cuts():
    imitator = taught(20, *picked(0, 1))
    assert rows_of(imitator)[0] == 0
    assert [len(cut.segments) > 0 for cut in imitator.cuts] == [False, True]
    assert not imitator.cuts[0].is_usual


def with_gaps(one: Demonstration, *gaps: int) -> Demonstration:
    """The same with three frames missing before each of these."""
    keep = torch.ones(len(one.state), dtype=torch.bool)
    for gap in gaps:
        keep[gap - 3 : gap] = False
    before = tuple(int(keep[:gap].sum()) for gap in gaps)
    state, around, action = one.state[keep], one.environment_state[keep], one.action[keep]
    return replace(one, state=state, environment_state=around, action=action, gaps=before)


@pytest.mark.parametrize("budget", [1, 2, 5, 20, 30, 60, 200])
def test_episodes_with_gaps_are_learned_within_any_budget(budget: int, tmp_path: Path):
    first, second, third, last = picked(0, 1, 2, 3)
    imitator = taught(budget, with_gaps(first, 23, 44, 95), with_gaps(second, 33))
    later = shown(PLAIN, with_gaps(third, 33, 54))
    imitator.learn(later, corrections=True)
    imitator.save_pretrained(tmp_path)
    loaded = Imitator.from_pretrained(tmp_path)
    for one in (imitator, loaded, imitator.fork()):
        one.learn(shown(PLAIN, last))
        assert_same(one, imitator)
        assert len(one.memory.rows) <= budget
        assert len(one.cuts) == len(one.reports) == 10
    for percept in last.percepts:
        np.testing.assert_equal(imitator.step(percept), loaded.step(percept))


def test_what_goes_on_where_nothing_is_kept_begins_in_the_middle():
    """There is room for one frame, the first of a part: when the next one comes, for none of it."""
    one = with_gaps(picked(0)[0], 23, 44, 95)
    imitator = taught(1, one)
    assert imitator.frames is not None
    kept = imitator.frames.segments.columns()
    assert (kept["demonstration"].tolist(), kept["begins"].tolist()) == ([2], [MIDDLE])
    assert successes(taught(40, one)) == successes(taught(None, one))


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        ({"frames.segments.rows.frames": -1}, "segments of whole demonstrations"),
        ({"memory.rows.time": 1}, "frames of their demonstrations"),
        ({"memory.demonstrations.frames": 2**40}, "at most 16777216 frames"),
        ({"memory.demonstrations.frames": -1}, "frames of their demonstrations"),
    ],
)
def test_a_damaged_state_is_refused(damage: dict[str, int], message: str):
    imitator = taught(20, *picked(0))
    tensors = imitator.state_dict()
    for name, more in damage.items():
        tensors[name][-1] += more
    with pytest.raises(ValueError, match=message):
        imitator.fork().load_state_dict(tensors)


def test_a_state_that_is_not_refused_is_one_to_act_on():
    """Frames that were kept at other times are followed, where the cuts fit them."""
    imitator, random = taught(20, *picked(0)), np.random.default_rng(0)
    percept, loaded = picked(0)[0].percepts[0], 0
    for _ in range(60):
        tensors, other = imitator.state_dict(), imitator.fork()
        rows = len(tensors["memory.rows.time"])
        frames = int(tensors["memory.demonstrations.frames"])
        times = random.choice(frames, rows, replace=False)
        tensors["memory.rows.time"] = torch.from_numpy(np.sort(times))
        lasting = other.memory.frames_of({
            name.removeprefix("memory."): one for name, one in tensors.items()
        })  # fmt: skip
        cut = tensors["frames.segments.rows.frames"]
        cut[-1] += int(lasting.sum()) - int(cut.sum())
        try:
            other.load_state_dict(tensors)
        except ValueError:
            continue
        loaded += 1
        assert other.step(percept).followed
        assert other.cuts
    assert loaded > 10


@pytest.fixture(scope="module")
def lifters() -> tuple[Imitator, Imitator, Demonstrations]:
    """With a twentieth of the frames, and with all of them."""
    demonstrations, imitators = lifts((0.35, 0.1, 0.02), (0.3, 0.0, 0.02), (0.33, -0.1, 0.02)), []
    frames = sum(len(one.state) for one in demonstrations)
    for budget in (frames // 20, None):
        imitator = Imitator.from_demonstrations(
            demonstrations, points=[CUP], body=arm(), budget=budget
        )
        imitator.learn(demonstrations)
        imitators.append(imitator)
    return imitators[0], imitators[1], demonstrations


def test_with_a_body_a_twentieth_of_the_frames_is_enough(
    lifters: tuple[Imitator, Imitator, Demonstrations],
):
    """Where a cup is that was not shown, both go the same way, and there."""
    few, whole, demonstrations = lifters
    frames = sum(len(one.state) for one in demonstrations)
    assert 0 < len(few.memory.rows) <= frames // 20
    place = (0.33, 0.06, 0.02)
    for imitator in (few, whole):
        imitator.reset()
        steps = [imitator.step(percept) for percept in lift(7, place).percepts]
        assert all(step.action is not None for step in steps)
        assert steps[-1].is_done
        way = [step.landmark for step in steps]
        ways = [one for one, before in zip(way, [None, *way], strict=False) if one != before]
        assert ways == ["cup", "world", "cup's place", "world"]
        target = [step.target for step in steps if step.segment == 0][-1]
        assert target is not None
        assert hand_of(target.astype(np.float64))[0] == pytest.approx(place, abs=0.01)


def test_with_a_body_it_learns_on_after_it_was_saved(
    lifters: tuple[Imitator, Imitator, Demonstrations], tmp_path: Path
):
    few, _, _ = lifters
    few.save_pretrained(tmp_path)
    loaded, fork = Imitator.from_pretrained(tmp_path), few.fork()
    for one in (loaded, fork):
        one.learn(lifts((0.31, 0.08, 0.02), seed=3))
    assert_same(loaded, fork)
