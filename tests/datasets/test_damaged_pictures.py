"""Claims about pictures that are damaged, missing or of another kind: each is named."""

import sys
import warnings
from collections.abc import Callable
from pathlib import Path

import av
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from layouts import Shown, edit_info, write_v20, write_v21, write_v30
from PIL import Image
from video_files import pictures, png, write_video

from pacnet.datasets.demonstrations import load_demonstrations
from pacnet.datasets.format import DatasetError, DatasetWarning

TOP, WRIST = "observation.images.top", "observation.images.wrist"
LENGTH = 6


def noise(seed: int, size: tuple[int, int] = (32, 48)) -> np.ndarray:
    """Pictures `[T, H, W, 3]` that take many bytes."""
    return np.random.default_rng(seed).integers(0, 256, (LENGTH, *size, 3), dtype=np.uint8)


def episodes(number: int = 3, of: str = "videos", **more: np.ndarray) -> list[Shown]:
    rows = np.arange(2.0 * LENGTH).reshape(LENGTH, 2).astype("f4")
    values = {"observation.state": rows, "action": rows}
    return [Shown("look", values, **{of: {TOP: noise(seed), **more}}) for seed in range(number)]


def video(root: Path, episode: int) -> Path:
    return next(root.glob(f"videos/*/{TOP}/episode_{episode:06d}.mp4"))


def refused(root: Path, *expected: str) -> None:
    """Check that pictures are refused, with all of these in the message."""
    with pytest.raises(DatasetError) as error:
        load_demonstrations(root, cameras="all")
    for text in expected:
        assert text in str(error.value)


def cut(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:-400])


def empty(path: Path) -> None:
    path.write_bytes(b"")


def point(path: Path) -> None:
    path.write_text("version https://git-lfs.github.com/spec/v1\noid sha256:0\nsize 10\n")


def recode(path: Path) -> None:
    path.write_bytes(path.read_bytes().replace(b"avc1", b"zzzz"))


def scratch(path: Path) -> None:
    """Damage the second half of one picture, the rest of which can still be decoded."""
    with av.open(str(path)) as container:
        packet = next(one for one in container.demux(video=0) if one.pts == 2 / 10 / one.time_base)
    content, half = bytearray(path.read_bytes()), packet.size // 2
    content[packet.pos + half : packet.pos + packet.size] = b"\xff" * (packet.size - half)
    path.write_bytes(content)


def list_others(path: Path) -> None:
    path.write_text("ffconcat version 1.0\nfile episode_000000.mp4\n")  # which FFmpeg would follow


@pytest.mark.parametrize(
    ("damage", "reason"),
    [
        (cut, "cannot be read"),
        (empty, "is missing or empty"),
        (point, "run `git lfs pull`"),
        (recode, "codec"),
        (list_others, "Invalid data"),
        (scratch, "found 5 and none for frame 2"),
        (lambda path: write_video(path, noise(1)[:-1]), "6 frames, found 5 and none for frame 5"),
        (lambda path: write_video(path, noise(1)[:, :, :32]), "48x32 after they are reduced"),
    ],
    ids=["cut", "empty", "pointer", "codec", "playlist", "scratch", "short", "aspect"],
)
def test_a_damaged_video_names_its_episode(
    tmp_path: Path, damage: Callable[[Path], None], reason: str
):
    root = write_v21(tmp_path / "seen", episodes())
    damage(video(root, 1))
    refused(root, repr(TOP), "in episode 1", reason, "--skip-damaged", "--exclude 1")
    with pytest.warns(DatasetWarning, match="left out .episode 1.") as told:
        kept = load_demonstrations(root, cameras="all", skip_damaged=True)
    assert reason in str(told[0].message)
    assert [shown.episode for shown in kept] == [0, 2]
    excluded = load_demonstrations(root, cameras="all", exclude=[1])
    for one, other in zip(kept, excluded, strict=True):
        assert np.array_equal(one.pictures[TOP], other.pictures[TOP])
    assert len(load_demonstrations(root)) == 3  # without pictures


@pytest.mark.parametrize("damaged", [0, 1, 2])
def test_damage_within_a_file_leaves_its_other_episodes(tmp_path: Path, damaged: int):
    root = write_v30(tmp_path / "seen", episodes(), per_file=3)
    whole = load_demonstrations(root, cameras="all")
    path = next(root.glob(f"videos/{TOP}/*/*.mp4"))
    with av.open(str(path)) as container:
        packets = [packet for packet in container.demux(video=0) if packet.pts is not None]
    begin, end = (LENGTH * (damaged + offset) / 10 for offset in (0, 1))
    hit = [packet for packet in packets if begin <= packet.pts * packet.time_base < end - 0.01]
    assert len(hit) == LENGTH
    content = bytearray(path.read_bytes())
    for packet in hit:
        content[packet.pos : packet.pos + packet.size] = b"\xff" * packet.size
    path.write_bytes(content)
    refused(root, f"in episode {damaged} cannot be read")
    with pytest.warns(DatasetWarning, match=f"left out .episode {damaged}."):
        kept = load_demonstrations(root, cameras="all", skip_damaged=True)
    for shown in kept:
        assert np.array_equal(shown.pictures[TOP], whole.episodes[shown.episode].pictures[TOP])
    assert len(kept) == 2


def test_where_every_video_is_damaged_the_camera_is_left_out(tmp_path: Path):
    root = write_v21(tmp_path / "seen", episodes())
    for episode in range(3):
        cut(video(root, episode))
    refused(root, "in episodes 0-2")
    with pytest.warns(DatasetWarning, match=f"left out the camera '{TOP}'"):
        kept = load_demonstrations(root, cameras="all", skip_damaged=True)
    assert [shown.pictures for shown in kept] == [{}, {}, {}]
    with pytest.raises(DatasetError, match=f"the camera '{TOP}' cannot be read"):
        load_demonstrations(root, cameras="top", skip_damaged=True)


@pytest.mark.parametrize("write", [write_v20, write_v30])
def test_a_camera_without_files_is_left_out(tmp_path: Path, write):
    root = write(tmp_path / "seen", episodes())
    for path in root.glob("videos/**/*.mp4"):
        path.unlink()
    with pytest.warns(DatasetWarning, match="left out the camera .*: none of its files is there"):
        assert not load_demonstrations(root, cameras="all").episodes[0].pictures
    with pytest.raises(DatasetError, match="none of its files is there"):
        load_demonstrations(root, cameras=["top"])


def test_a_camera_may_be_in_some_episodes_only(tmp_path: Path):
    root = write_v21(tmp_path / "seen", episodes())
    video(root, 1).unlink()
    with pytest.warns(DatasetWarning, match=f"'{TOP}' is not in episode 1"):
        found = load_demonstrations(root, cameras="all")
    assert [[*shown.pictures] for shown in found] == [[TOP], [], [TOP]]


def test_a_missing_file_of_several_episodes_is_damage(tmp_path: Path):
    root = write_v30(tmp_path / "seen", episodes(), per_file=2)
    next(root.glob("videos/**/file-000.mp4")).unlink()
    refused(root, "in episodes 0-1", "is missing or empty")


def test_another_resolution_of_the_same_aspect_is_reduced_alike(tmp_path: Path):
    root = write_v21(tmp_path / "seen", episodes())
    shades = pictures(LENGTH)
    for episode, factor in enumerate((10, 20, 12)):
        write_video(video(root, episode), shades.repeat(factor, 1).repeat(factor, 2))
    for shown in load_demonstrations(root, cameras="all"):
        assert shown.pictures[TOP].shape == (LENGTH, 128, 128, 3)
        assert np.abs(shown.pictures[TOP] - shades[:, :1, :1].astype(int)).max() <= 2


def test_frames_are_found_by_their_time(tmp_path: Path):
    root = write_v21(tmp_path / "seen", episodes(1))  # 10 frames per second
    shades = pictures(2 * LENGTH)
    write_video(video(root, 0), shades, fps=20)
    found = load_demonstrations(root, cameras="all").episodes[0].pictures[TOP]
    assert np.abs(found - shades[::2].astype(int)).max() <= 2


def test_a_clip_of_another_length_is_refused(tmp_path: Path):
    root = write_v30(tmp_path / "seen", episodes())
    path = root / "meta/episodes/chunk-000/file-000.parquet"
    rows = pq.read_table(path).to_pylist()
    rows[1][f"videos/{TOP}/to_timestamp"] += 0.3
    pq.write_table(pa.Table.from_pylist(rows), path)
    refused(root, "in episode 1", "0.6 s of video for its 6 frames, found 0.9 s")


@pytest.mark.parametrize("place", ["info", "video_info"])
@pytest.mark.parametrize("name", ["is_depth_map", "video.is_depth_map"])
def test_a_declared_depth_camera_is_left_out(tmp_path: Path, place: str, name: str):
    root = write_v21(tmp_path / "seen", episodes())
    feature = {"dtype": "video", "shape": [32, 48, 3], place: {name: True}}
    numbers = {"dtype": "float32", "shape": [2], "names": None}
    edit_info(root, features={TOP: feature, "observation.state": numbers, "action": numbers})
    with pytest.warns(DatasetWarning, match="left out the camera .*: it measures distances"):
        assert not load_demonstrations(root, cameras="all").episodes[0].pictures


def test_a_video_of_depth_is_left_out(tmp_path: Path):
    root = write_v21(tmp_path / "seen", episodes(1))
    with av.open(str(video(root, 0)), "w", format="mov") as container:
        stream = container.add_stream("png", 10)
        stream.width, stream.height, stream.pix_fmt = 48, 32, "gray16be"
        for frame in noise(0)[..., 0]:
            picture = av.VideoFrame.from_ndarray(frame * np.uint16(256), format="gray16le")
            container.mux(stream.encode(picture.reformat(format="gray16be")))
        container.mux(stream.encode())
    with pytest.warns(DatasetWarning, match=r"left out the camera .* shows distances .gray16be"):
        assert not load_demonstrations(root, cameras="all").episodes[0].pictures


def test_a_grey_video_is_made_rgb(tmp_path: Path):
    root = write_v21(tmp_path / "seen", episodes(1))
    shades = pictures(LENGTH)
    with av.open(str(video(root, 0)), "w") as container:
        stream = container.add_stream("libx264", 10, {"crf": "5"})
        stream.width, stream.height, stream.pix_fmt = 16, 16, "gray"
        for frame in shades:
            container.mux(stream.encode(av.VideoFrame.from_ndarray(frame[..., 0], format="gray")))
        container.mux(stream.encode())
    found = load_demonstrations(root, cameras="all").episodes[0].pictures[TOP]
    assert (found[..., :1] == found).all()
    spread = (shades - 16.0) * 255 / 219  # what is not marked otherwise has black at 16
    assert np.abs(found - spread).max() <= 2


# Images


def with_images(root: Path, cells: list[dict[str, object]]) -> Path:
    """A dataset of one episode with these images."""
    write_v21(root, episodes(1, of="images"))
    path = next(root.glob("data/*/*.parquet"))
    table = pq.read_table(path)
    column = pa.array(cells, pa.struct({"bytes": pa.binary(), "path": pa.string()}))
    pq.write_table(table.set_column(table.column_names.index(TOP), TOP, column), path)
    return root


def files(root: Path, images: list[Image.Image], suffix: str = "png") -> list[dict[str, object]]:
    (root / "images").mkdir(parents=True)
    for number, image in enumerate(images):
        image.save(root / f"images/{number}.{suffix}")
    return [{"bytes": None, "path": f"images/{number}.{suffix}"} for number in range(len(images))]


def test_images_may_be_files_of_the_dataset(tmp_path: Path):
    root = tmp_path / "seen"
    with_images(root, files(root, [Image.fromarray(frame) for frame in noise(0)]))
    for change in (0, 1):  # they are not taken from the cache
        found = load_demonstrations(root, cameras="all").episodes[0].pictures[TOP]
        assert np.array_equal(found[0], noise(change)[0])
        Image.fromarray(noise(1)[0]).save(root / "images/0.png")


@pytest.mark.parametrize("place", ["../0.png", "/etc/hostname", "images/../../0.png"])
def test_no_image_outside_of_the_dataset_is_opened(tmp_path: Path, place: str):
    (tmp_path / "0.png").write_bytes(png(noise(0)[0]))
    root = with_images(tmp_path / "seen", [{"bytes": None, "path": place}] * LENGTH)
    refused(root, "in episode 0", "expected a path in the dataset")


@pytest.mark.parametrize("mode", ["L", "LA", "RGBA", "P", "1"])
def test_other_colours_become_rgb(tmp_path: Path, mode: str):
    images = [Image.fromarray(frame).convert(mode) for frame in noise(0)]
    root = tmp_path / "seen"
    with_images(root, files(root, images))
    found = load_demonstrations(root, cameras="all").episodes[0].pictures[TOP]
    expected = np.stack([np.asarray(image.convert("RGB")) for image in images])
    assert np.array_equal(found, expected)


def test_jpeg_is_read(tmp_path: Path):
    root = tmp_path / "seen"
    with_images(root, files(root, [Image.fromarray(frame) for frame in pictures(LENGTH)], "jpg"))
    found = load_demonstrations(root, cameras="all").episodes[0].pictures[TOP]
    assert np.abs(found - pictures(LENGTH).astype(int)).max() <= 2


def test_images_of_depth_are_left_out(tmp_path: Path):
    root = tmp_path / "seen"
    deep = [Image.fromarray(np.full((4, 4), 1000 * n, np.uint16)) for n in range(LENGTH)]
    with_images(root, files(root, deep))
    with pytest.warns(DatasetWarning, match="left out the camera .*shows distances"):
        assert not load_demonstrations(root, cameras="all").episodes[0].pictures


@pytest.mark.parametrize(
    ("cell", "reason"),
    [
        ({"bytes": b"", "path": None}, "expected a picture, found none"),
        ({"bytes": b"no picture", "path": None}, "expected a picture as PNG or JPEG"),
        ({"bytes": png(noise(0)[0])[:-300], "path": None}, "expected a picture as PNG or JPEG"),
        ({"bytes": b"GIF89a", "path": None}, "expected a picture as PNG or JPEG"),
        ({"bytes": None, "path": "images/absent.png"}, "cannot be read"),
        ({"bytes": png(np.zeros((1, 8200, 3), "u1")), "path": None}, "up to 8192 pixels"),
    ],
    ids=["none", "bytes", "cut", "gif", "absent", "large"],
)
def test_a_damaged_image_names_its_frame(tmp_path: Path, cell: dict[str, object], reason: str):
    sound: dict[str, object] = {"bytes": png(noise(0)[0]), "path": None}
    root = with_images(tmp_path / "seen", [sound, sound, cell, sound, sound, sound])
    refused(root, "in episode 0", "frame 2", reason)


@pytest.mark.parametrize(("module", "of"), [("av", "videos"), ("PIL", "images")])
def test_a_missing_decoder_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, module: str, of: str
):
    root = write_v21(tmp_path / "seen", episodes(of=of))
    for name in [name for name in sys.modules if name.split(".")[0] == module]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(DatasetError, match=r"pip install 'pacnet\[cameras\]'"):
        load_demonstrations(root, cameras="all", skip_damaged=True)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert len(load_demonstrations(root)) == 3
