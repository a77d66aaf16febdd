"""An episode learned in portions of any size, against a plain account of one sample at a time."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from pacnet import NO_NODE, CompetingSchemas, CompetingSchemasConfig
from pacnet.schemas.interface import Samples
from pacnet.schemas.visits import Visit, assign_samples, continue_means

TARGETS, PERCEPTS, NODES, CONTINUATION = 2, 3, 5, 4


def make_schemas(**fields: object) -> CompetingSchemas:
    fields = {"lookahead_samples": CONTINUATION, "schemas_per_node": 3, **fields}
    schemas = CompetingSchemas(CompetingSchemasConfig(TARGETS, PERCEPTS, **fields))
    for _ in range(NODES):
        schemas.add_node()
    return schemas


def make_samples(generator: torch.Generator, count: int, dtype: torch.dtype) -> Samples:
    """Nodes that win for a while, in turns or once, each with percepts of its own."""
    change = torch.rand(count, generator=generator) < 0.4
    node = torch.randint(NODES, (count,), generator=generator)
    for sample in range(1, count):
        node[sample] = node[sample] if change[sample] else node[sample - 1]
    cue = node[:, None] + 0.05 * torch.randn(count, PERCEPTS, generator=generator)
    return Samples(
        node=node,
        activation=torch.rand(count, generator=generator).to(dtype),
        habituated=torch.rand(count, generator=generator) < 0.8,
        habituated_at=torch.zeros(count, dtype=torch.int64),
        target=torch.randn(count, TARGETS, generator=generator).to(dtype),
        cue=cue.to(dtype),
    )


def rows(samples: Samples) -> list[Samples]:
    """One sample each."""
    return [Samples(*(column[i : i + 1] for column in samples)) for i in range(len(samples.node))]


def in_portions(samples: Samples, generator: torch.Generator) -> list[Samples]:
    """The same samples, cut at random places."""
    cuts = torch.randint(1, len(samples.node), (6,), generator=generator).unique().tolist()
    columns = (column.tensor_split(cuts) for column in samples)
    return [Samples(*portion) for portion in zip(*columns, strict=True)]


class PlainEpisode:
    """What one episode leaves behind; passes as dicts, one sample at a time."""

    def __init__(self, dtype: np.dtype) -> None:
        self.dtype = dtype
        self.passes: list[dict] = []
        self.samples = 0

    def write(self, node: int, activation: float, habituated: bool, target: list, cue: list):
        """Add one sample."""
        for known in self.passes:
            if self.samples - known["last"] <= CONTINUATION:
                known["continuation"] = cue
        if habituated:
            self._write(node, activation, target, cue)
        self.samples += 1

    def _write(self, node: int, activation: float, target: list, cue: list) -> None:
        for known in self.passes:
            if known["node"] == node and self.samples - known["last"] <= CONTINUATION:
                here = known
                break
        else:
            here = {"node": node, "first": self.samples, "fit": self.dtype.type(0)}
            here |= {"continuation": cue, "targets": [], "cues": [], "frames": []}
            self.passes.append(here)
        here["last"] = self.samples
        here["targets"].append(target)
        here["cues"].append(cue)
        here["frames"].append(self.samples)
        seen = self.dtype.type(len(here["targets"]))
        here["fit"] = here["fit"] + (self.dtype.type(activation) - here["fit"]) / seen


def shown_alike(schemas: CompetingSchemas, plain: PlainEpisode) -> bool:
    state = schemas.state_dict()  # which closes the gaps

    def of_passes(name: str) -> list:
        return [each[name] for each in plain.passes]

    def joined(name: str) -> list:
        return [value for each in plain.passes for value in each[name]]

    expected = {
        "episodes.samples": [plain.samples],
        "visits.first": of_passes("first"),
        "visits.last": of_passes("last"),
        "visits.schema": list(range(len(plain.passes))),
        "blocks.node": of_passes("node"),
        "blocks.length": [len(targets) for targets in of_passes("targets")],
        "blocks.fit": [float(fit) for fit in of_passes("fit")],
        "blocks.continuation": of_passes("continuation"),
        "pool.target": joined("targets"),
        "pool.cue": joined("cues"),
        "pool.frame": joined("frames"),
    }
    return all(state[name].tolist() == values for name, values in expected.items())


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
@pytest.mark.parametrize("seed", range(4))
def test_one_episode_in_any_portions_equals_plain_lists(seed: int, dtype: torch.dtype):
    generator = torch.Generator().manual_seed(seed)
    samples = make_samples(generator, 160, dtype)
    plain = PlainEpisode(np.dtype(str(dtype).removeprefix("torch.")))
    for *row, _ in zip(*(column.tolist() for column in samples), strict=True):
        plain.write(*row)
    assert len(plain.passes) > 10
    for portions in ([samples], rows(samples), in_portions(samples, generator)):
        schemas = make_schemas().to(dtype)
        schemas.begin(0, "")
        for portion in portions:
            schemas.add_samples(portion, 0)
        assert shown_alike(schemas, plain)


def write_each(schemas: CompetingSchemas, samples: Samples) -> None:
    for node, activation, habituated, target, cue, _ in zip(*samples, strict=True):
        schemas.write(
            int(node), target, cue, activation=float(activation), habituated=bool(habituated)
        )


@pytest.mark.parametrize("seed", range(3))
def test_episodes_with_deletions_are_the_same_to_the_bit_in_any_portions(seed: int):
    generator = torch.Generator().manual_seed(seed)
    at_once, one_by_one, cut = everyone = (make_schemas(), make_schemas(), make_schemas())
    for episode in range(8):
        samples = make_samples(generator, 80, torch.float32)
        for schemas in everyone:
            schemas.begin(episode, f"behaviour {episode % 2}")
        at_once.add_samples(samples, episode)
        write_each(one_by_one, samples)
        for portion in in_portions(samples, generator):
            cut.add_samples(portion, episode)
        gone = torch.randint(NODES, (1,), generator=generator)
        for schemas in everyone if episode % 3 == 2 else ():  # and the episode may go on
            schemas.delete(gone)
            schemas.add_node()
    expected = at_once.state_dict()
    assert len(at_once.blocks) > 10
    for schemas in (one_by_one, cut):
        for name, value in schemas.state_dict().items():
            assert torch.equal(value, expected[name]), name


def test_samples_are_assigned_to_the_pass_that_may_go_on():
    # Node 1 was there two samples ago; from 10 on it may be away for three.
    recent = Visit(node=1, last=8, row=0)
    passes = assign_samples([2, 1, NO_NODE, 2, 1, 2, 2, 2, 2, 1], 10, [recent], lookahead=3)
    assert [(each.node, each.row, each.samples, each.last) for each in passes] == [
        (1, 0, [1, 4], 14),
        (2, -1, [0, 3, 5, 6, 7, 8], 18),
        (1, -1, [9], 19),  # five after 14
    ]


def test_a_pass_that_was_left_for_too_long_does_not_go_on():
    (recent, new) = assign_samples([1], 10, [Visit(node=1, last=6, row=0)], lookahead=3)
    assert (recent.samples, new.samples) == ([], [0])


def test_means_go_on_as_one_value_after_the_other():
    generator = torch.Generator().manual_seed(0)
    counts = torch.tensor([1, 40, 7, 3])
    seen, values = torch.tensor([0, 0, 5, 1000]), torch.rand(51, generator=generator)
    means = torch.tensor([0.0, 0.0, 0.25, 0.75])
    expected = []
    for mean, number, some in zip(
        means.numpy(), seen.tolist(), values.split(counts.tolist()), strict=True
    ):
        so_far = mean
        for count, value in enumerate(some.numpy(), start=number + 1):
            so_far = so_far + (value - so_far) / np.float32(count)
        expected.append(so_far)
    assert continue_means(means, seen, values, counts).tolist() == expected


def test_what_came_after_is_seen_over_portions_without_a_habituated_sample():
    schemas = make_schemas()
    schemas.begin(0, "")
    seen = []
    for habituated, cue in ((True, 1.0), (False, 2.0), (False, 3.0), (False, 4.0)):
        portion = Samples(
            node=torch.zeros(2, dtype=torch.int64),
            activation=torch.ones(2),
            habituated=torch.full((2,), habituated),
            habituated_at=torch.zeros(2, dtype=torch.int64),
            target=torch.zeros(2, TARGETS),
            cue=torch.full((2, PERCEPTS), cue),
        )
        schemas.add_samples(portion, 0)
        seen.append(schemas.blocks.live("continuation").unique().tolist())
    # Four samples after the last, and no more: two portions.
    assert seen == [[1.0], [2.0], [3.0], [3.0]]
    assert schemas.lengths.tolist() == [2]
    assert schemas.episodes.live("last_cue").unique().tolist() == [4.0]
