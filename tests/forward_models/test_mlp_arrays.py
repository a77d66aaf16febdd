"""The kernel reads the tensors that the model has now, and only those that fit together."""

from __future__ import annotations

import copy
import dataclasses
import pickle
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import torch
from candidate_models import (
    ACTIONS,
    STATES,
    command_one_by_one,
    command_rows,
    hand_set,
    random_model,
    random_rows,
)
from torch import Tensor, nn

from pacnet.forward_models import kernels
from pacnet.forward_models.mlp import MLPForwardModel


def learn(model: MLPForwardModel) -> None:
    states = random_rows(100)
    actions = torch.randn(100, ACTIONS, generator=torch.Generator().manual_seed(9))
    model.fit(states, actions, states - 0.5 * actions[:, [0, 1, 0]], seed=0)


def descend(model: MLPForwardModel) -> None:
    optimiser = torch.optim.SGD(model.parameters(), lr=1.0)
    model(random_rows(21), model.candidates).sum().backward()
    optimiser.step()


def write_data(model: MLPForwardModel) -> None:
    model.network[2].bias.data[0] -= 3


def transpose_in_place(model: MLPForwardModel) -> None:
    model.network[0].weight.data = model.network[0].weight.data.T  # of 5 inputs and 5 outputs


def replace_candidates(model: MLPForwardModel) -> None:
    model.candidates = model.candidates[:7] + 1


def cut_candidates_in_place(model: MLPForwardModel) -> None:
    model.candidates.data = model.candidates.data[:7]


def replace_weight(model: MLPForwardModel) -> None:
    model.network[0].weight = nn.Parameter(-model.network[0].weight.detach())


def replace_network(model: MLPForwardModel) -> None:
    model.network = random_model((9, 4), number=3).network


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
    transpose_in_place,
    replace_candidates,
    cut_candidates_in_place,
    replace_weight,
    replace_network,
    replace_config,
    replace_normaliser,
    drop_bias,
    parametrize,
    lambda model: model.load_state_dict(random_model(number=8).state_dict()),
    lambda model: model.state_mean.add_(1),
    lambda model: model.state_high.fill_(0),
    lambda model: model.network.__setitem__(1, nn.Tanh()),
    lambda model: model.network.append(nn.SiLU()),
    lambda model: model.double().network[2].bias.data.sub_(3),
    lambda model: model.double().half().float().network[2].bias.data.sub_(3),
]


@pytest.mark.parametrize("change", CHANGES)
def test_every_change_of_a_model_changes_its_commands(
    change: Callable[[MLPForwardModel], object],
):
    model = random_model()
    states, targets = random_rows(40), random_rows(40, seed=1)
    before = command_one_by_one(model, states, targets)
    untouched = copy.deepcopy(model)
    change(model)
    after = command_one_by_one(model, states, targets)
    assert not torch.equal(before, after)
    like = model.candidates
    wrapped = copy.deepcopy(model)
    wrapped.network = nn.Sequential(wrapped.network)  # predicts by torch, whatever the layers
    torch.testing.assert_close(after, command_rows(wrapped, states.to(like), targets.to(like)))
    assert torch.equal(command_one_by_one(untouched, states, targets), before)


@pytest.mark.parametrize("copied", [copy.deepcopy, lambda model: pickle.loads(pickle.dumps(model))])
def test_a_copy_is_independent(copied):
    model = random_model()
    states, targets = random_rows(40), random_rows(40, seed=1)
    before = command_one_by_one(model, states, targets)
    other = copied(model)
    assert torch.equal(command_one_by_one(other, states, targets), before)
    write_data(other)
    assert not torch.equal(command_one_by_one(other, states, targets), before)
    assert torch.equal(command_one_by_one(model, states, targets), before)


def test_a_functional_call_uses_the_tensors_it_is_given():
    class Acting(nn.Module):
        def __init__(self) -> None:
            super().__init__()
            self.body = hand_set(1.0, ((1.0,), (2.0,)))

        def forward(self, state: Any, target: Any) -> Any:
            return self.body.command_one(state, target)

    acting, row = Acting(), (np.float32([0.0]), np.float32([2.0]))
    assert acting(*row) == [2.0]
    other = {"body.network.0.weight": torch.tensor([[-0.5, -1.0]])}  # to −1 and −2
    assert torch.func.functional_call(acting, other, row) == [1.0]
    with pytest.raises(RuntimeError, match="shape"):  # torch's own
        torch.func.functional_call(acting, {"body.network.0.weight": torch.zeros(1, 3)}, row)
    assert acting(*row) == [2.0]


# Tensors that do not fit together.


def shrink_config(model: MLPForwardModel) -> None:
    model.config = dataclasses.replace(model.config, state_dimensions=2)


def cut(name: str) -> Callable[[MLPForwardModel], None]:
    def change(model: MLPForwardModel) -> None:
        setattr(model, name, model.get_buffer(name)[:0])

    return change


def end_elsewhere(model: MLPForwardModel) -> None:
    model.network = random_model((5, 4)).network[:3]  # ends with four states, not three


def cut_weight_in_place(model: MLPForwardModel) -> None:
    model.network[0].weight.data = model.network[0].weight.data[:2]


def lose_dimensions(model: MLPForwardModel) -> None:
    model.candidates = model.candidates[0, 0]


@pytest.mark.parametrize(
    "change",
    [
        shrink_config,
        cut("candidates"),
        cut("state_mean"),
        end_elsewhere,
        cut_weight_in_place,
        lose_dimensions,
    ],
)
@pytest.mark.parametrize("warm", [False, True])
def test_tensors_that_do_not_fit_are_refused(change, warm):
    model = random_model()
    state, target = random_rows(2).numpy()
    if warm:
        model.command_one(state, target)
    change(model)
    for refused in (
        lambda: model.command_one(state, target),
        lambda: model.command(random_rows(1), random_rows(1)),
        lambda: model.select(random_rows(1)[0], random_rows(1)[0]),
    ):
        with pytest.raises((ValueError, RuntimeError), match=r"expected|size|shape"):
            refused()


@pytest.mark.parametrize("bytes_left", [0, 8])
@pytest.mark.parametrize("name", ["network.0.weight", "state_std", "candidates"])
def test_a_tensor_without_its_memory_is_refused(name, bytes_left):
    model = random_model()
    tensor = model.get_buffer(name) if "." not in name else model.get_parameter(name)
    tensor.untyped_storage().resize_(bytes_left)
    with pytest.raises(ValueError, match=f"expected a tensor .* in memory, got {bytes_left} bytes"):
        model.command_one(*random_rows(2).numpy())


def test_memory_that_a_kernel_reads_cannot_be_resized():
    model = random_model()
    model.command_one(*random_rows(2).numpy())
    with pytest.raises(RuntimeError, match="not resizable"):
        model.network[0].weight.untyped_storage().resize_(0)


def test_other_layouts_are_accepted_without_compiling_again():
    model = random_model(abstain_below=0)
    state, target = random_rows(1)[0].numpy(), random_rows(1, seed=1)[0].numpy()
    wanted = model.command_one(state, target).tolist()
    signatures = len(kernels.decide.signatures)
    fixed = state.copy()
    fixed.flags.writeable = False
    spaced = np.repeat(state, 2)[::2]
    odd = np.zeros(4 * STATES + 1, np.uint8)[1:].view(np.float32)
    odd[:] = state
    for given in (fixed, spaced, odd, torch.from_numpy(state), nn.Parameter(torch.tensor(state))):
        assert model.command_one(given, target).tolist() == wanted
    assert model.command_one(state, np.stack([target] * 2, axis=1)[:, 1]).tolist() == wanted
    columns = torch.stack([torch.from_numpy(state)] * 2, dim=1).T  # [2, S], strided
    assert (
        model.command(columns, torch.from_numpy(target).expand(2, -1)).action[0].tolist() == wanted
    )
    assert len(kernels.decide.signatures) == signatures
