"""Scores of Experiment 2: from a robot's run along walls to the numbers of `metrics.json`.

The paper judges wall following by eye and announces "the 'energy' that the robot acquires from the
wall at particular configurations from it" (section "Recall phase" of Experiment 2). This module
defines that energy, and scores for what it misses: sides, contacts, being stuck.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.ndimage import maximum_filter1d, minimum_filter1d

from envs.arena_scene import CONTROL_TIMESTEP
from envs.wall_behaviours import CRUISE, WALL_DISTANCE
from envs.wall_following import ENERGY_WIDTH

SPEED = CRUISE  # of the teacher [m/s]
TIMESTEP = CONTROL_TIMESTEP  # of a step [s]
TEACHER_DISTANCE = WALL_DISTANCE  # from the teacher's rim to its wall [m]

NEAR_WALL = (0.008, 0.050)  # rim to wall, both ends included: neither touching nor away [m]
TIGHT_MARGIN = 0.008  # about the teacher's distance [m]
BORDER = (0.045, 0.055)  # where it is ambiguous whether there is a wall [m]
NO_WALL_READING = 0.1  # IR reading of a wall about 51 mm away, the reach of `wall_side`
STUCK_WINDOW = 500  # [steps]

LEFT, NO_WALL, RIGHT = "left", "no wall", "right"  # names of clusters of nodes
SIDES = {LEFT: 1, NO_WALL: 0, RIGHT: -1}  # their `WallRun.wall_side`

_FIELDS = {  # name: kind of number, shape after [T]
    "poses": ("f", (3,)),
    "percepts": ("f", (6,)),
    "wall_distance": ("f", ()),
    "wall_side": ("i", ()),
    "progress": ("f", ()),
    "contact": ("b", ()),
    "winners": ("i", ()),
    "commanded": ("b", ()),
}
_KINDS = {"f": "floats", "i": "integers", "b": "booleans"}


@dataclass(frozen=True, eq=False)
class WallRun:
    """T ≥ 1 steps of one robot.

    Attributes:
        poses: x, y and heading after each step `[T, 3]` [m, m, rad].
        percepts: IR before each step, 0 (nothing) to 1 (contact), of the sensors at +90, +45, +12,
            -12, -45 and -90 degrees: left to right `[T, 6]`.
        wall_distance: Rim to the nearest wall after each step `[T]` [m].
        wall_side: Where that wall is after each step: 1 left, -1 right, 0 none within 50 mm `[T]`.
        progress: Way along the nearest wall in each step, ≥ 0 `[T]` [m].
        contact: Whether the robot touched a wall in each step `[T]`.
        winners: Node that won the percept, -1 for no match `[T]`.
        commanded: Whether the network commanded the step, not the default behaviour `[T]`.

    Raises:
        ValueError: An array of another shape or kind, not finite, or with values out of range.
    """

    poses: NDArray[np.floating]
    percepts: NDArray[np.floating]
    wall_distance: NDArray[np.floating]
    wall_side: NDArray[np.integer]
    progress: NDArray[np.floating]
    contact: NDArray[np.bool_]
    winners: NDArray[np.integer]
    commanded: NDArray[np.bool_]

    def __post_init__(self) -> None:
        """Refuse arrays that do not fit one another."""
        steps = np.size(self.progress)
        for name, (kind, columns) in _FIELDS.items():
            _check_array(name, getattr(self, name), kind, (steps, *columns))
        if not np.isin(self.wall_side, (-1, 0, 1)).all():
            raise ValueError(f"expected wall_side of -1, 0 or 1, got {np.unique(self.wall_side)}")
        if self.progress.min() < 0:
            raise ValueError(f"expected progress ≥ 0 [m], got {self.progress.min()}")
        if self.winners.min() < -1:
            raise ValueError(f"expected winners ≥ -1, got {self.winners.min()}")

    def __len__(self) -> int:
        """Return the number of steps T."""
        return len(self.progress)


def wf(run: WallRun) -> float:
    """Return the progress near walls, relative to the teacher's speed.

        wf = sum of progress over the steps with the rim 8-50 mm from the wall / (SPEED T TIMESTEP)

    At least 0; 1 is a run that is always near a wall and moves along it at the teacher's speed. A
    faster robot may exceed 1.
    """
    low, high = NEAR_WALL
    return _progress_share(run, (run.wall_distance >= low) & (run.wall_distance <= high))


def tight(run: WallRun) -> float:
    """Return the same as `wf`, with the rim within 8 mm of the teacher's distance: 18-34 mm."""
    return _progress_share(run, np.abs(run.wall_distance - TEACHER_DISTANCE) <= TIGHT_MARGIN)


def energy(run: WallRun) -> float:
    """Return the wall energy of the paper, as a mean over steps.

        energy = mean of exp(-((d - 26 mm) / 10 mm)^2 / 2) min(1, progress / (SPEED TIMESTEP))

    with d the rim's distance to the nearest wall. From 0 to 1: 1 is a robot that always advances
    along a wall, at the teacher's distance and at least at its speed. A robot that stands still has
    0. The energy accumulated over a run is T times this.
    """
    offset = (run.wall_distance - TEACHER_DISTANCE) / ENERGY_WIDTH
    pace = np.minimum(1, run.progress / (SPEED * TIMESTEP))
    return float(np.mean(np.exp(-(offset**2) / 2) * pace))


def contact_share(run: WallRun) -> float:
    """Return the share of the steps in which the robot touched a wall, 0 to 1."""
    return float(run.contact.mean())


def side_kept(run: WallRun, side: int) -> float:
    """Return the share of the steps along walls that had the wall on that side, 0 to 1.

    A step is along a wall if one is within 50 mm and progress exceeds SPEED TIMESTEP / 2 = 3 mm.

    Args:
        run: To score.
        side: 1 left, -1 right.

    Returns:
        The share; 0 for a run with no step along a wall.

    Raises:
        ValueError: Another side.
    """
    if side not in (1, -1):
        raise ValueError(f"expected side 1 (left) or -1 (right), got {side}")
    return _share(_sides_along(run) == side)


def sides_share(run: WallRun) -> dict[str, float]:
    """Return name -> `side_kept` of both sides; they add up to 1 with any step along a wall."""
    return {name: side_kept(run, SIDES[name]) for name in (LEFT, RIGHT)}


def side_continuity(run: WallRun) -> float:
    """Return the share of the steps along walls with the wall on the same side as before.

    Steps away from walls do not count: a robot that leaves a wall on its left and finds the next on
    its left has kept its side. From 0 to 1; 0 for a run of fewer than two steps along walls.
    """
    sides = _sides_along(run)
    return _share(sides[1:] == sides[:-1])


def side_changes(run: WallRun) -> float:
    """Return the changes of the wall's side per 1,000 steps of the run."""
    sides = _sides_along(run)
    return 1000 * float((sides[1:] != sides[:-1]).sum()) / len(run)


def position_spread(run: WallRun, window: int = STUCK_WINDOW) -> float:
    """Return the smallest range of positions in any `window` consecutive steps [m].

    The range is the diagonal of the bounding box, along x and y, of the positions. It is small if
    the robot got stuck. A run shorter than the window counts as one window.

    Raises:
        ValueError: A window below 1.
    """
    if window < 1:
        raise ValueError(f"expected window ≥ 1 step, got {window}")
    size = min(window, len(run))
    positions = run.poses[:, :2].astype(np.float64)
    origin = -(size // 2)  # so that a window starts at its step instead of being centred on it
    highest = maximum_filter1d(positions, size, axis=0, origin=origin)
    lowest = minimum_filter1d(positions, size, axis=0, origin=origin)
    whole = (highest - lowest)[: len(run) - size + 1]  # [windows, 2]
    return float(np.hypot(*whole.T).min())


def name_clusters(prototypes: ArrayLike) -> list[str]:
    """Return the cluster of each node by its prototype: "left", "no wall" or "right".

    "no wall" if the strongest reading is below 0.1; else the side with the higher sum of its three
    sensors, the left if the sums are equal.

    Args:
        prototypes: IR readings of each node, sensors left to right `[N, 6]`.

    Raises:
        ValueError: Prototypes of another shape, or not finite.
    """
    readings = np.asarray(prototypes, dtype=np.float64)
    if readings.ndim != 2 or readings.shape[1] != 6 or not np.isfinite(readings).all():
        raise ValueError(f"expected finite prototypes of shape [N, 6], got {readings.shape}")
    seen = readings.max(axis=1) >= NO_WALL_READING
    left = readings[:, :3].sum(axis=1) >= readings[:, 3:].sum(axis=1)
    return np.where(seen, np.where(left, LEFT, RIGHT), NO_WALL).tolist()


def cluster_agreement(run: WallRun, names: Sequence[str]) -> float:
    """Return the share of the winners whose cluster is the robot's true wall side.

    The truth is `wall_side`, which counts a wall up to 50 mm away. The IR sees a wall up to 70 mm
    away, but there a sensor that faces it reads 0.11, hardly above the threshold 0.1 of
    `name_clusters`. Every winner counts, including those at the border, where noise decides;
    `border_share` bounds their number. The first step is left out: its percept was taken before the
    first pose of the run.

    Args:
        run: To score.
        names: Cluster of each node, from `name_clusters` `[N]`.

    Returns:
        The share, 0 to 1; 0 without any winner.

    Raises:
        ValueError: An unknown name, or fewer names than winners need.
    """
    unknown = set(names) - set(SIDES)
    if unknown or run.winners.max() >= len(names):
        wanted = f"names out of {list(SIDES)} for nodes 0 to {run.winners.max()}"
        raise ValueError(f"expected {wanted}, got {len(names)} names: {sorted(set(names))}")
    won = run.winners[1:] >= 0
    side_of = np.array([SIDES[name] for name in names], dtype=int)
    return _share(side_of[run.winners[1:][won]] == run.wall_side[:-1][won])


def border_share(run: WallRun) -> float:
    """Return the share of the steps with the nearest wall 45-55 mm away, 0 to 1.

    There it is ambiguous whether there is a wall. Another limit in that band changes
    `cluster_agreement` by at most this share, in a run in which every step has a winner.
    """
    low, high = BORDER
    return float(np.mean((run.wall_distance >= low) & (run.wall_distance <= high)))


def score_run(run: WallRun) -> dict[str, float]:
    """Return all scores that need nothing but the run."""
    sides = sides_share(run)
    return {
        "wf": wf(run),
        "tight": tight(run),
        "energy": energy(run),
        "contact_share": contact_share(run),
        "left_share": sides[LEFT],
        "right_share": sides[RIGHT],
        "side_continuity": side_continuity(run),
        "side_changes_per_1000_steps": side_changes(run),
        "position_spread_m": position_spread(run),
        "border_share": border_share(run),
        "matched_share": float(np.mean(run.winners >= 0)),
        "commanded_share": float(run.commanded.mean()),
    }


def _progress_share(run: WallRun, counts: NDArray[np.bool_]) -> float:
    """Return the progress over the steps that count, relative to the teacher's."""
    return float(run.progress[counts].sum() / (SPEED * TIMESTEP * len(run)))


def _sides_along(run: WallRun) -> NDArray[np.integer]:
    """Return the side of the wall, 1 or -1, at each step along a wall."""
    along = (run.wall_side != 0) & (run.progress > SPEED * TIMESTEP / 2)
    return run.wall_side[along]


def _share(true: NDArray[np.bool_]) -> float:
    """Return the share of true values; 0 of none."""
    return float(true.mean()) if true.size else 0.0


def _check_array(name: str, array: object, kind: str, shape: tuple[int, ...]) -> None:
    """Refuse what is not a finite array of that kind and shape with at least one row."""
    wanted = f"expected {name} as finite {_KINDS[kind]} of shape {list(shape)} with T ≥ 1"
    if not isinstance(array, np.ndarray):
        raise ValueError(f"{wanted}, got {type(array).__name__}")
    fits = array.dtype.kind == kind and array.shape == shape and len(array) > 0
    if not fits or not np.isfinite(array).all():
        raise ValueError(f"{wanted}, got {array.dtype} {list(array.shape)}")
