"""Recognition from one command: its scores, figures and columns, and what it refuses."""

import json
import re
import shlex
import subprocess
import sys
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
import torch
from recognitions import make_recognition
from torch import Tensor

from pacnet import MotorSchemasConfig, PACNet, PACNetConfig, SOFMConfig
from pacnet.competition.competing_schemas import CompetingSchemasConfig
from pacnet.competition.recognition import Recognition
from pacnet.datasets.demonstrations import Demonstration
from pacnet.datasets.format.info import read_info
from pacnet.datasets.recorder import Recorder
from pacnet.evaluation.recognized import RecognizedEpisode, column_names, column_values
from train import recognise
from train.postural.recognition.scores import print_table, score_all, score_episode

PROJECT = Path(__file__).parents[2]
BEHAVIOURS = ("drink", "wave")


def watched(task: str, recognition: Recognition, episode: int = 0) -> RecognizedEpisode:
    nothing = torch.zeros(len(recognition.winner), 3)
    return RecognizedEpisode(
        Demonstration(episode, task, nothing, nothing[:, :0], nothing), recognition
    )


RIGHT = watched("drink", make_recognition([1, 0, 1, 0, 0], [0.0, 0.25, 0.5, 0.75, 0.9], [0.1] * 5))
WRONG = watched("drink", make_recognition([1, 1, 1], [0.0, 0.3, 1.0], [0.1, 0.6, 0.8]), 1)
OTHER = watched("juggle", make_recognition([0, 0], [0.0, 0.0], [0.9, 0.9]), 2)


def test_scores_of_an_episode_are_those_worked_out_by_hand():
    scores = score_episode(RIGHT, BEHAVIOURS, fps=10)
    assert (scores["task"], scores["named"]) == ("drink", "drink")
    assert scores["probability"] == pytest.approx(0.8)
    assert scores["named_from_s"] == pytest.approx(0.3)  # the last sample named otherwise is 2
    assert scores["named_from_share"] == pytest.approx(3 / 5)
    assert scores["novelty_mean"] == pytest.approx(0.1)
    assert scores["novel_share"] == 0
    assert scores["progress_error_mean"] == pytest.approx(0.1 / 5)  # 0.9 in place of 1


def test_scores_of_an_unknown_task_named_from_the_start():
    scores = score_episode(OTHER, BEHAVIOURS, fps=10)
    assert (scores["task"], scores["named"]) == ("juggle", "drink")
    assert scores["named_from_s"] == scores["named_from_share"] == 0
    assert scores["novel_share"] == 1
    assert scores["progress_error_mean"] is None


def test_an_episode_of_one_frame_has_scores():
    one = watched("wave", make_recognition([1], [0.25], [0.1]))
    assert score_episode(one, BEHAVIOURS, 10)["progress_error_mean"] == pytest.approx(0.25)


def test_totals_count_known_and_unknown_tasks_separately():
    totals = score_all([RIGHT, WRONG, OTHER], BEHAVIOURS)
    assert (totals["watched"], totals["of_known_tasks"]) == (3, 2)
    assert totals["named_as_recorded_share"] == 0.5
    # Errors of 0.1 and of |0.3 − 0.5| in eight frames, two of which are novel.
    assert totals["progress_error_mean"] == pytest.approx((0.1 + 0.2) / 8)
    assert totals["novel_share_of_known_tasks"] == pytest.approx(2 / 8)
    assert totals["novel_share_of_other_tasks"] == 1


def test_totals_without_a_known_task_are_none():
    totals = score_all([OTHER], BEHAVIOURS)
    assert totals["of_known_tasks"] == 0
    assert totals["named_as_recorded_share"] is totals["progress_error_mean"] is None
    assert score_all([RIGHT], BEHAVIOURS)["novel_share_of_other_tasks"] is None


def test_the_table_has_a_row_for_each_episode(capsys: pytest.CaptureFixture[str]):
    everything = [RIGHT, WRONG, OTHER]
    rows = [score_episode(one, BEHAVIOURS, 10) for one in everything]
    print_table(rows, score_all(everything, BEHAVIOURS))
    lines = capsys.readouterr().out.splitlines()
    assert [" ".join(line.split()) for line in lines[2:5]] == [
        "0 drink drink 80.0% 0.30 s (60%) 0.100 0.0%",
        "1 drink wave 80.0% 0.00 s (0%) 0.500 66.7%",
        "2 juggle drink 80.0% 0.00 s (0%) 0.900 100.0%",
    ]
    assert len({len(line) for line in lines[1:5]}) == 1
    assert "named_as_recorded_share" in "\n".join(lines)


def test_columns_have_a_dimension_for_each_behaviour_and_part_of_a_percept():
    names = column_names(("drink", ""), ("x", "y", "z"))
    values = column_values(RIGHT.recognition)
    assert names["behaviour"] == ("drink", "untitled")
    assert names["expected_next"] == names["expected_end"] == ("x", "y", "z")
    assert not [name for name in names if name.startswith(("observation", "action"))]
    assert {name: len(dimensions) for name, dimensions in names.items()} == {
        name: array.shape[1] for name, array in values.items()
    }
    assert values["behaviour"][0] == pytest.approx([0.2, 0.8])
    assert values["progress"].ravel() == pytest.approx([0, 0.25, 0.5, 0.75, 0.9])
    assert values["novelty"].ravel() == pytest.approx([0.1] * 5)
    assert values["is_novel"].ravel().tolist() == [False] * 5
    assert values["winner"].ravel().tolist() == [0, 1, 2, 3, 4]
    assert (values["expected_next"] == 0).all()
    assert (values["expected_end"] == 1).all()


def curve(behaviour: str, seed: int, samples: int = 80) -> Tensor:
    """A noisy path through three dimensions, straight for a third, then bending [T, 3]."""
    bend = {"drink": 1.0, "wave": -1.0, "juggle": 3.0}[behaviour]
    along = torch.linspace(0, 3, samples)
    path = torch.stack([along, bend * (along - 1).clamp(min=0), 0.5 * along.sin()], dim=1)
    return path + 0.01 * torch.randn(path.shape, generator=torch.Generator().manual_seed(seed))


def taught(*shown: str) -> PACNet:
    """A network that watched each of these behaviours, one episode each."""
    attention = SOFMConfig.paper(3, novelty_threshold=0.7, winner_tau=1.0)
    network = PACNet(PACNetConfig(attention, CompetingSchemasConfig(3, 3)))
    for episode, behaviour in enumerate(shown):
        percepts = curve(behaviour, seed=1000 + episode)
        network.observe(percepts, percepts, episode, behaviour)
    return network.eval()


def record(root: Path, *tasks: str, surroundings: bool = False) -> Path:
    """A dataset of an episode for each task; there may be two features to perceive."""
    features = {"observation.state": ("x", "y", "z")}
    if surroundings:
        features = {"observation.state": ("x", "y"), "observation.environment_state": ("z",)}
    with Recorder(root, 20, features, "hand") as recorder:
        for number, task in enumerate(tasks):
            parts = np.split(curve(task, 2000 + number).numpy(), [2] * surroundings, axis=1)
            recorder.save_episode(task, dict(zip(features, parts, strict=True)))
    return root


def run_script(*arguments: object) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "train.recognise", *map(str, arguments)]
    return subprocess.run(command, cwd=PROJECT, capture_output=True, text=True, check=False)


@pytest.fixture(scope="module")
def checkpoint(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("checkpoint")
    taught(*BEHAVIOURS, *BEHAVIOURS).save_pretrained(folder)
    return folder


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Path:
    tasks = ("wave", "drink", "juggle", "drink")
    return record(tmp_path_factory.mktemp("data") / "set", *tasks, surroundings=True)


@pytest.fixture(scope="module")
def run(checkpoint: Path, dataset: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a run."""
    runs = tmp_path_factory.mktemp("runs")
    done = run_script(checkpoint, dataset, "--figures", 2, "--seed", 1003, "--runs", runs)
    assert done.returncode == 0, done.stderr
    assert "recognising: 100%" in done.stderr
    (folder,) = (runs / "recognise").iterdir()
    assert folder.name.endswith("-seed1003")
    (folder / "printed").write_text(done.stdout)
    return folder


@pytest.mark.slow
def test_a_run_names_known_behaviours_and_writes_all_its_files(run: Path):
    scores = json.loads((run / "metrics.json").read_text())
    assert scores["behaviours"] == list(BEHAVIOURS)
    assert (scores["watched"], scores["of_known_tasks"]) == (4, 3)
    assert scores["named_as_recorded_share"] == 1
    assert scores["progress_error_mean"] < 0.05
    assert scores["novel_share_of_known_tasks"] < 0.1
    assert scores["novel_share_of_other_tasks"] > 0.4
    assert [row["task"] for row in scores["episodes"]] == ["wave", "drink", "juggle", "drink"]
    assert 0.3 < scores["episodes"][1]["named_from_share"] < 0.5  # they part after a third
    assert {path.name for path in (run / "figures").iterdir()} == {
        "episode_000.png",
        "episode_001.png",
    }
    printed = (run / "printed").read_text()
    assert "named_as_recorded_share" in printed
    assert str(run / "dataset") in printed


@pytest.mark.slow
def test_the_command_in_the_metrics_is_the_one_given(run: Path, checkpoint: Path, dataset: Path):
    command = shlex.split(json.loads((run / "metrics.json").read_text())["command"])
    assert command[:5] == ["python", "-m", "train.recognise", str(checkpoint), str(dataset)]
    assert command[5:] == ["--seed", "1003", "--figures", "2"]


@pytest.mark.slow
def test_the_columns_are_what_the_network_recognises_episode_by_episode(
    run: Path, checkpoint: Path, dataset: Path
):
    network = PACNet.from_pretrained(checkpoint).eval()
    names = column_names(BEHAVIOURS, ("x", "y", "z"))
    features = read_info(run / "dataset")["features"]
    assert {name: tuple(features[name]["names"]) for name in names} == {
        name: tuple(dimensions) for name, dimensions in names.items()
    }
    table = pq.read_table(run / "dataset" / "data" / "chunk-000" / "file-000.parquet")
    copies = recognise.load_percepts(run / "dataset")
    start = 0
    for copy, original in zip(copies, recognise.load_percepts(dataset), strict=True):
        np.testing.assert_array_equal(copy.percepts, original.percepts)
        network.reset()
        expected = column_values(network.recognise(original.percepts))
        rows = slice(start, start + len(original.percepts))
        start = rows.stop
        for name, values in expected.items():
            got = np.reshape(table[name].to_pylist()[rows], values.shape)
            np.testing.assert_allclose(got, values, rtol=1e-5, atol=1e-6)


def refusal(monkeypatch: pytest.MonkeyPatch, *arguments: object) -> str:
    """The one line with which the script ends."""
    monkeypatch.setattr(sys, "argv", ["recognise", *map(str, arguments)])
    with pytest.raises(SystemExit) as end:
        recognise.main()
    message = str(end.value)
    assert message.startswith("error: ")
    assert "\n" not in message
    return message


def test_a_missing_checkpoint_or_dataset_ends_with_one_line(
    checkpoint: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    runs = ("--runs", tmp_path / "runs")
    message = refusal(monkeypatch, tmp_path / "nowhere", tmp_path, *runs)
    assert "expected a checkpoint folder" in message
    message = refusal(monkeypatch, checkpoint, tmp_path / "nowhere", *runs)
    assert "expected the folder of a LeRobot dataset" in message
    message = refusal(monkeypatch, checkpoint, tmp_path, *runs)
    assert "no meta/info.json" in message
    assert not (tmp_path / "runs").exists()


@pytest.mark.slow
def test_an_unsuitable_network_ends_with_one_line(
    dataset: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    one_schema_a_node = PACNetConfig(SOFMConfig.paper(3), MotorSchemasConfig(1, 3))
    longer = PACNetConfig(SOFMConfig.paper(4), CompetingSchemasConfig(1, 4))
    refused = {
        "one schema a node": PACNet(one_schema_a_node),
        "learned schemas": taught(),
        "percepts of 4 dimensions.*got 3 from .*state and observation.env": PACNet(longer),
    }
    for message, network in refused.items():
        network.save_pretrained(tmp_path / "checkpoint")
        got = refusal(monkeypatch, tmp_path / "checkpoint", dataset, "--runs", tmp_path / "runs")
        assert re.search(message, got), got
    assert not (tmp_path / "runs").exists()


@pytest.mark.slow
def test_a_dataset_that_cannot_be_copied_is_still_recognized(
    checkpoint: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
):
    root = record(tmp_path / "set", "wave")
    info = json.loads((root / "meta" / "info.json").read_text())
    info["features"]["novelty"] = {"dtype": "float32", "shape": [1], "names": None}
    (root / "meta" / "info.json").write_text(json.dumps(info))
    arguments = ["recognise", checkpoint, root, "--runs", tmp_path]
    monkeypatch.setattr(sys, "argv", list(map(str, arguments)))
    recognise.main()
    (message,) = [line for line in capsys.readouterr().err.splitlines() if "note: " in line]
    assert "the dataset will not be copied: " in message
    assert "novelty" in message
    (folder,) = (tmp_path / "recognise").iterdir()
    assert {path.name for path in folder.iterdir()} == {"figures", "metrics.json"}
    assert json.loads((folder / "metrics.json").read_text())["named_as_recorded_share"] == 1
