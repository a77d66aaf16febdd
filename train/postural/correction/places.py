"""Where the glasses of corrections stand: at known places, and at new ones further away."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from envs.glass_offset import draw_offset, draw_within
from train.postural.correction.episodes import Offset, Situation

DISTANCE = 0.15  # [m] between a new place and the usual one; a body reaches all that are nearer


def draw_places(seed: Sequence[int], count: int) -> list[Offset]:
    """Draw offsets of new places [m]; they and the usual one are at least `DISTANCE` apart."""
    rng = np.random.default_rng(seed)
    while True:
        places = np.stack([draw_offset(rng, DISTANCE) for _ in range(count)])
        apart = np.linalg.norm(places[:, None] - places, axis=2)[np.triu_indices(count, 1)]
        if (apart >= DISTANCE).all():
            return [(x, y) for x, y in places.tolist()]


def draw_other_place(seed: Sequence[int], corrected: Sequence[Offset]) -> Offset:
    """Draw the offset of another new place [m], away from those that were corrected."""
    rng = np.random.default_rng(seed)
    while True:
        place = draw_offset(rng, DISTANCE)
        if np.linalg.norm(place - np.array(corrected), axis=1).min() >= DISTANCE / 2:
            return (float(place[0]), float(place[1]))


def situations(seed: Sequence[int], places: Sequence[Offset], count: int) -> list[Situation]:
    """Return `count` situations with different seeds, cycling through the places."""
    seeds = np.random.SeedSequence(seed).generate_state(count).tolist()
    return [Situation(number, places[i % len(places)]) for i, number in enumerate(seeds)]


def alone(seed: Sequence[int], count: int, own_glass: str = "standing") -> list[Situation]:
    """Return situations of an imitator that is alone, its glasses within reach of a hand.

    Args:
        seed: Of all of them.
        count: Their number.
        own_glass: One of `envs.own_glass.OWN_GLASSES`; a far or absent one is not at that place.
    """
    rng = np.random.default_rng((*seed, 1))
    offsets = [draw_within(rng, DISTANCE).tolist() for _ in range(count)]
    drawn = situations(seed, [(x, y) for x, y in offsets], count)
    return [one._replace(is_alone=True, own_glass=own_glass) for one in drawn]
