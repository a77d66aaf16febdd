"""Commands read the episodes and frames asked for, and say what is wrong with the rest."""

import json
import math
import re
import warnings
from pathlib import Path

import pytest
import torch
from command_line import (
    STATE,
    assert_equal,
    edit_frames,
    process,
    record,
    refusal,
    rows_under,
    run,
    unannounced,
    value_of,
)

from pacnet.cli.notes import show_notes
from pacnet.datasets.demonstrations import Demonstrations, load_demonstrations
from pacnet.datasets.format import DatasetWarning
from pacnet.imitator import Imitator

TASKS = ("drink", "wave", "drink", "wave")


def learned(demonstrations: Demonstrations) -> Imitator:
    imitator = Imitator.from_demonstrations(demonstrations)
    imitator.learn(demonstrations)
    return imitator


@pytest.fixture
def damaged(tmp_path: Path) -> Path:
    """Four episodes of 80 frames; frame 7 of episode 1 has no x."""
    root = record(tmp_path / "damaged", TASKS, 1000)

    def spoil(columns: dict[str, list]) -> None:
        columns[STATE][87][0] = math.nan

    edit_frames(root, spoil)
    return root


@pytest.fixture
def gapped(tmp_path: Path) -> Path:
    """Four episodes at 20 frames per second; one second is missing before frame 50 of episode 2."""
    root = record(tmp_path / "gapped", TASKS, 1000)

    def delay(columns: dict[str, list]) -> None:
        for row in range(210, 240):
            columns["timestamp"][row] += 1.0

    edit_frames(root, delay)
    return root


@pytest.mark.parametrize(
    ("options", "episodes"),
    [
        (("--episodes", "2,0-1"), [0, 1, 2]),
        (("--episodes", "3", "--episodes", "1,1"), [1, 3]),
        (("--exclude", "3"), [0, 1, 2]),
        (("--exclude", "0", "--exclude", "2-3"), [1]),
        (("--episodes", "0-2", "--exclude", "1"), [0, 2]),
    ],
)
def test_fit_learns_the_episodes_asked_for(
    options: tuple[str, ...], episodes: list[int], tmp_path: Path
):
    root = record(tmp_path / "shown", TASKS, 1000)
    assert run("fit", root, *options, "--out", tmp_path / "out") == 0
    imitator = Imitator.from_pretrained(tmp_path / "out")
    assert [report.episode for report in imitator.reports] == episodes
    assert_equal(imitator, learned(load_demonstrations(root, episodes=episodes)))


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        ("a", "numbers and ranges of episodes, such as 0,2,5-9, got 'a'"),
        ("", "numbers and ranges of episodes, such as 0,2,5-9, got ''"),
        ("1,,2", "numbers and ranges of episodes, such as 0,2,5-9, got '1,,2'"),
        ("-1", "numbers and ranges of episodes, such as 0,2,5-9, got '-1'"),
        ("1-", "numbers and ranges of episodes, such as 0,2,5-9, got '1-'"),
        ("0.5", "numbers and ranges of episodes, such as 0,2,5-9, got '0.5'"),
        ("9999999999", "numbers and ranges of episodes, such as 0,2,5-9, got '9999999999'"),
        ("1,5-2", "ranges from a lower to a higher number, got 5-2"),
        ("0-999999999", "at most 1,000,000 episodes, got '0-999999999'"),
    ],
)
@pytest.mark.parametrize("option", ["--episodes", "--exclude"])
def test_a_list_that_is_none_is_wrong_usage(
    option: str, given: str, expected: str, capsys: pytest.CaptureFixture[str]
):
    assert run("watch", "imitator", "data", option, given) == 2
    last = capsys.readouterr().err.splitlines()[-1]
    assert f"argument {option}: expected {expected}" in last


@pytest.mark.parametrize("command", ["fit", "watch", "explain"])
def test_episodes_that_are_not_there_are_one_line(
    command: str, imitator: Path, other: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    line = {
        "fit": ["fit", other, "--out", tmp_path / "out", "--episodes", "1,7"],
        "watch": ["watch", imitator, other, "--episodes", "1,7"],
        "explain": ["explain", imitator, other, "--episode", "7", "--frame", "0"],
    }[command]
    assert "expected episodes of the dataset, which has 0-2, got 7" in refusal(capsys, *line)


def test_watch_leaves_out_what_is_not_finite(
    imitator: Path, damaged: Path, capsys: pytest.CaptureFixture[str]
):
    message = refusal(capsys, "watch", imitator, damaged)
    assert "episode 1, frame 7, dimension 'x'" in message
    assert "--exclude 1" in message
    assert run("watch", imitator, damaged, "--exclude", "1") == 0
    rows = rows_under("episode", capsys.readouterr().out)
    assert [row[0] for row in rows] == ["0", "2", "3"]


def test_export_copies_the_episodes_asked_for(imitator: Path, damaged: Path, tmp_path: Path):
    line = ("export", imitator, damaged, "--exclude", "1")
    assert run(*line, "--out", tmp_path / "copy") == 0
    copies = load_demonstrations(tmp_path / "copy")
    originals = load_demonstrations(damaged, exclude=[1])
    assert [copy.episode for copy in copies] == [0, 1, 2]
    assert [copy.task for copy in copies] == ["drink", "drink", "wave"]
    for copy, original in zip(copies, originals, strict=True):
        assert torch.equal(copy.percepts, original.percepts)
        assert torch.equal(copy.action, original.action)
    assert run(*line, "--no-videos", "--out", tmp_path / "blind") == 0  # it has none


def test_export_finds_a_dataset_by_its_name(
    imitator: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setenv("HF_LEROBOT_HOME", str(tmp_path / "cache"))
    monkeypatch.chdir(tmp_path)
    record(tmp_path / "cache" / "someone" / "drinking", ("drink", "wave"), 1000)
    assert run("export", imitator, "someone/drinking", "--out", "copy") == 0
    assert len(load_demonstrations("copy")) == 2


def test_explain_reads_only_its_episode(
    imitator: Path, damaged: Path, capsys: pytest.CaptureFixture[str]
):
    line = ("explain", imitator, damaged, "--frame", 60, "--episode")
    assert run(*line, 2) == 0
    assert "episode 1, frame 7" in refusal(capsys, *line, 1)
    assert run(*line, 2, "--episodes", "2-3", "--exclude", "3") == 0
    message = refusal(capsys, *line, 2, "--episodes", "0,3")
    assert "expected --episode among --episodes, got 2" in message


@pytest.mark.parametrize("command", ["fit", "watch", "export", "explain"])
def test_damaged_files_are_left_out_on_request(
    command: str, imitator: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    root = record(tmp_path / "first", ("drink",), 1000)
    (root / "data" / "chunk-000" / "file-001.parquet").write_bytes(b"nothing")
    line = {
        "fit": ["fit", root, "--out", tmp_path / "out"],
        "watch": ["watch", imitator, root],
        "export": ["export", imitator, root, "--out", tmp_path / "out"],
        "explain": ["explain", imitator, root, "--episode", "0", "--frame", "0"],
    }[command]
    if command != "explain":  # which asks for an episode that is whole
        assert "--skip-damaged" in refusal(capsys, *line)
    assert run(*line, "--skip-damaged") == 0
    error = unannounced(capsys.readouterr().err)
    assert command == "explain" or re.search(r"^note: left out.*file-001.parquet", error)


def test_a_gap_is_a_note_and_the_table_shows_the_parts(
    gapped: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    assert run("fit", gapped, "--out", tmp_path / "out") == 0
    out, error = capsys.readouterr()
    (line,) = unannounced(error).splitlines()
    assert line.startswith("note: ")
    assert "episode 2" in line
    rows = rows_under("dataset", out)
    assert [(row[1], row[3]) for row in rows] == [
        ("0", "80"), ("1", "80"), ("2", "50"), ("2 from frame 50", "30"), ("3", "80")
    ]  # fmt: skip
    assert value_of("learned", out).startswith("4 episodes in 5 parts, 320 frames in ")
    assert run("info", tmp_path / "out") == 0
    assert "2 from frame 50" in capsys.readouterr().out
    assert run("fit", gapped, "--from", tmp_path / "out", "--out", tmp_path / "out") == 0
    assert value_of("learned", capsys.readouterr().out).endswith("(8 episodes in all)")


def test_transitions_across_a_gap_are_not_counted(
    gapped: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    assert run("fit", gapped, "--targets", "state", "--out", tmp_path / "out") == 0
    # From each frame to the next within four episodes of 80 frames: 316, one of them over the gap.
    assert "to 315 transitions ..." in capsys.readouterr().err


def test_explain_names_frames_of_the_episode_not_of_its_part(
    tmp_path: Path, gapped: Path, capsys: pytest.CaptureFixture[str]
):
    assert run("fit", gapped, "--episodes", "2", "--out", tmp_path / "out") == 0
    capsys.readouterr()
    line = ("explain", tmp_path / "out", gapped, "--episode", 2, "--frame", 70, "--json")
    assert run(*line) == 0
    document = json.loads(capsys.readouterr().out)
    with pytest.warns(DatasetWarning, match="gap"):
        shown = load_demonstrations(gapped, episodes=[2]).episodes[0]
    first = document["followed"][0]  # the part that shows this very frame
    assert first["episode"] == 2
    assert abs(first["frame"] - 70) <= 2
    assert first["seconds"] == first["frame"] / 20
    assert list(first["target"].values()) == shown.action[first["frame"]].tolist()


def test_watch_runs_over_whole_episodes(
    imitator: Path, gapped: Path, capsys: pytest.CaptureFixture[str]
):
    usual = warnings.showwarning
    assert run("watch", imitator, gapped) == 0
    assert warnings.showwarning is usual
    out, error = capsys.readouterr()
    assert [row[0] for row in rows_under("episode", out)] == ["0", "1", "2", "3"]
    assert unannounced(error).startswith("note: ")


def test_only_the_frames_where_someone_stepped_in_are_learned(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    root = record(tmp_path / "shown", TASKS, 1000)

    def step_in(columns: dict[str, list]) -> None:
        columns["intervention"] = [False] * 320
        for first, end in ((20, 50), (60, 80), (170, 200)):
            columns["intervention"][first:end] = [True] * (end - first)

    edit_frames(root, step_in)
    assert run("fit", root, "--only-where", "intervention", "--out", tmp_path / "out") == 0
    out = capsys.readouterr().out
    assert [(row[1], row[3]) for row in rows_under("dataset", out)] == [
        ("0 from frame 20", "30"), ("0 from frame 60", "20"), ("2 from frame 10", "30")
    ]  # fmt: skip
    assert value_of("learned", out).startswith("2 episodes in 3 parts, 80 frames in ")
    message = refusal(capsys, "fit", root, "--only-where", "acted", "--out", tmp_path / "two")
    assert "'acted'" in message
    assert "'intervention'" in message


def test_notes_are_printed_once_and_other_warnings_stay(capsys: pytest.CaptureFixture[str]):
    with warnings.catch_warnings(record=True) as others:
        warnings.simplefilter("always")
        show_notes()
        for _ in range(2):
            warnings.warn("a file is\nmissing", DatasetWarning, stacklevel=1)
        warnings.warn("another is", DatasetWarning, stacklevel=1)
        warnings.warn("something else", UserWarning, stacklevel=1)
    assert capsys.readouterr().err == "note: a file is missing\nnote: another is\n"
    assert [str(other.message) for other in others] == ["something else"]
    with pytest.warns(DatasetWarning, match="now as always"):
        warnings.warn("now as always", DatasetWarning, stacklevel=1)


@pytest.mark.slow
def test_a_process_prints_notes_without_files_and_lines(gapped: Path, imitator: Path):
    done = process("watch", imitator, gapped)
    assert done.returncode == 0
    assert [line[:6] for line in unannounced(done.stderr).splitlines()] == ["note: "]
