"""Claims about recording while threads, forks, other processes, the disk or the user interfere."""

import gc
import os
import shutil
import signal
import threading
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from multiprocessing.connection import Connection
from multiprocessing.context import ForkServerContext
from pathlib import Path

import numpy as np
import pytest
from filelock import BaseFileLock
from numpy.typing import NDArray

from pacnet.core.durable import make_folder
from pacnet.datasets.demonstrations import load_demonstrations
from pacnet.datasets.format import DatasetError
from pacnet.datasets.format.features import Feature
from pacnet.datasets.journal.journal import Journal, check_folded, delete_and_release
from pacnet.datasets.recorder import Recorder, recover

FEATURES = {"observation.state": ("x", "y"), "action": ("push",)}
HALF = "\ud800"  # of a surrogate pair, which UTF-8 does not have


def episode(seed: int, length: int = 5) -> dict[str, NDArray[np.float32]]:
    rows = np.random.default_rng(seed).normal(size=(length, 3)).astype("f4")
    return {"observation.state": rows[:, :2], "action": rows[:, 2:]}


def open_recorder(root: str | Path, fps: int = 10) -> Recorder:
    return Recorder(root, fps, FEATURES)


def record(root: Path, *seeds: int, fps: int = 10) -> None:
    with open_recorder(root, fps) as recorder:
        for seed in seeds:
            recorder.save_episode("task", episode(seed))


def assert_holds(root: Path, *seeds: int, length: int = 5) -> None:
    """The dataset is that of these episodes, with nothing beside it."""
    assert {path.name for path in root.iterdir()} == {"data", "meta"}
    read = load_demonstrations(root)
    for seed, one in zip(seeds, read, strict=True):
        np.testing.assert_array_equal(one.state, episode(seed, length)["observation.state"])
        np.testing.assert_array_equal(one.action, episode(seed, length)["action"])


@pytest.fixture(autouse=True)
def without_waiting_for_the_disk(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("os.fsync", lambda _: None)


def run(forks: ForkServerContext, act: Callable[..., None], *arguments: object) -> None:
    """Do something in another process, in which it must not fail."""
    process = forks.Process(target=act, args=arguments)
    process.start()
    process.join()
    assert process.exitcode == 0


def test_threads_that_save_at_the_same_time_lose_nothing(tmp_path: Path):
    start = threading.Barrier(4)

    def save(recorder: Recorder, first: int) -> None:
        start.wait()
        for seed in range(first, first + 10):
            recorder.save_episode("task", episode(seed))

    with open_recorder(tmp_path / "new") as recorder:
        threads = [threading.Thread(target=save, args=(recorder, 10 * k)) for k in range(4)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()

    read = load_demonstrations(tmp_path / "new")
    got = sorted(float(one.action[0, 0]) for one in read)
    assert got == sorted(float(episode(seed)["action"][0, 0]) for seed in range(40))


def test_saving_does_not_look_through_what_is_saved(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    with open_recorder(tmp_path / "new") as recorder, monkeypatch.context() as patched:
        patched.setattr("pacnet.datasets.journal.journal._episode_files", None)
        for seed in range(3):
            recorder.save_episode("task", episode(seed))

    assert_holds(tmp_path / "new", 0, 1, 2)


def test_the_working_directory_may_change(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path)
    with open_recorder("new") as recorder:
        recorder.save_episode("task", episode(0))
        monkeypatch.chdir(tmp_path / "elsewhere")
        recorder.save_episode("task", episode(1))

    assert_holds(tmp_path / "new", 0, 1)
    assert not list((tmp_path / "elsewhere").iterdir())


def test_a_recorder_that_is_open_is_not_entered_again(tmp_path: Path):
    with open_recorder(tmp_path / "new") as recorder:
        recorder.save_episode("task", episode(0))
        with pytest.raises(RuntimeError, match="entered once at a time"), recorder:
            pass
        with pytest.raises(BlockingIOError):
            recover(tmp_path / "new")
        recorder.save_episode("task", episode(1))
    with pytest.raises(RuntimeError, match="inside the recorder's `with` block"):
        recorder.__exit__()
    with recorder:
        recorder.save_episode("task", episode(2))

    assert_holds(tmp_path / "new", 0, 1, 2)


def record_and_fork(root: Path) -> None:
    with open_recorder(root) as recorder:
        recorder.save_episode("task", episode(0))
        child = os.fork()
        if child == 0:
            with pytest.raises(RuntimeError, match="in the process that entered"):
                recorder.save_episode("task", episode(2))
        else:
            assert os.waitpid(child, 0)[1] == 0
            assert [path.name for path in root.iterdir()] == ["journal"]
            with pytest.raises(BlockingIOError):
                recover(root)
            recorder.save_episode("task", episode(1))
    if child == 0:
        os._exit(0)


@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs forks")
def test_a_fork_that_leaves_the_block_leaves_the_recording_alone(
    forks: ForkServerContext, tmp_path: Path
):
    run(forks, record_and_fork, tmp_path / "new")

    assert_holds(tmp_path / "new", 0, 1)


def fork_and_be_killed(root: Path, pid: Connection) -> None:
    """Leave a fork behind that lives on with a copy of the recorder."""
    recorder = open_recorder(root).__enter__()
    recorder.save_episode("task", episode(0))
    child = os.fork()
    if child == 0:
        pid.send(os.getpid())  # it runs, and has let go of the lock
        time.sleep(60)
        os._exit(0)
    time.sleep(60)  # until it is killed


@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs forks")
def test_a_fork_does_not_hold_the_lock_of_a_killed_recording(
    forks: ForkServerContext, tmp_path: Path
):
    pid, other = forks.Pipe(duplex=False)
    process = forks.Process(target=fork_and_be_killed, args=(tmp_path / "new", other))
    process.start()
    child = pid.recv()
    process.kill()
    process.join()
    try:
        assert recover(tmp_path / "new") == 1
    finally:
        os.kill(child, signal.SIGKILL)

    assert_holds(tmp_path / "new", 0)


def fork_that_forgets_the_recorder(root: Path) -> None:
    recorder = open_recorder(root).__enter__()
    recorder.save_episode("task", episode(0))
    child = os.fork()
    if child == 0:
        del recorder
        gc.collect()
        os._exit(0)
    assert os.waitpid(child, 0)[1] == 0
    with pytest.raises(BlockingIOError):
        recover(root)
    recorder.__exit__()


@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs forks")
def test_a_fork_that_forgets_the_recorder_leaves_the_lock_to_its_parent(
    forks: ForkServerContext, tmp_path: Path
):
    run(forks, fork_that_forgets_the_recorder, tmp_path / "new")

    assert_holds(tmp_path / "new", 0)


def test_another_thread_may_close_the_recorder(tmp_path: Path):
    recorder = open_recorder(tmp_path / "new").__enter__()
    recorder.save_episode("task", episode(0))
    with ThreadPoolExecutor(1) as pool:
        with pytest.raises(BlockingIOError):
            pool.submit(recover, tmp_path / "new").result()
        pool.submit(recorder.__exit__).result()

    assert_holds(tmp_path / "new", 0)


def record_on_a_full_disk(root: Path) -> None:
    import resource

    _, most = resource.getrlimit(resource.RLIMIT_FSIZE)
    recorder = open_recorder(root).__enter__()
    recorder.save_episode("task", episode(0, length=1000))
    resource.setrlimit(resource.RLIMIT_FSIZE, (8000, most))
    with pytest.raises(OSError, match="File too large"):
        recorder.save_episode("task", episode(3, length=1000))
    resource.setrlimit(resource.RLIMIT_FSIZE, (most, most))
    recorder.save_episode("task", episode(1, length=1000))
    resource.setrlimit(resource.RLIMIT_FSIZE, (8000, most))
    with pytest.raises(OSError, match="File too large"):
        recorder.__exit__()


@pytest.mark.skipif(os.name == "nt", reason="needs limits on files")
def test_a_full_disk_takes_no_finished_episode(forks: ForkServerContext, tmp_path: Path):
    run(forks, record_on_a_full_disk, tmp_path / "new")

    with pytest.raises(DatasetError, match="2 episodes in its journal"):
        check_folded(tmp_path / "new")
    assert recover(tmp_path / "new") == 2
    assert_holds(tmp_path / "new", 0, 1, length=1000)


def flipped(content: bytes) -> bytes:
    """One bit of the first value is another."""
    at = content.index(episode(1)["action"].tobytes())
    return content[:at] + bytes([content[at] ^ 1]) + content[at + 1 :]


@pytest.mark.parametrize(
    "damage", [lambda _: b"", lambda content: content[: len(content) // 2], flipped]
)
def test_a_damaged_episode_is_named_and_the_others_recovered_once_it_is_moved(
    tmp_path: Path, damage: Callable[[bytes], bytes]
):
    recorder = open_recorder(tmp_path / "new").__enter__()
    for seed in range(3):
        recorder.save_episode("task", episode(seed))
    path = tmp_path / "new/journal/episode-000001.arrow"
    path.write_bytes(damage(path.read_bytes()))
    message = "episode-000001.arrow is damaged: once it is moved away, the rest can be recovered"
    with pytest.raises(DatasetError, match=message):
        recorder.__exit__()
    with pytest.raises(DatasetError, match=message):
        record(tmp_path / "new", 3)
    path.rename(tmp_path / path.name)

    assert recover(tmp_path / "new") == 2
    assert_holds(tmp_path / "new", 0, 2)


def test_a_damaged_list_of_a_fold_is_named(tmp_path: Path):
    recorder = open_recorder(tmp_path / "new").__enter__()
    recorder.save_episode("task", episode(0))
    listed = tmp_path / "new/journal/fold.json"
    listed.write_text("{")
    for read in (recorder.__exit__, lambda: load_demonstrations(tmp_path / "new")):
        with pytest.raises(DatasetError, match=r"fold.json is damaged .*: without it, the whole"):
            read()
    listed.unlink()

    assert recover(tmp_path / "new") == 1
    assert_holds(tmp_path / "new", 0)


def test_a_journal_whose_dataset_became_another_says_so(tmp_path: Path):
    with open_recorder(tmp_path / "new") as recorder:
        recorder.save_episode("task", episode(0))
        shutil.copytree(tmp_path / "new/journal", tmp_path / "kept")
    shutil.rmtree(tmp_path / "new")
    record(tmp_path / "new", 1, fps=20)
    (tmp_path / "kept").rename(tmp_path / "new/journal")

    message = "journal in .*journal was recorded into another.*fps 20.*got 10: move it away"
    with pytest.raises(ValueError, match=message):
        recover(tmp_path / "new")
    with pytest.raises(ValueError, match=message):
        record(tmp_path / "new", 2, fps=20)


def record_and_end(root: Path, *seeds: int) -> None:
    """Save episodes and go without leaving the `with` block."""
    recorder = open_recorder(root).__enter__()
    for seed in seeds:
        recorder.save_episode("task", episode(seed))
    os._exit(0)


def test_a_dataset_that_lost_its_description_is_not_begun_anew(
    forks: ForkServerContext, tmp_path: Path
):
    root, info = tmp_path / "new", tmp_path / "new/meta/info.json"
    record(root, 0, 1, 2)
    run(forks, record_and_end, root, 3)
    info.rename(tmp_path / "info.json")
    before = {path: path.read_bytes() for path in root.rglob("*.*") if path.is_file()}
    for recovers in (recover, record):
        with pytest.raises(DatasetError, match=r"files in data/ and no meta/info.json: bring it"):
            recovers(root)
    assert {path: path.read_bytes() for path in root.rglob("*.*") if path.is_file()} == before

    shutil.copytree(root / "journal", tmp_path / "moved/journal")
    assert recover(tmp_path / "moved") == 1  # data/ and meta/ are elsewhere
    assert_holds(tmp_path / "moved", 3)
    (tmp_path / "info.json").rename(info)
    assert recover(root) == 1
    assert_holds(root, 0, 1, 2, 3)


@pytest.mark.parametrize("task", [f"reach {HALF}", None])
def test_a_task_that_no_file_can_hold_is_refused(tmp_path: Path, task: str):
    with open_recorder(tmp_path / "new") as recorder:
        recorder.save_episode("task", episode(0))
        with pytest.raises(ValueError, match="expected the task in words"):
            recorder.save_episode(task, episode(1))

    assert_holds(tmp_path / "new", 0)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"robot_type": f"arm {HALF}"}, "expected robot_type as text or None"),
        ({"robot_type": Path("arm")}, "expected robot_type as text or None"),
        ({"features": {f"action{HALF}": ("x",)}}, "expected feature names as text"),
        ({"features": {1: ("x",)}}, "expected feature names as text"),
        ({"features": {"action": (HALF,)}}, "'action' to have distinct dimension names as text"),
        ({"features": {"winner": Feature((np.int64(1),), "int64")}}, "dimension names as text"),  # pyright: ignore
    ],
)
def test_names_that_no_file_can_hold_are_refused(
    tmp_path: Path, changes: dict[str, object], message: str
):
    with pytest.raises(ValueError, match=message):
        Recorder(**{"root": tmp_path / "new", "fps": 10, "features": FEATURES} | changes)  # pyright: ignore


def test_another_recording_may_begin_while_one_is_closed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    other = []

    def delete_and_open(lock: BaseFileLock) -> None:
        delete_and_release(lock)
        if not other:
            other.append(Journal(tmp_path / "new"))

    monkeypatch.setattr("pacnet.datasets.journal.journal.delete_and_release", delete_and_open)
    record(tmp_path / "new", 0)
    with pytest.raises(BlockingIOError):
        recover(tmp_path / "new")
    other[0].close()

    assert_holds(tmp_path / "new", 0)


@pytest.mark.parametrize("error", [FileNotFoundError, FileExistsError, None])
def test_another_recording_may_be_closed_while_one_begins(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, error: type[OSError] | None
):
    """Its folder goes before, while or after this one makes it."""
    lost = []

    def make_and_lose(folder: Path) -> None:
        make_folder(folder)
        if len(lost) < 3:
            lost.append(folder)
            folder.rmdir()
            if error:
                raise error

    monkeypatch.setattr("pacnet.datasets.journal.journal.make_folder", make_and_lose)
    record(tmp_path / "new", 0)

    assert_holds(tmp_path / "new", 0)


def test_a_file_in_place_of_the_folder_of_a_lock_is_an_error(tmp_path: Path):
    (tmp_path / "journal").write_text("mine")
    with pytest.raises(FileExistsError, match="expected a dataset or a folder to be made"):
        record(tmp_path, 0)


def open_and_close(root: Path, times: int) -> None:
    opened = 0
    while opened < times:
        try:
            with open_recorder(root):
                opened += 1
        except BlockingIOError:
            pass


@pytest.mark.slow
@pytest.mark.parametrize("seeds", [(), (0,)])
def test_processes_that_open_and_close_at_the_same_time_only_wait(
    forks: ForkServerContext, tmp_path: Path, seeds: tuple[int, ...]
):
    record(tmp_path / "new", *seeds)
    processes = [
        forks.Process(target=open_and_close, args=(tmp_path / "new", 100)) for _ in range(4)
    ]
    for process in processes:
        process.start()
    for process in processes:
        process.join()

    assert [process.exitcode for process in processes] == [0] * 4
    if seeds:
        assert_holds(tmp_path / "new", *seeds)
