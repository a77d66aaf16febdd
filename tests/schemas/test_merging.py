"""Motor schemas within a budget: which targets become one."""

import pytest
import torch
from slow_merging import SlowSchemas

from pacnet import MotorSchemas, MotorSchemasConfig
from pacnet.schemas.interface import Samples

BUDGET = 13  # of four nodes, so that two of them may have equally many too many


def make_schemas(nodes: int, budget: int | None, dimensions: int = 1, **fields) -> MotorSchemas:
    schemas = MotorSchemas(MotorSchemasConfig(1, dimensions, budget=budget, **fields))
    for _ in range(nodes):
        schemas.add_node()
    return schemas


def write(schemas: MotorSchemas, node: int, *shown: tuple[float, float], **rest: int) -> None:
    """Write pairs of cue and target, in episode 0 unless told."""
    for cue, target in shown:
        pair, fields = (torch.tensor([target]), torch.tensor([cue])), {"episode": 0, **rest}
        schemas.write(node, *pair, **fields, habituated=True)


def kept(schemas: MotorSchemas, node: int) -> list[tuple[float, float, int]]:
    """Cue, target and count of each target of a node."""
    rows = schemas.cues(node), schemas.targets(node), schemas.rows_in("count", node)
    return list(zip(*(row.flatten().tolist() for row in rows), strict=True))


def stream(samples: int = 300, nodes: int = 4, dimensions: int = 2, forgets: float = 0.02):
    """Samples at which nodes win for a while, are sometimes not habituated, and forget."""
    generator = torch.Generator().manual_seed(4)
    node = torch.randint(nodes, (samples // 5 + 1,), generator=generator)
    node = node.repeat_interleave(5)[:samples]
    forgotten = torch.rand(samples, generator=generator) < forgets
    return Samples(
        node,
        torch.ones(samples),
        torch.rand(samples, generator=generator) < 0.9,
        torch.rand(samples, 1, generator=generator),
        torch.rand(samples, dimensions, generator=generator),
        forgotten.long().cumsum(0),
    )


def add(schemas: MotorSchemas | SlowSchemas, samples: Samples, portion: int) -> None:
    """Add samples in portions, a third of them in each of three episodes."""
    third = len(samples.node) // 3
    for episode in range(3):
        part = [column[episode * third : (episode + 1) * third] for column in samples]
        for some in zip(*(column.split(portion) for column in part), strict=True):
            schemas.add_samples(Samples(*some), episode)


def assert_same(one: torch.nn.Module, other: torch.nn.Module) -> None:
    got = other.state_dict()
    for name, expected in one.state_dict().items():
        assert torch.equal(expected, got[name]), name


# Which targets become one


def test_the_two_nearest_become_their_weighted_mean_in_place_of_the_earlier():
    schemas = make_schemas(1, budget=3)
    write(schemas, 0, (0.0, 10.0), (5.0, 20.0), (9.0, 30.0), (1.0, 13.0))
    # Of the distances 5, 9, 1, 4, 4, 8 that between 0 and 1 is the least.
    assert kept(schemas, 0) == [(0.5, 11.5, 2), (5, 20, 1), (9, 30, 1)]
    write(schemas, 0, (2.0, 19.0))
    # .5 and 2: a mean of two and one, (2 · .5 + 2) / 3 = 1 and (2 · 11.5 + 19) / 3 = 14.
    assert kept(schemas, 0) == [(1, 14, 3), (5, 20, 1), (9, 30, 1)]
    write(schemas, 0, (10.0, 50.0), (21.0, 7.0))
    # 9 with 10, then 5 and 1 are nearer than 5 and 9.5: (3 · 1 + 5) / 4 and (3 · 14 + 20) / 4.
    assert kept(schemas, 0) == [(2, 15.5, 4), (9.5, 40, 2), (21, 7, 1)]


def test_of_equally_near_pairs_the_first_becomes_one():
    schemas = make_schemas(1, budget=3)
    write(schemas, 0, (0.0, 0.0), (4.0, 4.0), (8.0, 8.0), (12.0, 12.0))
    assert kept(schemas, 0) == [(2, 2, 2), (8, 8, 1), (12, 12, 1)]


def test_a_mean_that_is_as_near_as_a_later_target_comes_first():
    schemas = make_schemas(1, budget=3, dimensions=2)
    cues = torch.tensor([[0.0, 0.0], [4.0, 0.5], [4.0, -0.5], [-4.0, 0.0], [0.0, 30.0]])
    zeros, ones = torch.zeros(5, dtype=torch.int64), torch.ones(5)
    schemas.add_samples(Samples(zeros, ones, ones.bool(), ones[:, None], cues, zeros), 0)
    # The second and third become (4, 0), as far from the first as (−4, 0) is: 0 + 2/3 · 4.
    expected = torch.tensor([[8 / 3, 0.0], [-4.0, 0.0], [0.0, 30.0]])
    torch.testing.assert_close(schemas.cues(0), expected)


def test_the_node_with_the_most_targets_makes_room_so_that_nodes_share_equally():
    schemas = make_schemas(3, budget=9)
    write(schemas, 0, *((float(cue), 0.0) for cue in range(9)))
    assert schemas.lengths.tolist() == [9, 0, 0]
    write(schemas, 2, (0.0, 1.0), (1.0, 1.0))
    assert schemas.lengths.tolist() == [7, 0, 2]
    for node in (1, 2):
        write(schemas, node, *((float(cue), 1.0) for cue in range(20)))
    assert schemas.lengths.tolist() == [3, 3, 3]


def test_of_nodes_with_equally_many_the_first_makes_room():
    schemas = make_schemas(2, budget=3)
    for node in (0, 1):
        write(schemas, node, (0.0, 0.0), (1.0, 1.0))
    assert schemas.lengths.tolist() == [1, 2]


def test_a_long_rest_takes_no_more_room_than_a_target():
    schemas = make_schemas(1, budget=6)
    way = [(float(cue), float(cue)) for cue in range(5)]
    write(schemas, 0, *way, *[(50.0, 50.0)] * 30, (60.0, 60.0))
    # The rest gives way first; only then are two of the way one.
    assert kept(schemas, 0) == [(0.5, 0.5, 2), *((c, t, 1) for c, t in way[2:]), (50, 50, 30),
                                (60, 60, 1)]  # fmt: skip


def test_what_is_forgotten_goes_before_anything_becomes_one():
    schemas = make_schemas(2, budget=4)
    write(schemas, 0, (0.0, 0.0), (0.1, 1.0), (5.0, 2.0), habituated_at=3)
    write(schemas, 0, (7.0, 7.0), habituated_at=30)  # replaces the first; two are forgotten
    write(schemas, 1, (0.0, 0.0), (1.0, 1.0), habituated_at=5)
    assert kept(schemas, 0) == [(5, 2, 1), (7, 7, 1)]
    write(schemas, 1, (3.0, 3.0), habituated_at=5)  # now the second node has the most
    assert kept(schemas, 0) == [(5, 2, 1), (7, 7, 1)]
    assert kept(schemas, 1) == [(0.5, 0.5, 2), (3, 3, 1)]
    write(schemas, 0, (8.0, 8.0), (9.0, 9.0), habituated_at=30)
    # 8 replaces 5, the last forgotten one; 9 is one too many.
    assert kept(schemas, 0) == [(7.5, 7.5, 2), (9, 9, 1)]


@pytest.mark.parametrize("times", [(7, 2, 9), (7, -1, 9)])
def test_with_fewer_targets_than_nodes_the_node_forgets_that_is_habituated_longest(times):
    schemas = make_schemas(3, budget=2)
    for node, time in enumerate(times):
        write(schemas, node, (1.0, float(node)), habituated_at=time)
    assert schemas.lengths.tolist() == [1, 0, 1]
    write(schemas, 1, (1.0, 5.0), habituated_at=20)
    assert schemas.lengths.tolist() == [0, 1, 1]


def test_a_node_that_forgets_its_only_target_has_none_to_replace():
    schemas = make_schemas(2, budget=1)
    write(schemas, 0, (1.0, 1.0), habituated_at=3)
    state = schemas.state_dict()
    state["blocks.forgotten"][0] = 1
    schemas.load_state_dict(state)
    write(schemas, 1, (1.0, 1.0), habituated_at=9)
    assert schemas.lengths.tolist() == [0, 1]
    schemas.load_state_dict(schemas.state_dict())


def test_a_budget_of_one_keeps_the_mean_of_the_last_node():
    schemas = make_schemas(2, budget=1)
    write(schemas, 0, (0.0, 0.0), (1.0, 3.0), (2.0, 6.0))
    assert kept(schemas, 0) == [(1, 3, 3)]
    write(schemas, 1, (4.0, 4.0))
    assert schemas.lengths.tolist() == [0, 1]
    assert schemas.recall(0, torch.ones(1)) is None
    write(schemas, 0, (8.0, 8.0))
    assert kept(schemas, 0) == [(8, 8, 1)]


def test_a_new_episode_clears_a_node_and_its_counts():
    schemas = make_schemas(1, budget=2)
    write(schemas, 0, (0.0, 0.0), (1.0, 1.0), (5.0, 5.0))
    write(schemas, 0, (7.0, 7.0), (9.0, 9.0), episode=1)
    assert kept(schemas, 0) == [(7, 7, 1), (9, 9, 1)]


def test_a_new_episode_clears_what_was_forgotten():
    schemas = make_schemas(1, budget=3)
    for time in (4, 4, 4, 30):
        write(schemas, 0, (1.0, 1.0), habituated_at=time)
    write(schemas, 0, (7.0, 7.0), (9.0, 9.0), habituated_at=30, episode=1)
    assert kept(schemas, 0) == [(7, 7, 1), (9, 9, 1)]


def test_room_of_a_deleted_node_is_for_the_others():
    schemas = make_schemas(3, budget=6)
    for node in range(3):
        write(schemas, node, *((float(cue), float(node)) for cue in range(4)))
    assert schemas.lengths.tolist() == [2, 2, 2]
    schemas.delete(torch.tensor([1]))
    write(schemas, 1, (10.0, 10.0), (20.0, 20.0))
    assert schemas.lengths.tolist() == [2, 4]
    assert [target for _, target, _ in kept(schemas, 1)] == [2, 2, 10, 20]
    write(schemas, 0, (30.0, 30.0))
    assert schemas.lengths.tolist() == [3, 3]


def test_recall_goes_by_cue_and_by_order():
    shown = [(0.0, 0.0), (4.0, 4.0), (5.0, 5.0), (9.0, 9.0)]
    for recall_by, expected in (("cue", [4.5, 0, 9]), ("order", [0, 4.5, 9])):
        schemas = make_schemas(1, budget=3, recall_by=recall_by)
        write(schemas, 0, *shown)
        found = [schemas.recall(0, torch.tensor([cue])) for cue in (4.4, 1.0, 20.0)]
        assert [one.target.item() for one in found if one is not None] == expected


def test_in_eval_mode_nothing_changes():
    schemas = make_schemas(1, budget=2)
    write(schemas, 0, (0.0, 0.0), (1.0, 1.0))
    write(schemas.eval(), 0, (5.0, 5.0))
    assert kept(schemas, 0) == [(0, 0, 1), (1, 1, 1)]


# Against the rules target by target, and in portions


@pytest.mark.parametrize("budget", [1, 3, BUDGET, 60])
@pytest.mark.parametrize("portion", [1, 7, 1000])
def test_the_same_is_kept_as_target_by_target(budget: int, portion: int):
    schemas, slow, samples = make_schemas(4, budget, 2), SlowSchemas(4, budget), stream()
    for number in range(0, 300, 60):
        part = Samples(*(column[number : number + 60] for column in samples))
        add(schemas, part, portion)
        add(slow, part, 1000)
        assert int(schemas.lengths.sum()) <= budget
        for node, expected in enumerate(slow.nodes):
            assert schemas.rows_in("count", node).tolist() == [s.count for s in expected.kept]
            for column in ("target", "cue"):
                values = [getattr(shown, column) for shown in expected.kept]
                got = list(schemas.rows_in(column, node))
                assert len(got) == len(values)
                assert all(map(torch.equal, got, values))


def test_cues_that_are_often_equally_near_make_no_difference():
    samples = stream(nodes=2)
    samples = samples._replace(cue=(samples.cue * 4).round())
    schemas, slow = make_schemas(2, BUDGET, 2), SlowSchemas(2, BUDGET)
    add(schemas, samples, 1000)
    add(slow, samples, 1000)
    for node, expected in enumerate(slow.nodes):
        assert schemas.rows_in("count", node).tolist() == [s.count for s in expected.kept]


def test_a_budget_that_is_not_reached_changes_nothing():
    bounded, unbounded = make_schemas(4, 10**30, 2), make_schemas(4, None, 2)
    for schemas in (bounded, unbounded):
        add(schemas, stream(), 50)
    state = bounded.state_dict()
    assert bool((state["pool.count"] == 1).all())
    for name, expected in unbounded.state_dict().items():
        assert torch.equal(expected, state[name]), name


@pytest.mark.parametrize("dtype", [torch.half, torch.bfloat16])
def test_in_half_precision_portions_do_not_matter(dtype: torch.dtype):
    samples = stream(90)
    samples = samples._replace(target=samples.target.to(dtype), cue=samples.cue.to(dtype))
    whole, single = (make_schemas(4, BUDGET, 2).to(dtype) for _ in range(2))
    add(whole, samples, 1000)
    add(single, samples, 1)
    assert_same(whole, single)
    assert whole.targets(0).dtype == dtype


def test_a_snapshot_for_recall_keeps_what_it_has():
    schemas = make_schemas(1, budget=2)
    write(schemas, 0, (0.0, 0.0), (4.0, 4.0))
    before = schemas.for_recall()
    write(schemas, 0, (8.0, 8.0), (9.0, 9.0), (20.0, 20.0))
    found = [before.recall(0, torch.tensor([cue])) for cue in (0.0, 9.0)]
    assert [one.target.item() for one in found if one is not None] == [0, 4]


def test_what_is_written_in_inference_mode_can_be_changed_later():
    schemas = make_schemas(1, budget=2)
    with torch.inference_mode():
        write(schemas, 0, (0.0, 0.0), (4.0, 4.0), (5.0, 5.0))
    write(schemas, 0, (6.0, 6.0))
    assert [count for *_, count in kept(schemas, 0)] == [1, 3]


# What is refused


@pytest.mark.parametrize("budget", [0, -1, 1.5, "3", True])
def test_a_budget_that_is_none_is_refused(budget: object):
    with pytest.raises(ValueError, match=r"MotorSchemasConfig\.budget ≥ 1, or None, got"):
        MotorSchemasConfig(1, 1, budget=budget)  # pyright: ignore[reportArgumentType]


def test_a_node_that_there_is_not_is_refused():
    schemas, samples = make_schemas(3, BUDGET, 2), stream(30)
    with pytest.raises(ValueError, match="expected nodes below 3"):
        schemas.add_samples(samples._replace(node=samples.node + 1), 0)
    assert schemas.lengths.tolist() == [0, 0, 0]


def test_the_largest_count_stays_one_that_loads():
    schemas = make_schemas(1, budget=2)
    write(schemas, 0, (0.0, 0.0), (1.0, 1.0))
    state = schemas.state_dict()
    state["pool.count"].fill_(2**53)
    schemas.load_state_dict(state)
    write(schemas, 0, (9.0, 9.0))
    assert kept(schemas, 0) == [(0.5, 0.5, 2**53), (9, 9, 1)]
    schemas.load_state_dict(schemas.state_dict())
