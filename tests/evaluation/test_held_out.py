"""Scores on held-out episodes: splits, an error worked out by hand, and by a second method."""

import math
from collections.abc import Iterator
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import torch

from pacnet.datasets.demonstrations import Demonstration, Demonstrations
from pacnet.evaluation import Split, held_out, score, splits
from pacnet.imitator import Imitator

NAMES = {"observation.state": ("x",), "action": ("u",)}
FPS = 10


def episode(number: int, states: list, actions: list, **kind) -> Demonstration:
    state = torch.tensor(states, dtype=torch.float32).reshape(-1, 1)
    action = torch.tensor(actions, dtype=torch.float32).reshape(len(state), -1)
    shown = {"task": "pull"} | kind
    return Demonstration(
        number, state=state, environment_state=torch.empty(len(state), 0), action=action, **shown
    )


def shown(*episodes: Demonstration) -> Demonstrations:
    return Demonstrations(FPS, NAMES, episodes)


def several(count: int) -> Demonstrations:
    return shown(*(episode(number, [number], [number]) for number in range(count)))


def numbers(split: Split) -> tuple[list[int], list[int]]:
    return [one.episode for one in split.training], [one.episode for one in split.held_out]


def swings(count: int, frames: int = 120) -> Demonstrations:
    """A wave at a pace that differs a little from one episode to the next, its slope as action."""
    rng = np.random.default_rng(0)
    episodes = []
    for number in range(count):
        phase = np.linspace(0, rng.uniform(6, 7), frames)
        noise = 0.01 * rng.standard_normal(frames)
        episodes.append(episode(number, np.sin(phase) + noise, np.cos(phase)))
    return shown(*episodes)


class Scripted:
    """Acts on percepts by a script, in place of an imitator: value -> (action or None, novel)."""

    def __init__(self, script: dict[float, tuple[float | None, bool]], first: float) -> None:
        self.script = script
        self.first_action = torch.tensor([first])
        self.tasks, self.resets = ("go",), 0

    def reset(self, task: str | None) -> None:  # noqa: ARG002
        """Count the episodes."""
        self.resets += 1

    def follow(self, shown: Demonstration) -> Iterator[SimpleNamespace]:
        """Do what the script says."""
        for percept in shown.percepts.numpy():
            action, novel = self.script[float(percept[0])]
            yield SimpleNamespace(
                action=None if action is None else np.float32([action]), is_novel=novel
            )


def test_the_last_of_each_five_is_held_out():
    (split,) = splits(several(12))
    assert numbers(split) == ([0, 1, 2, 3, 5, 6, 7, 8, 10, 11], [4, 9])
    (split,) = splits(several(10))
    assert numbers(split)[1] == [4, 9]
    (split,) = splits(several(7), every=3)
    assert numbers(split) == ([0, 1, 3, 4, 6], [2, 5])
    assert split.training.fps == split.held_out.fps == FPS


def test_at_most_ten_are_held_out():
    (split,) = splits(several(100))
    assert numbers(split)[1] == list(range(4, 50, 5))
    assert len(split.training) == 90
    (split,) = splits(several(100), most=1)
    assert numbers(split)[1] == [4]


@pytest.mark.parametrize(("count", "every"), [(2, 5), (9, 5), (3, 2)])
def test_fewer_episodes_are_left_out_in_turn(count: int, every: int):
    parted = splits(several(count), every)
    assert [numbers(split)[1] for split in parted] == [[number] for number in range(count)]
    for split in parted:
        training, (out,) = numbers(split)
        assert sorted([*training, out]) == list(range(count))


def test_parts_of_an_episode_stay_together():
    parts = [episode(0, [0], [0]), episode(0, [1], [1], first_frame=4), episode(1, [2], [2])]
    one, other = splits(shown(*parts))
    assert numbers(one) == ([1], [0, 0])
    assert numbers(other) == ([0, 0], [1])
    again = [episode(0, [0], [0]), episode(0, [1], [1])]  # two that have the same number
    assert len(splits(shown(*again))) == 2


def test_too_few_episodes_and_bad_numbers_are_refused():
    for count in (0, 1):
        with pytest.raises(ValueError, match=f"expected at least 2 episodes.*, got {count}"):
            splits(several(count))
    for numbers_ in ({"every": 1}, {"every": 2.0}, {"most": 0}):
        with pytest.raises(ValueError, match="expected every ≥ 2 and most ≥ 1"):
            splits(several(10), **numbers_)
    with pytest.raises(ValueError, match="expected splits with frames that are held out"):
        score([])


def test_where_it_holds_the_last_action_counts():
    script = {0.0: (None, True), 1.0: (5.0, False), 2.0: (None, False), 3.0: (7.0, False)}
    imitator = Scripted(script, first=4.0)
    followed = held_out.follow(imitator, episode(0, [0, 1, 2, 0, 3], [0] * 5))
    assert followed.sent.ravel().tolist() == [4, 5, 5, 5, 7]
    assert followed.acted.tolist() == [False, True, False, False, True]
    assert followed.novel.tolist() == [True, False, False, True, False]
    assert imitator.resets == 1


def test_the_errors_of_a_tiny_case():
    # Training: x 0 and 10, actions 2 and 6, a deviation of 2. Held out: x 1, 9, 9; 3, 6, 4 shown.
    training = shown(episode(0, [0], [2]), episode(1, [10], [6]))
    out = shown(episode(2, [1, 9, 9], [3, 6, 4]))
    imitator = Scripted({1.0: (None, True), 9.0: (5.0, False)}, first=4.0)
    scores = score([Split(training, out)], lambda _: imitator)
    assert scores[:4] == (1, 3, pytest.approx(2 / 3), pytest.approx(1 / 3))
    # It sends 4, 5, 5: differences 1, -1, 1, each half a deviation.
    assert scores.error == pytest.approx(0.5)
    # The nearest say 2, 6, 6: -1, 0, 2. All neighbours say 4: 1, -2, 0. With a history, the changes
    # of training are 0 and all frames count too. Repeating says 4 (the mean first action), 3, 6:
    # 1, -3, 2.
    assert scores.baselines == {
        "1-NN": pytest.approx(math.sqrt(5 / 3) / 2),
        "5-NN": pytest.approx(math.sqrt(5 / 3) / 2),
        "5-NN with history": pytest.approx(math.sqrt(5 / 3) / 2),
        "repeating the last action": pytest.approx(math.sqrt(14 / 3) / 2),
    }


def test_who_sees_is_compared_only_where_all_episodes_have_pictures():
    def pictured(one: Demonstration, level: int, *cameras: str) -> Demonstration:
        seen = np.full((len(one.state), 16, 16, 3), level, np.uint8)
        return replace(one, pictures=dict.fromkeys(cameras, seen))

    first = pictured(episode(0, [0], [2]), 0, "top")
    second = pictured(episode(1, [10], [6]), 200, "top", "left")
    out = pictured(episode(2, [1], [6]), 200, "top", "left")

    def errors(training: Demonstrations) -> dict[str, float]:
        imitator = Scripted({1.0: (6.0, False)}, first=0.0)
        return score([Split(training, shown(out))], lambda _: imitator).baselines

    # The actions deviate by 2. The state is nearest to the first's, the picture to the second's,
    # and both count alike: 4 (.1)² + 4 > 4 (.9)².
    seeing = errors(shown(first, second))
    assert seeing["1-NN"] == 2
    assert seeing["1-NN with the first picture"] == 0
    for lacking in (replace(first, pictures={}), pictured(first, 0, "right")):
        assert "1-NN with the first picture" not in errors(shown(lacking, second))


def test_dimensions_of_actions_that_did_not_move_are_not_compared():
    training = shown(episode(0, [0, 10], [[2, 1], [6, 1.0001]]))
    out = shown(episode(1, [0], [[3, 500]]))
    scores = score([Split(training, out)], lambda _: Scripted({0.0: (None, False)}, first=0.0))
    assert scores.error == pytest.approx(3 / 2)
    assert scores.baselines["1-NN"] == pytest.approx(1 / 2)
    still = shown(episode(0, [0, 10], [[2, 1], [2, 1]]))
    scores = score([Split(still, out)], lambda _: Scripted({0.0: (None, False)}, first=0.0))
    assert math.isnan(scores.error)


def test_errors_can_be_measured_by_other_data():
    training, out = shown(episode(0, [0, 1], [0, 2])), shown(episode(1, [0], [3]))
    scale = shown(episode(2, [5, 5], [0, 12]))  # a deviation of 6
    imitator = Scripted({0.0: (0.0, False)}, first=0.0)
    scores = score([Split(training, out, scale)], lambda _: imitator)
    assert scores.error == scores.baselines["1-NN"] == pytest.approx(3 / 6)


def test_frames_of_all_splits_count_alike():
    # Two splits with deviations of 1 and 2: errors of 3 in one frame, of 0 in three.
    one = Split(shown(episode(0, [0, 1], [0, 2])), shown(episode(1, [0], [3])))
    other = Split(shown(episode(0, [0, 1], [0, 4])), shown(episode(1, [0] * 3, [0] * 3)))
    scores = score([one, other], lambda _: Scripted({0.0: (0.0, False)}, first=0.0))
    assert scores[:3] == (2, 4, 1)
    assert scores.error == pytest.approx(math.sqrt(9 / 4))


def test_each_continuous_part_is_followed_from_its_beginning():
    out = shown(episode(1, [0, 0, 0, 0], [1, 1, 1, 1], gaps=(1,)))
    imitator = Scripted({0.0: (None, False)}, first=0.0)
    told: list[int] = []
    training = shown(episode(0, [0, 1], [0, 2]))
    scores = score([Split(training, out)], lambda _: imitator, told.append)
    assert imitator.resets == 2
    assert told == [1, 3]
    assert (scores.episodes, scores.frames) == (1, 4)


def test_it_scores_what_an_imitator_of_each_split_does():
    demonstrations = swings(3)
    scores = score(splits(demonstrations))
    assert (scores.episodes, scores.frames) == (3, 360)
    differences, acted = [], []
    for number, out in enumerate(demonstrations):  # the second method
        training = shown(*(one for one in demonstrations if one is not out))
        imitator = Imitator.from_demonstrations(training)
        imitator.learn(training)
        last = imitator.first_action.numpy()
        deviation = np.concatenate([one.action.numpy() for one in training]).std()
        for percept, wanted in zip(out.percepts, out.action.numpy(), strict=True):
            action = imitator.step(percept).action
            acted.append(action is not None)
            last = last if action is None else action
            differences.append((last - wanted) / deviation)
        assert number == out.episode
    assert scores.acted == np.mean(acted) > 0.9
    assert scores.error == pytest.approx(np.sqrt(np.mean(np.square(differences))), rel=1e-5)
    assert scores.error < 0.7
