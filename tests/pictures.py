"""Datasets with pictures, as LeRobot writes them, for the tests of whatever reads one."""

from pathlib import Path

import numpy as np

TOP = "observation.images.top"
LENGTHS = (3, 2)
# Red, green, blue of every frame, in 255ths: each frame has a colour of its own.
COLOURS = np.array([[40 * frame, 10 * frame, 200 - frame] for frame in range(sum(LENGTHS))])


def write_pictures(folder: Path, dtype: str) -> Path:
    """Two episodes, written by LeRobot, with an image of one colour in each frame."""
    from lerobot.datasets.lerobot_dataset import LeRobotDataset

    names = ["height", "width", "channels"]
    dataset = LeRobotDataset.create(
        "local/seen",
        fps=10,
        root=folder,
        features={
            TOP: {"dtype": dtype, "shape": (64, 96, 3), "names": names},
            "observation.state": {"dtype": "float32", "shape": (2,), "names": ["a", "b"]},
            "action": {"dtype": "float32", "shape": (2,), "names": ["c", "d"]},
        },
        use_videos=dtype == "video",
        video_backend="pyav",
    )
    for colour, is_last in zip(COLOURS, np.isin(np.arange(5), (2, 4)), strict=True):
        frame = {
            TOP: np.broadcast_to(colour.astype("u1"), (64, 96, 3)).copy(),
            "observation.state": colour[:2].astype("f4"),
            "action": colour[1:].astype("f4"),
            "task": "look",
        }
        dataset.add_frame(frame)
        if is_last:
            dataset.save_episode()
    dataset.finalize()
    return folder
