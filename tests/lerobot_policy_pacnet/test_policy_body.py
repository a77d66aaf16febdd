"""The policy takes a body when training begins, and keeps it in its imitator."""

import json
import shutil
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import torch

pytest.importorskip("lerobot")
pytest.importorskip("lerobot_policy_pacnet")

import draccus
from lerobot.configs.policies import PreTrainedConfig
from lerobot.configs.types import FeatureType, PolicyFeature
from lifting import ACTION, CUP, NAMES, STATE, SURROUNDINGS, arm, arm_in, hand_of, lifts

from lerobot_policy_pacnet import PACNetConfig, PACNetPolicy
from pacnet.datasets.demonstrations import Demonstrations
from pacnet.forward_models.config import MLPForwardModelConfig
from pacnet.forward_models.kinematics import KinematicModel
from pacnet.forward_models.mlp import MLPForwardModel
from pacnet.imitator.imitator import Imitator

SHOWN = lifts((0.35, 0.1, 0.02), (0.3, 0.0, 0.02))
MORE = lifts((0.38, 0.05, 0.02), seed=1)
KINDS = {STATE: FeatureType.STATE, SURROUNDINGS: FeatureType.ENV, ACTION: FeatureType.ACTION}


@dataclass
class Settings:
    """Settings of a command of LeRobot's that takes a policy."""

    policy: PreTrainedConfig


def config_of(**settings) -> PACNetConfig:
    features = {name: PolicyFeature(KINDS[name], (len(parts),)) for name, parts in NAMES.items()}
    action = {ACTION: features.pop(ACTION)}
    return PACNetConfig(device="cpu", input_features=features, output_features=action, **settings)


def meta_of(dataset: Demonstrations) -> SimpleNamespace:
    """What LeRobot's metadata say of a dataset."""
    features = {
        name: {"dtype": "float32", "shape": (len(parts),), "names": list(parts)}
        for name, parts in dataset.names.items()
    }
    mean = np.concatenate([one.action.numpy() for one in dataset]).mean(axis=0)
    return SimpleNamespace(
        fps=dataset.fps,
        features=features,
        total_frames=sum(len(one.state) for one in dataset),
        total_episodes=len(dataset),
        stats={ACTION: {"mean": mean}},
        repo_id="local/lifts",
        root=Path("/nowhere/lifts"),
    )


def batches(dataset: Demonstrations, size: int = 64) -> Iterator[dict]:
    """One pass over a dataset, shuffled."""
    lengths = torch.tensor([len(one.state) for one in dataset])
    columns = {
        STATE: torch.cat([one.state for one in dataset]),
        SURROUNDINGS: torch.cat([one.environment_state for one in dataset]),
        ACTION: torch.cat([one.action for one in dataset]),
        "index": torch.arange(int(lengths.sum())),
        "episode_index": torch.arange(len(lengths)).repeat_interleave(lengths),
    }
    order = torch.randperm(int(lengths.sum()), generator=torch.Generator().manual_seed(0))
    for rows in order.split(size):
        task = ["lift the cup"] * len(rows)
        yield {**{name: column[rows] for name, column in columns.items()}, "task": task}


def learn(policy: PACNetPolicy, dataset: Demonstrations, most: int | None = None) -> PACNetPolicy:
    for batch in list(batches(dataset))[:most]:
        policy.train()
        policy.forward(batch)
    return policy


def policy_for(dataset: Demonstrations = SHOWN, **settings) -> PACNetPolicy:
    return PACNetPolicy(config_of(**settings), dataset_meta=meta_of(dataset))


def loaded(folder: Path, dataset: Demonstrations | None = None, **settings) -> PACNetPolicy:
    """From a checkpoint, with its own settings and these."""
    config = PreTrainedConfig.from_pretrained(folder)
    for name, value in settings.items():
        setattr(config, name, value)
    meta = None if dataset is None else meta_of(dataset)
    return PACNetPolicy.from_pretrained(folder, config=config, dataset_meta=meta)


def assert_same(found: Imitator | None, expected: Imitator) -> None:
    assert found is not None
    assert found.config == expected.config
    tensors = expected.state_dict()
    assert found.state_dict().keys() == tensors.keys()
    assert all(torch.equal(one, tensors[name]) for name, one in found.state_dict().items())


@pytest.fixture(scope="module")
def body(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return arm_in(tmp_path_factory.mktemp("bodies") / "arm")


@pytest.fixture(scope="module")
def trained(body: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A policy's folder; that of its body is gone."""
    folder, copied = tmp_path_factory.mktemp("policies") / "lifter", body.parent / "copied"
    shutil.copytree(body, copied)
    learn(policy_for(points=[CUP], body=str(copied)), SHOWN).save_pretrained(folder)
    shutil.rmtree(copied)
    return folder


@pytest.fixture(scope="module")
def expected() -> Imitator:
    imitator = Imitator.from_demonstrations(SHOWN, points=[CUP], body=arm())
    imitator.learn(SHOWN)
    return imitator


def test_it_learns_what_the_imitator_does(trained: Path, expected: Imitator):
    assert_same(loaded(trained).imitator, expected)
    saved = json.loads((trained / "config.json").read_text())
    assert (saved["body"], saved["points"]) == (None, [CUP])


def test_landmarks_are_found_by_their_names(body: Path, expected: Imitator):
    assert_same(learn(policy_for(body=str(body)), SHOWN).imitator, expected)


def test_it_acts_with_the_body(trained: Path):
    policy, shown = loaded(trained).eval(), lifts((0.33, 0.06, 0.02), seed=5).episodes[0]
    policy.reset()
    for frame in range(33):
        action = policy.select_action(
            {STATE: shown.state[frame : frame + 1],
             SURROUNDINGS: shown.environment_state[frame : frame + 1]}
        )  # fmt: skip
    hand, _ = hand_of(action[0].double().numpy())
    assert hand == pytest.approx([0.33, 0.06, 0.02], abs=0.01)


def test_training_goes_on_with_the_body_that_was_learned_with(body: Path, tmp_path: Path):
    copied = tmp_path / "copied"
    shutil.copytree(body, copied)
    part = learn(policy_for(body=str(copied)), SHOWN, most=4)  # enough to learn from
    part.train(mode=False)
    assert part.imitator is not None
    part.save_pretrained(tmp_path / "policy")
    shutil.rmtree(copied)
    resumed = learn(loaded(tmp_path / "policy", SHOWN), SHOWN)
    assert_same(resumed.imitator, learn(policy_for(body=str(body)), SHOWN).imitator)


def test_until_something_is_learned_its_folder_is_needed(body: Path, tmp_path: Path):
    policy = policy_for(body=str(body))
    policy.save_pretrained(tmp_path / "policy")
    assert json.loads((tmp_path / "policy" / "config.json").read_text())["body"] == str(body)
    resumed = learn(loaded(tmp_path / "policy", SHOWN), SHOWN)
    assert resumed.imitator is not None
    assert resumed.imitator.frames is not None
    assert resumed.imitator.frames.has_body(arm())


def test_a_second_dataset_is_learned_with_the_same_body(trained: Path, body: Path):
    for settings in ({}, {"body": str(body)}):  # that one is equal
        policy = learn(loaded(trained, MORE, **settings), MORE)
        assert policy.imitator is not None
        assert len(policy.imitator.reports) == 3
        assert policy.imitator.frames is not None
        assert policy.imitator.frames.has_body(arm())


def test_another_body_than_that_learned_with_is_refused(trained: Path, tmp_path: Path):
    longer = KinematicModel.from_function(
        lambda angles: (1.1 * hand_of(angles)[0], hand_of(angles)[1]),
        arm().config.joints, arm().lowest, arm().highest,
    )  # fmt: skip
    longer.save_pretrained(tmp_path / "longer")
    with pytest.raises(ValueError, match=r"expected the body that was learned with, .*longer'"):
        loaded(trained, MORE, body=str(tmp_path / "longer"))
    with pytest.raises(FileNotFoundError, match=r"expected a checkpoint folder .*nowhere'"):
        loaded(trained, MORE, body=str(tmp_path / "nowhere"))


def test_a_policy_without_a_body_gets_none(body: Path, tmp_path: Path):
    learn(policy_for(), SHOWN).save_pretrained(tmp_path)
    with pytest.raises(ValueError, match="expected no body that was learned with"):
        loaded(tmp_path, body=str(body))


def test_other_landmarks_than_those_learned_are_refused(trained: Path):
    assert loaded(trained, points=None).imitator is not None
    for points, got in (([f"cup={SURROUNDINGS}[0:3]"], r"cup \[4, 5, 6\]"), ([], "none")):
        message = rf"points of the dimensions cup \[4, .* 9\], as learned before, got {got}"
        with pytest.raises(ValueError, match=message):
            loaded(trained, points=points)


def test_what_is_no_body_is_refused_with_the_first_frames(body: Path, tmp_path: Path):
    def refused(error: type[Exception], message: str, **settings) -> None:
        with pytest.raises(error, match=message):
            learn(policy_for(**settings), SHOWN, most=1)

    nowhere = str(tmp_path / "nowhere")
    refused(FileNotFoundError, "expected a checkpoint folder .*nowhere'", body=nowhere)
    network = MLPForwardModel(MLPForwardModelConfig(2, 2, ((0.0, 0.0), (1.0, 1.0))))
    network.save_pretrained(tmp_path / "network")
    message = "expected a checkpoint of KinematicModel .* 'MLPForwardModel'"
    refused(ValueError, message, body=str(tmp_path / "network"))
    leg = KinematicModel.from_function(
        lambda angles: hand_of(np.insert(angles, 2, 0)), ("turn", "hip", "knee"), [-1] * 3, [1] * 3
    )
    leg.save_pretrained(tmp_path / "leg")
    refused(ValueError, "got none of 'hip' among turn.pos", body=str(tmp_path / "leg"))
    hand = [f"hand={SURROUNDINGS}[0:3]"]
    refused(ValueError, "landmarks alone beside a body", body=str(body), points=hand)
    refused(ValueError, "to be of the features", body=str(body), points=["cup=cup"])


@pytest.mark.parametrize(
    ("settings", "got"),
    [({"targets": "state"}, "policy.targets=state"), ({"points": []}, "no points")],
)
def test_settings_that_contradict_a_body_are_refused(settings: dict, got: str):
    with pytest.raises(ValueError, match=f"expected policy.body with landmarks .* got {got}"):
        config_of(body="arm", **settings)


def test_a_body_is_given_on_the_command_line():
    settings = draccus.parse(Settings, args=["--policy.type=pacnet", "--policy.body=bodies/arm"])
    assert isinstance(settings.policy, PACNetConfig)
    assert settings.policy.body == "bodies/arm"
    assert config_of().body is None
