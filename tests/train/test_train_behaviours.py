"""Several behaviours: episodes, scores by hand, the pool, the whole command."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
import torch

from envs.kinematics import BodyKinematics
from pacnet import PACNet, Recognition
from pacnet.datasets.demonstrations import load_demonstrations
from train.common.pool import share_out
from train.postural.behaviours.episodes import ONE, SEVERAL, BehaviourEpisode
from train.postural.behaviours.figures import naming, novelty
from train.postural.behaviours.scores import (
    area_under_roc,
    score_novelty,
    score_recall,
    score_recognition,
)
from train.postural.episodes import RecallEpisode

PROJECT = Path(__file__).parents[2]
PHASES = ["rest"] * 2 + ["approach"] * 6 + ["grasp"] * 2 + ["lift"] * 10  # 20 samples
TAUGHT = ("drink", "toast")


def make_recall(samples: int, success: bool = True) -> RecallEpisode:
    line = np.linspace([0.0, 0, 0], [1.0, 0, 0], samples)
    return RecallEpisode(
        percepts=np.ones((samples, 28), dtype=np.float32)
        * np.arange(samples, dtype=np.float32)[:, None],
        winners=np.zeros(samples, dtype=np.int64),
        commanded=np.arange(samples) % 4 > 0,
        phases=np.array(PHASES[:samples]),
        demonstrator_wrist=line,
        imitator_wrist=line + np.array([0, 0.02, 0]),
        demonstrator_angles=np.zeros((samples, 11)),
        imitator_angles=np.zeros((samples, 11)),
        rim_to_mouth=0.01,
        glass_from_place=0.02,
        success=success,
        demonstrator_success=True,
    )


def make_episode(behaviour: str = "drink", right_from: int = 0, **fields: object):
    """An episode in which the right behaviour is named from a sample on."""
    samples = len(PHASES)
    kind = TAUGHT.index(behaviour) if behaviour in TAUGHT else 0
    right = torch.arange(samples) >= right_from
    named = torch.where(right, kind, 1 - kind)
    recognition = Recognition(
        probability=torch.nn.functional.one_hot(named, 2).float(),
        behaviour=named,
        progress=torch.linspace(0, 1, samples),
        next_percept=torch.zeros(samples, 28),
        end_percept=torch.zeros(samples, 28),
        novelty=torch.full((samples,), 0.1),
        is_novel=torch.zeros(samples, dtype=torch.bool),
        winner=torch.zeros(samples, dtype=torch.int64),
    )._replace(**fields)
    recalls = {SEVERAL: make_recall(samples), ONE: make_recall(samples, success=False)}
    return BehaviourEpisode(behaviour, recalls, recognition)


def test_the_end_of_the_approach_and_the_parting_of_behaviours():
    episode = make_episode()
    assert episode.approached == 8
    assert episode.parting == 10


def test_recall_is_scored_by_system_and_behaviour():
    scores = score_recall([make_episode("drink"), make_episode("toast")], TAUGHT)
    assert scores[SEVERAL]["toast"]["task_success_rate"] == 1
    assert scores[ONE]["toast"]["task_success_rate"] == 0
    assert scores[ONE]["drink"]["wrist_distance_mean_m"] == pytest.approx(0.02)
    assert scores[SEVERAL]["drink"]["commanded_share"] == pytest.approx(0.75)


def test_the_wrists_are_also_compared_where_the_behaviours_part():
    near, far = make_episode(), make_episode()
    far.recalls[SEVERAL].imitator_wrist[10:12] += [0, 0.06, 0]  # a tenth of 20 samples from there
    far.recalls[SEVERAL].imitator_wrist[12:] += [0, 9, 0]
    scores = score_recall([near, far], ("drink",))[SEVERAL]["drink"]
    assert scores["wrist_distance_at_parting_m"] == pytest.approx((0.02 + 0.08) / 2)
    assert scores["wrist_distance_at_parting_max_m"] == pytest.approx(0.08)


def test_a_behaviour_should_be_named_within_a_tenth_of_an_episode():
    # Parting at sample 10 of 20, so due at sample 12.
    episodes = [make_episode("drink", 12), make_episode("toast", 13), make_episode("toast", 0)]
    scores = score_recognition(episodes, TAUGHT)
    assert scores["named_within_a_tenth_share"] == pytest.approx(2 / 3)
    assert scores["named_after_a_tenth_samples_share"] == pytest.approx((8 + 7 + 8) / 24)
    assert scores["named_after_share_of_episode_max"] == pytest.approx(3 / 20)
    assert scores["named_after_share_of_episode_median"] == pytest.approx(2 / 20)


def test_progress_is_scored_against_a_steady_pace():
    late = torch.linspace(0, 1, 20) - 0.25
    scores = score_recognition([make_episode(progress=late), make_episode()], TAUGHT)
    assert scores["progress_error_mean"] == pytest.approx(0.125)
    assert scores["progress_error_max"] == pytest.approx(0.25)


def test_the_expected_end_is_scored_by_where_it_puts_the_wrist():
    angles = np.deg2rad([0.0, 0, 0, -43, 59, -40, 116, 58, -46, -11, 78])
    end = torch.zeros(20, 28)
    end[10, :11] = torch.from_numpy(angles)  # halfway; what is expected earlier does not count
    episode = make_episode(end_percept=end)
    wrist = BodyKinematics().pose(angles).wrist
    episode.shown.demonstrator_wrist[-1] = wrist + np.array([0.03, 0, 0.04])
    scores = score_recognition([episode], TAUGHT)
    assert scores["end_wrist_error_mean_m"] == pytest.approx(0.05, abs=1e-6)


def test_the_next_percept_is_scored_against_expecting_no_change():
    rising = np.arange(20, dtype=np.float32)[:, None] * 2 + np.zeros((1, 28), dtype=np.float32)
    halfway = torch.from_numpy(rising) + 1  # of the two that it rises by in each sample
    episode = make_episode(next_percept=halfway)
    episode.shown.percepts[:] = rising
    scores = score_recognition([episode], TAUGHT)
    assert scores["next_percept_error_to_persistence"] == pytest.approx(0.5)


def test_novelty_is_scored_per_episode_and_per_frame_after_the_approach():
    quiet = torch.full((20,), 0.1)
    early = quiet.clone()
    early[:8] = 0.9  # during the approach, which counts for the episode alone
    late = quiet.clone()
    late[14:] = 0.5
    known = [make_episode(), make_episode(novelty=early, is_novel=early > 0.3)]
    new = [make_episode("move", novelty=late, is_novel=late > 0.3)]
    scores = score_novelty(known, new)
    # Means .1 and .42 against .22: the new one is above the first alone.
    assert scores["auroc_per_episode"] == pytest.approx(0.5)
    # Frames after the approach: 24 of .1 against 6 of .1 (ties) and 6 of .5.
    assert scores["auroc_per_frame_after_approach"] == pytest.approx(0.75)
    assert scores["false_alarm_share"] == pytest.approx(8 / 40)
    assert scores["alarm_share_new_after_approach"] == pytest.approx(0.5)


def test_the_figures_show_each_behaviour_and_the_threshold():
    curves = {name: [np.linspace(0.5, 1, 60), np.linspace(0.4, 1, 70)] for name in TAUGHT}
    figure = naming(curves, {name: [20, 25] for name in TAUGHT}, [0.5, 0.7], timestep=0.1)
    assert len(figure.axes[0].lines) == 4  # two medians, the parting, the deadline
    median = figure.axes[0].lines[0].get_ydata()
    assert median[25] == pytest.approx((curves["drink"][0][20] + curves["drink"][1][25]) / 2)
    figure = novelty([0.1, 0.1], [0.9], 0.3, ("known", "new"))
    assert figure.axes[0].lines[0].get_xdata()[0] == 0.3


class Doubler:
    """A worker for the pool."""

    def __init__(self, factor: int) -> None:
        self.factor = factor

    def run(self, task: int) -> int:
        """Its task, times its factor."""
        return self.factor * task


@pytest.mark.parametrize("count", [3, 40], ids=["here", "in a pool"])
def test_shared_tasks_come_back_in_their_order(count: int, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("train.common.pool.usable_cores", lambda: 2)
    assert share_out(Doubler, (2,), range(count), "doubling") == [2 * n for n in range(count)]


@pytest.mark.slow
def test_the_command_writes_all_documented_files(tmp_path: Path):
    command = [sys.executable, "-m", "train.behaviours", "--seed", "1000", "--episodes", "2"]
    command += ["--demonstrations", "4", "--runs", str(tmp_path)]
    done = subprocess.run(command, cwd=PROJECT, capture_output=True, text=True, check=True)
    (folder,) = (tmp_path / "behaviours").iterdir()
    assert str(folder) in done.stdout
    scores = json.loads((folder / "metrics.json").read_text())
    assert scores["command"].startswith("python -m train.behaviours --seed 1000")
    assert scores["recall"][SEVERAL]["drink"]["task_success_rate"] == 1
    assert scores["recall"][SEVERAL]["toast"]["task_success_rate"] == 1
    assert scores["novelty"]["auroc_per_episode"] == 1
    tasks = [demonstration.task for demonstration in load_demonstrations(folder / "dataset")]
    network = PACNet.from_pretrained(folder / "checkpoint")
    assert network.behaviours == tuple(tasks[:2])
    assert tasks == tasks[:2] * 4
    names = {picture.stem for picture in (folder / "figures").iterdir()}
    expected = {"naming", "novelty"}
    assert names == expected | {f"recognised_{name}" for name in ("drink", "toast", "move")}


SHARED = """
import time
from train.common.pool import share_out

class Sleeper:
    def run(self, task):
        time.sleep(60)

if __name__ == "__main__":
    share_out(Sleeper, (), range(40), "sleeping")
"""


@pytest.mark.slow
@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGINT], ids=["killed", "interrupted"])
def test_the_processes_of_a_pool_end_with_their_parent(how: signal.Signals, tmp_path: Path):
    (tmp_path / "shared.py").write_text(SHARED)
    process = subprocess.Popen(
        [sys.executable, str(tmp_path / "shared.py")],
        env={**os.environ, "PYTHONPATH": str(PROJECT)},
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        # A background job hands down an ignored SIGINT.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )
    time.sleep(15)  # for its processes to start
    os.kill(process.pid, how)
    process.communicate(timeout=1800)  # until none of them holds its end of the pipe
    assert process.returncode != 0


def test_area_under_roc_equals_counting_all_pairs():
    generator = np.random.default_rng(0)
    known, new = generator.integers(0, 6, 40), generator.integers(2, 9, 30)
    pairs = [1.0 if n > k else 0.5 if n == k else 0.0 for k in known for n in new]
    assert area_under_roc(known, new) == pytest.approx(np.mean(pairs))
    assert area_under_roc([0.0, 1.0], [2.0, 3.0]) == 1.0
    assert area_under_roc([2.0, 3.0], [0.0, 1.0]) == 0.0


@pytest.mark.parametrize(
    ("known", "new", "message"),
    [
        ([], [1.0], "one or more scores"),
        ([1.0], [np.nan], "finite new"),
        ([[1.0]], [1.0], "known as numbers"),
    ],
)
def test_area_under_roc_of_no_scores_is_refused(known: list, new: list, message: str):
    with pytest.raises(ValueError, match=message):
        area_under_roc(known, new)
