"""The schema network: confidences, active schemas, winners and commands."""

import json
import math
from pathlib import Path

import pytest
import torch

from pacnet import NO_SCHEMA, Command, PIDConfig, PIDController
from pacnet.competition.winner_take_all import CompetitionConfig
from pacnet.network.config import SchemaNetworkConfig
from pacnet.network.schema_network import SchemaNetwork

NEAR_0, NEAR_4, NOWHERE = 0.25, 3.75, 50.0


def column(*values: float) -> torch.Tensor:
    return torch.tensor(values, dtype=torch.float32)[:, None]


def line(forward_model=None, threshold: float = 0.0, margin: float = 0.0) -> SchemaNetwork:
    """Schema 0 at 0, 1 with targets 10, 11; schema 1 at 4, 3, 5 with targets 20, 21, 22."""
    competition = CompetitionConfig(threshold, margin)
    network = SchemaNetwork(SchemaNetworkConfig(1, 1, competition=competition), forward_model)
    assert network.add_schema(column(0, 1), column(10, 11)) == 0
    assert network.add_schema(column(4, 3, 5), column(20, 21, 22)) == 1
    return network


def pid(integral_limit: float = 9.0) -> PIDController:
    """Torque 2 e + 1 * integral, damped by half the velocity, updated every second."""
    return PIDController(
        PIDConfig(
            kp=(2.0,), ki=(1.0,), kd=(0.5,), dt=1.0,
            integral_limit=integral_limit, torque_limit=99.0,
        )
    )  # fmt: skip


class Abstains:
    """Moves to the target, but abstains if that is 20 or more."""

    action_dimensions = 1

    def command(self, states, targets):  # noqa: D102
        given = targets[:, 0] < 20
        return Command((targets - states).where(given[:, None], torch.nan), given)

    def reset(self):  # noqa: D102
        pass


def test_confidence_falls_with_the_scaled_distance_to_the_nearest_percept():
    config = SchemaNetworkConfig(2, 1, scale=(2.0, 1.0), width=0.5)
    network = SchemaNetwork(config)
    network.add_schema(torch.tensor([[0.0, 0.0], [1.0, 1.0]]), column(1, 2))
    network.add_schema(torch.tensor([[9.0, 9.0]]), column(3))
    activity = network(torch.tensor([[0.0, 0.0], [1.5, 1.0], [0.0, 1.5]]))
    # Scaled distances. Second percept: (2·.5, 0) from place 1: 1. Third: (0, 1.5) from place 0
    # is 1.5, (2, .5) from place 1 more. Divided by the width of a half: 0, 2, 3.
    expected = torch.tensor([1.0, math.exp(-2), math.exp(-3)])
    torch.testing.assert_close(activity.confidence[:, 0], expected)
    assert activity.offset[:, 0].tolist() == [0, 1, 0]
    far = math.hypot(2 * 9, 9) / 0.5
    assert activity.confidence[0, 1].item() == pytest.approx(math.exp(-far), rel=1e-4)
    assert activity.targets[:, 0, 0].tolist() == [1, 2, 1]


def test_ties_between_percepts_go_to_the_lowest_index():
    assert line()(column(0.5, 4.5)).offset.tolist() == [[0, 1], [1, 0]]


def test_a_schema_is_active_and_has_a_target_from_the_threshold_on():
    # e^-d ≥ .25 up to d = ln 4 = 1.386. At 2.25 schema 0 is 1.25 away, schema 1 .75.
    activity = line(threshold=0.25)(column(NEAR_0, NEAR_4, 2.25))
    assert activity.active.tolist() == [[True, False], [False, True], [True, True]]
    assert activity.targets[:, :, 0].nan_to_num(-1).tolist() == [[10, -1], [-1, 20], [11, 21]]


def test_at_the_threshold_it_is_active():
    assert line(threshold=1.0)(column(0, 0.125)).active.tolist() == [[True, False], [False, False]]


def test_the_winner_gives_the_target_and_without_a_winner_there_is_none():
    recall = line(threshold=0.25).recall(column(NEAR_0, NOWHERE, NEAR_4))
    assert recall.winner.tolist() == [0, NO_SCHEMA, 1]
    assert recall.has_target.tolist() == [True, False, True]
    assert recall.target.flatten().nan_to_num(-1).tolist() == [10, -1, 20]


def test_a_batch_equals_one_by_one():
    generator = torch.Generator().manual_seed(0)
    network = SchemaNetwork(SchemaNetworkConfig(3, 2, competition=CompetitionConfig(0.25)))
    for length in (5, 1, 9):
        network.add_schema(
            torch.rand(length, 3, generator=generator), torch.rand(length, 2, generator=generator)
        )
    percepts = 3 * torch.rand(40, 3, generator=generator)
    together = network(percepts)
    assert 0 < together.active.float().mean() < 1
    for row in range(40):
        for one, all_ in zip(network(percepts[row : row + 1]), together, strict=True):
            torch.testing.assert_close(one[0], all_[row], rtol=0, atol=0, equal_nan=True)


def test_it_agrees_with_a_plain_search(monkeypatch):
    monkeypatch.setattr("pacnet.network.schema_network._SEARCH_ELEMENTS", 100)  # several chunks
    generator = torch.Generator().manual_seed(1)
    network = SchemaNetwork(SchemaNetworkConfig(3, 1, scale=(1.0, 0.5, 2.0), width=2.0))
    scale, sequences = torch.tensor([1.0, 0.5, 2.0]), []
    for length in (4, 7, 1):
        sequences.append(torch.rand(length, 3, generator=generator))
        network.add_schema(sequences[-1], torch.zeros(length, 1))
    percepts = torch.rand(25, 3, generator=generator)
    activity = network(percepts)
    for schema, sequence in enumerate(sequences):
        for row, percept in enumerate(percepts):
            distances = [math.dist(percept * scale, stored * scale) for stored in sequence]
            assert activity.offset[row, schema] == distances.index(min(distances))
            confidence = math.exp(-min(distances) / 2)
            assert activity.confidence[row, schema].item() == pytest.approx(confidence, rel=1e-5)


def test_without_schemas_there_is_no_winner():
    network = SchemaNetwork(SchemaNetworkConfig(1, 2), Abstains())
    activity = network(column(0, 1, 2))
    assert activity.confidence.shape == activity.active.shape == (3, 0)
    assert activity.targets.shape == (3, 0, 2)
    acted = network.act(column(0, 1, 2), column(0, 0, 0))
    assert acted.winner.tolist() == [NO_SCHEMA] * 3
    assert acted.candidates.shape == (3, 0, 1)
    assert acted.has_action.tolist() == [False] * 3
    assert acted.action.isnan().all()
    assert acted.target.isnan().all()


def test_recall_goes_on_from_the_last_call_until_reset():
    network = line(margin=0.5)  # between the two, the last winner stays
    assert network.recall(column(NEAR_0, 2.25)).winner.tolist() == [0, 0]
    assert network.recall(column(2.25)).winner.tolist() == [0]
    assert network(column(NEAR_4)).active.all()  # only reads
    assert network.recall(column(2.25)).winner.tolist() == [0]
    network.reset()
    assert network.recall(column(2.25)).winner.tolist() == [1]


def test_adding_a_schema_starts_a_new_episode():
    network = line(margin=0.5)
    network.recall(column(NEAR_0))
    network.add_schema(column(9), column(9))
    assert network.recall(column(2.25)).winner.tolist() == [1]


def test_the_winners_command_is_the_action_and_inactive_schemas_have_none():
    network = line(pid(), threshold=0.25)
    acted = network.act(column(NEAR_0, NOWHERE), torch.tensor([[4.0, 2.0], [0.0, 0.0]]))
    # Schema 0: target 10, angle 4, velocity 2: 2·6 + 1·6 − .5·2 = 17.
    assert acted.candidates[0, :, 0].nan_to_num(-1).tolist() == [17, -1]
    assert acted.candidates[1].isnan().all()
    assert acted.action.flatten().nan_to_num(-1).tolist() == [17, -1]
    assert acted.has_action.tolist() == [True, False]


def test_each_schema_has_the_command_of_its_own_controller():
    network = line(pid(), threshold=0.25)
    # Schema 0 is alone, both are active, schema 1 is alone, none, both, schema 0 alone.
    percepts = column(NEAR_0, 2.25, NEAR_4, NOWHERE, 2.25, NEAR_0)
    states = torch.tensor(
        [[0.0, 1.0], [5.0, -1.0], [7.0, 0.5], [8.0, 0.0], [9.0, 2.0], [10.0, 0.0]]
    )
    acted = network.act(percepts, states)
    # The targets of each row: its own if active, else the winner's; None without a winner.
    rows = {0: (10.0, 11.0, 20.0, None, 11.0, 10.0), 1: (10.0, 21.0, 20.0, None, 21.0, 10.0)}
    active = {0: (0, 1, 4, 5), 1: (1, 2, 4)}
    assert acted.winner.tolist() == [0, 1, 1, NO_SCHEMA, 1, 0]
    for schema, targets in rows.items():
        own = pid()
        for sample, target in enumerate(targets):
            if target is None:
                assert acted.candidates[sample, schema].isnan().all()
                continue
            command = own.command(states[sample : sample + 1], torch.tensor([[target]])).action
            if sample in active[schema]:
                assert acted.candidates[sample, schema].item() == command.item()
            else:
                assert acted.candidates[sample, schema].isnan().all()
    winners = [0, 1, 1, 0, 1, 0]
    chosen = torch.stack([acted.candidates[sample, who] for sample, who in enumerate(winners)])
    torch.testing.assert_close(acted.action, chosen, equal_nan=True)


def test_acting_goes_on_from_the_last_call_until_reset():
    percepts, states = column(NEAR_0, 2.25, NEAR_4), torch.zeros(3, 2)
    whole = line(pid(integral_limit=1000.0), 0.25).act(percepts, states)
    network = line(pid(integral_limit=1000.0), 0.25)
    parts = [network.act(percepts[t : t + 1], states[t : t + 1]) for t in range(3)]
    torch.testing.assert_close(torch.cat([part.action for part in parts]), whole.action)
    again = network.act(percepts, states)
    assert not torch.equal(again.action, whole.action)  # the integrals went on
    network.reset()
    torch.testing.assert_close(network.act(percepts, states).action, whole.action)


def test_there_is_no_action_where_the_forward_model_abstains():
    acted = line(Abstains(), threshold=0.25).act(column(2.25, NEAR_0), column(0, 0))
    assert acted.winner.tolist() == [1, 0]
    assert acted.candidates[:, :, 0].nan_to_num(-1).tolist() == [[11, -1], [10, -1]]
    assert acted.has_action.tolist() == [False, True]
    assert acted.action.flatten().nan_to_num(-1).tolist() == [-1, 10]


def test_old_names_of_fields_warn():
    acted = line(Abstains()).act(column(NEAR_0), column(0))
    assert acted.activity.targets.shape == (1, 2, 1)
    for old in ("given", "commanded", "targets"):
        with pytest.warns(DeprecationWarning, match=f"^{old} is now "):
            assert len(getattr(acted, old)) == 1
    with pytest.warns(DeprecationWarning, match="position is now offset"):
        assert acted.activity.position is acted.activity.offset
    with pytest.warns(DeprecationWarning, match="is now SchemaDecision"):
        assert acted.recall is acted


def test_gradient_reaches_the_percepts():
    percepts = column(NEAR_0, 0.0).requires_grad_()
    confidence = line()(percepts).confidence
    (gradient,) = torch.autograd.grad(confidence[:, 0].sum(), percepts)
    assert gradient.flatten().tolist() == pytest.approx([-math.exp(-NEAR_0), 0.0])


def snapshot(network: SchemaNetwork) -> dict[str, torch.Tensor]:
    return {name: tensor.clone() for name, tensor in network.state_dict().items()}


@pytest.mark.parametrize(
    ("percepts", "targets", "message"),
    [
        (torch.zeros(2, 2), column(1, 2), r"expected percepts .* got shape \[2, 2\]"),
        (column(1, math.nan), column(1, 2), "expected finite percepts"),
        (torch.zeros(0, 1), torch.zeros(0, 1), "percepts .* got an empty one"),
        (column(1, 2).double(), column(1, 2), "percepts .* got dtype torch.float64"),
        (column(1, 2), torch.zeros(2, 3), r"expected targets .* got shape \[2, 3\]"),
        (column(1, 2), column(1, math.inf), "expected finite targets"),
        (column(1, 2), column(1), "expected equally many rows, got .*'percepts': 2"),
        (column(3e38), column(1), "expected finite scaled percepts"),
    ],
)
def test_a_refused_schema_changes_nothing(percepts, targets, message):
    network = SchemaNetwork(SchemaNetworkConfig(1, 1, scale=(2.0,)))
    network.add_schema(column(1), column(1))
    before = snapshot(network)
    with pytest.raises(ValueError, match=message):
        network.add_schema(percepts, targets)
    for name, tensor in network.state_dict().items():
        assert torch.equal(tensor, before[name]), name
    assert len(network) == 1


@pytest.mark.parametrize(
    ("percepts", "states", "message"),
    [
        (torch.zeros(1, 2), torch.zeros(1, 2), "expected percepts"),
        (column(math.nan), torch.zeros(1, 2), "expected finite percepts"),
        (column(NEAR_4), torch.zeros(2, 2), "expected equally many rows"),
        (column(NEAR_4), torch.full((1, 2), math.nan), "expected finite states"),
        (column(NEAR_4), None, "expected states .* got NoneType"),
        (column(NEAR_4), torch.zeros(1, 1), r"expected states .*\[rows, 2\]"),  # the PID's own
    ],
)
def test_a_refused_action_leaves_the_episode_where_it_was(percepts, states, message):
    network = line(pid(), margin=0.5)
    network.act(column(NEAR_0), torch.zeros(1, 2))
    integral = network.forward_model.integral.clone()
    with pytest.raises(ValueError, match=message):
        network.act(percepts, states)
    assert torch.equal(network.forward_model.integral, integral)
    assert network.recall(column(2.25)).winner.tolist() == [0]  # the incumbent still


def test_a_refused_recall_leaves_the_episode_where_it_was():
    network = line(margin=0.5)
    network.recall(column(NEAR_0))
    with pytest.raises(ValueError, match="expected finite percepts"):
        network.recall(column(NEAR_4, math.nan))
    assert network.recall(column(2.25)).winner.tolist() == [0]


def test_stored_percepts_are_returned_in_their_own_units():
    network = SchemaNetwork(SchemaNetworkConfig(1, 1, scale=(4.0,)))
    network.add_schema(column(1, 2), column(3, 4))
    network.add_schema(column(5), column(6))
    assert network.lengths.tolist() == [2, 1]
    assert network.percepts(0).flatten().tolist() == [1, 2]
    assert network.targets(1).flatten().tolist() == [6]
    with pytest.raises(ValueError, match="expected a schema from 0 to 1, got 2"):
        network.targets(2)


def test_acting_without_a_forward_model_is_refused():
    with pytest.raises(ValueError, match="expected a forward model to act with"):
        line().act(column(0), column(0))
    with pytest.raises(ValueError, match="expected forward_model as a ForwardModel or None"):
        SchemaNetwork(SchemaNetworkConfig(1, 1), forward_model=3)  # pyright: ignore


def test_a_state_dict_brings_schemas_and_starts_a_new_episode():
    network = line(margin=0.5)
    other = SchemaNetwork(network.config)
    other.add_schema(column(7), column(7))
    other.add_schema(column(2.25), column(7))
    other.recall(column(7))
    other.load_state_dict(network.state_dict())
    percepts = column(2.25, NEAR_0, NEAR_4)
    for one, loaded in zip(network.recall(percepts)[:3], other.recall(percepts)[:3], strict=True):
        assert torch.equal(one, loaded)


@pytest.mark.parametrize("schemas", [0, 2])
def test_a_checkpoint_brings_config_and_schemas_without_the_forward_model(tmp_path: Path, schemas):
    config = SchemaNetworkConfig(1, 1, (0.5,), 0.75, CompetitionConfig(0.125, 0.0625))
    network = SchemaNetwork(config, pid())
    for number in range(schemas):
        network.add_schema(column(number, 4 * number), column(number + 1, 5))
    network.save_pretrained(tmp_path)
    loaded = SchemaNetwork.from_pretrained(tmp_path, Abstains())
    assert loaded.config == config
    assert loaded.act(column(0.5), column(0)).has_action.tolist() == [schemas > 0]
    bare = SchemaNetwork.from_pretrained(tmp_path)
    assert bare.forward_model is None
    percepts = column(0, 0.5, 3)
    for one, same in zip(network(percepts), bare(percepts), strict=True):
        torch.testing.assert_close(one, same, rtol=0, atol=0, equal_nan=True)
    for name, tensor in bare.state_dict().items():
        assert torch.equal(tensor, network.state_dict()[name]), name


def test_a_checkpoint_keeps_double_precision(tmp_path: Path):
    network = SchemaNetwork(SchemaNetworkConfig(1, 1)).double()
    network.add_schema(column(1 / 3).double(), column(1).double())
    network.save_pretrained(tmp_path)
    assert SchemaNetwork.from_pretrained(tmp_path)(column(1 / 3).double()).confidence.item() == 1.0


def rewrite(folder: Path, change) -> None:
    """Save a checkpoint with its tensors changed by hand."""
    from pacnet.core.checkpoint import read_checkpoint, write_checkpoint

    line().save_pretrained(folder)
    config, tensors = read_checkpoint(folder)
    change(config, tensors)
    write_checkpoint(folder, config, tensors)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda _, t: t.pop("pool.target"), r"\['pool.target'\] missing, none extra"),
        (lambda _, t: t.update(more=torch.zeros(1)), r"none missing, \['more'\] extra"),
        (lambda _, t: t.update({"pool.percept": torch.zeros(5, 2)}), r"got torch.float32 \[5, 2\]"),
        (lambda _, t: t.update({"pool.percept": torch.zeros(4, 1)}), r"pool.* \[4, 1\]"),
        (lambda _, t: t.update({"pool.percept": torch.tensor(1.0)}), r"got torch.float32 \[\]"),
        (lambda _, t: t["pool.target"].fill_(math.nan), "expected finite pool.target"),
        (lambda _, t: t["sequences.length"].fill_(2), r"expected lengths ≥ 1 of 5 rows"),
        (
            lambda _, t: t["sequences.length"].copy_(torch.tensor([0, 5])),
            r"expected lengths ≥ 1 of 5 rows in all .* got \[0, 5\]",
        ),
        (lambda c, _: c.update(width=-1), "expected SchemaNetworkConfig.width > 0"),
        (lambda c, _: c.pop("percept_dimensions"), "expected the fields of SchemaNetworkConfig"),
        (lambda c, _: c["competition"].update(threshold=7), r"CompetitionConfig.threshold in"),
        (lambda c, _: c.update(competition=3), "SchemaNetworkConfig.competition to be a"),
        (lambda c, _: c.update(model="PACNet"), "expected a checkpoint of SchemaNetwork"),
    ],
)
def test_a_damaged_checkpoint_is_refused(tmp_path: Path, change, message):
    rewrite(tmp_path, change)
    with pytest.raises(ValueError, match=message):
        SchemaNetwork.from_pretrained(tmp_path)


def test_a_tensor_that_is_not_finite_is_not_saved(tmp_path: Path):
    network = line()
    network.pool.live("target")[0] = math.nan
    with pytest.raises(ValueError, match=r"expected finite pool.target"):
        network.save_pretrained(tmp_path)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("field", "value", "message"),
    [
        ("percept_dimensions", 0, "percept_dimensions ≥ 1"),
        ("target_dimensions", True, "target_dimensions ≥ 1"),
        ("scale", (1.0, 2.0), "scale to be 1 positive finite factors"),
        ("scale", (-1.0,), "scale to be"),
        ("scale", 2.0, "scale to be"),
        ("width", 0.0, "width > 0"),
        ("width", math.inf, "width > 0"),
        ("competition", None, "competition to be a CompetitionConfig"),
    ],
)
def test_bad_config_is_refused(field, value, message):
    fields = {"percept_dimensions": 1, "target_dimensions": 1} | {field: value}
    with pytest.raises(ValueError, match=f"expected SchemaNetworkConfig.{message}"):
        SchemaNetworkConfig(**fields)


def test_a_scale_survives_json():
    scale = json.loads(json.dumps((1.0, 2.0)))
    assert SchemaNetworkConfig(2, 1, scale).scale == (1.0, 2.0)
