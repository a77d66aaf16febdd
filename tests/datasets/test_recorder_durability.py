"""Claims about what is on the disk, and in which order, so that a loss of power takes nothing."""

import os
from pathlib import Path

import numpy as np
import pytest

from pacnet.datasets.recorder import Recorder

pytestmark = pytest.mark.skipif(
    not Path("/proc/self/fd").exists(), reason="needs the names of open files"
)

FEATURES = {"observation.state": ("x", "y"), "action": ("push",)}
EPISODE = {"observation.state": np.zeros((3, 2)), "action": np.ones((3, 1))}
Event = tuple[str, Path]


@pytest.fixture
def events(monkeypatch: pytest.MonkeyPatch) -> list[Event]:
    """What is flushed to the disk, what a file is moved to and what is deleted, as it happens.

    A file is flushed under the name from which it is moved, and moved from that one.
    """
    happened: list[Event] = []
    replace, unlink = Path.replace, Path.unlink

    def note_flush(handle: int) -> None:
        happened.append(("flush", Path(f"/proc/self/fd/{handle}").readlink()))

    def note_move(path: Path, target: Path) -> Path:
        happened.extend([("from", path), ("to", target)])
        return replace(path, target)

    def note_deletion(path: Path, missing_ok: bool = False) -> None:
        if os.path.lexists(path):
            happened.append(("delete", path))
        unlink(path, missing_ok)

    monkeypatch.setattr(os, "fsync", note_flush)
    monkeypatch.setattr(Path, "replace", note_move)
    monkeypatch.setattr(Path, "unlink", note_deletion)
    return happened


def test_an_episode_is_on_the_disk_when_it_is_saved(tmp_path: Path, events: list[Event]):
    folder = tmp_path.resolve() / "runs" / "new"
    with Recorder(folder, 10, FEATURES) as recorder:
        opened = list(events)
        events.clear()
        recorder.save_episode("task", EPISODE)
        saved = list(events)

    # each folder that was made is an entry of the one above it
    assert {("flush", path) for path in (folder, folder.parent, tmp_path.resolve())} <= {*opened}
    episode = folder / "journal" / "episode-000000.arrow"
    fresh = episode.with_name("episode-000000.arrow.new")
    assert saved == [
        ("flush", fresh), ("from", fresh), ("to", episode), ("flush", folder / "journal"),
    ]  # fmt: skip


@pytest.mark.parametrize("before", [0, 1])
def test_files_are_on_the_disk_before_the_fold_goes_on(
    tmp_path: Path, events: list[Event], before: int
):
    folder = tmp_path.resolve() / "new"
    for _ in range(before):
        with Recorder(folder, 10, FEATURES) as recorder:
            recorder.save_episode("task", EPISODE)
    with Recorder(folder, 10, FEATURES) as recorder:
        recorder.save_episode("task", EPISODE)
        events.clear()

    journal, info = folder / "journal", folder / "meta" / "info.json"
    moved = {path: at for at, (kind, path) in enumerate(events) if kind == "to"}
    listed = moved[journal / "fold.json"]
    assert len(moved) == 6  # info, statistics, tasks, episodes, frames, and the list of them
    deleted = events.index(("delete", journal / "episode-000000.arrow"))
    for target, at in moved.items():
        assert ("flush", events[at - 1][1]) in events[:at]
        last = deleted if at >= moved[info] - 2 else moved[info]
        assert ("flush", target.parent) in events[at:last]
    assert ("flush", journal) in events[listed : min(set(moved.values()) - {listed})]
    assert events[: listed - 2].index(("flush", journal / "fold")) > max(
        events.index(("flush", journal / "fold" / str(number))) for number in range(5)
    )
    for made in ("", "data", "meta", "meta/episodes"):
        assert ("flush", folder / made) in events[listed : moved[info]]
    # nothing comes between the episodes and what counts them
    assert events[moved[info] - 2][1].parent.parent == folder / "meta" / "episodes"
    assert ("flush", folder / "meta") in events[moved[info] : deleted]
    assert ("flush", journal) in events[deleted : events.index(("delete", journal / "fold.json"))]
