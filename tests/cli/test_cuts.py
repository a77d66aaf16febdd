"""`fit` and `info` say how demonstrations were cut, `watch` draws it."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from carrying import LEG, record_carrying
from command_line import SURROUNDINGS, run, value_of

from pacnet.cli.cuts import cut_pairs
from pacnet.datasets.demonstrations import load_demonstrations
from pacnet.imitator import Imitator


@pytest.fixture(scope="module")
def carrying(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Four episodes, of which episode 2 goes to the goal first."""
    return record_carrying(
        tmp_path_factory.mktemp("data") / "carrying", (False, False, True, False)
    )


@pytest.fixture(scope="module")
def carrier(carrying: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("checkpoint") / "carrier"
    assert run("fit", carrying, "--out", folder) == 0
    return folder


MOVEMENT = "{}% of how hand moves is predicted from actions and momentum, in frames held out"
CUT = "object, goal (3 of 4 episodes); episode 2: goal, object, goal (not followed)"


def test_fit_and_info_say_how_demonstrations_were_cut(
    carrying: Path, carrier: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    capsys.readouterr()
    assert run("fit", carrying, "--out", tmp_path / "out") == 0
    fitted = capsys.readouterr().out
    assert run("info", carrier) == 0
    for printed in (fitted, capsys.readouterr().out):
        assert value_of("segments", printed) == CUT
        assert value_of("movement", printed) == MOVEMENT.format(100)


def test_the_json_has_each_segment(
    carrying: Path, carrier: Path, capsys: pytest.CaptureFixture[str]
):
    capsys.readouterr()
    assert run("info", carrier, "--json") == 0
    document = json.loads(capsys.readouterr().out)
    assert document["explained"] == pytest.approx(1, abs=0.02)
    assert [cut["episode"] for cut in document["cuts"]] == [0, 1, 2, 3]
    assert [cut["is_followed"] for cut in document["cuts"]] == [True, True, False, True]
    for cut, shown in zip(document["cuts"], load_demonstrations(carrying), strict=True):
        segments = cut["segments"]
        assert sum(segment["frames"] for segment in segments) == len(shown.state)
        ends = np.cumsum([0, *(segment["frames"] for segment in segments)])
        assert [segment["first_frame"] for segment in segments] == ends[:-1].tolist()
        # The hand turns to the goal when the object begins to move.
        assert abs(segments[-1]["frames"] - LEG) <= 5
    (first, *_) = document["cuts"][0]["segments"]
    assert (first["landmark"], first["reference"]) == ("object", "object")


def test_without_points_nothing_is_said_of_cuts(imitator: Path, capsys: pytest.CaptureFixture[str]):
    capsys.readouterr()
    assert run("info", imitator) == 0
    assert "\nsegments" not in capsys.readouterr().out
    assert run("info", imitator, "--json") == 0
    document = json.loads(capsys.readouterr().out)
    assert (document["explained"], document["cuts"]) == (None, [])


def shown(episode: int, *landmarks: str, **fields: Any) -> dict[str, Any]:
    segments = [{"landmark": name, "reference": name} for name in landmarks]
    cut = {
        "dataset": "shown", "episode": episode, "first_frame": 0, "task": "carry",
        "is_followed": True, "reaches_nothing": False, "segments": segments,
    }  # fmt: skip
    return cut | fields


def said(*cuts: dict[str, Any]) -> list[str]:
    document = {"points": {"hand": [], "cup": []}, "explained": 0.876, "cuts": list(cuts)}
    (movement, explained), *rest = cut_pairs(document)
    assert movement == "movement"
    assert explained == MOVEMENT.format(88)
    assert [name for name, _ in rest] == ["segments", *[""] * (len(rest) - 1)]
    return [text for _, text in rest]


def test_cuts_are_said_in_words():
    usual = [shown(number, "cup", "shelf") for number in range(20)]
    assert said(usual[0]) == ["cup, shelf"]
    assert said(*usual) == ["cup, shelf (all 20 episodes)"]
    lost = shown(3, "world", reaches_nothing=True, is_followed=False)
    assert said(*usual[:3], lost) == [
        "cup, shelf (3 of 4 episodes); episode 3: no landmark (world) (not followed)"
    ]
    back = [shown(number, "cup") for number in range(20, 27)]
    assert said(*usual, *back) == [
        "cup, shelf (20 of 27 episodes); episodes 20, 21, 22, 23, 24, 2 more: cup"
    ]
    away = shown(0, "cup")
    away["segments"][0]["reference"] = "world"
    assert said(away) == ["cup (kept in the frame of world)"]


def test_each_task_and_dataset_has_its_own_words():
    cuts = [shown(0, "cup"), shown(1, "cup"), shown(0, "shelf", task=""), shown(1, "cup", task=" ")]
    cuts[3]["dataset"] = "more"
    cuts[3]["first_frame"] = 7
    assert said(*cuts) == [
        "“carry”: cup (all 2 episodes)",
        "“untitled”: shelf (1 of 2 parts); episode 1 from frame 7 of more: cup",
    ]


def test_watch_draws_where_each_episode_is_cut(carrying: Path, carrier: Path, tmp_path: Path):
    chosen = ("--episodes", "0,2", "--out", tmp_path / "pictures")
    assert run("watch", carrier, carrying, *chosen) == 0
    names = [
        f"episode_{number}{kind}.png" for number in ("000", "002") for kind in ("", "_segments")
    ]
    assert sorted(path.name for path in (tmp_path / "pictures").iterdir()) == sorted(names)


def test_what_is_drawn_is_what_was_learned(carrying: Path, carrier: Path):
    imitator, demonstrations = Imitator.from_pretrained(carrier), load_demonstrations(carrying)
    frames = imitator.frames
    assert frames is not None
    for cut, episode in zip(imitator.cuts, demonstrations, strict=True):
        approach = frames.approach(episode)
        names = [frames.config.points.names[1 + number] for number in approach.landmark.tolist()]
        learned = [part.landmark for part in cut.segments for _ in range(part.frames)]
        assert names == learned
        apart = episode.state[:, :2] - episode.environment_state[:, :2]
        np.testing.assert_allclose(approach.distances[:, 0], apart.norm(dim=1).numpy(), atol=0.02)
    assert demonstrations.names[SURROUNDINGS][0] == "object.x"  # the first landmark
