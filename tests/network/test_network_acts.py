"""The network with a forward model: what it does, when it does nothing, what it saves."""

import pytest
import torch
from torch import nn

from pacnet import (
    Command,
    HabituatingSOFM,
    MLPForwardModel,
    MLPForwardModelConfig,
    MotorSchemasConfig,
    PACNet,
    PACNetConfig,
    PIDConfig,
    PIDController,
    SOFMConfig,
    TransitionMatrix,
    TransitionMatrixConfig,
    targets_ahead,
)

CANDIDATES = ((-0.1,), (0.0,), (0.1,))
HERE = torch.tensor([[0.5]])
NOWHERE = torch.tensor([[50.0]])


class Towards:
    """Goes to the target, unless it is nearer than `deadband`; counts its calls since reset."""

    action_dimensions = 1

    def __init__(self, deadband: float = 0.0) -> None:
        self.deadband, self.calls = deadband, 0

    def command(self, states, targets):  # noqa: D102
        self.calls += 1
        way = targets - states
        given = way.abs()[:, 0] >= self.deadband
        return Command(way.where(given[:, None], torch.nan), given)

    def reset(self):  # noqa: D102
        self.calls = 0


class Learned(nn.Module):
    """A caller's forward model with a state: a map, and names that this library had before."""

    action_dimensions = 1

    def __init__(self, value: float = 0.0) -> None:
        super().__init__()
        self.register_buffer("room", torch.full((2,), value))
        self.passes = nn.Linear(1, 1)
        self.passes.register_buffer("room", torch.full((3,), value))
        self.map = HabituatingSOFM(SOFMConfig.paper(1))
        self.map.observe(torch.full((3, 1), value))

    def command(self, states, targets):  # noqa: D102
        return Command(targets - states, torch.ones(len(states), dtype=torch.bool))

    def reset(self):  # noqa: D102
        pass


def trained(forward_model=None, target=0.75) -> PACNet:
    """Knows one percept, 0.5, and the target that goes with it."""
    attention = SOFMConfig.paper(1, novelty_threshold=0.6)
    network = PACNet(PACNetConfig(attention, MotorSchemasConfig(1, 1)), forward_model)
    network.observe(HERE.repeat(30, 1), torch.full((30, 1), target), episode=0)
    return network


def trained_mlp() -> MLPForwardModel:
    """Knows that an action moves the state by itself."""
    generator = torch.Generator().manual_seed(0)
    states = torch.rand(1000, 1, generator=generator)
    actions = 0.2 * torch.rand(1000, 1, generator=generator) - 0.1
    model = MLPForwardModel(MLPForwardModelConfig(1, 1, CANDIDATES, hidden=()))
    model.fit(states, actions, states + actions, seed=0)
    return model


def trained_matrix() -> TransitionMatrix:
    grid = torch.arange(0, 1.01, 0.1)
    states = grid.repeat_interleave(3)[:, None].repeat(5, 1)
    actions = torch.tensor(CANDIDATES).repeat(len(grid) * 5, 1)
    model = TransitionMatrix(TransitionMatrixConfig(1, 1, CANDIDATES, clusters=11))
    model.fit(states, actions, (states + actions).clamp(0, 1), seed=0)
    return model


def pid() -> PIDController:
    return PIDController(
        PIDConfig(kp=(2.0,), ki=(0.0,), kd=(1.0,), dt=0.02, integral_limit=1.0, torque_limit=10.0)
    )


def test_the_action_leads_from_the_percept_to_the_recalled_target():
    assert trained(Towards()).act(HERE).action.item() == pytest.approx(0.75 - 0.5)


def test_it_starts_from_the_state_where_that_is_not_the_percept():
    action = trained(Towards()).act(HERE, states=torch.tensor([[1.0]])).action
    assert action.item() == pytest.approx(0.75 - 1.0)


def test_nothing_is_done_about_an_unknown_percept():
    acted = trained(Towards()).act(torch.cat([NOWHERE, HERE]))
    assert acted.has_action.tolist() == [False, True]
    assert acted.action.isnan().flatten().tolist() == [True, False]
    assert acted.abstained.tolist() == [False, False]


def test_nothing_is_done_where_the_forward_model_abstains():
    acted = trained(Towards(deadband=0.5)).act(HERE)
    assert acted.has_target.item()
    assert not acted.has_action.item()
    assert acted.abstained.item()
    assert acted.action.isnan().item()


def test_reset_starts_the_forward_model_afresh():
    model = Towards()
    network = trained(model)
    network.act(HERE.repeat(3, 1))
    assert model.calls == 3
    network.reset()
    assert model.calls == 0


@pytest.mark.parametrize("make", [trained_mlp, trained_matrix])
@pytest.mark.parametrize(("target", "wanted"), [(0.7, 0.1), (0.3, -0.1), (0.5, 0.0)])
def test_learned_forward_models_choose_the_candidate_towards_the_target(make, target, wanted):
    acted = trained(make(), target).act(HERE)
    assert acted.action.item() == pytest.approx(wanted)


def test_a_pid_is_a_forward_model_with_a_state_of_its_own():
    states = torch.tensor([[0.25, 0.125]])  # angle [rad], velocity [rad/s]
    torque = trained(pid()).act(HERE, states).action
    assert torque.item() == pytest.approx(2.0 * (0.75 - 0.25) - 1.0 * 0.125)


def test_all_at_once_equals_one_by_one_also_with_a_memory():
    config = PIDConfig(
        kp=(2.0,), ki=(9.0,), kd=(0.0,), dt=0.02, integral_limit=1.0, torque_limit=10.0
    )
    percepts = torch.tensor([[0.5], [0.55], [50.0], [0.45]])
    states = torch.rand(4, 2, generator=torch.Generator().manual_seed(1))
    at_once = trained(PIDController(config)).act(percepts, states).action
    network = trained(PIDController(config))
    one_by_one = torch.cat(
        [
            network.act(percept[None], state[None]).action
            for percept, state in zip(percepts, states, strict=True)
        ]
    )
    torch.testing.assert_close(at_once, one_by_one, rtol=0, atol=0, equal_nan=True)


def test_acting_learns_nothing():
    network = trained(trained_mlp())
    before = {name: value.clone() for name, value in network.state_dict().items()}
    network.act(torch.cat([HERE, NOWHERE]))
    assert all(torch.equal(value, before[name]) for name, value in network.state_dict().items())


@pytest.mark.parametrize(
    ("model", "percepts", "states", "message"),
    [
        (None, HERE, None, "expected a forward model"),
        (Towards(), HERE, HERE.repeat(2, 1), "expected equally many rows"),
        (Towards(), HERE.double(), None, "expected percepts as a torch.float32"),
        (pid(), HERE, None, "columns|shape"),
    ],
)
def test_bad_input_is_refused(model, percepts, states, message):
    network = trained(model)
    with pytest.raises(ValueError, match=message):
        network.act(percepts, states)


def test_a_checkpoint_holds_the_network_and_not_its_forward_model(tmp_path):
    network = trained(trained_mlp(), target=0.7)
    network.save_pretrained(tmp_path / "network")
    network.forward_model.save_pretrained(tmp_path / "body")
    alone = PACNet.from_pretrained(tmp_path / "network")
    with pytest.raises(ValueError, match="forward model"):
        alone.act(HERE)
    body = MLPForwardModel.from_pretrained(tmp_path / "body")
    again = PACNet.from_pretrained(tmp_path / "network", forward_model=body)
    assert torch.equal(again.act(HERE).action, network.act(HERE).action)


def test_a_forward_model_keeps_its_own_names_when_a_state_is_loaded():
    saved, loaded = trained(Learned(1.0)), trained(Learned(2.0))
    state = saved.state_dict()
    assert {"forward_model.room", "forward_model.passes.room"} < state.keys()
    loaded.load_state_dict(state)
    for name, value in loaded.forward_model.state_dict().items():
        assert torch.equal(value, saved.forward_model.state_dict()[name]), name
    assert loaded.forward_model.room.tolist() == [1.0, 1.0]
    assert loaded.forward_model.passes.room.tolist() == [1.0, 1.0, 1.0]


def test_old_names_of_schemas_still_load_beside_a_forward_model_that_has_such_names():
    saved, loaded = trained(Learned(1.0)), trained(Learned(2.0))
    state = saved.state_dict()
    state["schemas.blocks.room"] = state.pop("schemas.blocks.capacity")
    loaded.load_state_dict(state)
    assert torch.equal(loaded.schemas.lengths, saved.schemas.lengths)
    assert loaded.forward_model.room.tolist() == [1.0, 1.0]


def test_a_forward_model_with_a_damaged_map_is_refused():
    network = trained(Learned(1.0))
    state = network.state_dict()
    state["forward_model.map.nodes.prototype"][0] = torch.nan
    with pytest.raises(ValueError, match="finite prototypes"):
        network.load_state_dict(state)
    assert network.forward_model.map.prototypes.tolist() == [[1.0]]


def test_a_forward_model_checkpoint_is_no_network(tmp_path):
    trained_mlp().save_pretrained(tmp_path)
    with pytest.raises(ValueError, match="expected"):
        PACNet.from_pretrained(tmp_path)


def test_targets_lie_some_steps_ahead_and_stay_at_the_end():
    states = torch.tensor([[0.0], [1.0], [2.0], [3.0]])
    assert targets_ahead(states, 2).flatten().tolist() == [2.0, 3.0, 3.0, 3.0]
    assert targets_ahead(states, 0).flatten().tolist() == [0.0, 1.0, 2.0, 3.0]
    assert targets_ahead(states, 9).flatten().tolist() == [3.0] * 4
    assert targets_ahead(states[:0], 2).shape == (0, 1)


@pytest.mark.parametrize(
    ("states", "steps", "message"),
    [
        (torch.zeros(4), 1, r"shape \[T, A\], got \[4\]"),
        ([[0.0]], 1, "got list"),
        (torch.zeros(4, 1), -1, "steps as an integer ≥ 0, got -1"),
        (torch.zeros(4, 1), 1.5, "steps as an integer ≥ 0, got 1.5"),
    ],
)
def test_targets_ahead_refuses(states, steps, message):
    with pytest.raises(ValueError, match=message):
        targets_ahead(states, steps)
