"""Recognition from one command: its scores, figures and columns, and what it refuses."""

import json
import re
import shlex
import subprocess
import sys
from itertools import pairwise
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
import torch
from matplotlib import cbook
from matplotlib.colors import to_hex
from torch import Tensor

from pacnet import MotorSchemasConfig, PACNet, PACNetConfig, SOFMConfig
from pacnet.competition.competing_schemas import CompetingSchemasConfig
from pacnet.competition.recognition import Recognition
from pacnet.datasets.demonstrations import Demonstration
from pacnet.datasets.format.info import read_info
from pacnet.datasets.recorder import Recorder
from pacnet.evaluation.recognised import Watched, column_names, column_values
from pacnet.evaluation.recognition_figures import recognition_over_time
from train import recognise
from train.postural.recognition.scores import print_table, score_all, score_episode

PROJECT = Path(__file__).parents[2]
BEHAVIOURS = ("drink", "wave")


def recognised(named: list[int], progress: list[float], novelty: list[float]) -> Recognition:
    """A recognition of two behaviours, written by hand; the named one has a probability of 0.8."""
    behaviour, samples = torch.tensor(named), len(named)
    probability = torch.full((samples, 2), 0.2)
    probability[torch.arange(samples), behaviour] = 0.8
    return Recognition(
        probability=probability,
        behaviour=behaviour,
        progress=torch.tensor(progress),
        next_percept=torch.zeros(samples, 3),
        end_percept=torch.ones(samples, 3),
        novelty=torch.tensor(novelty),
        is_novel=torch.tensor(novelty) > 0.5,
        winner=torch.tensor(
            [-1 if value > 0.7 else sample for sample, value in enumerate(novelty)]
        ),
    )


def watched(task: str, recognition: Recognition, episode: int = 0) -> Watched:
    nothing = torch.zeros(len(recognition.winner), 3)
    return Watched(Demonstration(episode, task, nothing, nothing[:, :0], nothing), recognition)


RIGHT = watched("drink", recognised([1, 0, 1, 0, 0], [0.0, 0.25, 0.5, 0.75, 0.9], [0.1] * 5))
WRONG = watched("drink", recognised([1, 1, 1], [0.0, 0.3, 1.0], [0.1, 0.6, 0.8]), 1)
OTHER = watched("juggle", recognised([0, 0], [0.0, 0.0], [0.9, 0.9]), 2)


def test_scores_of_an_episode_are_those_worked_out_by_hand():
    scores = score_episode(RIGHT, BEHAVIOURS, fps=10)
    assert (scores["task"], scores["named"]) == ("drink", "drink")
    assert scores["probability"] == pytest.approx(0.8)
    assert scores["named_from_s"] == pytest.approx(0.3)  # the last sample named otherwise is 2
    assert scores["named_from_share"] == pytest.approx(3 / 5)
    assert scores["novelty_mean"] == pytest.approx(0.1)
    assert scores["novel_share"] == 0
    assert scores["progress_error_mean"] == pytest.approx(0.1 / 5)  # 0.9 in place of 1


def test_one_that_is_named_from_the_start_and_never_taught():
    scores = score_episode(OTHER, BEHAVIOURS, fps=10)
    assert (scores["task"], scores["named"]) == ("juggle", "drink")
    assert scores["named_from_s"] == scores["named_from_share"] == 0
    assert scores["novel_share"] == 1
    assert scores["progress_error_mean"] is None


def test_an_episode_of_one_frame_has_scores():
    one = watched("wave", recognised([1], [0.25], [0.1]))
    assert score_episode(one, BEHAVIOURS, 10)["progress_error_mean"] == pytest.approx(0.25)


def test_totals_count_what_was_taught_and_what_was_not_apart():
    totals = score_all([RIGHT, WRONG, OTHER], BEHAVIOURS)
    assert (totals["watched"], totals["of_known_tasks"]) == (3, 2)
    assert totals["named_as_recorded_share"] == 0.5
    # Errors of 0.1 and of |0.3 − 0.5| in eight frames, two of which are novel.
    assert totals["progress_error_mean"] == pytest.approx((0.1 + 0.2) / 8)
    assert totals["novel_share_of_known_tasks"] == pytest.approx(2 / 8)
    assert totals["novel_share_of_other_tasks"] == 1


def test_totals_without_a_known_task_are_no_numbers():
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


def panels(recognition: Recognition):
    return recognition_over_time(recognition, BEHAVIOURS, 0.5, 0.1, "Episode 1").axes


def test_shares_of_the_behaviours_fill_the_panel_at_every_sample():
    shares = panels(RIGHT.recognition)[0].collections
    assert len(shares) == 2
    inside = [
        [area.get_paths()[0].contains_point((0.05 + 0.1 * k, 0.5)) for k in range(5)]
        for area in shares
    ]
    # At half height there is the behaviour of 80 %: the first below, the second above.
    assert inside == [[False, True, False, True, True], [True, False, True, False, False]]


def test_progress_has_the_colour_of_the_behaviour_named():
    probability, progress = panels(RIGHT.recognition)[:2]
    colours = [to_hex(area.get_facecolor()[0]) for area in probability.collections]
    dots = {to_hex(line.get_color()): line.get_xdata() for line in progress.lines[1:]}
    np.testing.assert_allclose(dots[colours[0]], [0.1, 0.3, 0.4])
    np.testing.assert_allclose(dots[colours[1]], [0, 0.2])
    assert colours[0] != colours[1]


def test_novel_stretches_are_shaded_and_what_nobody_matches_is_marked():
    _, progress, novelty, winners = panels(WRONG.recognition)
    for axes in (progress, novelty, winners):
        (shade,) = axes.collections
        edges = shade.get_paths()[0].vertices[:, 0]
        assert (edges.min(), edges.max()) == pytest.approx((0.1, 0.3))
    assert novelty.lines[1].get_ydata()[0] == 0.5  # the threshold
    marks = winners.lines[-1]
    assert marks.get_marker() == "x"
    np.testing.assert_allclose(marks.get_xdata(), [0.2])
    assert [label.get_text() for label in winners.get_yticklabels()] == ["0", "1", "no match"]


def test_any_episode_can_be_drawn(tmp_path: Path):
    rng = np.random.default_rng(0)
    for samples, behaviours, nodes in ((1, 1, 1), (40, 9, 30)):
        shares = torch.from_numpy(rng.dirichlet(np.ones(behaviours), samples))
        zeros = torch.zeros(samples)
        recognition = Recognition(
            shares, shares.argmax(1), zeros, zeros, zeros, zeros, zeros > 1,
            torch.from_numpy(rng.integers(-1, nodes, samples)),
        )  # fmt: skip
        names = [f"behaviour {number}" for number in range(behaviours)]
        figure = recognition_over_time(recognition, names, 0.5, 0.1, "Episode")
        figure.savefig(tmp_path / "figure.png")
        (legend,) = figure.legends
        assert len(legend.get_texts()) == behaviours + 3
    with pytest.raises(ValueError, match="expected titles of 9 behaviours, got"):
        recognition_over_time(recognition, names[1:], 0.5, 0.1, "Episode")
    with pytest.raises(ValueError, match="expected timestep > 0"):
        recognition_over_time(recognition, names, 0.5, 0.0, "Episode")


def test_where_the_robot_would_hold_there_is_a_band_under_the_novelty():
    acts = np.array([True, False, False, True, True])
    figure = recognition_over_time(RIGHT.recognition, BEHAVIOURS, 0.5, 0.1, "Episode", acts)
    novelty = figure.axes[2]
    _, band = novelty.collections
    vertices = band.get_paths()[0].vertices
    assert (vertices[:, 0].min(), vertices[:, 0].max()) == pytest.approx((0.1, 0.3))
    top = novelty.get_ylim()[0] + vertices[:, 1].max() * np.diff(novelty.get_ylim())[0]
    assert top < min(novelty.lines[0].get_ydata())
    assert figure.legends[0].get_texts()[-1].get_text() == "would hold, not act"


def test_each_node_has_its_number():
    winners = torch.arange(100) % 30
    recognition = recognised([0] * 100, [0.0] * 100, [0.1] * 100)._replace(winner=winners)
    figure = recognition_over_time(recognition, BEHAVIOURS, 0.5, 0.1, "Episode")
    labels = figure.axes[-1].get_yticklabels()
    assert [label.get_text() for label in labels] == [str(node) for node in range(30)]
    figure.draw_without_rendering()
    boxes = [label.get_window_extent() for label in labels]
    assert all(below.y1 < above.y0 + 1 for below, above in pairwise(boxes))  # [pixels]


def test_long_names_are_not_cut_off():
    task = "pick up the {} cube and place it carefully into the box on the far side of the table"
    names = [task.format(f"{colour} {shade}") for colour in ("red", "blue") for shade in range(6)]
    recognition = Recognition(
        torch.full((40, 12), 1 / 12), torch.zeros(40, dtype=torch.int64), *torch.zeros(4, 40),
        torch.zeros(40, dtype=torch.bool), torch.zeros(40, dtype=torch.int64),
    )  # fmt: skip
    figure = recognition_over_time(recognition, names, 0.5, 0.1, f"Episode 3, “{names[0]}”")
    figure.draw_without_rendering()
    title = figure.texts[0]
    for part in (title, *figure.legends[0].get_texts()):
        box = part.get_window_extent()
        assert figure.bbox.contains(box.x0, box.y0)
        assert figure.bbox.contains(box.x1, box.y1)
    shown = [text.get_text().replace("\n", " ") for text in figure.legends[0].get_texts()]
    assert shown[:12] == names
    assert figure.axes[0].get_window_extent().height > 1.1 * figure.dpi  # there is room for all


def test_an_episode_of_one_frame_can_be_seen():
    frame = Recognition(*(value[:1] for value in RIGHT.recognition))
    figure = recognition_over_time(frame, BEHAVIOURS, 0.5, 0.1, "Episode")
    for axes in figure.axes[1:]:
        (dot,) = [line for line in axes.lines if line.get_marker() == "."]
        assert len(dot.get_xdata()) == 1
        assert not dot.get_clip_on()  # it lies on the edge


def test_names_are_written_as_they_stand(tmp_path: Path):
    names = ("$x_1$ costs $", "lift\n\ta  cup")
    title = "Episode 1, “$x_1$ costs $”"
    figure = recognition_over_time(RIGHT.recognition, names, 0.5, 0.1, title)
    figure.savefig(tmp_path / "figure.png")  # "$ costs $" would be no formula
    (legend,) = figure.legends
    written = [figure.get_suptitle(), *(text.get_text() for text in legend.get_texts()[:2])]
    assert [cbook.is_math_text(text) for text in written] == [False] * 3
    shown = [text.replace(r"\$", "$") for text in written]
    assert shown == [title, names[0], "lift a cup"]


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
def test_a_run_names_what_it_was_taught_and_leaves_everything(run: Path):
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


def test_no_checkpoint_and_no_dataset_are_one_line_each(
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
def test_networks_that_cannot_recognise_it_are_one_line_each(
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
def test_a_dataset_that_cannot_be_copied_is_recognised_all_the_same(
    checkpoint: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
):
    root = record(tmp_path / "set", "wave")
    info = json.loads((root / "meta" / "info.json").read_text())
    info["features"]["observation.eye"] = {"dtype": "video", "shape": [3, 4, 4], "names": None}
    (root / "meta" / "info.json").write_text(json.dumps(info))
    arguments = ["recognise", checkpoint, root, "--runs", tmp_path]
    monkeypatch.setattr(sys, "argv", list(map(str, arguments)))
    recognise.main()
    (message,) = [line for line in capsys.readouterr().err.splitlines() if "note: " in line]
    assert "no copy of the dataset will be written: " in message
    assert "has observation.eye" in message
    (folder,) = (tmp_path / "recognise").iterdir()
    assert {path.name for path in folder.iterdir()} == {"figures", "metrics.json"}
    assert json.loads((folder / "metrics.json").read_text())["named_as_recorded_share"] == 1


def test_a_novelty_that_has_no_upper_end_stays_within_its_panel():
    far = RIGHT.recognition._replace(novelty=torch.tensor([0.2, 0.4, 2.0, 9.0, 0.1]))
    assert panels(far)[2].get_ylim()[1] > 9
    assert panels(RIGHT.recognition)[2].get_ylim() == (0, 1)
