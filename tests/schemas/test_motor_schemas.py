"""Motor schemas: the three rules, recall with a position, deletion with the node, the pool."""

from dataclasses import asdict

import pytest
import torch

from pacnet import NO_NODE, MotorSchemas, MotorSchemasConfig


def make_schemas(nodes: int = 2, **fields: object) -> MotorSchemas:
    schemas = MotorSchemas(MotorSchemasConfig(1, percept_dimensions=1, **fields))
    for _ in range(nodes):
        schemas.add_node()
    return schemas


def write(schemas: MotorSchemas, node: int, *values: float, episode: int = 0) -> None:
    """Write targets whose cues are a tenth of them."""
    for value in values:
        target, cue = torch.tensor([float(value)]), torch.tensor([value / 10])
        schemas.write(node, target, cue, episode, habituated=True)


def recalled(schemas: MotorSchemas, node: int, *cues: float) -> list[float | None]:
    """Targets recalled for percepts in turn."""
    results = [schemas.recall(node, torch.tensor([float(cue)])) for cue in cues]
    return [None if result is None else result.target.item() for result in results]


# The three rules


def test_rule_1_a_settling_node_keeps_its_schema():
    schemas = make_schemas()
    write(schemas, 0, 1, 2)
    schemas.write(0, torch.tensor([9.0]), torch.tensor([0.0]), episode=1, habituated=False)
    assert schemas.targets(0).flatten().tolist() == [1, 2]


def test_rule_2_the_same_episode_appends():
    schemas = make_schemas()
    write(schemas, 0, 1, 2)
    write(schemas, 1, 5)
    write(schemas, 0, 3)
    assert schemas.targets(0).flatten().tolist() == [1, 2, 3]
    assert schemas.targets(1).flatten().tolist() == [5]
    torch.testing.assert_close(schemas.cues(0).flatten(), torch.tensor([0.1, 0.2, 0.3]))


def test_rule_3_a_new_episode_starts_afresh_for_that_node_alone():
    schemas = make_schemas()
    write(schemas, 0, 1, 2, 3)
    write(schemas, 1, 5)
    write(schemas, 0, 7, 8, episode=1)
    assert schemas.targets(0).flatten().tolist() == [7, 8]
    assert schemas.targets(1).flatten().tolist() == [5]


def test_eval_mode_writes_nothing():
    schemas = make_schemas().eval()
    write(schemas, 0, 1)
    assert schemas.lengths.tolist() == [0, 0]


# Recall


def test_a_node_without_targets_recalls_none():
    assert recalled(make_schemas(), 0, 0.0) == [None]


def test_by_order_the_position_advances_and_the_last_target_stays():
    schemas = make_schemas(recall_by="order")
    write(schemas, 0, 1, 2, 3)
    assert recalled(schemas, 0, 0, 0, 0, 0, 0) == [1, 2, 3, 3, 3]


def test_by_order_a_re_entered_node_goes_on_where_it_was():
    schemas = make_schemas(recall_by="order")
    write(schemas, 0, 1, 2, 3)
    write(schemas, 1, 7, 8)
    assert recalled(schemas, 0, 0, 0) == [1, 2]
    assert recalled(schemas, 1, 0) == [7]
    assert recalled(schemas, 0, 0) == [3]
    schemas.reset()
    assert recalled(schemas, 0, 0) == [1]


def test_by_cue_the_position_keeps_pace_with_what_is_seen():
    schemas = make_schemas()
    write(schemas, 0, *range(10))
    assert recalled(schemas, 0, 0.0, 0.2, 0.4, 0.6) == [0, 2, 4, 6]  # a faster demonstration
    assert recalled(schemas, 0, 0.1, 0.1, 0.1, 0.2) == [1, 1, 1, 2]  # a slower one


def test_by_cue_off_either_end_the_nearest_target_stays():
    schemas = make_schemas()
    write(schemas, 0, 1, 2, 3)
    assert recalled(schemas, 0, -5.0, 0.1, 0.3, 9.0, 9.0) == [1, 1, 3, 3, 3]


def test_by_cue_re_entry_depends_on_the_percept_alone():
    schemas = make_schemas()
    write(schemas, 0, *range(10))
    write(schemas, 1, 50)
    assert recalled(schemas, 0, 0.8) == [8]
    assert recalled(schemas, 1, 5.0) == [50]
    assert recalled(schemas, 0, 0.3) == [3]


def test_by_cue_exact_ties_go_to_the_first():
    schemas = make_schemas()
    for target in (1.0, 2.0):
        schemas.write(0, torch.tensor([target]), torch.tensor([0.0]), episode=0, habituated=True)
    assert recalled(schemas, 0, 0.0) == [1]


def test_a_recalled_target_is_the_callers_own():
    schemas = make_schemas()
    write(schemas, 0, 1)
    result = schemas.recall(0, torch.tensor([0.1]))
    assert result is not None
    result.target.fill_(99)
    assert recalled(schemas, 0, 0.1) == [1]


# The pool


def test_deleting_a_node_takes_its_targets_and_keeps_the_others():
    schemas = make_schemas(nodes=3)
    write(schemas, 0, 1, 2)
    write(schemas, 1, 3, 4)
    write(schemas, 2, 5, 6)
    schemas.delete(torch.tensor([1]))
    assert len(schemas) == 2
    assert schemas.targets(1).flatten().tolist() == [5, 6]
    assert sorted(schemas.state_dict()["pool.target"].flatten().tolist()) == [1, 2, 5, 6]


def test_random_writes_equal_a_dict_of_lists():
    generator = torch.Generator().manual_seed(0)
    schemas, expected = make_schemas(nodes=7), {node: [] for node in range(7)}
    last_episode = dict.fromkeys(range(7), 0)
    for step in range(3000):
        node = int(torch.randint(7, (), generator=generator))
        episode = step // 600
        if last_episode[node] != episode:
            expected[node], last_episode[node] = [], episode
        write(schemas, node, step, episode=episode)
        expected[node].append(step)
        if step % 500 == 0:
            schemas.state_dict()  # saving in between must not disturb
    for node, values in expected.items():
        assert schemas.targets(node).flatten().tolist() == values


def test_the_pool_does_not_grow_with_overwritten_episodes():
    schemas = make_schemas(nodes=1)
    for episode in range(50):
        write(schemas, 0, *range(100), episode=episode)
    assert len(schemas.pool) < 1000
    assert schemas.state_dict()["pool.target"].shape == (100, 1)


def test_a_saved_pool_loads_and_goes_on():
    schemas = make_schemas(nodes=2)
    write(schemas, 1, 1, 2, 3)
    write(schemas, 0, 4)
    loaded = make_schemas(nodes=0)
    loaded.load_state_dict(schemas.state_dict())
    write(loaded, 1, 9)
    write(loaded, 0, 8)
    assert loaded.targets(1).flatten().tolist() == [1, 2, 3, 9]
    assert loaded.targets(0).flatten().tolist() == [4, 8]


@pytest.mark.parametrize(
    ("field", "value"),
    [("target_dimensions", 0), ("recall_by", "time"), ("percept_dimensions", 0)],
)
def test_a_config_without_meaning_is_refused_by_name(field: str, value: object):
    fields = {"target_dimensions": 1, "percept_dimensions": 1, field: value}
    with pytest.raises(ValueError, match=f"MotorSchemasConfig.{field}.*got"):
        MotorSchemasConfig(**fields)


def test_a_config_comes_back_from_its_fields():
    config = MotorSchemasConfig(1, 2, recall_by="order", nearest_cues=3)
    assert MotorSchemasConfig(**asdict(config)) == config


def test_by_cue_the_distance_is_euclidean_over_every_dimension():
    schemas = MotorSchemas(MotorSchemasConfig(1, percept_dimensions=2))
    schemas.add_node()
    for value, cue in ((1.0, (0.0, 3.0)), (2.0, (2.0, 2.0))):
        schemas.write(0, torch.tensor([value]), torch.tensor(cue), 0, habituated=True)
    result = schemas.recall(0, torch.zeros(2))  # squared 9 and 8; city block 3 and 4
    assert result is not None
    assert result.offset == 1


def test_deleted_nodes_leave_no_lasting_gaps():
    schemas = make_schemas(nodes=1)
    for episode in range(50):
        node = schemas.add_node()
        write(schemas, node, *range(100), episode=episode)
        schemas.delete(torch.tensor([node]))
    assert len(schemas.pool) < 2000


def test_appending_seldom_moves_a_sequence():
    schemas, starts = make_schemas(nodes=1), set()
    for value in range(1000):
        write(schemas, 0, value)
        starts.add(int(schemas.blocks.live("start")[0]))
    assert len(starts) <= 8  # room for 8, 16, …, 1024


def test_a_recall_in_progress_starts_afresh_when_nodes_are_deleted():
    schemas = make_schemas(nodes=3, recall_by="order")
    write(schemas, 1, 1, 2)
    write(schemas, 2, 7, 8)
    for _ in range(2):
        schemas.recall(1, torch.zeros(1))
    schemas.delete(torch.tensor([1]))
    result = schemas.recall(1, torch.zeros(1))  # what was node 2
    assert result is not None
    assert (result.target.item(), result.offset) == (7, 0)


def test_the_target_is_the_mean_over_the_nearest_cues():
    schemas = MotorSchemas(MotorSchemasConfig(1, percept_dimensions=1, nearest_cues=2))
    node = schemas.add_node()
    for cue, target in ((0.0, 10.0), (1.0, 20.0), (2.0, 60.0), (1.0, 90.0)):
        schemas.write(node, torch.tensor([target]), torch.tensor([cue]), episode=0, habituated=True)
    # From 1.8 the nearest are 2.0 (60) and, of two equally near, the first at 1.0 (20).
    recalled = schemas.recall(node, torch.tensor([1.8]))
    assert recalled is not None
    assert recalled.target.item() == 40.0
    assert recalled.offset == 2


def test_fewer_cues_than_asked_for_are_all_averaged():
    schemas = MotorSchemas(MotorSchemasConfig(1, percept_dimensions=1, nearest_cues=9))
    node = schemas.add_node()
    for cue, target in ((0.0, 1.0), (5.0, 4.0)):
        schemas.write(node, torch.tensor([target]), torch.tensor([cue]), episode=0, habituated=True)
    recalled = schemas.recall(node, torch.tensor([4.0]))
    assert recalled is not None
    assert recalled.target.item() == 2.5
    assert recalled.offset == 1


def test_a_node_that_there_is_not_is_refused():
    schemas = make_schemas(nodes=3)
    for node in range(3):
        write(schemas, node, 1)
    schemas.delete(torch.tensor([2]))
    with pytest.raises(ValueError, match="expected a node from -1 to 1, -1 for none, got 2"):
        schemas.recall_samples(torch.tensor([0, 2]), torch.ones(2, 1))
    with pytest.raises(ValueError, match="expected a node from -1 to 1, -1 for none, got 2"):
        schemas.recall(2, torch.ones(1))


def test_nobody_recalls_nothing():
    schemas = make_schemas()
    write(schemas, 0, 1)
    assert schemas.recall(NO_NODE, torch.zeros(1)) is None
    recalled = schemas.recall_samples(torch.tensor([NO_NODE, 0]), torch.zeros(2, 1))
    assert recalled.offset.tolist() == [-1, 0]
    assert recalled.schema.tolist() == [NO_NODE, 0]
    assert recalled.target.isnan().flatten().tolist() == [True, False]


@pytest.mark.parametrize("recall_by", ["cue", "order"])
@pytest.mark.parametrize(
    "percept",
    [torch.zeros(1, dtype=torch.int64), torch.zeros(2), torch.zeros(1).double(),
     torch.tensor([torch.nan])],
)  # fmt: skip
def test_a_bad_percept_is_refused(recall_by: str, percept: torch.Tensor):
    schemas = make_schemas(recall_by=recall_by)
    write(schemas, 0, 1, 2)
    with pytest.raises(ValueError, match=r"expected (finite )?percept"):
        schemas.recall(0, percept)
    with pytest.raises(ValueError, match=r"expected (finite )?percept"):
        schemas.recall_samples(torch.tensor([0]), percept[None])
    assert recalled(schemas, 0, 0) == [1]  # by order, nothing has moved


def test_a_state_whose_sequence_leaves_the_pool_is_not_loaded():
    schemas = make_schemas(nodes=1)
    write(schemas, 0, 1)
    state = schemas.state_dict()
    state["blocks.length"][0] = 10**6
    with pytest.raises(ValueError, match="lengths of sequences"):
        schemas.load_state_dict(state)
    assert recalled(schemas, 0, 0.1) == [1]


def test_a_sequence_that_leaves_the_pool_is_refused():
    schemas = make_schemas(nodes=1)
    write(schemas, 0, 1)
    schemas.blocks.live("length")[0] = 10**6
    with pytest.raises(ValueError, match="expected sequences within the"):
        schemas.recall(0, torch.ones(1))
