"""Scenes of Experiment 1 that the tests of a file share."""

import gymnasium
import pytest

import envs  # noqa: F401  registers the environment

ENV_ID = "pacnet/PosturalImitation-v0"


@pytest.fixture(scope="module")
def noisy():
    made = gymnasium.make(ENV_ID).unwrapped
    yield made
    made.close()


@pytest.fixture(scope="module")
def noiseless():
    made = gymnasium.make(ENV_ID, noise_scale=0.0).unwrapped
    yield made
    made.close()
