"""A killed recording loses no finished episode: killed at random, and before each file operation.

The processes to be killed are forked from one that has imported everything, so each costs
milliseconds.
"""

import itertools
import json
import os
import shutil
import signal
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from multiprocessing.connection import Connection
from multiprocessing.context import ForkServerContext
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from pacnet.datasets.demonstrations import load_demonstrations
from pacnet.datasets.format import DatasetError
from pacnet.datasets.format.features import Feature
from pacnet.datasets.journal.journal import check_folded
from pacnet.datasets.recorder import Recorder, recover

FEATURES = {
    "observation.state": ("x", "y"),
    "action": ("push",),
    "winner": Feature(("winner",), "int64"),
}
OPERATIONS = ("open", "os.rename", "os.remove", "os.mkdir", "os.rmdir", "shutil.rmtree")
KILLED = -signal.SIGKILL


def episode(number: int) -> dict[str, NDArray[np.generic]]:
    rng = np.random.default_rng(number)
    length = int(rng.integers(1, 40))
    return {
        "observation.state": rng.normal(size=(length, 2)).astype("f4"),
        "action": rng.normal(size=(length, 1)).astype("f4"),
        "winner": rng.integers(-1, 9, (length, 1)),
    }


def open_recorder(root: Path) -> Recorder:
    return Recorder(root, fps=10, features=FEATURES)


def record(root: Path, start: int, end: int, report: Callable[[int], None] = id) -> None:
    with open_recorder(root) as recorder:
        for number in range(start, end):
            recorder.save_episode(f"task {number % 3}", episode(number))
            report(number)


def assert_holds(root: Path, count: int) -> None:
    """The dataset is that of so many episodes, to our reader."""
    check_folded(root)
    assert not (root / "journal").exists()
    demonstrations = load_demonstrations(root, environment_state=None)
    assert [one.episode for one in demonstrations] == list(range(count))
    for number, one in enumerate(demonstrations):
        assert one.task == f"task {number % 3}"
        np.testing.assert_array_equal(one.state, episode(number)["observation.state"])
        np.testing.assert_array_equal(one.action, episode(number)["action"])


def assert_lerobot_reads(root: Path, *counts: int) -> None:
    """The dataset is that of one of so many episodes, to LeRobot."""
    from lerobot.datasets.lerobot_dataset import LeRobotDataset

    dataset = LeRobotDataset("local/new", root=root, video_backend="pyav")
    assert dataset.num_episodes in counts
    index = 0
    for number in range(dataset.num_episodes):
        winner = episode(number)["winner"]
        for frame in {0, len(winner) - 1}:
            got = dataset[index + frame]
            assert (got["episode_index"], got["frame_index"]) == (number, frame)
            assert got["winner"] == winner[frame, 0]
            assert got["task"] == f"task {number % 3}"
        index += len(winner)
    assert len(dataset) == index


def record_for_ever(root: Path, start: int, seed: int, pipe: Connection) -> None:
    """One recording after the other, of none to four episodes each; reports each saved episode."""
    rng = np.random.default_rng(seed)
    pipe.send(start)  # so many there are
    while True:
        end = start + int(rng.integers(0, 5))
        record(root, start, end, lambda number: pipe.send(number + 1))
        start = end


def record_and_tell(root: Path, start: int, end: int, pipe: Connection) -> None:
    record(root, start, end, lambda number: pipe.send(number + 1))


def record_and_wait(root: Path, start: int, pipe: Connection) -> None:
    def tell_and_wait(number: int) -> None:
        pipe.send(number + 1)
        signal.pause()

    record(root, start, start + 2, tell_and_wait)


def use_cache(folder: Path) -> None:
    """Where the reader of Parquet files that LeRobot uses keeps copies of them."""
    import datasets

    datasets.config.HF_DATASETS_CACHE = folder


def changes(event: str, details: tuple[object, ...]) -> bool:
    """Whether an event is an operation that changes files or folders."""
    return event in OPERATIONS and (event != "open" or str(details[1])[:1] in "wax")


def die_at(step: int, root: Path, act: Callable[..., None], *arguments: object) -> None:
    """Do something, and be killed at one of the operations that change files in the folder.

    That is before it, or when a file is half written.
    """
    steps = itertools.count()

    def count(event: str, details: tuple[object, ...]) -> None:
        if str(root) in str(details[:1]) and changes(event, details) and next(steps) == step:
            os.kill(os.getpid(), signal.SIGKILL)

    def flush(file: int) -> None:
        """Leave the disk its time: the kernel is not killed."""
        if next(steps) == step:
            with suppress(OSError):  # a folder
                os.ftruncate(file, os.fstat(file).st_size // 2)
            os.kill(os.getpid(), signal.SIGKILL)

    os.fsync = flush
    sys.addaudithook(count)
    act(root, *arguments)


def last_of(pipe: Connection, otherwise: int) -> int:
    """The last number that a process which has ended sent."""
    try:
        while pipe.poll():
            otherwise = pipe.recv()
    except EOFError:
        pass
    return otherwise


def dies(forks: ForkServerContext, step: int, root: Path, *arguments: object) -> bool:
    """Whether a process did something and was killed at a step, rather than completing it."""
    process = forks.Process(target=die_at, args=(step, root, *arguments))
    process.start()
    process.join()
    assert process.exitcode in (0, KILLED)
    return process.exitcode == KILLED


def kill_at_random(forks: ForkServerContext, root: Path, saved: int, seed: int) -> int:
    """Record until killed; the number of episodes that are said to be saved."""
    delay = float(np.random.default_rng(seed).uniform(0, 0.5))  # [s]; a recording takes a tenth
    pipe, other = forks.Pipe(duplex=False)
    process = forks.Process(target=record_for_ever, args=(root, saved, seed, other))
    process.start()
    other.close()
    assert pipe.recv() == saved
    time.sleep(delay)
    process.kill()
    process.join()
    assert process.exitcode == KILLED
    return last_of(pipe, saved)


def assert_recovered(root: Path, saved: int) -> int:
    """No episode that was saved is missing, and none is there in part or twice; their number."""
    if not (root / "meta").exists():
        assert saved == 0
        return 0
    count = len(load_demonstrations(root, environment_state=None))
    assert count in (saved, saved + 1)  # one may have been saved and not yet reported
    assert_holds(root, count)
    return count


def check_kills(forks: ForkServerContext, root: Path, seeds: range) -> int:
    """Kill recordings into one dataset; one in two is completed by the next recording.

    Returns:
        The number of its episodes.
    """
    count = 0
    for seed in seeds:
        saved = kill_at_random(forks, root, count, seed)
        if seed % 2:
            recover(root)
        else:
            record(root, 0, 0)
        count = assert_recovered(root, saved)
    return count


def test_finished_episodes_outlive_kills(forks: ForkServerContext, tmp_path: Path):
    check_kills(forks, tmp_path / "new", range(4))


@pytest.mark.slow
def test_finished_episodes_outlive_a_hundred_kills(forks: ForkServerContext, tmp_path: Path):
    use_cache(tmp_path / "cache")
    for start in range(4, 104, 10):
        root = tmp_path / str(start)
        count = check_kills(forks, root, range(start, start + 10))
        assert_lerobot_reads(root, count)


def kill_at_each_step(
    forks: ForkServerContext, folder: Path, before: int, after: int
) -> list[tuple[int, Path]]:
    """What recording episodes leaves when it is killed before each of its operations.

    Returns:
        For each operation, the number of episodes that were saved by then, and the dataset.
    """
    record(folder / "old", 0, before)
    states = []
    for step in itertools.count():
        root = folder / str(step)
        if before:
            shutil.copytree(folder / "old", root)
        pipe, other = forks.Pipe(duplex=False)
        killed = dies(forks, step, root, record_and_tell, before, after, other)
        other.close()
        if not killed:
            return states
        states.append((last_of(pipe, before), root))
    raise AssertionError


@pytest.fixture(scope="module")
def states(
    forks: ForkServerContext, tmp_path_factory: pytest.TempPathFactory
) -> list[tuple[int, Path]]:
    """A dataset of two episodes, and two more being recorded."""
    return kill_at_each_step(forks, tmp_path_factory.mktemp("states"), 2, 4)


def copies(states: list[tuple[int, Path]], folder: Path) -> Iterator[tuple[int, Path]]:
    """The same states, one after the other, for a test to change."""
    assert len(states) > 25
    for saved, root in states:
        if root.exists():
            shutil.copytree(root, folder / root.name)
        yield saved, folder / root.name


def test_a_kill_before_any_operation_on_files_loses_nothing(
    states: list[tuple[int, Path]], tmp_path: Path
):
    for saved, root in copies(states, tmp_path):
        recover(root)
        assert_recovered(root, saved)


@pytest.mark.slow
def test_a_kill_while_a_dataset_is_created_loses_nothing(forks: ForkServerContext, tmp_path: Path):
    for saved, root in kill_at_each_step(forks, tmp_path, 0, 2):
        record(root, 0, 0)
        assert_recovered(root, saved)


@pytest.mark.slow
def test_a_recovery_that_is_killed_again_and_again_loses_nothing(
    forks: ForkServerContext, states: list[tuple[int, Path]], tmp_path: Path
):
    for saved, root in copies(states, tmp_path):
        for step in itertools.count():
            if not dies(forks, step, root, recover):
                break
        assert_recovered(root, saved)


@pytest.mark.slow
def test_lerobot_reads_the_dataset_in_whatever_state_a_kill_leaves_it(
    states: list[tuple[int, Path]], tmp_path: Path
):
    use_cache(tmp_path / "cache")
    for _, root in copies(states, tmp_path):
        assert_lerobot_reads(root, 2, 4)


def test_what_another_program_appended_after_a_kill_stays(
    states: list[tuple[int, Path]], tmp_path: Path
):
    """Killed at any instant but one, and then another writer came before the recovery."""
    left = 0
    for saved, root in copies(states, tmp_path):
        if not (root / "journal").exists():
            continue
        info = json.loads((root / "meta/info.json").read_bytes())
        moved = (root / "meta/episodes/chunk-000/file-001.parquet").exists()
        old = info["total_episodes"]
        if moved and old == 2:  # between the last two, which contradict one another
            left += 1
            continue
        (root / "journal").rename(tmp_path / "journal")
        record(root, 4, 5)
        (tmp_path / "journal").rename(root / "journal")
        recover(root)
        demonstrations = load_demonstrations(root, environment_state=None)
        count = len(demonstrations) - 1
        assert count in (saved, saved + 1)
        numbers = (*range(old), 4, *range(old, count))
        for number, one in zip(numbers, demonstrations, strict=True):
            np.testing.assert_array_equal(one.state, episode(number)["observation.state"])
    assert left == 1


def test_a_dataset_changed_between_the_last_two_moves_is_refused(
    states: list[tuple[int, Path]], tmp_path: Path
):
    for _, root in copies(states, tmp_path):
        path = root / "meta/info.json"
        moved = (root / "meta/episodes/chunk-000/file-001.parquet").exists()
        if moved and json.loads(path.read_bytes())["total_episodes"] == 2:
            path.write_bytes(path.read_bytes() + b"\n")  # another program's
            with pytest.raises(DatasetError, match=r"expected 2 episodes of .* found 4 of"):
                recover(root)
            assert len(list((root / "journal").glob("*.arrow"))) == 2
            return
    raise AssertionError


def test_the_last_file_to_reach_the_disk_need_not_be_the_last_that_was_moved(
    states: list[tuple[int, Path]], tmp_path: Path
):
    """The power went, and the description was on the disk before the episodes were."""
    for _, root in copies(states, tmp_path):
        if (root / "journal/fold.json").exists() and not (root / "journal/fold/4").exists():
            (root / "meta/episodes/chunk-000/file-001.parquet").rename(root / "journal/fold/3")
            with pytest.raises(DatasetError, match="2 episodes in its journal"):
                check_folded(root)
            recover(root)
            assert_holds(root, 4)
            return
    raise AssertionError


def test_readers_refuse_the_journal_of_a_killed_recording(states: list[tuple[int, Path]]):
    seen = []
    for saved, root in states:
        count = json.loads((root / "meta/info.json").read_bytes())["total_episodes"]
        try:
            check_folded(root)
        except DatasetError:
            assert count == 2
            seen.append("refused")
        else:
            assert count == saved
            seen.append("complete" if saved > 2 else "nothing saved")
    assert [key for key, _ in itertools.groupby(seen)] == ["nothing saved", "refused", "complete"]


@pytest.mark.parametrize("start", [0, 2])
def test_what_a_killed_recording_locked_is_free(
    forks: ForkServerContext, tmp_path: Path, start: int
):
    record(tmp_path / "new", 0, start)
    pipe, other = forks.Pipe(duplex=False)
    process = forks.Process(target=record_and_wait, args=(tmp_path / "new", start, other))
    process.start()
    assert pipe.recv() == start + 1
    with pytest.raises(BlockingIOError, match="another one is in progress"):
        record(tmp_path / "new", 0, 0)
    process.kill()
    process.join()
    record(tmp_path / "new", start + 1, start + 2)

    assert_holds(tmp_path / "new", start + 2)
