"""The learned forward model and its fit, on systems whose answer is known."""

from __future__ import annotations

import itertools
import math
import signal
import statistics
from fractions import Fraction

import pytest
import torch
from candidate_models import TURNS, hand_set, snapshot
from torch import Tensor

from pacnet.core.checkpoint import read_checkpoint, write_checkpoint
from pacnet.forward_models import fitting
from pacnet.forward_models.config import MLPForwardModelConfig, TransitionMatrixConfig
from pacnet.forward_models.mlp import MLPForwardModel
from pacnet.forward_models.transition_matrix import TransitionMatrix


def linear_system(rows: int, seed: int) -> tuple[Tensor, Tensor, Tensor]:
    """States (x, y) that go to (7/8 x + a / 2, y − b / 4) by random actions (a, b)."""
    generator = torch.Generator().manual_seed(seed)
    states = torch.rand(rows, 2, generator=generator) * 2 - 1
    actions = torch.rand(rows, 2, generator=generator) * 2 - 1
    gains = torch.tensor([0.5, -0.25])
    return states, actions, states + gains * actions - torch.tensor([0.125, 0.0]) * states


def linear_model(**fields: float) -> MLPForwardModel:
    corners = tuple(itertools.product((-1.0, 1.0), repeat=2))
    return MLPForwardModel(MLPForwardModelConfig(2, 2, corners, hidden=(16,), **fields))


@pytest.fixture(scope="module")
def fitted() -> MLPForwardModel:
    model = linear_model()
    report = model.fit(*linear_system(1000, seed=0), seed=0)
    assert report.r2.min() > 0.999
    return model


def same(one: dict[str, Tensor], other: dict[str, Tensor]) -> bool:
    return list(one) == list(other) and all(torch.equal(one[name], other[name]) for name in one)


def test_cost_is_the_euclidean_distance_over_all_dimensions(fitted):
    # From (0, 0): (±1, ±1) lead to (±.5, ∓.25). Target (.5, .75): (1, −1) is .5 away, the nearest.
    selection = fitted.select(torch.zeros(2), torch.tensor([0.5, 0.75]))
    expected = [math.hypot(1, 0.5), math.hypot(1, 1), 0.5, 1.0]
    assert selection.costs.tolist() == pytest.approx(expected, abs=0.02)
    assert (selection.index, selection.action.tolist()) == (2, [1.0, -1.0])
    assert selection.spread == pytest.approx(math.hypot(0.5, 0.25), abs=0.02)


def test_the_fitted_model_chooses_what_the_known_system_would(fitted):
    # Corner (a, b) leads to .875 x + .5 a, y − .25 b; so a is the sign of what is left in x.
    states, *_ = linear_system(200, seed=1)
    targets, *_ = linear_system(200, seed=2)
    left = targets - states * torch.tensor([0.875, 1.0])
    clear = (left.abs() > 0.05).all(dim=1)  # rounding and the fit's error decide nothing there
    assert clear.sum() > 100
    command = fitted.command(states, targets)
    assert command.has_action.all()
    assert torch.equal(command.action[clear], torch.sign(left * torch.tensor([1.0, -1.0]))[clear])


def test_the_order_of_candidates_only_orders_the_costs(fitted):
    state, target = torch.tensor([0.3, -0.2]), torch.tensor([0.0, 0.1])
    candidates = torch.tensor([[0.1, 0.2], [-0.7, 0.9], [0.8, -0.4], [0.0, 0.0], [-1.0, -1.0]])
    order = torch.tensor([3, 0, 4, 1, 2])
    plain = fitted.select(state, target, candidates)
    mixed = fitted.select(state, target, candidates[order])
    torch.testing.assert_close(mixed.costs, plain.costs[order])
    assert torch.equal(mixed.action, plain.action)
    assert int(order[mixed.index]) == plain.index
    assert mixed.spread == pytest.approx(plain.spread)


def test_an_action_is_held_for_all_steps():
    # x ← x / 2 + a twice: 8 → 4 + a → 2 + 3a / 2.
    once, twice = hand_set(1.0), hand_set(1.0, steps=2)
    states, actions = torch.full((3, 1), 8.0), torch.tensor(TURNS)
    assert twice.predict(states, actions).tolist() == [[0.5], [2.0], [5.0]]
    again = once.predict(once.predict(states, actions), actions)
    assert torch.equal(twice.predict(states, actions), again)
    assert twice.select(states[0], torch.tensor([1.0])).costs.tolist() == [0.5, 1.0, 4.0]
    assert torch.equal(twice(states, actions), once(states, actions))  # of one step, always


def test_gradient_reaches_action_and_weights_but_not_a_choice(fitted):
    states, actions = torch.zeros(1, 2), torch.zeros(1, 2, requires_grad=True)
    (gradient,) = torch.autograd.grad(fitted.predict(states, actions)[:, 0].sum(), actions)
    assert gradient[0].tolist() == pytest.approx([0.5, 0.0], abs=0.05)
    assert all(parameter.requires_grad for parameter in fitted.parameters())
    chosen = fitted.select(states[0], states[0], actions)
    assert not chosen.costs.requires_grad
    assert not chosen.action.requires_grad


def test_without_anything_to_learn_the_model_equals_persistence():
    generator = torch.Generator().manual_seed(0)
    states, actions, noise = (torch.randn(1000, 1, generator=generator) for _ in range(3))
    model = MLPForwardModel(MLPForwardModelConfig(1, 1, TURNS, hidden=(16,)))
    report = model.fit(states, actions, states + 0.1 * noise, seed=0)
    assert abs(float(report.r2)) < 0.05


def test_reported_r2_is_that_of_the_rows_held_out():
    states, actions, after = linear_system(300, seed=3)
    model = linear_model()
    report = model.fit(states, actions, after, seed=1)
    rows = report.validation_rows
    with torch.no_grad():
        error = (after - states - model(states, actions))[rows].double().square().sum(dim=0)
    total = (after - states)[rows].double().square().sum(dim=0)
    assert report.r2.tolist() == pytest.approx((1 - error / total).tolist(), abs=1e-6)


def test_normalisers_are_exact_far_from_zero():
    generator = torch.Generator().manual_seed(0)
    states = 1e3 + 0.1 * torch.randn(200, 1, generator=generator)
    actions = torch.full((200, 1), 0.73)
    after = 1e3 + 0.1 * torch.randn(200, 1, generator=generator)
    model = MLPForwardModel(MLPForwardModelConfig(1, 1, TURNS, hidden=(4,)))
    report = model.fit(states, actions, after, seed=0)
    learning = sorted(set(range(200)) - set(report.validation_rows.tolist()))
    exact = [Fraction(value) for value in states[learning, 0].tolist()]
    changes = [Fraction(b) - a for a, b in zip(exact, after[learning, 0].tolist(), strict=True)]
    for name, values in (("state", exact), ("change", changes)):
        mean, std = (model.get_buffer(f"{name}_{what}") for what in ("mean", "std"))
        assert mean.dtype == std.dtype == torch.float64
        assert mean.item() == pytest.approx(float(statistics.mean(values)), rel=1e-12)
        assert std.item() == pytest.approx(float(statistics.pstdev(values)), rel=1e-9)
    assert model.action_std.tolist() == [1.0]  # a constant is left as it is
    assert model.action_mean.item() == pytest.approx(actions[0, 0].item(), rel=1e-12)


@pytest.mark.parametrize("move", [lambda m: m.float(), lambda m: m.half(), lambda m: m.double()])
def test_normalisers_survive_any_cast(move):
    model = hand_set(1.0)
    model.state_mean.fill_(1e3 + 1e-9)
    before = model.state_mean.clone()
    moved = move(model)
    assert torch.equal(moved.state_mean, before)
    assert moved.candidates.dtype == moved.network[0].weight.dtype
    rows = torch.zeros(2, 1, dtype=moved.candidates.dtype)
    assert moved(rows, rows).dtype == rows.dtype


def test_the_seed_decides_every_draw():
    transitions = linear_system(300, seed=0)
    states = []
    for seed in (5, 5, 6):
        model = linear_model()
        torch.manual_seed(len(states))  # the global generator has no say
        model.fit(*transitions, seed=seed)
        states.append(snapshot(model))
    assert same(states[0], states[1])
    assert not torch.equal(states[0]["network.0.weight"], states[2]["network.0.weight"])
    assert not torch.equal(states[0]["state_mean"], states[2]["state_mean"])  # other rows held out


def test_the_seed_decides_where_the_weights_start(monkeypatch):
    monkeypatch.setattr(fitting, "MAX_EPOCHS", 0)
    one, other = linear_model(), linear_model()
    for seed, model in enumerate((one, other)):
        model.fit(*linear_system(100, seed=0), seed=seed)
    assert not torch.equal(one.network[0].weight, other.network[0].weight)


def test_making_a_model_leaves_the_global_generator_alone():
    config = linear_model().config
    before = torch.get_rng_state()
    one, two, three = (MLPForwardModel(config, seed=seed) for seed in (1, 1, 2))
    assert torch.equal(torch.get_rng_state(), before)
    assert same(snapshot(one), snapshot(two))
    assert not same(snapshot(one), snapshot(three))


def test_a_fit_replaces_whatever_was_learned_before(fitted):
    transitions = linear_system(300, seed=4)
    fresh, again = linear_model(), MLPForwardModel(fitted.config, seed=9)
    again.load_state_dict(fitted.state_dict())
    fresh.fit(*transitions, seed=0)
    again.eval().fit(*transitions, seed=0)
    assert same(snapshot(fresh), snapshot(again))
    assert not again.training


def test_early_stopping_keeps_the_weights_of_the_best_epoch():
    generator = torch.Generator().manual_seed(0)
    states, actions, noise = (torch.randn(150, 2, generator=generator) for _ in range(3))
    losses: list[tuple[int, float, float]] = []
    config = MLPForwardModelConfig(2, 2, ((0.0, 0.0),), hidden=(32,))
    model = MLPForwardModel(config)
    after = states + noise  # pure noise: whatever is learned is overfitted
    report = model.fit(states, actions, after, seed=0, progress=lambda *loss: losses.append(loss))
    assert [epoch for epoch, *_ in losses] == list(range(1, report.epochs + 1))
    best = min(losses, key=lambda loss: loss[2])
    assert (report.train_loss, report.validation_loss) == best[1:]
    assert report.epochs == best[0] + fitting.PATIENCE < fitting.MAX_EPOCHS
    assert losses[-1][2] > best[2]
    rows = report.validation_rows
    with torch.no_grad():
        error = (after - states - model(states, actions))[rows] / model.change_std
    assert float(error.square().mean()) == pytest.approx(report.validation_loss, rel=1e-5)


def test_a_fit_ends_at_the_last_epoch_allowed(monkeypatch):
    monkeypatch.setattr(fitting, "MAX_EPOCHS", 4)
    assert linear_model().fit(*linear_system(200, seed=0), seed=0).epochs == 4


@pytest.mark.parametrize("epoch", [1, 3])
def test_a_ctrl_c_in_a_fit_leaves_the_model_as_it_was(epoch):
    model = linear_model()
    before = snapshot(model)

    def interrupt(number: int, *_: float) -> None:
        if number == epoch:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        model.fit(*linear_system(200, seed=0), seed=0, progress=interrupt)
    assert same(snapshot(model), before)


def test_a_ctrl_c_while_the_result_is_taken_over_comes_after_it():
    done, model = linear_model(), linear_model()
    done.fit(*linear_system(200, seed=0), seed=0)
    # Called when the normalisers have been replaced and the weights have not.
    model.network.register_load_state_dict_pre_hook(lambda *_: signal.raise_signal(signal.SIGINT))
    previous = signal.signal(signal.SIGINT, signal.default_int_handler)  # ignored in background
    try:
        with pytest.raises(KeyboardInterrupt):
            model.fit(*linear_system(200, seed=0), seed=0)
    finally:
        signal.signal(signal.SIGINT, previous)
    assert same(snapshot(model), snapshot(done))


@pytest.mark.parametrize(
    ("position", "value", "message"),
    [
        (0, torch.zeros(200, 3), r"expected states .* \[rows, 2\] .* got shape \[200, 3\]"),
        (1, torch.zeros(200), r"expected actions .* got shape \[200\]"),
        (1, torch.zeros(199, 2), "equally many rows, got .*'actions': 199"),
        (2, torch.zeros(200, 2).double(), "next_states .* got dtype torch.float64"),
        (2, torch.full((200, 2), math.nan), "expected finite next_states"),
        (0, [[0.0, 0.0]], "expected states .* got list"),
    ],
)
def test_a_fit_refuses_bad_transitions(position, value, message):
    model, transitions = linear_model(), list(linear_system(200, seed=0))
    transitions[position] = value
    before = snapshot(model)
    with pytest.raises(ValueError, match=message):
        model.fit(*transitions, seed=0)
    assert same(snapshot(model), before)


def test_a_fit_needs_two_blocks():
    with pytest.raises(ValueError, match=r"at least 100 transitions, two blocks of 50, got 99"):
        linear_model().fit(*linear_system(99, seed=0), seed=0)
    assert len(linear_model().fit(*linear_system(100, seed=0), seed=0).validation_rows) == 50


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_a_saved_model_comes_back_whole(tmp_path, fitted, dtype):
    model = MLPForwardModel(fitted.config)
    model.load_state_dict(fitted.state_dict())
    model.to(dtype).save_pretrained(tmp_path)
    loaded = MLPForwardModel.from_pretrained(tmp_path)
    assert loaded.config == model.config
    assert same(snapshot(loaded), snapshot(model))
    states, targets, _ = (rows.to(dtype) for rows in linear_system(50, seed=7))
    assert torch.equal(
        loaded.command(states, targets).action, model.command(states, targets).action
    )


def damage(folder, name: str, tensor: Tensor | None) -> None:
    """Replaces one tensor of a checkpoint, or takes it out."""
    fields, tensors = read_checkpoint(folder)
    tensors.pop(name, None)
    write_checkpoint(folder, fields, tensors if tensor is None else tensors | {name: tensor})


@pytest.mark.parametrize(
    ("name", "tensor", "message"),
    [
        ("state_std", None, r"got \['state_std'\] missing, none extra"),
        ("network.7.weight", torch.zeros(1), r"got none missing, \['network.7.weight'\] extra"),
        ("network.0.bias", torch.zeros(9), r"network.0.bias .* \[16\], got torch.float32 \[9\]"),
        ("state_mean", torch.zeros(2), "state_mean .* as torch.float64 .* got torch.float32"),
        ("network.2.bias", torch.zeros(2).double(), "network.2.bias .* got torch.float64"),
        ("network.0.weight", torch.zeros(16, 4).long(), "network.0.weight .* got torch.int64"),
        (
            "network.0.weight",
            torch.zeros(16, 4).to(torch.float8_e4m3fn),
            "weight .* got torch.float8",
        ),
        ("network.0.bias", torch.full((16,), math.nan), "expected finite network.0.bias"),
        ("change_std", torch.zeros(2).double(), r"expected change_std > 0, got \[0.0, 0.0\]"),
    ],
)
def test_a_damaged_checkpoint_is_refused(tmp_path, name, tensor, message):
    linear_model().save_pretrained(tmp_path)
    damage(tmp_path, name, tensor)
    with pytest.raises(ValueError, match=message):
        MLPForwardModel.from_pretrained(tmp_path)


def test_the_checkpoint_of_something_else_is_refused(tmp_path):
    config = TransitionMatrixConfig(1, 1, TURNS, clusters=2)
    TransitionMatrix(config).save_pretrained(tmp_path / "matrix")
    linear_model().save_pretrained(tmp_path / "mlp")
    with pytest.raises(ValueError, match=r"of MLPForwardModel .* got one of 'TransitionMatrix'"):
        MLPForwardModel.from_pretrained(tmp_path / "matrix")
    with pytest.raises(ValueError, match=r"of TransitionMatrix .* got one of 'MLPForwardModel'"):
        TransitionMatrix.from_pretrained(tmp_path / "mlp")
    with pytest.raises(FileNotFoundError):
        MLPForwardModel.from_pretrained(tmp_path / "nothing")


def test_an_unknown_field_of_the_config_is_refused(tmp_path):
    linear_model().save_pretrained(tmp_path)
    fields, tensors = read_checkpoint(tmp_path)
    write_checkpoint(tmp_path, fields | {"layers": 3}, tensors)
    with pytest.raises(ValueError, match=r"expected the fields of MLPForwardModelConfig.*'layers'"):
        MLPForwardModel.from_pretrained(tmp_path)


def test_a_model_that_means_nothing_does_not_replace_a_good_one(tmp_path):
    model = linear_model()
    model.save_pretrained(tmp_path)
    files = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    model.network[0].bias.data.fill_(math.nan)
    with pytest.raises(ValueError, match=r"expected finite network.0.bias"):
        model.save_pretrained(tmp_path)
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == files


def test_a_held_action_never_leads_beyond_the_states_that_were_seen():
    generator = torch.Generator().manual_seed(0)
    states = torch.rand(500, 1, generator=generator)  # a robot between two walls, at 0 and at 1
    actions = torch.rand(500, 1, generator=generator) - 0.5
    config = MLPForwardModelConfig(1, 1, candidates=((-0.5,), (0.5,)), steps=9)
    model = MLPForwardModel(config)
    model.fit(states, actions, (states + actions).clamp(0, 1), seed=0)
    predicted = model.predict(torch.tensor([[0.5], [0.5]]), torch.tensor([[0.5], [-0.5]]))
    assert predicted.flatten().tolist() == pytest.approx([1.0, 0.0], abs=0.02)
    assert predicted.min() >= model.state_low.item() >= 0
    assert predicted.max() <= model.state_high.item() <= 1


def test_transitions_without_a_finite_loss_are_refused_and_nothing_changes(monkeypatch):
    model = linear_model()
    before = snapshot(model)
    nowhere = float("nan")
    monkeypatch.setattr(
        "pacnet.forward_models.fitting._loss", lambda net, x, _: net(x).sum() * nowhere
    )
    with pytest.raises(ValueError, match="never finite"):
        model.fit(*linear_system(200, seed=0), seed=0)
    assert same(snapshot(model), before)
