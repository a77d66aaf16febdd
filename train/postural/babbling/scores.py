"""How well a body is known: errors on postures that were not seen, of several ways to learn it."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import torch
from scipy.spatial.transform import Rotation
from torch import Tensor
from tqdm import tqdm

from envs.humanoid import JOINTS
from envs.kinematics import BodyKinematics
from pacnet import KinematicModel
from pacnet.forward_models.kinematic_arrays import HandPose
from pacnet.forward_models.turn_matrices import angles_between
from train.postural.babbling.network import fit_network
from train.postural.babbling.recording import Array, Babble, quaternion

HELD_OUT = 2000  # postures, uniform over the whole range of each joint, without noise
COUNTS = (400, 1500)  # of postures to learn from, beside all
PRODUCTS, FUNCTION = "products of sines and cosines", "MuJoCo's own kinematics, called"
NETWORKS = {
    "network of 128 units on sines and cosines": (128, True),
    "network of 64 units on sines and cosines": (64, True),
    "network of 64 units on bare angles": (64, False),
}
_HELD_OUT_SEED = 6

Body = Callable[[Tensor], HandPose]


class Score(NamedTuple):
    """Errors on held-out postures."""

    place_rms_mm: float  # of the distance of the grip
    turn_rms_deg: float
    fit_s: float  # of the processor's time


def held_out(seed: int) -> Babble:
    """Return postures with where the hand is in truth."""
    body = BodyKinematics()
    rng = np.random.default_rng((seed, _HELD_OUT_SEED))
    low, high = body.joint_range.T
    angles = rng.uniform(low, high, (HELD_OUT, len(JOINTS)))
    poses = [body.pose(one) for one in angles]
    turns = quaternion(Rotation.from_matrix(np.array([pose.hand for pose in poses])))
    return Babble(angles, np.array([pose.grip for pose in poses]), turns)


def score(body: Body, truth: Babble, fit_s: float) -> Score:
    """Return the errors of a body model."""
    pose = body(torch.from_numpy(truth.angles))
    square = (pose.place - torch.from_numpy(truth.places)).square().sum(dim=1)
    off = angles_between(pose.turn, torch.from_numpy(truth.turns))
    place, turn = float(square.mean().sqrt()), float(off.square().mean().sqrt())
    return Score(1000 * place, float(np.degrees(turn)), fit_s)


def compare(babble: Babble, truth: Babble, seed: int) -> dict[int, dict[str, Score]]:
    """Return the scores of each way to learn a body, by the number of its first postures."""
    counts = [count for count in COUNTS if count < len(babble.angles)] + [len(babble.angles)]
    ways: dict[str, Callable[[Babble], Body]] = {PRODUCTS: fit_products}
    for name, (width, waves) in NETWORKS.items():
        ways[name] = lambda seen, w=width, on=waves: fit_network(seen, w, on, seed)
    scores: dict[int, dict[str, Score]] = {count: {} for count in counts}
    with tqdm(total=len(counts) * len(ways), desc="comparing", unit="fit") as progress:
        for count in counts:
            seen = Babble(*(rows[:count] for rows in babble))
            for name, way in ways.items():
                scores[count][name] = _timed(lambda way=way, seen=seen: way(seen), truth)
                progress.update()
    scores[counts[-1]][FUNCTION] = _timed(from_simulator, truth)
    return scores


def fit_products(babble: Babble) -> KinematicModel:
    """Return the library's model of a body, fitted to postures."""
    return KinematicModel.fitted(JOINTS, *babble)[0]


def from_simulator() -> KinematicModel:
    """Return the model that is made from the simulator's own kinematics."""
    body = BodyKinematics()

    def function(angles: Array) -> tuple[Array, Array]:
        pose = body.pose(angles)
        return pose.grip, pose.hand

    return KinematicModel.from_function(function, JOINTS, *body.joint_range.T)


def _timed(fit: Callable[[], Body], truth: Babble) -> Score:
    begin = time.process_time()
    body = fit()
    return score(body, truth, time.process_time() - begin)
