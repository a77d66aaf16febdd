"""The whole network: what it learns by watching, what it commands, and what it refuses."""

import copy
import json
import math
import signal
import threading
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
import torch

import pacnet.network.state
from pacnet import (
    CompetingSchemasConfig,
    MotorSchemas,
    MotorSchemasConfig,
    PACNet,
    PACNetConfig,
    SOFMConfig,
)
from pacnet.core.checkpoint import read_checkpoint, write_checkpoint
from pacnet.schemas.interface import NO_EPISODE
from pacnet.schemas.sequences import Sequences


def make_network(preset: str = "paper", **fields: object) -> PACNet:
    attention = getattr(SOFMConfig, preset)(2, novelty_threshold=0.6, **fields)
    return PACNet(PACNetConfig(attention, MotorSchemasConfig(1, percept_dimensions=2)))


def make_circle(samples: int = 200, noise: float = 0.0, seed: int = 0) -> tuple[torch.Tensor, ...]:
    """Percepts on a circle of radius 2; the target is the sine of the angle a little ahead."""
    angle = torch.linspace(0, 2 * math.pi, samples + 1)[:-1]
    percepts = 2 * torch.stack([angle.cos(), angle.sin()], dim=1)
    generator = torch.Generator().manual_seed(seed)
    percepts = percepts + noise * torch.randn(percepts.shape, generator=generator)
    return percepts, (angle + 0.1).sin()[:, None]


def make_trained(episodes: int = 3, **fields: object) -> PACNet:
    network = make_network(**fields)
    for episode in range(episodes):
        network.observe(*make_circle(noise=0.01, seed=episode), episode=episode)
    return network


def assert_same(one: torch.Tensor, other: torch.Tensor) -> None:
    """Equal to the last bit, NaN to NaN."""
    torch.testing.assert_close(one, other, rtol=0, atol=0, equal_nan=True)


def assert_same_state(one: PACNet, other: PACNet) -> None:
    expected, got = one.state_dict(), other.state_dict()
    assert expected.keys() == got.keys()
    for name, value in expected.items():
        assert torch.equal(value, got[name]), name


def test_recall_gives_the_targets_that_were_shown():
    network = make_trained()
    percepts, targets = make_circle(noise=0.01, seed=9)
    recall = network.recall(percepts)
    assert recall.has_target.all()
    assert (recall.target - targets).abs().mean() < 0.03


def test_recall_keeps_pace_with_a_slower_and_a_faster_teacher():
    network = make_trained()
    for samples in (120, 400):
        network.reset()
        percepts, targets = make_circle(samples, noise=0.01, seed=9)
        assert (network.recall(percepts).target - targets).abs().mean() < 0.03


def test_below_the_match_threshold_nothing_is_commanded():
    network = make_trained()
    recall = network.recall(torch.tensor([[50.0, 50.0], [2.0, 0.0]]))
    assert recall.has_target.tolist() == [False, True]
    assert recall.is_novel.tolist() == [True, False]
    assert recall.target.isnan().flatten().tolist() == [True, False]
    assert recall.offset[0].item() == -1


def test_a_node_that_never_habituated_commands_nothing():
    network = make_network()
    percepts = torch.zeros(5, 2)
    network.observe(percepts, torch.ones(5, 1), episode=0)
    recall = network.recall(percepts[:1])
    assert not recall.is_novel.item()
    assert not recall.has_target.item()


def test_an_untrained_network_commands_nothing():
    recall = make_network().recall(torch.zeros(3, 2))
    assert not recall.has_target.any()
    assert recall.winner.tolist() == [-1, -1, -1]


def test_only_samples_at_which_a_habituated_node_won_are_kept():
    network = make_network()
    record = network.observe(torch.zeros(30, 2), torch.arange(30.0)[:, None], episode=0)
    kept = network.schemas.targets(0).flatten()
    assert kept.tolist() == record.ignored.nonzero().flatten().tolist()
    assert kept[0] == 11  # inserted at 0, ten firings, then habituated


def test_a_new_episode_replaces_what_its_nodes_kept():
    network = make_network()
    network.observe(torch.zeros(30, 2), torch.zeros(30, 1), episode=0)
    network.observe(torch.zeros(4, 2), torch.ones(4, 1), episode=1)
    assert network.schemas.targets(0).flatten().tolist() == [1, 1, 1, 1]


def test_nodes_and_motor_schemas_stay_in_step_through_deletions():
    network = make_network(preset="gwr", max_edge_age=4, neighbour_rate=0.05)
    generator = torch.Generator().manual_seed(1)
    percepts = torch.randn(1500, 2, generator=generator).mul(0.3).cumsum(0) % 3
    deleted = 0
    for episode in range(3):
        # The target says where the percept was, so a schema given to a wrong node would show.
        deleted += int(network.observe(percepts, percepts[:, :1], episode).deleted.sum())
    assert deleted > 0
    assert len(network.schemas) == len(network.sofm)
    for node, prototype in enumerate(network.sofm.prototypes):
        distance = (network.schemas.targets(node) - prototype[0]).abs()
        assert len(distance) == 0 or distance.median() < 0.5


@pytest.mark.parametrize("preset", ["paper", "gwr"])
def test_a_sequence_at_once_equals_sample_by_sample(preset: str):
    whole, single = make_network(preset), make_network(preset)
    percepts, targets = make_circle(noise=0.05)
    for episode in range(2):
        whole.observe(percepts, targets, episode)
        for percept, target in zip(percepts, targets, strict=True):
            single.observe(percept[None], target[None], episode)
    for name, value in whole.state_dict().items():
        assert torch.equal(value, single.state_dict()[name]), name
    at_once = whole.recall(percepts)
    for sample, percept in enumerate(percepts):
        one = single.recall(percept[None])
        assert_same(one.target[0], at_once.target[sample])
        assert one.offset[0] == at_once.offset[sample]


def test_eval_mode_learns_nothing_and_recall_changes_nothing_learned():
    network = make_trained().eval()
    before = copy.deepcopy(network.state_dict())
    record = network.observe(*make_circle(noise=0.5, seed=3), episode=7)
    network.recall(make_circle()[0])
    assert record.ignored.all()
    for name, value in network.state_dict().items():
        assert torch.equal(value, before[name]), name


@pytest.mark.parametrize("schemas", [MotorSchemasConfig(1, 2), CompetingSchemasConfig(1, 2)])
def test_a_state_before_the_last_episode_of_its_schemas_is_refused(schemas):
    network = PACNet(PACNetConfig(SOFMConfig.paper(2), schemas))
    for episode in (0, 3):
        network.observe(torch.zeros(15, 2), torch.zeros(15, 1), episode)
    state = network.state_dict()
    for episode in (2, NO_EPISODE):
        with pytest.raises(ValueError, match="expected an episode ≥ −1, the last of all"):
            network.check_state({**state, "episode": torch.tensor(episode)})
    for episode in (3, 4):  # one that no node kept may come last
        network.check_state({**state, "episode": torch.tensor(episode)})


@pytest.mark.parametrize("schemas", [MotorSchemasConfig(1, 2), CompetingSchemasConfig(1, 2)])
def test_an_untrained_state_has_no_episode_and_none_before_that(schemas):
    network = PACNet(PACNetConfig(SOFMConfig.paper(2), schemas))
    network.check_state(network.state_dict())
    with pytest.raises(ValueError, match="expected an episode ≥ −1, the last of all"):
        network.check_state({**network.state_dict(), "episode": torch.tensor(NO_EPISODE - 1)})


def test_learning_goes_on_after_save_and_load(tmp_path):
    network = make_trained()
    network.save_pretrained(tmp_path)
    loaded = PACNet.from_pretrained(tmp_path)
    assert loaded.config == network.config
    percepts, targets = make_circle(noise=0.2, seed=5)
    for one in (network, loaded):
        one.observe(percepts, targets, episode=3)
    for name, value in network.state_dict().items():
        assert torch.equal(value, loaded.state_dict()[name]), name
    assert_same(network.recall(percepts).target, loaded.recall(percepts).target)


def test_an_untrained_network_saves_and_loads(tmp_path):
    make_network().save_pretrained(tmp_path)
    loaded = PACNet.from_pretrained(tmp_path)
    loaded.observe(*make_circle(), episode=0)
    assert len(loaded.sofm) > 1


def test_the_config_survives_json(tmp_path):
    attention = SOFMConfig.gwr(2, scale=(0.1, 1 / 3), novelty_threshold=0.7)
    network = PACNet(PACNetConfig(attention, MotorSchemasConfig(1, 2, recall_by="order")))
    network.save_pretrained(tmp_path)
    assert PACNet.from_pretrained(tmp_path).config == network.config


@pytest.mark.parametrize(
    ("schemas", "kind"),
    [
        (MotorSchemasConfig(1, 2, nearest_cues=3), "motor_schemas"),
        (CompetingSchemasConfig(1, 2, nearest_cues=3), "competing_schemas"),
    ],
)
def test_a_checkpoint_names_the_kind_of_schemas_and_older_ones_load_without(
    schemas, kind: str, tmp_path
):
    network = PACNet(PACNetConfig(SOFMConfig.paper(2), schemas))
    network.save_pretrained(tmp_path)
    file = tmp_path / "config.json"
    assert json.loads(file.read_text())["config"]["schemas"]["type"] == kind
    assert PACNet.from_pretrained(tmp_path).config == network.config
    fields, tensors = read_checkpoint(tmp_path)
    del fields["schemas"]["type"]
    write_checkpoint(tmp_path, fields, tensors)
    assert "type" not in json.loads(file.read_text())["config"]["schemas"]
    loaded = PACNet.from_pretrained(tmp_path)
    assert loaded.config == network.config
    assert type(loaded.schemas) is type(network.schemas)


BAD_PAIRS = {
    "NaN percept": (torch.tensor([[0.0, math.nan]]), torch.zeros(1, 1), "finite percepts"),
    "infinite target": (torch.zeros(1, 2), torch.tensor([[math.inf]]), "finite targets"),
    "percept dimension": (torch.zeros(3, 4), torch.zeros(3, 1), r"percepts.*\[rows, 2\]"),
    "target dimension": (torch.zeros(3, 2), torch.zeros(3, 2), r"targets.*\[rows, 1\]"),
    "target dtype": (torch.zeros(3, 2), torch.zeros(3, 1).double(), "targets.*float64"),
    "fewer targets": (torch.zeros(3, 2), torch.zeros(2, 1), "expected equally many rows"),
    "empty": (torch.zeros(0, 2), torch.zeros(0, 1), "at least one row"),
}


@pytest.mark.parametrize("case", BAD_PAIRS)
def test_bad_input_is_refused_before_anything_changes(case: str):
    network = make_trained()
    before = copy.deepcopy(network.state_dict())
    percepts, targets, message = BAD_PAIRS[case]
    with pytest.raises(ValueError, match=message):
        network.observe(percepts, targets, episode=3)
    for name, value in network.state_dict().items():
        assert torch.equal(value, before[name]), name


@pytest.mark.parametrize(
    ("episode", "message"),
    [(1, "episode ≥ 2.*got 1"), (-1, "got -1"), (2.0, "got 2.0"), (True, "got True")],
)
def test_an_episode_that_goes_backwards_or_is_no_number_is_refused(episode, message):
    network = make_trained(episodes=3)
    with pytest.raises(ValueError, match=message):
        network.observe(*make_circle(), episode=episode)


def test_parts_that_do_not_fit_are_refused():
    with pytest.raises(ValueError, match=r"percept_dimensions.*= 2, got 3"):
        PACNetConfig(SOFMConfig.paper(2), MotorSchemasConfig(1, percept_dimensions=3))


@pytest.mark.parametrize("preset", ["paper", "gwr"])
def test_presets_take_any_field(preset: str):
    config = getattr(SOFMConfig, preset)(2, winner_rate=0.3, insert_at="percept")
    assert (config.winner_rate, config.insert_at) == (0.3, "percept")


def test_an_episode_may_be_a_numpy_integer_and_must_fit_int64():
    network = make_network()
    network.observe(*make_circle(), episode=np.int64(3))
    assert network.episode.item() == 3
    with pytest.raises(ValueError, match="from 0 to 9223372036854775807"):
        network.observe(*make_circle(), episode=2**63)


def test_reset_starts_every_sequence_again():
    config = PACNetConfig(SOFMConfig.paper(2), MotorSchemasConfig(1, 2, recall_by="order"))
    network, percepts = PACNet(config), torch.zeros(20, 2)
    network.observe(percepts, percepts[:, :1], episode=0)
    assert network.recall(percepts[:3]).offset.tolist() == [0, 1, 2]
    assert network.recall(percepts[:1]).offset.tolist() == [3]
    network.reset()
    assert network.recall(percepts[:2]).offset.tolist() == [0, 1]


def test_in_the_preset_gwr_a_habituated_node_keeps_targets_and_goes_on_learning():
    network = make_network("gwr")
    record = network.observe(torch.zeros(30, 2), torch.arange(30.0)[:, None], episode=0)
    assert record.attended.all()
    assert network.schemas.targets(0).flatten().tolist() == list(range(11, 30))


def test_percepts_reach_the_schemas_scaled():
    attention = SOFMConfig.paper(2, scale=(0.01, 1.0), forgetting_interval=None)
    network = PACNet(PACNetConfig(attention, MotorSchemasConfig(1, 2)))
    network.observe(torch.zeros(11, 2), torch.zeros(11, 1), episode=0)  # habituates
    network.observe(torch.tensor([[40.0, 0.0], [0.0, 0.3]]), torch.tensor([[1.0], [2.0]]), 0)
    # scaled, the percept is at (.1, .0): .3 from the first cue, sqrt(.01 + .09) = .316 from the
    # second; unscaled, 10 lies 10.0 from the second and 9.6 from the scaled first.
    assert network.schemas.cues(0).tolist() == [[pytest.approx(0.4), 0], [0, pytest.approx(0.3)]]
    assert network.recall(torch.tensor([[10.0, 0.3]])).target.item() == 2
    assert network.recall(torch.tensor([[25.0, 0.0]])).target.item() == 1


def test_eval_mode_keeps_the_episode_too():
    network = make_network().eval()
    network.observe(torch.zeros(2, 2), torch.zeros(2, 1), episode=5)
    network.train().observe(torch.zeros(2, 2), torch.zeros(2, 1), episode=0)


def test_at_the_sample_that_deletes_a_node_the_winner_still_keeps_its_target():
    network = make_network(max_edge_age=2, ignore_when_habituated=False, neighbour_rate=0.0)
    rows = [(9, 0), *[(0, 0)] * 12, (0, 2), *[(0, 0)] * 3]  # nodes 0, 1, 2; edges 0-1, 1-2
    seen = torch.tensor(rows, dtype=torch.float32)
    record = network.observe(seen, torch.arange(17.0)[:, None], episode=0)
    assert record.deleted.nonzero().flatten().tolist() == [15]  # node 0: the winner was 1, is 0
    assert network.schemas.targets(0).flatten().tolist() == [12, 14, 15, 16]


@pytest.fixture
def sigint() -> Iterator[None]:
    """Ctrl-C is a KeyboardInterrupt; a background job hands down an ignored one."""
    previous = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, previous)


LEARNING = {
    "observe": lambda network: network.observe(*make_circle(noise=0.3, seed=7), episode=3),
    "attend": lambda network: network.attend(make_circle(noise=0.3, seed=7)[0]),
}


@pytest.mark.usefixtures("sigint")
@pytest.mark.parametrize("verb", LEARNING)
def test_ctrl_c_between_map_and_schemas_leaves_what_was_known(verb: str, monkeypatch, tmp_path):
    network, untouched = make_trained(), make_trained()
    watched = network.recall(make_circle(noise=0.1, seed=4)[0])
    add_node, added = MotorSchemas.add_node, []

    def interrupted_add_node(schemas: MotorSchemas) -> int:
        added.append(add_node(schemas))
        if len(added) == 3:
            signal.raise_signal(signal.SIGINT)
        return added[-1]

    monkeypatch.setattr(MotorSchemas, "add_node", interrupted_add_node)
    with pytest.raises(KeyboardInterrupt):
        LEARNING[verb](network)
    assert len(added) == 3
    monkeypatch.undo()
    assert_same_state(network, untouched)
    network.reset()
    for one, other in zip(network.recall(make_circle(noise=0.1, seed=4)[0]), watched, strict=True):
        assert_same(one, other)
    network.save_pretrained(tmp_path)
    for one in (network, untouched, PACNet.from_pretrained(tmp_path)):
        LEARNING[verb](one)
        assert len(one.sofm) == len(one.schemas) > len(watched.winner.unique())
    assert_same_state(network, untouched)


@pytest.mark.usefixtures("sigint")
def test_ctrl_c_while_what_was_learned_is_taken_over_comes_after_it(monkeypatch):
    network, expected = make_trained(), make_trained()
    adopt, adopted = pacnet.network.state.adopt, []

    def interrupted_adopt(*modules: torch.nn.Module) -> None:
        signal.raise_signal(signal.SIGINT)
        adopt(*modules)
        adopted.append(modules)

    monkeypatch.setattr("pacnet.network.state.adopt", interrupted_adopt)
    with pytest.raises(KeyboardInterrupt):
        LEARNING["observe"](network)
    assert len(adopted) == 2  # map and schemas
    monkeypatch.undo()
    LEARNING["observe"](expected)
    assert_same_state(network, expected)


def test_an_error_while_learning_leaves_what_was_known(monkeypatch):
    network, untouched = make_trained(), make_trained()

    def out_of_memory(*_: object) -> None:
        raise MemoryError

    monkeypatch.setattr(MotorSchemas, "append_rows", out_of_memory)
    with pytest.raises(MemoryError):
        LEARNING["observe"](network)
    monkeypatch.undo()
    assert_same_state(network, untouched)
    for one in (network, untouched):
        LEARNING["observe"](one)
    assert_same_state(network, untouched)


@pytest.mark.parametrize("schemas", [MotorSchemasConfig(1, 2), CompetingSchemasConfig(1, 2)])
def test_while_a_thread_learns_others_recall_what_was_known(schemas, monkeypatch):
    network = PACNet(PACNetConfig(SOFMConfig.paper(2, novelty_threshold=0.6), schemas))
    network.observe(*make_circle(noise=0.01), episode=0)
    before, after = copy.deepcopy(network), copy.deepcopy(network)
    LEARNING["observe"](after)
    asked = make_circle(noise=0.3, seed=8)[0]
    half_way, go_on = threading.Event(), threading.Event()
    append_rows = Sequences.append_rows

    def append_slowly(*args: object) -> None:
        append_rows(*args)
        half_way.set()
        assert go_on.wait(60)

    monkeypatch.setattr(Sequences, "append_rows", append_slowly)
    with ThreadPoolExecutor(1) as pool:
        learned = pool.submit(LEARNING["observe"], network)
        try:
            assert half_way.wait(60)
            for one, other in zip(network.recall(asked), before.recall(asked), strict=True):
                assert_same(one, other)
            assert_same_state(network, before)
        finally:
            go_on.set()
        assert learned.result().inserted.any()
    for one, other in zip(network.recall(asked), after.recall(asked), strict=True):
        assert_same(one, other)
    assert_same_state(network, after)
