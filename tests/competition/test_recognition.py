"""Several schemas per node in the whole network: what it understands, and what it recalls."""

from __future__ import annotations

import copy
import functools
import math
import pickle
import signal
from collections.abc import Callable

import pytest
import torch
from torch import Tensor

from pacnet import (
    CompetingSchemas,
    CompetingSchemasConfig,
    MotorSchemasConfig,
    PACNet,
    PACNetConfig,
    RecognitionConfig,
    SOFMConfig,
)

PLACES = 64
SCALE = (0.5, 2.0)
NAMES = ("up", "down")


def make_network(preset: str = "paper", scale: tuple = SCALE, **fields: object) -> PACNet:
    attention = getattr(SOFMConfig, preset)(2, novelty_threshold=0.6, scale=scale)
    recognition = RecognitionConfig(n_states=PLACES, obs_std=0.1)
    schemas = CompetingSchemasConfig(1, percept_dimensions=2, recognition=recognition, **fields)
    return PACNet(PACNetConfig(attention, schemas))


def make_episode(
    side: int, samples: int = 120, noise: float = 0.01, seed: int = 0
) -> tuple[Tensor, Tensor]:
    """Along x and from half way on also up or down; scaled, it is 2 long in each. Targets say y."""
    time = torch.linspace(0, 1, samples)
    way = torch.stack([2 * time, side * 2 * (2 * time - 1).clamp(min=0)], dim=1)
    generator = torch.Generator().manual_seed(seed)
    scaled = way + noise * torch.randn(way.shape, generator=generator)
    return scaled / torch.tensor(SCALE), way[:, 1:]


def side_of(episode: int) -> int:
    return 1 if episode % 2 == 0 else -1


def teach(network: PACNet, episodes: int = 4, named: bool = True, **fields: float) -> PACNet:
    """Show "up" and "down" alternately."""
    for episode in range(episodes):
        side = side_of(episode)
        name = NAMES[episode % 2] if named else ""
        network.observe(*make_episode(side, seed=100 + episode, **fields), episode, name)
    return network


@functools.cache
def trained_once() -> PACNet:
    return teach(make_network())


def make_trained() -> PACNet:
    return copy.deepcopy(trained_once())


def assert_same(one: tuple, other: tuple) -> None:
    """Equal to the last bit, NaN to NaN."""
    for a, b in zip(one, other, strict=True):
        if a is None and b is None:
            continue
        torch.testing.assert_close(a, b, rtol=0, atol=0, equal_nan=True)


def assert_same_state(one: PACNet, other: PACNet) -> None:
    state = other.state_dict()
    for name, value in one.state_dict().items():
        assert torch.equal(value, state[name]), name


# What is understood


@pytest.mark.parametrize("samples", [80, 120, 180])
@pytest.mark.parametrize("side", [1, -1])
def test_behaviour_progress_next_and_end_of_what_is_watched(side: int, samples: int):
    network = make_trained().eval()
    assert network.behaviours == NAMES
    percepts, _ = make_episode(side, samples, seed=side + 1)
    seen = network.recognise(percepts)
    time, ours = torch.linspace(0, 1, samples), 0 if side == 1 else 1
    torch.testing.assert_close(seen.probability.sum(dim=1), torch.ones(samples))
    assert (seen.probability[time > 0.6, ours] > 0.95).all()
    assert (seen.behaviour[time > 0.6] == ours).all()
    assert torch.equal(seen.behaviour, seen.probability.argmax(dim=1))
    assert (seen.progress - time).abs().mean() < 0.02
    assert not seen.is_novel.any()
    scale = torch.tensor(SCALE)
    end = torch.tensor([2.0, 2.0 * side])
    known = seen.behaviour == ours
    assert (seen.end_percept * scale - end)[known].norm(dim=1).max() < 0.1
    error = (seen.next_percept[:-1] - percepts[1:]) * scale
    assert error[known[:-1]].norm(dim=1).mean() < 0.06


def test_an_exact_repeat_is_followed_to_the_place():
    network = make_network()
    for episode in range(4):
        network.observe(*make_episode(side_of(episode), noise=0.0), episode, NAMES[episode % 2])
    seen = network.recognise(make_episode(1, noise=0.0)[0])
    time = (torch.arange(120) + 0.5) / 120
    assert (seen.progress - time).abs().mean() < 1 / PLACES
    assert (seen.progress - time).abs().max() < 2 / PLACES


def test_the_expected_next_percept_is_nearer_than_the_present_one():
    network = make_trained()
    percepts, _ = make_episode(1, noise=0.0)
    seen, scale = network.recognise(percepts), torch.tensor(SCALE)
    # Of a movement of constant pace the next percept lies as far on as the present from the last.
    ahead = (seen.next_percept[70:110] - percepts[70:110]) * scale
    step = (percepts[71:111] - percepts[70:110]) * scale
    assert ((ahead * step).sum(dim=1).mean() / step.square().sum(dim=1).mean()).item() == (
        pytest.approx(1, abs=0.5)
    )


def test_what_lasts_sets_the_next_percept_off_from_the_known_ones():
    network, shift = make_trained(), 0.15  # in scaled units
    percepts = make_episode(1, noise=0.0)[0]
    percepts[:, 1] += shift / SCALE[1]
    off = (network.recognise(percepts).next_percept[:-1] - percepts[1:])[:, 1] * SCALE[1]
    assert off[0].item() == pytest.approx(-shift, abs=0.05)
    assert off[25:55].abs().mean() < 0.3 * shift


def test_before_they_part_neither_is_sure():
    seen = make_trained().recognise(make_episode(1, seed=9)[0])
    assert (seen.probability[:50].amax(dim=1) < 0.9).all()


def test_every_behaviour_is_as_likely_at_first_however_often_it_was_shown():
    network = make_network()
    for episode, side in enumerate((1, 1, 1, -1)):
        name = "up" if side == 1 else "down"
        network.observe(*make_episode(side, noise=0.0), episode, name)
    first = network.recognise(make_episode(1, noise=0.0)[0][:1]).probability[0]
    assert first.tolist() == pytest.approx([0.5, 0.5], abs=0.1)  # the first episode trained less


def test_novelty_is_the_distance_to_the_nearest_known_percept_by_hand():
    network = make_network()
    # Node 0 habituates at the 11th sample and keeps these two, in scaled units (0, 0) and (.3, 0).
    network.observe(torch.zeros(12, 2), torch.zeros(12, 1), episode=0)
    network.observe(torch.tensor([[0.6, 0.0]]), torch.zeros(1, 1), episode=0)
    percepts = torch.tensor([[0.0, 0.0], [0.6, 0.0], [0.0, 0.2], [0.6, 0.1], [-8.0, 0.0]])
    seen = network.recognise(percepts)
    distances = (0.0, 0.0, 0.4, 0.2, 4.0)
    expected = [1 - math.exp(-distance) for distance in distances]
    assert seen.novelty.tolist() == pytest.approx(expected, abs=1e-6)
    assert seen.is_novel.tolist() == [False, False, True, False, True]  # over .3
    assert seen.winner.tolist() == [0, 0, 0, 0, -1]


def test_spare_room_is_no_known_percept():
    network = make_network()
    far = torch.tensor([[8.0, 2.0]])  # so that zeros are unknown
    network.observe(far.expand(30, 2), torch.zeros(30, 1), episode=0)
    assert network.recognise(torch.zeros(1, 2)).novelty.item() > 0.99


def test_a_behaviour_that_was_never_shown_is_novel_where_it_differs():
    network = make_trained()
    percepts, _ = make_episode(1, seed=9)
    percepts[60:, 1] = 0.0  # straight on: neither up nor down
    seen = network.recognise(percepts)
    assert not seen.is_novel[:70].any()
    assert seen.is_novel[90:].all()


def test_after_a_change_of_behaviour_the_other_one_is_named():
    network = make_trained()
    up, down = make_episode(1, seed=9)[0], make_episode(-1, seed=9)[0]
    seen = network.recognise(torch.cat([up[:90], down[90:]]))
    assert (seen.behaviour[75:90] == 0).all()
    assert (seen.behaviour[100:] == 1).all()


def test_a_burst_of_noise_does_not_turn_the_behaviour():
    network = make_trained()
    percepts, _ = make_episode(1, seed=9)
    percepts[95:98] = 3 * torch.randn(3, 2, generator=torch.Generator().manual_seed(1))
    assert (network.recognise(percepts).behaviour[75:] == 0).all()


# What is done


@pytest.mark.parametrize("named", [True, False])
@pytest.mark.parametrize("side", [1, -1])
def test_recall_follows_the_one_that_is_shown_with_names_or_without(side: int, named: bool):
    network = teach(make_network(), named=named)
    assert network.behaviours == (NAMES if named else ("",))
    percepts, targets = make_episode(side, seed=9)
    recall = network.recall(percepts)
    after = slice(75, None)
    assert recall.has_target[after].float().mean() > 0.9
    assert (recall.target[after] - targets[after]).abs().nanmean() < 0.1


def test_the_schema_recalled_belongs_to_the_winner_and_holds_the_target():
    network = make_trained()
    recall = network.recall(make_episode(-1, seed=9)[0])
    for sample in recall.has_target.nonzero().flatten().tolist():
        schema, position = int(recall.schema[sample]), int(recall.offset[sample])
        assert network.schemas.blocks.live("node")[schema] == recall.winner[sample]
        assert torch.equal(network.schemas.targets(schema)[position], recall.target[sample])
    assert (recall.schema == -1).equal(~recall.has_target)
    assert recall.has_target.any()


def test_below_the_match_threshold_nothing_is_commanded():
    recall = make_trained().recall(torch.full((3, 2), 50.0))
    assert not recall.has_target.any()
    assert recall.target.isnan().all()


# Over time


def test_observing_at_once_equals_sample_by_sample():
    whole, single = make_network(lookahead_samples=4), make_network(lookahead_samples=4)
    for episode in range(3):
        percepts, targets = make_episode(side_of(episode), seed=episode)
        whole.observe(percepts, targets, episode, "same")
        for percept, target in zip(percepts, targets, strict=True):
            single.observe(percept[None], target[None], episode, "same")
    assert_same_state(whole, single)


def joined(parts: list[tuple]) -> tuple:
    """One record of several, field by field; a field that is None stays it."""
    fields = zip(*parts, strict=True)
    return tuple(None if field[0] is None else torch.cat(field) for field in fields)


@pytest.mark.parametrize("verb", ["recognise", "recall"])
@pytest.mark.parametrize("chunk", [1, 50])
def test_in_chunks_equals_at_once(verb: str, chunk: int):
    network, percepts = make_trained(), make_episode(1, seed=9)[0]
    at_once = getattr(network, verb)(percepts)
    network.reset()
    parts = [getattr(network, verb)(part) for part in percepts.split(chunk)]
    assert_same(at_once, joined(parts))


def test_recognising_and_recalling_do_not_disturb_one_another():
    percepts = make_episode(-1, seed=9)[0]
    alone = make_trained(), make_trained()
    recognised, recalled = alone[0].recognise(percepts), alone[1].recall(percepts)
    both, seen, done = make_trained(), [], []
    for part in percepts.split(30):
        seen.append(both.recognise(part))
        done.append(both.recall(part))
    assert_same(recognised, joined(seen))
    assert_same(recalled, joined(done))


def test_reset_forgets_what_was_watched():
    network, (up, _), (down, _) = make_trained(), make_episode(1, seed=9), make_episode(-1, seed=9)
    expected = network.recognise(down), network.recall(down)
    network.reset()
    network.recognise(up)
    network.recall(up)
    network.reset()
    assert_same(network.recognise(down), expected[0])
    assert_same(network.recall(down), expected[1])


@pytest.mark.parametrize(
    "copied", [copy.deepcopy, lambda network: pickle.loads(pickle.dumps(network))],
    ids=["deep copy", "pickle"],
)  # fmt: skip
def test_a_copy_goes_on_where_the_original_is_and_then_its_own_way(
    copied: Callable[[PACNet], PACNet],
):
    network = make_trained()
    (up, _), (down, _) = make_episode(1, seed=9), make_episode(-1, seed=9)
    network.recognise(up[:80])
    network.recall(up[:80])
    reference, other = copied(network), copied(network)
    reference.recognise(down)
    reference.recall(down)
    assert_same(network.recognise(up[80:]), other.recognise(up[80:]))
    assert_same(network.recall(up[80:]), other.recall(up[80:]))


def test_watching_may_go_on_outside_of_inference_mode():
    network, other, percepts = make_trained(), make_trained(), make_episode(1, seed=9)[0]
    with torch.inference_mode():
        network.recognise(percepts[:80])
        network.recall(percepts[:80])
    other.recognise(percepts[:80])
    other.recall(percepts[:80])
    assert_same(network.recognise(percepts[80:]), other.recognise(percepts[80:]))
    assert_same(network.recall(percepts[80:]), other.recall(percepts[80:]))


def test_saving_in_the_middle_changes_nothing(tmp_path):
    saved, other, percepts = make_trained(), make_trained(), make_episode(1, seed=9)[0]
    for network in (saved, other):
        network.recognise(percepts[:80])
        network.recall(percepts[:80])
    saved.save_pretrained(tmp_path)
    assert_same(saved.recognise(percepts[80:]), other.recognise(percepts[80:]))
    assert_same(saved.recall(percepts[80:]), other.recall(percepts[80:]))


def test_what_is_learned_in_the_middle_is_recognised_from_then_on():
    network = make_trained()
    network.recognise(make_episode(1, seed=9)[0])
    percepts = torch.tensor([[20.0, 5.0]])
    assert network.recognise(percepts).is_novel.item()
    network.observe(percepts.expand(30, 2), torch.zeros(30, 1), episode=9, behaviour="stay")
    seen = network.recognise(percepts)
    assert not seen.is_novel.item()
    assert seen.probability.shape == (1, 3)


def test_eval_mode_learns_nothing_and_watching_changes_nothing():
    network = make_trained().eval()
    before = copy.deepcopy(network)
    percepts, targets = make_episode(1, noise=0.5, seed=3)
    network.observe(percepts, targets, episode=7, behaviour="new")
    network.recognise(percepts)
    network.recall(percepts)
    assert_same_state(network, before)
    assert network.behaviours == NAMES


def test_in_double_precision_it_understands_the_same():
    single, double = make_trained(), make_trained().double()
    percepts = make_episode(1, seed=9)[0]
    for one, other in zip(
        single.recognise(percepts), double.recognise(percepts.double()), strict=True
    ):
        assert not other.is_floating_point() or other.dtype == torch.float64
        torch.testing.assert_close(other.to(one.dtype), one, rtol=1e-3, atol=1e-4)


def test_learning_and_watching_go_on_after_save_and_load(tmp_path):
    network = make_trained()
    network.save_pretrained(tmp_path)
    loaded = PACNet.from_pretrained(tmp_path)
    assert loaded.config == network.config
    assert loaded.behaviours == NAMES
    percepts, targets = make_episode(-1, noise=0.05, seed=5)
    for one in (network, loaded):  # the last episode continues, and another begins
        one.observe(percepts[:20], targets[:20], episode=3, behaviour="down")
        one.observe(percepts, targets, episode=4, behaviour="third")
    assert_same_state(network, loaded)
    assert_same(network.recognise(percepts), loaded.recognise(percepts))
    assert_same(network.recall(percepts), loaded.recall(percepts))


# Nodes come and go


def test_map_and_schemas_agree_after_every_sample_of_a_random_run():
    attention = SOFMConfig.gwr(2, novelty_threshold=0.6, max_edge_age=4, neighbour_rate=0.05)
    schemas = CompetingSchemasConfig(
        1, 2, schemas_per_node=2, lookahead_samples=3, same_schema_similarity=0.6
    )
    network = PACNet(PACNetConfig(attention, schemas))
    generator = torch.Generator().manual_seed(0)
    percepts = torch.randn(400, 2, generator=generator).mul(0.3).cumsum(0) % 3
    deleted, kept = 0, 0
    for sample, percept in enumerate(percepts):
        # The target says where the percept was, so a schema given to a wrong node would show.
        one, target = percept[None], percept[None, :1]
        deleted += int(network.observe(one, target, sample // 50, f"b{sample // 150}").deleted)
        network.check_state(network.state_dict())
        if sample % 50 == 0 and len(network.schemas.visits):
            network.recognise(one)
            network.recall(one)
    assert deleted > 0
    for schema, node in enumerate(network.schemas.blocks.live("node").tolist()):
        distance = network.schemas.targets(schema) - network.sofm.prototypes[node, 0]
        kept += bool(distance.abs().median() < 0.7)
    assert kept >= 0.9 * len(network.schemas.blocks) > 5
    assert network.schemas.blocks.live("support").max() > 1


# What is refused


def test_one_schema_a_node_recognises_nothing():
    network = PACNet(PACNetConfig(SOFMConfig.paper(2), MotorSchemasConfig(1, 2)))
    network.observe(torch.zeros(30, 2), torch.zeros(30, 1), episode=0, behaviour="tea")
    assert network.behaviours == ()
    with pytest.raises(ValueError, match=r"CompetingSchemasConfig.*got one schema a node"):
        network.recognise(torch.zeros(1, 2))


def test_before_anything_was_learned_there_is_nothing_to_recognise():
    network = make_network()
    for _ in range(2):
        with pytest.raises(ValueError, match="learned schemas, got one without"):
            network.recognise(torch.zeros(1, 2))
        assert not network.recall(torch.zeros(1, 2)).has_target.any()
        network.observe(torch.zeros(5, 2), torch.zeros(5, 1), episode=0)  # none habituated yet


@pytest.mark.parametrize(
    ("percepts", "message"),
    [
        (torch.zeros(3, 4), r"percepts.*\[rows, 2\]"),
        (torch.zeros(3, 2).double(), "percepts.*float64"),
        (torch.zeros(0, 2), "at least one row"),
        (torch.tensor([[0.0, 0.0], [0.0, math.nan]]), "finite percepts.*row 1"),
    ],
)
def test_bad_percepts_are_refused_and_what_was_watched_stays(percepts: Tensor, message: str):
    network, other = make_trained(), make_trained()
    up = make_episode(1, seed=9)[0]
    for one in (network, other):
        one.recognise(up[:80])
    with pytest.raises(ValueError, match=message):
        network.recognise(percepts)
    assert_same(network.recognise(up[80:]), other.recognise(up[80:]))


@pytest.mark.parametrize(
    ("behaviour", "message"),
    [
        ("up", "episode 3 to go on with 'down', got 'up'"),
        (None, "behaviour as a str, got NoneType"),
    ],
)
def test_an_episode_that_goes_on_as_another_is_refused_with_nothing_changed(behaviour, message):
    network, other = make_trained(), make_trained()
    with pytest.raises(ValueError, match=message):
        network.observe(*make_episode(1), episode=3, behaviour=behaviour)
    assert_same_state(network, other)
    assert network.behaviours == other.behaviours


def test_bad_targets_neither_begin_an_episode_nor_name_a_behaviour():
    network, other = make_trained(), make_trained()
    with pytest.raises(ValueError, match="finite targets"):
        network.observe(torch.zeros(1, 2), torch.tensor([[math.nan]]), episode=8, behaviour="new")
    assert_same_state(network, other)


def test_the_config_comes_back_from_json_with_its_kind(tmp_path):
    network = make_network(max_quality_drop=0.5, margin=0.25)
    network.save_pretrained(tmp_path)
    loaded = PACNet.from_pretrained(tmp_path)
    assert loaded.config == network.config
    assert isinstance(loaded.config.schemas, CompetingSchemasConfig)


def test_parts_that_do_not_fit_are_refused():
    with pytest.raises(ValueError, match=r"percept_dimensions.*= 2, got 3"):
        PACNetConfig(SOFMConfig.paper(2), CompetingSchemasConfig(1, percept_dimensions=3))


@pytest.mark.parametrize("verb", ["begin_episode", "append_rows", "_forget_recall"])
def test_ctrl_c_while_an_episode_is_learned_leaves_what_was_known(monkeypatch, tmp_path, verb: str):
    network, untouched = make_trained(), make_trained()
    percepts, targets = make_episode(1, seed=9)
    for one in (network, untouched):
        one.recognise(percepts[:60])
        one.recall(percepts[:60])
    method, called = getattr(CompetingSchemas, verb), []

    def interrupted(*args: object) -> None:  # half way: the map has learned, passes are open
        method(*args)
        called.append(args)
        signal.raise_signal(signal.SIGINT)

    monkeypatch.setattr(CompetingSchemas, verb, interrupted)
    previous = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        with pytest.raises(KeyboardInterrupt):
            network.observe(percepts, targets, episode=4, behaviour="new")
    finally:
        signal.signal(signal.SIGINT, previous)
    monkeypatch.undo()
    assert len(called) == 1
    assert_same_state(network, untouched)
    assert network.behaviours == NAMES
    # Recognition continues as if nothing had happened.
    assert_same(network.recognise(percepts[60:]), untouched.recognise(percepts[60:]))
    assert_same(network.recall(percepts[60:]), untouched.recall(percepts[60:]))
    network.save_pretrained(tmp_path)
    for one in (network, untouched, loaded := PACNet.from_pretrained(tmp_path)):
        one.observe(percepts, targets, episode=4, behaviour="new")
    assert_same_state(network, untouched)
    assert_same_state(loaded, untouched)
