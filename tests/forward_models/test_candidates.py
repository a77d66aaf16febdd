"""The choice among candidate actions: by hand, against plain Python, and what it refuses.

`test_mlp.py` and `test_transition_matrix.py` test what the models learn.
"""

from __future__ import annotations

import copy
import dataclasses
import json
import math
import pickle
import sys
import threading
from collections.abc import Callable
from dataclasses import asdict
from typing import Any

import numpy as np
import pytest
import torch
from candidate_models import (
    command_one_by_one,
    command_rows,
    hand_set,
    random_model,
    random_rows,
    small_matrix,
    snapshot,
)
from torch import Tensor, nn

from pacnet.core.checkpoint import read_checkpoint, write_checkpoint
from pacnet.forward_models import kernels
from pacnet.forward_models.config import MLPForwardModelConfig, TransitionMatrixConfig
from pacnet.forward_models.mlp import MLPForwardModel
from pacnet.forward_models.protocol import Command, ForwardModel, OneStateForwardModel
from pacnet.forward_models.transition_matrix import TransitionMatrix


def test_three_members_make_a_forward_model():
    class Mine:
        action_dimensions = 1

        def command(self, states: Tensor, targets: Tensor) -> Command:
            return Command(targets - states, torch.ones(len(states), dtype=torch.bool))

        def reset(self) -> None:
            pass

    assert isinstance(Mine(), ForwardModel)
    assert isinstance(random_model(), ForwardModel)
    assert isinstance(small_matrix(), ForwardModel)
    assert not isinstance(torch.nn.Linear(1, 1), ForwardModel)


def test_the_old_name_of_a_commands_field_warns():
    action, has_action = torch.zeros(1, 1), torch.ones(1, dtype=torch.bool)
    with pytest.warns(DeprecationWarning, match="given is now has_action"):
        command = Command(action=action, given=has_action)
    with pytest.warns(DeprecationWarning, match="given is now has_action"):
        assert command.given is command.has_action is has_action
    assert pickle.loads(pickle.dumps(command))._fields == ("action", "has_action")


# The choice by hand: from state x, action a leads to x / 2 + gain × a.


def test_costs_choice_and_spread_by_hand():
    # gain 1, from 4: TURNS lead to 1, 2, 4. Their mean is 7/3 and they lie 4/3, 1/3, 5/3 from it.
    selection = hand_set(1.0).select(torch.tensor([4.0]), torch.tensor([1.75]))
    assert selection.costs.tolist() == [0.75, 0.25, 2.25]
    assert (selection.index, selection.action.tolist()) == (1, [0.0])
    assert selection.spread == pytest.approx(math.sqrt((16 + 1 + 25) / 9 / 3))
    assert not selection.abstained


def test_a_single_candidate_is_chosen_only_without_a_threshold():
    for threshold, has_action in ((0.0, True), (1e-6, False)):
        model = hand_set(1.0, ((2.0,),), abstain_below=threshold)
        assert model.command(torch.zeros(1, 1), torch.zeros(1, 1)).has_action.tolist() == [
            has_action
        ]


def test_a_command_is_a_selection_for_each_state():
    model = hand_set(1.0, abstain_below=0.5)
    model.network[0].weight.data[0, 1] = 0  # no effect of the action
    halves = torch.tensor([[4.0], [-2.0], [0.5]])
    assert not model.command(halves, halves).has_action.any()
    model.network[0].weight.data[0, 1] = 1
    command = model.command(halves, halves)
    for row, state in enumerate(halves):
        assert torch.equal(command.action[row], model.select(state, state).action)
    assert command.action.tolist() == [[2.0], [-1.0], [0.0]]  # 4→2+2, −2→−1−1, ½→¼+0


def test_ties_go_to_the_lowest_index():
    # From 0 the candidates lead to 3, 1, −1, 1: all but the first are at distance 1 from 0.
    model = hand_set(1.0, ((3.0,), (1.0,), (-1.0,), (1.0,)))
    assert model.select(torch.zeros(1), torch.zeros(1)).index == 1
    assert model.command_one(np.zeros(1, np.float32), np.zeros(1, np.float32)) == [1.0]
    offered = torch.tensor([[-1.0], [1.0], [1.0]])
    assert model.select(torch.zeros(1), torch.ones(1), offered).index == 1


@pytest.mark.parametrize(("threshold", "abstains"), [(0.25, False), (0.2500001, True), (0, False)])
def test_it_abstains_exactly_when_the_spread_is_below_the_threshold(threshold, abstains):
    # From 8, ±1 at gain 1/4 lead to 4 ± 1/4: a spread of 1/4; the target 3 is nearer to the lower.
    model = hand_set(0.25, ((1.0,), (-1.0,)), abstain_below=threshold)
    state, target = torch.tensor([8.0]), torch.tensor([3.0])
    selection = model.select(state, target)
    assert selection.spread == 0.25
    assert selection.abstained == abstains
    assert selection.action.tolist() == [-1.0]  # the nearest one also if the model abstains
    command = model.command(state[None], target[None])
    assert command.has_action.tolist() == [not abstains]
    assert command.action.isnan().tolist() == [[abstains]]
    assert model.command_one(state, target) == (None if abstains else [-1.0])


def test_an_action_is_held_for_all_steps_within_the_range():
    # From 8 through 4 + a to 2 + 3a / 2, or, not above 4, through 4 to 2 + a for a > 0.
    model = hand_set(1.0, ((-1.0,), (0.0,), (0.5,), (1.0,)), steps=2)
    state, target = np.float32([8.0]), np.float32([2.75])
    assert model.command_one(state, target) == [0.5]
    model.state_high.fill_(4)
    assert model.command_one(state, np.float32([2.625])) == [0.5]
    assert model.command_one(state, np.float32([2.875])) == [1.0]


# The choice against plain Python.


def plain_prediction(
    model: MLPForwardModel, state: list[float], action: list[float]
) -> list[float]:
    """The state after an action, number by number in float64."""
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
    after = [plain_prediction(model, state.tolist(), action) for action in candidates]
    costs = [math.dist(place, target.tolist()) for place in after]
    mean = [sum(column) / len(after) for column in zip(*after, strict=True)]
    spread = math.sqrt(sum(math.dist(place, mean) ** 2 for place in after) / len(after))
    action = torch.tensor(candidates[costs.index(min(costs))])
    too_few = spread < model.config.abstain_below
    return action * math.nan if too_few else action, sorted(costs), spread


def assert_chosen(model: MLPForwardModel, states: Tensor, targets: Tensor) -> Tensor:
    """Compare with plain Python, unless costs, or spread and threshold, are nearly equal."""
    chosen = command_one_by_one(model, states, targets)
    torch.testing.assert_close(
        chosen, command_rows(model, states, targets), rtol=0, atol=0, equal_nan=True
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
    model = random_model(hidden, number, steps)
    chosen = assert_chosen(model, random_rows(25), random_rows(25, seed=1))
    assert number == 1 or len(chosen.unique(dim=0)) > 3


@pytest.mark.parametrize("hidden", [(), (9, 9)])
def test_it_abstains_where_plain_python_does(hidden):
    model = random_model(hidden, steps=2)
    states, targets = random_rows(60), random_rows(60, seed=1)
    spreads = torch.tensor([model.select(*p).spread for p in zip(states, targets, strict=True)])
    model.config = dataclasses.replace(model.config, abstain_below=float(spreads.median()))
    assert 20 < assert_chosen(model, states, targets).isnan().all(dim=1).sum() < 40


def test_torch_and_the_kernel_choose_the_same():
    model, replaced = random_model((64, 64), steps=3), random_model((64, 64), steps=3)
    replaced.network = nn.Sequential(replaced.network)  # not supported by the kernel
    states, targets = random_rows(200), random_rows(200, seed=1)
    same = (
        command_one_by_one(model, states, targets) == command_one_by_one(replaced, states, targets)
    ).all(dim=1)
    assert same.sum() >= 199  # float32 rounding may decide one
    torch.testing.assert_close(
        model.select(states[0], targets[0]).costs, replaced.select(states[0], targets[0]).costs
    )


@pytest.mark.parametrize("scale", [1e3, 1e30])
def test_saturated_networks_still_choose_and_overflowing_ones_abstain(scale):
    model = random_model((7, 6))
    with torch.no_grad():
        model.network[2].weight.mul_(scale)
    for state, target in zip(random_rows(20) * scale, random_rows(20, seed=1), strict=True):
        selection = model.select(state, target)
        if scale == 1e3:  # the range bounds the predictions
            assert selection.costs.isfinite().all()
        if selection.costs.isfinite().any():
            assert selection.index == selection.costs.argmin()
        else:  # infinity minus infinity
            assert selection.abstained
            assert model.command_one(state, target) is None


def test_a_prediction_that_is_not_a_number_is_not_chosen():
    model = hand_set(1.0, ((2.0,), (1.0,), (0.0,)))
    model.candidates[0] = math.nan
    model.network = nn.Sequential(model.network)
    after = model.outcomes(torch.zeros(1, 1), model.candidates)
    assert after.isnan().flatten().tolist() == [True, False, False]
    best, costs, spread, abstained = kernels.choose(
        after[0].detach().double().numpy(), np.array([2.0]), 0.0
    )
    assert (best, costs.tolist(), spread, abstained) == (1, [math.inf, 1.0, 2.0], 0.5, False)


# One state at a time, other types and devices.


def test_a_returned_action_is_a_copy():
    model = hand_set(1.0, ((1.0,), (2.0,)))
    state, target = np.float32([0.0]), np.float32([2.0])
    model.command_one(state, target)[:] = 7
    assert model.command_one(state, target) == [2.0]
    assert (state, target) == ([0.0], [2.0])


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
        random_model().command_one(state, target)


def test_an_infinite_state_is_refused_even_if_its_prediction_is_finite():
    model = hand_set(1.0, ((1.0,), (2.0,)))
    model.network[0].weight.data[0, 0] = 0.5
    model.state_high.fill_(4)  # so that the predicted state is finite
    with pytest.raises(ValueError, match="expected finite states"):
        model.command_one(np.float32([math.inf]), np.float32([1.0]))


@pytest.mark.parametrize("dtype", [torch.float64, torch.float16])
def test_a_model_in_another_dtype_still_takes_and_gives_float32(dtype):
    model, single = random_model().to(dtype), random_model()
    states, targets = random_rows(20), random_rows(20, seed=1)
    chosen = command_one_by_one(model, states, targets)
    assert chosen.dtype == torch.float32
    near = (chosen - command_one_by_one(single, states, targets)).abs().amax(dim=1) < 1e-3
    assert near.sum() >= 19


def test_only_the_mlp_is_a_one_state_forward_model():
    assert isinstance(random_model(), OneStateForwardModel)
    assert isinstance(small_matrix(), ForwardModel)
    assert not isinstance(small_matrix(), OneStateForwardModel)


@pytest.mark.skipif(not torch.cuda.is_available(), reason="needs a GPU")
@pytest.mark.parametrize("model", [random_model(), small_matrix()])
def test_on_a_gpu_it_chooses_as_on_the_cpu(model):
    columns = model.config.state_dimensions
    states, targets = (random_rows(50, seed)[:, :columns] for seed in (0, 1))
    here, there = model.command(states, targets), copy.deepcopy(model).cuda()
    command = there.command(states.cuda(), targets.cuda())
    assert command.action.is_cuda
    assert command.has_action.is_cuda
    same = (command.action.cpu().nan_to_num() == here.action.nan_to_num()).all(dim=1)
    assert same.sum() >= 49
    selection = there.select(states[0].cuda(), targets[0].cuda())
    assert selection.action.is_cuda
    assert selection.costs.is_cuda


# Invalid input.


def both_models() -> tuple[MLPForwardModel, TransitionMatrix]:
    mlp, matrix = (
        config(2, 2, ((0.0, 0.0),)) for config in (MLPForwardModelConfig, TransitionMatrixConfig)
    )
    return MLPForwardModel(mlp), TransitionMatrix(matrix)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((torch.zeros(3), torch.zeros(2)), r"expected states .* got shape \[1, 3\]"),
        ((torch.zeros(2), torch.zeros(1, 2)), r"expected target .* got shape \[1, 1, 2\]"),
        ((torch.zeros(2), [0.0, 0.0]), "expected target .* got list"),
        ((None, torch.zeros(2)), "expected states .* got NoneType"),
        ((torch.zeros(2), torch.full((2,), math.inf)), "expected finite target"),
        ((torch.zeros(2), torch.zeros(2), torch.zeros(4, 1)), "expected candidates .*4, 1"),
        ((torch.zeros(2), torch.zeros(2), torch.zeros(0, 2)), "candidates .* got an empty one"),
    ],
)
def test_a_selection_refuses_bad_input(arguments, message):
    for model in both_models():
        with pytest.raises(ValueError, match=message):
            model.select(*arguments)


def test_unequal_numbers_of_rows_are_refused():
    for model in both_models():
        for verb in (model.command, model.predict):
            with pytest.raises(ValueError, match="expected equally many rows"):
                verb(torch.zeros(2, 2), torch.zeros(1, 2))


@pytest.mark.parametrize(
    ("field", "value", "message"),
    [
        ("state_dimensions", 0, "state_dimensions ≥ 1, got 0"),
        ("action_dimensions", 1.0, "action_dimensions ≥ 1, got 1.0"),
        ("candidates", (), "candidates to be one or more actions"),
        ("candidates", ((0.0,), (0.0, 1.0)), "candidates to be"),
        ("candidates", ((math.nan, 0.0),), "candidates to be"),
        ("candidates", "ab", "candidates to be"),
        ("steps", 0, "steps ≥ 1, got 0"),
        ("abstain_below", -0.1, "abstain_below ≥ 0 and finite, got -0.1"),
        ("abstain_below", math.nan, "abstain_below ≥ 0"),
        ("hidden", (8, 0), "hidden to be a tuple of widths ≥ 1"),
        ("hidden", 64, "hidden to be"),
        ("clusters", 0, "clusters ≥ 1, got 0"),
    ],
)
def test_a_bad_config_is_refused(field, value, message):
    sound = {"state_dimensions": 1, "action_dimensions": 2, "candidates": ((0.0, 0.0),)}
    for kind in (MLPForwardModelConfig, TransitionMatrixConfig):
        assert kind(**sound).candidates == ((0.0, 0.0),)
        if field in kind.__dataclass_fields__:
            with pytest.raises(ValueError, match=f"{kind.__name__}.{message}"):
                kind(**sound | {field: value})


def test_a_config_survives_json():
    for config in (
        MLPForwardModelConfig(1, 2, ((0.0, 1.0), (2, 3)), hidden=(8, 4), steps=3),
        TransitionMatrixConfig(1, 2, [[0, 1], [2, 3]], clusters=5),
    ):
        again = type(config)(**json.loads(json.dumps(asdict(config))))
        assert again == config
        assert hash(again) == hash(config)


# Loading is all or nothing.


def other_state(model: nn.Module) -> dict[str, Tensor]:
    """A valid state with other values everywhere."""
    return {name: tensor + 1 for name, tensor in model.state_dict().items()}


def changed(name: str, change: Callable[[Tensor], Any]) -> Callable[[dict[str, Tensor]], object]:
    return lambda state: state.update({name: change(state[name])})


LAST = {"mlp": "network.2.bias", "matrix": "counts"}  # the last one that is copied
WRONG_FORM = {
    "missing": lambda state, last: state.pop(last),
    "extra": lambda state, _: state.update(more=torch.zeros(1)),
    "misshapen": lambda state, last: state.update({last: state[last][None]}),
    "another kind": lambda state, last: state.update({last: state[last].bool()}),
    "not a tensor": lambda state, last: state.update({last: state[last].tolist()}),
}
INVALID = [
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
@pytest.mark.parametrize("spoil", WRONG_FORM)
def test_tensors_of_another_form_are_refused_and_nothing_is_loaded(kind, spoil):
    model: nn.Module = random_model() if kind == "mlp" else small_matrix()
    state = other_state(model)
    WRONG_FORM[spoil](state, LAST[kind])
    assert_refused(model, state, f"the tensors of|{LAST[kind]} of")
    model.load_state_dict(other_state(model))


@pytest.mark.parametrize(("kind", "spoil", "message"), INVALID)
def test_invalid_values_are_refused_and_nothing_is_loaded(kind, spoil, message, tmp_path):
    model: Any = random_model() if kind == "mlp" else small_matrix()
    state = other_state(model)
    spoil(state)
    assert_refused(model, state, message)
    parent = nn.ModuleDict({"body": model})
    assert_refused(parent, {f"body.{name}": tensor for name, tensor in state.items()}, message)
    model.save_pretrained(tmp_path)
    write_checkpoint(tmp_path, read_checkpoint(tmp_path)[0], state)
    with pytest.raises(ValueError, match=f"expected {message}"):
        type(model).from_pretrained(tmp_path)


def test_part_of_a_state_can_be_loaded_if_not_strict():
    model = random_model()
    model.load_state_dict({"state_mean": torch.ones(3), "more": torch.zeros(1)}, strict=False)
    assert model.state_mean.tolist() == [1.0] * 3


@pytest.mark.parametrize(
    ("model", "fields", "named"),
    [
        (random_model(), {"state_dimensions": 10**7}, "(network|state)"),
        (random_model(), {"hidden": [10**9]}, "network"),
        (random_model(), {"hidden": [10**12, 10**12]}, "sizes"),
        (random_model(), {"hidden": [10**30]}, "sizes"),
        (small_matrix(), {"state_dimensions": 10**9}, "centroids"),
        (small_matrix(), {"clusters": 10**8}, "(centroids|counts)"),
        (small_matrix(), {"clusters": 10**12}, "sizes"),
    ],
)
def test_a_config_with_huge_sizes_is_refused_before_memory_is_taken(model, fields, named, tmp_path):
    model.save_pretrained(tmp_path)
    config, tensors = read_checkpoint(tmp_path)
    write_checkpoint(tmp_path, config | fields, tensors)
    with pytest.raises(ValueError, match=f"expected {named}"):
        type(model).from_pretrained(tmp_path)


def test_during_a_load_a_command_uses_all_old_or_all_new_tensors():
    candidates = ((0.0,), (1.0,), (2.0,), (7.0,))
    old, new, acting = (hand_set(1.0, candidates, steps=200) for _ in range(3))
    new.network[0].weight.data[0, 1] = -1
    new.action_mean.fill_(3)
    # The old model leads to 2a in the end, so for 4 it chooses 2; the new one to 2 (3 - a), so 1.
    # A mixture of both would lead to -2a or 2 (a - 3), and choose 0 or 7.
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
        seen: set[float] = set()
        for count in range(
            100_000
        ):  # until the other thread has had its turn, at least 1,000 times
            seen.add(acting.command_one(*row).item())
            if count >= 1000 and len(seen) > 1:
                break
    finally:
        stop.set()
        thread.join()
        sys.setswitchinterval(interval)
    assert seen == {1.0, 2.0}
