"""Where a recalled target came from, by hand, and what competed with it."""

from __future__ import annotations

import copy

import numpy as np
import pytest
import torch

from pacnet import NO_NODE, CompetingSchemas, CompetingSchemasConfig, RecognitionConfig
from pacnet.competition.explanation import Origin

ELSEWHERE = 9.0


def make_schemas(**fields: object) -> CompetingSchemas:
    fields = {"lookahead_samples": 3, "same_schema_similarity": 0.75, **fields}
    schemas = CompetingSchemas(CompetingSchemasConfig(1, percept_dimensions=1, **fields))
    for _ in range(2):
        schemas.add_node()
    return schemas


def write(schemas: CompetingSchemas, cue: float, target: float = 0.0, kept: bool = True) -> None:
    schemas.write(0, torch.tensor([target]), torch.tensor([cue]), activation=0.8, habituated=kept)


def show(
    schemas: CompetingSchemas,
    episode: int,
    behaviour: str,
    before: int,
    targets: list[float],
    cue: float = 0.0,
    then: float = ELSEWHERE,
) -> None:
    """An episode that comes to node 0 after so many samples elsewhere, and continues elsewhere."""
    schemas.begin(episode, behaviour)
    for _ in range(before):
        write(schemas, ELSEWHERE, kept=False)
    for target in targets:
        write(schemas, cue, target)
    for _ in range(4):
        write(schemas, then, kept=False)


def test_a_target_stands_for_the_same_share_of_each_pass():
    schemas = make_schemas()
    show(schemas, 3, "tea", 2, [1.0] * 5)  # frames 2 to 6
    show(schemas, 7, "milk", 10, [2.0] * 9)  # frames 10 to 18
    show(schemas, 8, "tea", 4, [3.0] * 7)  # frames 4 to 10, and it stays: it is the newest
    schemas.begin(9, "")
    assert schemas.targets(0).flatten().tolist() == [3.0] * 7
    assert schemas.origins(0, 0) == [(8, "tea", 4), (3, "tea", 2), (7, "milk", 10)]
    # A third of the way: 4 + 2, 2 + 4/3, 10 + 8/3.
    assert schemas.origins(0, 2) == [(8, "tea", 6), (3, "tea", 3), (7, "milk", 13)]
    assert schemas.origins(0, 6) == [(8, "tea", 10), (3, "tea", 6), (7, "milk", 18)]


def test_the_own_moment_is_that_of_the_sequence_that_was_kept():
    schemas = make_schemas()
    show(schemas, 0, "tea", 1, [1.0, 1.0, 1.0, 1.0])
    show(schemas, 1, "tea", 5, [0.0, 2.0, 0.0, 2.0])  # a tremor: it does not renew
    schemas.begin(2, "")
    assert schemas.targets(0).flatten().tolist() == [1.0] * 4
    assert schemas.origins(0, 1) == [(0, "tea", 2), (1, "tea", 6)]


def test_a_moment_is_a_frame_that_was_shown_though_the_pass_was_interrupted():
    schemas = make_schemas()
    schemas.begin(0, "tea")
    for kept in (True, True, False, False, True):
        write(schemas, 0.0, kept=kept)
    assert [schemas.origins(0, position)[0].frame for position in range(3)] == [0, 1, 4]


def test_of_passes_at_the_same_frames_the_one_that_was_kept_is_named_first():
    schemas = make_schemas()
    show(schemas, 0, "tea", 1, [0.0, 1.0, 0.0, 1.0])
    show(schemas, 1, "tea", 1, [1.0, 1.5, 2.0, 2.5])  # smoother: it renews
    show(schemas, 2, "tea", 1, [3.0, 1.0, 3.0, 1.0])  # a tremor: it does not
    schemas.begin(3, "")
    assert schemas.targets(0).flatten().tolist() == [1.0, 1.5, 2.0, 2.5]
    assert schemas.origins(0, 1) == [Origin(number, "tea", 2) for number in (1, 0, 2)]


def wander(schemas: CompetingSchemas, episode: int, generator: torch.Generator) -> None:
    """An episode at one node after the other, in which every target says episode and frame."""
    schemas.begin(episode, "")
    lengths = torch.randint(1, 10, (8,), generator=generator)
    nodes = torch.randint(5, (8,), generator=generator).repeat_interleave(lengths)
    for frame, node in enumerate(nodes.tolist()):
        schemas.write(
            node,
            torch.tensor([episode, frame]).float(),
            node + 0.02 * torch.randn(1, generator=generator),
            activation=0.8,
            habituated=bool(torch.rand((), generator=generator) < 0.8),
        )


@pytest.mark.parametrize("seed", range(3))
def test_the_first_origin_is_where_the_target_was_shown(seed: int):
    generator = torch.Generator().manual_seed(seed)
    schemas = CompetingSchemas(CompetingSchemasConfig(2, percept_dimensions=1, lookahead_samples=4))
    for _ in range(5):
        schemas.add_node()
    for episode in range(10, 22):
        wander(schemas, episode, generator)
        if episode % 4 == 0:
            schemas.delete(torch.tensor([episode % 5]))
            schemas.add_node()
    shared = 0
    for schema in range(len(schemas.blocks)):
        for position, (episode, frame) in enumerate(schemas.targets(schema).tolist()):
            origins = schemas.origins(schema, position)
            assert origins[0] == (episode, "", frame)
            shared += len(origins) > 1
    assert shared > 10


@pytest.mark.parametrize(
    ("schema", "position", "message"),
    [
        (1, 0, "schema from 0 to 0, got 1"),
        (NO_NODE, 0, "schema from 0 to 0, got -1"),
        (0, 2, "offset from 0 to 1, got 2"),
        (0, -1, "offset from 0 to 1, got -1"),
    ],
)
def test_what_is_not_there_has_no_origin(schema: int, position: int, message: str):
    schemas = make_schemas()
    show(schemas, 0, "tea", 0, [1.0, 1.0])
    with pytest.raises(ValueError, match=message):
        schemas.origins(schema, position)


def make_fork(**fields: object) -> CompetingSchemas:
    """After node 0 comes +5 (tea, and once milk) or -5 (milk)."""
    schemas = make_schemas(recognition=RecognitionConfig(n_states=8), **fields)
    for episode, (name, side) in enumerate((("tea", 1), ("milk", -1), ("milk", 1))):
        show(schemas, episode, name, 3, [side * 1.0] * 4, cue=0.1 * side, then=side * 5.0)
    schemas.begin(3, "")
    return schemas


def test_rivals_are_all_schemas_of_the_node_the_most_confident_first():
    schemas = make_fork(margin=0.0)
    for percept in (0.1, 0.05, -0.1, -0.1, -0.1):
        answer = schemas.recall(0, torch.tensor([percept]))
        rivals = schemas.rivals(0, torch.tensor([percept]))
        assert answer is not None
        assert (answer.schema, answer.offset) == (rivals[0].schema, rivals[0].offset)
        assert sorted(rival.schema for rival in rivals) == schemas.schemas_of(0).tolist()
        assert rivals[0].confidence > rivals[1].confidence
        names = {schemas.targets(each.schema)[0].item(): each.behaviours for each in rivals}
        assert names == {1.0: ("tea", "milk"), -1.0: ("milk",)}


def test_asking_for_rivals_changes_nothing():
    asked, other = make_fork(), make_fork()
    before = copy.deepcopy(asked.state_dict())
    for percept in (9.0, 0.1, 0.0, -0.1, -0.1):
        answers = [each.recall(0, torch.tensor([percept])) for each in (asked, other)]
        assert (answers[0] is None) == (answers[1] is None)
        if answers[0] is not None:
            assert answers[0][1:] == answers[1][1:]
        asked.rivals(0, torch.tensor([percept]))
        asked.rivals(1, torch.tensor([0.0]))
    one, two = asked._recall.belief.probability, other._recall.belief.probability
    np.testing.assert_array_equal(one, two)
    for name, value in asked.state_dict().items():
        assert torch.equal(value, before[name]), name


def test_where_nothing_competes_there_are_no_rivals():
    schemas = make_fork()
    schemas.recall(NO_NODE, torch.tensor([0.0]))
    assert schemas.rivals(NO_NODE, torch.tensor([0.0])) == []
    assert schemas.rivals(1, torch.tensor([2.0])) == []


def test_before_the_first_percept_nothing_competes():
    schemas = make_fork()
    schemas.recall(0, torch.tensor([0.0]))
    schemas.reset()
    for each in (schemas, make_schemas()):
        with pytest.raises(ValueError, match="recalled, got none"):
            each.rivals(0, torch.tensor([0.0]))
