"""Claims about appending to datasets as LeRobot and its robots leave them."""

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from pacnet.datasets.demonstrations import load_demonstrations
from pacnet.datasets.format import DatasetError
from pacnet.datasets.format.features import Feature
from pacnet.datasets.recorder import Recorder

DATA = Path(__file__).parent / "data"
FEATURES = {"observation.state": ("x", "y"), "action": ("delta_x", "delta_y", "gripper")}


@pytest.fixture(autouse=True)
def without_waiting_for_the_disk(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("os.fsync", lambda _: None)


def record(root: Path, *numbers: int, **changes: Any) -> None:
    with Recorder(**{"root": root, "fps": 10, "features": FEATURES} | changes) as recorder:
        for number in numbers:
            recorder.save_episode(f"task {number}", rows_of(number))


def rows_of(number: int) -> dict[str, NDArray[np.float32]]:
    rows = np.full((3, 3), number, "f4")
    return {"observation.state": rows[:, :2], "action": rows}


def change_info(root: Path, change: Callable[[dict[str, Any]], object]) -> None:
    info = json.loads((root / "meta/info.json").read_text())
    change(info)
    (root / "meta/info.json").write_text(json.dumps(info))


def assert_holds(root: Path, count: int) -> None:
    for number, one in zip(range(count), load_demonstrations(root), strict=True):
        assert one.task == f"task {number}"
        np.testing.assert_array_equal(one.action, rows_of(number)["action"])


@pytest.mark.parametrize("entry", ["chunks_size", "data_files_size_in_mb", "data_path"])
def test_missing_file_settings_have_defaults(tmp_path: Path, entry: str):
    record(tmp_path / "new", 0)
    change_info(tmp_path / "new", lambda info: info.pop(entry))
    record(tmp_path / "new", 1)

    assert_holds(tmp_path / "new", 2)
    assert (tmp_path / "new/data/chunk-000/file-001.parquet").exists()


@pytest.mark.parametrize("entry", ["total_frames", "total_episodes"])
def test_a_dataset_that_does_not_count_is_refused(tmp_path: Path, entry: str):
    record(tmp_path / "new", 0)
    change_info(tmp_path / "new", lambda info: info.pop(entry))
    with pytest.raises(
        DatasetError, match=r"expected .*None .* as in meta/info.json, found 1 of 3"
    ):
        record(tmp_path / "new", 1)


def test_names_with_indices(tmp_path: Path):
    """As LeRobot's gamepads and keyboards have them, in whatever order."""
    names = {"gripper": 2, "delta_x": 0, "delta_y": 1}
    record(tmp_path / "new", 0)
    change_info(tmp_path / "new", lambda info: info["features"]["action"].update(names=names))
    assert load_demonstrations(tmp_path / "new").action_names == FEATURES["action"]
    record(tmp_path / "new", 1)
    assert_holds(tmp_path / "new", 2)

    with pytest.raises(ValueError, match=r"'action' as float32 of \['delta_x', 'delta_y', 'gripp"):
        record(tmp_path / "new", 2, features=FEATURES | {"action": tuple(names)})


@pytest.mark.parametrize("dtype", ["float64", "int32", "image"])
def test_a_feature_that_no_recorder_stores(tmp_path: Path, dtype: str):
    """There is no way to append then: it is of no use to ask for the same feature."""
    record(tmp_path / "new", 0)
    change_info(tmp_path / "new", lambda info: info["features"]["action"].update(dtype=dtype))
    message = (
        f"which is what Recorder stores: with 'action' being {dtype}, .*new cannot be appended"
    )
    with pytest.raises(ValueError, match=message):
        record(tmp_path / "new", 1)
    with pytest.raises(ValueError, match=message):
        record(tmp_path / "new", 1, features={"observation.state": ("x", "y")})


@pytest.fixture(params=["lerobot_044", "lerobot_061"])
def empty(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    """A dataset as LeRobot leaves it that has recorded nothing: its description, and no more."""
    (tmp_path / "empty/meta").mkdir(parents=True)
    shutil.copy(DATA / request.param / "meta/info.json", tmp_path / "empty/meta")
    counts = dict.fromkeys(("total_episodes", "total_frames", "total_tasks"), 0)
    change_info(tmp_path / "empty", lambda info: info.update(counts | {"splits": {}}))
    return tmp_path / "empty"


def test_a_dataset_without_episodes_is_begun(empty: Path):
    before = (empty / "meta/info.json").read_bytes()
    features = {"observation.state": ("x", "y"), "action": ("u", "v")}
    with pytest.raises(ValueError, match="expected fps 10"):
        record(empty, fps=20, features=features)
    record(empty, features=features)
    assert [path.read_bytes() for path in empty.rglob("*") if path.is_file()] == [before]
    with pytest.raises(DatasetError, match="empty has no data"):
        load_demonstrations(empty)

    with Recorder(empty, 10, features) as recorder:
        rows = np.arange(6.0).reshape(3, 2)
        recorder.save_episode("task", {"observation.state": rows, "action": -rows})
    (one,) = load_demonstrations(empty)
    np.testing.assert_array_equal(one.action, -rows)
    assert {path.name for path in empty.iterdir()} == {"data", "meta"}


STOCK = {
    "observation.state": {"dtype": "float32", "shape": (2,), "names": {"motors": ["x", "y"]}},
    "action": {"dtype": "float32", "shape": (2,), "names": {"delta_x": 0, "delta_y": 1}},
    "next.success": {"dtype": "bool", "shape": (1,), "names": None},
    "next.reward": {"dtype": "float32", "shape": (1,), "names": ["reward"]},
    "winner": {"dtype": "int64", "shape": (1,), "names": ["winner"]},
    "pair": {"dtype": "int64", "shape": (2,), "names": ["first", "second"]},
}
OURS = {
    "observation.state": ("x", "y"),
    "action": ("delta_x", "delta_y"),
    "next.success": Feature(("success",), "bool"),
    "next.reward": ("reward",),
    "winner": Feature(("winner",), "int64"),
    "pair": Feature(("first", "second"), "int64"),
}


def stock_episode(number: int) -> dict[str, NDArray[np.generic]]:
    rows = np.random.default_rng(number).integers(-9, 9, (5, 9))
    return {
        "observation.state": rows[:, :2].astype("f4"),
        "action": rows[:, 2:4].astype("f4"),
        "next.success": rows[:, 4:5] > 0,
        "next.reward": rows[:, 5:6].astype("f4"),
        "winner": rows[:, 6:7],
        "pair": rows[:, 7:],
    }


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:Conver:Warning")  # LeRobot 0.4 on scalars and booleans
@pytest.mark.parametrize("recorded", [0, 2])
def test_booleans_integers_and_scalars_of_lerobot_are_appended_to(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, recorded: int
):
    from lerobot.datasets.lerobot_dataset import LeRobotDataset

    monkeypatch.setattr("datasets.config.HF_DATASETS_CACHE", tmp_path / "cache")
    options = {"root": tmp_path / "new", "video_backend": "pyav"}
    stock = LeRobotDataset.create("local/new", 10, STOCK, use_videos=False, **options)
    for number in range(recorded):
        for rows in zip(*stock_episode(number).values(), strict=True):
            stock.add_frame(dict(zip(STOCK, rows, strict=True)) | {"task": "task"})
        stock.save_episode()
    stock.finalize()
    with Recorder(tmp_path / "new", 10, OURS) as recorder:
        for number in range(recorded, 4):
            recorder.save_episode("task", stock_episode(number))

    dataset = LeRobotDataset("local/new", **options)
    assert (dataset.num_episodes, len(dataset)) == (4, 20)
    for name in STOCK:
        rows = np.concatenate([stock_episode(number)[name] for number in range(4)])
        got = np.stack([np.atleast_1d(dataset[index][name]) for index in range(20)])
        np.testing.assert_array_equal(got, rows)
        np.testing.assert_allclose(dataset.meta.stats[name]["mean"], rows.mean(axis=0))
        np.testing.assert_allclose(dataset.meta.stats[name]["std"], rows.std(axis=0))
        read = load_demonstrations(tmp_path / "new", state=name, action="action")
        np.testing.assert_array_equal(np.concatenate([one.state for one in read]), rows)
    assert read.action_names == ("delta_x", "delta_y")
