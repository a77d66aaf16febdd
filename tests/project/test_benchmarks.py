"""The measurements: interleaved runs, the C loop, the other packages, the page."""

import importlib.util
import socket
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from benchmarks import __main__ as command
from benchmarks import acting, batch, datasets, floor, harness, machine, observe, page, step
from benchmarks.grow_when_required import GrowWhenRequired
from benchmarks.harness import Table
from benchmarks.nodes import full_map
from benchmarks.peers import PEERS, grid
from benchmarks.step import laps
from benchmarks.streams import CASES, demonstrations
from pacnet import HabituatingSOFM, Imitator, SOFMConfig

RECORDED = tuple(name for name in floor.FIELDS if name != "activation")


@pytest.fixture
def built() -> floor.Floor:
    compiled = floor.build()
    if compiled is None:
        pytest.skip("no C compiler")
    return compiled


def learned(config: SOFMConfig, percepts: np.ndarray) -> HabituatingSOFM:
    som = HabituatingSOFM(config, engine="eager")
    som.observe(torch.from_numpy(percepts))
    return som


DELETES = {"novelty_threshold": 0.8, "forgetting_interval": 20}


@pytest.mark.parametrize(
    "config",
    [
        SOFMConfig.paper(28, novelty_threshold=0.63),
        SOFMConfig.gwr(28, novelty_threshold=0.63),
        SOFMConfig.paper(6, max_edge_age=3, **DELETES),
        SOFMConfig.gwr(6, max_edge_age=8, **DELETES),
        SOFMConfig.paper(
            5, novelty_threshold=0.8, insert_at="midpoint", habituation_scales_learning=True
        ),
        SOFMConfig.gwr(17, novelty_threshold=0.6, insert_at="percept"),
    ],
)
def test_the_floor_learns_what_the_eager_engine_learns(built: floor.Floor, config: SOFMConfig):
    percepts = demonstrations(600, config.dimensions, behaviours=2, seed=3)
    som = HabituatingSOFM(config, engine="eager")
    observation = som.observe(torch.from_numpy(percepts))
    nodes, record = built.observe(config, percepts)
    assert nodes == len(som) > 10
    for name in RECORDED:
        assert record[name].tolist() == getattr(observation, name).tolist(), name
    np.testing.assert_allclose(record["activation"], observation.activation, atol=1e-6)
    if config.forgetting_interval == 20:
        assert record["deleted"].sum() > 0
        assert record["dishabituated"].sum() > 0


def test_the_floor_leaves_the_arithmetic_of_the_process_alone(built: floor.Floor):
    built.observe(SOFMConfig.paper(3), demonstrations(10, 3, 1, seed=0))
    assert np.float32(1e-45) / np.float32(1) > 0  # subnormals are still there


def test_the_floor_refuses_a_capacity_that_is_too_small(built: floor.Floor):
    config = SOFMConfig.paper(6, novelty_threshold=0.95)
    percepts = demonstrations(500, 6, 1, seed=0)
    with pytest.raises(ValueError, match="expected ≤ 16 nodes"):
        built.observe(config, percepts, capacity=16)


@pytest.mark.parametrize(
    ("config", "percepts", "capacity"),
    [
        (SOFMConfig.paper(2), np.zeros((3, 2)), 16),
        (SOFMConfig.paper(2), np.zeros((3, 3), np.float32), 16),
        (SOFMConfig.paper(2, scale=(1.0, 2.0)), np.zeros((3, 2), np.float32), 16),
        (SOFMConfig.paper(2), np.zeros((3, 2), np.float32), 17),
    ],
)
def test_the_floor_refuses_what_it_cannot_read(
    built: floor.Floor, config: SOFMConfig, percepts: np.ndarray, capacity: int
):
    with pytest.raises(ValueError, match="expected"):
        built.observe(config, percepts, capacity)


def test_the_floor_reads_every_number(built: floor.Floor):
    memory = np.arange(256 + 16, dtype=np.float32)
    first = (-memory.ctypes.data % 64) // 4
    numbers = memory[first : first + 256]
    assert built.read(numbers, 3) == 3 * numbers.sum()


def test_without_a_compiler_there_is_no_floor_and_its_row_says_so(monkeypatch: pytest.MonkeyPatch):
    floor.build.cache_clear()
    monkeypatch.setattr(floor.shutil, "which", lambda _: None)
    try:
        case = CASES["small"]
        entry = observe.entries(case, case.stream()[:10])[0]
        assert entry.prepare is None
        assert observe._row("small", entry, {}, {})[1] == "no C compiler"
    finally:
        floor.build.cache_clear()


def test_a_peer_that_is_not_installed_has_a_row_that_says_so(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setitem(PEERS, "minigng", PEERS["minigng"]._replace(module="no_such_module"))
    case = CASES["small"]
    entry = next(e for e in observe.entries(case, case.stream()[:10]) if e.name == "minigng")
    assert observe._row("small", entry, {}, {})[1] == "not installed"


def test_rows_compare_with_the_floor_of_the_preset_and_the_slower_of_the_two():
    cost = {"floor paper": 2.0, "floor gwr": 4.0, "compiled paper": 3.0, "compiled gwr": 6.0}
    cost |= {"minigng None": 240.0}
    sizes = dict.fromkeys(cost, 50)
    start = object()
    own = observe.Entry("compiled", "gwr", "ours", 2_500, start)
    assert observe._row("small", own, cost, sizes)[2:] == ("6.00", "1.50 ×", "–", "≤ 2.0 ×")
    peer = observe.Entry("minigng", None, "theirs", 2_500, start)
    assert observe._row("small", peer, cost, sizes)[2:] == ("240", "60.0 ×", "40.0 ×", "≥ 30 ×")


@pytest.mark.parametrize("name", PEERS)
def test_a_peer_makes_one_pass_to_about_as_many_nodes(name: str):
    peer = PEERS[name]
    if not peer.installed:
        pytest.skip(f"{name} is not installed")
    percepts = demonstrations(600, 4, 1, seed=0)
    before = percepts.copy()
    run = peer.prepare(percepts, 12)
    run.learn()
    assert 10 <= run.size() <= 14
    assert np.array_equal(percepts, before)


def test_a_grid_has_about_as_many_nodes():
    assert grid(49) == (7, 7)
    for nodes in (50, 100, 1_000):
        rows, columns = grid(nodes)
        assert abs(rows * columns - nodes) <= 0.05 * nodes
        assert abs(rows - columns) <= 2


def test_searches_by_a_matrix_product_find_what_the_map_finds(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(batch, "CHUNK", 300)
    monkeypatch.setattr(batch, "TORCH_CHUNK", 400)
    som = full_map(50)
    queries = torch.rand(1_000, som.config.dimensions, generator=torch.Generator().manual_seed(2))
    attention = som(queries)
    pair = torch.stack([attention.winner, attention.runner_up], dim=1)
    assert torch.equal(batch.torch_two_nearest(queries, som.prototypes), pair)
    winner, runner_up = batch.numpy_two_nearest(queries.numpy(), som.prototypes.numpy())
    assert np.array_equal(np.stack([winner, runner_up], axis=1), pair.numpy())


@pytest.fixture
def taught() -> Imitator:
    lessons, _ = laps(2, 50)
    imitator = Imitator.from_demonstrations(lessons)
    imitator.learn(lessons)
    return imitator.eval()


def test_an_imitator_learns_while_the_block_runs(taught: Imitator):
    lessons, watched = laps(3, 50)
    learning = acting.Learning(taught, lessons)
    with learning.in_background():
        while not learning.over.is_set():
            assert taught.step(watched[0]).followed
    assert learning.learned == 3
    assert len(taught.reports) == 5


def test_an_error_of_the_learning_thread_is_raised(taught: Imitator):
    lessons, _ = laps(1, 50)
    learning = acting.Learning(taught, replace(lessons, fps=10))
    with pytest.raises(ValueError, match="expected 50 frames per second"), learning.in_background():
        pass


def test_a_steady_loop_takes_every_step_when_it_is_due(taught: Imitator):
    _, watched = laps(1, 20)
    start = time.perf_counter()
    times = acting.steady(taught, iter(watched), rate=200)
    assert time.perf_counter() - start >= 20 / 200
    assert times.taken.shape == times.since_due.shape == (20,)
    assert (times.taken > 0).all()
    assert (times.taken <= times.since_due).all()


def test_acting_has_a_row_for_each_loop_alone_and_beside_learning(
    monkeypatch: pytest.MonkeyPatch, taught: Imitator
):
    monkeypatch.setattr(acting, "imitator", lambda _: (taught, laps(1, 50)[1]))
    monkeypatch.setattr(acting, "LESSONS", 5)
    (table,) = acting.measure(steps=(20, 40), rate=500)
    assert [row[0].split(",")[:2] for row in table.rows] == [
        [loop, f" {beside}"]
        for loop, beside in [
            ("steady", "alone"),
            ("steady", "beside learning"),
            ("steady", "alone"),
            ("steady", "beside learning"),
            ("busy", "alone"),
            ("busy", "beside learning"),
        ]
    ]
    assert [row[4] for row in table.rows] == ["–", "≤ 5", "–", "–", "–", "≤ 5"]
    assert all(len(row) == len(table.columns) for row in table.rows)


def test_an_imitator_that_is_shown_many_demonstrations_is_as_one_that_learned_them():
    episodes, watched = laps(14, 50)
    filled = step.shown_many(episodes, 12)
    expected = Imitator.from_demonstrations(replace(episodes, episodes=episodes.episodes[:10]))
    expected.learn(replace(episodes, episodes=episodes.episodes[:13]))
    for name, tensor in expected.memory.state_dict().items():
        assert torch.equal(filled.memory.state_dict()[name], tensor), name
    assert torch.equal(
        filled.novelty_detector.state_dict()["thresholds"], expected.novelty_detector.thresholds
    )
    for percept in watched:
        assert np.array_equal(filled.step(percept).target, expected.step(percept).target)


def test_steps_after_many_demonstrations_have_a_row_each():
    table = step.measure_imitators({2: 0.1, 12: 0.2}, length=40, steps=200)
    assert [row[0] for row in table.rows] == ["2", "12"]
    assert [row[2] for row in table.rows] == ["≤ 0.1", "≤ 0.2"]
    assert [row[7] for row in table.rows] == ["–", "≤ 2 ×"]
    assert all(len(row) == len(table.columns) for row in table.rows)


@pytest.mark.parametrize("max_edge_age", [50, 5])
def test_the_numpy_network_learns_what_preset_gwr_learns(max_edge_age: int):
    config = SOFMConfig.gwr(6, novelty_threshold=0.85, max_edge_age=max_edge_age)
    percepts = demonstrations(800, 6, behaviours=2, seed=1)
    network = GrowWhenRequired(config)
    network.learn(percepts)
    som = learned(config, percepts)
    assert network.count == len(som) > 16  # beyond the first capacity
    np.testing.assert_allclose(network.prototypes, som.prototypes, atol=1e-5)


def test_streams_are_seeded_and_ordered_in_time():
    stream = demonstrations(1000, 6, behaviours=3, seed=5)
    assert stream.shape == (1000, 6)
    assert stream.dtype == np.float32
    assert np.array_equal(stream, demonstrations(1000, 6, behaviours=3, seed=5))
    assert not np.array_equal(stream, demonstrations(1000, 6, behaviours=3, seed=6))
    moved = np.linalg.norm(np.diff(stream, axis=0), axis=1)
    apart = np.linalg.norm(stream[:500] - stream[500:], axis=1)
    assert np.median(moved) < 0.3 * np.median(apart)


@pytest.mark.parametrize("preset", ["paper", "gwr"])
def test_thresholds_give_the_nodes_that_the_case_names(built: floor.Floor, preset: str):
    for case in CASES.values():
        nodes, _ = built.observe(case.config(preset), case.stream())
        assert abs(nodes - case.nodes) <= 0.05 * case.nodes


def test_runs_are_interleaved_until_the_budget_is_spent(monkeypatch: pytest.MonkeyPatch):
    durations = {"quick": iter([5.0, 1.0, 2.0]), "slow": iter([9.0, 7.0])}
    order = []

    def timed(run: object) -> float:
        order.append(run)
        return next(durations[run])

    monkeypatch.setattr(harness, "timed", timed)
    candidates = {"quick": lambda: "quick", "slow": lambda: "slow"}
    medians = harness.median_times(candidates, budget=10, most=3)
    assert order == ["quick", "slow", "quick", "slow", "quick"]  # 16 is over the slow one's budget
    assert medians == {"quick": 2.0, "slow": 8.0}


def test_latencies_are_one_for_each_call():
    seen = []
    times = harness.latencies(seen.append, np.arange(5))
    assert seen == [0, 1, 2, 3, 4]
    assert times.shape == (5,)
    assert (times > 0).all()


def test_a_table_is_markdown_in_straight_columns():
    drawn = str(Table("Title", "Some\ntext.", ("who", "µs"), [("one", "1.0"), ("other", "10.0")]))
    assert drawn.splitlines() == [
        "## Title",
        "",
        "Some text.",
        "",
        "| who   |   µs |",
        "|-------|-----:|",
        "| one   |  1.0 |",
        "| other | 10.0 |",
    ]


def test_the_page_keeps_the_other_parts_of_the_same_machine(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(page, "PAGE", tmp_path / "performance.md")
    page.update({"batch": "## B\n\nold"}, ("observe", "batch"), "- here")
    page.update({"observe": "## O"}, ("observe", "batch"), "- here")
    written = page.PAGE.read_text("utf-8")
    assert page.parts_of(written, "- here") == {"observe": "## O", "batch": "## B\n\nold"}
    assert written.index("## O") < written.index("## B") < written.index("- here")
    page.update({"observe": "## O"}, ("observe", "batch"), "- there")
    assert page.parts_of(page.PAGE.read_text("utf-8"), "- there") == {"observe": "## O"}


def test_the_machine_is_described_without_its_name_or_paths():
    described = machine.describe()
    assert socket.gethostname() not in described
    assert str(Path.cwd()) not in described
    assert f"numpy {np.__version__}" in described


def test_the_command_measures_all_or_what_is_named(capsys: pytest.CaptureFixture[str]):
    assert command.parse_arguments([]) == (list(command.MODULES), None)
    assert command.parse_arguments(["batch", "step"]) == (["batch", "step"], None)
    also = command.parse_arguments(["datasets", "--also", sys.executable])
    assert also == (["datasets"], sys.executable)
    for refused in (["no_such_table"], ["datasets", "--also", "no_such_python"]):
        with pytest.raises(SystemExit):
            command.parse_arguments(refused)
        assert f"got {refused[-1]}" in capsys.readouterr().err


@pytest.mark.parametrize("name", command.MODULES)
def test_every_name_is_a_module(name: str):
    assert importlib.util.find_spec(f"benchmarks.{name}") is not None


def test_an_interruption_keeps_finished_tables_and_a_failure_the_others(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    def measure(name: str) -> list[Table] | None:
        if name == "batch":
            raise KeyboardInterrupt
        return None if name == "nodes" else [Table(name, "", ("a", "b"), [])]

    monkeypatch.setattr(command, "measure_in_process", measure)
    parts = command.measure_all(["observe", "nodes", "step", "batch", "memory"])
    assert list(parts) == ["observe", "step"]
    assert "interrupted" in capsys.readouterr().err


def test_datasets_are_measured_with_a_second_interpreter_too(monkeypatch: pytest.MonkeyPatch):
    def measure(name: str, python: str = "own") -> list[Table]:
        return [Table(f"{name} by {python}", "", ("a", "b"), [])]

    monkeypatch.setattr(command, "measure_in_process", measure)
    parts = command.measure_all(["step", "datasets"], also="other")
    assert parts["step"].count("## ") == 1
    assert parts["datasets"].index("datasets by own") < parts["datasets"].index("datasets by other")


def test_tables_of_datasets_name_the_versions_that_they_were_measured_with():
    table = datasets._table("Reading", "How.\n", ("a", "b"), [])
    lerobot = machine.version_of("lerobot")
    assert table.title == f"Reading, LeRobot {lerobot}"
    assert f"lerobot {lerobot}, torch {torch.__version__.split('+')[0]}" in table.text


@pytest.mark.slow
def test_a_module_that_fails_in_its_process_is_reported(capsys: pytest.CaptureFixture[str]):
    assert command.measure_in_process("no_such_module") is None
    assert "no_such_module failed" in capsys.readouterr().err


def test_a_case_gives_the_config_of_either_preset():
    case = CASES["long"]
    assert case.config("paper").insert_at == "percept"
    assert case.config("gwr").insert_at == "midpoint"
    assert case.config("gwr").novelty_threshold == case.gwr_threshold
