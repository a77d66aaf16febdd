"""The imitator's joints driven from its own percepts."""

import numpy as np
import pytest

from benchmarks.noisy_proprioception import Estimate, OwnTorques

JOINTS = 11


def test_the_estimate_goes_on_by_velocity_and_is_corrected_by_the_angle():
    estimate = Estimate(trust=0.25)
    still, moving = np.zeros(JOINTS), np.full(JOINTS, 0.5)  # [rad/s]
    assert estimate.update(np.full(JOINTS, 1.0), still) == pytest.approx(1.0)
    # 1 rad + 0.02 s · 0.5 rad/s = 1.01 rad, then a quarter of the way to 1.41 rad.
    assert estimate.update(np.full(JOINTS, 1.41), moving) == pytest.approx(1.11)


def test_trust_in_the_angles_alone_is_the_last_angle():
    estimate, rng = Estimate(trust=1.0), np.random.default_rng(0)
    for angles in rng.normal(size=(5, JOINTS)):
        assert estimate.update(angles, rng.normal(size=JOINTS)) == pytest.approx(angles)


def test_both_percepts_are_nearer_to_the_truth_than_angles_alone():
    rng = np.random.default_rng(0)
    truth = 0.3 * np.sin(0.02 * np.arange(500))[:, None] * np.ones(JOINTS)  # [T, 11] [rad]
    velocity = np.diff(truth, axis=0, prepend=truth[:1]) / 0.02
    angles = truth + rng.normal(0, 0.01, truth.shape)
    velocities = velocity + rng.normal(0, 0.05, truth.shape)
    estimate = Estimate(trust=0.1)
    estimated = [estimate.update(*row) for row in zip(angles, velocities, strict=True)]
    error = np.sqrt(np.square(estimated - truth)[50:].mean())
    assert error < 0.004  # [rad]; an angle alone is off by 0.01


def test_torques_take_the_joints_to_their_targets():
    environment = OwnTorques(trust=0.1)
    environment.reset(seed=1000)
    target = environment.rest_posture.copy()
    target[-1] += 0.3  # [rad]
    for _ in range(30):
        _, _, _, _, info = environment.step_to(target)
    environment.close()
    np.testing.assert_allclose(info["imitator_angles"], target, atol=0.02)
