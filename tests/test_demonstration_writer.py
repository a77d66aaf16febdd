"""Claims about recording demonstrations; what opens a writer is slow, as it imports LeRobot."""

import hashlib
import signal
import subprocess
import sys
import textwrap
from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from pacnet.demonstration_writer import DemonstrationWriter
from pacnet.demonstrations import load_demonstrations

FEATURES = {
    "observation.state": ("x", "y", "z"),
    "observation.environment_state": ("u", "v"),
    "action": ("push",),
}
PROJECT = Path(__file__).parents[1]


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
    with DemonstrationWriter(root, fps=10, features=FEATURES, robot_type="hand") as writer:
        for number, frames in enumerate(episodes):
            writer.save_episode(f"task {number % 2}", frames)
        if error:
            raise error


def assert_holds(root: Path, *episodes: Mapping[str, NDArray[np.float32]]) -> None:
    for demonstration, frames in zip(load_demonstrations(root), episodes, strict=True):
        np.testing.assert_array_equal(demonstration.state, frames["observation.state"])
        np.testing.assert_array_equal(
            demonstration.environment_state, frames["observation.environment_state"]
        )
        np.testing.assert_array_equal(demonstration.action, frames["action"])


@pytest.fixture
def interruptible() -> Iterator[None]:
    """SIGINT raises KeyboardInterrupt, which a background job would hand down ignored."""
    previous = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, previous)


@pytest.mark.parametrize("fps", [0, -1, 2.5, True, "10"])
def test_fps_is_a_positive_integer(tmp_path: Path, fps: int):
    with pytest.raises(ValueError, match="expected fps as an integer above 0, got"):
        DemonstrationWriter(tmp_path / "new", fps=fps, features=FEATURES)


@pytest.mark.parametrize(
    ("features", "message"),
    [
        ({}, "at least one feature"),
        ({"a/b": ("x",)}, "without '/'.*got 'a/b'"),
        ({"timestamp": ("x",)}, "got 'timestamp'"),
        ({"action": ()}, "'action' to have distinct dimension names"),
        ({"action": ("x", "x")}, "'action' to have distinct dimension names"),
        ({"action": "xy"}, "'action' to have distinct dimension names"),
    ],
)
def test_features_that_cannot_be_stored(
    tmp_path: Path, features: dict[str, tuple[str, ...]], message: str
):
    with pytest.raises(ValueError, match=message):
        DemonstrationWriter(tmp_path / "new", fps=10, features=features)


def test_saving_outside_the_with_block(tmp_path: Path):
    writer = DemonstrationWriter(tmp_path / "new", fps=10, features=FEATURES)

    with pytest.raises(RuntimeError, match="inside the writer's `with` block"):
        writer.save_episode("task", episode(0))
    assert not (tmp_path / "new").exists()


@pytest.mark.slow
def test_what_is_written_is_read(tmp_path: Path):
    episodes = episode(0), episode(1, length=1), episode(2, length=30)
    record(tmp_path / "new", *episodes)

    assert_holds(tmp_path / "new", *episodes)
    demonstrations = load_demonstrations(tmp_path / "new")
    assert [one.task for one in demonstrations] == ["task 0", "task 1", "task 0"]
    assert demonstrations.fps == 10
    assert demonstrations.names == FEATURES


@pytest.mark.slow
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


@pytest.mark.slow
def test_the_same_episodes_give_the_same_bytes(tmp_path: Path):
    digests = []
    for name in ("one", "other"):
        record(tmp_path / name, episode(0), episode(1))
        files = sorted((tmp_path / name / "data").rglob("*.parquet"))
        digests.append([hashlib.sha256(file.read_bytes()).hexdigest() for file in files])

    assert digests[0] == digests[1] != []


@pytest.mark.slow
def test_recording_is_silent(tmp_path: Path, capfd: pytest.CaptureFixture[str]):
    record(tmp_path / "new", episode(0))

    assert capfd.readouterr() == ("", "")


@pytest.mark.slow
def test_progress_bars_are_on_again_after_recording(tmp_path: Path):
    import datasets

    record(tmp_path / "new", episode(0))

    assert datasets.are_progress_bars_disabled() is False


@pytest.mark.slow
def test_a_folder_that_exists_is_left_alone(tmp_path: Path):
    (tmp_path / "mine").write_text("precious")

    with pytest.raises(FileExistsError, match="exists"):
        record(tmp_path, episode(0))
    assert [path.name for path in tmp_path.iterdir()] == ["mine"]


@pytest.mark.slow
def test_leaving_the_block_closes_the_files_at_once(tmp_path: Path):
    with DemonstrationWriter(tmp_path / "new", fps=10, features=FEATURES) as writer:
        writer.save_episode("task", episode(0))
        kept = writer._dataset  # else LeRobot's destructor would close them as well

    assert_holds(tmp_path / "new", episode(0))
    assert kept is not None


@pytest.mark.slow
@pytest.mark.parametrize("error", [RuntimeError, KeyboardInterrupt])
def test_what_was_saved_before_an_error_is_read(tmp_path: Path, error: type[BaseException]):
    with pytest.raises(error):
        record(tmp_path / "new", episode(0), episode(1), error=error)

    assert_holds(tmp_path / "new", episode(0), episode(1))


@pytest.mark.slow
@pytest.mark.parametrize("error", [RuntimeError, KeyboardInterrupt])
def test_an_error_before_the_first_episode_leaves_nothing(
    tmp_path: Path, error: type[BaseException]
):
    with pytest.raises(error):
        record(tmp_path / "new", error=error)

    assert not (tmp_path / "new").exists()


@pytest.mark.slow
def test_without_an_episode_nothing_is_left(tmp_path: Path):
    record(tmp_path / "new")

    assert not (tmp_path / "new").exists()


@pytest.mark.slow
@pytest.mark.usefixtures("interruptible")
def test_an_interrupt_while_opening_leaves_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    from lerobot.datasets.lerobot_dataset import LeRobotDataset

    create, made = LeRobotDataset.create, []

    def create_and_interrupt(**arguments: object) -> LeRobotDataset:
        dataset = create(**arguments)
        made.append((tmp_path / "new").exists())
        signal.raise_signal(signal.SIGINT)
        return dataset

    monkeypatch.setattr(LeRobotDataset, "create", create_and_interrupt)
    with pytest.raises(KeyboardInterrupt):
        record(tmp_path / "new", episode(0))

    assert made == [True]
    assert not (tmp_path / "new").exists()


@pytest.mark.slow
@pytest.mark.usefixtures("interruptible")
def test_an_interrupt_while_closing_waits_until_the_files_are_closed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    from lerobot.datasets.lerobot_dataset import LeRobotDataset

    finalize = LeRobotDataset.finalize
    kept = []  # else LeRobot's destructor would close the files as well

    def interrupt_and_finalize(dataset: LeRobotDataset) -> None:
        if not kept:
            kept.append(dataset)
            signal.raise_signal(signal.SIGINT)
        finalize(dataset)

    monkeypatch.setattr(LeRobotDataset, "finalize", interrupt_and_finalize)
    with pytest.raises(KeyboardInterrupt):
        record(tmp_path / "new", episode(0), episode(1))

    assert len(kept) == 1
    assert_holds(tmp_path / "new", episode(0), episode(1))


@pytest.mark.slow
@pytest.mark.usefixtures("interruptible")
def test_an_interrupt_while_saving_waits_until_the_episode_is_written(tmp_path: Path):
    long = episode(1, length=3000)
    interrupted = []

    def interrupt(*_: object) -> None:
        interrupted.append(True)
        signal.raise_signal(signal.SIGINT)

    previous_alarm = signal.signal(signal.SIGALRM, interrupt)
    try:
        with DemonstrationWriter(tmp_path / "new", fps=10, features=FEATURES) as writer:
            writer.save_episode("task", episode(0))
            signal.setitimer(signal.ITIMER_REAL, 0.1)
            with pytest.raises(KeyboardInterrupt):
                writer.save_episode("task", long)
            assert interrupted
            writer.save_episode("task", episode(2))
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, previous_alarm)

    assert_holds(tmp_path / "new", episode(0), long, episode(2))


@pytest.mark.slow
def test_a_process_that_is_interrupted_keeps_its_finished_episodes(tmp_path: Path):
    code = f"""
        import itertools, sys
        sys.path.insert(0, {str(PROJECT / "tests")!r})
        from test_demonstration_writer import FEATURES, DemonstrationWriter, episode
        with DemonstrationWriter({str(tmp_path / "new")!r}, fps=10, features=FEATURES) as writer:
            for number in itertools.count():
                writer.save_episode("task", episode(number, length=200))
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
        output, errors = process.communicate(timeout=60)

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
}


@pytest.mark.slow
@pytest.mark.parametrize("case", [*BAD_EPISODES, "no task"])
def test_a_bad_episode_changes_nothing(tmp_path: Path, case: str):
    frames, message = BAD_EPISODES.get(case, (episode(1), "expected the task in words, got ' '"))
    with DemonstrationWriter(tmp_path / "new", fps=10, features=FEATURES) as writer:
        writer.save_episode("task", episode(0))
        before = {path: path.read_bytes() for path in (tmp_path / "new").rglob("*.json")}
        with pytest.raises(ValueError, match=message):
            writer.save_episode(" " if case == "no task" else "task", frames)
        assert before == {path: path.read_bytes() for path in (tmp_path / "new").rglob("*.json")}
        writer.save_episode("task", episode(2))

    assert_holds(tmp_path / "new", episode(0), episode(2))
