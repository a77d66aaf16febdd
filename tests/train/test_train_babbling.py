"""Babbling: what is recorded, how a body is scored, what a run leaves behind."""

import json
import sys
from pathlib import Path

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation
from training_runs import only_run

from envs.humanoid import JOINTS
from envs.kinematics import BodyKinematics
from pacnet import KinematicModel
from pacnet.datasets.demonstrations import load_demonstrations
from pacnet.forward_models.kinematic_arrays import HandPose
from train import babbling
from train.postural.babbling import network, recording, scores
from train.postural.babbling.figures import error_curves
from train.postural.babbling.scores import FUNCTION, PRODUCTS, Score

SEED, COUNT = 11, 90  # more than the 75 postures of an episode


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("babbling") / "dataset"
    recording.record(folder, SEED, COUNT)
    return folder


def test_postures_are_recorded_with_where_the_hand_was_seen(dataset: Path):
    episodes = load_demonstrations(dataset)
    assert [len(one.action) for one in episodes] == [75, 15]  # an episode takes 15 s
    assert episodes.fps == 5
    babble, body = recording.load(dataset), BodyKinematics()
    poses = [body.pose(angles) for angles in babble.angles]
    off = babble.places - [pose.grip for pose in poses]
    # Seen with 5 mm of noise, and from angles with .01 rad of noise, at an arm's length of .6 m.
    assert 0.004 < off.std() < 0.009
    assert np.abs(off.mean(axis=0)).max() < 0.003
    seen = Rotation.from_quat(np.roll(babble.turns, -1, axis=1))
    turned = seen * Rotation.from_matrix(np.array([pose.hand for pose in poses])).inv()
    # Three dimensions of .01 rad, and the noise of four angles.
    assert 0.017 < np.sqrt(np.square(turned.magnitude()).mean()) < 0.035


def test_postures_span_the_range_of_every_joint(dataset: Path):
    low, high = BodyKinematics().joint_range.T
    angles = recording.load(dataset).angles
    shares = (angles - low) / (high - low)
    assert (shares.min(axis=0) < 0.1).all()
    assert (shares.max(axis=0) > 0.9).all()
    sent = np.concatenate([one.action.numpy() for one in load_demonstrations(dataset)])
    assert (sent >= low - 1e-6).all()
    assert (sent <= high + 1e-6).all()


def test_the_same_seed_gives_the_same_postures(dataset: Path, tmp_path: Path):
    first = recording.load(dataset)
    recording.record(tmp_path / "again", SEED, 20)
    recording.record(tmp_path / "other", SEED + 1, 20)
    again, other = recording.load(tmp_path / "again"), recording.load(tmp_path / "other")
    for rows, same, different in zip(first, again, other, strict=True):
        assert rows[:20].tobytes() == same.tobytes()
        assert not np.allclose(rows[:20], different)


def test_errors_are_those_of_a_body_that_is_off_by_as_much():
    truth = scores.held_out(SEED)
    assert truth.angles.shape == (scores.HELD_OUT, len(JOINTS))
    tilt = Rotation.from_rotvec([0, 0.1, 0])

    def off(_: torch.Tensor) -> HandPose:
        turns = tilt * Rotation.from_quat(np.roll(truth.turns, -1, axis=1))
        moved = truth.places + np.array([0.003, 0.004, 0.0])
        return HandPose(torch.from_numpy(moved), torch.from_numpy(recording.quaternion(turns)))

    found = scores.score(off, truth, 1.5)
    assert found == pytest.approx(Score(5.0, np.degrees(0.1), 1.5))  # 3² + 4² = 5²


def test_the_simulator_called_as_a_function_is_exact():
    found = scores.score(scores.from_simulator(), scores.held_out(SEED), 0.0)
    assert found.place_rms_mm < 1e-6
    assert found.turn_rms_deg < 1e-4


@pytest.mark.parametrize("waves", [False, True])
def test_a_network_learns_where_the_hand_is(monkeypatch: pytest.MonkeyPatch, waves: bool):
    monkeypatch.setattr(network, "STEPS", 300)
    truth = scores.held_out(SEED)
    state = torch.random.get_rng_state()
    body = network.fit_network(truth, 64, waves, SEED)
    assert torch.equal(torch.random.get_rng_state(), state)
    found = scores.score(body, truth, 0.0)
    assert found.place_rms_mm < 0.3 * 1000 * np.linalg.norm(truth.places.std(axis=0))
    again = network.fit_network(truth, 64, waves, SEED)
    angles = torch.from_numpy(truth.angles[:9])
    assert torch.equal(body(angles).place, again(angles).place)


def test_the_figure_draws_each_way_over_the_postures():
    ways = {400: {"one": Score(8, 1, 0), "two": Score(20, 1, 0)}}
    ways[5000] = {"one": Score(2, 1, 0), "two": Score(9, 1, 0), FUNCTION: Score(0, 0, 0)}
    lines = error_curves(ways).axes[0].get_lines()
    assert [line.get_label() for line in lines] == ["one", "two"]
    assert [list(line.get_ydata()) for line in lines] == [[8, 2], [20, 9]]
    assert list(lines[0].get_xdata()) == [400, 5000]


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (["--postures", "323"], "--postures: expected ≥ 324, got 323"),
        (["--postures", "few"], "expected an integer ≥ 1, got 'few'"),
        (["--seed", "-1"], "expected an integer ≥ 0, got '-1'"),
    ],
)
def test_arguments_out_of_range_are_refused(
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    given: list[str],
    message: str,
):
    monkeypatch.setattr(sys, "argv", ["babbling", *given])
    with pytest.raises(SystemExit):
        babbling.parse_arguments()
    assert message in capsys.readouterr().err


def test_a_run_leaves_dataset_checkpoint_scores_and_figure(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    monkeypatch.setattr(network, "STEPS", 20)
    monkeypatch.setattr(sys, "argv", ["babbling", "--postures", "500", "--runs", str(tmp_path)])
    babbling.main()
    folder = only_run(tmp_path)
    assert {path.name for path in folder.iterdir()} == {
        "dataset", "checkpoint", "figures", "tensorboard", "metrics.json"
    }  # fmt: skip
    found = json.loads((folder / "metrics.json").read_text())
    assert found["command"] == "python -m train.babbling --seed 0 --postures 500"
    assert found["moving"] == [name for name in JOINTS if name.startswith("right")]
    assert list(found["by_postures"]) == ["400", "500"]
    assert found["ways"][PRODUCTS]["place_rms_mm"] == found["place_rms_mm"]
    assert found["ways"][FUNCTION]["place_rms_mm"] < 1e-6
    model = KinematicModel.from_pretrained(folder / "checkpoint")
    again = scores.score(model, scores.held_out(0), 0.0)
    assert again.place_rms_mm == pytest.approx(found["place_rms_mm"])
    assert again.place_rms_mm < 15
    assert (folder / "figures/babbling.png").stat().st_size > 0
    assert f"{again.place_rms_mm:10.2f}" in capsys.readouterr().out


def test_the_shipped_body_is_as_good_as_its_scores_say():
    folder = Path(__file__).parents[2] / "checkpoints/body"
    shipped = json.loads((folder / "metrics.json").read_text())
    model = KinematicModel.from_pretrained(folder)
    found = scores.score(model, scores.held_out(shipped["seed"]), 0.0)
    assert model.config.joints == JOINTS
    assert found.place_rms_mm == pytest.approx(shipped["place_rms_mm"], rel=1e-6)
    assert found.turn_rms_deg == pytest.approx(shipped["turn_rms_deg"], rel=1e-6)
    assert found.place_rms_mm < 3
