"""Which forward model leads an imitator to states, and that it does."""

from __future__ import annotations

import json
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest
import torch

from pacnet import Imitator
from pacnet.datasets.demonstrations import Demonstration, Demonstrations
from pacnet.forward_models.config import AffineForwardModelConfig, MLPForwardModelConfig
from pacnet.imitator.config import ImitatorConfig
from pacnet.imitator.forward_model import AFFINE, NETWORK

FPS, STEP = 20, 0.02
NAMES = {"observation.state": ("x", "y"), "action": ("dx", "dy", "grip")}


def reach(frames: int = 60) -> Demonstration:
    """A hand that goes around a corner, and closes its gripper there."""
    t = torch.linspace(0, 1, frames)
    move = torch.stack([(1.4 * t).cos(), (1.4 * t).sin()], dim=1)
    move *= (4 * t * (1 - t)).sqrt()[:, None]
    state = torch.cat([torch.zeros(1, 2), STEP * move.cumsum(0)[:-1]])
    grip = torch.where(t > 0.5, 1.0, -1.0)[:, None]
    return Demonstration(0, "reach", state, torch.empty(frames, 0), torch.cat([move, grip], 1))


def reaching(frames: int = 60) -> Demonstrations:
    return Demonstrations(FPS, NAMES, (reach(frames),), "reaching")


def rippled(frames: int = 600) -> Demonstrations:
    """A place where the same push moves to one side or the other, as no affine law can say."""
    push = torch.rand(frames, generator=torch.Generator().manual_seed(0)) * 2 - 1
    place, places = torch.tensor(0.26), []
    for action in push:
        places.append(place)
        place = place + 0.2 * action * (6 * place).cos() + 0.05 * (0.26 - place)
    names = {"observation.state": ("place",), "action": ("push",)}
    state = torch.stack(places)[:, None]
    one = Demonstration(0, "sway", state, torch.empty(frames, 0), push[:, None])
    return Demonstrations(FPS, names, (one,), "swaying")


def taught(demonstrations: Demonstrations, lead: int = 3) -> Imitator:
    imitator = Imitator.from_demonstrations(demonstrations, targets="state", lead=lead)
    imitator.learn(demonstrations)
    return imitator


@pytest.fixture(scope="module")
def imitator() -> Imitator:
    return taught(reaching())


def test_one_short_demonstration_is_enough_to_be_led_along_it(imitator: Imitator):
    assert isinstance(imitator.config.forward_model, AffineForwardModelConfig)
    assert imitator.config.explained[AFFINE] > 0.9
    shown, place = reach(), np.float32([0.0, 0.05])
    imitator.reset()
    for _ in range(70):
        step = imitator.step(place)
        assert step.action is not None
        place = place + np.float32(STEP) * step.action[:2]
    assert place == pytest.approx(shown.state[-1].numpy(), abs=0.05)


def test_what_does_not_move_the_hand_is_done_as_shown(imitator: Imitator):
    shown = reach()
    assert imitator.config.still_actions == (2,)
    assert imitator.memory.rows.live("target").shape == (60, 3)
    imitator.reset()
    grip = [imitator.step(place).action[2] for place in shown.state.numpy()]
    wrong = np.abs(np.array(grip) - shown.action[:, 2].numpy()) > 0.5
    assert wrong.sum() <= 2  # but around the moment at which it closes


def test_targets_are_the_states_ahead_and_those_actions(imitator: Imitator):
    shown, stored = reach(), imitator.memory.rows.live("target")
    assert torch.equal(stored[:-3, :2], shown.state[3:])
    assert torch.equal(stored[:, 2], shown.action[:, 2])


def test_a_network_is_used_where_no_affine_law_holds():
    imitator = taught(rippled(), lead=1)
    assert isinstance(imitator.config.forward_model, MLPForwardModelConfig)
    shares = imitator.config.explained
    assert shares[AFFINE] < 0.5 < shares[NETWORK]
    assert imitator.config.still_actions == ()
    assert imitator.step(np.float32([0.1])).target is not None


def test_no_network_is_tried_with_few_transitions():
    config = Imitator.from_demonstrations(rippled(60), targets="state").config
    assert isinstance(config.forward_model, AffineForwardModelConfig)
    assert set(config.explained) == {AFFINE}


def test_a_new_episode_has_no_velocity_from_the_last(imitator: Imitator):
    first, other = np.float32([0.0, 0.0]), np.float32([0.1, 0.02])
    imitator.reset()
    expected = imitator.step(first).action
    imitator.step(other)
    twin = imitator.fork()
    imitator.reset()
    for again in (imitator, twin):
        assert np.array_equal(again.step(first).action, expected)


def test_a_loaded_imitator_knows_its_model_and_does_the_same(imitator: Imitator, tmp_path: Path):
    imitator.save_pretrained(tmp_path)
    loaded = Imitator.from_pretrained(tmp_path)
    assert loaded.config == imitator.config
    imitator.reset()
    for place in reach().state.numpy():
        assert np.array_equal(loaded.step(place).action, imitator.step(place).action)


def test_a_damaged_forward_model_is_refused_before_anything_changes(imitator: Imitator):
    twin, state = imitator.fork(), imitator.state_dict()
    state["forward_model.moves"] = torch.tensor([False, True, False])
    state["first_action"] = torch.ones(3)
    with pytest.raises(ValueError, match="no gain of actions that move nothing"):
        twin.load_state_dict(state)
    assert torch.equal(twin.first_action, imitator.first_action)


def test_settings_of_older_checkpoints_are_read():
    fields = json.loads(json.dumps(asdict(taught(rippled(), lead=1).config)))
    del fields["explained"], fields["still_actions"]
    config = ImitatorConfig.from_dict(fields)
    assert isinstance(config.forward_model, MLPForwardModelConfig)
    assert (dict(config.explained), config.still_actions) == ({}, ())


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"still_actions": (2, 2)}, "still_actions as ascending"),
        ({"still_actions": (3,)}, "still_actions as ascending"),
        ({"explained": {"affine": 1.5}}, "explained as shares"),
        ({"explained": {"": 0.5}}, "explained as shares"),
    ],
)
def test_settings_that_cannot_be_are_refused(
    imitator: Imitator, fields: dict[str, object], message: str
):
    with pytest.raises(ValueError, match=message):
        replace(imitator.config, **fields)


def test_too_few_frames_are_refused():
    with pytest.raises(ValueError, match="at least 16 frames to fit 3 frames ahead"):
        Imitator.from_demonstrations(reaching(9), targets="state", lead=3)
