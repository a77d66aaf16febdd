"""Claims about datasets of unknown origin: their files are checked before they are used."""

import copy
import hashlib
import json
import os
import random
import shutil
import warnings
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from pacnet.datasets.annotations import check_annotatable, write_annotated
from pacnet.datasets.demonstrations import load_demonstrations
from pacnet.datasets.format import DatasetError, DatasetWarning
from pacnet.datasets.format.clips import Clips
from pacnet.datasets.format.paths import path_inside
from pacnet.datasets.journal import folding, staging
from pacnet.datasets.journal.episode_file import read_episode
from pacnet.datasets.journal.journal import acquire_lock
from pacnet.datasets.recorder import Feature, Recorder, recover

FEATURES = {
    "observation.state": ("x", "y"),
    "action": ("push",),
    "winner": Feature(("winner",), "int64"),
    "next.success": Feature(("success",), "bool"),
}
INFO, LIST, FIRST = "meta/info.json", "journal/fold.json", "journal/episode-000000.arrow"
EPISODES = "meta/episodes/chunk-000/file-000.parquet"
FRAMES = "data/chunk-000/file-000.parquet"


@pytest.fixture(autouse=True)
def without_waiting_for_the_disk(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("os.fsync", lambda _: None)


def save(recorder: Recorder, *numbers: int) -> None:
    for number in numbers:
        rows = np.full((3, 5), number)
        frames = {"observation.state": rows[:, :2] / 2, "action": rows[:, 2:3] / 2}
        others = {"winner": rows[:, 3:4], "next.success": rows[:, 4:] > 1}
        recorder.save_episode("task", frames | others)


def record(root: Path, *numbers: int) -> None:
    with Recorder(root, 10, FEATURES) as recorder:
        save(recorder, *numbers)


class KilledError(Exception):
    """Stands for the end of the process."""


def kill(*_: object) -> None:
    raise KilledError


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A dataset, the same with a journal of two episodes, and with these about to be moved."""
    folder = tmp_path_factory.mktemp("made")
    record(folder / "plain", 0, 1)
    for name, module, killed in (
        ("journal", folding, "Stage"),
        ("commit", staging, "finish_commit"),
    ):
        shutil.copytree(folder / "plain", folder / name)
        recorder = Recorder(folder / name, 10, FEATURES)
        recorder.__enter__()
        save(recorder, 2, 3)
        with pytest.MonkeyPatch.context() as patched:
            patched.setattr(module, killed, kill)
            with pytest.raises(KilledError):
                recorder.__exit__()
    return folder


@pytest.fixture
def top(tmp_path: Path) -> Path:
    """A folder with a file that must stay, beside a dataset from a stranger."""
    (tmp_path / "outside").mkdir()
    for name in ("precious", *"01234"):
        (tmp_path / "outside" / name).write_text("mine")
    return tmp_path


def copy_of(made: Path, top: Path) -> Path:
    shutil.rmtree(top / "sent", ignore_errors=True)
    return Path(shutil.copytree(made, top / "sent"))


OPENINGS: dict[str, Callable[[Path], object]] = {
    "load": load_demonstrations,
    "annotate": lambda root: check_annotatable(root, {"novelty": ("novelty",)}),
    "recover": recover,
    "record": lambda root: record(root, 9),
}
WRITERS = {name: OPENINGS[name] for name in ("recover", "record")}


def contents(folder: Path) -> dict[Path, bytes | None]:
    return {
        path: path.read_bytes() if path.is_file() and not path.is_symlink() else None
        for path in folder.rglob("*")
    }


def assert_refused(root: Path, act: Callable[[Path], object], message: str = "expected") -> None:
    """Before anything is changed, in the dataset or beside it."""
    before = contents(root.parent)
    with pytest.raises(DatasetError, match=message):
        act(root)
    assert contents(root.parent) == before


def change_json(path: Path, change: Callable[[Any], object]) -> None:
    document = json.loads(path.read_text())
    change(document)
    path.write_text(json.dumps(document))


# Places in the list of a commit

OUTSIDE = [
    "../outside/precious",
    "/etc/precious",
    "meta/../../outside/precious",
    "./meta/more.json",
    "meta//more.json",
    "meta",
    "meta/info.json/more",
    "data/chunk-000",
    "data/chunk-000/file-000.parquet/more",
    "journal/lock",
    "journal/fold/0",
    "nul\0",
    "c:\\precious",
    "half \ud800",
    "long" * 100,
    "",
    ".",
    None,
    7,
    ["meta/more.json"],
]


@pytest.mark.parametrize("outside", OUTSIDE)
@pytest.mark.parametrize("act", OPENINGS.values(), ids=OPENINGS)
def test_no_file_is_moved_out_of_the_dataset(
    made: Path, top: Path, outside: object, act: Callable[[Path], object]
):
    root = copy_of(made / "commit", top)
    change_json(root / LIST, lambda listed: listed["places"].__setitem__(0, outside))
    assert_refused(root, act, r"fold.json is damaged .*: without it, the whole")


@pytest.mark.parametrize("name", ["../../outside/precious", "../meta/info.json", "lock", "", 7])
@pytest.mark.parametrize("act", WRITERS.values(), ids=WRITERS)
def test_only_episodes_of_the_journal_are_deleted(
    made: Path, top: Path, name: object, act: Callable[[Path], object]
):
    root = copy_of(made / "commit", top)
    change_json(root / LIST, lambda listed: listed["folded"].append(name))
    assert_refused(root, act, "expected names of episodes' files")


COMMITS = {
    "a place in another": {"places": ["new", "new/more", INFO]},
    "a place twice": {"places": ["new", "new", INFO]},
    "another place last": {"places": [INFO, "new"]},
    "no places": {"places": []},
    "no names": {"folded": "episode-000000.arrow"},
    "no digest": {"info": ["0"]},
    "no new digest": {"new_info": 0},
}


@pytest.mark.parametrize("changes", COMMITS.values(), ids=COMMITS)
def test_a_list_is_checked_as_a_whole_before_anything_is_moved(
    made: Path, top: Path, changes: dict[str, object]
):
    root = copy_of(made / "commit", top)
    change_json(root / LIST, lambda listed: listed.update(changes))
    for act in OPENINGS.values():
        assert_refused(root, act, r"fold.json is damaged \(expected .*\): without it, the whole")


# Links


def link(root: Path, place: str, target: Path) -> None:
    path = root / place
    if path.is_dir():
        shutil.rmtree(path)
    path.unlink(missing_ok=True)
    path.symlink_to(target)


LINKS = {
    "journal": "outside",
    "journal/fold": "outside",
    "journal/fold/0": "outside/precious",
    "journal/fold.json": "outside/precious",
    "journal/lock": "outside/made",
    "journal/episode-000000.arrow.new": "outside/precious",
    "journal/episode-000002.arrow": "outside/precious",
    "data": "outside",
    "data/chunk-000": "outside",
    "data/chunk-000/file-001.parquet": "outside/made",
    "meta/stats.json": "outside/precious",
    "meta/tasks.parquet": "outside/made",
    "meta/episodes": "outside",
    "meta/info.json": "outside/made",
}


@pytest.mark.parametrize("linked", LINKS)
@pytest.mark.parametrize("act", WRITERS.values(), ids=WRITERS)
def test_nothing_is_written_moved_or_deleted_through_a_link(
    made: Path, top: Path, linked: str, act: Callable[[Path], object]
):
    root = copy_of(made / "commit", top)
    link(root, linked, top / LINKS[linked])
    assert_refused(root, act)


@pytest.mark.parametrize(
    "linked", [FRAMES, *(name for name in LINKS if not name.startswith("journal"))]
)
def test_nothing_is_recorded_into_a_dataset_with_links_out_of_it(
    made: Path, top: Path, linked: str
):
    root = copy_of(made / "plain", top)
    target = top / "moved"
    if (root / linked).exists():  # so that all can be read as before
        (root / linked).rename(target)
    link(root, linked, target)
    assert_refused(root, WRITERS["record"])


def test_a_link_at_the_second_new_file_is_refused(made: Path, top: Path):
    root = copy_of(made / "journal", top)
    change_json(root / INFO, lambda info: info.update(data_files_size_in_mb=1e-6))
    link(root, "data/chunk-000/file-002.parquet", top / "outside" / "made")
    before = contents(top / "outside")
    with pytest.raises(DatasetError, match=r"expected a path .* a link to .*made"):
        recover(root)
    assert contents(top / "outside") == before
    (root / "data/chunk-000/file-002.parquet").unlink()
    assert recover(root) == 2


@pytest.mark.parametrize("place_of_file", ["meta/stats.json", "data/chunk-000/file-001.parquet"])
def test_a_folder_in_place_of_a_file_is_refused_before_recording(
    made: Path, top: Path, place_of_file: str
):
    root = copy_of(made / "plain", top)
    (root / place_of_file).unlink(missing_ok=True)
    (root / place_of_file).mkdir()
    assert_refused(root, WRITERS["record"], "expected a file or nothing at")


@pytest.mark.parametrize("linked", ["meta/info.json", "meta", "data"])
def test_a_dataset_is_not_begun_through_a_link(made: Path, top: Path, linked: str):
    root = copy_of(made / "journal", top)
    for folder in ("data", "meta"):
        shutil.rmtree(root / folder)
    (root / linked).parent.mkdir(exist_ok=True)
    (root / linked).symlink_to(top / "made")
    assert_refused(root, recover, "expected a path in the dataset, found .* a link to .*made")


def test_links_may_be_read_and_the_folder_may_be_one(made: Path, top: Path):
    """As datasets lie in the cache of a hub: each file is a link to a folder beside."""
    root = copy_of(made / "plain", top)
    for path in [path for path in root.rglob("*") if path.is_file()]:
        target = top / "outside" / path.relative_to(root).as_posix().replace("/", "-")
        path.rename(target)
        path.symlink_to(target)
    assert len(load_demonstrations(root)) == 2

    root = copy_of(made / "plain", top)
    (top / "linked").symlink_to(root)
    record(top / "linked", 9)
    assert len(load_demonstrations(top / "linked")) == 3


@pytest.mark.skipif(not hasattr(os, "O_NOFOLLOW"), reason="needs the system to follow no links")
@pytest.mark.parametrize("target", ["outside/made", "outside/precious"])
def test_a_link_at_the_lock_is_not_followed(top: Path, target: str):
    (top / "journal").mkdir()
    (top / "journal" / "lock").symlink_to(top / target)
    with pytest.raises(OSError, match="lock"):
        acquire_lock(top)
    assert not (top / "outside" / "made").exists()


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="needs pipes")
@pytest.mark.parametrize("name", ["lock", "episode-000000.arrow", "fold.json"])
def test_a_pipe_in_the_journal_does_not_block(made: Path, top: Path, name: str):
    root = copy_of(made / "plain", top)
    (root / "journal").mkdir()
    os.mkfifo(root / "journal" / name)
    for act in OPENINGS.values():
        with pytest.raises(DatasetError, match="expected a file at"):
            act(root)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="needs pipes")
@pytest.mark.parametrize("name", [FRAMES, EPISODES, "meta/tasks.parquet", INFO])
def test_a_pipe_in_place_of_a_table_does_not_block(made: Path, top: Path, name: str):
    root = copy_of(made / "plain", top)
    (root / name).unlink()
    os.mkfifo(root / name)
    readers = [] if name == EPISODES else [load_demonstrations]
    for act in [*readers, WRITERS["record"]]:
        with pytest.raises(DatasetError, match=r"it is no file|is no LeRobot dataset"):
            act(root)


@pytest.mark.parametrize("name", ["episode-x.arrow", "episode-1.arrow", "episode-.arrow"])
def test_an_unknown_file_in_the_journal_is_refused(made: Path, top: Path, name: str):
    root = copy_of(made / "journal", top)
    (root / FIRST).rename(root / "journal" / name)
    for act in OPENINGS.values():
        assert_refused(root, act, f"expected files like .* found .*{name}: move it away")


# Templates of paths

TEMPLATES = [
    "../outside/{chunk_index}/{file_index}.parquet",
    "data/../../outside/chunk-{chunk_index}/file-{file_index}.parquet",
    "/etc/chunk-{chunk_index}/file-{file_index}.parquet",
    "data/chunk-{chunk_index.__class__}/file-{file_index}.parquet",
    "data/chunk-{chunk_index!r}/file-{file_index}.parquet",
    "data/chunk-{chunk_index:9999999999d}/file-{file_index}.parquet",
    "data/chunk-{chunk_index:{file_index}d}/file-{file_index}.parquet",
    "data/chunk-{chunk_index}/file-{file_index}-{more}.parquet",
    "data/chunk-{chunk_index}/file-{0}.parquet",
    "data/chunk-{chunk_index}/file-{}.parquet",
    "data/chunk-{chunk_index}/file-{file_index.parquet",
    "data/chunk-{chunk_index}/file.parquet",
    "data/file-{chunk_index}{file_index}.parquet",
    "data/chunk-{chunk_index}/file-{file_index}.parquet\0",
    "meta/episodes/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet",
    "journal/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet",
    "meta/info.json",
    "",
    None,
    7,
    ["data"],
]


@pytest.mark.parametrize("template", TEMPLATES)
def test_a_data_path_names_a_different_file_for_each_number(
    made: Path, top: Path, template: object
):
    root = copy_of(made / "journal", top)
    change_json(root / INFO, lambda info: info.update(data_path=template))
    for act in WRITERS.values():
        with pytest.raises(DatasetError, match="expected a data_path like data/chunk"):
            act(root)
    assert {path.name for path in top.iterdir()} == {"outside", "sent"}
    assert {path.read_text() for path in (top / "outside").iterdir()} == {"mine"}


@pytest.mark.parametrize(
    ("changes", "key"),
    [
        ({"video_path": "../{video_key}/{chunk_index:03d}/{file_index:03d}.mp4"}, "top"),
        ({"video_path": "videos/{video_key.__class__}.mp4"}, "top"),
        ({"video_path": "videos/{video_key}/{file_index}.mp4"}, "top"),
        ({"video_path": "/videos/{video_key}.mp4"}, "top"),
        ({}, "../top"),
        ({}, ".."),
    ],
)
def test_no_video_outside_of_the_dataset_is_opened(
    tmp_path: Path, changes: dict[str, object], key: str
):
    video_path = "videos/{video_key}/chunk-{chunk_index:03d}/file-{file_index:03d}.mp4"
    info = {"codebase_version": "v3.0", "video_path": video_path} | changes
    with pytest.raises(DatasetError, match=r"expected (a video_path|names of videos)"):
        Clips(tmp_path, info, [key])


def test_circular_links_and_existing_destinations(top: Path):
    (top / "circle").symlink_to(top / "circle")
    assert path_inside(top, "circle/file") == top / "circle" / "file"  # which cannot be opened
    (top / "copy").symlink_to(top / "nowhere")
    with pytest.raises(FileExistsError, match="expected a folder to be made"):
        write_annotated(top / "sent", top / "copy", {"novelty": ("novelty",)}, [])


# Other forms

FORMS = [None, True, -1, 0, 10**400, 1.5, "", "../x", "{0}", "\ud800", [], [-1], [[1]], {"a": [1]}]


def mutations(document: Any, most: int) -> list[str]:
    """The document as JSON with one part, however deep, missing, there twice or of another form."""
    found = []

    def walk(part: Any) -> None:
        for key in list(part) if isinstance(part, dict) else range(len(part)):
            whole = copy.copy(part)
            for form in [*FORMS, [whole[key]]]:
                part[key] = form
                found.append(json.dumps(document))
            del part[key]
            found.append(json.dumps(document))
            part.clear()
            part.update(whole) if isinstance(part, dict) else part.extend(whole)
            if isinstance(part[key], dict | list):
                walk(part[key])

    walk(document)
    return random.Random(0).sample(found, min(most, len(found)))


BROKEN = ["", "[", "[]", "null", "7", '"places"', "\0", "[" * 10**5, '{"features": [' * 10**5]


def open_and_leave(root: Path) -> None:
    with Recorder(root, 10, FEATURES):
        pass


def test_a_description_of_any_form_is_read_or_refused(made: Path, top: Path):
    root = copy_of(made / "plain", top)
    document = json.loads((root / INFO).read_text())
    before, refused = contents(top), 0
    for text in [*BROKEN, *mutations(document, 200)]:
        (root / INFO).write_text(text)
        for act in (load_demonstrations, open_and_leave):
            try:
                with warnings.catch_warnings():
                    warnings.simplefilter("ignore", DatasetWarning)
                    act(root)
            except ValueError:
                refused += 1
    (root / INFO).write_bytes(before[root / INFO] or b"")
    assert contents(top) == before
    assert 150 < refused < 400


DESCRIPTIONS: dict[str, Callable[[dict[str, Any]], object]] = {
    "chunks_size above 0": lambda info: info.update(chunks_size=0),
    "chunks_size .* True": lambda info: info.update(chunks_size=True),
    "data_files_size_in_mb above 0": lambda info: info.update(data_files_size_in_mb="100"),
    "data_files_size_in_mb .* inf": lambda info: info.update(data_files_size_in_mb=float("inf")),
    "'action' with a dtype": lambda info: info["features"].update(action=["float32", [1]]),
    "'action' .* 'shape': []": lambda info: info["features"]["action"].update(shape=[]),
    "'action' .*'dtype': []": lambda info: info["features"]["action"].update(dtype=[]),
    "'timestamp' as one float32": lambda info: info["features"].pop("timestamp"),
    "'index' as one int64": lambda info: info["features"]["index"].update(shape=[2]),
    "no features": lambda info: info["features"].update(task=info["features"]["index"]),
    "JSON in UTF-8": lambda info: info.update(more="\ud800"),
    "JSON in UTF-8 .* not JSON": lambda info: info.update(more=float("nan")),
}


@pytest.mark.parametrize("message", DESCRIPTIONS)
def test_what_new_frames_need_is_checked_before_any_is_recorded(
    made: Path, top: Path, message: str
):
    root = copy_of(made / "plain", top)
    change_json(root / INFO, DESCRIPTIONS[message])
    assert_refused(root, WRITERS["record"], f"expected .*{message.replace('[', '.')}")


def test_a_list_of_a_commit_of_any_form_is_read_or_refused(made: Path, top: Path):
    root = copy_of(made / "commit", top)
    document = json.loads((root / LIST).read_text())
    before, refused = contents(top), 0
    for text in [*BROKEN, *mutations(document, 10**6)]:
        (root / LIST).write_text(text)
        try:
            staging.is_complete(root / "journal")
        except DatasetError:
            refused += 1
    (root / LIST).write_bytes(before[root / LIST] or b"")
    assert contents(top) == before
    assert refused > 100


def write_episode(path: Path, table: pa.Table) -> None:
    """With a checksum, which anybody can compute."""
    sink = pa.BufferOutputStream()
    with pa.ipc.new_stream(sink, table.schema) as writer:
        writer.write_table(table)
    stored = sink.getvalue().to_pybytes()
    path.write_bytes(stored + hashlib.sha256(stored).digest())


def stored_table(path: Path) -> pa.Table:
    with pa.ipc.open_stream(path.read_bytes()[:-32]) as reader:
        return reader.read_all()


def test_an_episode_of_any_description_is_read_or_refused(made: Path, top: Path):
    path = copy_of(made / "journal", top) / FIRST
    table, refused = stored_table(path), 0
    for text in [*BROKEN, *mutations(json.loads(table.schema.metadata[b"pacnet"]), 10**6)]:
        write_episode(path, table.replace_schema_metadata({"pacnet": text}))
        try:
            read_episode(path)
        except DatasetError:
            refused += 1
    assert refused > 300


def redescribed(table: pa.Table, **changes: object) -> pa.Table:
    header = json.loads(table.schema.metadata[b"pacnet"]) | changes
    return table.replace_schema_metadata({"pacnet": json.dumps(header)})


CHANGES: dict[str, Callable[[pa.Table], pa.Table]] = {
    "no task": lambda table: redescribed(table, task=" "),
    "half a letter": lambda table: redescribed(table, task="\ud800"),
    "no description": lambda table: table.replace_schema_metadata(None),
    "no frames": lambda table: table.slice(0, 0),
    "no column": lambda table: table.drop_columns(["action"]),
    "another column": lambda table: table.append_column("more", table["action"]),
    "words": lambda table: table.set_column(1, "action", pa.array(["push"] * 3)),
    "doubles": lambda table: table.set_column(1, "action", pa.array([1.0] * 3)),
    "gaps": lambda table: table.set_column(1, "action", pa.array([1, None, 2], pa.float32())),
    "infinite": lambda table: table.set_column(1, "action", pa.array([np.inf] * 3, pa.float32())),
}


@pytest.mark.parametrize("change", CHANGES.values(), ids=CHANGES)
def test_an_episode_of_another_form_is_refused(
    made: Path, top: Path, change: Callable[[pa.Table], pa.Table]
):
    root = copy_of(made / "journal", top)
    write_episode(root / FIRST, change(stored_table(root / FIRST)))
    assert_refused(root, recover, "holds no episode .*: once it is moved away, the rest can be")


def test_an_episode_of_another_recording_is_refused(made: Path, top: Path):
    root = copy_of(made / "journal", top)
    other = redescribed(stored_table(root / FIRST), fps=20)
    write_episode(root / "journal/episode-000001.arrow", other)
    with pytest.raises(DatasetError, match=r"of another recording than episode-000000\.arrow"):
        recover(root)


@pytest.mark.parametrize("value", [1, 128])
def test_an_episode_with_changed_bytes_is_read_or_refused(made: Path, top: Path, value: int):
    """What is read lies in the file, however long the file says that it is."""
    path = copy_of(made / "journal", top) / FIRST
    content = path.read_bytes()[:-32]
    for at in range(len(content)):
        changed = content[:at] + bytes([value]) + content[at + 1 :]
        path.write_bytes(changed + hashlib.sha256(changed).digest())
        with suppress(DatasetError):
            read_episode(path)[2].validate(full=True)


@pytest.mark.parametrize("fps", [2**31, 10**400])
def test_the_recorder_stores_nothing_that_cannot_be_read(tmp_path: Path, fps: int):
    with pytest.raises(ValueError, match=r"fps as an integer below 2\*\*31, got"):
        Recorder(tmp_path / "new", fps, FEATURES)
    with pytest.raises(ValueError, match=r"'action' of dtype float32, int64, bool, got \['bool'\]"):
        Recorder(tmp_path / "new", 10, {"action": Feature(("push",), ["bool"])})  # pyright: ignore


# Tables

Values = list[Any] | pa.Array


def replace(path: Path, name: str, values: Values) -> None:
    table = pq.read_table(path)
    at = table.column_names.index(name)
    pq.write_table(table.set_column(at, name, pa.array(values)), path)


@pytest.mark.parametrize("values", [[0.0] * 2, [-1] * 2, [2**60] * 2, ["0"] * 2, [[0, 0]] * 2])
@pytest.mark.parametrize(
    "name", ["data/file_index", "meta/episodes/chunk_index", "dataset_to_index"]
)
def test_invalid_file_numbers(made: Path, top: Path, name: str, values: Values):
    root = copy_of(made / "plain", top)
    replace(root / EPISODES, name, values)
    assert_refused(root, WRITERS["record"], f"expected (integers|numbers).* in '{name}'")


def test_a_new_file_would_replace_an_old_one(made: Path, top: Path):
    root = copy_of(made / "plain", top)
    (root / "data/chunk-000/file-001.parquet").write_bytes((root / FRAMES).read_bytes())
    replace(root / EPISODES, "data/file_index", [1, 0])
    change_json(root / INFO, lambda info: info.update(total_frames=12))
    replace(root / EPISODES, "dataset_to_index", [6, 12])
    assert_refused(
        root, WRITERS["record"], "expected the last episode in the last of its data files"
    )

    root = copy_of(made / "plain", top)
    (root / EPISODES).rename(root / "meta/episodes/chunk-000/file-001.parquet")
    assert_refused(root, WRITERS["record"], "file-001.parquet to be numbered in meta/episodes")


@pytest.mark.parametrize("numbers", [[True], [0.0], ["0"], [None]])
def test_tasks_without_indices(made: Path, top: Path, numbers: Values):
    root = copy_of(made / "plain", top)
    replace(root / "meta/tasks.parquet", "task_index", numbers)
    for act in (load_demonstrations, WRITERS["record"]):
        assert_refused(root, act, "expected tasks as index, text")


def test_no_frames_are_counted_by_an_integer(made: Path, top: Path):
    root = copy_of(made / "plain", top)
    shutil.rmtree(root / "data")
    shutil.rmtree(root / "meta/episodes")
    counts = dict.fromkeys(("total_frames", "total_episodes"), False)
    change_json(root / INFO, lambda info: info.update(counts))
    assert_refused(root, WRITERS["record"], "expected total_frames as an integer, found False")


@pytest.mark.parametrize("rows", [0, 1])
def test_missing_episodes(made: Path, top: Path, rows: int):
    root = copy_of(made / "plain", top)
    pq.write_table(pq.read_table(root / EPISODES).slice(0, rows), root / EPISODES)
    assert_refused(root, WRITERS["record"], "expected .*episodes")


@pytest.mark.parametrize(
    "kind", [pa.struct([("a", pa.int64())]), pa.map_(pa.string(), pa.int64()), pa.date32()]
)
def test_columns_that_no_new_episode_fits_into(made: Path, top: Path, kind: pa.DataType):
    root = copy_of(made / "plain", top)
    replace(root / EPISODES, "stats/action/mean", pa.nulls(2, kind))
    assert_refused(root, WRITERS["record"], "expected columns in meta/episodes that new episodes")


@pytest.mark.parametrize("file", [FRAMES, EPISODES, "meta/tasks.parquet"])
def test_two_columns_of_one_name(made: Path, top: Path, file: str):
    root = copy_of(made / "plain", top)
    table = pq.read_table(root / file)
    for name in table.column_names:
        table = table.append_column(name, table[name])
    pq.write_table(table, root / file)
    for act in OPENINGS.values() if file != EPISODES else [WRITERS["record"]]:
        if act is not recover:
            assert_refused(root, act, "columns of different names")


@pytest.mark.parametrize("name", ["index", "episode_index", "task_index"])
@pytest.mark.parametrize(
    "values", [[0.5] * 6, [float("nan")] * 6, [-1] * 6, pa.array([2**63] * 6, pa.uint64())]
)
def test_invalid_indices(made: Path, top: Path, name: str, values: Values):
    root = copy_of(made / "plain", top)
    replace(root / FRAMES, name, values)
    assert_refused(root, load_demonstrations, f"expected integers .*in '{name}'")


# Sizes that are declared


@pytest.mark.parametrize("feature", ["observation.state", "action", "winner"])
@pytest.mark.parametrize("names", [None, ["x", "y"]])
def test_a_shape_is_compared_with_the_files(
    made: Path, top: Path, feature: str, names: list[str] | None
):
    """The names of its dimensions would not fit into memory."""
    root = copy_of(made / "plain", top)
    entry = {"shape": [10**12], "names": names}
    change_json(root / INFO, lambda info: info["features"][feature].update(entry))
    options = {"state": feature, "action": feature, "environment_state": None}
    with pytest.warns(DatasetWarning, match="the shape \\[1000000000000\\]"):
        demonstrations = load_demonstrations(root, **options)
    assert demonstrations.names[feature] in (("0", "1"), ("0",))
    with pytest.raises(ValueError, match=r"expected .* as .* in"):
        record(root, 9)


@pytest.mark.parametrize("name", ["total_frames", "total_episodes"])
@pytest.mark.parametrize("count", [10**12, 10**300, True])
def test_counts_are_compared_with_the_files(made: Path, top: Path, name: str, count: int):
    root = copy_of(made / "plain", top)
    change_json(root / INFO, lambda info: info.update({name: count}))
    with pytest.warns(DatasetWarning, match=r"counts (10{12}|10+\.\.\.0+|True) "):
        assert len(load_demonstrations(root)) == 2
    assert_refused(root, WRITERS["record"])


def test_frames_per_second_beyond_floats(made: Path, top: Path):
    root = copy_of(made / "plain", top)
    change_json(root / INFO, lambda info: info.update(fps=10**400))
    with pytest.warns(DatasetWarning, match=r"no valid fps \(10+\.\.\.0+\): the timestamps say 10"):
        assert load_demonstrations(root).fps == 10


def test_more_rows_than_a_file_can_hold(made: Path, top: Path):
    root, count = copy_of(made / "plain", top), 10**7
    pq.write_table(pa.table({"index": np.zeros(count, "i8")}), root / FRAMES)
    for act in (load_demonstrations, WRITERS["record"]):
        assert_refused(root, act, f"expected rows that fit, found {count} in")
