"""Claims about the pictures of cameras: each in its place, in every layout, reduced."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from layouts import WRITERS, Shown, write_v21
from video_files import pictures, write_video

from pacnet.datasets.demonstrations import load_demonstrations
from pacnet.datasets.format import DatasetError

TOP, WRIST, SIDE = (f"observation.images.{name}" for name in ("top", "wrist", "side"))
LENGTHS = (5, 3, 4)


def episode(number: int) -> Shown:
    """An episode with a camera in video files and one in the data files."""
    length, first = LENGTHS[number], sum(LENGTHS[:number])
    rows = np.arange(2.0 * length).reshape(length, 2).astype("f4")
    frames = pictures(length, first)
    return Shown(
        "look",
        {"observation.state": rows, "action": rows},
        images={WRIST: 255 - frames},
        videos={TOP: frames},
    )


@pytest.fixture(scope="module", params=[*WRITERS])
def root(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("cameras") / "seen"
    return WRITERS[request.param](folder, [episode(number) for number in range(len(LENGTHS))])


def test_each_frame_has_its_picture(root: Path):
    demonstrations = load_demonstrations(root, cameras="all")
    first = 0
    for shown, length in zip(demonstrations, LENGTHS, strict=True):
        expected = pictures(length, first).astype(int)
        assert set(shown.pictures) == {TOP, WRIST}
        assert shown.pictures[TOP].shape == shown.pictures[WRIST].shape == (length, 16, 16, 3)
        assert shown.pictures[TOP].dtype == np.uint8
        # Shades differ by 8 from frame to frame; video coding keeps them to 2.
        assert np.abs(shown.pictures[TOP] - expected).max() <= 2
        assert np.array_equal(shown.pictures[WRIST], 255 - expected)
        first += length


def test_chosen_episodes_have_their_own_pictures(root: Path):
    whole = load_demonstrations(root, cameras=["top", "wrist"])
    chosen = load_demonstrations(root, cameras=["top", "wrist"], episodes=[2])
    for camera in (TOP, WRIST):
        assert np.array_equal(
            chosen.episodes[0].pictures[camera], whole.episodes[2].pictures[camera]
        )


@pytest.mark.parametrize("write", [*WRITERS.values()])
def test_videos_that_were_not_asked_for_are_not_opened(write, tmp_path: Path):
    shown = [episode(number) for number in range(len(LENGTHS))]
    two = [replace(one, videos={TOP: one.videos[TOP], SIDE: one.videos[TOP]}) for one in shown]
    root = write(tmp_path / "seen", two)
    whole = load_demonstrations(root, cameras="top").episodes[2].pictures[TOP]
    # The third episode is in the last file, alone.
    _, *others = sorted(root.glob(f"videos/**/*{TOP}*/**/*.mp4"), reverse=True)
    for path in [*others, *root.glob(f"videos/**/*{SIDE}*/**/*.mp4")]:
        path.write_bytes(b"no video")
    chosen = load_demonstrations(root, cameras="top", episodes=[2])
    assert np.array_equal(chosen.episodes[0].pictures[TOP], whole)
    with pytest.raises(DatasetError, match="cannot be read"):
        load_demonstrations(root, cameras="top", episodes=[1, 2])


def test_cameras_are_chosen_by_name_or_its_last_part(root: Path):
    assert all(not shown.pictures for shown in load_demonstrations(root))
    for cameras in ("top", ["top"], [TOP], [TOP, "top"]):
        shown = load_demonstrations(root, cameras=cameras).episodes[0]
        assert [*shown.pictures] == [TOP]
    with pytest.raises(DatasetError, match=rf"of the dataset \({WRIST}, {TOP}\), got 'left'"):
        load_demonstrations(root, cameras=["left"])


def test_a_part_of_an_episode_has_its_pictures(root: Path):
    whole = load_demonstrations(root, cameras="all").episodes[0]
    part = whole.part(1, 3)
    for camera in (TOP, WRIST):
        assert np.array_equal(part.pictures[camera], whole.pictures[camera][1:3])


def test_av1_is_read(tmp_path: Path):
    root = write_v21(tmp_path / "seen", [episode(0)])
    path = next(root.glob("videos/**/*.mp4"))
    write_video(path, pictures(LENGTHS[0]).repeat(4, 1).repeat(4, 2), codec="libsvtav1")
    found = load_demonstrations(root, cameras="top").episodes[0].pictures[TOP]
    assert found.shape == (LENGTHS[0], 64, 64, 3)
    assert np.abs(found - pictures(LENGTHS[0])[:, :1, :1].astype(int)).max() <= 2
