"""An imitator's features: no state of the robot, several states, several actions."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from reaching import FPS, NAMES, assert_same, follow, reach, shown

from pacnet.core.checkpoint import read_checkpoint, write_checkpoint
from pacnet.datasets.demonstrations import Demonstrations
from pacnet.imitator import Imitator, ImitatorConfig

ENVIRONMENT = "observation.environment_state"


def surroundings(*seeds: int) -> Demonstrations:
    """The same numbers as of `reach`, all of them an environment state."""
    episodes = tuple(
        replace(one, state=one.state[:, :0], environment_state=one.percepts)
        for one in map(reach, seeds)
    )
    names = {ENVIRONMENT: ("shoulder", "elbow", "glass.x"), "action": NAMES["action"]}
    return Demonstrations(FPS, names, episodes, "reaching", state=())


def joints(*seeds: int) -> Demonstrations:
    """The same numbers as of `reach`, the state and the action from two features each."""
    names = {"upper": ("angle",), "lower": ("angle",), ENVIRONMENT: ("glass.x",)}
    names |= {"pull": ("force",), "push": ("force",)}
    episodes = tuple(map(reach, seeds))
    return Demonstrations(
        FPS, names, episodes, "reaching", action=("pull", "push"), state=("upper", "lower")
    )


def test_an_environment_state_alone_is_learned_and_acted_on():
    usual, alone = shown(*map(reach, range(3))), surroundings(0, 1, 2)
    imitators = [Imitator.from_demonstrations(one) for one in (usual, alone)]
    for imitator, one in zip(imitators, (usual, alone), strict=True):
        imitator.learn(one)
    assert_same(*imitators)
    # Nothing of the robot's own is known, so no action is a place that it goes to.
    config = imitators[1].config
    assert (imitators[0].config.follows, config.follows) == ((0, 1), (-1, -1))
    steps = follow(imitators[1], reach(100).percepts)
    wrong = [
        np.abs(s.action - a).max() for s, a in zip(steps, reach(100).action.numpy(), strict=True)
    ]
    assert np.median(wrong) < 0.05
    assert (config.state_features, config.state_dimensions) == ((), 0)
    assert config.percept_names == ("shoulder", "elbow", "glass.x")


def test_without_a_state_none_can_be_aimed_at():
    with pytest.raises(ValueError, match="expected a state of the robot to aim at"):
        Imitator.from_demonstrations(surroundings(0), targets="state")


@pytest.mark.parametrize("targets", ["action", "state"])
def test_two_features_act_like_the_same_numbers_in_one(targets):
    usual, apart = shown(*map(reach, range(3))), joints(0, 1, 2)
    imitators = [Imitator.from_demonstrations(one, targets, 5) for one in (usual, apart)]
    for imitator, one in zip(imitators, (usual, apart), strict=True):
        imitator.learn(one)
    assert_same(*imitators)
    steps = [follow(imitator, reach(100).percepts[:100]) for imitator in imitators]
    for one, same in zip(*steps, strict=True):
        assert (one.action is None) == (same.action is None)
        assert one.action is None or np.array_equal(one.action, same.action)
    config = imitators[1].config
    assert config.percept_names == ("upper.angle", "lower.angle", f"{ENVIRONMENT}.glass.x")
    assert config.action == ("pull.force", "push.force")
    assert config.state_features == ("upper", "lower")
    assert config.state_names == ("upper.angle", "lower.angle")
    assert config.action_features == ("pull", "push")


def test_features_survive_a_checkpoint(tmp_path: Path):
    for number, one in enumerate((surroundings(0), joints(0), shown(reach(0)))):
        imitator = Imitator.from_demonstrations(one)
        imitator.learn(one)
        imitator.save_pretrained(tmp_path / str(number))
        loaded = Imitator.from_pretrained(tmp_path / str(number))
        assert loaded.config == imitator.config
        assert len(loaded.learn(one)) == 1


def test_an_older_checkpoint_has_its_first_feature_as_state(tmp_path: Path):
    imitator = Imitator.from_demonstrations(shown(reach(0)))
    imitator.learn(shown(reach(0)))
    imitator.save_pretrained(tmp_path)
    fields, tensors = read_checkpoint(tmp_path)
    del fields["state"], fields["action_features"], fields["reports"][0]["first_frame"]
    write_checkpoint(tmp_path, fields, tensors)
    loaded = Imitator.from_pretrained(tmp_path)
    assert loaded.config.state_features == ("observation.state",)
    assert loaded.config.action_features == ("action",)
    assert loaded.reports == imitator.reports
    assert len(loaded.learn(shown(reach(1)))) == 1


@pytest.mark.parametrize(
    "fields",
    [{"state": [ENVIRONMENT]}, {"state": ["no such"]}, {"state": [1]}, {"action_features": [0]}],
)
def test_features_that_contradict_the_percept_are_refused(fields: dict, tmp_path: Path):
    imitator = Imitator.from_demonstrations(shown(reach(0)))
    imitator.save_pretrained(tmp_path)
    wrong, tensors = read_checkpoint(tmp_path)
    write_checkpoint(tmp_path, wrong | fields, tensors)
    with pytest.raises(ValueError, match=f"expected ImitatorConfig.{next(iter(fields))} as"):
        Imitator.from_pretrained(tmp_path)


def test_a_report_that_begins_nowhere_is_refused(tmp_path: Path):
    imitator = Imitator.from_demonstrations(shown(reach(0)))
    imitator.learn(shown(reach(0)))
    imitator.save_pretrained(tmp_path)
    fields, tensors = read_checkpoint(tmp_path)
    fields["reports"][0]["first_frame"] = "0"
    write_checkpoint(tmp_path, fields, tensors)
    with pytest.raises(ValueError, match="expected first_frame in a report"):
        Imitator.from_pretrained(tmp_path)


def test_another_state_of_the_same_percept_is_refused():
    usual = shown(reach(0))
    imitator = Imitator.from_demonstrations(usual)
    both = ("observation.state", ENVIRONMENT)
    joined = replace(
        reach(1), state=reach(1).percepts, environment_state=torch.empty(len(reach(1).state), 0)
    )
    with pytest.raises(ValueError, match=r"expected the state observation.state, as learned"):
        imitator.learn(replace(usual, episodes=(joined,), state=both))


def test_without_actions_nothing_can_be_learned():
    watched = replace(
        shown(replace(reach(0), action=torch.empty(len(reach(0).state), 0))),
        names={name: NAMES[name] for name in ("observation.state", ENVIRONMENT)},
        action=(),
    )
    with pytest.raises(ValueError, match="expected demonstrations with actions"):
        Imitator.from_demonstrations(watched)
    with pytest.raises(ValueError, match="expected 'action' with the dimensions"):
        Imitator.from_demonstrations(shown(reach(0))).learn(watched)


def test_state_and_action_share_no_feature():
    with pytest.raises(ValueError, match=r"of different features, got 'upper' for both"):
        Imitator.from_demonstrations(replace(joints(0), action=("pull", "upper")))


def test_a_config_is_what_its_fields_say():
    config = Imitator.from_demonstrations(joints(0)).config
    with pytest.raises(ValueError, match=r"expected ImitatorConfig.state as the first of upper"):
        replace(config, state=("lower",))
    with pytest.raises(ValueError, match=r"expected ImitatorConfig.follows as 2 dimensions of 2"):
        replace(config, follows=(0, 2))
    assert isinstance(replace(config, state=["upper"], follows=(0, -1)), ImitatorConfig)
