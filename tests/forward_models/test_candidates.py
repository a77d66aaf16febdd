"""The choice among candidate actions: by hand, by the tensors a model has now, and what it refuses.

`test_forward_model.py` and `test_transition_matrix.py` are about what the models learn.
"""

from __future__ import annotations

import copy
import dataclasses
import math
import pickle
import sys
import threading
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import torch
from torch import Tensor, nn

from pacnet.core.checkpoint import read_checkpoint, write_checkpoint
from pacnet.forward_models import kernels as compiled
from pacnet.forward_models.mlp import MLPForwardModel, MLPForwardModelConfig
from pacnet.forward_models.protocol import ForwardModel, OneStateForwardModel
from pacnet.forward_models.transition_matrix import TransitionMatrix, TransitionMatrixConfig

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


def matrix() -> TransitionMatrix:
    return TransitionMatrix(TransitionMatrixConfig(1, 1, ((0.0,), (1.0,)), clusters=2))


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


def snapshot(model: nn.Module) -> dict[str, Tensor]:
    return {name: tensor.clone() for name, tensor in model.state_dict().items()}


# The choice, against plain Python.


def led_to(model: MLPForwardModel, state: list[float], action: list[float]) -> list[float]:
    """Where an action leads, number by number in float64."""
    value = {name: buffer.tolist() for name, buffer in model.named_buffers()}
    layers = [(layer.weight.tolist(), layer.bias.tolist()) for layer in model.network[::2]]
    for _ in range(model.config.steps):
        x = [(s - m) / d for s, m, d in zip(state, value["state_mean"], value["state_std"])]  # noqa: B905
        x += [(a - m) / d for a, m, d in zip(action, value["action_mean"], value["action_std"])]  # noqa: B905
        for number, (weight, bias) in enumerate(layers):
            x = [b + sum(w * v for w, v in zip(row, x)) for row, b in zip(weight, bias)]  # noqa: B905
            if number + 1 < len(layers):
                x = [v / (1 + math.exp(-v)) for v in x]
        state = [
            min(max(state[d] + x[d] * value["change_std"][d] + value["change_mean"][d],
                value["state_low"][d]), value["state_high"][d])
            for d in range(len(state))
        ]  # fmt: skip
    return state


def expected(
    model: MLPForwardModel, state: Tensor, target: Tensor
) -> tuple[Tensor, list[float], float]:
    """The action, or NaN, the costs and the spread."""
    candidates = model.candidates.tolist()
    after = [led_to(model, state.tolist(), action) for action in candidates]
    costs = [math.dist(place, target.tolist()) for place in after]
    mean = [sum(column) / len(after) for column in zip(*after, strict=True)]
    spread = math.sqrt(sum(math.dist(place, mean) ** 2 for place in after) / len(after))
    action = torch.tensor(candidates[costs.index(min(costs))])
    too_few = spread < model.config.abstain_below
    return action * math.nan if too_few else action, sorted(costs), spread


def assert_chosen(model: MLPForwardModel, states: Tensor, targets: Tensor) -> Tensor:
    """That it chooses as plain Python does, but where costs, or spread and threshold, are equal."""
    chosen = answers(model, states, targets)
    torch.testing.assert_close(
        chosen, commanded(model, states, targets), rtol=0, atol=0, equal_nan=True
    )
    for row, (state, target) in enumerate(zip(states, targets, strict=True)):
        action, costs, spread = expected(model, state, target)
        selection = model.select(state, target)
        assert selection.costs.sort().values.tolist() == pytest.approx(costs, rel=1e-4, abs=1e-5)
        assert selection.spread == pytest.approx(spread, rel=1e-4, abs=1e-5)
        tied = len(costs) > 1 and costs[1] - costs[0] < 1e-5
        if not tied and abs(spread - model.config.abstain_below) > 1e-5:
            assert torch.equal(chosen[row].isnan(), action.isnan())
            assert torch.equal(chosen[row].nan_to_num(), action.nan_to_num())
    return chosen


@pytest.mark.parametrize("hidden", [(), (5,), (33, 18), (3, 1, 18, 7)])
@pytest.mark.parametrize(("number", "steps"), [(1, 1), (21, 3), (24, 1), (70, 2)])
def test_it_chooses_as_plain_python_does(hidden, number, steps):
    model = make(hidden, number, steps)
    chosen = assert_chosen(model, rows(25), rows(25, seed=1))
    assert number == 1 or len(chosen.unique(dim=0)) > 3


@pytest.mark.parametrize("hidden", [(), (9, 9)])
def test_it_abstains_where_plain_python_does(hidden):
    model = make(hidden, steps=2)
    states, targets = rows(60), rows(60, seed=1)
    spreads = torch.tensor([model.select(*p).spread for p in zip(states, targets, strict=True)])
    model.config = dataclasses.replace(model.config, abstain_below=float(spreads.median()))
    assert 20 < assert_chosen(model, states, targets).isnan().all(dim=1).sum() < 40


def test_what_torch_predicts_is_chosen_from_alike():
    model, replaced = make((64, 64), steps=3), make((64, 64), steps=3)
    replaced.network = nn.Sequential(replaced.network)  # of which kernels know nothing
    states, targets = rows(200), rows(200, seed=1)
    same = (answers(model, states, targets) == answers(replaced, states, targets)).all(dim=1)
    assert same.sum() >= 199  # float32 rounding may decide one
    torch.testing.assert_close(
        model.select(states[0], targets[0]).costs, replaced.select(states[0], targets[0]).costs
    )


def test_equal_costs_go_to_the_first_candidate():
    # From 0 they lead to 3, 1, −1, 1, all but the first at distance 1 from 0.
    model = hand_set(1.0, (3.0, 1.0, -1.0, 1.0))
    assert model.command_one(np.zeros(1, np.float32), np.zeros(1, np.float32)) == [1.0]


@pytest.mark.parametrize(("threshold", "action"), [(0.25, -1.0), (0.2500001, None), (0, -1.0)])
def test_it_abstains_exactly_when_predictions_are_closer_than_the_threshold(threshold, action):
    # From 8, ±1 at gain 1/4 lead to 4 ± 1/4: a spread of 1/4; the target 3 is nearer to the lower.
    model = hand_set(0.25, (1.0, -1.0), abstain_below=threshold)
    assert model.command_one(np.float32([8.0]), np.float32([3.0])) == action


def test_an_action_is_held_for_all_steps_within_the_range():
    # From 8 through 4 + a to 2 + 3a / 2, or, not above 4, through 4 to 2 + a for a > 0.
    model = hand_set(1.0, (-1.0, 0.0, 0.5, 1.0), steps=2)
    state, target = np.float32([8.0]), np.float32([2.75])
    assert model.command_one(state, target) == [0.5]
    model.state_high.fill_(4)
    assert model.command_one(state, np.float32([2.625])) == [0.5]
    assert model.command_one(state, np.float32([2.875])) == [1.0]


@pytest.mark.parametrize("scale", [1e3, 1e30])
def test_saturated_networks_choose_what_leads_nearest_and_overflowing_ones_nothing(scale):
    model = make((7, 6))
    with torch.no_grad():
        model.network[2].weight.mul_(scale)
    for state, target in zip(rows(20) * scale, rows(20, seed=1), strict=True):
        selection = model.select(state, target)
        if scale == 1e3:  # the range bounds the predictions
            assert selection.costs.isfinite().all()
        if selection.costs.isfinite().any():
            assert selection.index == selection.costs.argmin()
        else:  # infinity less infinity on the way
            assert selection.abstained
            assert model.command_one(state, target) is None


def test_a_prediction_that_is_not_a_number_is_not_chosen():
    model = hand_set(1.0, (2.0, 1.0, 0.0))
    model.candidates[0] = math.nan
    model.network = nn.Sequential(model.network)
    after = model.outcomes(torch.zeros(1, 1), model.candidates)
    assert after.isnan().flatten().tolist() == [True, False, False]
    best, costs, spread, abstained = compiled.choose(
        after[0].detach().double().numpy(), np.array([2.0]), 0.0
    )
    assert (best, costs.tolist(), spread, abstained) == (1, [math.inf, 1.0, 2.0], 0.5, False)


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


def transpose_in_place(model: MLPForwardModel) -> None:
    model.network[0].weight.data = model.network[0].weight.data.T  # of 5 inputs and 5 outputs


def replace_candidates(model: MLPForwardModel) -> None:
    model.candidates = model.candidates[:7] + 1


def cut_candidates_in_place(model: MLPForwardModel) -> None:
    model.candidates.data = model.candidates.data[:7]


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
    transpose_in_place,
    replace_candidates,
    cut_candidates_in_place,
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
    like = model.candidates
    wrapped = copy.deepcopy(model)
    wrapped.network = nn.Sequential(wrapped.network)  # what torch says, whatever the network is
    torch.testing.assert_close(after, commanded(wrapped, states.to(like), targets.to(like)))
    assert torch.equal(answers(twin, states, targets), before)


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


def test_a_functional_call_uses_the_tensors_it_is_given():
    class Acting(nn.Module):
        def __init__(self) -> None:
            super().__init__()
            self.body = hand_set(1.0, (1.0, 2.0))

        def forward(self, state: Any, target: Any) -> Any:
            return self.body.command_one(state, target)

    acting, row = Acting(), (np.float32([0.0]), np.float32([2.0]))
    assert acting(*row) == [2.0]
    other = {"body.network.0.weight": torch.tensor([[-0.5, -1.0]])}  # to −1 and −2
    assert torch.func.functional_call(acting, other, row) == [1.0]
    with pytest.raises(RuntimeError, match="shape"):  # torch's own
        torch.func.functional_call(acting, {"body.network.0.weight": torch.zeros(1, 3)}, row)
    assert acting(*row) == [2.0]


# What does not fit together is refused before a kernel sees it.


def shrink_config(model: MLPForwardModel) -> None:
    model.config = dataclasses.replace(model.config, state_dimensions=2)


def cut(name: str) -> Callable[[MLPForwardModel], None]:
    def change(model: MLPForwardModel) -> None:
        setattr(model, name, model.get_buffer(name)[:0])

    return change


def end_elsewhere(model: MLPForwardModel) -> None:
    model.network = make((5, 4)).network[:3]  # ends with four states, not three


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
    model = make()
    state, target = rows(2).numpy()
    if warm:
        model.command_one(state, target)
    change(model)
    for refused in (
        lambda: model.command_one(state, target),
        lambda: model.command(rows(1), rows(1)),
        lambda: model.select(rows(1)[0], rows(1)[0]),
    ):
        with pytest.raises((ValueError, RuntimeError), match=r"expected|size|shape"):
            refused()


@pytest.mark.parametrize("bytes_left", [0, 8])
@pytest.mark.parametrize("name", ["network.0.weight", "state_std", "candidates"])
def test_a_tensor_whose_memory_was_taken_away_is_refused(name, bytes_left):
    model = make()
    tensor = model.get_buffer(name) if "." not in name else model.get_parameter(name)
    tensor.untyped_storage().resize_(bytes_left)
    with pytest.raises(ValueError, match=f"expected the memory of .* got {bytes_left} bytes"):
        model.command_one(*rows(2).numpy())


def test_memory_that_a_kernel_reads_cannot_be_taken_away():
    model = make()
    model.command_one(*rows(2).numpy())
    with pytest.raises(RuntimeError, match="not resizable"):
        model.network[0].weight.untyped_storage().resize_(0)


def test_an_answer_is_the_callers_own():
    model = hand_set(1.0, (1.0, 2.0))
    state, target = np.float32([0.0]), np.float32([2.0])
    model.command_one(state, target)[:] = 7
    assert model.command_one(state, target) == [2.0]
    assert (state, target) == ([0.0], [2.0])


def test_any_layout_is_taken_and_nothing_is_compiled_for_it():
    model = make(abstain_below=0)
    state, target = rows(1)[0].numpy(), rows(1, seed=1)[0].numpy()
    wanted = model.command_one(state, target).tolist()
    signatures = len(compiled.decide.signatures)
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
    assert len(compiled.decide.signatures) == signatures


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
    model, single = make().to(dtype), make()
    states, targets = rows(20), rows(20, seed=1)
    chosen = answers(model, states, targets)
    assert chosen.dtype == torch.float32
    near = (chosen - answers(single, states, targets)).abs().amax(dim=1) < 1e-3
    assert near.sum() >= 19


def test_a_model_that_commands_one_says_so():
    assert isinstance(make(), OneStateForwardModel)
    assert isinstance(matrix(), ForwardModel)
    assert not isinstance(matrix(), OneStateForwardModel)


@pytest.mark.skipif(not torch.cuda.is_available(), reason="needs a GPU")
@pytest.mark.parametrize("model", [make(), matrix()])
def test_on_a_gpu_it_chooses_as_on_the_cpu_and_answers_there(model):
    columns = model.config.state_dimensions
    states, targets = (rows(50, seed)[:, :columns] for seed in (0, 1))
    here, there = model.command(states, targets), copy.deepcopy(model).cuda()
    command = there.command(states.cuda(), targets.cuda())
    assert command.action.is_cuda
    assert command.given.is_cuda
    same = (command.action.cpu().nan_to_num() == here.action.nan_to_num()).all(dim=1)
    assert same.sum() >= 49
    selection = there.select(states[0].cuda(), targets[0].cuda())
    assert selection.action.is_cuda
    assert selection.costs.is_cuda


# Loading is all or nothing.


def another(model: nn.Module) -> dict[str, Tensor]:
    """A state with other values everywhere, and sound."""
    return {name: tensor + 1 for name, tensor in model.state_dict().items()}


def changed(name: str, change: Callable[[Tensor], Any]) -> Callable[[dict[str, Tensor]], object]:
    return lambda state: state.update({name: change(state[name])})


LAST = {"mlp": "network.2.bias", "matrix": "counts"}  # the last one that is copied
SPOILT = {
    "missing": lambda state, last: state.pop(last),
    "extra": lambda state, _: state.update(more=torch.zeros(1)),
    "misshapen": lambda state, last: state.update({last: state[last][None]}),
    "another kind": lambda state, last: state.update({last: state[last].bool()}),
    "not a tensor": lambda state, last: state.update({last: state[last].tolist()}),
}
MEANINGLESS = [
    ("mlp", changed("network.2.bias", lambda tensor: tensor * math.nan), "finite network.2.bias"),
    ("mlp", changed("state_low", lambda tensor: tensor * math.inf), "finite state_low"),
    ("mlp", changed("change_std", torch.zeros_like), "change_std > 0"),
    ("mlp", changed("action_std", torch.neg), "action_std > 0"),
    ("mlp", changed("state_low", lambda tensor: tensor + 9), "state_low ≤ state_high"),
    ("matrix", changed("centroids", lambda tensor: tensor * math.nan), "finite centroids"),
    ("matrix", changed("counts", torch.neg), "counts ≥ 0, got -1"),
]


def assert_refused(model: nn.Module, state: dict[str, Any], message: str) -> None:
    before = snapshot(model)
    with pytest.raises(ValueError, match=f"expected {message}"):
        model.load_state_dict(state)
    assert all(torch.equal(tensor, before[name]) for name, tensor in model.state_dict().items())


@pytest.mark.parametrize("kind", ["mlp", "matrix"])
@pytest.mark.parametrize("spoil", SPOILT)
def test_a_state_of_another_form_is_refused_and_nothing_loaded(kind, spoil):
    model: nn.Module = make() if kind == "mlp" else matrix()
    state = another(model)
    SPOILT[spoil](state, LAST[kind])
    assert_refused(model, state, f"the tensors of|{LAST[kind]} of")
    model.load_state_dict(another(model))


@pytest.mark.parametrize(("kind", "spoil", "message"), MEANINGLESS)
def test_a_state_that_means_nothing_is_refused_and_nothing_loaded(kind, spoil, message, tmp_path):
    model: Any = make() if kind == "mlp" else matrix()
    state = another(model)
    spoil(state)
    assert_refused(model, state, message)
    parent = nn.ModuleDict({"body": model})
    assert_refused(parent, {f"body.{name}": tensor for name, tensor in state.items()}, message)
    model.save_pretrained(tmp_path)
    write_checkpoint(tmp_path, read_checkpoint(tmp_path)[0], state)
    with pytest.raises(ValueError, match=f"expected {message}"):
        type(model).from_pretrained(tmp_path)


def test_a_part_of_a_state_can_be_loaded_if_asked_for():
    model = make()
    model.load_state_dict({"state_mean": torch.ones(3), "more": torch.zeros(1)}, strict=False)
    assert model.state_mean.tolist() == [1.0] * 3


@pytest.mark.parametrize(
    ("model", "fields", "named"),
    [
        (make(), {"state_dimensions": 10**7}, "(network|state)"),
        (make(), {"hidden": [10**9]}, "network"),
        (make(), {"hidden": [10**12, 10**12]}, "sizes"),
        (make(), {"hidden": [10**30]}, "sizes"),
        (matrix(), {"state_dimensions": 10**9}, "centroids"),
        (matrix(), {"clusters": 10**8}, "(centroids|counts)"),
        (matrix(), {"clusters": 10**12}, "sizes"),
    ],
)
def test_sizes_that_a_config_only_declares_take_no_memory(model, fields, named, tmp_path):
    model.save_pretrained(tmp_path)
    config, tensors = read_checkpoint(tmp_path)
    write_checkpoint(tmp_path, config | fields, tensors)
    with pytest.raises(ValueError, match=f"expected {named}"):
        type(model).from_pretrained(tmp_path)


# Acting beside fitting.


def test_who_acts_beside_a_fit_knows_all_of_the_old_or_all_of_the_new():
    candidates = (0.0, 1.0, 2.0, 7.0)
    old, new, acting = (hand_set(1.0, candidates, steps=200) for _ in range(3))
    new.network[0].weight.data[0, 1] = -1
    new.action_mean.fill_(3)
    # In the end the old leads to 2a, so for 4 it takes 2, and the new to 2 (3 - a), so 1. Half of
    # each would lead to -2a or 2 (a - 3), so to 0 or 7.
    states, row = (old.state_dict(), new.state_dict()), (np.float32([0.0]), np.float32([4.0]))
    stop, interval = threading.Event(), sys.getswitchinterval()

    def load() -> None:
        while not stop.is_set():
            for state in states:
                acting.load_state_dict(state)  # as `fit` does

    thread = threading.Thread(target=load)
    sys.setswitchinterval(1e-6)
    thread.start()
    try:
        seen = {acting.command_one(*row).item() for _ in range(1000)}
    finally:
        stop.set()
        thread.join()
        sys.setswitchinterval(interval)
    assert seen == {1.0, 2.0}
