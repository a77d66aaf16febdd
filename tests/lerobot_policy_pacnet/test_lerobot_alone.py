"""LeRobot's environment in which nobody shows the drink."""

import math

import numpy as np
import pytest

pytest.importorskip("lerobot")
pytest.importorskip("lerobot_policy_pacnet")
pytest.importorskip("dm_control")

import gymnasium
from lerobot.envs.factory import make_env

from envs.demonstrator import plan_demonstration
from envs.kinematics import BodyKinematics
from envs.scene import GLASS_PLACE
from lerobot_policy_pacnet import PACNetEnv

ID = "gym_pacnet/DrinkAlone-v0"


@pytest.fixture
def alone():
    made = gymnasium.make(ID, noise_scale=0.0)
    yield made
    made.close()


def play(env, targets):
    """The successes of an episode to its end; the last target is kept."""
    successes, truncated = [], False
    while not truncated:
        target = targets[min(len(successes), len(targets) - 1)]
        *_, truncated, info = env.step(np.float32(target))
        successes.append(info["is_success"])
    return successes


@pytest.mark.parametrize("seed", [0, 1])
def test_drinking_there_is_a_success_at_the_end(alone, seed):
    place = alone.reset(seed=seed)[0]["environment_state"][:2]
    body = BodyKinematics()
    plan = plan_demonstration(body, place, np.random.default_rng(0)).angles
    successes = play(alone, plan)
    assert len(successes) == 750
    assert successes[-1] is True
    assert not any(successes[:-1])


def test_watching_is_no_success(alone):
    observation, _ = alone.reset(seed=0)
    assert not any(play(alone, observation["agent_pos"][None, :11]))


def test_its_own_body_and_glass_are_observed(alone):
    observation, _ = alone.reset(seed=0)
    posture = observation["agent_pos"][:11] + np.float32(0.2)  # not that of the one who is away
    for _ in range(100):  # until it keeps still
        observation, *_ = alone.step(posture)
    info = alone.unwrapped.scene.step_to(posture)[-1]
    assert observation["agent_pos"][:11] == pytest.approx(info["imitator_angles"], abs=0.01)
    glass = observation["environment_state"][:3]
    assert glass == pytest.approx(info["glass_position"], abs=1e-3)
    assert np.abs(info["imitator_angles"] - info["demonstrator_angles"]).min() > 0.1


def test_the_glass_stands_anywhere_within_15_cm(alone):
    places = np.array([alone.reset(seed=seed)[0]["environment_state"][:2] for seed in range(60)])
    away = np.linalg.norm(places - GLASS_PLACE, axis=1)
    assert away.max() <= 0.15 + math.hypot(0.01, 0.01)  # the spread of the usual place
    assert 0.3 < (away < 0.15 / math.sqrt(2)).mean() < 0.7  # half of the area


def test_a_reset_without_a_seed_goes_on(alone):
    alone.reset(seed=3)
    second = alone.reset()[0]["environment_state"]
    third = alone.reset()[0]["environment_state"]
    assert not np.array_equal(second, third)
    alone.reset(seed=3)
    assert np.array_equal(alone.reset()[0]["environment_state"], second)


def test_lerobot_is_told_what_to_do():
    vector = next(iter(make_env(PACNetEnv(task="DrinkAlone-v0"), n_envs=2)["pacnet"].values()))
    vector.reset(seed=[0, 1])
    assert list(vector.call("task_description")) == ["drink a glass of beer"] * 2
    vector.close()
