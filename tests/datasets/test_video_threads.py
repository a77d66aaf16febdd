"""A video is decoded in the thread that asks: others could wait for Python's lock for ever."""

import sys
from pathlib import Path

import numpy as np
import pytest
from video_files import write_video

from pacnet.datasets.pictures.video_file import VideoFile


def threads() -> list[str]:
    """Names of the threads of this process."""
    return [one.read_text() for one in Path("/proc/self/task").glob("*/comm")]


@pytest.mark.skipif(sys.platform != "linux", reason="threads are listed by Linux alone")
@pytest.mark.parametrize("codec", ["libx264", "libsvtav1"])
def test_no_thread_decodes_beside_the_one_that_asks(tmp_path: Path, codec: str):
    frames = np.random.default_rng(0).integers(0, 256, (20, 64, 96, 3), dtype=np.uint8)
    write_video(tmp_path / "a.mp4", frames, codec=codec)
    video = VideoFile(tmp_path / "a.mp4")
    seen = next(video.frames(0.0, 20, 10.0))
    during = threads()
    video.close()
    assert seen[0] == 0
    assert not [name for name in during if name.startswith(("av:", "dav1d"))]
