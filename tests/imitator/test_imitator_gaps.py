"""Nothing is learned across a gap: an episode with gaps is learned as the parts between them."""

from dataclasses import replace

import pytest
import torch
from reaching import FRAMES, assert_same, assert_same_actions, reach, shown

from pacnet.datasets.demonstrations import Demonstration
from pacnet.imitator import Imitator

GAP, LOST = 120, 60  # frames before the gap, frames that are missing there


def with_gap(seed: int) -> Demonstration:
    """A reach of which a fifth is missing in the middle."""
    whole = reach(seed)
    kept = [*range(GAP), *range(GAP + LOST, FRAMES)]
    return replace(
        whole,
        state=whole.state[kept],
        environment_state=whole.environment_state[kept],
        action=whole.action[kept],
        gaps=(GAP,),
    )


def in_two(seed: int) -> tuple[Demonstration, Demonstration]:
    """The second method: what is there of the same reach, as two demonstrations."""
    before, after = (
        replace(
            reach(seed),
            state=reach(seed).state[rows],
            environment_state=reach(seed).environment_state[rows],
            action=reach(seed).action[rows],
        )
        for rows in (slice(0, GAP), slice(GAP + LOST, None))
    )
    return before, replace(after, first_frame=GAP)


@pytest.mark.parametrize("targets", ["action", "state"])
def test_an_episode_with_a_gap_is_learned_as_two(targets):
    gapped = shown(with_gap(0), with_gap(1))
    apart = shown(*in_two(0), *in_two(1))
    ours, theirs = (Imitator.from_demonstrations(one, targets, lead=3) for one in (gapped, apart))
    assert ours.config == theirs.config  # its scale and the change in three frames too
    for imitator, one in ((ours, gapped), (theirs, apart)):
        imitator.learn(one)
    assert_same(ours, theirs)
    assert ours.reports == theirs.reports


def test_reports_say_where_a_part_begins():
    imitator = Imitator.from_demonstrations(shown(with_gap(3)))
    progress = []
    reports = imitator.learn(shown(with_gap(3)), progress.append)
    assert [(one.episode, one.first_frame, one.frames) for one in reports] == [
        (3, 0, GAP), (3, GAP, FRAMES - GAP - LOST)
    ]  # fmt: skip
    assert progress == [GAP, FRAMES - GAP - LOST]


def test_a_part_of_an_episode_keeps_its_first_frame(tmp_path):
    part = reach(0).part(100, 250)
    imitator = Imitator.from_demonstrations(shown(part))
    assert [one.first_frame for one in imitator.learn(shown(part))] == [100]
    imitator.save_pretrained(tmp_path)
    assert [one.first_frame for one in Imitator.from_pretrained(tmp_path).reports] == [100]


def test_the_first_action_is_of_demonstrations_that_begin_with_their_episode():
    whole = reach(0)

    def first(value: float, begin: int) -> Demonstration:
        actions = whole.action.clone()
        actions[begin] = value
        return replace(whole, action=actions).part(begin, FRAMES)

    imitator = Imitator.from_demonstrations(shown(whole))
    for one, mean in (
        (first(4.0, 10), 4.0),
        (first(6.0, 20), 5.0),  # none begins with its episode: the mean of both
        (first(1.0, 0), 1.0),
        (first(9.0, 30), 1.0),
        (first(2.0, 0), 1.5),
    ):
        imitator.learn(shown(one))
        torch.testing.assert_close(imitator.first_action, torch.tensor([mean, mean]))


def test_a_later_part_alone_acts_like_the_whole_where_it_is_known():
    whole = shown(*(reach(seed) for seed in range(3)))
    cut = shown(*(replace(one, gaps=(150,)) for one in whole))
    imitator = Imitator.from_demonstrations(whole)
    apart = Imitator.from_demonstrations(whole)
    imitator.learn(cut)
    for one in cut.continuous():
        apart.learn(shown(one))
    assert_same_actions(imitator, apart, reach(100).percepts[150:])


@pytest.mark.parametrize("gaps", [(0,), (FRAMES,), (20, 20), (30, 20), (1.5,)])
def test_gaps_that_are_none_are_refused(gaps):
    spoilt = shown(reach(0), replace(reach(1), gaps=gaps))
    imitator = Imitator.from_demonstrations(shown(reach(0)))
    with pytest.raises(ValueError, match="episode 1: expected gaps in order, from 1 to 299"):
        imitator.learn(spoilt)
    assert imitator.reports == []
