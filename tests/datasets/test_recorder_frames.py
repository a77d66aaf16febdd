"""Claims about recording an episode frame by frame."""

import os
from multiprocessing.context import ForkServerContext
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pacnet.datasets.demonstrations import load_demonstrations
from pacnet.datasets.journal.journal import check_folded
from pacnet.datasets.recorder import Feature, Recorder

FEATURES = {
    "observation.state": ("x", "y"),
    "action": ("push",),
    "winner": Feature(("winner",), "int64"),
    "next.success": Feature(("success",), "bool"),
}


@pytest.fixture(autouse=True)
def without_waiting_for_the_disk(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("os.fsync", lambda _: None)


def open_recorder(root: Path) -> Recorder:
    return Recorder(root, 10, FEATURES)


def frame_at(time: int) -> dict[str, Any]:
    """Numbers and vectors of one, by turns, where there is one dimension."""
    one = (lambda value: value) if time % 2 else (lambda value: [value])
    return {
        "observation.state": np.array([time, -time], "f4"),
        "action": one(0.5 * time),
        "winner": one(2**60 + time),
        "next.success": one(time == 2),
    }


def episode(length: int) -> dict[str, np.ndarray]:
    """The same frames as a whole episode."""
    time = np.arange(length)[:, None]
    return {
        "observation.state": np.hstack([time, -time]).astype("f4"),
        "action": 0.5 * time,
        "winner": 2**60 + time,
        "next.success": time == 2,
    }


def add_frames(recorder: Recorder, count: int) -> None:
    for time in range(count):
        recorder.add_frame(frame_at(time))


def lengths(root: Path) -> list[int]:
    return [len(one.state) for one in load_demonstrations(root)]


def test_frame_by_frame_is_the_same_bytes_as_at_once(tmp_path: Path):
    with open_recorder(tmp_path / "frames") as recorder:
        for count in (3, 1):
            add_frames(recorder, count)
            recorder.save_episode("task")
    with open_recorder(tmp_path / "episodes") as recorder:
        for count in (3, 1):
            recorder.save_episode("task", episode(count))

    files = [
        {path.relative_to(root): path.read_bytes() for path in root.rglob("*.*") if path.is_file()}
        for root in (tmp_path / "frames", tmp_path / "episodes")
    ]
    assert files[0] == files[1]
    assert len(files[0]) == 5


def test_an_episode_of_frames_is_safe_once_it_is_saved(tmp_path: Path):
    with open_recorder(tmp_path / "new") as recorder:
        add_frames(recorder, 3)
        check_folded(tmp_path / "new")  # nothing is written yet
        recorder.save_episode("task")
        with pytest.raises(ValueError, match="1 episodes in its journal"):
            check_folded(tmp_path / "new")


def test_what_is_cleared_is_not_saved(tmp_path: Path):
    with open_recorder(tmp_path / "new") as recorder:
        add_frames(recorder, 3)
        recorder.clear_episode()
        with pytest.raises(ValueError, match="expected frames, given here or added before, got n"):
            recorder.save_episode("task")
        add_frames(recorder, 2)
        recorder.save_episode("task")
        with pytest.raises(ValueError, match="got none"):
            recorder.save_episode("task")

    assert lengths(tmp_path / "new") == [2]


def test_an_unfinished_episode_is_dropped(tmp_path: Path):
    recorder = open_recorder(tmp_path / "new")
    with recorder:
        add_frames(recorder, 2)
        recorder.save_episode("task")
        add_frames(recorder, 3)
    with recorder:
        add_frames(recorder, 4)
        recorder.save_episode("task")

    assert lengths(tmp_path / "new") == [2, 4]


def test_frames_are_either_given_or_added(tmp_path: Path):
    with open_recorder(tmp_path / "new") as recorder:
        add_frames(recorder, 2)
        with pytest.raises(ValueError, match="expected no frames, as 2 were added: save them fir"):
            recorder.save_episode("task", episode(3))
        with pytest.raises(ValueError, match="expected the task in words"):
            recorder.save_episode(" ")
        recorder.save_episode("task")
        recorder.save_episode("task", episode(3))

    assert lengths(tmp_path / "new") == [2, 3]


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (
            {"action": np.nan},
            r"frame 2: expected 'action' as .* of shape \[1\] and finite, got \[n",
        ),
        ({"observation.state": [0.0, np.inf]}, r"frame 2: .*finite, got \[0.0, inf\]"),
        (
            {"observation.state": [0.0]},
            r"'observation.state' as .* of shape \[2\], got shape \[1\]",
        ),
        ({"observation.state": 0.0}, r"of shape \[2\], got shape \[\]"),
        ({"action": [[0.0]]}, r"'action' as .* of shape \[1\], got shape \[1, 1\]"),
        ({"action": 1}, "'action' as float32 or float64 .*got dtype int64"),
        ({"winner": 1.0}, "'winner' as integers .*got dtype float64"),
        ({"winner": np.uint64(2**63)}, r"'winner' .* below 2\*\*63, got 9223"),
        ({"next.success": 1}, "'next.success' as booleans .*got dtype int64"),
        ({"torque": 1.0}, "expected the features .*torque"),
    ],
)
def test_a_frame_that_does_not_fit_is_refused_at_once(
    tmp_path: Path, changes: dict[str, Any], message: str
):
    with open_recorder(tmp_path / "new") as recorder:
        add_frames(recorder, 2)
        with pytest.raises(ValueError, match=message):
            recorder.add_frame(frame_at(2) | changes)
        recorder.add_frame(frame_at(2))
        recorder.save_episode("task")

    assert lengths(tmp_path / "new") == [3]


def test_a_measurement_may_be_written_over(tmp_path: Path):
    state = np.zeros(2, "f4")
    with open_recorder(tmp_path / "new") as recorder:
        for time in range(3):
            state[:] = time
            recorder.add_frame(frame_at(time) | {"observation.state": state})
        recorder.save_episode("task")

    (one,) = load_demonstrations(tmp_path / "new")
    assert one.state.tolist() == [[0, 0], [1, 1], [2, 2]]


def test_frames_of_an_episode_that_the_disk_refuses_may_be_saved_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    def refuse(*_: object) -> None:
        raise OSError("full")

    with open_recorder(tmp_path / "new") as recorder:
        add_frames(recorder, 3)
        with monkeypatch.context() as patched:
            patched.setattr("pacnet.datasets.journal.journal.write_atomically", refuse)
            with pytest.raises(OSError, match="full"):
                recorder.save_episode("task")
        recorder.save_episode("task")

    assert lengths(tmp_path / "new") == [3]


def test_outside_the_with_block(tmp_path: Path):
    recorder = open_recorder(tmp_path / "new")
    for act in (lambda: recorder.add_frame(frame_at(0)), recorder.clear_episode):
        with pytest.raises(RuntimeError, match="inside the recorder's `with` block"):
            act()


def add_in_a_fork(root: Path) -> None:
    with open_recorder(root) as recorder:
        add_frames(recorder, 2)
        child = os.fork()
        if child == 0:
            for act in (lambda: recorder.add_frame(frame_at(0)), recorder.clear_episode):
                with pytest.raises(RuntimeError, match="in the process that entered"):
                    act()
            os._exit(0)
        assert os.waitpid(child, 0)[1] == 0
        recorder.save_episode("task")


@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs forks")
def test_a_fork_adds_nothing(forks: ForkServerContext, tmp_path: Path):
    process = forks.Process(target=add_in_a_fork, args=(tmp_path / "new",))
    process.start()
    process.join()

    assert process.exitcode == 0
    assert lengths(tmp_path / "new") == [2]
