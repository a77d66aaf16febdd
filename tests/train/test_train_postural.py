"""Experiment 1: seeds, files of a run, repeatability, success."""

import json
import subprocess
import sys
from pathlib import Path

import av
import numpy as np
import pytest
from training_runs import interrupt, only_run

from pacnet import PACNet
from pacnet.datasets.demonstrations import load_demonstrations
from train.postural.alone.learning import FOLDERS
from train.postural.alone.scenes import (
    ALONE,
    COPYING,
    LEAVES,
    OURS,
    OURS_ONE,
    PRESENT,
    REPLAY,
    SCENES,
    STRANGE,
    USUAL,
)
from train.postural.episodes import LEAD, demonstration_seeds, motor_targets, recall_seeds

PROJECT = Path(__file__).parents[2]
PAPER_FIGURES = ("percepts", "map", "winners", "wrists")
SHIPPED = PROJECT / "checkpoints" / "postural_imitation"


def run_script(module: str, *arguments: object) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", f"train.{module}", *map(str, arguments)]
    return subprocess.run(command, cwd=PROJECT, capture_output=True, text=True, check=True)


def test_demonstrations_and_recall_never_share_a_seed():
    for seed in range(20):
        assert not set(demonstration_seeds(seed, 50)) & set(recall_seeds(seed, 200))


def test_fewer_episodes_are_the_first_of_more():
    assert recall_seeds(3, 100)[:7] == recall_seeds(3, 7)


def test_targets_are_the_perceived_angles_smoothed_and_ahead():
    time = np.arange(100)
    percepts = np.zeros((100, 28), dtype=np.float32)
    percepts[:, 2] = 0.01 * time  # joint 2 moves at a constant speed, which smoothing keeps
    targets = motor_targets(percepts)
    assert targets.shape == (100, 11)
    np.testing.assert_allclose(targets[:-LEAD, 2], 0.01 * (time[:-LEAD] + LEAD), atol=1e-5)
    np.testing.assert_allclose(targets[-LEAD:, 2], 0.99, atol=1e-5)
    rng = np.random.default_rng(0)
    percepts[:, 3] = rng.normal(0, 0.01, 100)
    assert motor_targets(percepts)[:, 3].std() < 0.006


@pytest.fixture(scope="module")
def two_runs(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    folders = []
    for name in ("one", "two"):
        runs = tmp_path_factory.mktemp(name)
        arguments = ("--seed", 11, "--demonstrations", 3, "--episodes", 3, "--runs", runs)
        run_script("postural_imitation", *arguments)
        folders.append(only_run(runs))
    return folders


@pytest.mark.slow
def test_a_run_writes_all_its_files(two_runs: list[Path]):
    folder = two_runs[0]
    names = {path.name for path in folder.iterdir()}
    assert {"dataset", "checkpoint", "figures", "tensorboard", "metrics.json"} <= names
    figures = {path.stem for path in (folder / "figures").iterdir()}
    assert figures == {*PAPER_FIGURES, "alone", "alone_wrists", "mirror"}
    scores = json.loads((folder / "metrics.json").read_text())
    assert scores["recall_episodes"] == 3
    assert scores["task_success_rate"] == 1.0
    assert scores["wrist_distance_mean_m"] < 0.03
    for name in ("recall", "alone"):
        with av.open(folder / f"{name}.mp4") as video:
            seconds = float(video.streams.video[0].duration * video.streams.video[0].time_base)
        assert 6 < seconds < 15


@pytest.mark.slow
def test_the_glass_alone_calls_up_the_drink_which_no_simpler_rule_does(two_runs: list[Path]):
    scores = json.loads((two_runs[0] / "metrics.json").read_text())["alone"]
    success = {cell: score["mean"] for cell, score in scores["success"].items()}
    distance = {cell: score["mean"] for cell, score in scores["distance_m"].items()}
    alone = {row: success[f"{ALONE} | {row}"] for row in SCENES[ALONE].rows}
    others = [share for row, share in alone.items() if row not in (OURS, OURS_ONE)]
    assert min(alone[OURS], alone[OURS_ONE]) >= max(others) + 0.3
    assert success[f"{LEAVES} | {OURS}"] >= 0.75
    assert distance[f"{ALONE} | {OURS}"] <= 0.02  # [m]
    assert success[f"{USUAL} | {REPLAY}"] >= 0.75  # it fails for the place alone
    assert success[f"{PRESENT} | {COPYING}"] == 1.0
    for name, novelty in scores["novelty"].items():
        assert novelty["mean"] == (name in STRANGE), name


@pytest.mark.slow
def test_the_node_of_the_others_grasp_wins_in_the_own(two_runs: list[Path]):
    shares = json.loads((two_runs[0] / "metrics.json").read_text())["alone"]["mirror"]
    assert shares["watched"]["mean"] > 0.9
    assert shares["own"]["mean"] > shares["chance"]["mean"] + 0.4


@pytest.mark.slow
def test_the_log_holds_learning_curves_figures_the_projector_and_the_video(two_runs: list[Path]):
    from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

    log = EventAccumulator(str(two_runs[0] / "tensorboard"))
    log.Reload()
    curves = {"nodes", "insertions", "mean_habituation", "attended_share"}
    assert {f"learning/{curve}" for curve in curves} <= set(log.Tags()["scalars"])
    assert {*PAPER_FIGURES, "mirror", "recall", "alone"} <= set(log.Tags()["images"])
    assert list((two_runs[0] / "tensorboard").glob("**/projector_config.pbtxt"))
    network = PACNet.from_pretrained(two_runs[0] / "checkpoint")
    assert log.Scalars("learning/nodes")[-1].value == len(network.sofm)


@pytest.mark.slow
def test_the_same_seed_gives_the_same_bytes(two_runs: list[Path]):
    one, two = two_runs
    folders = ("checkpoint", *FOLDERS.values())
    names = ("config.json", "model.safetensors")
    files = [f"{folder}/{name}" for folder in folders for name in names]
    data = sorted(path.relative_to(one) for path in (one / "dataset" / "data").rglob("*.parquet"))
    assert data
    for file in (*files, *data):
        assert (one / file).read_bytes() == (two / file).read_bytes(), file
    first, second = (json.loads((run / "metrics.json").read_text()) for run in two_runs)
    for scores in (first, second):
        assert scores["alone"].pop("timing").keys() == {"learning_s", "step_s"}
    assert first == second


@pytest.mark.slow
def test_the_dataset_holds_what_was_learned(two_runs: list[Path]):
    demonstrations = load_demonstrations(two_runs[0] / "dataset")
    assert len(demonstrations) == 3
    network = PACNet.from_pretrained(two_runs[0] / "checkpoint").eval()
    last = demonstrations.episodes[-1]
    recall = network.recall(last.percepts)
    assert recall.has_target.float().mean() > 0.95
    error = (recall.target - last.action)[recall.has_target].abs().mean()
    assert error < 0.01  # [rad]: most frames recall their very own target


@pytest.mark.slow
def test_the_shipped_checkpoint_recalls(tmp_path: Path):
    done = run_script("recall", SHIPPED, "--episodes", 5, "--seed", 12, "--runs", tmp_path)
    scores = json.loads((only_run(tmp_path) / "metrics.json").read_text())
    assert scores["task_success_rate"] == 1.0
    assert "task_success_rate" in done.stdout
    assert (only_run(tmp_path) / "recall.mp4").stat().st_size > 10_000


def test_the_shipped_checkpoint_says_how_it_was_made():
    scores = json.loads((SHIPPED / "metrics.json").read_text())
    assert scores["command"].startswith("python -m train.postural_imitation --seed")
    assert scores["nodes"] == len(PACNet.from_pretrained(SHIPPED).sofm)
    assert scores["recall_episodes"] == 100
    assert scores["task_success_rate"] >= 0.95
    assert scores["wrist_distance_mean_m"] <= 0.02
    assert scores["wrist_distance_max_m"] <= 0.06
    assert 9 <= scores["nodes"] <= 20
    assert scores["winner_order_agreement"] >= 0.95


def test_a_missing_checkpoint_ends_with_one_line_and_an_exit_code(tmp_path: Path):
    command = [sys.executable, "-m", "train.recall", str(tmp_path / "nowhere")]
    done = subprocess.run(command, cwd=PROJECT, capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert done.stderr.startswith("error: expected a checkpoint folder")
    assert done.stderr.count("\n") == 1


@pytest.mark.slow
def test_ctrl_c_while_recalling_keeps_dataset_and_checkpoint(tmp_path: Path):
    command = [sys.executable, "-m", "train.postural_imitation", "--demonstrations", "2"]
    interrupt([*command, "--runs", str(tmp_path)], tmp_path, lambda text: "recalling:" in text)
    folder = only_run(tmp_path)
    assert len(load_demonstrations(folder / "dataset")) == 2
    assert len(PACNet.from_pretrained(folder / "checkpoint").sofm) > 1


def test_scores_are_the_means_of_hand_made_episodes():
    from pacnet import NO_NODE
    from train.postural.episodes import RecallEpisode
    from train.postural.scores import score_episodes, score_order

    def episode(offset: float, winners: list[int], success: bool) -> RecallEpisode:
        samples = len(winners)
        line = np.linspace([0.0, 0, 0], [1.0, 0, 0], samples)
        return RecallEpisode(
            percepts=np.zeros((samples, 28), dtype=np.float32),
            winners=np.array(winners),
            phases=np.full(samples, "lift"),
            commanded=np.array(winners) != NO_NODE,
            demonstrator_wrist=line,
            imitator_wrist=line + np.array([0, offset, 0]),
            demonstrator_angles=np.zeros((samples, 11)),
            imitator_angles=np.full((samples, 11), np.deg2rad(2.0)),
            rim_to_mouth=0.01,
            glass_from_place=0.02,
            success=success,
            demonstrator_success=True,
        )

    episodes = [
        episode(0.01, [0, 0, 0, 1, 1, 1], success=True),
        episode(0.03, [0, 0, 0, NO_NODE, NO_NODE, NO_NODE], success=False),
    ]
    scores = score_episodes(episodes)
    assert scores["task_success_rate"] == 0.5
    assert scores["wrist_distance_mean_m"] == pytest.approx(0.02)
    assert scores["wrist_distance_max_m"] == pytest.approx(0.03)
    assert scores["area_between_curves_m2"] == pytest.approx(0.02)  # strips of 1 m x 1 and 3 cm
    assert scores["joint_rms_deg"] == pytest.approx(2.0)
    assert scores["commanded_share"] == pytest.approx(0.75)
    assert scores["switches_per_episode"] == pytest.approx(0.5)
    assert score_order(episodes, np.array([0, 0, 0, 1, 1, 1])) == pytest.approx(0.75)
