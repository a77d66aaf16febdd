"""What was not brought to its place is led there, also where the way is longer than shown."""

import numpy as np
import torch

from pacnet.datasets.demonstrations import Demonstration, Demonstrations
from pacnet.imitator import Imitator

FPS = 25
NAMES = {
    "observation.state": ("hand.x", "hand.y", "gripper"),
    "observation.environment_state": ("cup.x", "cup.y", "tray.x", "tray.y"),
    "action": ("vx", "vy", "close"),
}


def fetched() -> Demonstrations:
    """One demonstration: a hand goes to a cup, closes, and carries it to within 3 cm of a tray."""
    hand, cup, tray, closed = np.zeros(2), np.array([0.3, 0.1]), np.array([0.1, 0.4]), False
    rows = []
    while np.linalg.norm(tray - hand) > 0.03:
        closes = np.linalg.norm(cup - hand) < 0.01
        way = (tray if closes else cup) - hand
        speed = 0.3 * way / max(0.1, float(np.linalg.norm(way)))
        rows.append([*hand, closed, *cup, *tray, *speed, closes])
        hand, closed = hand + speed / FPS, closes
        cup = hand if closed else cup
    state, around, action = torch.tensor(np.float32(rows)).split((3, 4, 3), dim=1)
    shown = Demonstration(0, "fetch", *(part.contiguous() for part in (state, around, action)))
    return Demonstrations(FPS, NAMES, (shown,), "fetching")


def test_a_longer_way_is_gone_to_its_end():
    demonstrations = fetched()
    imitator = Imitator.from_demonstrations(demonstrations)
    imitator.learn(demonstrations)
    ((cup_segment, tray_segment), _) = imitator.cuts[0]
    assert (cup_segment.landmark, tray_segment.landmark) == ("cup", "tray")
    hand, cup, tray, closed = np.zeros(2), np.array([-0.2, 0.3]), np.array([0.3, -0.1]), False
    step = None
    for _ in range(150):  # twice as long as was shown
        step = imitator.step(np.float32([*hand, closed, *cup, *tray]))
        assert step.action is not None
        held = np.linalg.norm(cup - hand) < 0.02
        closed, hand = bool(step.action[2] > 0.5), hand + step.action[:2] / FPS
        cup = hand if closed and held else cup
    assert step is not None
    assert (step.landmark, step.segment, step.is_done) == ("tray", 1, True)
    assert np.linalg.norm(cup - tray) < 0.05
