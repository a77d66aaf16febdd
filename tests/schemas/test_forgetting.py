"""Forgetting of targets: what a dishabituated node stores replaces what it stored before."""

import itertools

import pytest
import torch
from torch import Tensor

from pacnet import MotorSchemas, MotorSchemasConfig, PACNet, PACNetConfig, SOFMConfig
from pacnet.attention.records import NO_NODE
from pacnet.schemas.interface import Samples

HERE = torch.zeros(1, 2)
FIRINGS = 10  # of a node until it is fully habituated, with the paper's settings
INTERVAL = 20  # samples


def make_network(engine: str = "auto", **fields: object) -> PACNet:
    """A network that forgets after 20 samples; on HERE a single node wins."""
    attention = SOFMConfig.paper(2, **{"forgetting_interval": INTERVAL, **fields})
    return PACNet(PACNetConfig(attention, MotorSchemasConfig(1, 2)), engine=engine)


def show(network: PACNet, first: int, last: int, episode: int = 0) -> list[list[float]]:
    """Show samples `first` to `last` − 1 at one place; return the targets after each.

    The target is the number of the sample.
    """
    seen = []
    for sample in range(first, last):
        network.observe(HERE, torch.tensor([[float(sample)]]), episode)
        seen.append(network.schemas.targets(0).flatten().tolist())
    return seen


def test_a_forgotten_node_replaces_its_targets_one_by_one_once_it_is_habituated_again():
    seen = show(make_network(), 0, 60)
    # Sample 0 makes the node, 1 to 10 habituate it: time is 11 then.
    begun = 1 + FIRINGS
    assert seen[begun - 1] == []
    assert seen[begun] == [begun]
    # It is dishabituated at time 31, which is sample 30: the last one stored is 29.
    before = list(range(begun, begun + INTERVAL - 1))
    assert seen[before[-1]] == before
    # It habituates again over samples 30 to 39. Nothing is lost meanwhile.
    again = before[-1] + 1 + FIRINGS
    for sample in range(before[-1] + 1, again):
        assert seen[sample] == before
    assert seen[again] == [*before[1:], again]
    assert seen[again + 1] == [*before[2:], again, again + 1]
    # 19 targets are stored in an interval of 20 samples. At 59 all old ones are replaced.
    assert len(before) == INTERVAL - 1
    assert seen[58] == list(range(again, 59))
    assert seen[59] == seen[58]  # forgotten again


def test_without_forgetting_every_target_of_an_episode_stays():
    assert show(make_network(forgetting_interval=None), 0, 60)[-1] == list(range(1 + FIRINGS, 60))


def test_a_neighbour_that_was_dishabituated_replaces_its_targets_too():
    """Two nodes at a distance of 1 that are joined: one forgets while the other wins."""
    attention = SOFMConfig.paper(1, forgetting_interval=INTERVAL, neighbour_rate=0.0)
    network = PACNet(PACNetConfig(attention, MotorSchemasConfig(1, 1)))
    # Both habituate: at time 11, and at 27. At 47 the second is forgotten, and the first with it.
    places = [0.0] * 16 + [1.0] * 34
    for sample, place in enumerate(places):
        network.observe(torch.tensor([[place]]), torch.tensor([[float(sample)]]), 0)
    assert len(network.sofm) == 2
    times = network.sofm.nodes.live("habituated_at").tolist()
    assert times[0] == NO_NODE
    assert network.schemas.targets(0).flatten().tolist() == [11, 12, 13, 14, 15]
    for sample in range(100, 100 + FIRINGS + 1):
        network.observe(torch.tensor([[0.0]]), torch.tensor([[float(sample)]]), 0)
    kept = network.schemas.targets(0).flatten().tolist()
    assert len(kept) == 5
    new = [target for target in kept if target >= 100]
    assert kept == [*range(11 + len(new), 16), *new]
    assert len(new) > 0


def wandering(samples: int = 400) -> tuple[Tensor, Tensor]:
    """Percepts among a few places, each held for a while, and a target that never repeats."""
    generator = torch.Generator().manual_seed(3)
    places = torch.randint(3, (samples // 8, 2), generator=generator).float()
    percepts = places.repeat_interleave(8, dim=0)
    return percepts, torch.arange(float(len(percepts)))[:, None]


def state_of(network: PACNet) -> dict[str, Tensor]:
    return network.state_dict()


def assert_same_state(one: PACNet, other: PACNet) -> None:
    got = state_of(other)
    for name, expected in state_of(one).items():
        assert torch.equal(expected, got[name]), name


@pytest.mark.parametrize("interval", [1, 10, 60])
def test_at_once_in_parts_and_with_either_engine_the_same_is_kept(interval: int, tmp_path):
    fields = {"forgetting_interval": interval, "winner_rate": 1.0, "neighbour_rate": 0.0}
    percepts, targets = wandering()
    whole, eager = (make_network(engine, **fields) for engine in ("compiled", "eager"))
    whole.observe(percepts, targets, 0)
    eager.observe(percepts, targets, 0)
    kept = whole.schemas.lengths.sum()
    assert 0 < kept < len(percepts) / 2 or interval == 1
    assert_same_state(whole, eager)

    single, saved = make_network(**fields), make_network(**fields)
    for percept, target in zip(percepts, targets, strict=True):
        single.observe(percept[None], target[None], 0)
    for number, (start, stop) in enumerate(itertools.pairwise((0, 1, 90, 91, 260, 400))):
        saved.observe(percepts[start:stop], targets[start:stop], 0)
        saved.save_pretrained(tmp_path / str(number))
        saved = PACNet.from_pretrained(tmp_path / str(number))
    assert_same_state(whole, single)
    assert_same_state(whole, saved)


def test_a_state_of_an_older_release_loads_and_forgets_from_then_on():
    network = make_network()
    show(network, 0, 25)
    lacking = tuple(f"schemas.blocks.{column}" for column in ("habituated_at", "forgotten"))
    old = {name: rows for name, rows in network.state_dict().items() if name not in lacking}
    loaded = make_network()
    loaded.load_state_dict(old)
    assert loaded.schemas.blocks.live("habituated_at").tolist() == [NO_NODE]
    # It goes on where it was: 25 to 29 are appended, and 40 replaces 11.
    seen = show(loaded, 25, 43)
    assert seen[29 - 25] == list(range(11, 30))
    assert seen[-1] == [*range(14, 30), 40, 41, 42]
    schemas = MotorSchemas(MotorSchemasConfig(1, 2))
    own = {k.removeprefix("schemas."): v for k, v in old.items() if k.startswith("schemas.")}
    schemas.load_state_dict(own)
    assert schemas.targets(0).flatten().tolist() == list(range(11, 25))


def test_written_directly_a_later_time_replaces_and_an_unknown_one_does_not():
    schemas = MotorSchemas(MotorSchemasConfig(1, 1))
    schemas.add_node()
    seen = []
    for value, since in ((1, NO_NODE), (2, NO_NODE), (3, 4), (4, 30), (5, 30)):
        target = torch.tensor([float(value)])
        schemas.write(0, target, target, 0, habituated=True, habituated_at=since)
        seen.append(schemas.targets(0).flatten().tolist())
    assert seen == [[1], [1, 2], [1, 2, 3], [2, 3, 4], [3, 4, 5]]
    with pytest.raises(ValueError, match="sample"):
        schemas.write(0, target, target, 0, habituated=True, habituated_at=-2)


def test_a_new_episode_clears_what_was_forgotten():
    schemas = MotorSchemas(MotorSchemasConfig(1, 1))
    schemas.add_node()
    for value, since, episode in ((1, 4, 0), (2, 4, 0), (3, 30, 0), (4, 30, 1), (5, 30, 1)):
        target = torch.tensor([float(value)])
        schemas.write(0, target, target, episode, habituated=True, habituated_at=since)
    assert schemas.targets(0).flatten().tolist() == [4, 5]


def test_random_portions_equal_a_dict_of_lists():
    """Portions of samples of several nodes, some of which are forgotten once or more in one."""
    generator = torch.Generator().manual_seed(0)
    schemas, expected = MotorSchemas(MotorSchemasConfig(1, 1)), {n: [] for n in range(4)}
    for _ in expected:
        schemas.add_node()
    since, old, number = [0] * 4, [0] * 4, 0
    for _ in range(12):
        nodes = torch.randint(4, (9,), generator=generator)
        forgets = torch.rand(9, generator=generator) < 0.2
        times, values = [], []
        for node, forgotten in zip(nodes.tolist(), forgets.tolist(), strict=True):
            number += 1
            if forgotten:
                since[node], old[node] = number, len(expected[node])
            if old[node]:
                old[node] -= 1
                expected[node].pop(0)
            times.append(since[node])
            values.append(float(number))
            expected[node].append(float(number))
        column = torch.tensor(values)[:, None]
        yes, one = torch.ones(9, dtype=torch.bool), torch.ones(9)
        schemas.add_samples(Samples(nodes, one, yes, column, column, torch.tensor(times)), 0)
        for node, kept in expected.items():
            assert schemas.targets(node).flatten().tolist() == kept
