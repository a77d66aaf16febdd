"""LeRobot opens a copy, decodes its pictures, appends to it, and converts v2.1 to the same."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from layouts import WRITERS, Shown, write_v21
from test_copies import EPISODES, TOP, WRIST, annotate
from video_files import pictures

pytestmark = pytest.mark.slow


@pytest.fixture(autouse=True)
def _cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("datasets.config.HF_DATASETS_CACHE", tmp_path / "cache")


def lerobot(root: Path, **options: Any) -> Any:
    from lerobot.datasets.lerobot_dataset import LeRobotDataset

    return LeRobotDataset("local/copy", root=root, video_backend="pyav", **options)


def appendable(root: Path) -> Any:
    """The dataset open for writing; LeRobot's default codec cannot encode pictures this small."""
    from lerobot.datasets.lerobot_dataset import LeRobotDataset

    if not hasattr(LeRobotDataset, "resume"):
        return lerobot(root, vcodec="h264")
    from lerobot.configs.video import RGBEncoderConfig

    encoder = RGBEncoderConfig(vcodec="h264")
    return LeRobotDataset.resume("local/copy", root=root, rgb_encoder=encoder)


def check(frame: dict[str, Any], episode: Shown, time: int) -> None:
    """A frame as LeRobot reads it is that of the episode."""
    assert frame["task"] == episode.tasks[time]
    for name, values in episode.values.items():
        value = values[time]  # LeRobot gives every float out as float32
        expected = np.float32(value) if np.asarray(values).dtype == np.float64 else value
        np.testing.assert_array_equal(frame[name], expected)
    for name, seen in {WRIST: episode.images[WRIST], TOP: episode.videos[TOP]}.items():
        shade = float(seen[time].mean()) / 255
        assert float(frame[name].mean()) == pytest.approx(shade, abs=0.01)


@pytest.mark.filterwarnings("ignore")  # LeRobot's own
@pytest.mark.parametrize("version", WRITERS)
@pytest.mark.parametrize("selected", [[0, 1, 2], [2, 0]])
def test_lerobot_reads_a_copy_and_appends_to_it(tmp_path: Path, version: str, selected: list[int]):
    copy = annotate(WRITERS[version](tmp_path / "source", EPISODES), selected)
    writer = appendable(copy)
    for _ in range(2):  # the second time it joins the video to that of the first
        for time in range(3):
            frame = {name: np.atleast_1d(rows[time]) for name, rows in EPISODES[1].values.items()}
            pixels = {TOP: pictures(3)[time], WRIST: pictures(3)[time]}
            more = {"note": "new", "count": np.ones(1, int), "novelty": np.zeros(1, "f4")}
            writer.add_frame(frame | pixels | more | {"task": "new"})
        writer.save_episode(parallel_encoding=False)
    writer.finalize()

    dataset = lerobot(copy)
    assert dataset.num_episodes == len(selected) + 2
    for row in range(3 * len(selected)):
        episode, time = divmod(row, 3)
        check(dataset[row], EPISODES[selected[episode]], time)
    last = dataset[len(dataset) - 1]
    assert last["task"] == "new"
    assert float(last[TOP].mean()) == pytest.approx(56 / 255, abs=0.01)


@pytest.mark.filterwarnings("ignore")
def test_a_copy_of_v21_is_what_lerobot_converts_it_to(tmp_path: Path):
    converter = pytest.importorskip("lerobot.datasets.v30.convert_dataset_v21_to_v30")
    source, converted = write_v21(tmp_path / "source", EPISODES), tmp_path / "converted"
    converter.convert_info(source, converted, 100, 200)
    converter.convert_tasks(source, converted)
    data = converter.convert_data(source, converted, 100)
    videos = converter.convert_videos(source, converted, 200)
    converter.convert_episodes_metadata(source, converted, data, videos)

    copy = annotate(source)
    mine, theirs = lerobot(copy), lerobot(converted)
    assert len(mine) == len(theirs) == 9
    for row in range(9):
        frame, other = mine[row], theirs[row]
        assert {*frame} == {*other, "novelty"}
        for name, value in other.items():
            np.testing.assert_array_equal(frame[name], value, err_msg=name)
    stats = [json.loads((root / "meta/stats.json").read_text()) for root in (copy, converted)]
    for name in (TOP, WRIST, "observation.state"):
        for kind in ("min", "max", "mean", "std", "count"):
            np.testing.assert_allclose(stats[0][name][kind], stats[1][name][kind], atol=1e-12)
