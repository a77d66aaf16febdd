"""Claims about recording demonstrations; what has LeRobot read them is slow, as it imports it."""

import json
import shutil
import signal
import subprocess
import sys
import textwrap
from collections.abc import Iterator, Mapping
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest
import torch
from checkers import assert_clean
from numpy.typing import NDArray

from pacnet.core.durable import write_atomically
from pacnet.datasets.demonstrations import load_demonstrations
from pacnet.datasets.format import DatasetError
from pacnet.datasets.format.features import Feature
from pacnet.datasets.format.parquet import read_table
from pacnet.datasets.journal.folding import fold
from pacnet.datasets.journal.journal import Journal, check_folded
from pacnet.datasets.recorder import Recorder, recover

FEATURES = {
    "observation.state": ("x", "y", "z"),
    "observation.environment_state": ("u", "v"),
    "action": ("push",),
}
PROJECT = Path(__file__).parents[2]
DATA = Path(__file__).parent / "data"


def episode(seed: int, length: int = 5) -> dict[str, NDArray[np.float32]]:
    rng = np.random.default_rng(seed)
    return {
        name: rng.normal(size=(length, len(names))).astype(np.float32)
        for name, names in FEATURES.items()
    }


def record(
    root: Path,
    *episodes: Mapping[str, NDArray[np.float32]],
    error: type[BaseException] | None = None,
) -> None:
    """Record episodes, then leave the `with` block, by an error if one is given."""
    with Recorder(root, fps=10, features=FEATURES, robot_type="hand") as recorder:
        for number, frames in enumerate(episodes):
            recorder.save_episode(f"task {number % 2}", frames)
        if error:
            raise error


def assert_holds(root: Path, *episodes: Mapping[str, NDArray[np.float32]]) -> None:
    for demonstration, frames in zip(load_demonstrations(root), episodes, strict=True):
        np.testing.assert_array_equal(demonstration.state, frames["observation.state"])
        np.testing.assert_array_equal(
            demonstration.environment_state, frames["observation.environment_state"]
        )
        np.testing.assert_array_equal(demonstration.action, frames["action"])


def files_of(root: Path) -> dict[Path, bytes]:
    return {path: path.read_bytes() for path in root.rglob("*") if path.is_file()}


@pytest.fixture(autouse=True)
def without_waiting_for_the_disk(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("os.fsync", lambda _: None)


@pytest.fixture
def interruptible() -> Iterator[None]:
    """SIGINT raises KeyboardInterrupt, which a background job would hand down ignored."""
    previous = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, previous)


@pytest.mark.parametrize("fps", [0, -1, 2.5, True, "10"])
def test_fps_is_a_positive_integer(tmp_path: Path, fps: int):
    with pytest.raises(ValueError, match="expected fps as an integer above 0, got"):
        Recorder(tmp_path / "new", fps=fps, features=FEATURES)


def test_fps_may_be_an_integer_of_numpy(tmp_path: Path):
    with Recorder(tmp_path / "new", fps=np.int64(10), features=FEATURES) as recorder:
        recorder.save_episode("task", episode(0))

    assert load_demonstrations(tmp_path / "new").fps == 10


@pytest.mark.parametrize(
    ("features", "message"),
    [
        ({}, "at least one feature in a mapping, got {}"),
        ([("action", ("x",))], "at least one feature in a mapping, got \\["),
        ({"": ("x",)}, "not empty, and other than .*, got ''"),
        ({"..": ("x",)}, "other than '.', '..', .*, got '..'"),
        ({"a/b": ("x",)}, "without '/'.*got 'a/b'"),
        ({"timestamp": ("x",)}, "got 'timestamp'"),
        ({"action": ()}, "'action' to have distinct dimension names"),
        ({"action": ("x", "x")}, "'action' to have distinct dimension names"),
        ({"action": "xy"}, "'action' to have distinct dimension names"),
        ({"action": {"x", "y"}}, "'action' to have .* names as text, in a list or tuple, got {"),
        ({"action": 2}, "'action' to have .* names as text, in a list or tuple, got 2$"),
        ({"action": None}, "'action' to have .* names as text, in a list or tuple, got None$"),
        ({"action": Feature({"x": 0})}, "got {'x': 0}: give its names alone, or a Feature"),  # pyright: ignore
        (
            {"action": {"dtype": "float32", "shape": (2,), "names": ["x", "y"]}},
            "'action' to have .*, got {'dtype': .*}: give its names alone, or a Feature",
        ),
        ({"action": Feature(("x",), "float16")}, "'action' of dtype float32, int64, bool, got 'fl"),
    ],
)
def test_features_that_cannot_be_stored(
    tmp_path: Path, features: dict[str, tuple[str, ...] | Feature], message: str
):
    with pytest.raises(ValueError, match=message):
        Recorder(tmp_path / "new", fps=10, features=features)


def test_saving_outside_the_with_block(tmp_path: Path):
    recorder = Recorder(tmp_path / "new", fps=10, features=FEATURES)

    with pytest.raises(RuntimeError, match="inside the recorder's `with` block"):
        recorder.save_episode("task", episode(0))
    assert not (tmp_path / "new").exists()


def test_what_is_written_is_read(tmp_path: Path):
    episodes = episode(0), episode(1, length=1), episode(2, length=30)
    record(tmp_path / "new", *episodes)

    assert_holds(tmp_path / "new", *episodes)
    demonstrations = load_demonstrations(tmp_path / "new")
    assert [one.task for one in demonstrations] == ["task 0", "task 1", "task 0"]
    assert demonstrations.fps == 10
    assert demonstrations.names == FEATURES


def test_doubles_are_stored_as_floats(tmp_path: Path):
    doubles = {name: values.astype(np.float64) / 3 for name, values in episode(0).items()}
    record(tmp_path / "new", doubles)

    floats = {name: values.astype(np.float32) for name, values in doubles.items()}
    assert_holds(tmp_path / "new", floats)


@pytest.mark.slow
def test_lerobot_reads_what_was_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    from lerobot.datasets.lerobot_dataset import LeRobotDataset

    monkeypatch.setattr("datasets.config.HF_DATASETS_CACHE", tmp_path / "cache")
    episodes = episode(0), episode(1)
    record(tmp_path / "new", *episodes)

    dataset = LeRobotDataset("local/new", root=tmp_path / "new", video_backend="pyav")
    assert (dataset.num_episodes, dataset.fps, dataset.meta.robot_type) == (2, 10, "hand")
    assert len(dataset) == 10
    for row in range(10):
        frame, number, time = dataset[row], row // 5, row % 5
        assert frame["task"] == f"task {number}"
        assert frame["timestamp"] == pytest.approx(time / 10)
        assert (frame["episode_index"], frame["frame_index"]) == (number, time)
        for name, values in episodes[number].items():
            np.testing.assert_array_equal(frame[name].reshape(-1), values[time])


@pytest.mark.slow
def test_what_lerobot_wrote_frame_by_frame_is_read(tmp_path: Path):
    from lerobot.datasets.lerobot_dataset import LeRobotDataset

    # Without `action`, whose single dimension LeRobot 0.4 cannot write frame by frame quietly.
    names = ("observation.state", "observation.environment_state")
    dataset = LeRobotDataset.create(
        "local/new",
        fps=10,
        features={
            name: {"dtype": "float32", "shape": (len(FEATURES[name]),), "names": None}
            for name in names
        },
        root=tmp_path / "new",
        use_videos=False,
        video_backend="pyav",
    )
    episodes = episode(0), episode(1, length=2)
    for frames in episodes:
        for time in range(len(frames["action"])):
            dataset.add_frame({name: frames[name][time] for name in names} | {"task": "poke"})
        dataset.save_episode()
    dataset.finalize()

    read = load_demonstrations(
        tmp_path / "new",
        environment_state=None,
        action="observation.environment_state",
    )
    for demonstration, frames in zip(read, episodes, strict=True):
        assert demonstration.task == "poke"
        np.testing.assert_array_equal(demonstration.state, frames[names[0]])
        np.testing.assert_array_equal(demonstration.action, frames[names[1]])


def test_the_same_episodes_give_the_same_bytes(tmp_path: Path):
    contents = []
    for name in ("one", "other"):
        record(tmp_path / name, episode(0), episode(1))
        record(tmp_path / name, episode(2))
        files = files_of(tmp_path / name).items()
        contents.append({path.relative_to(tmp_path / name): content for path, content in files})

    assert contents[0] == contents[1]
    assert len(contents[0]) == 7


def test_recording_is_silent(tmp_path: Path, capfd: pytest.CaptureFixture[str]):
    record(tmp_path / "new", episode(0))

    assert capfd.readouterr() == ("", "")


def test_a_folder_of_something_else_is_left_alone(tmp_path: Path):
    (tmp_path / "mine").write_text("precious")

    with pytest.raises(FileExistsError, match="expected a dataset or a folder to be made"):
        record(tmp_path, episode(0))
    with pytest.raises(FileExistsError, match="mine exists"):
        record(tmp_path / "mine", episode(0))
    assert [path.name for path in tmp_path.iterdir()] == ["mine"]


def test_nothing_but_the_dataset_is_left(tmp_path: Path):
    record(tmp_path / "new", episode(0))

    files = [path for path in (tmp_path / "new").rglob("*") if path.is_file()]
    assert sorted(str(path.relative_to(tmp_path / "new")) for path in files) == [
        "data/chunk-000/file-000.parquet",
        "meta/episodes/chunk-000/file-000.parquet",
        "meta/info.json",
        "meta/stats.json",
        "meta/tasks.parquet",
    ]
    assert {path.name for path in (tmp_path / "new").iterdir()} == {"data", "meta"}


@pytest.mark.parametrize("error", [RuntimeError, KeyboardInterrupt])
def test_what_was_saved_before_an_error_is_read(tmp_path: Path, error: type[BaseException]):
    with pytest.raises(error):
        record(tmp_path / "new", episode(0), episode(1), error=error)

    assert_holds(tmp_path / "new", episode(0), episode(1))


@pytest.mark.parametrize("error", [RuntimeError, KeyboardInterrupt])
def test_an_error_before_the_first_episode_leaves_nothing(
    tmp_path: Path, error: type[BaseException]
):
    with pytest.raises(error):
        record(tmp_path / "new", error=error)

    assert not (tmp_path / "new").exists()


def test_without_an_episode_nothing_is_left(tmp_path: Path):
    record(tmp_path / "new")

    assert not (tmp_path / "new").exists()


@pytest.mark.usefixtures("interruptible")
def test_an_interrupt_while_opening_leaves_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    made = []

    def fold_and_interrupt(journal: Journal) -> int:
        made.append(journal.folder.exists())
        signal.raise_signal(signal.SIGINT)
        return fold(journal)

    monkeypatch.setattr("pacnet.datasets.journal.folding.fold", fold_and_interrupt)
    with pytest.raises(KeyboardInterrupt):
        record(tmp_path / "new", episode(0))

    assert made == [True]
    assert not (tmp_path / "new").exists()


@pytest.mark.usefixtures("interruptible")
def test_an_interrupt_while_closing_waits_until_the_files_are_closed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    interrupted = []

    def interrupt_and_fold(journal: Journal) -> int:
        if journal.episodes():
            interrupted.append(True)
            signal.raise_signal(signal.SIGINT)
        return fold(journal)

    monkeypatch.setattr("pacnet.datasets.journal.folding.fold", interrupt_and_fold)
    with pytest.raises(KeyboardInterrupt):
        record(tmp_path / "new", episode(0), episode(1))

    assert interrupted == [True]
    assert_holds(tmp_path / "new", episode(0), episode(1))


@pytest.mark.usefixtures("interruptible")
def test_an_interrupt_while_saving_waits_until_the_episode_is_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    def interrupt_and_put(path: Path, content: bytes) -> None:
        if path.name == "episode-000001.arrow":
            signal.raise_signal(signal.SIGINT)
        write_atomically(path, content)

    monkeypatch.setattr("pacnet.datasets.journal.journal.write_atomically", interrupt_and_put)
    with Recorder(tmp_path / "new", fps=10, features=FEATURES) as recorder:
        recorder.save_episode("task", episode(0))
        with pytest.raises(KeyboardInterrupt):
            recorder.save_episode("task", episode(1))
        recorder.save_episode("task", episode(2))

    assert_holds(tmp_path / "new", episode(0), episode(1), episode(2))


@pytest.mark.slow
def test_a_process_that_is_interrupted_keeps_its_finished_episodes(tmp_path: Path):
    code = f"""
        import itertools, sys
        sys.path[:0] = [{str(PROJECT / "tests")!r}, {str(PROJECT / "tests/datasets")!r}]
        from test_recorder import FEATURES, Recorder, episode
        with Recorder({str(tmp_path / "new")!r}, fps=10, features=FEATURES) as recorder:
            for number in itertools.count():
                recorder.save_episode("task", episode(number, length=200))
                print(number, flush=True)
    """
    with subprocess.Popen(
        [sys.executable, "-c", textwrap.dedent(code)],
        cwd=PROJECT,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    ) as process:
        assert process.stdout is not None
        for _ in range(3):
            process.stdout.readline()
        process.send_signal(signal.SIGINT)
        output, errors = process.communicate(timeout=1800)

    assert "KeyboardInterrupt" in errors
    finished = 3 + len(output.split())
    saved = len(load_demonstrations(tmp_path / "new"))
    assert saved in (finished, finished + 1)  # one may have been saved and not yet announced
    assert_holds(tmp_path / "new", *(episode(number, length=200) for number in range(saved)))


def spoilt(feature: str, values: object) -> dict[str, object]:
    return episode(1) | {feature: values}


def with_value(value: float) -> NDArray[np.float64]:
    state = np.zeros((5, 3))
    state[3, 1] = value
    return state


BAD_EPISODES = {
    "nan": (spoilt("observation.state", with_value(np.nan)), "'observation.state'.*finite.*row 3"),
    "infinite": (spoilt("observation.state", with_value(-np.inf)), "finite.*row 3"),
    "too large": (spoilt("observation.state", with_value(1e39)), "finite.*row 3"),
    "dimension": (spoilt("action", np.zeros((5, 2))), r"shape \[T > 0, 1\], got shape \[5, 2\]"),
    "flat": (spoilt("action", np.zeros(5)), r"'action'.*got shape \[5\]"),
    "empty": (spoilt("action", np.zeros((0, 1))), r"'action'.*got shape \[0, 1\]"),
    "integers": (spoilt("action", np.zeros((5, 1), int)), "'action'.*got dtype int64"),
    "halves": (spoilt("action", np.zeros((5, 1), np.float16)), "'action'.*got dtype float16"),
    "shorter": (spoilt("action", np.zeros((4, 1))), "as many frames .*'action': 4"),
    "unknown": (spoilt("torque", np.zeros((5, 1))), r"expected the features \['action'.*torque"),
    "missing": ({"action": np.zeros((5, 1))}, r"got \['action'\]"),
    "number as a name": (episode(1) | {1: np.zeros((5, 1))}, r"got \['1', 'action'"),  # pyright: ignore
    "no mapping": ([*episode(1).items()], "with their values in a mapping, got list"),
    "gradients": (spoilt("action", torch.zeros(5, 1, requires_grad=True)), "'action'.*grad"),
    "bfloat16": (spoilt("action", torch.zeros(5, 1).bfloat16()), "'action'.*BFloat16"),
    "ragged": (spoilt("action", [[1.0], [1.0, 2.0]]), "'action'.*inhomogeneous"),
    "masked": (spoilt("action", np.ma.zeros((5, 1), "f4")), "'action'.*got a masked array"),
}


@pytest.mark.parametrize("case", [*BAD_EPISODES, "no task"])
def test_a_bad_episode_changes_nothing(tmp_path: Path, case: str):
    frames, message = BAD_EPISODES.get(case, (episode(1), "expected the task in words, got ' '"))
    with Recorder(tmp_path / "new", fps=10, features=FEATURES) as recorder:
        recorder.save_episode("task", episode(0))
        before = files_of(tmp_path / "new")
        with pytest.raises(ValueError, match=message):
            recorder.save_episode(" " if case == "no task" else "task", frames)
        assert before == files_of(tmp_path / "new")
        recorder.save_episode("task", episode(2))

    assert_holds(tmp_path / "new", episode(0), episode(2))


EXTRAS = {
    "observation.state": ("x", "y"),
    "novelty": ("novelty",),
    "winner": Feature(("winner",), "int64"),
    "runners_up": Feature(("second", "third"), "int64"),
    "next.success": Feature(("success",), "bool"),
    "contact": Feature(("left", "right"), "bool"),
}


def annotated(seed: int, length: int) -> dict[str, NDArray[np.generic]]:
    rng = np.random.default_rng(seed)
    return {
        "observation.state": rng.normal(size=(length, 2)),
        "novelty": rng.uniform(size=(length, 1)).astype("f4"),
        "winner": rng.integers(-(2**60), 2**60, (length, 1)),
        "runners_up": rng.integers(0, 99, (length, 2)).astype("u1"),
        "next.success": np.arange(length)[:, None] == length - 1,
        "contact": rng.uniform(size=(length, 2)) < 0.5,
    }


@pytest.mark.slow
def test_lerobot_reads_integers_and_booleans_as_such(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    from lerobot.datasets.lerobot_dataset import LeRobotDataset

    monkeypatch.setattr("datasets.config.HF_DATASETS_CACHE", tmp_path / "cache")
    with Recorder(tmp_path / "new", fps=10, features=EXTRAS) as recorder:
        recorder.save_episode("task", annotated(0, 11))
        recorder.save_episode("task", annotated(1, 3))

    dataset = LeRobotDataset("local/new", root=tmp_path / "new", video_backend="pyav")
    expected = [annotated(0, 11), annotated(1, 3)]
    for name in EXTRAS:
        rows = np.concatenate([frames[name] for frames in expected])
        for row in range(14):
            got = dataset[row][name].numpy()
            if rows.shape[1] == 1:
                assert got.shape == ()
            np.testing.assert_array_equal(got.reshape(-1), rows[row].astype(got.dtype))
    kinds = {name: str(dataset[0][name].dtype).removeprefix("torch.") for name in EXTRAS}
    assert kinds == {
        "observation.state": "float32",
        "novelty": "float32",
        "winner": "int64",
        "runners_up": "int64",
        "next.success": "bool",
        "contact": "bool",
    }


@pytest.mark.parametrize(
    ("feature", "values", "message"),
    [
        ("winner", np.zeros((3, 1)), "'winner' as integers of shape .*got dtype float64"),
        ("winner", np.zeros((3, 1), bool), "'winner' as integers.*got dtype bool"),
        ("winner", np.full((3, 1), 2**63, np.uint64), r"'winner'.*below 2\*\*63, got 92233"),
        ("winner", np.zeros(3, int), r"'winner'.*got shape \[3\]"),
        ("next.success", np.zeros((3, 1), int), "'next.success' as booleans.*got dtype int64"),
        ("novelty", np.zeros((3, 1), int), "'novelty' as float32 or float64.*got dtype int64"),
    ],
)
def test_values_of_another_kind_are_refused(
    tmp_path: Path, feature: str, values: NDArray[np.generic], message: str
):
    with Recorder(tmp_path / "new", fps=10, features=EXTRAS) as recorder:
        with pytest.raises(ValueError, match=message):
            recorder.save_episode("task", annotated(0, 3) | {feature: values})
        recorder.save_episode("task", annotated(0, 3))


def statistic(root: Path, name: str) -> list[float]:
    """A statistic of `observation.state`."""
    stored = json.loads((root / "meta/stats.json").read_text(encoding="utf-8"))
    return stored["observation.state"][name]


def record_states(root: Path, *episodes: NDArray[np.generic]) -> None:
    names = tuple("abcdefgh"[: episodes[0].shape[1]])
    with Recorder(root, fps=10, features={"observation.state": names}) as recorder:
        for rows in episodes:
            recorder.save_episode("task", {"observation.state": rows})


def test_statistics_of_two_recordings_by_hand(tmp_path: Path):
    record_states(tmp_path, np.array([[0.0], [4.0]]), np.array([[8.0]]))
    record_states(tmp_path, np.array([[12.0], [16.0]]))

    # 0, 4, 8, 12, 16: quantile q lies at 16 q; the variance is (64 + 16) * 2 / 5
    expected = {"min": 0, "max": 16, "mean": 8, "std": 32**0.5, "count": 5, "q50": 8}
    expected |= {"q01": 0.16, "q10": 1.6, "q90": 14.4, "q99": 15.84}
    for name, value in expected.items():
        assert statistic(tmp_path, name) == [pytest.approx(value, rel=1e-12)], name


def test_statistics_do_not_cancel(tmp_path: Path):
    rng = np.random.default_rng(0)
    rows = np.stack([1000 + 0.098 * rng.normal(size=4000), np.full(4000, 0.73)], axis=1)
    record_states(tmp_path, rows)

    # the second method: exact fractions of what was stored
    stored = [Fraction(float(value)) for value in rows[:, 0].astype(np.float32)]
    mean = sum(stored) / 4000
    variance = sum((value - mean) ** 2 for value in stored) / 4000
    assert statistic(tmp_path, "mean")[0] == pytest.approx(float(mean), rel=1e-14)
    assert statistic(tmp_path, "std")[0] == pytest.approx(float(variance) ** 0.5, rel=1e-9)
    assert statistic(tmp_path, "std")[1] == 0
    assert statistic(tmp_path, "mean")[1] == np.float32(0.73)


def test_statistics_read_each_file_of_frames_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    record(tmp_path / "new", episode(0))
    record(tmp_path / "new", episode(1))
    read: list[Path] = []

    def note_and_read(path: Path, *columns: Any) -> Any:
        read.append(path)
        return read_table(path, *columns)

    monkeypatch.setattr("pacnet.datasets.format.parquet.read_table", note_and_read)
    record(tmp_path / "new", episode(2))

    old = tmp_path / "new/data/chunk-000"
    assert [path for path in read if old in path.parents] == [
        old / "file-000.parquet", old / "file-001.parquet",
    ]  # fmt: skip


@pytest.mark.parametrize("held", [1, 80, 10**6])
def test_statistics_of_many_dimensions(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, held: int):
    """However many of them are taken at once: one, two of 40 frames each, or all."""
    monkeypatch.setattr("pacnet.datasets.format.statistics._BLOCK", held)
    rows = np.random.default_rng(0).normal(size=(40, 5)).astype("f4") * np.arange(1, 6)
    record_states(tmp_path, rows[:30], rows[30:])

    stored = rows.astype("f4").astype("f8")
    assert statistic(tmp_path, "std") == pytest.approx(stored.std(axis=0), rel=1e-12)
    assert statistic(tmp_path, "max") == stored.max(axis=0).tolist()
    # quantile 0.1 of 40 lies at 3.9 of the sorted
    low, high = np.sort(stored, axis=0)[3:5]
    assert statistic(tmp_path, "q10") == pytest.approx(low + 0.9 * (high - low), rel=1e-12)
    assert statistic(tmp_path, "count") == [40]


def test_each_episode_has_its_own_statistics(tmp_path: Path):
    record_states(tmp_path, np.array([[0.0], [4.0]]), np.array([[8.0]]))

    table = pq.read_table(tmp_path / "meta/episodes/chunk-000/file-000.parquet")
    assert table["stats/observation.state/mean"].to_pylist() == [[2.0], [8.0]]
    assert table["stats/observation.state/std"].to_pylist() == [[2.0], [0.0]]
    assert table["stats/observation.state/count"].to_pylist() == [[2], [1]]
    assert table["stats/index/max"].to_pylist() == [[1.0], [2.0]]


def test_appending_leaves_the_old_files_alone(tmp_path: Path):
    record(tmp_path / "new", episode(0), episode(1))
    written = files_of(tmp_path / "new").items()
    kept = {path: content for path, content in written if path.stem == "file-000"}
    record(tmp_path / "new", episode(2, length=1))
    record(tmp_path / "new", episode(3))

    assert_holds(tmp_path / "new", episode(0), episode(1), episode(2, length=1), episode(3))
    assert len(kept) == 2
    assert kept.items() <= files_of(tmp_path / "new").items()
    assert [one.task for one in load_demonstrations(tmp_path / "new")] == [
        "task 0", "task 1", "task 0", "task 0",
    ]  # fmt: skip
    tasks = pq.read_table(tmp_path / "new/meta/tasks.parquet").to_pylist()
    assert tasks == [{"task_index": 0, "task": "task 0"}, {"task_index": 1, "task": "task 1"}]


def test_opening_a_dataset_and_recording_nothing_changes_nothing(tmp_path: Path):
    record(tmp_path / "new", episode(0))
    before = files_of(tmp_path / "new")
    record(tmp_path / "new")

    assert before == files_of(tmp_path / "new")


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"fps": 20}, "expected fps 10 as in .*new, got 20"),
        ({"robot_type": "arm"}, "expected robot_type 'hand' as in .*new, got 'arm'"),
        (
            {"features": {"action": ("push",)}},
            r"expected the features \['action', .*got \['action'\]",
        ),
        (
            {"features": FEATURES | {"action": ("pull",)}},
            r"'action' as float32 of \['push'\] as in .*got float32 of \['pull'\]",
        ),
        (
            {"features": FEATURES | {"action": Feature(("push",), "int64")}},
            r"'action' as float32 of \['push'\] as in .*got int64 of \['push'\]",
        ),
    ],
)
def test_a_dataset_of_something_else_is_left_alone(
    tmp_path: Path, changes: dict[str, object], message: str
):
    record(tmp_path / "new", episode(0))
    before = files_of(tmp_path / "new")
    arguments = {"fps": 10, "features": FEATURES, "robot_type": "hand"} | changes
    recorder = Recorder(tmp_path / "new", **arguments)  # pyright: ignore
    with pytest.raises(ValueError, match=message), recorder:
        pass

    assert before == files_of(tmp_path / "new")
    assert {path.name for path in (tmp_path / "new").iterdir()} == {"data", "meta"}


def test_a_dataset_without_names_is_appended_to(tmp_path: Path):
    record(tmp_path / "new", episode(0))
    path = tmp_path / "new/meta/info.json"
    info = json.loads(path.read_text())
    info["features"]["action"]["names"] = None
    info["features"]["observation.state"]["names"] = {"motors": ["x", "y", "z"]}
    path.write_text(json.dumps(info))
    record(tmp_path / "new", episode(1))

    assert_holds(tmp_path / "new", episode(0), episode(1))
    assert json.loads(path.read_text())["features"] == info["features"]


def test_a_feature_without_names_has_its_length(tmp_path: Path):
    record(tmp_path / "new", episode(0))
    path = tmp_path / "new/meta/info.json"
    info = json.loads(path.read_text())
    info["features"]["observation.state"]["names"] = None
    path.write_text(json.dumps(info))
    before = files_of(tmp_path / "new")
    for names in (("x", "y"), ("x", "y", "z", "w")):
        features = FEATURES | {"observation.state": names}
        with pytest.raises(
            ValueError,
            match=r"'observation.state' as float32 of \['shape \[3\]'\] as in .*\['x', 'y'",
        ):
            Recorder(tmp_path / "new", 10, features).__enter__()
    assert before == files_of(tmp_path / "new")


def test_the_description_counts_what_was_appended(tmp_path: Path):
    for numbers in ((0, 1), (2, 3, 4)):
        with Recorder(tmp_path / "new", 10, FEATURES) as recorder:
            for number in numbers:
                recorder.save_episode(f"task {number % 3}", episode(number, length=number + 1))

    info = json.loads((tmp_path / "new/meta/info.json").read_text())
    assert info["splits"] == {"train": "0:5"}
    counts = (info["total_episodes"], info["total_frames"], info["total_tasks"])
    assert counts == (5, 1 + 2 + 3 + 4 + 5, 3)


def test_time_runs_from_0_in_each_episode(tmp_path: Path):
    for length in (3, 2):
        with Recorder(tmp_path / "new", 30, FEATURES) as recorder:
            recorder.save_episode("task", episode(0, length))

    files = sorted((tmp_path / "new/data").rglob("*.parquet"))
    times = [time for path in files for time in pq.read_table(path)["timestamp"].to_pylist()]
    assert times == pytest.approx([0, 1 / 30, 2 / 30, 0, 1 / 30], rel=1e-7)


def test_frames_go_to_another_file_before_one_grows_too_large(tmp_path: Path):
    record(tmp_path / "new", episode(0))
    path = tmp_path / "new/meta/info.json"
    info = json.loads(path.read_text())
    path.write_text(json.dumps(info | {"data_files_size_in_mb": 0.02, "chunks_size": 3}))
    episodes = [episode(number, length=150) for number in range(1, 8)]
    record(tmp_path / "new", *episodes)

    assert_holds(tmp_path / "new", episode(0), *episodes)
    files = sorted((tmp_path / "new/data").rglob("*.parquet"))
    assert [f"{path.parent.name[-1]}{path.stem[-1]}" for path in files[:4]] == [
        "00",
        "01",
        "02",
        "10",
    ]
    assert all(path.stat().st_size < 0.02 * 2**20 for path in files)
    assert len(files) < 8  # more than one episode fits
    for path in files:
        rows = pq.ParquetFile(path).metadata
        assert rows.num_row_groups == rows.num_rows // (150 if path != files[0] else 5)


FIXED = {"observation.state": ("x", "y"), "action": ("u", "v")}
VERSIONS = ("lerobot_044", "lerobot_061")


def fixed(number: int) -> dict[str, NDArray[np.float32]]:
    """An episode as in tests/datasets/data/README.md."""
    rows = np.array([[number, frame] for frame in range(3)], np.float32)
    return {"observation.state": rows, "action": -rows}


def append_fixed(root: Path, *numbers: int) -> None:
    with Recorder(root, 10, FIXED, "hand") as recorder:
        for number in numbers:
            recorder.save_episode(f"task {number}", fixed(number))


def assert_fixed(root: Path, count: int) -> None:
    demonstrations = load_demonstrations(root, environment_state=None)
    for number, one in zip(range(count), demonstrations, strict=True):
        assert (one.episode, one.task) == (number, f"task {number}")
        np.testing.assert_array_equal(one.state, fixed(number)["observation.state"])
        np.testing.assert_array_equal(one.action, fixed(number)["action"])
    states = np.concatenate([fixed(number)["observation.state"] for number in range(count)])
    assert statistic(root, "mean") == pytest.approx(states.mean(axis=0))
    assert statistic(root, "std") == pytest.approx(states.std(axis=0))


@pytest.mark.parametrize("version", VERSIONS)
def test_what_lerobot_wrote_is_appended_to(tmp_path: Path, version: str):
    shutil.copytree(DATA / version, tmp_path / "new")
    append_fixed(tmp_path / "new", 2)
    append_fixed(tmp_path / "new", 3, 4)

    assert_fixed(tmp_path / "new", 5)
    tables = [pq.read_table(path) for path in sorted((tmp_path / "new/meta/episodes").rglob("*.*"))]
    assert [table["length"].to_pylist() for table in tables] == [[3, 3], [3], [3, 3]]
    assert tables[0].schema.equals(tables[1].schema)
    starts = [table["dataset_from_index"].to_pylist() for table in tables]
    assert starts == [[0, 3], [6], [9, 12]]
    tasks = pq.read_table(tmp_path / "new/meta/tasks.parquet")
    assert tasks["task"].to_pylist() == [f"task {number}" for number in range(5)]


@pytest.mark.slow
@pytest.mark.parametrize("version", [*VERSIONS, "ours"])
def test_lerobot_and_the_recorder_append_in_turn(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, version: str
):
    monkeypatch.setattr("datasets.config.HF_DATASETS_CACHE", tmp_path / "cache")
    root = tmp_path / "new"
    if version == "ours":
        append_fixed(root, 0, 1)
    else:
        shutil.copytree(DATA / version, root)
    append_fixed(root, 2)
    append_with_lerobot(root, 3)
    append_fixed(root, 4)
    append_with_lerobot(root, 5)

    assert_fixed(root, 6)
    dataset = open_with_lerobot(root)
    assert (dataset.num_episodes, len(dataset), len(dataset.hf_dataset)) == (6, 18, 18)
    for index in range(18):
        frame, number, time = dataset[index], index // 3, index % 3
        assert (frame["index"], frame["episode_index"], frame["frame_index"]) == (
            index, number, time,
        )  # fmt: skip
        assert frame["task"] == f"task {number}"
        np.testing.assert_array_equal(frame["action"], fixed(number)["action"][time])
        row = dataset.meta.episodes[number]
        assert (row["episode_index"], row["length"]) == (number, 3)
        assert (row["dataset_from_index"], row["dataset_to_index"]) == (3 * number, 3 * number + 3)


def open_with_lerobot(root: Path) -> Any:
    from lerobot.datasets.lerobot_dataset import LeRobotDataset

    return LeRobotDataset("local/new", root=root, video_backend="pyav")


def append_with_lerobot(root: Path, number: int) -> None:
    from lerobot.datasets.lerobot_dataset import LeRobotDataset

    if hasattr(LeRobotDataset, "resume"):  # since 0.5
        dataset: Any = LeRobotDataset.resume("local/new", root=root, video_backend="pyav")
    else:
        dataset = open_with_lerobot(root)
    for state, action in zip(*fixed(number).values(), strict=True):
        dataset.add_frame({"observation.state": state, "action": action, "task": f"task {number}"})
    dataset.save_episode()
    dataset.finalize()


def test_a_dataset_in_pieces_is_refused(tmp_path: Path):
    record(tmp_path / "new", episode(0))
    record(tmp_path / "new", episode(1))
    info = tmp_path / "new/meta/info.json"
    info.write_text(info.read_text().replace('"total_episodes": 2', '"total_episodes": 3'))
    with pytest.raises(DatasetError, match=r"expected 3 episodes of 10 frames .* found 2 of 10"):
        record(tmp_path / "new")

    (tmp_path / "new/data/chunk-000/file-001.parquet").write_bytes(b"PAR1")
    with pytest.raises(DatasetError, match=r"file-001.parquet cannot be read"):
        record(tmp_path / "new")


def test_a_second_recording_into_a_dataset_is_refused(tmp_path: Path):
    with Recorder(tmp_path / "new", fps=10, features=FEATURES) as recorder:
        recorder.save_episode("task", episode(0))
        with pytest.raises(BlockingIOError, match=r"only recording into .*new, another one"):
            record(tmp_path / "new", episode(1))
        with pytest.raises(BlockingIOError):
            recover(tmp_path / "new")
        recorder.save_episode("task", episode(2))

    assert_holds(tmp_path / "new", episode(0), episode(2))


def test_a_dataset_with_a_journal_says_how_to_complete_it(tmp_path: Path):
    with Recorder(tmp_path / "new", fps=10, features=FEATURES) as recorder:
        check_folded(tmp_path / "new")
        recorder.save_episode("task", episode(0))
        with pytest.raises(DatasetError, match=r"1 episodes in its journal.*datasets.recover\("):
            check_folded(tmp_path / "new")

    check_folded(tmp_path / "new")
    assert recover(tmp_path / "new") == 0
    assert recover(tmp_path / "nowhere") == 0
    check_folded(tmp_path / "nowhere")


@pytest.mark.slow
def test_recording_imports_nothing_heavy(tmp_path: Path):
    code = f"""
        import sys
        import numpy as np
        from pacnet.datasets.recorder import Recorder
        with Recorder({str(tmp_path / "new")!r}, 10, {{"action": ("x", "y")}}) as recorder:
            recorder.save_episode("task", {{"action": np.zeros((3, 2))}})
        print(sorted({{"lerobot", "datasets", "pandas", "numba"}} & set(sys.modules)))
    """
    command = [sys.executable, "-c", textwrap.dedent(code)]
    done = subprocess.run(command, cwd=PROJECT, capture_output=True, text=True, check=True)

    assert (done.stdout, done.stderr) == ("[]\n", "")


@pytest.mark.slow
def test_independent_checkers_find_nothing_wrong(tmp_path: Path):
    features = FEATURES | {"action": ("x", "y", "z")}
    time = np.linspace(0, 6, 200)[:, None]
    for seeds in (range(6), range(6, 10)):
        with Recorder(tmp_path / "new", fps=30, features=features) as recorder:
            for seed in seeds:
                phase = np.random.default_rng(seed).uniform(size=6)
                waves = np.sin(time + phase) + 1000
                frames = dict(zip(FEATURES, np.split(waves, [3, 5], axis=1), strict=True))
                frames["action"] = frames["observation.state"] + 0.01
                recorder.save_episode("wave to the one who waves first", frames)
    assert_clean(tmp_path / "new")
