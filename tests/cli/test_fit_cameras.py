"""The command line looks at cameras, says what each tells, and draws what is seen."""

import json
import shutil
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import sights
from command_line import refusal, rows_under, run, value_of
from sights import TOP

from pacnet.datasets.demonstrations import load_demonstrations
from pacnet.imitator import Imitator

SHOWN, FEW = 6, 3  # demonstrations


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Datasets: what is learned, other places, the same with nothing to see, and a checkpoint."""
    root = tmp_path_factory.mktemp("sights")
    sights.write(root / "shown", sights.demonstrations(SHOWN))
    sights.write(root / "others", sights.demonstrations(2, seed=7))
    sights.write(root / "bare", sights.demonstrations(1, seed=8, seen=False))
    sights.write(root / "blind", sights.demonstrations(2), with_pictures=False)
    assert run("fit", root / "shown", "--out", root / "imitator") == 0
    return root


def test_fit_says_what_a_camera_tells(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    capsys.readouterr()
    assert run("fit", folder / "shown", "--out", tmp_path) == 0
    told = Imitator.from_pretrained(tmp_path).cameras.encoders[TOP].told
    assert told.error < 0.1 * told.alone
    text = (
        f"top: where hand will go within {told.error:.3g}; state alone {told.alone:.3g} "
        "(patches, in the unit of hand)"
    )
    assert value_of("cameras", capsys.readouterr().out) == text
    assert run("info", tmp_path) == 0
    assert f"\ncameras         {text}\n" in capsys.readouterr().out  # it is a feature's name too
    assert run("info", tmp_path, "--json") == 0
    (camera,) = json.loads(capsys.readouterr().out)["cameras"]
    assert (camera["feature"], camera["used"], camera["encoder"]) == (TOP, True, "patches")
    assert (camera["error"], camera["demonstrations"]) == (told.error, SHOWN)


def test_the_hand_is_enough_of_points(folder: Path, tmp_path: Path):
    hand = "hand=observation.state[0:2]"
    assert run("fit", folder / "shown", "--out", tmp_path, "--points", hand) == 0
    imitator = Imitator.from_pretrained(tmp_path)
    assert imitator.cameras is not None
    assert imitator.config.points.names[:2] == ("hand", "goal 25%")


def test_too_few_demonstrations_are_said(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    assert run("fit", folder / "shown", "--episodes", f"0-{FEW - 1}", "--out", tmp_path) == 0
    text = "top: not used: too few demonstrations to tell, from 5 on"
    assert value_of("cameras", capsys.readouterr().out) == text


def test_after_one_demonstration_only_the_same_place_will_do(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    sights.write(tmp_path / "one", sights.demonstrations(1))
    capsys.readouterr()
    asked = ("--out", tmp_path / "imitator", "--encoder", "patches")
    assert run("fit", tmp_path / "one", *asked) == 0
    assert "only the same place will do" in value_of("cameras", capsys.readouterr().out)


def test_a_camera_that_does_not_help_is_said(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    sights.write(tmp_path / "bare", sights.demonstrations(SHOWN, seen=False))
    assert run("fit", tmp_path / "bare", "--out", tmp_path / "out") == 0
    text = value_of("cameras", capsys.readouterr().out)
    assert text.startswith("top: does not help: within ")
    assert Imitator.from_pretrained(tmp_path / "out").cameras is None


def test_no_camera_is_looked_at_if_so_asked(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    shown = folder / "shown"
    assert run("fit", shown, "--out", tmp_path, "--cameras", "none") == 0
    assert "cameras" not in capsys.readouterr().out
    assert Imitator.from_pretrained(tmp_path).cameras is None
    message = refusal(capsys, "fit", shown, "--out", tmp_path / "out", "--cameras", "left")
    assert f"expected a camera of the dataset ({TOP}), got 'left'" in message
    message = refusal(capsys, "fit", shown, "--out", tmp_path / "out", "--encoder", "magic")
    assert "got 'magic'" in message


@pytest.mark.parametrize("options", [("--cameras", "top"), ("--encoder", "pca")])
def test_another_imitator_keeps_its_cameras(
    options: tuple[str, str], folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    arguments = ("--from", folder / "imitator", "--out", tmp_path / "out")
    assert run("fit", folder / "others", *arguments, *options) == 2
    assert f"argument {options[0]}: not with --from" in capsys.readouterr().err
    assert run("fit", folder / "others", *arguments) == 0
    encoder = Imitator.from_pretrained(tmp_path / "out").cameras.encoders[TOP]
    assert len(encoder.shown) == SHOWN + 2


def test_missing_files_of_a_camera_are_noted_once(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    shutil.copytree(folder / "shown", tmp_path / "shown")
    shutil.rmtree(tmp_path / "shown" / "videos")
    assert run("fit", tmp_path / "shown", "--out", tmp_path / "out") == 0
    out, notes = capsys.readouterr()
    assert notes.count(f"note: left out the camera {TOP!r}: none of its files is there") == 1
    assert "cameras" not in out
    other = Imitator.from_pretrained(tmp_path / "out")
    assert run("fit", folder / "blind", "--out", tmp_path / "blind") == 0
    assert other.config.percepts == Imitator.from_pretrained(tmp_path / "blind").config.percepts


def test_without_a_decoder_it_goes_on_unless_cameras_are_asked_for(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
):  # fmt: skip
    monkeypatch.setenv("PACNET_CACHE", str(tmp_path / "cache"))
    monkeypatch.setitem(sys.modules, "av", None)
    assert run("fit", folder / "shown", "--out", tmp_path / "out") == 0
    note = capsys.readouterr().err
    assert note.count("note: no camera is looked at") == 1
    assert "pip install 'pacnet[cameras]'" in note
    message = refusal(
        capsys, "fit", folder / "shown", "--out", tmp_path / "other", "--cameras", "top"
    )
    assert "pip install 'pacnet[cameras]'" in message


def test_watch_says_that_nothing_is_found(folder: Path, capsys: pytest.CaptureFixture[str]):
    capsys.readouterr()
    assert run("watch", folder / "imitator", folder / "bare") == 0
    (row,) = rows_under("episode", capsys.readouterr().out)[:1]
    assert (row[2], row[5], row[7], row[10]) == ("new", "100.0%", TOP, "not found")
    assert run("watch", folder / "imitator", folder / "others") == 0
    for row in rows_under("episode", capsys.readouterr().out)[:2]:
        assert (row[2], row[5], row[9]) == ("reach", "0.0%", "100.0%")


def test_explain_has_boxes_and_draws_both_pictures(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    arguments = ("explain", folder / "imitator", folder / "others", "--episode", 1, "--frame", 5)
    capsys.readouterr()
    assert run(*arguments, "--json", "--out", tmp_path) == 0
    document = json.loads(capsys.readouterr().out)
    (camera,) = document["cameras"]
    # The square is 13 pixels wide; a patch of 5 may overlap it by a half.
    goal = load_demonstrations(folder / "others").episodes[1].state[-1].numpy()
    row, column = sights.pixel_of(goal)
    left, top, right, bottom = np.multiply(camera["boxes"][0], [sights.WIDTH, sights.HEIGHT] * 2)
    assert abs((left + right) / 2 - column) < 9
    assert abs((top + bottom) / 2 - row) < 9
    assert camera["doubt"] < 1
    before, followed = camera["remembered"], document["followed"][0]
    assert before == {"dataset": "shown", "episode": followed["episode"], "is_followed": True}
    assert (tmp_path / "episode_001_frame_0005.png").stat().st_size > 10_000
    assert list(document["percept"])[:3] == ["hand.x", "hand.y", "goal 25%.x"]
    assert run(*arguments) == 0
    assert "as episode" in value_of("cameras", capsys.readouterr().out)


def test_explain_names_the_camera_where_nothing_is_found(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    arguments = (folder / "imitator", folder / "bare", "--episode", 0, "--frame", 9)
    capsys.readouterr()
    assert run("explain", *arguments, "--out", tmp_path) == 0
    out = capsys.readouterr().out
    assert value_of("decision", out) == "holds: top: what is attended to is not found"
    assert Path(value_of("picture", out)).is_file()


def test_explain_says_so_where_no_picture_is_remembered(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    """Cameras are fitted, but what was learned had no pictures."""
    blind = Imitator.from_demonstrations(sights.demonstrations(6))
    blind.learn(load_demonstrations(folder / "blind"))
    blind.save_pretrained(tmp_path / "blind")
    arguments = (tmp_path / "blind", folder / "others", "--episode", 1, "--frame", 5)
    capsys.readouterr()
    assert run("explain", *arguments, "--out", tmp_path) == 0
    out = capsys.readouterr().out
    assert "no picture is remembered" in value_of("cameras", out)
    assert Path(value_of("picture", out)).is_file()
    assert run("explain", *arguments, "--json") == 0
    (camera,) = json.loads(capsys.readouterr().out)["cameras"]
    assert camera["remembered"] is None


@pytest.mark.parametrize("command", ["watch", "explain", "export"])
def test_a_dataset_without_the_camera_is_refused(
    command: str, folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    options = {"explain": ("--episode", 0, "--frame", 0), "export": ("--out", tmp_path / "out")}
    message = refusal(
        capsys, command, folder / "imitator", folder / "blind", *options.get(command, ())
    )
    assert f"the imitator has learned to look at {TOP!r}" in message


def test_pictures_of_another_aspect_are_refused(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    wide = sights.demonstrations(1)
    episodes = [replace(one, pictures={TOP: one.pictures[TOP][:, :48]}) for one in wide]
    sights.write(tmp_path / "wide", replace(wide, episodes=tuple(episodes)))
    message = refusal(capsys, "watch", folder / "imitator", tmp_path / "wide")
    assert f"expected pictures of {TOP!r} that are 112 x 96 pixels when reduced" in message


def test_what_is_held_out_is_seen(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    sights.write(tmp_path / "eight", sights.demonstrations(8))
    assert run("fit", tmp_path / "eight", "--out", tmp_path / "out", "--held-out", 4) == 0
    imitator, *others = rows_under("compared", capsys.readouterr().out)
    assert imitator[:3] == ["imitator", "100.0%", "0.0%"]
    errors = {row[0]: float(row[3]) for row in others}
    assert errors["1-NN with the first picture"] < errors["1-NN"]


def test_explain_draws_only_with_cameras(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    assert run("fit", folder / "shown", "--out", tmp_path / "none", "--cameras", "none") == 0
    arguments = (tmp_path / "none", folder / "shown", "--episode", 0, "--frame", 0)
    message = refusal(capsys, "explain", *arguments, "--out", tmp_path / "out")
    assert "expected --out with an imitator that looks at cameras" in message
