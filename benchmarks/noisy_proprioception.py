"""The imitator's joints driven from its own noisy proprioception, as in the paper's Experiment 1.

PACNet imitates new demonstrations. Its targets go to the simulator's PID, which has the true
angles, or to a `PIDController` that has what the imitator perceives of itself every 20 ms.
`python -m benchmarks.noisy_proprioception` prints success and wrist distance of each.
"""

import argparse
from pathlib import Path

import numpy as np
import torch

from benchmarks.postural_control import make_controller
from envs.humanoid import JOINTS
from envs.physics import CONTROL_TIMESTEP
from envs.postural_imitation import PosturalImitationEnv
from pacnet import PACNet
from pacnet.kernels.threads import use_one_thread
from train.common.summary import mean_and_std, summarise
from train.postural.episodes import recall_episode, recall_seeds
from train.postural.scores import score_episodes

TRUST = 0.1  # share of a perceived angle in the estimate; chosen on seeds 1000 and 1001
SEEDS = (40, 41, 42)
SHOWN = {  # score -> title, factor
    "task_success_rate": ("success", 1.0),
    "wrist_distance_mean_m": ("wrist, mean [cm]", 100.0),
    "wrist_distance_max_m": ("wrist, largest [cm]", 100.0),
}


class Estimate:
    """Estimates angles from noisy angles and velocities: carried on by velocity, then corrected.

    Args:
        trust: Share of the perceived angle; with 1 it is the estimate.
    """

    def __init__(self, trust: float) -> None:
        self._trust = trust
        self.angles: np.ndarray | None = None  # [11] [rad]; None until something was perceived

    def update(self, angles: np.ndarray, velocities: np.ndarray) -> np.ndarray:
        """Return the estimate after percepts of angles [rad] and velocities [rad/s] `[11]`."""
        if self.angles is None:
            self.angles = angles
        expected = self.angles + CONTROL_TIMESTEP * velocities
        self.angles = expected + self._trust * (angles - expected)
        return self.angles


class OwnTorques(PosturalImitationEnv):
    """The scene of Experiment 1, in which a `PIDController` moves the imitator's joints.

    Args:
        trust: Of the estimate of the own angles; None for the true angles.
    """

    def __init__(self, trust: float | None) -> None:
        super().__init__()
        self._trust = trust
        self._joints = self._physics.velocity_at[1]
        # The simulator's own PID of this body has no force; a range of zero would mean no limit.
        self._physics.model.actuator_forcerange[len(JOINTS) :] = (-1e-12, 1e-12)

    def _set_scene(self, rng: np.random.Generator) -> None:
        super()._set_scene(rng)
        self._controller = make_controller(kd_per_kp=0.0, dt=CONTROL_TIMESTEP)
        load = torch.tensor(self._physics.data.qfrc_bias[self._joints], dtype=torch.float32)
        self._controller.integral = (load / self._controller.ki)[None]
        self._estimate = None if self._trust is None else Estimate(self._trust)

    def _observe(self) -> dict[str, np.ndarray]:
        observation = super()._observe()
        self._angles = self._physics.scene_state.angles[1]
        if self._estimate is not None:
            angles, velocities = np.split(observation["proprioception"].astype(np.float64), 2)
            self._angles = self._estimate.update(angles, velocities)
        return observation

    def _advance(self, wanted: np.ndarray) -> tuple:
        angles, targets = (
            torch.tensor(row, dtype=torch.float32)[None] for row in (self._angles, wanted)
        )
        still = torch.zeros_like(angles)  # there is no derivative term
        torques = self._controller.step(angles, still, targets, still)
        self._physics.data.qfrc_applied[self._joints] = torques[0].numpy()
        return super()._advance(wanted)


DRIVES = {
    "the simulator's PID, true angles": PosturalImitationEnv,
    "PIDController, true angles": lambda: OwnTorques(None),
    "PIDController, perceived angles": lambda: OwnTorques(1.0),
    "PIDController, perceived angles and velocities": lambda: OwnTorques(TRUST),
}


def main() -> None:
    """Measure and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--episodes", type=int, default=20, help="of each seed")
    parser.add_argument("--seeds", type=int, nargs="+", default=SEEDS, help="of the episodes")
    parser.add_argument("--checkpoint", type=Path, default="checkpoints/postural_imitation")
    arguments = parser.parse_args()
    use_one_thread()
    network = PACNet.from_pretrained(arguments.checkpoint).eval()
    print(f"{'':<48}" + "".join(f"{title:>22}" for title, _ in SHOWN.values()))
    for name, make in DRIVES.items():
        environment = make()
        replicates = [
            score_episodes(
                [
                    recall_episode(network, environment, s)
                    for s in recall_seeds(seed, arguments.episodes)
                ]
            )
            for seed in arguments.seeds
        ]
        environment.close()
        scores = summarise([{key: one[key] for key in SHOWN} for one in replicates])
        row = (mean_and_std(scores[key], factor=factor) for key, (_, factor) in SHOWN.items())
        print(f"{name:<48}" + "".join(f"{text:>22}" for text in row), flush=True)


if __name__ == "__main__":
    main()
