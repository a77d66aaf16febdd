"""Little pictures and videos for datasets in tests."""

import io
from pathlib import Path

import av
import numpy as np
from PIL import Image

SIDE = 16  # pixels


def pictures(length: int, first: int = 0) -> np.ndarray:
    """Return grey pictures `[T, 16, 16, 3]`: frame t has the shade 40 + 8 (first + t)."""
    shades = np.arange(first, first + length) * 8 + 40
    return np.broadcast_to(shades[:, None, None, None], (length, SIDE, SIDE, 3)).astype(np.uint8)


def write_video(path: Path, frames: np.ndarray, fps: int = 10, codec: str = "libx264") -> None:
    """Write frames `[T, H, W, 3]` of a whole number of frames per second, as H.264 unless asked."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with av.open(str(path), "w") as container:
        stream = container.add_stream(codec, fps, {"g": "2", "crf": "10"})
        stream.height, stream.width = frames.shape[1:3]
        stream.pix_fmt = "yuv420p"
        for frame in frames:
            container.mux(stream.encode(av.VideoFrame.from_ndarray(frame, format="rgb24")))
        container.mux(stream.encode())


def read_video(path: Path) -> np.ndarray:
    """Return the frames of a video `[T, H, W, 3]`."""
    with av.open(str(path)) as container:
        return np.stack([frame.to_ndarray(format="rgb24") for frame in container.decode(video=0)])


def png(frame: np.ndarray) -> bytes:
    """Return a picture `[H, W, 3]` as PNG."""
    content = io.BytesIO()
    Image.fromarray(frame).save(content, "png")
    return content.getvalue()
