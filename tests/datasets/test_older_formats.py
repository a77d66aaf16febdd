"""Claims about datasets of formats v2.0 and v2.1: they are read as v3.0 is."""

from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
import torch
from handmade import TASKS, columns, write, write_info, write_lines, write_old
from layouts import Shown, write_v21

from pacnet.datasets.demonstrations import Demonstrations, load_demonstrations
from pacnet.datasets.format import DatasetError, DatasetWarning
from pacnet.datasets.recorder import Recorder


@pytest.fixture(params=["v2.0", "v2.1"])
def root(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    return write_old(tmp_path / "old", request.param)


def assert_equal(one: Demonstrations, other: Demonstrations) -> None:
    assert (one.fps, one.names) == (other.fps, other.names)
    for mine, theirs in zip(one, other, strict=True):
        assert (mine.episode, mine.task) == (theirs.episode, theirs.task)
        assert torch.equal(mine.percepts, theirs.percepts)
        assert torch.equal(mine.action, theirs.action)


def test_an_old_dataset_reads_as_the_same_in_the_new_format(root: Path, tmp_path: Path):
    assert_equal(load_demonstrations(root), load_demonstrations(write(tmp_path / "new")))


def test_tasks_that_no_frame_is_about_are_not_tasks(root: Path):
    assert [shown.task for shown in load_demonstrations(root)] == list(TASKS)


def test_the_frames_of_an_episode_may_count_from_0_in_each_file(root: Path):
    expected, frames = load_demonstrations(root), columns()
    frames["index"] = frames["frame_index"]
    write_old(root, "v2.1", frames)

    assert_equal(load_demonstrations(root), expected)


def test_columns_of_the_format_may_be_missing(root: Path):
    """Then a file's name says which episode it holds, and its order is that of time."""
    expected = load_demonstrations(root)
    for path in sorted((root / "data").glob("*/*.parquet")):
        table = pq.read_table(path)
        missing = ["index", "frame_index", "timestamp", "episode_index"]
        pq.write_table(table.drop_columns(missing), path)

    assert_equal(load_demonstrations(root), expected)


def test_without_task_indices_the_list_of_episodes_has_the_tasks(root: Path):
    for path in (root / "data").glob("*/*.parquet"):
        pq.write_table(pq.read_table(path).drop_columns(["task_index"]), path)

    with pytest.warns(DatasetWarning, match="no 'task_index': tasks are taken from the episodes'"):
        demonstrations = load_demonstrations(root)

    assert [shown.task for shown in demonstrations] == list(TASKS)


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("nonsense", "cannot be read"),
        ("[0]", r"expected an object on each line, found \[0\]"),
        ('{"task_index": "0", "task": "x"}', "expected tasks as index, text, found '0', 'x'"),
        ("\udcff", "cannot be read"),
    ],
)
def test_damaged_tasks_are_named_and_can_be_done_without(root: Path, line: str, message: str):
    (root / "meta/tasks.jsonl").write_text(line, errors="surrogateescape")

    with pytest.raises(DatasetError, match=rf"tasks.jsonl.*{message}.*--skip-damaged"):
        load_demonstrations(root)
    with pytest.warns(DatasetWarning, match="tasks are taken from the episodes' list"):
        demonstrations = load_demonstrations(root, skip_damaged=True)
    assert [shown.task for shown in demonstrations] == list(TASKS)


def test_missing_tasks_are_named(root: Path):
    (root / "meta/tasks.jsonl").unlink()
    with pytest.raises(DatasetError, match=r"tasks\.jsonl cannot be read.*--skip-damaged"):
        load_demonstrations(root)


def test_an_unknown_task_is_named(root: Path):
    write_lines(root / "meta/tasks.jsonl", [{"task_index": 0, "task": "drink"}])

    with pytest.raises(DatasetError, match=r"tasks.jsonl: expected the tasks \[1\], found \[0\]"):
        load_demonstrations(root)


def test_an_old_dataset_is_not_appended_to(root: Path):
    features = {"observation.state": ("x",), "action": ("y",)}

    with pytest.raises(DatasetError, match=r"v3.0 to append to, found v2.*`pacnet export`"):
        Recorder(root, 50, features).__enter__()


def test_a_declared_feature_without_a_column_is_named_with_those_there(root: Path):
    frames = columns()
    del frames["action"]
    write_old(root, "v2.1", frames)

    with pytest.raises(
        DatasetError, match=r"'action', the dataset has the vectors 'observation.state'"
    ):
        load_demonstrations(root)
    assert len(load_demonstrations(root, action=None)) == 3


def test_features_that_are_not_declared_are_found_in_the_data(root: Path):
    write_info(root, codebase_version="v2.1", features={})
    demonstrations = load_demonstrations(root)

    assert demonstrations.names["observation.state"] == ("0", "1", "2")
    np.testing.assert_array_equal(
        demonstrations.episodes[0].state, columns()["observation.state"][:4]
    )


@pytest.mark.slow
def test_lerobots_own_converter_makes_the_same_of_it(tmp_path: Path):
    """Its steps without the one that asks the Hub; in both versions of LeRobot."""
    try:
        from lerobot.scripts import convert_dataset_v21_to_v30 as converter
    except ImportError:
        from lerobot.datasets.v30 import convert_dataset_v21_to_v30 as converter

    rng = np.random.default_rng(3)
    episodes = [
        Shown(
            task,
            {
                "observation.state": rng.normal(size=(length, 3)),
                "observation.environment_state": rng.normal(size=(length, 1)),
                "action": rng.normal(size=(length, 2)).astype("f4"),
            },
        )
        for task, length in (("drink", 5), ("wave", 3), ("drink", 4))
    ]
    old, new = write_v21(tmp_path / "shown", episodes), tmp_path / "new" / "shown"
    converter.convert_info(old, new, 100, 500)
    converter.convert_tasks(old, new)
    converter.convert_episodes_metadata(old, new, converter.convert_data(old, new, 100))

    converted = load_demonstrations(new)
    assert_equal(load_demonstrations(old), converted)
    for shown, demonstration in zip(episodes, converted, strict=True):
        state = shown.values["observation.state"].astype("f4")
        np.testing.assert_array_equal(demonstration.state, state)
