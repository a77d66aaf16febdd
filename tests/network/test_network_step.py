"""`PACNet.step`: what `recall` and `act` answer, for one percept of a control loop."""

from __future__ import annotations

import copy
import functools
import math
import pickle
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import torch
from numpy.typing import NDArray
from torch import Tensor

from pacnet import (
    NO_NODE,
    Command,
    CompetingSchemasConfig,
    Decision,
    ForwardModel,
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
)

ENGINES = ("eager", "compiled")
SCHEMAS = {
    "nearest cue": MotorSchemasConfig(2, 2),
    "five nearest cues": MotorSchemasConfig(2, 2, nearest_cues=5),
    "order": MotorSchemasConfig(2, 2, recall_by="order"),
    "several schemas": CompetingSchemasConfig(2, 2, nearest_cues=3),
}
CANDIDATES = ((-0.6, 0.0), (-0.3, 0.0), (0.0, 0.0), (0.35, 0.0), (0.7, 0.0))
FAR = (50.0, 50.0)

every_engine = pytest.mark.parametrize("engine", ENGINES)
every_kind = pytest.mark.parametrize("schemas", SCHEMAS)


class Towards:
    """A user's own forward model: goes to the target, unless it is within half a unit."""

    action_dimensions = 2

    def command(self, states: Tensor, targets: Tensor) -> Command:  # noqa: D102
        way = targets - states[:, :2]
        given = torch.linalg.vector_norm(way, dim=1) > 0.5
        return Command(way.where(given[:, None], torch.nan), given)

    def reset(self) -> None: ...  # noqa: D102


def transitions() -> tuple[Tensor, Tensor, Tensor]:
    """An action moves the state by itself as far as a wall at 1.2, beyond which none has been."""
    generator = torch.Generator().manual_seed(3)
    states = torch.rand(1000, 2, generator=generator) * torch.tensor([4.2, 6.0]) - 3
    actions = torch.tensor(CANDIDATES)[torch.randint(5, (1000,), generator=generator)]
    after = states + actions
    return states, actions, after.clamp(max=torch.tensor([1.2, 9.0]))


@functools.cache
def mlp() -> MLPForwardModel:
    config = MLPForwardModelConfig(2, 2, CANDIDATES, hidden=(), abstain_below=0.1)
    model = MLPForwardModel(config)
    model.fit(*transitions(), seed=0)
    return model


@functools.cache
def matrix() -> TransitionMatrix:
    config = TransitionMatrixConfig(2, 2, CANDIDATES, clusters=40, abstain_below=0.25)
    model = TransitionMatrix(config)
    model.fit(*transitions(), seed=0)
    return model


def pid() -> PIDController:
    gains = {"kp": (2.0, 3.0), "ki": (9.0, 5.0), "kd": (1.0, 0.5)}
    return PIDController(PIDConfig(**gains, dt=0.02, integral_limit=1.0, torque_limit=10.0))


MODELS: dict[str, Callable[[], ForwardModel]] = {
    "MLP": mlp, "transition matrix": matrix, "PID": pid, "a user's own": Towards,
}  # fmt: skip


def circle(samples: int = 150, noise: float = 0.05, seed: int = 0) -> tuple[Tensor, Tensor]:
    """Percepts on a circle of radius 2, and as targets those a little ahead, both `[T, 2]`."""
    angle = torch.linspace(0, 2 * math.pi, samples + 1)[:-1]
    ahead = angle + 0.2
    drawn = torch.randn(samples, 2, generator=torch.Generator().manual_seed(seed))
    percepts = 2 * torch.stack([angle.cos(), angle.sin()], dim=1) + noise * drawn
    return percepts, 2 * torch.stack([ahead.cos(), ahead.sin()], dim=1)


def make_network(
    engine: Any = "auto", schemas: str = "nearest cue", model: ForwardModel | None = None
) -> PACNet:
    attention = SOFMConfig.paper(2, scale=(0.5, 1.0), novelty_threshold=0.6)
    return PACNet(PACNetConfig(attention, SCHEMAS[schemas]), model, engine)


@functools.cache
def lessons(schemas: str) -> dict[str, Any]:
    """One way round the circle, or for several schemas the other one as well."""
    network = make_network("auto", schemas)
    for episode in range(4):
        percepts, targets = circle(seed=episode)
        if schemas == "several schemas" and episode % 2:
            percepts, targets = percepts.flip(0), targets.flip(0)
        network.observe(percepts, targets, episode, f"way {episode % 2}")
    return network.state_dict()


def trained(
    engine: Any = "auto", schemas: str = "nearest cue", model: ForwardModel | None = None
) -> PACNet:
    network = make_network(engine, schemas)
    network.load_state_dict(lessons(schemas))
    network.forward_model = copy.deepcopy(model)
    return network


def walk() -> Tensor:
    """Percepts `[65, 2]` near the circle, at first in its middle and now and then far from it."""
    percepts = torch.cat([torch.zeros(5, 2), circle(60, noise=0.2, seed=9)[0]])
    percepts[::10] *= 3
    return percepts


def steps(network: PACNet, percepts: Tensor, states: Tensor | None = None) -> list[Decision]:
    rows = percepts.numpy()
    if states is None:
        return [network.step(row) for row in rows]
    return [network.step(row, state) for row, state in zip(rows, states.numpy(), strict=True)]


def assert_equal_rows(rows: list[NDArray[np.float32] | None], expected: Tensor) -> None:
    """None where a row of NaN is expected; else the same bits."""
    for row, wanted in zip(rows, expected.numpy(), strict=True):
        if row is None:
            assert np.isnan(wanted).all()
        else:
            assert row.dtype == wanted.dtype
            np.testing.assert_array_equal(row, wanted)


def assert_recalled(decisions: list[Decision], recall: Decision) -> None:
    assert_equal_rows([decision.target for decision in decisions], recall.target)
    for name in ("winner", "activation", "is_novel", "offset", "schema"):
        got = [getattr(decision, name) for decision in decisions]
        assert got == getattr(recall, name).tolist(), name


def assert_acted(decisions: list[Decision], acted: Decision) -> None:
    assert_recalled(decisions, acted)
    assert_equal_rows([decision.action for decision in decisions], acted.action)


def assert_steps_as_recalls(network: PACNet, percepts: Tensor) -> None:
    """And as another network with the same tensors, which has never taken a step."""
    tensors, other = network.state_dict(), PACNet(network.config, engine=network.sofm.engine)
    other.load_state_dict({name: tensors[name] for name in other.state_dict()})
    network.reset()
    decisions = steps(network, percepts)
    assert any(decision.target is not None for decision in decisions)
    assert_recalled(decisions, other.recall(percepts))
    network.reset()
    assert_recalled(decisions, network.recall(percepts))


@every_engine
@every_kind
def test_it_equals_recall_sample_by_sample(engine: str, schemas: str):
    network, reference = trained(engine, schemas), trained(engine, schemas)
    recall = reference.recall(walk())
    assert 5 < recall.is_novel.sum() < 20
    assert 30 < recall.has_target.sum() < 60
    decisions = steps(network, walk())
    assert_recalled(decisions, recall)
    assert all(decision.action is None for decision in decisions)


@every_engine
@pytest.mark.parametrize("name", ["MLP", "transition matrix", "a user's own"])
def test_it_equals_act_sample_by_sample(engine: str, name: str):
    network, reference = (trained(engine, "five nearest cues", MODELS[name]()) for _ in range(2))
    acted = reference.act(walk())
    assert acted.has_action.sum() > 10
    assert acted.abstained.sum() > 2
    assert_acted(steps(network, walk()), acted)


@every_engine
@pytest.mark.parametrize("name", MODELS)
def test_it_starts_from_the_state_where_one_is_given(engine: str, name: str):
    columns = 4 if name == "PID" else 2  # angles and velocities of two joints
    drawn = torch.randn(len(walk()), columns, generator=torch.Generator().manual_seed(5))
    states = walk().repeat(1, columns // 2) + drawn
    network, reference = (trained(engine, "five nearest cues", MODELS[name]()) for _ in range(2))
    acted = reference.act(walk(), states)
    assert acted.has_action.sum() > 10
    assert_acted(steps(network, walk(), states), acted)


@every_engine
@every_kind
def test_tensors_and_arrays_give_the_same(engine: str, schemas: str):
    network, reference = trained(engine, schemas, Towards()), trained(engine, schemas, Towards())
    for row in walk():
        one, other = network.step(row.numpy()), reference.step(row)
        np.testing.assert_equal(one._asdict(), other._asdict())
        np.testing.assert_equal(
            network.step(row.numpy(), row.numpy() + 1)._asdict(),
            reference.step(row, row + 1)._asdict(),
        )


@every_engine
def test_calls_of_step_and_of_recall_go_on_from_one_another(engine: str):
    network, reference = trained(engine, "order"), trained(engine, "order")
    percepts = circle(40)[0]
    positions = []
    for start in range(0, 40, 4):
        positions += network.recall(percepts[start : start + 3]).offset.tolist()
        positions.append(network.step(percepts[start + 3].numpy()).offset)
    assert positions == reference.recall(percepts).offset.tolist()
    assert max(positions) > 3


class Echo(Towards):
    """Return its argument: the target, or the state."""

    def __init__(self, what: str) -> None:
        self.what = what

    def command(self, states: Tensor, targets: Tensor) -> Command:  # noqa: D102
        rows = targets if self.what == "target" else states
        return Command(rows, torch.ones(len(rows), dtype=torch.bool))


ANSWERING: dict[str, Callable[[], ForwardModel]] = {
    "the target": lambda: Echo("target"), "the state": lambda: Echo("state"), **MODELS,
}  # fmt: skip
del ANSWERING["PID"]  # which has states of its own


@every_engine
@pytest.mark.parametrize(
    ("schemas", "name"),
    [*((schemas, "a user's own") for schemas in SCHEMAS), *(("order", name) for name in ANSWERING)],
)
def test_answers_are_the_callers_own(engine: str, schemas: str, name: str):
    network = trained(engine, schemas, ANSWERING[name]())
    before = copy.deepcopy(network.state_dict())
    percepts = walk()
    first = steps(network, percepts)
    kept = copy.deepcopy(first)
    network.reset()
    rows = percepts.clone().numpy()
    for row, expected in zip(rows, kept, strict=True):
        decision = network.step(row)
        np.testing.assert_equal(decision._asdict(), expected._asdict())
        for answer in (decision.action, decision.target):
            if answer is not None:
                answer += 1.0
        assert decision.action is None or decision.action is not decision.target
        if decision.action is not None:  # each had one added, once
            np.testing.assert_array_equal(decision.action, expected.action + np.float32(1))
            np.testing.assert_array_equal(decision.target, expected.target + np.float32(1))
    np.testing.assert_array_equal(rows, percepts.numpy())
    for one, other in zip(first, kept, strict=True):
        np.testing.assert_equal(one._asdict(), other._asdict())
    for key, value in network.state_dict().items():
        assert torch.equal(value, before[key]), key


BAD_PERCEPTS: dict[str, Any] = {
    "NaN": np.array([0.0, math.nan], np.float32),
    "infinite": torch.tensor([math.inf, 0.0]),
    "too large": np.array([1e30, 0.0], np.float32),
    "longer": np.zeros(3, np.float32),
    "shorter": torch.zeros(1),
    "two-dimensional": np.zeros((1, 2), np.float32),
    "float64": np.zeros(2),
    "integers": torch.zeros(2, dtype=torch.int64),
    "a list": [0.0, 0.0],
    "None": None,
}


@every_engine
@pytest.mark.parametrize("case", BAD_PERCEPTS)
def test_a_bad_percept_is_refused_and_the_episode_stays_where_it_was(engine: str, case: str):
    network = trained(engine, "order")
    percepts = circle(6, noise=0.0)[0].numpy()
    position = network.step(percepts[0]).offset
    before = copy.deepcopy(network.state_dict())
    with pytest.raises(ValueError, match=r"^expected .*percept.*, got "):
        network.step(BAD_PERCEPTS[case])
    for name, value in network.state_dict().items():
        assert torch.equal(value, before[name]), name
    assert network.step(percepts[0]).offset == position + 1


@every_engine
@pytest.mark.parametrize("name", ["MLP", "transition matrix", "PID"])
@pytest.mark.parametrize("state", [np.zeros(3, np.float32), np.full(2, np.nan, np.float32), [0, 0]])
def test_a_state_that_the_forward_model_cannot_use_is_refused(engine: str, name: str, state: Any):
    network = trained(engine, model=MODELS[name]())
    with pytest.raises(ValueError, match=r"^expected .*state.*, got "):
        network.step(circle(6, noise=0.0)[0][0].numpy(), state)


@every_engine
@every_kind
@pytest.mark.parametrize("training", [True, False], ids=["training", "eval"])
def test_nothing_is_learned(engine: str, schemas: str, training: bool):
    network = trained(engine, schemas).train(training)
    before = copy.deepcopy(network.state_dict())
    steps(network, walk())
    for name, value in network.state_dict().items():
        assert torch.equal(value, before[name]), name
    assert network.training is training


@every_engine
@every_kind
def test_an_unknown_percept_is_new_and_commands_nothing(engine: str, schemas: str):
    network = trained(engine, schemas, Towards())
    decision = network.step(np.array(FAR, np.float32))
    assert decision.is_novel is True
    assert (decision.target, decision.has_target) == (None, False)
    assert (decision.action, decision.has_action) == (None, False)
    assert (decision.offset, decision.schema) == (-1, NO_NODE)
    distance = (network.sofm.prototypes - torch.tensor(FAR)) * torch.tensor([0.5, 1.0])
    assert decision.winner == int(distance.square().sum(dim=1).argmin())
    assert decision.activation < 1e-9


@every_engine
@every_kind
def test_an_untrained_network_commands_nothing(engine: str, schemas: str):
    decision = make_network(engine, schemas, Towards()).step(np.zeros(2, np.float32))
    assert decision == Decision(None, False, NO_NODE, 0.0, True, offset=-1, schema=NO_NODE)


@every_engine
@every_kind
def test_a_node_that_never_habituated_commands_nothing(engine: str, schemas: str):
    network = make_network(engine, schemas, Towards())
    network.observe(torch.zeros(5, 2), torch.ones(5, 2), episode=0)
    decision = network.step(np.zeros(2, np.float32))
    assert decision == Decision(None, False, 0, 1.0, False, offset=-1, schema=NO_NODE)


@every_engine
def test_where_the_forward_model_abstains_there_is_a_target_and_no_action(engine: str):
    network = make_network(engine, model=Towards())
    here, target = torch.zeros(20, 2), torch.tensor([[0.25, 0.25]])
    network.observe(here, target.repeat(20, 1), episode=0)
    decision = network.step(here[0].numpy())  # .35 from the target, which is within half a unit
    assert decision.action is None
    np.testing.assert_array_equal(decision.target, target[0])
    decision = network.step(here[0].numpy(), np.array([1.0, 0.5], np.float32))
    np.testing.assert_array_equal(decision.action, [-0.75, -0.25])


@every_kind
def test_it_follows_what_is_learned_later(schemas: str):
    network = make_network(schemas=schemas)
    places = 4 * torch.cartesian_prod(torch.arange(10.0), torch.arange(7.0))
    for episode, part in enumerate(places.split([20, 30, 20])):
        stays = part.repeat_interleave(13, dim=0)  # [samples] to habituate in, and one more
        network.observe(stays, stays / 4, episode)
        assert len(network.sofm) == (20, 50, 70)[episode]  # there was room for 64 at first
        assert_steps_as_recalls(network, torch.cat([part[::5], walk()[:10]]))


@every_kind
def test_it_follows_what_is_loaded(schemas: str):
    network, other = trained(schemas=schemas), make_network(schemas=schemas)
    for episode in range(3):
        other.observe(*(1.5 * rows for rows in circle(200)), episode)
    steps(network, walk())
    network.load_state_dict(other.state_dict())
    assert_steps_as_recalls(network, 1.5 * walk())
    network.load_state_dict(make_network(schemas=schemas).state_dict())
    assert steps(network, walk())[50].winner == NO_NODE


@every_kind
def test_a_copy_has_a_memory_of_its_own(schemas: str):
    network = trained(schemas=schemas, model=mlp())
    steps(network, walk())
    network.reset()
    other = copy.deepcopy(network)
    expected = steps(network, walk())
    np.testing.assert_equal(steps(other, walk()), expected)
    other.observe(*(1.5 * rows for rows in circle(300)), 4)
    network.reset()
    np.testing.assert_equal(steps(network, walk()), expected)
    assert_steps_as_recalls(other, 1.5 * walk())


@every_engine
def test_it_survives_pickling(engine: str):
    network = trained(engine, "five nearest cues", mlp())
    expected = steps(network, walk())
    np.testing.assert_equal(steps(pickle.loads(pickle.dumps(network)), walk()), expected)


@every_engine
@every_kind
def test_it_follows_targets_that_are_changed_in_place(engine: str, schemas: str):
    network = trained(engine, schemas)
    steps(network, walk())
    network.reset()
    before = [decision.target for decision in steps(network, walk())]
    for sequence in range(len(network.schemas.lengths)):
        network.schemas.targets(sequence).add_(1.0)
    network.reset()
    for old, decision in zip(before, steps(network, walk()), strict=True):
        assert (old is None) == (decision.target is None)
        if old is not None:
            np.testing.assert_allclose(decision.target, old + 1, atol=1e-6)


@every_engine
def test_reset_starts_a_new_episode(engine: str):
    network = trained(engine, "order", pid())
    percept, state = circle(6, noise=0.0)[0][0].numpy(), np.zeros(4, np.float32)
    first = network.step(percept, state)
    second = network.step(percept, state)
    assert (first.offset, second.offset) == (0, 1)
    network.reset()
    np.testing.assert_equal(network.step(percept, state)._asdict(), first._asdict())


@every_kind
@pytest.mark.parametrize("name", ["MLP", "a user's own"])
def test_a_network_in_float64_takes_percepts_in_float64(schemas: str, name: str):
    network, reference = (trained("auto", schemas, MODELS[name]()).double() for _ in range(2))
    assert_acted(steps(network, walk().double()), reference.act(walk().double()))


@pytest.mark.parametrize("name", MODELS)
def test_a_view_and_a_read_only_array_are_percepts_and_states_too(name: str):
    network = trained("compiled", model=MODELS[name]())
    row = circle(6, noise=0.0)[0][1].numpy()
    spaced = np.zeros((4, 3), np.float32)
    spaced[::2, 1] = row
    locked = row.copy()
    locked.flags.writeable = False
    state = np.zeros(4 if name == "PID" else 2, np.float32)
    expected = network.step(row, state)
    assert expected.target is not None
    for percept in (row[::-1].copy()[::-1], spaced[::2, 1], locked):
        for same in (state, state[::-1], np.broadcast_to(np.float32(0), state.shape)):
            network.reset()
            np.testing.assert_equal(network.step(percept, same)._asdict(), expected._asdict())
