"""Claims about recorded pictures: they become videos, and nothing finished is lost."""

import json
import os
import signal
import sys
from multiprocessing.context import ForkServerContext
from pathlib import Path

import av
import numpy as np
import pyarrow.parquet as pq
import pytest
from video_files import read_video

from pacnet.datasets.annotations import write_annotated
from pacnet.datasets.demonstrations import load_demonstrations
from pacnet.datasets.format import DatasetError
from pacnet.datasets.format.shades import Shades
from pacnet.datasets.journal import video_files
from pacnet.datasets.recorder import Picture, Recorder, recover

TOP, WRIST = "observation.images.top", "observation.images.wrist"
FEATURES = {
    "observation.state": ("x", "y"),
    "action": ("u", "v"),
    TOP: Picture(64, 96),  # AV1 takes no less than 64
    WRIST: Picture(64, 64),
}
RED = (200, 30, 30)
EPISODES = "meta/episodes/chunk-000/file-000.parquet"


@pytest.fixture(autouse=True)
def without_waiting_for_the_disk(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("os.fsync", lambda _: None)


def episode(seed: int, length: int = 5) -> dict[str, np.ndarray]:
    """An episode with smooth pictures, which a video keeps to a few shades."""
    rng = np.random.default_rng(seed)
    frames = {name: rng.normal(size=(length, 2)) for name in ("observation.state", "action")}
    for name, size in ((TOP, (64, 96)), (WRIST, (64, 64))):
        slope = np.linspace(20, 200, size[1])[:, None] + rng.uniform(0, 50, (length, 1, 1, 3))
        frames[name] = np.broadcast_to(slope, (length, *size, 3)).astype(np.uint8)
    return frames


def record(root: Path, *seeds: int, **features: Picture) -> None:
    with Recorder(root, 10, FEATURES | features) as recorder:
        for seed in seeds:
            recorder.save_episode("look", episode(seed, 4 + seed))


def assert_holds(root: Path, *seeds: int) -> None:
    demonstrations = load_demonstrations(root, cameras="all")
    for shown, seed in zip(demonstrations, seeds, strict=True):
        frames = episode(seed, 4 + seed)
        np.testing.assert_array_equal(shown.state, frames["observation.state"].astype("f4"))
        for camera in (TOP, WRIST):
            difference = shown.pictures[camera].astype(int) - frames[camera]
            assert np.abs(difference).max() <= 8
            assert np.abs(difference).mean() < 2  # neighbouring episodes differ by some 15


def test_what_is_recorded_is_read(tmp_path: Path):
    record(tmp_path / "new", 0, 1, 2)
    assert_holds(tmp_path / "new", 0, 1, 2)
    assert {path.name for path in (tmp_path / "new").iterdir()} == {"data", "meta", "videos"}
    path = tmp_path / "new/videos" / TOP / "chunk-000/file-000.mp4"
    assert len(read_video(path)) == 4 + 5 + 6
    rows = pq.read_table(tmp_path / "new" / EPISODES).to_pylist()
    bounds = [[row[f"videos/{TOP}/{name}_timestamp"] for name in ("from", "to")] for row in rows]
    assert bounds == [[0, 0.4], [0.4, 0.9], [0.9, 1.5]]
    entry = json.loads((tmp_path / "new/meta/info.json").read_text())["features"][TOP]
    assert (entry["dtype"], entry["shape"]) == ("video", [64, 96, 3])
    assert entry["info"]["video.codec"] == "h264"


def colours_of(root: Path) -> str:
    """Return what meta/info.json says of a camera's colours."""
    return json.loads((root / "meta/info.json").read_text())["features"][WRIST]["info"][
        "video.pix_fmt"
    ]


def test_the_colour_of_a_small_thing_is_kept(tmp_path: Path):
    """Three pixels of red; with halved colours their mean is off by 50 and more."""
    frames = episode(0)
    frames[WRIST][:, 30:33, 31:34] = RED
    with Recorder(tmp_path / "new", 10, FEATURES) as recorder:
        recorder.save_episode("look", frames)
    (shown,) = load_demonstrations(tmp_path / "new", cameras="all")
    seen = shown.pictures[WRIST][:, 30:33, 31:34].mean(axis=(0, 1, 2))
    np.testing.assert_allclose(seen, RED, atol=20)
    assert colours_of(tmp_path / "new") == "yuv444p"


def test_large_pictures_are_as_everybody_plays_them(tmp_path: Path):
    with Recorder(tmp_path / "new", 10, FEATURES | {WRIST: Picture(64, 258)}) as recorder:
        recorder.save_episode("look", episode(0) | {WRIST: np.zeros((5, 64, 258, 3), np.uint8)})
    assert colours_of(tmp_path / "new") == "yuv420p"


def test_a_dataset_keeps_its_colours(tmp_path: Path):
    """Of a dataset that others began: what it says of its videos stays true."""
    record(tmp_path / "new", 0)
    path = tmp_path / "new/meta/info.json"
    path.write_text(path.read_text().replace("yuv444p", "yuv420p"))
    record(tmp_path / "new", 1)
    found = []
    for name in ("file-000.mp4", "file-001.mp4"):
        with av.open(tmp_path / "new/videos" / TOP / "chunk-000" / name) as file:
            found.append(file.streams.video[0].codec_context.pix_fmt)
    assert found == ["yuv444p", "yuv420p"]


def test_frame_by_frame(tmp_path: Path):
    with Recorder(tmp_path / "new", 10, FEATURES) as recorder:
        for seed in (0, 9, 1):
            frames = episode(seed, 4 + seed)
            reused = {name: np.array(rows[0]) for name, rows in frames.items()}
            for at in range(4 + seed):
                for name, rows in frames.items():
                    reused[name][...] = rows[at]
                recorder.add_frame(reused)  # which is a copy
            if seed == 9:
                recorder.clear_episode()
            else:
                recorder.save_episode("look")
    assert_holds(tmp_path / "new", 0, 1)


def test_more_is_recorded_behind_it(tmp_path: Path):
    record(tmp_path / "new", 0, 1)
    record(tmp_path / "new", 2)
    assert_holds(tmp_path / "new", 0, 1, 2)
    files = sorted(path.name for path in (tmp_path / "new/videos" / TOP / "chunk-000").iterdir())
    assert files == ["file-000.mp4", "file-001.mp4"]
    stored = json.loads((tmp_path / "new/meta/stats.json").read_text())[TOP]
    whole = np.concatenate([episode(seed, 4 + seed)[TOP] for seed in range(3)]) / 255
    assert stored["count"] == [15]
    for name in ("min", "max", "mean", "std"):
        expected = getattr(np, name)(whole, axis=(0, 1, 2)).reshape(3, 1, 1)
        np.testing.assert_allclose(stored[name], expected, atol=1e-12)


def test_a_full_file_is_followed_by_another(tmp_path: Path):
    record(tmp_path / "new", 0)
    path = tmp_path / "new/meta/info.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | {"video_files_size_in_mb": 1e-5}))
    record(tmp_path / "new", 1, 2)
    assert_holds(tmp_path / "new", 0, 1, 2)
    assert len([*(tmp_path / "new/videos" / TOP).rglob("*.mp4")]) == 3


def test_it_is_copied_with_annotations(tmp_path: Path):
    record(tmp_path / "new", 0, 1)
    novelty = [{"novelty": np.zeros((4 + seed, 1))} for seed in (0, 1)]
    write_annotated(tmp_path / "new", tmp_path / "copy", {"novelty": ("novelty",)}, novelty)
    assert_holds(tmp_path / "copy", 0, 1)


def kill_at(root: Path, calls: int) -> None:
    """Record three episodes, and be killed while the videos are encoded."""
    add, left = video_files.VideoFiles.add, [calls]

    def fatal(self: video_files.VideoFiles, images: list[bytes]):
        left[0] -= 1
        if not left[0]:
            os.kill(os.getpid(), signal.SIGKILL)
        return add(self, images)

    video_files.VideoFiles.add = fatal  # in this process alone
    record(root, 0, 1, 2)


@pytest.mark.parametrize("calls", [1, 3, 5])
def test_nothing_is_lost_when_it_is_killed_while_it_encodes(
    tmp_path: Path, forks: ForkServerContext, calls: int
):
    root = tmp_path / "new"
    process = forks.Process(target=kill_at, args=(root, calls))
    process.start()
    process.join()
    assert process.exitcode == -signal.SIGKILL
    with pytest.raises(DatasetError, match="has 3 episodes in its journal"):
        load_demonstrations(root, cameras="all")
    assert recover(root) == 3
    assert_holds(root, 0, 1, 2)
    assert {path.name for path in root.iterdir()} == {"data", "meta", "videos"}


def test_an_image_that_is_none_keeps_the_journal(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    root = tmp_path / "new"
    with monkeypatch.context() as patch:
        patch.setattr("pacnet.datasets.journal.image_queue.encode_png", lambda _: b"none")
        with pytest.raises(DatasetError, match="expected a picture as PNG or JPEG"):
            record(root, 0)
    assert [*(root / "journal").glob("*.arrow")]


@pytest.mark.parametrize(
    ("name", "got"),
    [
        (TOP, np.zeros((5, 64, 96, 3), np.float32)),
        (TOP, np.zeros((5, 3, 64, 96), np.uint8)),
        (TOP, np.zeros((5, 96, 64, 3), np.uint8)),
        (TOP, np.zeros((4, 64, 96, 3), np.uint8)),
        (TOP, np.zeros((0, 64, 96, 3), np.uint8)),
        (TOP, [None] * 5),
    ],
)
def test_what_is_no_picture_is_refused(tmp_path: Path, name: str, got: object):
    with Recorder(tmp_path / "new", 10, FEATURES) as recorder:
        with pytest.raises(ValueError, match=r"expected 'observation.images.top' as uint8|as many"):
            recorder.save_episode("look", episode(0) | {name: got})
        frame = {key: rows[0] for key, rows in episode(0).items()}
        with pytest.raises(ValueError, match=rf"frame 0: expected '{TOP}' as uint8"):
            recorder.add_frame(frame | {name: np.zeros((3, 64, 96), np.uint8)})
    assert not (tmp_path / "new").exists()


@pytest.mark.parametrize(
    ("features", "message"),
    [
        ({TOP: Picture(31, 48)}, "an even height and width, 2 to 8192 pixels, got .*31"),
        ({TOP: Picture(0, 48)}, "an even height and width"),
        ({TOP: Picture(16384, 48)}, "an even height and width"),
        ({TOP: Picture(32.0, 48)}, "an even height and width"),  # pyright: ignore
        ({"a/b": Picture(32, 48)}, "without '/'"),
        ({"..": Picture(32, 48)}, "other than '.', '..'"),
        ({"c:top": Picture(32, 48)}, "name of a camera without ':'"),
        ({"x" * 101: Picture(32, 48)}, "of 100 bytes at most"),
    ],
)
def test_what_is_no_camera_is_refused(tmp_path: Path, features: dict[str, Picture], message: str):
    with pytest.raises(ValueError, match=message):
        Recorder(tmp_path / "new", 10, {"action": ("u",), **features})


def test_numbers_are_wanted_beside_pictures(tmp_path: Path):
    with pytest.raises(ValueError, match="expected at least one feature"):
        Recorder(tmp_path / "new", 10, {TOP: Picture(32, 48)})


def test_another_camera_is_not_recorded_behind_it(tmp_path: Path):
    record(tmp_path / "new", 0)
    with pytest.raises(ValueError, match=r"as video of shape \[64, 96, 3\] .* got pictures of"):
        record(tmp_path / "new", 1, **{TOP: Picture(48, 32)})
    with pytest.raises(ValueError, match=r"expected the features .*got"):
        record(tmp_path / "new", 1, **{"observation.images.left": Picture(48, 32)})
    stray = tmp_path / "new/videos" / TOP / "chunk-000/file-001.mp4"
    stray.touch()
    with pytest.raises(DatasetError, match=r"file-001.mp4 shows no episode: move it away"):
        record(tmp_path / "new", 1)


@pytest.mark.parametrize("module", ["av", "PIL"])
def test_a_missing_codec_is_named_before_anything_is_recorded(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, module: str
):
    for name in [name for name in sys.modules if name.split(".")[0] == module]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(DatasetError, match=r"pip install 'pacnet\[cameras\]'"):
        Recorder(tmp_path / "new", 10, FEATURES)


def test_shades_are_counted():
    pictures = np.random.default_rng(0).integers(0, 256, (3, 5, 7, 3)).astype(np.uint8) // 3
    shades = Shades()
    for picture in pictures:
        shades.add(picture)
    found = shades.statistics()
    levels = pictures.reshape(-1, 3) / 255
    expected = {"min": levels.min(0), "max": levels.max(0)}
    expected |= {"mean": levels.mean(0), "std": levels.std(0)}
    for share in (1, 10, 50, 90, 99):
        expected[f"q{share:02d}"] = np.quantile(levels, share / 100, axis=0)
    for name, values in expected.items():
        np.testing.assert_allclose(found[name], values.reshape(3, 1, 1), atol=1e-12, err_msg=name)
    assert found["count"].tolist() == [3]


# LeRobot


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:The video decoding and encoding:UserWarning")
def test_lerobot_reads_it_and_records_behind_it(tmp_path: Path):
    from lerobot.datasets.lerobot_dataset import LeRobotDataset

    root = tmp_path / "new"
    record(root, 0, 1)
    record(root, 2)
    dataset = LeRobotDataset("local/new", root=root, video_backend="pyav")
    at = 0
    for seed in range(3):
        for number, picture in enumerate(episode(seed, 4 + seed)[TOP]):
            frame = dataset[at + number]
            got = frame[TOP].permute(1, 2, 0).numpy() * 255
            assert np.abs(got - picture).mean() < 2
            assert int(frame["episode_index"]) == seed
        at += 4 + seed
    assert dataset.meta.stats[TOP]["mean"].shape == (3, 1, 1)

    save_with_lerobot(dataset, 3, 7)
    dataset.finalize()
    assert_holds(root, 0, 1, 2, 3)
    record(root, 4)
    assert_holds(root, 0, 1, 2, 3, 4)


def save_with_lerobot(dataset, seed: int, count: int) -> None:
    """Let LeRobot save an episode of so many frames."""
    for number in range(count):
        frame = {
            name: rows[number].astype("u1" if rows.ndim == 4 else "f4")
            for name, rows in episode(seed, count).items()
        }
        dataset.add_frame(frame | {"task": "look"})
    dataset.save_episode()


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:The video decoding and encoding:UserWarning")
def test_it_is_recorded_behind_lerobot(tmp_path: Path):
    from lerobot.datasets.lerobot_dataset import LeRobotDataset

    root = tmp_path / "new"
    names = ["height", "width", "channels"]
    features = {
        camera: {"dtype": "video", "shape": FEATURES[camera].shape, "names": names}
        for camera in (TOP, WRIST)
    }
    for name in ("observation.state", "action"):
        features[name] = {"dtype": "float32", "shape": (2,), "names": [*FEATURES[name]]}
    dataset = LeRobotDataset.create(
        "local/new", fps=10, root=root, features=features, video_backend="pyav"
    )
    for seed in (0, 1):
        save_with_lerobot(dataset, seed, 4 + seed)
    dataset.finalize()
    record(root, 2)
    assert_holds(root, 0, 1, 2)
    again = LeRobotDataset("local/new", root=root, video_backend="pyav")
    assert len(again) == 15
    assert np.abs(again[14][TOP].permute(1, 2, 0).numpy() * 255 - episode(2, 6)[TOP][5]).mean() < 2
