"""The compiled engine against the eager one, which is its specification."""

from __future__ import annotations

import copy
import ctypes
import dataclasses
import mmap
import pickle
import subprocess
import sys
from collections import Counter
from typing import Any

import numba
import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from torch import Tensor

from pacnet import (
    NO_NODE,
    HabituatingSOFM,
    MotorSchemas,
    MotorSchemasConfig,
    Observation,
    SOFMConfig,
)
from pacnet.kernels.distances import distances_of, squared_distances
from pacnet.kernels.engine import Engine, runs_compiled

FAR = 2.0**6  # coordinates under it, of multiples of 1 / FAR, have distances exact in float32
CLOSE = 1e-6  # relative difference of distances whose order rounding may change


def make_both(config: SOFMConfig) -> tuple[HabituatingSOFM, HabituatingSOFM]:
    return HabituatingSOFM(config, engine="eager"), HabituatingSOFM(config, engine="compiled")


def state_of(sofm: HabituatingSOFM) -> dict[str, Tensor]:
    return {name: tensor.clone() for name, tensor in sofm.state_dict().items()}


def assert_same_state(one: HabituatingSOFM, other: HabituatingSOFM) -> None:
    expected, got = state_of(one), state_of(other)
    assert expected.keys() == got.keys()
    for name, tensor in expected.items():
        assert torch.equal(tensor, got[name]), name


def assert_same_record(one: Observation, other: Observation) -> None:
    for name, expected in one._asdict().items():
        got = getattr(other, name)
        assert expected.dtype == got.dtype
        if name == "activation":  # of a distance summed in another order
            torch.testing.assert_close(got, expected, rtol=2e-6, atol=0)
        else:
            assert torch.equal(expected, got), name


def rounding_decides(sofm: HabituatingSOFM, percept: Tensor) -> bool:
    """Return whether winner, runner-up or novelty depend on how distances are rounded."""
    if len(sofm) == 0:
        return False
    scaled = percept * sofm.scale
    rows = torch.cat([sofm.nodes.live("prototype"), scaled[None]]).double()
    exact = bool((rows * FAR == (rows * FAR).round()).all() and (rows.abs() < FAR).all())
    if exact:
        return False  # then each sum of squares is exact, in any order
    distance = torch.linalg.vector_norm(rows[:-1] - rows[-1], dim=1).sort().values
    edge = -torch.tensor(sofm.config.novelty_threshold).double().log()
    gaps = torch.cat([distance[:3].diff(), (distance[:1] - edge).abs()])
    return bool((gaps <= CLOSE * (1 + distance[0])).any())


def draw_settings(draw: st.DrawFn, dimensions: int) -> dict[str, Any]:
    """Draw every field independently of the others."""
    options: dict[str, st.SearchStrategy[Any]] = {
        "scale": st.none() | st.tuples(*[st.sampled_from([0.5, 1.0, 2.0])] * dimensions),
        "novelty_threshold": st.sampled_from([0.01, 0.01, 0.1, 0.3, 0.9]),
        "insert_only_when_habituated": st.booleans(),
        "insert_at": st.sampled_from(["percept", "midpoint"]),
        "ignore_when_habituated": st.booleans(),
        "habituation_scales_learning": st.booleans(),
        "winner_rate": st.sampled_from([0.1, 0.5, 1.0]),
        "neighbour_rate": st.sampled_from([0.0, 0.01, 0.5, 1.0]),
        "habituated_below": st.sampled_from([0.1, 0.1, 0.6]),
        "winner_tau": st.sampled_from([1.5, 3.33]),
        "neighbour_tau": st.sampled_from([4.0, 14.3]),
        "forgetting_interval": st.sampled_from([2, 5, 50, None]),
        "max_edge_age": st.sampled_from([1, 1, 2, 5]),
    }
    return {name: draw(option) for name, option in options.items()}


@st.composite
def sequences(draw: st.DrawFn) -> tuple[SOFMConfig, Tensor, list[int]]:
    """Draw a config, percepts on a coarse grid with many ties, and how many to learn at once."""
    dimensions = draw(st.sampled_from([1, 2, 3, 8, 17]))
    config = SOFMConfig(dimensions, **draw_settings(draw, dimensions))
    coordinate = st.integers(-2, 2).map(float)
    place = st.lists(coordinate, min_size=dimensions, max_size=dimensions)
    places = draw(st.lists(place, min_size=2, max_size=8))
    stays = st.tuples(st.sampled_from(places), st.integers(1, 4))
    order = draw(st.lists(stays, min_size=10, max_size=30))
    percepts = torch.tensor([row for row, stay in order for _ in range(stay)])
    return config, percepts, draw(st.lists(st.integers(0, 9), min_size=3, max_size=10))


def learn_in_parts(sofm: HabituatingSOFM, percepts: Tensor, parts: list[int]) -> Observation:
    """Learn stretches of different lengths, those of length 0 by one `step`."""
    records, start, turn = [], 0, 0
    while start < len(percepts):
        length = parts[turn % len(parts)]
        stretch = percepts[start : start + max(1, length)]
        if length == 0:
            fields = sofm.step(stretch[0].numpy())
            records.append(Observation(*(torch.tensor([field]) for field in fields)))
        else:
            records.append(sofm.observe(stretch))
        start, turn = start + len(stretch), turn + 1
    return Observation(*map(torch.cat, zip(*records, strict=True)))


def test_both_engines_learn_the_same_from_random_sequences():
    happened = Counter()

    @settings(max_examples=100, derandomize=True, deadline=None, database=None)
    @given(sequences())
    def check(sequence: tuple[SOFMConfig, Tensor, list[int]]) -> None:
        config, percepts, parts = sequence
        eager, compiled = make_both(config)
        records = []
        for percept in percepts:
            if rounding_decides(eager, percept):
                happened["stopped"] += 1
                break
            distances = (eager.nodes.live("prototype") - percept * eager.scale).square().sum(1)
            happened["ties"] += len(distances.unique()) < len(distances)
            records.append(eager.observe(percept[None]))
        if not records:
            return
        expected = Observation(*map(torch.cat, zip(*records, strict=True)))
        got = learn_in_parts(compiled, percepts[: len(records)], parts)
        assert_same_record(expected, got)
        assert_same_state(eager, compiled)
        for name in ("inserted", "ignored", "dishabituated", "deleted"):
            happened[name] += int(getattr(expected, name).sum())
        happened["sequences"] += 1

    check()
    for name in ("ties", "inserted", "ignored", "dishabituated", "deleted"):
        assert happened[name] > 20, happened
    assert happened["stopped"] < happened["sequences"] / 2, happened


@pytest.mark.parametrize("preset", ["paper", "gwr"])
@pytest.mark.parametrize("dimensions", [2, 6, 28, 33])
def test_both_engines_learn_the_same_from_noisy_data_but_for_rounding(preset: str, dimensions: int):
    config = getattr(SOFMConfig, preset)(
        dimensions,
        scale=(0.7,) * dimensions,
        novelty_threshold=0.6,
        max_edge_age=2,
        **({"forgetting_interval": 40} if preset == "paper" else {}),
    )
    compared, happened = 0, Counter()
    for seed in range(2):
        eager, compiled = make_both(config)
        random = np.random.default_rng(1000 + seed)
        way = np.cumsum(random.normal(size=(300, dimensions)) / dimensions**0.5, axis=0)
        for percept in torch.from_numpy(np.sin(0.2 * way).astype(np.float32)):
            if rounding_decides(eager, percept):
                break
            expected, got = eager.observe(percept[None]), compiled.observe(percept[None])
            assert_same_record(expected, got)
            compared += 1
            happened.update(inserted=int(expected.inserted), deleted=int(expected.deleted))
        assert_same_state(eager, compiled)
    assert compared > 200
    assert happened["inserted"] > 10
    if dimensions < 28:
        assert happened["deleted"] > 0


@pytest.mark.parametrize("threshold", [1e-4, 0.3, 0.5, 0.9, 0.999, 0.9999999, 0.99999999])
def test_novelty_begins_at_the_same_distance(threshold: float):
    eager, compiled = make_both(SOFMConfig.paper(1, novelty_threshold=threshold))
    start = torch.zeros(1, 1)
    eager.observe(start), compiled.observe(start)
    edge = np.float32(-np.log(threshold))
    around = [edge]
    for towards in (-np.inf, np.inf):
        distance = edge
        for _ in range(100):
            distance = np.nextafter(distance, np.float32(towards))
            around.append(distance)
    steps = torch.logspace(-9, 1, 500)
    percepts = torch.cat([torch.tensor(np.array(around)), steps])[:, None]
    novelty = torch.cat([eager(percept[None]).novelty for percept in percepts])
    assert torch.equal(compiled(percepts).novelty, novelty)
    assert novelty.any()
    assert not novelty.all()


def walk(samples: int, dimensions: int, seed: int = 0) -> Tensor:
    random = torch.Generator().manual_seed(seed)
    return torch.randn(samples, dimensions, generator=random).cumsum(0).mul(0.3)


def make_trained(engine: str = "compiled", **fields: object) -> HabituatingSOFM:
    sofm = HabituatingSOFM(SOFMConfig.paper(3, **fields), engine=engine)
    sofm.observe(walk(300, 3))
    return sofm


def test_a_step_is_an_observation_of_one():
    one, other = make_trained(), make_trained()
    for percept in walk(200, 3, seed=1):
        record = one.observe(percept[None])
        step = other.step(percept.numpy())
        assert tuple(step) == tuple(field.item() for field in record)
        assert all(type(field) in (int, float, bool) for field in step)
    assert_same_state(one, other)


def test_a_step_in_eval_mode_reads_and_changes_nothing():
    sofm = make_trained().eval()
    before = state_of(sofm)
    for percept in walk(50, 3, seed=1):
        step, reading = sofm.step(percept), sofm(percept[None])
        assert step[:4] == tuple(field.item() for field in reading)
        assert step.ignored
        assert not step.attended
    for name, tensor in sofm.state_dict().items():
        assert torch.equal(tensor, before[name])


def test_the_first_step_makes_the_first_node():
    sofm = HabituatingSOFM(SOFMConfig.paper(2))
    step = sofm.step(np.array([1, 2], np.float32))
    assert step == (NO_NODE, NO_NODE, 0.0, True, True, True, False, False, 0)
    assert sofm.prototypes.tolist() == [[1, 2]]


def test_a_row_of_a_larger_or_protected_array_can_be_a_step():
    sofm, plain = make_trained(), make_trained()
    columns = np.asfortranarray(walk(20, 3, seed=2).numpy())
    columns.flags.writeable = False
    for row in columns:
        assert sofm.step(row) == plain.step(row.copy())


@pytest.mark.parametrize(
    "percept",
    [
        np.zeros(2, np.float32), np.zeros((1, 3), np.float32), np.zeros(3),
        [0.0, 0.0, 0.0], None, torch.zeros(3, dtype=torch.float64), torch.zeros(3, device="meta"),
        np.array([0, np.nan, 0], np.float32), torch.tensor([0, 0, torch.inf]),
        np.array([1e18, 0, 0], np.float32), np.ma.masked_array(np.zeros(3, np.float32), [0, 1, 0]),
    ],
    ids=str,
)  # fmt: skip
@pytest.mark.parametrize("engine", ["eager", "compiled"])
def test_a_step_refuses_bad_percepts_before_anything_changes(engine: str, percept: object):
    sofm = make_trained(engine)
    before = state_of(sofm)
    with pytest.raises(ValueError, match=r"^expected .*(percept|scaled).*, got "):
        sofm.step(percept)  # pyright: ignore[reportArgumentType]
    for name, tensor in sofm.state_dict().items():
        assert torch.equal(tensor, before[name])


def test_replaced_buffers_are_noticed():
    sofm, eager = make_trained(), make_trained("eager")
    further = walk(60, 3, seed=3)
    loaded = HabituatingSOFM(SOFMConfig.paper(3), engine="compiled")
    loaded.observe(walk(5, 3, seed=9))
    loaded.load_state_dict(sofm.state_dict())
    copied, pickled = copy.deepcopy(sofm), pickle.loads(pickle.dumps(sofm))
    eager.observe(further)
    for other in (loaded, copied, pickled):
        before = state_of(sofm)
        other.observe(further[:30])
        for percept in further[30:]:
            other.step(percept)
        assert_same_state(eager, other)
        assert_same_state(sofm, make_trained())
        assert state_of(sofm).keys() == before.keys()
    shared = make_trained()
    shared.share_memory()
    shared.observe(further)
    assert_same_state(eager, shared)
    taken = make_trained()
    taken.nodes.prototype = taken.nodes.prototype.clone()
    taken.observe(further)
    assert_same_state(eager, taken)


@pytest.mark.parametrize("engine", ["eager", "compiled"])
@pytest.mark.parametrize("method", ["observe", "step"])
def test_a_loaded_edge_that_is_too_old_is_deleted_at_once(engine: Engine, method: str):
    sofm = HabituatingSOFM(SOFMConfig.paper(1, max_edge_age=50), engine)
    sofm.observe(torch.tensor([[0.0], [5.0], [10.0]]))
    state = sofm.state_dict()
    state["edges.age"][0] = 51  # of nodes 0 and 1, while node 2 wins
    sofm.load_state_dict(state)
    percept = torch.tensor([10.1])
    deleted = (
        sofm.step(percept).deleted if method == "step" else sofm.observe(percept[None]).deleted
    )
    assert int(deleted) == 1
    assert sofm.edges.live("ends").tolist() == [[0, 1]]


def before_a_forbidden_page(tensor: Tensor) -> Tensor:
    """Return the same numbers, right before memory that raises a fault when it is touched."""
    size = tensor.numel() * tensor.element_size()
    usable = -(-size // mmap.PAGESIZE) * mmap.PAGESIZE
    memory = mmap.mmap(-1, usable + mmap.PAGESIZE)
    forbidden = ctypes.addressof(ctypes.c_char.from_buffer(memory)) + usable
    libc = ctypes.CDLL(None, use_errno=True)
    assert libc.mprotect(ctypes.c_void_p(forbidden), ctypes.c_size_t(mmap.PAGESIZE), 0) == 0
    moved = torch.frombuffer(memory, dtype=tensor.dtype, count=tensor.numel(), offset=usable - size)
    return moved.reshape(tensor.shape).copy_(tensor)


@pytest.mark.skipif(sys.platform != "linux", reason="pages are forbidden by Linux's mprotect")
@pytest.mark.parametrize("dimensions", [*range(1, 20), 31, 32, 33, 47, 48, 49, 65])
def test_kernels_keep_within_the_buffers(dimensions: int):
    random = torch.Generator().manual_seed(dimensions)
    for nodes in (1, 7, 8, 9, 24, 31):
        eager, compiled = make_both(SOFMConfig.paper(dimensions, novelty_threshold=0.9))
        eager.observe(torch.randint(-45, 46, (nodes, dimensions), generator=random).float())
        compiled.load_state_dict(eager.state_dict())
        for rows in (compiled.nodes, compiled.edges):
            for name in rows.columns:
                if len(rows):
                    setattr(rows, name, before_a_forbidden_page(rows.get_buffer(name)))
        percepts = torch.randint(-45, 46, (20, dimensions), generator=random).float()
        assert torch.equal(eager(percepts).winner, compiled(percepts).winner)
        assert [compiled.eval().step(row).winner for row in percepts] == eager(
            percepts
        ).winner.tolist()
        eager.observe(percepts[:3])
        compiled.train().observe(percepts[:3])
        assert_same_state(eager, compiled)


def test_a_replaced_config_is_noticed():
    sofm = HabituatingSOFM(SOFMConfig.paper(1, novelty_threshold=0.5), engine="compiled")
    sofm.observe(torch.zeros(1, 1))
    assert not sofm.step(torch.tensor([0.1])).novelty
    sofm.config = dataclasses.replace(sofm.config, novelty_threshold=0.99)
    assert sofm.step(torch.tensor([0.3])).novelty


def shorten_habituation(sofm: HabituatingSOFM) -> None:
    sofm.nodes.habituation = sofm.nodes.habituation[:-1].clone()


def remove_nodes(sofm: HabituatingSOFM) -> None:
    for name in sofm.nodes.columns:  # its edges stay
        setattr(sofm.nodes, name, sofm.nodes.get_buffer(name)[:2].clone())


def join_missing_node(sofm: HabituatingSOFM) -> None:
    sofm.edges.live("ends")[0, 1] = len(sofm)


def join_node_to_itself(sofm: HabituatingSOFM) -> None:
    sofm.edges.live("ends")[0] = 1


def double_habituation(sofm: HabituatingSOFM) -> None:
    sofm.nodes.habituation = sofm.nodes.habituation.double()


def free_prototypes(sofm: HabituatingSOFM) -> None:
    sofm.nodes.prototype = sofm.nodes.prototype.clone()
    sofm.nodes.prototype.untyped_storage().resize_(0)


CONTRADICTIONS = {
    "columns of unequal length": (shorten_habituation, "expected habituation of shape"),
    "fewer nodes": (remove_nodes, "edges between two of 2 nodes"),
    "an edge to a missing node": (join_missing_node, "edges between two of"),
    "an edge from a node to itself": (join_node_to_itself, "edges between two of"),
    "another type": (double_habituation, "expected habituation as torch.float32 on the CPU, got"),
    "no memory": (free_prototypes, "elements in memory, got 0 bytes"),
}


@pytest.mark.parametrize("contradiction", CONTRADICTIONS)
def test_buffers_that_contradict_one_another_are_refused(contradiction: str):
    sofm, (spoil, message) = make_trained(), CONTRADICTIONS[contradiction]
    assert len(sofm) > 3
    sofm.step(walk(1, 3)[0])  # it has looked up its buffers
    spoil(sofm)
    time = int(sofm.time)
    with pytest.raises(ValueError, match=message):
        sofm.observe(walk(5, 3))
    with pytest.raises(ValueError, match=message):
        sofm.step(walk(1, 3)[0])
    assert int(sofm.time) == time


def test_a_part_of_a_state_is_not_loaded():
    sofm, small = make_trained(), HabituatingSOFM(SOFMConfig.paper(3))
    small.observe(walk(2, 3))
    part = {name: tensor for name, tensor in small.state_dict().items() if "nodes" in name}
    with pytest.raises(ValueError, match=r"\['edges.age', 'edges.ends', 'time'\] missing"):
        sofm.load_state_dict(part, strict=False)
    assert_same_state(sofm, make_trained())


def test_an_array_from_another_process_can_be_a_step():
    row = pickle.loads(pickle.dumps(np.zeros(3, np.float32)))
    assert make_trained().step(row) == make_trained().step(np.zeros(3, np.float32))


def test_kernels_outside_the_library_are_not_announced():
    make_trained()  # registers the listener
    space = {"__name__": None}
    exec("def double(x): return 2 * x", space)
    assert numba.njit(space["double"])(4) == 8


def test_double_precision_runs_eagerly_and_cannot_be_forced():
    auto = make_trained("auto").double()
    assert not runs_compiled(auto.engine, auto.nodes.prototype)
    auto.observe(walk(5, 3).double())
    assert runs_compiled(auto.float().engine, auto.nodes.prototype)
    forced = make_trained("compiled").double()
    with pytest.raises(ValueError, match=r"float32 on the CPU for engine='compiled', got torch.fl"):
        forced.observe(walk(5, 3).double())


def test_an_unknown_engine_is_refused():
    with pytest.raises(ValueError, match="auto, eager, compiled, got 'fast'"):
        HabituatingSOFM(SOFMConfig.paper(3), engine="fast")  # pyright: ignore[reportArgumentType]
    assert not runs_compiled("eager", make_trained("eager").nodes.prototype)


def test_reading_in_threads_changes_nothing():
    sofm, percepts = make_trained(novelty_threshold=0.97), walk(20_000, 3, seed=4)
    assert len(sofm) > 60
    threads = torch.get_num_threads()
    try:
        torch.set_num_threads(1)
        alone = sofm(percepts)
        torch.set_num_threads(2)
        together = sofm(percepts)
    finally:
        torch.set_num_threads(threads)
    assert all(map(torch.equal, alone, together))
    eager = make_trained("eager", novelty_threshold=0.97)(percepts)
    differ = (eager.winner != alone.winner) | (eager.runner_up != alone.runner_up)
    assert all(rounding_decides(sofm, percept) for percept in percepts[differ])


@pytest.mark.parametrize("dimensions", [1, 6, 8, 9, 28, 40])
def test_percepts_read_together_are_read_as_each_alone(dimensions: int):
    sofm = HabituatingSOFM(SOFMConfig.paper(dimensions, novelty_threshold=0.9))
    sofm.observe(walk(300, dimensions, seed=6))
    sofm.eval()
    percepts = torch.cat([walk(45, dimensions, seed=7), sofm.prototypes])
    together = sofm(percepts)
    for number, percept in enumerate(percepts):
        assert [field[number].item() for field in together] == list(sofm.step(percept)[:4])


def squares(percept: NDArray[np.float32], rows: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return squared distances of a percept [D] from rows [N, D]."""
    out = np.full(max(4, len(rows)), np.nan, np.float32)
    nearest = squared_distances(percept[None], 0, np.ascontiguousarray(rows.T), 0, len(rows), out)
    order = [*out[: len(rows)].argsort(kind="stable").tolist(), NO_NODE]
    assert nearest == (order[0], order[1])
    return out[: len(rows)]


def nearly_equidistant(dimensions: int) -> tuple[NDArray[np.float32], ...]:
    """Return percepts [8, D], rows [33, D], and squares [8, 33] of each pair alone.

    Rows are permutations of the same numbers, and a percept has equal dimensions: the last bit
    decides which row is nearest.
    """
    rng = np.random.default_rng(dimensions)
    rows = rng.permuted(np.tile(rng.standard_normal(dimensions), (33, 1)), axis=1)
    rows = rows.astype(np.float32)
    percepts = np.repeat(rng.standard_normal((8, 1)), dimensions, axis=1).astype(np.float32)
    alone = [[squares(percept, row[None])[0] for row in rows] for percept in percepts]
    if dimensions > 4:
        assert len(np.unique(np.argmin(alone, axis=1))) > 1
    return percepts, rows, np.array(alone)


@pytest.mark.parametrize("dimensions", range(1, 41))
def test_a_distance_depends_on_the_two_points_alone(dimensions: int):
    percepts, rows, alone = nearly_equidistant(dimensions)
    for percept, expected in zip(percepts, alone, strict=True):
        for first, last in ((0, 33), (1, 33), (5, 8), (7, 12), (3, 4), (11, 13), (30, 33)):
            np.testing.assert_array_equal(squares(percept, rows[first:last]), expected[first:last])
            np.testing.assert_array_equal(
                distances_of(percept, rows[first:last]), np.sqrt(expected[first:last])
            )
        np.testing.assert_array_equal(squares(percept, rows[::-1].copy()), expected[::-1])


@pytest.mark.parametrize("dimensions", range(1, 41))
def test_every_way_of_reading_gives_the_same_distance(dimensions: int):
    """Reading one percept or 100,000, learning, and recalling."""
    percepts, rows, alone = nearly_equidistant(dimensions)
    order = alone.argsort(axis=1, kind="stable")[:, :2]
    nearest = np.sqrt(alone.min(axis=1)).astype(np.float64)
    expected = np.column_stack([order, np.exp(-nearest).astype(np.float32)])
    sofm = HabituatingSOFM(SOFMConfig.paper(dimensions), engine="compiled")
    sofm.load_state_dict(
        sofm.state_dict()
        | {
            "nodes.prototype": torch.from_numpy(rows),
            "nodes.habituation": torch.ones(33),
            "nodes.habituated_at": torch.full((33,), NO_NODE),
        }
    )
    many = sofm(torch.from_numpy(np.tile(percepts, (12_500, 1))))
    np.testing.assert_array_equal(np.column_stack(many[:3]), np.tile(expected, (12_500, 1)))
    schemas = MotorSchemas(MotorSchemasConfig(1, dimensions))
    schemas.add_node()
    for row in torch.from_numpy(rows):
        schemas.write(0, torch.zeros(1), row, 0, habituated=True)
    for percept, wanted in zip(torch.from_numpy(percepts), expected.tolist(), strict=True):
        assert [field.item() for field in sofm(percept[None])[:3]] == wanted
        assert list(sofm.eval().step(percept)[:3]) == wanted
        one, other = copy.deepcopy(sofm).train(), copy.deepcopy(sofm).train()
        assert list(one.step(percept)[:3]) == wanted
        assert [field[0].item() for field in other.observe(percept.expand(3, -1))[:3]] == wanted
        recalled = schemas.recall(0, percept)
        assert recalled is not None
        assert recalled.offset == wanted[0]


def test_ties_go_to_the_lowest_index_however_many_percepts_are_read():
    sofm = HabituatingSOFM(SOFMConfig.paper(2, novelty_threshold=0.9))
    corners = torch.tensor([[x, y] for x in (0.0, 2.0, 4.0) for y in (0.0, 2.0, 4.0)])
    sofm.observe(corners)
    middles = torch.tensor([[1.0, 1.0], [3.0, 1.0], [1.0, 3.0], [3.0, 3.0]])
    expected = [[0, 1], [3, 4], [1, 2], [4, 5]]
    for percepts, pairs in ((middles, expected), (middles.repeat(8, 1), expected * 8)):
        reading = sofm(percepts)
        assert torch.stack(reading[:2], dim=1).tolist() == pairs


def test_a_gradient_reaches_the_percepts_through_the_compiled_search():
    percepts = walk(10, 3, seed=5).requires_grad_()
    gradients = [
        torch.autograd.grad(make_trained(engine)(percepts).activation.sum(), percepts)[0]
        for engine in ("eager", "compiled")
    ]
    torch.testing.assert_close(*gradients)
    assert gradients[0].abs().sum() > 0


def test_the_eager_engine_does_not_import_numba():
    code = """
import sys, torch
from pacnet import HabituatingSOFM, SOFMConfig
sofm = HabituatingSOFM(SOFMConfig.gwr(2, max_edge_age=3), engine="eager")
percepts = torch.randn(60, 2, generator=torch.Generator().manual_seed(0))
sofm.observe(percepts)
sofm(percepts)
sofm.step(percepts[0])
sofm.eval().step(percepts[0].numpy())
state = sofm.state_dict()
sofm.load_state_dict(state)
sys.exit("numba" in sys.modules)
"""
    done = subprocess.run([sys.executable, "-c", code], check=False, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
