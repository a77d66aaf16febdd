"""Claims about what a copy keeps of datasets in the layouts of v3.0, v2.1 and v2.0."""

import json
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from layouts import WRITERS, Shown
from video_files import pictures, read_video

from pacnet.datasets.annotations import check_annotatable, write_annotated
from pacnet.datasets.copying.write import os as copying_os
from pacnet.datasets.format import DatasetError, DatasetWarning
from pacnet.datasets.recorder import Feature, Recorder, recover

TOP, WRIST = "observation.images.top", "observation.images.wrist"
COLUMNS = {"novelty": ("novelty",)}
TASKS = ("reach", ["reach", "grasp", "grasp"], "grasp")


def shown(index: int) -> Shown:
    """Three frames that only this episode has."""
    values = {
        "observation.state": np.arange(6.0).reshape(3, 2) / 3 + index,  # float64
        "action": np.full(3, index, "f4"),
        "done": np.array([False, False, True]),
        "count": np.array([2**53 + 1, 2, index]),
        "note": ["a", "b", f"c{index}"],
        "pose": np.arange(12, dtype="f4").reshape(3, 2, 2) + index,
    }
    seen = pictures(3, 3 * index)
    return Shown(TASKS[index], values, images={WRIST: seen}, videos={TOP: seen})


EPISODES = [shown(index) for index in range(3)]


@pytest.fixture(params=WRITERS)
def source(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    return WRITERS[request.param](tmp_path / "source", EPISODES)


def annotate(source: Path, selected: Sequence[int] | None = None, **options: Any) -> Path:
    """A copy with the index of each episode's source as its novelty."""
    copy = source.parent / "copy"
    order = range(3) if selected is None else selected
    columns = [{"novelty": np.full((3, 1), index, "f4")} for index in order]
    write_annotated(source, copy, COLUMNS, columns, selected=selected, **options)
    return copy


def read(root: Path) -> dict[str, list[Any]]:
    """All frames of a copy, by column."""
    files = sorted((root / "data").glob("*/*.parquet"))
    return pa.concat_tables([pq.read_table(path) for path in files]).to_pydict()


def rows_of(root: Path) -> list[dict[str, Any]]:
    return pq.read_table(root / "meta/episodes/chunk-000/file-000.parquet").to_pylist()


def info_of(root: Path) -> dict[str, Any]:
    return json.loads((root / "meta/info.json").read_text())


def clips_of(root: Path) -> list[tuple[Path, float, float]]:
    """The video file of each episode of a copy, from and to which time."""
    places = [
        {name: row[f"videos/{TOP}/{name}"] for name in ("chunk_index", "file_index")}
        for row in rows_of(root)
    ]
    path = info_of(root)["video_path"]
    files = [root / path.format(video_key=TOP, **place) for place in places]
    times = [
        (row[f"videos/{TOP}/from_timestamp"], row[f"videos/{TOP}/to_timestamp"])
        for row in rows_of(root)
    ]
    return [(file, *time) for file, time in zip(files, times, strict=True)]


def video_files(root: Path) -> list[Path]:
    return sorted(path for path in root.rglob("*.mp4"))


def check(copy: Path, order: Sequence[int]) -> None:
    """Every value of a copy is that of the source's episodes in this order."""
    found = read(copy)
    for name in EPISODES[0].values:
        expected = [np.asarray(EPISODES[index].values[name]).tolist() for index in order]
        assert found[name] == [value for rows in expected for value in rows]
    assert found["novelty"] == np.repeat(order, 3).tolist()
    assert found["index"] == [*range(3 * len(order))]
    assert found["episode_index"] == np.repeat(np.arange(len(order)), 3).tolist()
    assert found["frame_index"] == [0, 1, 2] * len(order)
    np.testing.assert_array_equal(found["timestamp"], np.array([0, 0.1, 0.2] * len(order), "f4"))
    texts = pq.read_table(copy / "meta/tasks.parquet").to_pydict()["task"]
    tasks = [task for index in order for task in EPISODES[index].tasks]
    assert [texts[number] for number in found["task_index"]] == tasks
    assert texts == [*dict.fromkeys(tasks)]
    for (file, start, end), index in zip(clips_of(copy), order, strict=True):
        assert end - start == pytest.approx(0.3)
        seen = read_video(file)[round(start * 10) : round(end * 10)]
        assert np.abs(seen.astype(int) - EPISODES[index].videos[TOP]).max() <= 3


def test_a_copy_keeps_every_value_task_and_picture(source: Path):
    copy = annotate(source)

    check(copy, [0, 1, 2])
    info = info_of(copy)
    assert (info["codebase_version"], info["total_episodes"], info["total_frames"]) == (
        "v3.0",
        3,
        9,
    )
    kinds = {name: entry["dtype"] for name, entry in info["features"].items()}
    assert kinds["observation.state"] == "float64"
    assert (kinds["count"], kinds["note"], kinds["done"]) == ("int64", "string", "bool")
    assert (kinds[WRIST], kinds[TOP]) == ("image", "video")
    stored = pq.read_table(min((source / "data").glob("*/*.parquet"))).to_pydict()
    assert read(copy)[WRIST][:3] == stored[WRIST][:3]
    assert [row["tasks"] for row in rows_of(copy)] == [["reach"], ["reach", "grasp"], ["grasp"]]


@pytest.mark.parametrize("selected", [[1], [2, 0], [0, 2]])
def test_a_copy_has_the_selected_episodes_in_their_order(source: Path, selected: list[int]):
    check(annotate(source, selected), selected)


@pytest.mark.parametrize("selected", [[3], [0, 0], []])
def test_episodes_that_cannot_be_selected_are_refused(source: Path, selected: list[int]):
    with pytest.raises(ValueError, match="expected different episodes of 0-2, at least one, got"):
        annotate(source, selected)


def test_video_files_that_no_episode_needs_are_not_there(source: Path):
    assert len(video_files(annotate(source, [2]))) == 1


def test_the_last_episode_is_in_the_last_video_file(source: Path):
    """LeRobot appends behind it, and would replace a file of a higher number."""
    files = [file for file, *_ in clips_of(annotate(source, [2, 0]))]
    assert files == sorted(files)


def test_videos_are_the_same_files(source: Path):
    copy = annotate(source)

    known = {path.stat().st_ino: path for path in video_files(source)}
    for path in video_files(copy):
        assert path.samefile(known[path.stat().st_ino])


def test_videos_are_copied_where_they_cannot_be_linked(
    source: Path, monkeypatch: pytest.MonkeyPatch
):
    def fail(*_: object) -> None:
        raise OSError("another file system")

    monkeypatch.setattr(copying_os, "link", fail)
    copy = annotate(source)
    assert not {path.stat().st_ino for path in video_files(copy)} & {
        path.stat().st_ino for path in video_files(source)
    }
    assert {path.read_bytes() for path in video_files(copy)} == {
        path.read_bytes() for path in video_files(source)
    }


def test_statistics_are_of_the_frames_in_the_copy(source: Path):
    copy = annotate(source, [0, 2])

    found = json.loads((copy / "meta/stats.json").read_text())
    assert found["action"]["mean"] == [1.0]
    assert (found["action"]["min"], found["action"]["max"]) == ([0.0], [2.0])
    assert found["action"]["count"] == [6]
    assert found["pose"]["max"] == [12.0, 13.0]  # over the rows of the matrices
    assert rows_of(copy)[1]["stats/action/mean"] == [2.0]


def test_statistics_of_pictures_are_those_of_the_source(source: Path):
    copy = annotate(source)

    found = json.loads((copy / "meta/stats.json").read_text())
    for name in (TOP, WRIST):  # shades 40, 48, ..., 104
        np.testing.assert_allclose(found[name]["mean"], np.full((3, 1, 1), 72 / 255))
        np.testing.assert_allclose(found[name]["max"], np.full((3, 1, 1), 104 / 255))
        assert found[name]["count"] == [9]
    per_episode = [row[f"stats/{TOP}/mean"] for row in rows_of(copy)]
    if info_of(source)["codebase_version"] == "v2.0":  # which has them of all episodes together
        assert per_episode == [None] * 3
    else:
        shades = [[[[shade / 255]]] * 3 for shade in (48, 72, 96)]
        np.testing.assert_allclose(per_episode, np.reshape(shades, (3, 3, 1, 1)))


def test_statistics_that_cannot_be_true_are_not_carried_over(tmp_path: Path):
    source = WRITERS["v2.0"](tmp_path / "source", EPISODES)
    path = source / "meta/stats.json"
    stats = json.loads(path.read_text())
    stats[TOP]["min"] = [[[2.0]]] * 3  # above the mean
    stats[WRIST]["mean"] = [0.5]
    path.write_text(json.dumps(stats))
    with pytest.warns(DatasetWarning, match=f"no statistics of {TOP}, .*use_imagenet_stats=false"):
        copy = annotate(source)
    found = json.loads((copy / "meta/stats.json").read_text())
    assert TOP not in found
    assert WRIST not in found


@pytest.mark.parametrize("shift", [0.3, -0.08])
def test_frames_that_are_elsewhere_in_time_do_not_get_other_pictures(source: Path, shift: float):
    """Time would begin at 0 in the copy, and the picture of each frame be another."""
    path = sorted((source / "data").rglob("*.parquet"))[0]
    table = pq.read_table(path)
    times = table["timestamp"].to_numpy() + np.where(table["frame_index"].to_numpy() > 0, shift, 0)
    place = table.column_names.index("timestamp")
    pq.write_table(table.set_column(place, "timestamp", pa.array(times.astype("f4"))), path)
    with pytest.raises(DatasetError, match=r"frames at every 1/10 s.*--no-videos.*--exclude 0"):
        annotate(source)
    with pytest.warns(DatasetWarning, match="in the copy it runs evenly from 0"):
        annotate(source, videos=False)


@pytest.mark.parametrize(("start", "taken"), [(0.1, True), (0.2, False)])
def test_time_may_count_from_one_frame_on_but_not_from_later(
    source: Path, start: float, taken: bool
):
    for path in (source / "data").rglob("*.parquet"):
        table = pq.read_table(path)
        times = (table["timestamp"].to_numpy() + start).astype("f4")
        place = table.column_names.index("timestamp")
        pq.write_table(table.set_column(place, "timestamp", pa.array(times)), path)
    if taken:
        assert len(video_files(annotate(source))) > 0
    else:
        with pytest.raises(DatasetError, match="--exclude 0-2"):
            annotate(source)


def test_a_camera_without_any_file_is_left_out(source: Path):
    for path in video_files(source):
        path.unlink()
    with pytest.warns(DatasetWarning, match=f"{TOP}' of .* none of its video files"):
        copy = annotate(source)
    assert TOP not in info_of(copy)["features"]
    assert info_of(copy)["video_path"] is None


def test_a_camera_with_missing_files_is_refused_by_name(source: Path):
    missing = video_files(source)[-1]
    missing.unlink()
    name = "episode 2" if "episode" in missing.name else missing.name
    with pytest.raises(DatasetError, match=rf"{TOP}.*{name}.*--no-videos"):
        annotate(source)
    assert not (source.parent / "copy").exists()
    copy = annotate(source, videos=False)
    assert TOP not in info_of(copy)["features"]
    assert read(copy)["novelty"] == np.repeat([0, 1, 2], 3).tolist()


def test_missing_files_of_other_episodes_do_not_matter(source: Path):
    video_files(source)[-1].unlink()  # of episode 2 alone
    check(annotate(source, [1, 0]), [1, 0])


def test_a_pointer_in_place_of_a_video_is_refused(source: Path):
    pointer = "version https://git-lfs.github.com/spec/v1\noid sha256:0\nsize 1\n"
    video_files(source)[0].write_text(pointer)
    with pytest.raises(DatasetError, match="git lfs pull"):
        annotate(source)


def test_a_link_out_of_the_dataset_is_refused(source: Path, tmp_path: Path):
    path = video_files(source)[0]
    path.rename(tmp_path / "secret.mp4")
    path.symlink_to(tmp_path / "secret.mp4")
    with pytest.raises(DatasetError, match="a link to"):
        annotate(source)


def test_links_of_the_hubs_cache_are_followed(source: Path, tmp_path: Path):
    snapshot = tmp_path / "cache" / "datasets--me--mine" / "snapshots" / "1234"
    blobs = snapshot.parents[1] / "blobs"
    blobs.mkdir(parents=True)
    for number, path in enumerate(sorted(source.rglob("*.*"))):
        if path.is_file():
            path.rename(blobs / str(number))
            link = snapshot / path.relative_to(source)
            link.parent.mkdir(parents=True, exist_ok=True)
            link.symlink_to(os.path.relpath(blobs / str(number), link.parent))
    copy = annotate(snapshot)
    check(copy, [0, 1, 2])
    assert not any(path.is_symlink() for path in copy.rglob("*"))


def test_columns_that_are_not_declared_are_left_out(source: Path):
    for path in (source / "data").glob("*/*.parquet"):
        table = pq.read_table(path)
        pq.write_table(table.append_column("secret", table["index"]), path)
    with pytest.warns(DatasetWarning, match="'secret' .* not declared"):
        copy = annotate(source)
    assert "secret" not in read(copy)


UNFIT: dict[str, Mapping[str, Any]] = {
    "other shape": {"dtype": "float32", "shape": [2], "names": None},
    "other kind": {"dtype": "int64", "shape": [1], "names": None},
    "several texts": {"dtype": "string", "shape": [2], "names": None},
    "no dtype": {"shape": [1]},
    "no mapping": {"dtype": None, "shape": None},
}


@pytest.mark.parametrize("case", UNFIT)
def test_what_lerobot_cannot_hold_is_left_out(source: Path, case: str):
    info = info_of(source)
    info["features"]["action"] = UNFIT[case]
    (source / "meta/info.json").write_text(json.dumps(info))
    with pytest.warns(DatasetWarning, match="'action' of .* is left out"):
        copy = annotate(source)
    assert "action" not in {*read(copy), *info_of(copy)["features"]}


def test_a_list_of_one_number_becomes_that_number(source: Path):
    """LeRobot reads features of shape [1] as numbers, whatever other writers stored."""
    for path in (source / "data").glob("*/*.parquet"):
        table = pq.read_table(path)
        lists = pa.array([[value] for value in table["done"].to_pylist()])
        pq.write_table(table.set_column(table.column_names.index("done"), "done", lists), path)
    check(annotate(source), [0, 1, 2])


def test_frames_may_lie_anywhere_in_a_file(tmp_path: Path):
    source = WRITERS["v3.0"](tmp_path / "source", EPISODES)
    path = source / "data/chunk-000/file-000.parquet"
    pq.write_table(pq.read_table(path).take([4, 0, 3, 2, 5, 1]), path, row_group_size=4)
    check(annotate(source), [0, 1, 2])


def test_a_full_file_is_followed_by_another(tmp_path: Path):
    source = WRITERS["v3.0"](tmp_path / "source", EPISODES)
    info = info_of(source) | {"data_files_size_in_mb": 0.001, "chunks_size": 2}
    (source / "meta/info.json").write_text(json.dumps(info))
    copy = annotate(source)
    names = sorted(str(path.relative_to(copy / "data")) for path in copy.rglob("data/*/*.parquet"))
    assert names == [
        "chunk-000/file-000.parquet", "chunk-000/file-001.parquet", "chunk-001/file-000.parquet"
    ]  # fmt: skip
    check(copy, [0, 1, 2])


def test_progress_counts_the_frames(source: Path):
    done: list[int] = []
    annotate(source, [2, 1], progress=done.append)
    assert done == [3, 3]


def test_the_check_before_says_the_same(source: Path):
    contents = check_annotatable(source, COLUMNS, selected=[1])
    assert [episode.number for episode in contents.source.episodes] == [1]
    with pytest.raises(ValueError, match="does not have, got note"):
        check_annotatable(source, {"note": ("n",)})


def test_recorder_appends_to_a_copy(tmp_path: Path):
    numbers = [Shown("a", {"action": np.ones((2, 2), "f4")}) for _ in range(3)]
    source = WRITERS["v2.1"](tmp_path / "source", numbers)
    columns = [{"novelty": np.ones((2, 1))}] * 3
    write_annotated(source, tmp_path / "copy", COLUMNS, columns)
    features = {"action": ("d0", "d1"), "novelty": Feature(("novelty",))}
    with Recorder(tmp_path / "copy", 10, features) as recorder:
        recorder.save_episode("b", {"action": np.ones((1, 2)), "novelty": np.ones((1, 1))})
    assert recover(tmp_path / "copy") == 0
    assert info_of(tmp_path / "copy")["total_episodes"] == 4
