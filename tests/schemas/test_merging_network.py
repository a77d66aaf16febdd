"""A network within a budget: the same in any portions, and which states are refused."""

import copy
import threading

import pytest
import torch
from torch import Tensor

from pacnet import MotorSchemasConfig, PACNet, PACNetConfig, SOFMConfig
from pacnet.core.checkpoint import read_checkpoint, write_checkpoint

BUDGET = 12
DELETING = {"forgetting_interval": 20, "max_edge_age": 2}


def assert_same(one: torch.nn.Module, other: torch.nn.Module) -> None:
    got = other.state_dict()
    for name, expected in one.state_dict().items():
        assert torch.equal(expected, got[name]), name


def make_network(budget: int | None = BUDGET, engine: str = "auto", **fields: object) -> PACNet:
    attention = SOFMConfig.paper(2, **{"novelty_threshold": 0.6, **fields})
    return PACNet(PACNetConfig(attention, MotorSchemasConfig(1, 2, budget=budget)), engine=engine)


def wandering(samples: int = 120) -> tuple[Tensor, Tensor]:
    """Percepts among a few places, each held for a while, with noise, and their targets."""
    generator = torch.Generator().manual_seed(3)
    places = torch.randint(2, (samples // 10, 2), generator=generator).float()
    percepts = places.repeat_interleave(10, dim=0)
    return percepts + 0.1 * torch.rand(samples, 2, generator=generator), percepts[:, :1] + 0.0


@pytest.mark.parametrize("budget", [5, BUDGET])
def test_at_once_in_parts_over_checkpoints_and_with_either_engine_the_same_is_kept(
    budget: int, tmp_path
):
    """Nodes are forgotten, and with the smaller budget also deleted."""
    fields = {"forgetting_interval": 60} if budget == BUDGET else DELETING
    percepts, targets = wandering()
    whole, eager, single, saved = (
        make_network(budget, engine, **fields) for engine in ("compiled", "eager", "auto", "auto")
    )
    gone = 0
    for episode in range(2):
        gone += int(whole.observe(percepts, targets, episode).deleted.sum())
        eager.observe(percepts, targets, episode)
        for percept, target in zip(percepts, targets, strict=True):
            single.observe(percept[None], target[None], episode)
        for start, stop in ((0, 1), (1, 70), (70, 120)):
            saved.observe(percepts[start:stop], targets[start:stop], episode)
            saved.save_pretrained(tmp_path / "net")
            saved = PACNet.from_pretrained(tmp_path / "net")
    counts = whole.state_dict()["schemas.pool.count"]
    assert len(counts) <= budget < int(counts.sum())
    assert (gone > 0) == (fields is DELETING)
    for other in (eager, single, saved):
        assert_same(whole, other)


def test_a_thread_recalls_from_before_or_after_while_another_learns():
    percepts, targets = wandering()
    network = make_network()
    network.observe(percepts, targets, 0)
    states = [copy.deepcopy(network)]
    for _ in range(20):
        states.append(copy.deepcopy(states[-1]))
        states[-1].observe(percepts[:100], targets[:100] + len(states), 0)
    expected = {tuple(one.eval().recall(percepts[:9]).target.flatten().tolist()) for one in states}
    seen, over = set(), threading.Event()

    def watch() -> None:
        while not over.is_set():
            seen.add(tuple(network.recall(percepts[:9]).target.flatten().tolist()))

    watcher = threading.Thread(target=watch)
    watcher.start()
    try:
        for number in range(2, 22):
            network.observe(percepts[:100], targets[:100] + number, 0)
    finally:
        over.set()
        watcher.join()
    assert seen <= expected
    assert len(expected) == 21


# What is refused


def learned(budget: int | None) -> PACNet:
    network = make_network(budget)
    network.observe(*wandering(), 0)
    return network


def test_a_state_with_counts_does_not_load_without_a_budget_nor_the_other_way_round():
    bounded, unbounded = learned(BUDGET), learned(None)
    with pytest.raises(ValueError, match=r"of a budget, got \['pool\.count'\] missing"):
        make_network().load_state_dict(unbounded.state_dict())
    with pytest.raises(ValueError, match=r"of no budget, got .*\['pool\.count'\] extra"):
        make_network(None).load_state_dict(bounded.state_dict())
    with pytest.raises(ValueError, match="5 targets at most"):
        make_network(5).load_state_dict(bounded.state_dict())


def test_a_checkpoint_from_before_there_was_a_budget_loads(tmp_path):
    network = learned(None)
    network.save_pretrained(tmp_path)
    fields, tensors = read_checkpoint(tmp_path)
    del fields["schemas"]["budget"]
    write_checkpoint(tmp_path, fields, tensors)
    loaded = PACNet.from_pretrained(tmp_path)
    assert loaded.config == network.config
    assert_same(network, loaded)


@pytest.mark.parametrize("count", [0, -1, 2**53 + 1])
def test_a_damaged_count_is_refused(count: int):
    network = learned(BUDGET)
    before, state = copy.deepcopy(network), network.state_dict()
    state["schemas.pool.count"][1] = count
    with pytest.raises(ValueError, match="counts from 1 to"):
        network.load_state_dict(state)
    assert_same(before, network)
