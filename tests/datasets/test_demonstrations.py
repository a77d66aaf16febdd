"""Claims about reading demonstrations, on datasets laid out by hand after the format."""

import json
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import torch
from handmade import LENGTHS, TASKS, columns, write, write_info, write_rows, write_tasks

from pacnet.datasets.demonstrations import dimension_names, load_demonstrations
from pacnet.datasets.format import DatasetError, DatasetWarning


@pytest.fixture
def root(tmp_path: Path) -> Path:
    """A sound dataset in one data file."""
    return write(tmp_path)


def test_every_episode_comes_back_as_it_was(root: Path):
    demonstrations = load_demonstrations(root)

    assert demonstrations.fps == 50
    assert demonstrations.names["observation.environment_state"] == (
        "observation.environment_state_0",
        "observation.environment_state_1",
    )
    assert len(demonstrations) == 3
    start = 0
    for demonstration, number, length, task in zip(
        demonstrations, range(3), LENGTHS, TASKS, strict=True
    ):
        rows = slice(start, start + length)
        start += length
        assert (demonstration.episode, demonstration.task) == (number, task)
        for feature, tensor in (
            ("observation.state", demonstration.state),
            ("observation.environment_state", demonstration.environment_state),
            ("action", demonstration.action),
        ):
            assert tensor.dtype == torch.float32
            np.testing.assert_array_equal(tensor.numpy(), columns()[feature][rows])


def test_percepts_are_the_state_then_the_environment(root: Path):
    demonstration = load_demonstrations(root).episodes[0]

    assert demonstration.percepts.shape == (4, 5)
    assert torch.equal(demonstration.percepts[:, :3], demonstration.state)
    assert torch.equal(demonstration.percepts[:, 3:], demonstration.environment_state)


def test_without_environment_state_the_percepts_are_the_state(root: Path):
    demonstration = load_demonstrations(root, environment_state=None).episodes[2]

    assert demonstration.environment_state.shape == (3, 0)
    assert torch.equal(demonstration.percepts, demonstration.state)


def test_features_are_chosen_by_name(root: Path):
    demonstration = load_demonstrations(
        root, state="observation.environment_state", environment_state=None, action="action"
    ).episodes[0]

    np.testing.assert_array_equal(
        demonstration.state.numpy(), columns()["observation.environment_state"][:4]
    )


def test_frames_are_ordered_by_index_whatever_the_order_of_files_and_rows(root: Path):
    expected = load_demonstrations(root)
    (root / "data/chunk-000/file-000.parquet").unlink()
    write_rows(root, columns(), [7, 5, 6], "chunk-000/file-000.parquet")
    write_rows(root, columns(), [1, 0], "chunk-000/file-001.parquet")
    write_rows(root, columns(), [4, 2, 3], "chunk-001/file-000.parquet")

    for one, other in zip(expected, load_demonstrations(root), strict=True):
        assert (one.episode, one.task) == (other.episode, other.task)
        assert torch.equal(one.percepts, other.percepts)
        assert torch.equal(one.action, other.action)


def test_doubles_in_lists_of_any_length_are_read_as_floats(root: Path):
    frames = columns()
    table = pq.read_table(root / "data/chunk-000/file-000.parquet")
    doubles = pa.array(frames["observation.state"].astype("f8").tolist())
    assert doubles.type == pa.list_(pa.float64())
    place = table.column_names.index("observation.state")
    pq.write_table(
        table.set_column(place, "observation.state", doubles),
        root / "data/chunk-000/file-000.parquet",
    )

    state = load_demonstrations(root).episodes[0].state

    assert state.dtype == torch.float32
    np.testing.assert_array_equal(state.numpy(), frames["observation.state"][:4])


@pytest.mark.parametrize("words", ["task", "__index_level_0__"])
def test_tasks_are_found_whatever_their_column_is_called(root: Path, words: str):
    write_tasks(root, words)

    assert tuple(demonstration.task for demonstration in load_demonstrations(root)) == TASKS


@pytest.mark.parametrize(
    ("names", "expected"),
    [
        (None, ("0", "1", "2")),
        ({"motors": ["a", "b", "c"]}, ("a", "b", "c")),
        (["too", "few"], ("0", "1", "2")),
    ],
)
def test_dimensions_have_names_even_where_the_dataset_has_none(
    root: Path, names: object, expected: tuple[str, ...]
):
    features = json.loads((root / "meta/info.json").read_text())["features"]
    features["observation.state"]["names"] = names
    write_info(root, features=features)

    assert load_demonstrations(root).names["observation.state"] == expected


def test_no_folder(tmp_path: Path):
    with pytest.raises(DatasetError, match=r"found no folder .*nowhere"):
        load_demonstrations(tmp_path / "nowhere")


def test_a_folder_that_is_no_dataset(tmp_path: Path):
    with pytest.raises(DatasetError, match=r"has no meta/info\.json"):
        load_demonstrations(tmp_path)


@pytest.mark.parametrize("version", ["v1.6", "v3.1", "v4.0", None])
def test_another_format_version_is_named(root: Path, version: str | None):
    write_info(root, codebase_version=version)

    with pytest.raises(
        DatasetError, match=rf"expected codebase_version v2\.0, v2\.1, v3\.0, found {version}"
    ):
        load_demonstrations(root)


def test_a_missing_feature_is_named_with_those_there(root: Path):
    vectors = r"'observation.state' \[3\], 'observation.environment_state' \[2\], 'action' \[1\]"
    with pytest.raises(DatasetError, match=rf"'torque'.* {vectors}: choose with --action NAME"):
        load_demonstrations(root, action="torque")


@pytest.mark.parametrize(
    "description",
    [{"dtype": "video", "shape": [3]}, {"dtype": "float32", "shape": [2, 2]}, {}],
)
def test_only_vectors_of_numbers_are_read(root: Path, description: dict[str, object]):
    features = json.loads((root / "meta/info.json").read_text())["features"]
    write_info(root, features=features | {"action": description})

    with pytest.raises(DatasetError, match="expected 'action' to be a vector of numbers"):
        load_demonstrations(root)


def test_an_incomplete_description(root: Path):
    write_info(root, features=None)

    with pytest.raises(DatasetError, match="features, found None"):
        load_demonstrations(root)


@pytest.mark.parametrize(
    "file", ["meta/info.json", "meta/tasks.parquet", "data/chunk-000/file-000.parquet"]
)
@pytest.mark.parametrize("kept", [0.0, 0.5, 0.98])
def test_a_truncated_file_is_named(root: Path, file: str, kept: float):
    content = (root / file).read_bytes()
    (root / file).write_bytes(content[: int(kept * len(content))])

    with pytest.raises(DatasetError, match=f"{file} cannot be read"):
        load_demonstrations(root)


def test_no_data_files(root: Path):
    (root / "data/chunk-000/file-000.parquet").unlink()

    with pytest.raises(DatasetError, match="found none"):
        load_demonstrations(root)


def test_no_tasks(root: Path):
    (root / "meta/tasks.parquet").unlink()

    with pytest.raises(DatasetError, match=r"tasks\.parquet cannot be read"):
        load_demonstrations(root)


def test_a_task_without_words(root: Path):
    pq.write_table(pa.table({"task_index": [0], "task": ["a"]}), root / "meta/tasks.parquet")

    with pytest.raises(DatasetError, match=r"expected the tasks \[1\], found \[0\]"):
        load_demonstrations(root)


@pytest.mark.parametrize("entry", ["total_frames", "total_episodes"])
def test_counts_may_be_missing(root: Path, entry: str):
    write_info(root, **{entry: None})

    assert len(load_demonstrations(root)) == 3


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"total_frames": 9}, "counts 9 frames where the data files hold 8"),
        ({"total_episodes": 2}, "counts 2 episodes where the data files hold 3"),
        ({"total_frames": "\ud800"}, r"counts '\\ud800' frames"),
        ({"total_frames": 10**400}, r"counts 1000\d*\.\.\.\d* frames"),
    ],
)
def test_the_data_count_where_the_description_contradicts_them(
    root: Path, changes: dict[str, object], message: str
):
    expected = load_demonstrations(root)
    write_info(root, **changes)

    with pytest.warns(DatasetWarning, match=message):
        demonstrations = load_demonstrations(root)

    for one, other in zip(expected, demonstrations, strict=True):
        assert torch.equal(one.percepts, other.percepts)


def test_a_frame_twice_and_another_lost(root: Path):
    write_rows(root, columns(), [0, 1, 2, 2, 4, 5, 6, 7], "chunk-000/file-000.parquet")

    with pytest.raises(DatasetError, match="each frame once, found index 2 of episode 0 twice"):
        load_demonstrations(root)


def test_an_episode_in_pieces(root: Path):
    frames = columns()
    frames["episode_index"] = np.array([0, 0, 1, 1, 0, 0, 2, 2])
    write_rows(root, frames, list(range(8)), "chunk-000/file-000.parquet")

    with pytest.raises(DatasetError, match="found 3 episodes in 4 runs of frames"):
        load_demonstrations(root)


def test_a_column_that_the_description_promises(root: Path):
    frames = columns()
    del frames["action"]
    write_rows(root, frames, list(range(8)), "chunk-000/file-000.parquet")

    with pytest.raises(
        DatasetError, match=r"expected the feature 'action', .* has the vectors 'observation"
    ):
        load_demonstrations(root)


def test_vectors_of_another_length_than_described(root: Path):
    frames = columns()
    frames["observation.state"] = np.arange(32, dtype="f4").reshape(8, 4)
    write_rows(root, frames, list(range(8)), "chunk-000/file-000.parquet")

    with pytest.warns(DatasetWarning, match=r"'observation.state' the shape \[3\], .* have 4 dim"):
        demonstrations = load_demonstrations(root)

    assert demonstrations.names["observation.state"] == ("0", "1", "2", "3")
    assert demonstrations.episodes[1].state.tolist() == [[16, 17, 18, 19]]


def test_vectors_of_different_lengths(root: Path):
    file = root / "data/chunk-000/file-000.parquet"
    table = pq.read_table(file)
    place = table.column_names.index("action")
    ragged = pa.array([[0.0, 1.0]] * 7 + [[0.0]])
    pq.write_table(table.set_column(place, "action", ragged), file)

    with pytest.raises(DatasetError, match=r"in 'action', found 1 in a frame in place of 2"):
        load_demonstrations(root)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ([0.0] * 7 + [None], "episode 2, frame 2, dimension 'action_0'.*--exclude 2"),
        ([[0.0]] * 7 + [None], "episode 2, frame 2, dimension 'action_0'.*--exclude 2"),
        ([[0.0]] * 7 + [[None]], "episode 2, frame 2, dimension 'action_0'.*--exclude 2"),
        ([0] * 7 + [None], "expected numbers in 'action', found 1 gaps"),
        (["word"] * 8, "expected numbers in 'action', found values of type string"),
    ],
)
def test_empty_values_and_words_in_place_of_numbers(root: Path, values: list[object], message: str):
    file = root / "data/chunk-000/file-000.parquet"
    table = pq.read_table(file)
    place = table.column_names.index("action")
    pq.write_table(table.set_column(place, "action", pa.array(values)), file)

    with pytest.raises(DatasetError, match=message):
        load_demonstrations(root)
    if "--exclude" in message:
        assert len(load_demonstrations(root, exclude=[2])) == 2


@pytest.mark.parametrize("value", [np.nan, np.inf, 1e39])
def test_numbers_that_are_not_finite_in_float32(root: Path, value: float):
    frames = columns()
    frames["observation.state"] = frames["observation.state"].astype("f8")
    frames["observation.state"][5, 1] = value
    write_rows(root, frames, list(range(8)), "chunk-000/file-000.parquet")

    with pytest.raises(
        DatasetError, match=r"episode 2, frame 0, .*'observation.state_1': .*--exclude 2"
    ):
        load_demonstrations(root)


def test_reading_does_without_lerobot(root: Path):
    code = (
        "import sys; from pacnet.datasets.demonstrations import load_demonstrations;"
        f"load_demonstrations({str(root)!r});"
        "sys.exit(bool({'lerobot', 'datasets', 'pandas'} & set(sys.modules)))"
    )

    subprocess.run([sys.executable, "-c", code], check=True)


def test_the_task_of_the_first_frame_counts(root):
    frames = columns()
    frames["task_index"] = np.array([0, 0, 0, 1, 1, 0, 1, 1])
    write_rows(root, frames, list(range(8)), "chunk-000/file-000.parquet")
    assert [one.task for one in load_demonstrations(root)] == ["drink", "wave", "drink"]


@pytest.mark.parametrize("dtype", ["int64", "int8", "uint8", "uint64"])
def test_integers_are_read_as_floats(root, dtype):
    frames = columns()
    frames["action"] = np.arange(8, dtype=dtype)[:, None]
    write_rows(root, frames, list(range(8)), "chunk-000/file-000.parquet")
    features = json.loads((root / "meta/info.json").read_text())["features"]
    write_info(root, features=features | {"action": {"dtype": dtype, "shape": [1]}})
    action = load_demonstrations(root).episodes[0].action
    assert action.dtype == torch.float32
    assert action.flatten().tolist() == [0, 1, 2, 3]


def without_time(root: Path) -> None:
    frames = columns()
    del frames["timestamp"]
    write_rows(root, frames, list(range(8)), "chunk-000/file-000.parquet")


def test_a_fraction_of_a_frame_per_second_stays(root):
    without_time(root)
    write_info(root, fps=29.97)
    assert load_demonstrations(root).fps == 29.97


@pytest.mark.parametrize("fps", [0, -1, None, np.nan, np.inf, True, "8"])
def test_fps_that_is_no_rate_is_taken_from_the_time(root, fps):
    write_info(root, fps=fps)
    with pytest.warns(DatasetWarning, match=rf"no valid fps \({fps!r}\): the timestamps say 50"):
        assert load_demonstrations(root).fps == 50

    without_time(root)
    with pytest.raises(DatasetError, match=f"fps above 0 and finite, found {fps!r}"):
        load_demonstrations(root)


def test_vectors_of_length_one_may_be_lists(root):
    frames = columns()
    table = pq.read_table(root / "data/chunk-000/file-000.parquet")
    lists = pa.array(frames["action"].tolist())  # [[x], [x], …]
    table = table.set_column(table.column_names.index("action"), "action", lists)
    pq.write_table(table, root / "data/chunk-000/file-000.parquet")
    np.testing.assert_array_equal(
        load_demonstrations(root).episodes[0].action, frames["action"][:4]
    )


WANTED = r"expected 'action' to be a vector of numbers of shape \[D > 0\], found "
NONSENSE = {  # (what info.json says of the action, columns in place of the sound ones, message)
    "no description": (None, {}, WANTED + "the description None"),
    "a list": ([1], {}, WANTED + r"the description \[1\]"),
    "length in words": ({"dtype": "float32", "shape": ["2"]}, {}, WANTED + r".*shape \['2'\]"),
    "length true": ({"dtype": "float32", "shape": [True]}, {}, WANTED + r".*shape \[True\]"),
    "length 2.0": ({"dtype": "float32", "shape": [2.0]}, {}, WANTED + r".*shape \[2\.0\]"),
    "length 0": ({"dtype": "float32", "shape": [0]}, {}, WANTED + r".*shape \[0\]"),
    "length -1": ({"dtype": "float32", "shape": [-1]}, {}, WANTED + r".*shape \[-1\]"),
    "words": (
        {"dtype": "float32", "shape": [2]},
        {"action": ["word"] * 8},
        "expected numbers in 'action', found values of type string",
    ),
    "lists of lists": (
        {"dtype": "float32", "shape": [1]},
        {"action": [[[0.5]]] * 8},
        r"expected numbers in 'action', found values of type list",
    ),
    "records": (
        {"dtype": "float32", "shape": [1]},
        {"action": [{"x": 0.5}] * 8},
        "expected numbers in 'action', found struct<x: double> in place of lists",
    ),
}


@pytest.mark.parametrize("case", NONSENSE)
def test_nonsense_is_a_dataset_error(root: Path, case: str):
    description, changed, message = NONSENSE[case]
    features = json.loads((root / "meta/info.json").read_text())["features"]
    write_info(root, features=features | {"action": description})
    file = root / "data/chunk-000/file-000.parquet"
    table = pq.read_table(file)
    for name, values in changed.items():
        table = table.set_column(table.column_names.index(name), name, pa.array(values))
    pq.write_table(table, file)

    with pytest.raises(DatasetError, match=message):
        load_demonstrations(root)


@pytest.mark.parametrize(
    ("numbers", "words"), [([[0], [1]], ["a", "b"]), ([None, 1], ["a", "b"]), ([0, 1], [5, 6])]
)
def test_tasks_that_are_not_words(root: Path, numbers: list[object], words: list[object]):
    table = pa.table({"task_index": pa.array(numbers), "task": pa.array(words)})
    pq.write_table(table, root / "meta/tasks.parquet")

    message = f"expected tasks as index, text, found {numbers[0]!r}, {words[0]!r}"
    with pytest.raises(DatasetError, match=re.escape(message)):
        load_demonstrations(root)


def test_equal_names_of_two_features_are_prefixed():
    assert dimension_names({"observation.state": ("x", "y"), "action": ("z",)}) == ("x", "y", "z")
    names = dimension_names({"observation.state": ("x", "y"), "observation.eye": ("x",)})
    assert names == ("observation.state.x", "observation.state.y", "observation.eye.x")


def test_a_dataset_need_not_have_an_environment_state(root: Path):
    info = json.loads((root / "meta" / "info.json").read_text())
    del info["features"]["observation.environment_state"]
    (root / "meta" / "info.json").write_text(json.dumps(info))
    demonstrations = load_demonstrations(root)
    assert demonstrations.percept_features.keys() == {"observation.state"}
    assert demonstrations.action_names == ("action_0",)
    with pytest.raises(DatasetError, match=r"expected the feature 'observation\.eye'"):
        load_demonstrations(root, environment_state="observation.eye")


def test_demonstrations_know_the_name_of_their_dataset(root: Path):
    assert load_demonstrations(root).source == root.name
