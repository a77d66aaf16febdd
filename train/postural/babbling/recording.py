"""Babbling: the imitator moves its joints at random, feels its angles and sees its hand."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation
from tqdm import tqdm

from envs.humanoid import JOINTS
from envs.kinematics import BodyKinematics
from envs.postural_imitation import PosturalImitationEnv
from pacnet.datasets.demonstrations import load_demonstrations
from pacnet.datasets.recorder import Recorder
from train.common.expected_findings import expect_findings
from train.postural.episodes import FPS, Condition, make_environment

Array = NDArray[np.float64]

POSTURES = 5000
HOLD = 10  # [steps] of 20 ms for which a random target is held; most joints arrive
STRETCH = 1.2  # of the range that targets are drawn from, then clipped: so its ends are seen too
PLACE_NOISE, TURN_NOISE = 0.005, 0.01  # [m], [rad] of how the hand is seen
ALONE = {"demonstrator": "absent"}
TASK = "move all joints at random and watch the hand"
HAND_NAMES = ("grip.x", "grip.y", "grip.z", "hand.qw", "hand.qx", "hand.qy", "hand.qz")
FEATURES = {
    "observation.state": JOINTS,  # perceived angles
    "observation.environment_state": HAND_NAMES,  # seen, in the body frame
    "action": JOINTS,  # joint-angle targets
}
_ENVIRONMENT, _TARGETS, _SIGHT = 3, 4, 5  # purposes for which seeds are drawn

# A checker takes postures that change as much between frames as in an episode for noise.
NOISE, WHY_NOISE = (
    "episodes.no_motion*",
    "postures at random, each held for 0.2 s: no path leads on",
)


class Babble(NamedTuple):
    """N postures, and where the hand was seen."""

    angles: Array  # [N, 11] [rad]
    places: Array  # [N, 3] of the grip [m], in the body frame
    turns: Array  # [N, 4] of the hand, unit quaternions w, x, y, z


def record(folder: Path, seed: int, count: int) -> None:
    """Babble, and write the postures into a LeRobot dataset, an episode for each reset.

    Args:
        folder: Of the new dataset.
        seed: Of all random numbers.
        count: Number of postures.
    """
    environment, ends = make_environment(Condition()), BodyKinematics().joint_range
    targets, sight = (np.random.default_rng((seed, use)) for use in (_TARGETS, _SIGHT))
    resets = np.random.default_rng((seed, _ENVIRONMENT))
    with (
        Recorder(folder, FPS // HOLD, FEATURES, "postural_imitation") as recorder,
        tqdm(total=count, desc="babbling", unit="posture") as progress,
    ):
        while progress.n < count:
            environment.reset(seed=int(resets.integers(2**31)), options=ALONE)
            rows = _episode(environment, ends, targets, sight, count - progress.n)
            recorder.save_episode(TASK, rows)
            progress.update(len(rows["action"]))
    environment.close()
    expect_findings(folder, NOISE, WHY_NOISE)


def load(folder: Path) -> Babble:
    """Return the postures of a dataset that `record` wrote."""
    episodes = load_demonstrations(folder)
    rows = [np.concatenate([one.percepts.numpy() for one in episodes]).astype(np.float64)]
    angles, places, turns = np.split(rows[0], [len(JOINTS), len(JOINTS) + 3], axis=1)
    return Babble(angles, places, turns / np.linalg.norm(turns, axis=1, keepdims=True))


def quaternion(turn: Rotation) -> Array:
    """Return rotations as quaternions w, x, y, z with w ≥ 0, `[..., 4]`."""
    return np.roll(turn.as_quat(canonical=True), 1, axis=-1)


def _episode(
    environment: PosturalImitationEnv,
    ends: Array,
    targets: np.random.Generator,
    sight: np.random.Generator,
    most: int,
) -> dict[str, NDArray[np.float32]]:
    """Return the features of the postures until the episode ends, `most` of them at most."""
    frames: list[tuple[Array, Array, Array]] = []
    truncated = False
    while not truncated and len(frames) < most:
        shares = np.clip(STRETCH * targets.uniform(-1, 1, len(JOINTS)), -1, 1)
        target = ends.mean(axis=1) + shares * np.diff(ends)[:, 0] / 2
        for _ in range(HOLD - 1):
            environment.step_to(target)
        observation, _, _, truncated, info = environment.step_to(target)
        frames.append((observation["proprioception"][: len(JOINTS)], _seen(info, sight), target))
    names = ("observation.state", "observation.environment_state", "action")
    return dict(zip(names, map(_rows, zip(*frames, strict=True)), strict=True))


def _seen(info: dict[str, Array], sight: np.random.Generator) -> Array:
    """Return place and quaternion of the hand `[7]`, as they are seen."""
    place = info["imitator_grip"] + PLACE_NOISE * sight.standard_normal(3)
    shake = Rotation.from_rotvec(TURN_NOISE * sight.standard_normal(3))
    turn = quaternion(shake * Rotation.from_matrix(info["imitator_hand"]))
    return np.concatenate([place, turn])


def _rows(frames: tuple[Array, ...]) -> NDArray[np.float32]:
    return np.array(frames, np.float32)
