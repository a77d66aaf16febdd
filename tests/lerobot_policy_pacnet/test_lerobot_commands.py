"""LeRobot's own commands train, resume, evaluate and run the policy, each in its own process."""

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
import torch

pytest.importorskip("lerobot")
pytest.importorskip("accelerate", reason="lerobot-train needs the extra lerobot[training]")
pytest.importorskip("lerobot_policy_pacnet")
pytest.importorskip("dm_control")

from envs.humanoid import JOINTS as JOINT_NAMES
from envs.kinematics import BodyKinematics
from pacnet.datasets.demonstrations import load_demonstrations
from pacnet.datasets.recorder import Recorder
from pacnet.forward_models.kinematics import KinematicModel
from pacnet.imitator.imitator import Imitator
from train.postural.behaviours.episodes import TASKS
from train.postural.episodes import (
    Condition,
    demonstration_seeds,
    make_environment,
    watch_demonstration,
)
from train.postural.learning import FEATURES, frames_of

pytestmark = pytest.mark.slow

OLD = sys.version_info < (3, 12)  # LeRobot 0.4.4
BATCH = 256
EPISODES = 10 if OLD else 50  # 0.4.4 takes twice as long
JOINTS = ("shoulder.pos", "elbow.pos")

FAKE_ROBOT = '''
"""A robot of two joints that reach every command at once, for `--robot.type=fake`."""

import json
from dataclasses import dataclass

from lerobot.robots import Robot, RobotConfig

JOINTS = ("shoulder.pos", "elbow.pos")


@RobotConfig.register_subclass("fake")
@dataclass
class FakeRobotConfig(RobotConfig):
    log: str = ""


class FakeRobot(Robot):
    config_class = FakeRobotConfig
    name = "fake"
    cameras = {}
    is_connected = False
    is_calibrated = True
    observation_features = action_features = dict.fromkeys(JOINTS, float)

    def __init__(self, config):
        super().__init__(config)
        self.log, self.at, self.commands = config.log, dict.fromkeys(JOINTS, 0.0), []

    def connect(self, calibrate=True):
        self.is_connected = True

    def calibrate(self):
        pass

    def configure(self):
        pass

    def get_observation(self):
        return dict(self.at)

    def send_action(self, action):
        self.at = {name: float(action[name]) for name in JOINTS}
        self.commands.append(list(self.at.values()))
        return action

    def disconnect(self):
        self.is_connected = False
        with open(self.log, "w") as file:
            json.dump(self.commands, file)
'''


def start(command: str, *arguments: str, where: Path) -> subprocess.Popen:
    """Begins one of LeRobot's commands, in a folder that is not the repository."""
    homes = {name: str(where / "home") for name in ("HF_HOME", "HF_LEROBOT_HOME")}
    environment = {**os.environ, **homes, "HF_HUB_OFFLINE": "1", "OMP_NUM_THREADS": "1"}
    paths = [str(where / "plugins"), *filter(None, [os.environ.get("PYTHONPATH")])]
    environment |= {"MUJOCO_GL": "disable", "PYTHONPATH": os.pathsep.join(paths)}
    return subprocess.Popen(
        [sys.executable, "-m", f"lerobot.scripts.lerobot_{command}", *arguments],
        cwd=where,
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )


def run(command: str, *arguments: str, where: Path) -> str:
    """Run one of LeRobot's commands to its end."""
    process = start(command, *arguments, where=where)
    printed, _ = process.communicate()
    assert process.returncode == 0, printed[-3000:]
    return printed


def record(folder: Path, behaviour: str, seed: int) -> Path:
    """Eight demonstrations."""
    environment, task = make_environment(Condition(behaviour=behaviour)), TASKS[behaviour]
    with Recorder(folder, 50, FEATURES, "postural_imitation") as recorder:
        for one in demonstration_seeds(seed, 8):
            recorder.save_episode(task, frames_of(watch_demonstration(environment, one)))
    return folder


def steps_of(dataset: Path) -> int:
    """Steps of one pass."""
    info = json.loads((dataset / "meta" / "info.json").read_text())
    return -(-info["total_frames"] // BATCH)


def training_of(dataset: Path, *arguments: str) -> list[str]:
    return [
        f"--dataset.repo_id=local/{dataset.name}",
        f"--dataset.root={dataset}",
        f"--batch_size={BATCH}",
        f"--steps={steps_of(dataset)}",
        "--num_workers=0",
        *arguments,
    ]


def checkpoint_in(output: Path) -> Path:
    return output / "checkpoints" / "last" / "pretrained_model"


def success(checkpoint: Path, task: str, where: Path) -> float:
    """The share of successes that lerobot-eval finds, on seeds from 0."""
    output = where / f"eval-{task}-{checkpoint.parents[2].name}"
    run(
        "eval",
        f"--policy.path={checkpoint}",
        "--env.type=pacnet",
        f"--env.task={task}",
        "--env.picture_every=1000",  # drawing takes most of the time otherwise
        f"--eval.n_episodes={EPISODES}",
        "--eval.batch_size=10",
        "--eval.use_async_envs=false",
        "--seed=0",
        f"--output_dir={output}",
        where=where,
    )
    info = json.loads((output / "eval_info.json").read_text())
    return info["overall"]["pc_success"] / 100


@pytest.fixture(scope="module")
def where(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("lerobot")


@pytest.fixture(scope="module")
def drinking(where: Path) -> Path:
    return record(where / "drinking", "drink", seed=0)


@pytest.fixture(scope="module")
def trained(where: Path, drinking: Path) -> Path:
    """A checkpoint after one pass over the drinking dataset."""
    output = where / "trained"
    run(
        "train",
        *training_of(drinking, "--policy.type=pacnet", f"--output_dir={output}"),
        where=where,
    )
    return checkpoint_in(output)


@pytest.fixture(scope="module")
def drinks(where: Path, trained: Path) -> float:
    """How often the trained policy drinks."""
    return success(trained, "Drink-v0", where)


def assert_learned(checkpoint: Path, expected: Imitator) -> None:
    found = Imitator.from_pretrained(checkpoint / "imitator")
    tensors = expected.state_dict()
    assert found.reports == expected.reports
    assert found.state_dict().keys() == tensors.keys()
    assert all(torch.equal(found.state_dict()[name], tensors[name]) for name in tensors)


def test_one_pass_learns_the_dataset_in_order(trained: Path, drinking: Path):
    demonstrations = load_demonstrations(drinking)
    expected = Imitator.from_demonstrations(demonstrations)
    expected.learn(demonstrations)
    assert_learned(trained, expected)


def test_a_killed_training_is_resumed(trained: Path, drinking: Path, where: Path):
    output = where / "resumed"
    settings = training_of(drinking, "--policy.type=pacnet", f"--output_dir={output}")
    process = start("train", *settings, "--save_freq=3", where=where)
    while not checkpoint_in(output).exists() and process.poll() is None:
        time.sleep(0.05)
    process.send_signal(signal.SIGKILL)
    process.communicate()
    # LeRobot 0.4.4 does not go on with a pass that was interrupted: it begins another.
    steps = 2 * steps_of(drinking) if OLD else steps_of(drinking)
    config = checkpoint_in(output) / "train_config.json"
    again = (f"--config_path={config}", "--resume=true", f"--steps={steps}")
    run("train", *again, where=where)
    assert_learned(checkpoint_in(output), Imitator.from_pretrained(trained / "imitator"))


def test_one_pass_is_enough_to_drink(drinks: float):
    assert drinks >= 0.9


def test_a_body_is_learned_with_and_drinks_alone(drinking: Path, where: Path):
    kinematics, output = BodyKinematics(), where / "alone"

    def hand(angles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        pose = kinematics.pose(angles)
        return pose.grip, pose.hand

    body = KinematicModel.from_function(hand, JOINT_NAMES, *kinematics.joint_range.T)
    body.save_pretrained(where / "body")
    training = training_of(drinking, "--policy.type=pacnet", f"--output_dir={output}")
    run("train", *training, f"--policy.body={where / 'body'}", where=where)
    shutil.rmtree(where / "body")
    demonstrations = load_demonstrations(drinking)
    expected = Imitator.from_demonstrations(demonstrations, body=body)
    expected.learn(demonstrations)
    assert_learned(checkpoint_in(output), expected)
    assert success(checkpoint_in(output), "DrinkAlone-v0", where) >= 0.9


def test_a_second_behaviour_leaves_the_first(trained: Path, drinks: float, where: Path):
    toasting, output = record(where / "toasting", "toast", seed=1), where / "both"
    more = (f"--policy.path={trained}", f"--output_dir={output}")
    run("train", *training_of(toasting, *more), where=where)
    first, both = (
        Imitator.from_pretrained(checkpoint / "imitator")
        for checkpoint in (trained, checkpoint_in(output))
    )
    assert [report.dataset for report in both.reports] == ["drinking"] * 8 + ["toasting"] * 8
    assert both.config == first.config  # the scale of percepts among others
    assert success(checkpoint_in(output), "Drink-v0", where) >= drinks - 0.02


def test_a_robot_is_driven(where: Path):
    time_ = np.arange(0, 3, 1 / 30)
    path = np.stack([np.sin(2 * time_), 1 - np.cos(2 * time_)], axis=1).astype(np.float32)
    rng = np.random.default_rng(0)
    dataset, output, log = where / "circling", where / "circles", where / "commands.json"
    with Recorder(dataset, 30, {"observation.state": JOINTS, "action": JOINTS}) as recorder:
        for _ in range(5):
            seen = path + 0.01 * rng.standard_normal(path.shape).astype(np.float32)
            ahead = np.concatenate([path[3:], path[-3:]])
            recorder.save_episode("circle", {"observation.state": seen, "action": ahead})
    training = training_of(dataset, "--policy.type=pacnet", f"--output_dir={output}")
    run("train", *training, where=where)

    plugins = where / "plugins"
    information = plugins / "lerobot_robot_fake-0.1.dist-info"
    information.mkdir(parents=True)
    (information / "METADATA").write_text("Metadata-Version: 2.1\nName: lerobot_robot_fake\n")
    (plugins / "lerobot_robot_fake.py").write_text(FAKE_ROBOT)
    robot = ("--robot.type=fake", "--robot.id=one", f"--robot.log={log}", "--play_sounds=false")
    policy = f"--policy.path={checkpoint_in(output)}"
    if OLD:
        recording = (
            "--dataset.repo_id=local/eval_circling",
            f"--dataset.root={where / 'eval_circling'}",
            "--dataset.single_task=circle",
            "--dataset.fps=30",
            "--dataset.num_episodes=1",
            "--dataset.episode_time_s=3",
            "--dataset.push_to_hub=false",
        )
        run("record", policy, *robot, *recording, where=where)
    else:
        alone = ("--task=circle", "--fps=30", "--duration=3", "--return_to_initial_position=false")
        run("rollout", policy, *robot, *alone, where=where)
    commands = np.array(json.loads(log.read_text()))
    off = np.linalg.norm(commands[:, None] - path, axis=2).min(axis=1)
    assert off.max() < 0.1
    assert np.ptp(commands, axis=0).min() > 0.9 * np.ptp(path, axis=0).min()


def test_the_plugin_is_imported_without_a_simulator():
    code = (
        "import sys, lerobot_policy_pacnet; "
        "sys.exit(bool({'mujoco', 'dm_control', 'envs', 'numba'} & set(sys.modules)))"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
