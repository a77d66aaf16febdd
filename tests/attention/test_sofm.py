"""The growing map: the three cases, habituation, forgetting, edges; values worked out by hand."""

import copy
import math

import numpy as np
import pytest
import torch

from pacnet import NO_NODE, HabituatingSOFM, SOFMConfig
from pacnet.kernels.engine import Engine


def percepts(*rows: tuple[float, ...]) -> torch.Tensor:
    return torch.tensor(rows, dtype=torch.float32)


def make_map(dimensions: int = 2, preset: str = "paper", **fields: object) -> HabituatingSOFM:
    return HabituatingSOFM(getattr(SOFMConfig, preset)(dimensions, **fields))


def make_walk(samples: int, dimensions: int, seed: int) -> torch.Tensor:
    generator = torch.Generator().manual_seed(seed)
    return torch.randn(samples, dimensions, generator=generator).mul(0.2).cumsum(0)


# Reading


def test_an_empty_map_finds_every_percept_novel():
    reading = make_map()(percepts((0, 0), (1, 1)))
    assert reading.winner.tolist() == [NO_NODE, NO_NODE]
    assert reading.runner_up.tolist() == [NO_NODE, NO_NODE]
    assert reading.activation.tolist() == [0, 0]
    assert reading.novelty.tolist() == [True, True]


def test_one_node_has_no_runner_up():
    sofm = make_map()
    sofm.observe(percepts((0, 0)))
    reading = sofm(percepts((0.3, 0.4)))
    assert reading.winner.item() == 0
    assert reading.runner_up.item() == NO_NODE
    assert reading.activation.item() == pytest.approx(math.exp(-0.5))


def test_winner_and_runner_up_are_the_two_nearest():
    sofm = make_map(novelty_threshold=0.5)
    sofm.observe(percepts((0, 0), (3, 0), (0, 5)))
    reading = sofm(percepts((2, 0), (0.1, 4)))
    assert reading.winner.tolist() == [1, 2]
    assert reading.runner_up.tolist() == [0, 0]
    # exp(-1) = 0.368 and exp(-sqrt(1.01)) are both under the threshold
    assert reading.novelty.tolist() == [True, True]


def test_exact_ties_go_to_the_lowest_index():
    sofm = make_map(novelty_threshold=0.5)
    sofm.observe(percepts((2, 0), (-2, 0), (0, 2), (0, -2)))
    reading = sofm(percepts((0, 0)))
    assert (reading.winner.item(), reading.runner_up.item()) == (0, 1)


def test_scale_stretches_distances_and_prototypes_keep_the_percepts_units():
    sofm = make_map(scale=(1.0, 0.5))
    sofm.observe(percepts((1, 4)))
    assert sofm.prototypes.tolist() == [[1, 4]]
    assert sofm(percepts((1, 6))).activation.item() == pytest.approx(math.exp(-1.0))


def test_reading_in_chunks_changes_nothing(monkeypatch: pytest.MonkeyPatch):
    sofm = make_map(dimensions=3)
    sofm.observe(make_walk(300, 3, seed=1))
    queries = make_walk(50, 3, seed=2)
    whole = sofm(queries)
    monkeypatch.setattr("pacnet.attention.eager._SEARCH_ELEMENTS", 1)
    for one, other in zip(whole, sofm(queries), strict=True):
        assert torch.equal(one, other)


def test_activation_is_differentiable_in_the_percept():
    sofm = make_map()
    sofm.observe(percepts((0, 0)))
    query = percepts((0.3, 0.4), (0, 0)).requires_grad_()
    sofm(query).activation.sum().backward()
    # d exp(-|x|)/dx = -exp(-|x|) x/|x|, and 0 at the prototype itself rather than NaN
    expected = -math.exp(-0.5) * torch.tensor([0.6, 0.8])
    assert query.grad is not None
    torch.testing.assert_close(query.grad[0], expected)
    assert query.grad[1].tolist() == [0, 0]


# Case 1: novelty


def test_a_novel_percept_makes_a_node_there_joined_to_the_winner():
    sofm = make_map(novelty_threshold=0.5)
    record = sofm.observe(percepts((0, 0), (2, 0)))
    assert record.inserted.tolist() == [True, True]
    assert record.winner.tolist() == [NO_NODE, 0]
    assert record.attended.tolist() == [True, True]
    assert sofm.prototypes.tolist() == [[0, 0], [2, 0]]
    assert sofm.edges.live("ends").tolist() == [[0, 1]]
    assert sofm.habituation.tolist() == [1, 1]


def test_a_higher_threshold_never_makes_fewer_nodes_on_a_line():
    line = torch.linspace(0, 10, 500)[:, None]
    counts = []
    for threshold in (0.2, 0.4, 0.6, 0.8):
        sofm = make_map(1, novelty_threshold=threshold)
        sofm.observe(line)
        counts.append(len(sofm))
    assert counts == sorted(counts)
    assert counts[0] < counts[-1]


def test_gwr_inserts_midway_and_only_where_the_winner_is_habituated():
    sofm = make_map(preset="gwr", novelty_threshold=0.9, winner_rate=0.1)
    assert sofm.observe(percepts((0, 0), (1, 0))).inserted.tolist() == [True, False]
    # not habituated: moved by winner_rate x habituation 1 of the way instead
    assert sofm.prototypes[0].tolist() == pytest.approx([0.1, 0])
    sofm.observe(percepts((0.1, 0)).expand(10, 2))
    assert bool(sofm.fully_habituated[0])
    before = sofm.prototypes[0].clone()
    record = sofm.observe(percepts((4, 0)))
    assert record.inserted.item()
    torch.testing.assert_close(sofm.prototypes[1], (before + torch.tensor([4.0, 0.0])) / 2)


def test_gwr_inserts_the_new_node_on_the_edge_between_winner_and_runner_up():
    sofm = make_map(preset="gwr", novelty_threshold=0.9)
    sofm.observe(percepts((0, 0)).expand(12, 2))
    sofm.observe(percepts((4, 0)))  # node 1 at (2, 0)
    assert sofm.edges.live("ends").tolist() == [[0, 1]]
    sofm.observe(percepts((2, 0)).expand(12, 2))
    sofm.observe(percepts((1.2, 0)))  # nearest to node 1, then 0: node 2 between
    ends = {tuple(pair) for pair in sofm.edges.live("ends").tolist()}
    assert ends == {(0, 2), (1, 2)}


# Case 2: a good match


def test_winner_and_neighbour_move_by_their_constant_fractions():
    sofm = make_map(novelty_threshold=0.5, winner_rate=0.2, neighbour_rate=0.05)
    sofm.observe(percepts((0, 0), (2, 0), (0, 3)))  # edges 0-1 and 0-2
    record = sofm.observe(percepts((0.5, 0)))
    assert record.attended.item()
    assert not record.inserted.item()
    # winner: 0 + .2 x .5; neighbours: 2 + .05 (.5 - 2) and (0, 3) + .05 ((.5, 0) - (0, 3))
    expected = percepts((0.1, 0), (1.925, 0), (0.025, 2.85))
    torch.testing.assert_close(sofm.prototypes, expected)


def test_habituation_follows_the_closed_form_of_stanleys_equation():
    sofm = make_map(forgetting_interval=None, ignore_when_habituated=False)
    curve = []
    for _ in range(40):
        sofm.observe(percepts((0, 0)))
        curve.append(sofm.habituation.item())
    # h(t) = 1 - (1/1.05)(1 - exp(-1.05 t / 3.33)); the insertion itself is no firing
    firings = np.arange(40)
    closed_form = 1 - (1 - np.exp(-1.05 * firings / 3.33)) / 1.05
    np.testing.assert_allclose(curve, closed_form, atol=1e-6)
    assert np.argmax(closed_form < 0.1) == 10  # fully habituated after ten firings
    assert min(curve) > 1 - 1 / 1.05


def test_neighbours_habituate_more_slowly_than_the_winner():
    sofm = make_map(novelty_threshold=0.5)
    sofm.observe(percepts((0, 0), (2, 0)))
    sofm.observe(percepts((0, 0)))
    winner, neighbour = sofm.habituation.tolist()
    assert winner == pytest.approx(1 - (1 - math.exp(-1.05 / 3.33)) / 1.05)
    assert neighbour == pytest.approx(1 - (1 - math.exp(-1.05 / 14.3)) / 1.05)


# Case 3 and forgetting


def test_a_fully_habituated_winner_ignores_its_percept():
    sofm = make_map()
    sofm.observe(percepts((0, 0)).expand(11, 2))
    assert bool(sofm.fully_habituated[0])
    state = {name: value.clone() for name, value in sofm.state_dict().items()}
    record = sofm.observe(percepts((0.1, 0.1)))
    assert record.ignored.item()
    assert not record.attended.item()
    for name, value in sofm.state_dict().items():
        if name != "time":
            assert torch.equal(value, state[name]), name


def test_a_habituated_neighbour_does_not_move():
    sofm = make_map(novelty_threshold=0.5)
    sofm.observe(percepts((0, 0)).expand(11, 2))
    sofm.observe(percepts((2, 0), (1.9, 0)))
    assert sofm.edges.live("ends").tolist() == [[0, 1]]
    assert sofm.prototypes[0].tolist() == [0, 0]


def test_dishabituation_comes_after_exactly_the_interval():
    sofm = make_map(forgetting_interval=20)
    record = sofm.observe(percepts((0, 0)).expand(60, 2))
    # Inserted at sample 0, fires at 1..10, habituated at sample 10, responds again at 10 + 20.
    assert record.dishabituated.nonzero().flatten().tolist() == [30, 59]
    assert record.ignored.nonzero().flatten().tolist() == [*range(11, 30), *range(40, 59)]


def test_without_an_interval_nothing_is_forgotten():
    sofm = make_map(forgetting_interval=None)
    record = sofm.observe(percepts((0, 0)).expand(200, 2))
    assert not record.dishabituated.any()
    assert record.ignored[11:].all()


def test_a_dishabituated_node_moves_again():
    sofm = make_map(forgetting_interval=20)
    sofm.observe(percepts((0, 0)).expand(30, 2))
    sofm.observe(percepts((0.2, 0)))
    assert sofm.prototypes[0, 0].item() == pytest.approx(0.02)


# Edges


def test_an_old_edge_is_deleted_with_its_isolated_node():
    sofm = make_map(novelty_threshold=0.5, max_edge_age=3, ignore_when_habituated=False)
    sofm.observe(percepts((0, 0), (2, 0), (0, 9)))  # 0-1, and 2 joined to 0
    record = sofm.observe(percepts((0, 0)).expand(4, 2))  # 0 and 1 stay best and second best
    assert record.deleted.tolist() == [0, 0, 0, 1]
    assert len(sofm) == 2
    assert sofm.edges.live("ends").tolist() == [[0, 1]]


def test_deleting_a_node_renumbers_the_edges_of_later_ones():
    sofm = make_map(novelty_threshold=0.5, max_edge_age=2, ignore_when_habituated=False)
    sofm.observe(percepts((0, 0), (0, 9), (2, 0), (4, 0)))  # 0-1, 0-2, 2-3
    record = sofm.observe(percepts((0.1, 0)).expand(3, 2))
    assert record.deleted.sum() == 1
    assert sofm.prototypes[:, 1].abs().max() < 1  # the far node is deleted
    assert sorted(sofm.edges.live("ends").tolist()) == [[0, 1], [1, 2]]


def test_every_node_keeps_an_edge_and_every_edge_two_nodes():
    sofm = make_map(
        dimensions=3, preset="gwr", novelty_threshold=0.8, max_edge_age=5, neighbour_rate=0.05
    )
    record = sofm.observe(make_walk(2000, 3, seed=3) % 2)
    ends = sofm.edges.live("ends")
    assert record.deleted.sum() > 0
    assert set(ends.flatten().tolist()) == set(range(len(sofm)))
    assert (ends[:, 0] < ends[:, 1]).all()
    assert len({tuple(pair) for pair in ends.tolist()}) == len(ends)


# The record, modes and bad input


@pytest.mark.parametrize("preset", ["paper", "gwr"])
def test_a_sequence_at_once_equals_sample_by_sample(preset: str):
    walk = make_walk(400, 3, seed=4)
    whole, single = (make_map(3, preset, max_edge_age=8) for _ in range(2))
    record = whole.observe(walk)
    parts = [single.observe(sample[None]) for sample in walk]
    for name in record._fields:
        joined = torch.cat([getattr(part, name) for part in parts])
        assert torch.equal(getattr(record, name), joined), name
    for name, value in whole.state_dict().items():
        assert torch.equal(value, single.state_dict()[name]), name


def test_the_record_reads_as_forward_did_before_learning():
    sofm = make_map(dimensions=3)
    for sample in make_walk(100, 3, seed=5):
        reading = sofm(sample[None])
        record = sofm.observe(sample[None])
        for name in reading._fields:
            assert torch.equal(getattr(reading, name), getattr(record, name)), name


def test_two_equal_percepts_make_one_node():
    sofm = make_map()
    sofm.observe(percepts((1, 2), (1, 2)))
    assert len(sofm) == 1


def test_learning_inside_inference_mode_leaves_a_map_that_learns_outside():
    sofm = make_map()
    with torch.inference_mode():
        sofm.observe(percepts((0, 0), (5, 0)))
    sofm.observe(percepts((0.1, 0), (9, 9)))
    assert len(sofm) == 3


BAD_PERCEPTS = {
    "NaN": (percepts((0, math.nan)), "finite percepts.*nan.*row 0"),
    "infinity": (percepts((0, 0), (math.inf, 0)), "finite percepts.*inf.*row 1"),
    "dimension": (torch.zeros(3, 5), r"\[rows, 2\].*got shape \[3, 5\]"),
    "vector": (torch.zeros(2), r"got shape \[2\]"),
    "dtype": (torch.zeros(3, 2, dtype=torch.float64), "torch.float32.*got dtype torch.float64"),
    "array": (np.zeros((3, 2), dtype=np.float32), "tensor.*got ndarray"),
    "empty": (torch.zeros(0, 2), "at least one row, got an empty"),
}


@pytest.mark.parametrize("case", BAD_PERCEPTS)
@pytest.mark.parametrize("method", ["forward", "observe"])
def test_bad_percepts_are_refused_before_anything_changes(case: str, method: str):
    sofm = make_map()
    sofm.observe(percepts((0, 0), (2, 0)))
    before = copy.deepcopy(sofm.state_dict())
    value, message = BAD_PERCEPTS[case]
    with pytest.raises(ValueError, match=message):
        getattr(sofm, method)(value)
    for name, tensor in sofm.state_dict().items():
        assert torch.equal(tensor, before[name]), name


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("novelty_threshold", 0.0),
        ("novelty_threshold", math.nan),
        ("winner_rate", 1.5),
        ("neighbour_rate", 1.1),
        ("winner_tau", 0.0),
        ("neighbour_tau", math.inf),
        ("alpha", 0.0),
        ("habituated_below", 0.04),  # under the floor 1 - 1/1.05: never reached
        ("scale", (1.0,)),
        ("scale", (1.0, 0.0)),
        ("insert_at", "winner"),
        ("forgetting_interval", 0),
        ("max_edge_age", 0),
    ],
)
def test_an_invalid_config_field_is_refused_by_name(field: str, value: object):
    with pytest.raises(ValueError, match=f"SOFMConfig.{field}.*got"):
        SOFMConfig.paper(2, **{field: value})


def test_a_percept_exactly_at_the_threshold_is_not_novel():
    sofm = make_map(novelty_threshold=torch.tensor(-1.0).exp().item())
    sofm.observe(percepts((0, 0)))
    assert sofm(percepts((1, 0), (1.001, 0))).novelty.tolist() == [False, True]


def test_percepts_whose_distances_would_overflow_are_refused():
    sofm = make_map(1, scale=(10.0,))
    sofm.observe(percepts((1e16,), (0.0,)))
    with pytest.raises(ValueError, match=r"within ±1e\+17, got 1e\+18"):
        sofm.observe(percepts((0.0,), (1e17,)))
    assert (len(sofm), sofm.time.item()) == (2, 2)


def test_gwr_never_forgets_by_default():
    assert SOFMConfig.gwr(2).forgetting_interval is None


def test_several_nodes_deleted_at_once_move_the_later_ones_down_together():
    sofm = make_map(max_edge_age=2, neighbour_rate=0.0, ignore_when_habituated=False)
    sofm.observe(percepts((0, 0), (9, 0), (-9, 0), (0, 2), (0, 4)))  # 0-1, 0-2, 0-3, 3-4
    record = sofm.observe(percepts((0, 0)).expand(3, 2))  # 0 and 3 stay best and second best
    assert record.deleted.tolist() == [0, 0, 2]
    assert sofm.prototypes.tolist() == [[0, 0], [0, 2], [0, 4]]
    assert sorted(sofm.edges.live("ends").tolist()) == [[0, 1], [1, 2]]


def test_percepts_on_another_device_are_refused():
    with pytest.raises(ValueError, match="on cpu, got one on meta"):
        make_map()(torch.zeros(1, 2, device="meta"))


def test_a_percept_has_at_least_one_dimension():
    with pytest.raises(ValueError, match=r"SOFMConfig\.dimensions ≥ 1, got 0"):
        SOFMConfig(dimensions=0)


@pytest.mark.parametrize("engine", ["eager", "compiled"])
def test_an_update_lists_the_deleted_nodes_by_sample(engine: Engine):
    config = SOFMConfig.paper(2, max_edge_age=2, neighbour_rate=0.0, ignore_when_habituated=False)
    sofm = HabituatingSOFM(config, engine)
    sofm.observe(percepts((0, 0), (9, 0), (-9, 0), (0, 2), (0, 4)))
    update = sofm.update(percepts((0, 0)).expand(5, 2))
    assert {sample: nodes.tolist() for sample, nodes in update.deleted_nodes.items()} == {2: [1, 2]}
    stretches = [(part, nodes.tolist()) for part, nodes in update.between_deletions()]
    assert stretches == [(slice(0, 3), [1, 2]), (slice(3, 5), [])]


@pytest.mark.parametrize("engine", ["eager", "compiled"])
def test_reading_one_percept_also_returns_it_normalized(engine: Engine):
    sofm = HabituatingSOFM(SOFMConfig.paper(2, scale=(1.0, 0.5)), engine)
    sofm.observe(percepts((0, 0), (1, 4)))
    step, normalized = sofm.read_one(np.float32([1, 6]))
    assert normalized.tolist() == [1, 3]
    assert step == sofm.eval().step(np.float32([1, 6]))


def test_old_names_of_the_verbs_warn():
    sofm = make_map(scale=(1.0, 0.5))
    with pytest.warns(DeprecationWarning, match="scaled is now normalize"):
        assert sofm.scaled(percepts((1, 6))).tolist() == [[1, 3]]  # pyright: ignore
    with pytest.warns(DeprecationWarning, match="learn is now update"):
        sofm.learn(percepts((1, 3)))  # pyright: ignore
    with pytest.warns(DeprecationWarning, match="look is now read_one"):
        assert sofm.look(torch.tensor([1.0, 6.0]))[0].winner == 0  # pyright: ignore
