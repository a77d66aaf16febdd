"""A planar arm of joint angles alone, which goes to a ball that its camera sees from above."""

from __future__ import annotations

import numpy as np
import torch

from pacnet.datasets.demonstrations import Demonstration, Demonstrations
from pacnet.imitator.imitator import Imitator

TOP = "observation.images.top"
LENGTHS = np.array([0.5, 0.5])
REST = np.array([0.4, 0.9])
FRAMES, FPS = 50, 25  # frames, [1/s]


def hand_at(angles):
    """Where the hand of a planar arm is."""
    turned = np.cumsum(angles)
    return np.array([(LENGTHS * np.cos(turned)).sum(), (LENGTHS * np.sin(turned)).sum()])


def angles_at(place):
    """The elbow-up angles that take the hand to a place."""
    x, y = place
    cosine = (x * x + y * y - (LENGTHS**2).sum()) / (2 * LENGTHS.prod())
    elbow = np.arccos(np.clip(cosine, -1, 1))
    shoulder = np.arctan2(y, x) - np.arctan2(
        LENGTHS[1] * np.sin(elbow), LENGTHS[0] + LENGTHS[1] * np.cos(elbow)
    )
    return np.array([shoulder, elbow])


def picture_of(place):
    """A ball on a floor with structure, from above."""
    rows, columns = np.mgrid[:80, :96]
    image = np.stack([90 + rows, 60 + columns, 80 + (rows * columns) % 23], 2).astype(np.uint8)
    row, column = 70 - 60 * place[1], 10 + 75 * place[0]
    image[(rows - row) ** 2 + (columns - column) ** 2 < 30] = (250, 220, 40)
    image[(rows - row - 2) ** 2 + (columns - column) ** 2 < 5] = (20, 20, 160)
    return image


def places(count, seed):
    return np.random.default_rng(seed).uniform((0.35, 0.3), (0.75, 0.7), (count, 2))


def episode(number, place, absolute=True, start=REST, first_frame=0):
    """From the start to the ball, then still; actions are angles to go to, or changes of them."""
    along = np.clip(np.linspace(0, 1.4, FRAMES), 0, 1)[:, None]
    wanted = start + along * along * (3 - 2 * along) * (angles_at(place) - start)
    state, angles = [], start.copy()
    for target in wanted:
        state.append(angles.copy())
        angles = angles + 0.6 * (target - angles)
    action = wanted if absolute else np.gradient(wanted, axis=0)
    return Demonstration(
        number,
        "touch",
        torch.tensor(np.array(state)).float(),
        torch.empty(FRAMES, 0),
        torch.tensor(action).float(),
        first_frame=first_frame,
        pictures={TOP: np.repeat(picture_of(place)[None], FRAMES, axis=0)},
    )


def demonstrations(count, seed=0, **kinds):
    return shown_as(*(episode(n, place, **kinds) for n, place in enumerate(places(count, seed))))


def shown_as(*episodes, source="arm"):
    joints = ("shoulder.pos", "elbow.pos")
    return Demonstrations(FPS, {"observation.state": joints, "action": joints}, episodes, source)


def taught(shown, **options):
    """An imitator that has learned what was shown."""
    made = Imitator.from_demonstrations(shown, **options)
    made.learn(shown)
    return made


def path(imitator, place, pictures=True, start=REST):
    """Where the hand is while it acts with the ball at a place, `[T, 2]`."""
    imitator.reset()
    angles, action, hand = start.copy(), start.copy(), []
    for _ in range(FRAMES + 20):
        seen = {TOP: picture_of(place)} if pictures else None
        step = imitator.step(angles.astype(np.float32), seen)
        action = action if step.action is None else step.action
        angles = angles + 0.6 * (action - angles)
        hand.append(hand_at(angles))
    return np.array(hand)


def miss(imitator, place, pictures=True, start=REST):
    """How far from the ball the hand ends."""
    return np.linalg.norm(path(imitator, place, pictures, start)[-1] - place)
