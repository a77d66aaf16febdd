"""Videos read back with the frames, the size and the frame rate that were written."""

import av
import numpy as np
import pytest
from PIL import Image

from train.common.video import write_gif, write_mp4

WRITERS = [(write_mp4, "film.mp4"), (write_gif, "film.gif")]


def film(count: int = 7, height: int = 48, width: int = 64):
    """A bright square that moves to the right over a dark ground, 8 pixels a frame."""
    for index in range(count):
        frame = np.full((height, width, 3), (20, 40, 60), dtype=np.uint8)
        frame[16:32, 8 * index : 8 * index + 16] = (250, 200, 30)
        yield frame


def read_mp4(path) -> tuple[list[np.ndarray], float]:
    with av.open(path) as file:
        frames = [frame.to_ndarray(format="rgb24") for frame in file.decode(video=0)]
        return frames, float(file.streams.video[0].average_rate)


def test_mp4_reads_back(tmp_path):
    path = write_mp4(film(), tmp_path / "film.mp4", fps=25)
    frames, rate = read_mp4(path)
    assert rate == 25
    assert len(frames) == 7
    for read, frame in zip(frames, film(), strict=True):
        assert read.shape == frame.shape
        assert np.abs(read.astype(int) - frame).mean() < 10  # H.264 loses a little
    with av.open(path) as file:
        assert file.streams.video[0].codec_context.pix_fmt == "yuv420p"


def test_gif_reads_back(tmp_path):
    path = write_gif(film(), tmp_path / "film.gif", fps=25)
    with Image.open(path) as picture:
        assert picture.n_frames == 7
        for index, frame in enumerate(film()):
            picture.seek(index)
            assert picture.info["duration"] == 40  # [ms]
            np.testing.assert_allclose(np.asarray(picture.convert("RGB")), frame, atol=2)
        assert picture.info["loop"] == 0


@pytest.mark.parametrize(("write", "name"), WRITERS)
def test_same_frames_same_bytes(tmp_path, write, name):
    first = write(film(), tmp_path / f"1{name}", 25).read_bytes()
    assert write(film(), tmp_path / f"2{name}", 25).read_bytes() == first


def test_a_fractional_frame_rate_is_kept(tmp_path):
    assert read_mp4(write_mp4(film(), tmp_path / "film.mp4", 12.5))[1] == 12.5


@pytest.mark.parametrize(("write", "name"), WRITERS)
def test_a_video_may_have_one_frame(tmp_path, write, name):
    assert write(film(1), tmp_path / name, 10).stat().st_size > 0


def broken_off():
    yield from film(3)
    raise KeyboardInterrupt("Ctrl-C")


def changing_size():
    yield from film(2)
    yield from film(1, height=50)


@pytest.mark.parametrize(("write", "name"), WRITERS)
@pytest.mark.parametrize(
    ("frames", "error", "message"),
    [
        (broken_off, KeyboardInterrupt, "Ctrl-C"),
        (changing_size, ValueError, r"frame 2 as \(48, 64, 3\) like the first, got \(50, 64, 3\)"),
        (list, ValueError, "one or more frames, got none"),
        (lambda: [np.zeros((4, 4, 3))], ValueError, "frame 0 as uint8 .* got float64"),
        (lambda: [np.zeros((4, 4, 4), np.uint8)], ValueError, r"got uint8 \(4, 4, 4\)"),
        (lambda: [np.zeros((4, 4), np.uint8)], ValueError, r"got uint8 \(4, 4\)"),
    ],
)
def test_an_interrupted_write_keeps_the_old_file_and_leaves_no_other(
    tmp_path, write, name, frames, error, message
):
    (tmp_path / name).write_bytes(b"the film before")
    with pytest.raises(error, match=message):
        write(frames(), tmp_path / name, 10)
    assert (tmp_path / name).read_bytes() == b"the film before"
    assert list(tmp_path.iterdir()) == [tmp_path / name]


def test_mp4_refuses_odd_sizes_which_a_gif_takes(tmp_path):
    with pytest.raises(ValueError, match="even height and width, got 47 x 63"):
        write_mp4(film(2, 47, 63), tmp_path / "film.mp4", 10)
    with Image.open(write_gif(film(2, 47, 63), tmp_path / "film.gif", 10)) as picture:
        assert picture.size == (63, 47)


@pytest.mark.parametrize(("write", "name"), WRITERS)
@pytest.mark.parametrize("fps", [0, -1, 1e-6, float("nan"), float("inf")])
def test_a_bad_frame_rate_is_refused(tmp_path, write, name, fps):
    with pytest.raises(ValueError, match="expected fps from"):
        write(film(), tmp_path / name, fps)


def test_gif_refuses_a_frame_rate_that_viewers_do_not_keep(tmp_path):
    with pytest.raises(ValueError, match="up to 50"):
        write_gif(film(), tmp_path / "film.gif", 60)
