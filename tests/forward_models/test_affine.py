"""An affine forward model: it recovers a law from little, and its inverse leads to targets."""

from __future__ import annotations

import math
from copy import deepcopy
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from torch import Tensor

from pacnet.forward_models.affine import AffineForwardModel
from pacnet.forward_models.affine_rows import rows_of
from pacnet.forward_models.config import AffineForwardModelConfig
from pacnet.forward_models.protocol import OneStateForwardModel

TURN = torch.tensor([[0.0, -1.0], [1.0, 0.0]])  # a quarter of a turn
STEP = 0.02  # of the hand, for an action of 1


def smooth(frames: int, width: int, seed: int, waves: int = 4) -> Tensor:
    """Actions `[T, U]` within ±1 that change smoothly."""
    rng = np.random.default_rng(seed)
    t = np.linspace(0, 2 * np.pi, frames)[:, None]
    pace, begin = rng.uniform(0.5, waves, (2, width))
    return torch.from_numpy(np.sin(pace * t + 6 * begin)).float()


def moved(actions: Tensor, law: Tensor, lag: float = 0.0) -> Tensor:
    """States `[T, S]` that `law @ action` moves from each frame to the next, and that go on."""
    state, speed, states = torch.zeros(len(law)), torch.zeros(len(law)), []
    for action in actions:
        states.append(state)
        speed = lag * speed + law @ action
        state = state + speed
    return torch.stack(states)


def hand(frames: int = 90, seed: int = 0) -> tuple[Tensor, Tensor]:
    """A hand's places `[T, 2]`, its displacements and a gripper's command `[T, 3]`."""
    actions = smooth(frames, 2, seed)
    grip = torch.where(torch.arange(frames) < 0.4 * frames, -1.0, 1.0)[:, None]
    return moved(actions, STEP * TURN), torch.cat([actions, grip], dim=1)


def model_of(
    states: list[Tensor], actions: list[Tensor], lead: int = 1, follows: tuple[int, ...] = ()
) -> AffineForwardModel:
    width = actions[0].shape[1]
    follows = follows or (-1,) * width
    model = AffineForwardModel(AffineForwardModelConfig(states[0].shape[1], width, lead, follows))
    model.fit(states, actions)
    return model


@pytest.mark.parametrize("lead", [1, 5])
def test_one_demonstration_shows_the_law_of_others(lead: int):
    model = model_of(*([part] for part in hand()), lead=lead)
    assert model.moves.tolist() == [True, True, False]
    assert torch.allclose(model.gain[:, :2], lead * STEP * TURN, atol=0.1 * lead * STEP)
    assert (model.gain[:, 2] == 0).all()
    assert (model.explained > 0.95).all()
    states, actions = hand(seed=1)
    residual = model.residual(states, actions)
    change = states[lead:] - states[:-lead]
    assert (residual[-lead:] == 0).all()
    assert float(residual.square().sum() / change.square().sum()) < 0.05


def test_the_residual_is_what_the_prediction_misses():
    states, actions = hand()
    model = model_of([states], [actions], lead=3)
    residual = model.residual(states, actions)
    for frame in (0, 7, 86):
        velocity = states[frame] - states[frame - 1] if frame else torch.zeros(2)
        mean = actions[frame : frame + 3].mean(dim=0)
        predicted = model(states[frame : frame + 1], velocity[None], mean[None])[0]
        missed = states[frame + 3] - states[frame] - predicted
        assert torch.allclose(residual[frame], missed, atol=1e-6), frame


def test_commands_lead_a_hand_to_its_target():
    model = model_of(*([part] for part in hand()), lead=5)
    place, target = torch.tensor([[0.3, -0.2]]), torch.tensor([[0.1, 0.1]])
    for _ in range(40):
        command = model.command(place, target)
        assert bool(command.has_action)
        place = place + STEP * command.action[:, :2] @ TURN.T
    assert torch.allclose(place, target, atol=0.01)


def test_an_action_that_was_hardly_tried_gets_the_gain_of_the_others():
    _, actions = hand(60)
    weak = torch.randn(60, generator=torch.Generator().manual_seed(0)) * 1e-3
    actions[:, 0] = weak
    model = model_of([moved(actions[:, :2], STEP * TURN)], [actions])
    noisy = moved(actions[:, :2], STEP * TURN)
    noisy += 1e-3 * torch.randn(60, 2, generator=torch.Generator().manual_seed(1))
    for shown in (model, model_of([noisy], [actions[:, :2]])):
        assert float(shown.gain[:, 0].norm()) < 3 * STEP
        assert float(shown.gain[0, 1]) == pytest.approx(-STEP, rel=0.3)


def test_no_dimension_of_another_unit_is_presumed_to_move_as_far():
    actions = smooth(90, 2, seed=4) * torch.tensor([1.0, 0.05])  # it hardly turns
    law = torch.diag(torch.tensor([STEP, 1.0]))
    noise = torch.from_numpy(np.random.default_rng(0).normal(0, 2e-3, (90, 2))).float()
    states = moved(actions, law, lag=0.5) + noise
    settings = AffineForwardModelConfig(2, 2, 1, (-1, -1), turns=1)
    gains = []
    for unit in (1.0, 1000.0):  # m, then mm
        model = AffineForwardModel(settings)
        model.fit([states * torch.tensor([unit, 1.0])], [actions])
        gains.append(model.gain.diag() / torch.tensor([unit, 1.0]))
    assert gains[0][1] == pytest.approx(1, abs=0.2)
    torch.testing.assert_close(gains[0], gains[1], rtol=1e-3, atol=0)


def test_what_goes_on_moving_is_braked():
    actions = smooth(200, 1, seed=2)
    states = moved(actions, torch.tensor([[STEP]]), lag=0.8)
    model = model_of([states], [actions], lead=1)
    assert float(model.lag[0, 0]) == pytest.approx(0.8, abs=0.05)
    assert float(model.gain[0, 0]) == pytest.approx(STEP, rel=0.05)
    here = torch.zeros(1, 1)
    standing = model.command(here, here).action
    assert standing.item() == pytest.approx(0, abs=0.05)
    moving = model.command(here + 0.01, here + 0.01).action
    # It would go on by 0.8 · 0.01; the action takes that back.
    assert moving.item() == pytest.approx(-0.008 / STEP, abs=0.05)
    model.reset()
    assert model.command(here + 0.01, here + 0.01).action.item() == pytest.approx(
        standing.item(), abs=1e-4
    )


def test_places_are_gone_to():
    """Joints that go a tenth of the way to a commanded place in each frame."""
    place, sent = torch.tensor([0.0, 0.0, 0.5]), smooth(120, 3, seed=3)
    sent[:, 2] = 0.5  # never moved
    states = []
    for action in sent:
        states.append(place)
        place = place + 0.1 * (action - place)
    state = torch.stack(states)
    model = model_of([state], [sent], follows=(0, 1, 2))
    assert model.moves.all()
    now, target = state[50:51], state[51:52]
    assert torch.allclose(model.command(now, target).action, sent[50:51], atol=0.1)
    assert model.command(now, target + 9).action[0, :2].tolist() == pytest.approx(
        sent.amax(dim=0)[:2].tolist()
    )  # no further than was shown


def test_a_place_that_was_hardly_commanded_gets_the_gain_of_the_others():
    """One of two commanded joints stands still but for noise; a third is not commanded."""
    sent = smooth(80, 2, seed=4)
    sent[:, 1] = 0.3
    place, states = torch.tensor([0.0, 0.3]), []
    for action in sent:
        states.append(place)
        place = place + 0.1 * (action - place)
    state = torch.stack(states)
    third = 0.2 * smooth(80, 1, seed=5)
    shown = torch.cat([state[:, :1], third, state[:, 1:]], dim=1)
    model = model_of([shown], [sent], follows=(0, 2))
    assert float(model.gain[0, 0]) == pytest.approx(0.1, rel=0.1)
    assert float(model.gain[2, 1]) == pytest.approx(0.1, rel=0.3)


def test_noise_in_a_change_moves_the_action_by_as_much_as_is_likely():
    actions = smooth(400, 1, seed=6)
    noise = 0.01 * torch.randn(400, 1, generator=torch.Generator().manual_seed(0))
    states = moved(actions, torch.tensor([[STEP]])) + noise
    model = model_of([states], [actions])
    gain, unexplained = model.gain.item(), model.residual_variance.item()
    # The posterior mean of u, with the mean square of u before it, and change = gain u + noise.
    before = float(actions[1:-1].square().mean())
    assert model.inverse.item() == pytest.approx(
        gain * before / (gain**2 * before + unexplained), rel=1e-3
    )
    assert model.inverse.item() < 0.9 / gain


def test_moments_with_frames_of_two_blocks_are_not_compared():
    state, action = torch.arange(15.0)[:, None].numpy(), np.ones((15, 1))
    rows = rows_of([state, state[:3]], [action, action[:3]], (-1,), lead=2)
    # 12 moments in 3 blocks, as each has at least twice the lead; three frames have none.
    assert rows.part.tolist() == [0, 0, 0, -1, 1, 1, 1, -1, 2, 2, 2, 2]
    assert (rows.changes == 2).all()
    assert (rows.inputs == 1).all()


def test_actions_that_move_nothing_are_the_mean_of_those_shown():
    states, actions = hand()
    model = model_of([states], [actions])
    command = model.command(states[:5], states[5:10])
    assert torch.allclose(command.action[:, 2], actions[:, 2].mean().expand(5))
    constant = torch.cat([actions[:, :2], torch.full((90, 1), 0.25)], dim=1)
    model = model_of([states], [constant])
    assert model.moves.tolist() == [True, True, False]
    assert (model.command(states[:5], states[5:10]).action[:, 2] == 0.25).all()


def test_a_model_that_nothing_moves_gives_no_action():
    config = AffineForwardModelConfig(2, 1, lead=1, follows=(-1,))
    still, target = torch.zeros(30, 2), np.ones(2, np.float32)
    for model in (AffineForwardModel(config), AffineForwardModel(config)):
        command = model.command(torch.zeros(3, 2), torch.ones(3, 2))
        assert not command.has_action.any()
        assert command.action.isnan().all()
        model.reset()
        assert model.command_one(np.zeros(2, np.float32), target) is None
        assert model.fit([still], [torch.ones(30, 1)]).tolist() == [0, 0]
        model.reset()
        assert model.command_one(np.zeros(2, np.float32), target) is None


def test_one_state_gets_the_action_of_a_batch():
    _, actions = hand()
    states = moved(actions[:, :2], STEP * TURN, lag=0.8)
    model = model_of([states], [actions], lead=5)
    assert float(model.lag.diag().min()) > 0.5
    assert isinstance(model, OneStateForwardModel)
    rows = model.command(states[10:11], states[15:16]), model.command(states[11:12], states[16:17])
    model.reset()
    for row, frame in zip(rows, (10, 11), strict=True):
        one = model.command_one(states[frame].numpy(), states[frame + 5])
        assert one.dtype == np.float32
        assert one == pytest.approx(row.action[0].numpy(), abs=1e-5)


def test_plain_arrays_say_the_same():
    states, actions = hand()
    model = model_of([states], [actions], lead=5)
    arrays = model.arrays()
    assert model.arrays() is arrays
    state, target = states[20].double().numpy(), states[25].double().numpy()
    action = arrays.inverse @ (target - state - arrays.drift)
    action = np.where(arrays.moves, action.clip(arrays.lowest, arrays.highest), arrays.mean_action)
    assert model.command_one(states[20], states[25]) == pytest.approx(action, abs=1e-5)
    assert arrays.lead == 5
    assert arrays.follows.tolist() == [-1, -1, -1]
    model.fit([states], [2 * actions])
    assert model.arrays().gain == pytest.approx(arrays.gain / 2, abs=1e-5)
    with torch.no_grad():
        model.gain.zero_()
    assert not model.arrays().gain.any()


def test_nothing_is_learned_across_episodes():
    states, actions = hand(180)
    parts = [states[:90], states[90:] + 5.0], [actions[:90], actions[90:]]
    model = model_of(*parts)
    assert torch.allclose(model.gain[:, :2], STEP * TURN, atol=0.1 * STEP)
    assert float(model.residual_variance.max()) < 1e-5  # a jump of 5 would be seen
    short = model_of([*parts[0], states[:1]], [*parts[1], actions[:1]])  # with nothing after it
    assert torch.equal(short.gain, model.gain)


@pytest.mark.parametrize(("frames", "lead"), [(5, 1), (25, 5)])
def test_too_few_frames_are_refused_and_the_next_number_is_enough(frames: int, lead: int):
    states, actions = hand(frames)
    model = AffineForwardModel(AffineForwardModelConfig(2, 3, lead, (-1,) * 3))
    with pytest.raises(ValueError, match=rf"at least {frames + 1} frames .* got \[{frames}\]"):
        model.fit([states], [actions])
    assert not model.moves.any()
    states, actions = hand(frames + 1)
    model.fit([states], [actions])
    assert model.gain.isfinite().all()


@pytest.mark.parametrize(
    ("states", "actions", "message"),
    [
        ([], [], "one or more episodes"),
        ([torch.zeros(9, 2)], [], "one or more episodes, got 1 and 0"),
        ([torch.zeros(9, 2)], [torch.zeros(8, 3)], "equally many rows"),
        ([torch.zeros(9, 3)], [torch.zeros(9, 3)], r"states .* got shape \[9, 3\]"),
        ([torch.zeros(9, 2)], [torch.full((9, 3), math.nan)], "finite actions"),
    ],
)
def test_bad_episodes_are_refused(states: list[Tensor], actions: list[Tensor], message: str):
    model = model_of(*([part] for part in hand()))
    before = deepcopy(model.state_dict())
    with pytest.raises(ValueError, match=message):
        model.fit(states, actions)
    for name, tensor in model.state_dict().items():
        assert torch.equal(tensor, before[name])


def test_other_numbers_of_states_need_a_reset():
    model = model_of(*([part] for part in hand()))
    model.command(torch.zeros(2, 2), torch.ones(2, 2))
    with pytest.raises(ValueError, match="expected 2 states, as before, or a reset"):
        model.command(torch.zeros(3, 2), torch.ones(3, 2))
    model.reset()
    assert model.command(torch.zeros(3, 2), torch.ones(3, 2)).has_action.all()


@pytest.mark.parametrize(
    ("name", "place", "value", "message"),
    [
        ("gain", (0, 2), 1.0, "no gain of actions that move nothing"),
        ("inverse", (2, 0), 1.0, "no inverse of actions that move nothing"),
        ("moves", 0, False, "no gain of actions that move nothing"),
        ("residual_variance", 0, -1.0, "residual variance ≥ 0"),
        ("explained", 0, 1.5, "explained shares ≤ 1"),
        ("lowest", 0, 9.0, "lowest ≤ highest"),
        ("drift", 0, math.inf, "a finite drift"),
    ],
)
def test_states_that_cannot_be_are_refused(name: str, place, value: float, message: str):
    model = model_of(*([part] for part in hand()))
    state = model.state_dict()
    state[name][place] = value
    with pytest.raises(ValueError, match=message):
        model.load_state_dict(state)


def test_a_saved_model_commands_the_same(tmp_path: Path):
    states, actions = hand()
    model = model_of([states], [actions], lead=5)
    model.save_pretrained(tmp_path)
    loaded = AffineForwardModel.from_pretrained(tmp_path)
    assert loaded.config == model.config
    model.reset()
    assert torch.equal(
        loaded.command(states[:9], states[5:14]).action,
        model.command(states[:9], states[5:14]).action,
    )


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("turns", 2),
        ("lead", 0),
        ("follows", (0,)),
        ("follows", (0, 2)),
        ("follows", (0, -2)),
        ("lead", True),
    ],
)
def test_settings_out_of_range_are_refused(field: str, value: object):
    config = AffineForwardModelConfig(2, 2, lead=1, follows=(0, 1))
    with pytest.raises(ValueError, match=f"AffineForwardModelConfig.{field}"):
        replace(config, **{field: value})


def wandering(turns: int) -> tuple[AffineForwardModel, Tensor, Tensor]:
    """A hand in a plane that moves with a lag, 0.01 a frame, and turns at once, 0.05 a frame."""
    actions = torch.randn(60, 3, generator=torch.Generator().manual_seed(3)).cumsum(0) / 4
    states, speed = torch.zeros(60, 3), torch.zeros(2)
    for frame in range(59):
        speed = 0.7 * speed + 0.01 * actions[frame, :2]
        turn = 0.05 * actions[frame, 2:]
        states[frame + 1] = states[frame] + torch.cat([speed, turn])
    config = AffineForwardModelConfig(3, 3, lead=1, follows=(-1, -1, -1), turns=turns)
    model = AffineForwardModel(config)
    model.fit([states], [actions])
    return model, states, actions


def test_turns_are_fitted_apart_from_places():
    model, _, _ = wandering(turns=1)
    gain = torch.diag(torch.tensor([0.01, 0.01, 0.05]))
    torch.testing.assert_close(model.gain, gain, rtol=0, atol=1e-4)
    torch.testing.assert_close(
        model.lag, torch.diag(torch.tensor([0.7, 0.7, 0.0])), rtol=0, atol=0.01
    )
    assert model.lag[2, :2].tolist() == model.lag[:2, 2].tolist() == [0, 0]
    assert model.moves.all()


@pytest.mark.parametrize("turns", [-1, 2, 1.0])
def test_some_of_a_state_is_a_place(turns: object):
    with pytest.raises(ValueError, match=r"AffineForwardModelConfig.turns from 0 to 1"):
        AffineForwardModelConfig(2, 1, 1, (-1,), turns=turns)  # pyright: ignore[reportArgumentType]


def test_dimensions_count_together_by_how_much_they_change():
    """One dimension does as it is told exactly, another one is noise."""
    push = torch.randn(200, 1, generator=torch.Generator().manual_seed(0))
    noise = 0.1 * torch.randn(200, 1, generator=torch.Generator().manual_seed(1))
    place = torch.cat([torch.zeros(1, 1), push.cumsum(0)[:-1]])
    state = torch.cat([place, noise], 1)
    model = AffineForwardModel(AffineForwardModelConfig(2, 1, lead=1, follows=(-1,)))
    assert model.explained_together(2) == 0.0
    told, noisy = model.fit([state], [push]).tolist()
    assert told == pytest.approx(1, abs=1e-4)
    changes = torch.diff(state, dim=0).square().mean(dim=0).tolist()
    expected = 1 - ((1 - told) * changes[0] + (1 - noisy) * changes[1]) / sum(changes)
    assert model.explained_together(2) == pytest.approx(expected, abs=2e-3)
    assert model.explained_together(1) == pytest.approx(told, abs=1e-6)
