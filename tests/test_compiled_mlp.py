"""The learned forward model's command for one state against `command`, whatever its tensors."""

from __future__ import annotations

import copy
import dataclasses
import math
import pickle
from collections.abc import Callable

import numpy as np
import pytest
import torch
from torch import Tensor, nn

from pacnet import mlp_kernels as kernels
from pacnet.forward_model import ForwardModel, OneStateForwardModel
from pacnet.mlp_forward_model import MLPForwardModel, MLPForwardModelConfig
from pacnet.transition_matrix import TransitionMatrix, TransitionMatrixConfig

STATES, ACTIONS = 3, 2


def make(
    hidden: tuple[int, ...] = (5,), number: int = 21, steps: int = 1, abstain_below: float = 0.0
) -> MLPForwardModel:
    """An untrained model with random candidates, normalisers and range."""
    generator = torch.Generator().manual_seed(number)
    candidates = torch.randn(number, ACTIONS, generator=generator).tolist()
    config = MLPForwardModelConfig(
        STATES, ACTIONS, candidates, hidden=hidden, steps=steps, abstain_below=abstain_below
    )
    model = MLPForwardModel(config, seed=1)
    for name, buffer in model.named_buffers():
        if name.endswith(("mean", "std")):
            drawn = torch.rand(len(buffer), generator=generator, dtype=torch.float64)
            buffer.copy_(drawn + 0.2 if name.endswith("std") else drawn - 0.5)
    model.state_low.copy_(torch.tensor([-1.5, -1.0, -2.0]))
    model.state_high.copy_(torch.tensor([1.5, 2.0, 1.0]))
    with torch.no_grad():
        for parameter in model.parameters():
            parameter.add_(0.3 * torch.randn(parameter.shape, generator=generator))
    return model


def hand_set(gain: float, candidates: tuple[float, ...], **fields: float) -> MLPForwardModel:
    """From state x action a leads to x / 2 + gain × a, exact in float32."""
    config = MLPForwardModelConfig(1, 1, tuple((a,) for a in candidates), hidden=(), **fields)
    model = MLPForwardModel(config)
    weights = {"weight": torch.tensor([[-0.5, gain]]), "bias": torch.zeros(1)}
    model.network[0].load_state_dict(weights)
    return model


def rows(number: int, seed: int = 0) -> Tensor:
    return torch.randn(number, STATES, generator=torch.Generator().manual_seed(seed))


def answers(model: MLPForwardModel, states: Tensor, targets: Tensor) -> Tensor:
    """What it commands, one row after the other, as `command` says it: NaN where it abstains."""
    nothing = np.full(model.action_dimensions, np.nan, np.float32)
    said = [model.command_one(*pair) for pair in zip(states.numpy(), targets.numpy(), strict=True)]
    return torch.from_numpy(np.stack([nothing if action is None else action for action in said]))


def commanded(model: MLPForwardModel, states: Tensor, targets: Tensor) -> Tensor:
    like = model.candidates
    return model.command(states.to(like), targets.to(like)).action.float()


def assert_chosen_alike(model: MLPForwardModel, states: Tensor, targets: Tensor) -> None:
    """Both choose alike, but where costs, or spread and threshold, agree to 1e-6."""
    one_by_one, wanted = answers(model, states, targets), commanded(model, states, targets)
    for row in (~torch.isclose(one_by_one, wanted, 0, 0, equal_nan=True).all(dim=1)).nonzero():
        selection = model.select(states[row[0]], targets[row[0]])
        near, second = selection.costs.sort().values[:2].tolist()
        threshold = model.config.abstain_below
        assert (
            second == pytest.approx(near, rel=1e-6)
            or selection.spread == pytest.approx(threshold, rel=1e-6)
        )  # fmt: skip


# The choice.


@pytest.mark.parametrize("hidden", [(), (5,), (64, 64), (3, 1, 18, 7)])
@pytest.mark.parametrize("number", [1, 21, 70])
@pytest.mark.parametrize("steps", [1, 3])
def test_command_one_is_a_command_for_one_state(hidden, number, steps):
    model = make(hidden, number, steps)
    states, targets = rows(150), rows(150, seed=1)
    assert_chosen_alike(model, states, targets)
    if number > 1:
        assert len(answers(model, states, targets).unique(dim=0)) > 3


@pytest.mark.parametrize("hidden", [(), (64, 64)])
def test_it_abstains_where_command_does(hidden):
    model = make(hidden, steps=2)
    states, targets = rows(300), rows(300, seed=1)
    pairs = zip(states, targets, strict=True)
    spreads = torch.tensor([model.select(*pair).spread for pair in pairs])
    model.config = dataclasses.replace(model.config, abstain_below=float(spreads.median()))
    abstains = answers(model, states, targets).isnan().all(dim=1)
    assert 140 < abstains.sum() < 160
    assert_chosen_alike(model, states, targets)


@pytest.mark.parametrize(("threshold", "action"), [(0.25, -1.0), (0.2500001, None), (0, -1.0)])
def test_it_abstains_exactly_when_predictions_are_closer_than_the_threshold(threshold, action):
    # From 8, ±1 at gain 1/4 lead to 4 ± 1/4: a spread of 1/4; the target 3 is nearer to the lower.
    model = hand_set(0.25, (1.0, -1.0), abstain_below=threshold)
    assert model.command_one(np.float32([8.0]), np.float32([3.0])) == action


def test_equal_costs_go_to_the_first_candidate():
    # From 0 they lead to 3, 1, −1, 1, all but the first at distance 1 from 0.
    model = hand_set(1.0, (3.0, 1.0, -1.0, 1.0))
    assert model.command_one(np.zeros(1, np.float32), np.zeros(1, np.float32)) == [1.0]


def test_an_action_is_held_for_all_steps_within_the_range():
    # From 8 through 4 + a to 2 + 3a / 2, or, not above 4, through 4 to 2 + a for a > 0.
    model = hand_set(1.0, (-1.0, 0.0, 0.5, 1.0), steps=2)
    state, target = np.float32([8.0]), np.float32([2.75])
    assert model.command_one(state, target) == [0.5]
    model.state_high.fill_(4)
    assert model.command_one(state, np.float32([2.625])) == [0.5]
    assert model.command_one(state, np.float32([2.875])) == [1.0]


@pytest.mark.parametrize("scale", [1e3, 1e6, 1e30])
def test_saturated_and_overflowing_networks_choose_as_command_does(scale):
    model = make((7, 6))
    assert_chosen_alike(model, rows(50) * scale, rows(50, seed=1))
    model.state_low.fill_(-torch.finfo(torch.float32).max)
    model.state_high.fill_(torch.finfo(torch.float32).max)
    with torch.no_grad():
        model.network[2].weight.mul_(scale)
    assert_chosen_alike(model, rows(50) * scale, rows(50, seed=1) * scale)


# It answers by the tensors that the model has now.


def learn(model: MLPForwardModel) -> None:
    states = rows(100)
    actions = torch.randn(100, ACTIONS, generator=torch.Generator().manual_seed(9))
    model.fit(states, actions, states - 0.5 * actions[:, [0, 1, 0]], seed=0)


def descend(model: MLPForwardModel) -> None:
    optimiser = torch.optim.SGD(model.parameters(), lr=1.0)
    model(rows(21), model.candidates).sum().backward()
    optimiser.step()


def write_data(model: MLPForwardModel) -> None:
    model.network[2].bias.data[0] -= 3


def replace_data(model: MLPForwardModel) -> None:
    model.network[0].weight.data = -model.network[0].weight.data


def replace_candidates(model: MLPForwardModel) -> None:
    model.candidates = model.candidates[:7] + 1


def replace_weight(model: MLPForwardModel) -> None:
    model.network[0].weight = nn.Parameter(-model.network[0].weight.detach())


def replace_network(model: MLPForwardModel) -> None:
    model.network = make((9, 4), number=3).network


def replace_config(model: MLPForwardModel) -> None:
    model.config = dataclasses.replace(model.config, steps=4)


def replace_normaliser(model: MLPForwardModel) -> None:
    model.change_mean = model.change_mean.float() - 1


def drop_bias(model: MLPForwardModel) -> None:
    model.network[2].register_parameter("bias", None)


def parametrize(model: MLPForwardModel) -> None:
    class Negative(nn.Module):
        def forward(self, weight: Tensor) -> Tensor:
            return -weight

    nn.utils.parametrize.register_parametrization(model.network[2], "weight", Negative())


CHANGES = [
    learn,
    descend,
    write_data,
    replace_data,
    replace_candidates,
    replace_weight,
    replace_network,
    replace_config,
    replace_normaliser,
    drop_bias,
    parametrize,
    lambda model: model.load_state_dict(make(number=8).state_dict()),
    lambda model: model.state_mean.add_(1),
    lambda model: model.state_high.fill_(0),
    lambda model: model.network.__setitem__(1, nn.Tanh()),
    lambda model: model.network.append(nn.SiLU()),
    lambda model: model.double().network[2].bias.data.sub_(3),
    lambda model: model.double().half().float().network[2].bias.data.sub_(3),
]


@pytest.mark.parametrize("change", CHANGES)
def test_whatever_changes_changes_the_next_command(change: Callable[[MLPForwardModel], object]):
    model = make()
    states, targets = rows(40), rows(40, seed=1)
    before = answers(model, states, targets)
    twin = copy.deepcopy(model)
    change(model)
    after = answers(model, states, targets)
    assert not torch.equal(before, after)
    torch.testing.assert_close(after, commanded(model, states, targets), rtol=0, atol=0)
    assert torch.equal(answers(twin, states, targets), before)


def test_what_does_not_fit_is_refused_as_command_refuses_it():
    model = make()
    state, target = rows(2).numpy()
    model.command_one(state, target)
    model.network = make((5, 4)).network[:3]  # ends with four states, not three
    with pytest.raises(RuntimeError, match="size"):
        model.command_one(state, target)


@pytest.mark.parametrize("copied", [copy.deepcopy, lambda model: pickle.loads(pickle.dumps(model))])
def test_a_copy_goes_its_own_way(copied):
    model = make()
    states, targets = rows(40), rows(40, seed=1)
    before = answers(model, states, targets)
    twin = copied(model)
    assert torch.equal(answers(twin, states, targets), before)
    write_data(twin)
    assert not torch.equal(answers(twin, states, targets), before)
    assert torch.equal(answers(model, states, targets), before)


def test_an_answer_is_the_callers_own():
    model = hand_set(1.0, (1.0, 2.0))
    state, target = np.float32([0.0]), np.float32([2.0])
    model.command_one(state, target)[:] = 7
    assert model.command_one(state, target) == [2.0]
    assert (state, target) == ([0.0], [2.0])


# What it takes.


def test_any_layout_is_taken_and_nothing_is_compiled_for_it():
    model = make(abstain_below=0)
    state, target = rows(1)[0].numpy(), rows(1, seed=1)[0].numpy()
    wanted = model.command_one(state, target).tolist()
    fixed = state.copy()
    fixed.flags.writeable = False
    spaced = np.repeat(state, 2)[::2]
    odd = np.zeros(4 * STATES + 1, np.uint8)[1:].view(np.float32)
    odd[:] = state
    for given in (fixed, spaced, odd, torch.from_numpy(state), nn.Parameter(torch.tensor(state))):
        assert model.command_one(given, target).tolist() == wanted
    assert model.command_one(state, np.stack([target] * 2, axis=1)[:, 1]).tolist() == wanted
    assert len(kernels.choose.signatures) == 1


@pytest.mark.parametrize(
    ("state", "target", "message"),
    [
        (np.zeros(2, np.float32), np.zeros(3, np.float32), r"expected state .* got .*\[2\]"),
        (np.zeros(3, np.float32), np.zeros((1, 3), np.float32), r"expected target .*\[1, 3\]"),
        (np.zeros(3), np.zeros(3, np.float32), "expected state as a float32 .* got float64"),
        ([0.0, 0.0, 0.0], np.zeros(3, np.float32), "expected state .* got list"),
        (np.zeros(3, np.float32), None, "expected target .* got NoneType"),
        (np.float32([0, math.nan, 0]), np.zeros(3, np.float32), "expected finite states"),
        (np.zeros(3, np.float32), np.float32([0, 0, math.inf]), "expected finite targets"),
    ],
)
def test_a_bad_row_is_refused(state, target, message):
    with pytest.raises(ValueError, match=message):
        make().command_one(state, target)


def test_an_infinite_state_is_refused_even_if_what_follows_is_finite():
    model = hand_set(1.0, (1.0, 2.0))
    model.network[0].weight.data[0, 0] = 0.5
    model.state_high.fill_(4)  # where all beyond it ends up
    with pytest.raises(ValueError, match="expected finite states"):
        model.command_one(np.float32([math.inf]), np.float32([1.0]))


@pytest.mark.parametrize("dtype", [torch.float64, torch.float16])
def test_a_model_in_another_dtype_still_takes_and_gives_float32(dtype):
    model = make().to(dtype)
    states, targets = rows(20), rows(20, seed=1)
    assert model.command_one(states[0].numpy(), targets[0].numpy()).dtype == np.float32
    assert torch.equal(answers(model, states, targets), commanded(model, states, targets))


def test_a_model_that_commands_one_says_so():
    assert isinstance(make(), OneStateForwardModel)
    matrix = TransitionMatrix(TransitionMatrixConfig(1, 1, ((0.0,),)))
    assert isinstance(matrix, ForwardModel)
    assert not isinstance(matrix, OneStateForwardModel)


@pytest.mark.slow
def test_the_model_that_ships_commands_one_as_it_commands_many():
    model = MLPForwardModel.from_pretrained("checkpoints/forward_model")
    generator = torch.Generator().manual_seed(0)
    low, high = model.state_low.float(), model.state_high.float()
    states, targets = (
        low + (high - low) * torch.rand(20_000, 6, generator=generator) ** power for power in (4, 1)
    )
    states[:2000] = low + 0.01 * (states[:2000] - low)  # in the open it abstains
    abstains = answers(model, states, targets).isnan().all(dim=1)
    assert 1000 < abstains.sum() < 10_000
    assert_chosen_alike(model, states, targets)
