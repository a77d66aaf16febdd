"""Claims about copying a dataset with extra columns."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from pacnet.datasets.annotations import write_annotated
from pacnet.datasets.demonstrations import load_demonstrations
from pacnet.datasets.format import DatasetError, DatasetWarning
from pacnet.datasets.format.file_number import FileNumber
from pacnet.datasets.format.writing import DataFiles
from pacnet.datasets.recorder import Feature, Recorder

LENGTHS = (4, 1, 3)
TASKS = ("drink", "wave", "drink")
FEATURES = {
    "observation.state": ("x", "y", "z"),
    "action": ("push",),
    "reward": ("mine", "yours"),  # LeRobot's policies ignore it; the copy keeps it
}
COLUMNS = {"behaviour": ("drink", "wave"), "novelty": ("novelty",), "winner": ("winner",)}


def frames(seed: int = 0) -> dict[str, np.ndarray]:
    """Every frame of the episodes: features [8, D] and the format's own columns [8]."""
    rng = np.random.default_rng(seed)
    total = sum(LENGTHS)
    columns: dict[str, np.ndarray] = {
        name: rng.normal(size=(total, len(names))).astype("f4") for name, names in FEATURES.items()
    }
    columns["index"] = np.arange(total)
    columns["episode_index"] = np.repeat((0, 2, 5), LENGTHS)  # as after episodes were deleted
    columns["frame_index"] = np.concatenate([np.arange(length) for length in LENGTHS])
    columns["timestamp"] = columns["frame_index"] / 50
    columns["task_index"] = np.repeat((0, 1, 0), LENGTHS)
    return columns


def write_source(root: Path, values: Mapping[str, np.ndarray], **changes: Any) -> Path:
    """A sound dataset, but for the changes to its info.json."""
    tasks = changes.pop("tasks", ["drink", "wave"])
    features = {
        name: {"dtype": str(values[name].dtype), "shape": [len(names)], "names": list(names)}
        for name, names in FEATURES.items()
    }
    own = {
        name: {"dtype": str(values[name].dtype), "shape": [1], "names": None}
        for name in ("index", "episode_index", "frame_index", "timestamp", "task_index")
    }
    info = {
        "codebase_version": "v3.0",
        "robot_type": "hand",
        "fps": 50,
        "total_episodes": len(LENGTHS),
        "total_frames": sum(LENGTHS),
        "features": features | own,
    }
    info["features"] |= changes.pop("features", {})
    (root / "meta").mkdir(parents=True)
    (root / "meta" / "info.json").write_text(json.dumps(info | changes))
    pq.write_table(pa.table({"task_index": [0, 1], "task": tasks}), root / "meta/tasks.parquet")
    (root / "data" / "chunk-000").mkdir(parents=True)
    table = {
        name: array.tolist() if array.ndim == 2 and array.shape[1] > 1 else array.ravel()
        for name, array in values.items()
    }
    pq.write_table(pa.table(table), root / "data/chunk-000/file-000.parquet")
    return root


def added(seed: int = 1) -> list[dict[str, np.ndarray]]:
    """The extra columns of each episode."""
    rng = np.random.default_rng(seed)
    return [
        {
            "behaviour": rng.uniform(size=(length, 2)).astype("f4"),
            "novelty": rng.uniform(size=(length, 1)).astype("f4"),
            "winner": rng.integers(-1, 9, size=(length, 1)),
        }
        for length in LENGTHS
    ]


@pytest.fixture
def source(tmp_path: Path) -> Path:
    return write_source(tmp_path / "source", frames())


def column(root: Path, name: str) -> np.ndarray:
    """A feature of a dataset, all episodes one after the other [8, D]."""
    read = load_demonstrations(root, state=name, environment_state=None, action=name)
    return np.concatenate([episode.state.numpy() for episode in read])


def test_the_copy_has_all_of_the_source_and_the_columns(source: Path, tmp_path: Path):
    write_annotated(source, tmp_path / "copy", COLUMNS, iter(added()))

    for name in FEATURES:
        np.testing.assert_array_equal(column(tmp_path / "copy", name), frames()[name])
    for name in COLUMNS:
        expected = np.concatenate([episode[name] for episode in added()])
        np.testing.assert_array_equal(column(tmp_path / "copy", name), expected)
    read = load_demonstrations(tmp_path / "copy", environment_state="reward", action="behaviour")
    assert [len(episode.state) for episode in read] == list(LENGTHS)
    assert [episode.episode for episode in read] == [0, 1, 2]
    assert [episode.task for episode in read] == list(TASKS)
    assert read.fps == 50
    assert read.names["reward"] == FEATURES["reward"]
    assert read.names["behaviour"] == COLUMNS["behaviour"]


def test_the_source_stays_as_it_is(source: Path, tmp_path: Path):
    before = {path: path.read_bytes() for path in source.rglob("*") if path.is_file()}
    write_annotated(source, tmp_path / "copy", COLUMNS, added())

    assert before == {path: path.read_bytes() for path in source.rglob("*") if path.is_file()}


@pytest.mark.slow
def test_lerobot_reads_the_copy(source: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    from lerobot.datasets.lerobot_dataset import LeRobotDataset

    monkeypatch.setattr("datasets.config.HF_DATASETS_CACHE", tmp_path / "cache")
    write_annotated(source, tmp_path / "copy", COLUMNS, added())

    dataset = LeRobotDataset("local/copy", root=tmp_path / "copy", video_backend="pyav")
    assert (dataset.num_episodes, dataset.fps, dataset.meta.robot_type) == (3, 50, "hand")
    assert dataset.meta.features["behaviour"]["names"] == ["drink", "wave"]
    assert len(dataset) == sum(LENGTHS)
    row = 0
    for number, episode in enumerate(added()):
        for time in range(LENGTHS[number]):
            frame = dataset[row]
            assert frame["task"] == TASKS[number]
            assert (frame["episode_index"], frame["frame_index"]) == (number, time)
            np.testing.assert_array_equal(frame["behaviour"], episode["behaviour"][time])
            assert frame["winner"].shape == ()  # a vector of one dimension reads back as a scalar
            assert frame["winner"] == episode["winner"][time, 0]
            np.testing.assert_array_equal(frame["reward"], frames()["reward"][row])
            row += 1


def test_whole_numbers_and_booleans_come_back_as_they_were(tmp_path: Path):
    values = frames() | {"reward": np.arange(16).reshape(8, 2) - 2**24 + 1}
    source = write_source(tmp_path / "source", values, fps=50.0)
    seen = [
        {"novel": np.arange(length)[:, None] % 2 == 0, "winner": np.full((length, 1), 2**24 + 1)}
        for length in LENGTHS
    ]
    write_annotated(source, tmp_path / "copy", {"novel": ("n",), "winner": ("w",)}, seen)

    np.testing.assert_array_equal(column(tmp_path / "copy", "reward"), values["reward"])
    copy = pq.read_table(tmp_path / "copy/data/chunk-000/file-000.parquet")
    assert copy["novel"].to_pylist() == [True, False] * 2 + [True, True, False, True]
    assert copy["winner"].to_pylist() == [2**24 + 1] * 8  # float32 would have made it 2**24
    features = json.loads((tmp_path / "copy/meta/info.json").read_text())["features"]
    kinds = {name: features[name]["dtype"] for name in ("reward", "novel", "winner", "action")}
    expected = {"reward": "int64", "novel": "bool", "winner": "int64", "action": "float32"}
    assert kinds == expected


@pytest.mark.parametrize(
    "reward",
    [
        np.arange(16, dtype=np.uint8).reshape(8, 2),
        np.arange(16).reshape(8, 2) + 2**53 + 1,  # float64 would round them
        np.arange(16).reshape(8, 2) / 3,
        np.full((8, 2), np.nan, "f4"),
    ],
)
def test_numbers_stay_as_they_are_stored(tmp_path: Path, reward: np.ndarray):
    source = write_source(tmp_path / "source", frames() | {"reward": reward})
    write_annotated(source, tmp_path / "copy", COLUMNS, added())

    features = json.loads((tmp_path / "copy/meta/info.json").read_text())["features"]
    assert features["reward"]["dtype"] == str(reward.dtype)
    copy = pq.read_table(tmp_path / "copy/data/chunk-000/file-000.parquet")["reward"]
    stored = pq.read_table(source / "data/chunk-000/file-000.parquet")["reward"]
    assert copy.type == stored.type
    np.testing.assert_array_equal(copy.to_pylist(), stored.to_pylist())


def test_what_the_recorder_wrote_is_copied_as_it_is(tmp_path: Path):
    features = {"action": ("x", "y"), "next.success": Feature(("success",), "bool")}
    success = np.array([[False], [False], [True]])
    with Recorder(tmp_path / "source", 10, features) as recorder:
        recorder.save_episode("reach", {"action": np.ones((3, 2)), "next.success": success})
    columns, seen = {"novelty": ("novelty",)}, [{"novelty": np.ones((3, 1))}]
    write_annotated(tmp_path / "source", tmp_path / "copy", columns, seen)
    copy = pq.read_table(tmp_path / "copy/data/chunk-000/file-000.parquet")
    assert copy["next.success"].to_pylist() == [False, False, True]


def refused(
    source: Path,
    message: str,
    columns: Mapping[str, Any] = COLUMNS,
    episodes: Any = None,
    error: type[ValueError] = ValueError,
) -> None:
    """Copying raises, and leaves nothing."""
    copy = source.parent / "copy"
    with pytest.raises(error, match=message):
        write_annotated(source, copy, columns, added() if episodes is None else episodes)
    assert not copy.exists()


@pytest.mark.parametrize("dtype", ["image", "video", "string", "float32"])
def test_what_is_declared_and_not_there_is_left_out(tmp_path: Path, dtype: str):
    missing = {"dtype": dtype, "shape": [3, 4, 4] if dtype != "string" else [1], "names": None}
    source = write_source(tmp_path / "source", frames(), features={"observation.eye": missing})
    with pytest.warns(DatasetWarning, match="'observation.eye' .* is left out of the copy"):
        write_annotated(source, tmp_path / "copy", COLUMNS, added())

    info = json.loads((tmp_path / "copy/meta/info.json").read_text())
    assert "observation.eye" not in info["features"]
    np.testing.assert_array_equal(column(tmp_path / "copy", "action"), frames()["action"])


def test_a_source_that_is_no_dataset_is_refused(tmp_path: Path):
    refused(tmp_path / "nowhere", "found no folder", error=DatasetError)


def test_episodes_without_a_task_in_words_are_untitled(tmp_path: Path):
    """LeRobot takes no empty task."""
    source = write_source(tmp_path / "source", frames(), tasks=["drink", " "])
    with pytest.warns(DatasetWarning, match="no task in words in episode 2: 'untitled' in the"):
        write_annotated(source, tmp_path / "copy", COLUMNS, added())
    tasks = [shown.task for shown in load_demonstrations(tmp_path / "copy")]
    assert tasks == ["drink", "untitled", "drink"]


def test_without_the_tables_of_tasks_the_list_of_episodes_has_them(tmp_path: Path):
    source = write_source(tmp_path / "source", frames())
    (source / "meta/tasks.parquet").unlink()
    numbers = zip((0, 2, 5), "abc", strict=True)
    lines = [{"episode_index": index, "tasks": [task]} for index, task in numbers]
    (source / "meta/episodes.jsonl").write_text("\n".join(map(json.dumps, lines)))
    refused(source, "tasks.jsonl cannot be read|tasks.parquet cannot be read", error=DatasetError)
    with pytest.warns(DatasetWarning, match="tasks are taken from the episodes' list"):
        write_annotated(source, tmp_path / "copy", COLUMNS, added(), skip_damaged=True)
    assert [shown.task for shown in load_demonstrations(tmp_path / "copy")] == ["a", "b", "c"]


@pytest.mark.parametrize("fps", [29.97, None, "10"])
@pytest.mark.parametrize("version", ["v3.0", "v2.1"])
def test_frames_per_second_that_are_not_whole_are_refused(
    tmp_path: Path, fps: object, version: str
):
    camera = {"observation.eye": {"dtype": "video", "shape": [4, 4, 3], "names": None}}
    values = {"fps": fps, "codebase_version": version, "features": camera}
    source = write_source(tmp_path / "source", frames(), **values)

    message = f"a whole number as fps in meta.info.json, found {fps!r}"
    refused(source, message, error=DatasetError)


def test_a_folder_that_exists_is_left_alone(source: Path, tmp_path: Path):
    (tmp_path / "copy").mkdir()
    (tmp_path / "copy" / "mine").write_text("precious")

    with pytest.raises(FileExistsError, match="copy exists"):
        write_annotated(source, tmp_path / "copy", COLUMNS, added())
    assert [path.name for path in (tmp_path / "copy").iterdir()] == ["mine"]


@pytest.mark.parametrize(
    ("columns", "message"),
    [
        ({}, "expected at least one column"),
        ({"novelty": ("n",), "reward": ("r",)}, "the dataset does not have, got reward"),
        ({"timestamp": ("t",)}, "got 'timestamp'"),
        ({"a/b": ("x",)}, "without '/'"),
        ({"novelty": ("x", "x")}, "distinct dimension names"),
    ],
)
def test_columns_that_cannot_be_added_are_refused(
    source: Path, columns: Mapping[str, Any], message: str
):
    refused(source, message, columns)


def spoilt(**changes: object) -> list[dict[str, Any]]:
    """The extra columns, with the last episode's changed."""
    return [*added()[:2], added()[2] | changes]


NOT_A_NUMBER = np.array([[0.0], [np.nan], [0.0]])
BAD_EPISODES = {
    "too few": (added()[:2], "each of 3 episodes, got 2"),
    "too many": ([*added(), added()[0]], "each of 3 episodes, got 4"),
    "longer": ([*added()[:2], added()[0]], "episode 5: expected 3 frames in columns, got 4"),
    "unequal": (spoilt(novelty=np.zeros((2, 1))), "episode 5: .*as many frames .*'novelty': 2"),
    "not finite": (spoilt(novelty=NOT_A_NUMBER), "episode 5: .*'novelty'.*finite.*row 1"),
    "too large": (spoilt(novelty=np.full((3, 1), 1e39)), "'novelty'.*finite.*row 0"),
    "flat": (spoilt(novelty=np.zeros(3)), r"'novelty'.*got shape \[3\]"),
    "dimension": (spoilt(novelty=np.zeros((3, 2))), r"'novelty'.*got shape \[3, 2\]"),
    "words": (spoilt(novelty=[["high"]] * 3), "'novelty'.*got dtype <U4"),
    "another dtype": (spoilt(winner=np.zeros((3, 1))), "'winner' as integers.*got dtype float64"),
    "empty": (spoilt(winner=np.zeros((0, 1), int)), r"'winner'.*got shape \[0, 1\]"),
    "unknown": (spoilt(torque=np.zeros((3, 1))), "expected the features .*torque"),
    "missing": ([*added()[:2], {"novelty": np.zeros((3, 1))}], r"got \['novelty'\]"),
}


@pytest.mark.parametrize("case", BAD_EPISODES)
def test_bad_columns_are_refused_before_anything_is_written(source: Path, case: str):
    episodes, message = BAD_EPISODES[case]
    refused(source, message, episodes=episodes)


@pytest.mark.parametrize("interrupt", [KeyboardInterrupt, OSError, MemoryError])
def test_a_copy_that_is_interrupted_leaves_nothing(
    interrupt: type[BaseException], source: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    add, saved = DataFiles.add, []

    def interrupted(self: DataFiles, table: pa.Table) -> FileNumber:
        number = add(self, table)
        saved.append(number)
        if len(saved) == 2:
            raise interrupt
        return number

    with monkeypatch.context() as patch:
        patch.setattr(DataFiles, "add", interrupted)
        with pytest.raises(interrupt):
            write_annotated(source, tmp_path / "copies" / "copy", COLUMNS, added())
    assert list((tmp_path / "copies").iterdir()) == []
    write_annotated(source, tmp_path / "copies" / "copy", COLUMNS, added())
    assert [path.name for path in (tmp_path / "copies").iterdir()] == ["copy"]
    assert len(load_demonstrations(tmp_path / "copies" / "copy").episodes) == 3
