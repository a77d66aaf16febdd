"""Check that a world without rewards is the same one, and that its seed decides all of it.

`python -m benchmarks.metaworld.check_simulation` runs noisy experts. The first world of each task
computes rewards and quaternions. The second leaves them out; it was used before, for other places.
"""

from __future__ import annotations

import sys
import warnings

import numpy as np

from benchmarks.metaworld import tasks
from benchmarks.metaworld.features import Array, landmarks_of, percept_of
from benchmarks.metaworld.simulation import World

NOISE = {10_000: 0.1, 10_001: 0.3, 10_002: 0.5}  # seed -> noise of actions: some episodes fail
STEPS = 200


def perceived(world: World, seed: int, actions: Array | None = None) -> tuple[Array, Array, Array]:
    """Return percepts `[STEPS + 1, D]`, success `[STEPS]` and actions `[STEPS, 4]`.

    Args:
        world: of the task.
        seed: of places and noise.
        actions: to be repeated; None for those of the expert.
    """
    random, observation = np.random.default_rng(seed), world.reset(seed)
    landmarks = landmarks_of(observation)
    percepts, successes, done = [percept_of(observation, landmarks)], [], []
    for step in range(STEPS):
        noisy = world.expert(observation) + random.normal(0, NOISE[seed], 4)
        done.append(noisy if actions is None else actions[step])
        observation, success = world.step(done[-1])
        percepts.append(percept_of(observation, landmarks))
        successes.append(success)
    return np.array(percepts), np.array(successes), np.array(done)


def main() -> int:
    """Print what differs; return whether anything does."""
    warnings.filterwarnings("ignore", "Constant", module="metaworld")
    names = tasks.choose(sys.argv[1:] or ["development", "held-out"])
    whole = {  # before any world without rewards
        (name, seed): perceived(World(name, whole=True), seed) for name in names for seed in NOISE
    }
    differing = 0
    for name in names:
        world, solved = World(name), 0
        world.reset(0)
        for seed in NOISE:
            percepts, successes, actions = whole[name, seed]
            again = perceived(world, seed, actions)
            same = np.array_equal(percepts, again[0]) and np.array_equal(successes, again[1])
            differing += not same
            solved += bool(successes.any())
            if not same:
                print(f"{name}, seed {seed}: by up to {np.abs(percepts - again[0]).max():g}")
        print(f"{name}: {solved} of {len(NOISE)} episodes succeed")
    print(f"{differing} of {len(whole)} episodes differ")
    return int(differing > 0)


if __name__ == "__main__":
    sys.exit(main())
