"""Claims about datasets that are opened for appending, and whose old frames are not as they say."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from pacnet.datasets.demonstrations import load_demonstrations
from pacnet.datasets.format import DatasetError
from pacnet.datasets.format.info import json_bytes
from pacnet.datasets.recorder import Recorder, recover

FEATURES = {"observation.state": ("x", "y"), "action": ("push",)}
FRAMES = "data/chunk-000/file-000.parquet"
EPISODES = "meta/episodes/chunk-000/file-000.parquet"


@pytest.fixture(autouse=True)
def without_waiting_for_the_disk(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("os.fsync", lambda _: None)


def save(recorder: Recorder, *numbers: int) -> None:
    for number in numbers:
        rows = np.full((3, 3), number, "f4")
        recorder.save_episode("task", {"observation.state": rows[:, :2], "action": rows[:, 2:]})


def record(root: Path, *numbers: int) -> None:
    with Recorder(root, 10, FEATURES) as recorder:
        save(recorder, *numbers)


@pytest.fixture
def root(tmp_path: Path) -> Path:
    """A dataset of two files of frames: episodes 0 and 1 are in the first, 2 in the second."""
    record(tmp_path / "new", 0, 1)
    record(tmp_path / "new", 2)
    return tmp_path / "new"


def replace(path: Path, name: str, values: list[Any], kind: pa.DataType | None = None) -> None:
    """Replace the first values of a column in a Parquet file."""
    table = pq.read_table(path)
    place = table.column_names.index(name)
    column = pa.array(values + table[name].to_pylist()[len(values) :], kind or table[name].type)
    pq.write_table(table.set_column(place, name, column), path)


def drop(path: Path, name: str) -> None:
    pq.write_table(pq.read_table(path).drop_columns([name]), path)


def contents(root: Path) -> dict[Path, bytes]:
    return {path: path.read_bytes() for path in root.rglob("*") if path.is_file()}


def assert_refused(root: Path, message: str) -> None:
    """When the `with` block is entered, and nothing is changed."""
    before = contents(root)
    with pytest.raises(DatasetError, match=message):
        Recorder(root, 10, FEATURES).__enter__()
    assert contents(root) == before


@pytest.mark.parametrize(
    ("feature", "value"),
    [("action", None), ("observation.state", [1.0, None]), ("task_index", None)],
)
def test_gaps(root: Path, feature: str, value: object):
    lists = pa.list_(pa.float32()) if isinstance(value, list) else None
    replace(root / FRAMES, feature, [value], lists)

    assert_refused(root, f"000/file-000.parquet: expected numbers in '{feature}', found 1 gaps")


def test_a_vector_of_another_length(root: Path):
    replace(root / FRAMES, "observation.state", [[1.0, 2.0, 3.0]], pa.list_(pa.float32()))

    assert_refused(root, r"'observation.state', found 13 in 6 frames in place of 2 in each")


def test_words(root: Path):
    replace(root / FRAMES, "action", ["left"] * 6, pa.string())

    assert_refused(root, "file-000.parquet: expected numbers in 'action', found values of type str")


def test_scalars_in_place_of_vectors(root: Path):
    replace(root / FRAMES, "observation.state", [1.0] * 6, pa.float32())

    assert_refused(root, "in 'observation.state', found float in place of lists of 2")


@pytest.mark.parametrize("feature", ["action", "timestamp"])
def test_a_feature_that_a_file_lacks(root: Path, feature: str):
    drop(root / FRAMES, feature)

    assert_refused(root, rf"file-000.parquet: expected the columns \['{feature}'\], found \['obs")


def test_a_file_of_frames_without_episodes(root: Path):
    (root / "data/chunk-000/file-001.parquet").rename(root / "data/chunk-000/file-007.parquet")
    (root / "data/chunk-001").mkdir()
    for place in ("chunk-000/file-001", "chunk-001/file-000"):
        (root / f"data/{place}.parquet").write_bytes(
            (root / "data/chunk-000/file-007.parquet").read_bytes()
        )

    assert_refused(root, "data/chunk-000/file-007.parquet holds frames of no episode: move it away")
    (root / "data/chunk-000/file-007.parquet").unlink()
    assert_refused(root, "data/chunk-001/file-000.parquet holds frames of no episode: move it away")


def test_a_file_without_episodes_that_is_written_over_may_stay(root: Path):
    (root / "data/chunk-000/file-002.parquet").write_bytes((root / FRAMES).read_bytes())
    record(root, 3)

    read = load_demonstrations(root)
    assert [one.action[0].item() for one in read] == [0, 1, 2, 3]


def test_what_a_journal_writes_over_may_be_several_files(root: Path):
    """As a killed process leaves them during the moves, before another process appends."""
    path = root / "meta/info.json"
    info = json.loads(path.read_text())
    path.write_text(json.dumps(info | {"data_files_size_in_mb": 1e-6}))  # a file for each episode
    old = (root / FRAMES).read_bytes()
    files = [root / f"data/chunk-000/file-00{number}.parquet" for number in (2, 3, 4)]
    recorder = Recorder(root, 10, FEATURES).__enter__()
    save(recorder, 3, 4)
    for file in files:
        file.write_bytes(old)
    with pytest.raises(DatasetError, match=r"file-004.parquet holds frames of no episode"):
        recorder.__exit__()
    files[-1].unlink()

    assert recover(root) == 2
    assert [one.action[0].item() for one in load_demonstrations(root)] == [0, 1, 2, 3, 4]


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("feature", ["action", "observation.state"])
def test_numbers_that_are_not_finite(root: Path, feature: str, value: float):
    """As LeRobot's own recorder accepts them: they are in its statistics of the episode as well."""
    dimension = len(FEATURES[feature])
    frame = value if dimension == 1 else [0.0, value]
    replace(root / FRAMES, feature, [0.0 if dimension == 1 else [0.0, 0.0]] * 4 + [frame])
    for name in ("min", "max"):
        extremes = [[0.0] * dimension, [0.0] * (dimension - 1) + [value]]
        if (name == "min") != (value > 0):
            replace(root / EPISODES, f"stats/{feature}/{name}", extremes)

    assert_refused(
        root, f"episodes/.*file-000.parquet: .* in '{feature}', found others in episode 1$"
    )


def test_numbers_that_are_not_finite_and_missing_in_the_statistics(root: Path):
    """No `NaN` comes into JSON, and the new episode stays in the journal."""
    replace(root / FRAMES, "action", [np.nan])
    before = contents(root)
    with pytest.raises(DatasetError, match="expected finite numbers in 'action', found others in"):
        record(root, 3)

    after = contents(root)
    assert before.items() <= after.items()
    assert root / "journal/episode-000000.arrow" in after
    with pytest.raises(ValueError, match="not JSON compliant"):
        json_bytes({"mean": [np.nan]})


def test_missing_statistics_of_episodes_are_accepted(root: Path):
    """Neither a statistic that the dataset has not, nor one that an episode has not."""
    drop(root / EPISODES, "stats/action/min")
    replace(root / EPISODES, "stats/action/max", [None])
    record(root, 3)

    assert len(load_demonstrations(root)) == 4
