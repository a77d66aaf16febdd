"""Results of the Metaworld benchmark: kept cell by cell, continued, and reported as tables."""

import itertools
import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from metaworld_toys import ToyWorld, observation

from benchmarks import results_page
from benchmarks.metaworld import __main__ as command
from benchmarks.metaworld import figure, recording, report
from benchmarks.metaworld.features import View
from benchmarks.metaworld.recording import ExpertFailsError, demonstrations_of, load, successes
from benchmarks.metaworld.results import Cell, Result, Results
from pacnet import load_demonstrations

HALF = Result([True, False], [120, 300], 0.25, 1.5, 40.0)
ALL = HALF._replace(successes=[True, True])


class ToyTask(ToyWorld):
    """The made-up world with an expert, which gives up where the seed is divisible by `fails`."""

    made = 0

    def __init__(self, task: str, fails: int = 10**9) -> None:
        ToyTask.made += 1
        self.task, self.fails = task, fails

    def expert(self, seen: np.ndarray) -> np.ndarray:
        """Return the way to the object."""
        way = 10 * (seen[4:7] - seen[:3])
        return np.append(way if self.seeds[-1] % self.fails else 0 * way, -1.0)


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(command, "World", ToyTask)
    return tmp_path


def arguments(folder: Path, *more: str) -> command.Arguments:
    given = ["--tasks", "reach", "--draws", "1", "--demonstrations", "1", "2", "--episodes", "3"]
    given += ["--learners", "nearest", "replay", "--folder", str(folder)]
    return command.parse_arguments([*given, *more])


def test_results_come_back_as_they_were_kept(tmp_path: Path):
    results = Results(tmp_path / "results")
    assert results.all() == {}
    usual, noisy = Cell("door-open", 0, 5, "bc"), Cell("door-open", 0, 5, "bc", View(noise=0.002))
    assert usual.file == "door-open-0-5-bc.json"
    results.keep(usual, ALL)
    results.keep(noisy, HALF)
    results.keep(usual, HALF)
    results.keep(usual, ALL)
    assert results.all() == {usual: ALL, noisy: HALF}
    assert results.has(usual, episodes=2)
    assert not results.has(usual, episodes=3)
    assert not results.has(Cell("door-open", 1, 5, "bc"), episodes=2)


def test_views_have_files_of_their_own():
    views = [View(), View(noise=0.1), View(units=1000), View(turn=30), View(turn=30, units=1000)]
    assert len({Cell("push", 0, 1, "bc", view).file for view in views}) == 5


def test_a_task_that_is_left_out_is_named_and_not_reported(tmp_path: Path):
    results = Results(tmp_path)
    results.keep(Cell("push", 0, 1, "bc"), HALF)
    results.keep(Cell("reach", 0, 1, "bc"), HALF)
    results.leave_out("push", "push: its expert succeeded in 14 of 20")
    assert [cell.task for cell in results.all()] == ["reach"]
    drawn = report.markdown(results.all(), results.failed_experts)
    assert "push: its expert succeeded in 14 of 20" in " ".join(drawn.split())


def test_a_run_measures_every_cell_and_then_none(folder: Path, monkeypatch: pytest.MonkeyPatch):
    results = Results(folder / "results")
    command.measure(arguments(folder), results)
    found = results.all()
    expected = itertools.product((1, 2), ("nearest", "replay"))
    assert {(cell.demonstrations, cell.learner) for cell in found} == set(expected)
    assert all(len(result.successes) == 3 for result in found.values())
    monkeypatch.setattr(command, "evaluate", lambda *_: pytest.fail("it was measured before"))
    command.measure(arguments(folder), results)


def test_an_interrupted_run_goes_on(folder: Path, monkeypatch: pytest.MonkeyPatch):
    results, real, calls = Results(folder / "results"), command.evaluate, []

    def interrupted(cell: Cell, *rest: object) -> Result:
        calls.append(cell)
        if len(calls) == 3:
            raise KeyboardInterrupt
        return real(cell, *rest)

    monkeypatch.setattr(command, "evaluate", interrupted)
    with pytest.raises(KeyboardInterrupt):
        command.measure(arguments(folder), results)
    assert set(results.all()) == set(calls[:2])
    command.measure(arguments(folder), results)
    assert calls[3] == calls[2]
    assert len(calls) == 5  # four cells, one of them twice
    command.measure(arguments(folder, "--again"), results)
    assert len(calls) == 9


def test_a_dataset_is_recorded_once_and_read_in_its_order(folder: Path):
    world = ToyTask("reach")
    root = demonstrations_of(world, 1, folder)
    assert world.seeds == list(range(20_000, 20_020))
    demonstrations_of(world, 1, folder)
    assert len(world.seeds) == 20
    shown = load(root, 5)
    assert len(shown) == 5
    assert shown.fps == 80
    assert shown.names == {
        "observation.state": ("hand.x", "hand.y", "hand.z", "gripper"),
        "observation.environment_state": (
            "object.x", "object.y", "object.z", "goal.x", "goal.y", "goal.z"
        ),
        "action": ("x", "y", "z", "gripper"),
    }  # fmt: skip
    world.reset(20_004)
    first = observation(world.hand, world.thing, world.goal)
    expected = np.float32([*first[:4], *first[4:7], *first[36:]])
    assert np.array_equal(shown.episodes[4].percepts[0], expected)


def test_a_recording_that_was_interrupted_is_begun_again(
    folder: Path, monkeypatch: pytest.MonkeyPatch
):
    real = recording.Recorder.save_episode
    saved: Iterator[int] = itertools.count(1)

    def interrupted(self: object, *rest: object) -> None:
        if next(saved) == 7:
            raise KeyboardInterrupt
        real(self, *rest)

    monkeypatch.setattr(recording.Recorder, "save_episode", interrupted)
    world = ToyTask("reach")
    with pytest.raises(KeyboardInterrupt):
        demonstrations_of(world, 0, folder)
    root = demonstrations_of(world, 0, folder)
    assert len(load_demonstrations(root)) == 20
    assert [path.name for path in folder.iterdir()] == [root.name]


def test_demonstrations_end_ten_frames_after_success():
    world = ToyTask("reach")
    (shown,) = successes(world, 7, number=1)
    places = shown.observations[:, :3] - shown.observations[:, 4:7]
    near = np.flatnonzero(np.linalg.norm(places, axis=1) < 0.01)
    # Action t leads to observation t + 1: the first success is that of action near[0] − 1.
    assert len(shown.actions) == near[0] + 10
    assert np.abs(shown.actions).max() <= 1
    assert shown.actions[:, 3].max() == pytest.approx(-1 + 0.2, abs=0.15)  # the noise is executed
    assert np.array_equal(np.array(world.commands), shown.actions)


def test_only_successes_are_kept_and_an_expert_that_fails_is_refused():
    kept = list(successes(ToyTask("reach", fails=6), 1))
    assert len(kept) == 20
    with pytest.raises(ExpertFailsError, match=r"reach: its expert succeeded in 1[0-9] of"):
        list(successes(ToyTask("reach", fails=3), 1))
    with pytest.raises(ExpertFailsError, match="succeeded in 0 of 6"):
        list(successes(ToyTask("reach", fails=1), 1))


def test_a_failing_expert_leaves_its_task_out_and_the_others_go_on(
    folder: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(command, "World", lambda name: ToyTask(name, 3 if name == "push" else 99))
    results = Results(folder / "results")
    given = arguments(folder)._replace(tasks=["push", "reach"])
    command.measure(given, results)
    assert {cell.task for cell in results.all()} == {"reach"}
    assert set(results.failed_experts) == {"push"}
    made = ToyTask.made
    command.measure(given, results)  # nothing is missing, push is not tried again
    assert ToyTask.made == made


def test_means_are_over_draws_and_then_over_tasks():
    found = {
        Cell("reach", 0, 1, "bc"): HALF,
        Cell("push", 0, 1, "bc"): ALL,
        Cell("push", 1, 1, "bc"): ALL,
    }
    assert report.success(found, "bc") == pytest.approx((0.5 + 1.0) / 2)
    found[Cell("push", 1, 1, "pacnet")] = ALL
    assert report.success(found, "pacnet") is None  # not measured on all of them
    assert report.success({}, "bc") is None


def test_tables_have_a_row_for_each_set_view_and_number_of_demonstrations():
    noisy = View(noise=0.002)
    found = {
        Cell("push", 0, 1, "pacnet"): ALL,
        Cell("push", 0, 1, "nearest"): HALF,
        Cell("reach", 0, 20, "nearest", noisy): HALF,
        Cell("reach", 0, 5, "nearest"): ALL,
        Cell("reach", 0, 5, "pacnet"): HALF,
    }
    table = report.sets_table(found, {})
    assert table.columns == ("tasks, demonstrations", "number", "`Imitator`", "1-NN")
    assert table.rows == [
        ("development, 5", "1", "50%", "100%"),
        ("development, noise 0.002, 20", "1", "–", "50%"),
        ("held-out, 1", "1", "100%", "50%"),
        ("all, 1", "1", "100%", "50%"),
        ("all, 5", "1", "50%", "100%"),
        ("all, noise 0.002, 20", "1", "–", "50%"),
    ]
    assert report.tasks_table(found).rows == [
        ("reach, 5", "development", "50%", "100%"),
        ("push, 1", "held-out", "100%", "50%"),
    ]
    times = report.times_table(found)
    assert times.rows[0] == ("`Imitator`, 1", "1.50", "40.0", "25%")


def test_the_page_and_the_figure_are_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(results_page, "PAGE", tmp_path / "benchmarks.md")
    monkeypatch.setattr(figure, "PATH", tmp_path / "metaworld.png")
    found = {Cell("reach", 0, n, "nearest"): HALF for n in (1, 5)}
    report.write(found, {})
    page = results_page.PAGE.read_text("utf-8")
    assert page.count("<!-- metaworld -->") == 1
    assert "| development, 5" in page
    assert f"images/{figure.PATH.name}" in page
    assert figure.PATH.read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize(
    ("given", "told"),
    [
        (["--draws", "0"], "--draws: expected 1 to 50, got 0"),
        (["--demonstrations", "1", "21"], "--demonstrations: expected 1 to 20, got 21"),
        (["--episodes", "1001"], "--episodes: expected 1 to 1000, got 1001"),
        (["--noise", "-1"], "expected --noise ≥ 0"),
        (["--units", "0"], "expected --noise ≥ 0 and --units > 0"),
        (["--learners", "nobody"], "nobody"),
    ],
)
def test_arguments_out_of_range_are_refused(
    given: list[str], told: str, capsys: pytest.CaptureFixture[str]
):
    with pytest.raises(SystemExit):
        command.parse_arguments(given)
    assert told in capsys.readouterr().err


def test_without_arguments_both_sets_are_measured():
    given = command.parse_arguments([])
    assert given.tasks == ["development", "held-out"]
    assert (given.draws, given.demonstrations, given.episodes) == (3, [1, 5, 20], 50)
    assert given.view == View()
    assert len(list(command.cells(given, ["reach"]))) == 3 * 3 * 6


def test_only_what_a_command_asks_for_is_printed(folder: Path):
    given = arguments(folder)
    asked, other = Cell("reach", 0, 2, "replay"), Cell("reach", 1, 2, "replay")
    assert command.asked_for(given, {asked: HALF, other: ALL}) == {asked: HALF}
    noisy = given._replace(view=View(noise=0.1))
    assert command.asked_for(noisy, {asked: HALF, other: ALL}) == {}


def test_every_file_is_complete_json(folder: Path):
    results = Results(folder / "results")
    command.measure(arguments(folder), results)
    names = sorted(path.name for path in results.folder.iterdir())
    assert names[0] == "reach-0-1-nearest.json"
    content = json.loads((results.folder / names[0]).read_text("utf-8"))
    assert content["cell"]["task"] == "reach"
