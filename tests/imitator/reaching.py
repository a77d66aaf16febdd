"""What the tests of the imitator show: an arm that swings out and back, beside a glass."""

import math

import numpy as np
import torch
from torch import Tensor

from pacnet.datasets.demonstrations import Demonstration, Demonstrations
from pacnet.imitator import Imitator

FPS = 50
NAMES = {
    "observation.state": ("shoulder", "elbow"),
    "observation.environment_state": ("glass.x",),
    "action": ("shoulder", "elbow"),
}
FRAMES = 300


def reach(seed: int, glass: float = 0.0, task: str = "reach") -> Demonstration:
    """An arm that swings out and back once, beside a glass, with a little noise."""
    generator = torch.Generator().manual_seed(seed)
    phase = torch.linspace(0, 2 * math.pi, FRAMES)
    path = torch.stack([0.5 - 0.5 * phase.cos(), 0.5 * phase.sin()], dim=1)
    state = path + 0.01 * torch.randn(FRAMES, 2, generator=generator)
    place = glass + 0.005 * torch.randn(FRAMES, 1, generator=generator)
    return Demonstration(seed, task, state, place, path.roll(-1, dims=0))


def shown(*episodes: Demonstration, source: str = "reaching") -> Demonstrations:
    return Demonstrations(FPS, NAMES, episodes, source)


def follow(imitator: Imitator, percepts: Tensor) -> list:
    imitator.reset()
    return [imitator.step(percept) for percept in percepts]


def assert_same(imitator: Imitator, other: Imitator) -> None:
    """What two imitators know is the same, bit for bit."""
    tensors = other.state_dict()
    assert imitator.state_dict().keys() == tensors.keys()
    for name, tensor in imitator.state_dict().items():
        torch.testing.assert_close(tensor, tensors[name], rtol=0, atol=0, msg=name)


def assert_same_actions(imitator: Imitator, other: Imitator, percepts: Tensor) -> None:
    """Two imitators act alike, and act at most of the percepts."""
    pairs = [*zip(follow(imitator, percepts), follow(other, percepts), strict=True)]
    for one, same in pairs:
        assert (one.action is None) == (same.action is None)
        assert one.action is None or np.array_equal(one.action, same.action)
    assert np.mean([one.action is not None for one, _ in pairs]) > 0.9
