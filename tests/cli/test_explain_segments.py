"""With points, `pacnet explain` names the segment, its landmark, and how far the hand is off."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from carrying import FPS, LEG, REST, record_carrying
from command_line import rows_under, run, value_of

from pacnet.datasets.demonstrations import load_demonstrations


@pytest.fixture(scope="module")
def taught(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path, Path]:
    """An imitator of one demonstration, that demonstration, and another dataset."""
    root = tmp_path_factory.mktemp("data")
    shown = record_carrying(root / "shown", (False,), seed=0)
    other = record_carrying(root / "other", (False, False), seed=1)
    assert run("fit", shown, "--out", root / "imitator") == 0
    return root / "imitator", shown, other


def explained(
    taught: tuple[Path, Path, Path], capsys: pytest.CaptureFixture[str], frame: int
) -> dict[str, Any]:
    capsys.readouterr()
    place = ("--episode", 1, "--frame", frame)
    assert run("explain", taught[0], taught[2], *place, "--json") == 0
    return json.loads(capsys.readouterr().out)


def seen(dataset: Path, episode: int, frame: int) -> np.ndarray:
    """The percept: hand.x, hand.y, gripper, object.x, object.y, goal.x, goal.y."""
    return load_demonstrations(dataset).episodes[episode].percepts[frame].double().numpy()


@pytest.mark.parametrize(
    ("frame", "number", "landmark", "first"),
    [(15, 1, "object", 3), (LEG + REST + 30, 2, "goal", 5)],
)
def test_the_segment_and_its_landmark_are_named(
    taught, capsys: pytest.CaptureFixture[str], frame: int, number: int, landmark: str, first: int
):
    document = explained(taught, capsys, frame)
    segment, (followed,) = document["segment"], document["followed"]
    assert (segment["number"], segment["of"]) == (number, 2)
    assert (segment["landmark"], segment["reference"]) == (landmark, landmark)
    assert (segment["moved"], followed["weight"]) == ("hand", 1)
    assert (followed["dataset"], followed["episode"]) == ("shown", 0)
    assert followed["seconds"] == followed["frame"] / FPS
    now, then = seen(taught[2], 1, frame), seen(taught[1], 0, followed["frame"])
    way, way_shown = (one[:2] - one[first : first + 2] for one in (now, then))
    assert segment["distance"] == pytest.approx(np.hypot(*way), abs=1e-5)
    assert segment["distance_shown"] == pytest.approx(np.hypot(*way_shown), abs=1e-5)
    off = way - way_shown
    most = int(np.abs(off).argmax())
    assert followed["dimension"] == ("hand.x", "hand.y")[most]
    assert followed["deviation"] == pytest.approx(off[most], abs=1e-5)


def test_it_is_printed_in_words(taught, capsys: pytest.CaptureFixture[str]):
    document = explained(taught, capsys, 15)
    assert run("explain", taught[0], taught[2], "--episode", 1, "--frame", 15) == 0
    out = capsys.readouterr().out
    assert value_of("segment", out) == "1 of 2, on the way to object"
    segment = document["segment"]
    assert value_of("targets", out) == (
        f"in the frame of object: hand is {segment['distance']:.4g} from it now, and was "
        f"{segment['distance_shown']:.4g} from it at the moment followed"
    )
    ((dataset, *_, dimension),) = rows_under("dataset", out)
    assert (dataset, dimension) == ("shown", document["followed"][0]["dimension"])
    assert "both seen from object" in out


def test_without_points_there_is_no_segment(
    imitator: Path, dataset: Path, capsys: pytest.CaptureFixture[str]
):
    capsys.readouterr()
    place = ("--episode", 0, "--frame", 40)
    assert run("explain", imitator, dataset, *place, "--json") == 0
    assert json.loads(capsys.readouterr().out)["segment"] is None
    assert run("explain", imitator, dataset, *place) == 0
    assert "\nsegment" not in capsys.readouterr().out
