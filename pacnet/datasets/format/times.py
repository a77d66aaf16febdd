"""Where the times of a dataset's frames contradict its `fps` or each other.

LeRobot writes `timestamp` as `frame_index / fps`; other writers store what a clock said.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pacnet.datasets.format.numbers import episodes_text

_RATE_TOLERANCE = 0.05  # of 1 / fps
_LONGEST_STEP = 1.5  # typical steps; jitter stays below
_SHOWN = 3  # events spelled out in a note


class Timing(NamedTuple):
    """What the times of a dataset say about its frames.

    Attributes:
        gaps: for each episode, the frames that do not follow on the frame before, counted from 0.
        notes: sentences for the user.
    """

    gaps: list[tuple[int, ...]]
    notes: list[str]


class _Frames(NamedTuple):
    """The frames of all episodes, one after the other."""

    episodes: Sequence[int]  # [E] their indices in the dataset
    starts: NDArray[np.intp]  # [E] first row of each episode
    owner: NDArray[np.intp]  # [N] position in `episodes`
    times: NDArray[np.float64]  # [N] in s, NaN where not finite or without the column
    numbers: NDArray[np.int64]  # [N] frame_index, or as counted where the column is missing
    within: NDArray[np.bool_]  # [N - 1] whether a step leads to a frame of the same episode
    steps: NDArray[np.float64]  # [N - 1] in s, NaN between episodes
    spacing: NDArray[np.float64]  # [N - 1] in s, between a time and the next that can be stored


def find_gaps(
    fps: float,
    episodes: Sequence[int],
    lengths: Sequence[int],
    timestamps: NDArray[Any] | None,
    frame_indices: NDArray[Any] | None,
) -> Timing:
    """Find the frames that do not follow on the frame before, by their time or their number.

    A step in time is a gap if it is longer than 1.5 typical steps, 0 or negative. The typical step
    is the median over all episodes.

    Args:
        fps: frames per second that `meta/info.json` gives [1/s].
        episodes: index of each episode.
        lengths: number of its frames.
        timestamps: time of all frames `[N]` [s], one episode after the other; None without.
        frame_indices: number of each frame in its episode, `[N]`; None without.

    Returns:
        The gaps of each episode, and notes about all that contradicts itself.
    """
    frames = _frames(episodes, lengths, timestamps, frame_indices)
    known = frames.steps[np.isfinite(frames.steps)]
    typical = float(np.median(known)) if known.size else 0.0
    jumps, notes_of_numbers = _check_numbers(frames)
    if typical > 0:
        breaks, notes = _check_times(frames, typical, fps)
    else:
        breaks, notes = np.zeros_like(jumps), _unusable(frames, timestamps)
    notes += notes_of_numbers
    rows = np.flatnonzero(breaks | jumps) + 1
    if not rows.size:
        return Timing([()] * len(episodes), notes)
    notes.append(_describe_gaps(frames, rows, breaks, typical))
    numbers = rows - frames.starts[frames.owner[rows]]
    ends = np.searchsorted(frames.owner[rows], np.arange(1, len(episodes)))
    parts = np.split(numbers, ends)[: len(episodes)]
    return Timing([tuple(part.tolist()) for part in parts], notes)


def _frames(
    episodes: Sequence[int],
    lengths: Sequence[int],
    timestamps: NDArray[Any] | None,
    frame_indices: NDArray[Any] | None,
) -> _Frames:
    """Compare each frame with the one before."""
    owner, starts = np.repeat(np.arange(len(lengths)), lengths), np.cumsum([0, *lengths])[:-1]
    stored, numbers = timestamps, frame_indices
    if stored is None:
        stored = np.full(len(owner), np.nan)
    times = stored.astype(np.float64)
    with np.errstate(invalid="ignore", over="ignore"):
        spacing = np.spacing(np.abs(stored[1:])).astype(np.float64)
    if numbers is None:
        numbers = np.arange(len(owner))
    times[~np.isfinite(times)] = np.nan
    within = owner[1:] == owner[:-1]
    with np.errstate(over="ignore"):
        steps = np.where(within, np.diff(times), np.nan)
    return _Frames(episodes, starts, owner, times, numbers, within, steps, spacing)


def _check_numbers(frames: _Frames) -> tuple[NDArray[np.bool_], list[str]]:
    """Return which steps skip frames by their numbers, `[N - 1]`; usual steps may be above 1."""
    steps = np.diff(frames.numbers)
    usual = float(np.median(steps[frames.within])) if frames.within.any() else 1.0
    if usual > 0:
        return frames.within & (steps != usual), []
    note = "The frame_index is unusable, it does not rise: frames are taken in their order."
    return np.zeros_like(frames.within), [note]


def _unusable(frames: _Frames, timestamps: NDArray[Any] | None) -> list[str]:
    """Say that the timestamps tell nothing, where there are some to tell it."""
    if not frames.within.any() or timestamps is None:
        return []
    found = "they do not rise" if np.isfinite(frames.steps).any() else "they are not finite"
    return [f"The timestamps are unusable, {found}: frames are taken as evenly spaced."]


def _check_times(
    frames: _Frames, typical: float, fps: float
) -> tuple[NDArray[np.bool_], list[str]]:
    """Return which steps in time are gaps, `[N - 1]`, and notes about the rest."""
    notes = []
    with np.errstate(invalid="ignore", over="ignore"):
        spacing = frames.spacing  # two roundings move a step by at most that
        rounding = float(np.median(spacing[np.isfinite(frames.steps)]))
        breaks = (frames.steps > _LONGEST_STEP * typical + spacing) | (frames.steps < 0)
        breaks |= (frames.steps == 0) & (spacing < typical)
    if abs(typical - 1 / fps) > _RATE_TOLERANCE / fps + rounding:
        notes.append(
            f"The timestamps have {1 / typical:.4g} frames per second, meta/info.json gives fps "
            f"{fps:g}: correct the one that is wrong."
        )
    stopped = _stopped(frames)
    if stopped.any():
        names = [frames.episodes[position] for position in np.flatnonzero(stopped).tolist()]
        notes.append(
            f"The timestamps of {episodes_text(names)} stand still and are unusable: "
            "frames are taken as evenly spaced."
        )
        breaks &= ~stopped[frames.owner[1:]]
    return breaks, notes + _note_unknown(frames)


def _stopped(frames: _Frames) -> NDArray[np.bool_]:
    """Return which episodes of three frames or more have one time for all, `[E]`."""
    owner, count = frames.owner[1:], len(frames.episodes)
    steps = np.bincount(owner[frames.within], minlength=count)
    still = np.bincount(owner[frames.within & (frames.steps == 0)], minlength=count)
    return (steps > 1) & (steps == still)


def _note_unknown(frames: _Frames) -> list[str]:
    """Say how many timestamps are not finite in episodes that have some that are."""
    finite = np.isfinite(frames.times)
    some = np.bincount(frames.owner[finite], minlength=len(frames.episodes)) > 0
    rows = np.flatnonzero(~finite & some[frames.owner])
    if not rows.size:
        return []
    owner = int(frames.owner[rows[0]])
    return [
        f"Timestamps that are not finite: {rows.size}, the first in episode "
        f"{frames.episodes[owner]}, frame {rows[0] - frames.starts[owner]}. No gap is looked for "
        "beside them."
    ]


def _describe_gaps(
    frames: _Frames, rows: NDArray[np.intp], breaks: NDArray[np.bool_], typical: float
) -> str:
    """Return the note about the gaps before these rows."""
    events = [_describe(frames, int(row), bool(breaks[row - 1]), typical) for row in rows[:_SHOWN]]
    more = f"; and {rows.size - _SHOWN} more" if rows.size > _SHOWN else ""
    count = "1 gap" if rows.size == 1 else f"{rows.size} gaps"
    return f"{count} in time, which learning does not cross: {'; '.join(events)}{more}."


def _describe(frames: _Frames, row: int, is_break: bool, typical: float) -> str:
    """Return where the gap before a row is, and how long."""
    owner = int(frames.owner[row])
    start = frames.starts[owner]
    passed = float(frames.times[row - 1]) - float(frames.times[start])
    place = f"episode {frames.episodes[owner]}, frame {row - start}"
    if np.isfinite(passed):
        place += f", after {passed:.3f} s"
    step = frames.steps[row - 1]
    if not is_break:
        before, number = frames.numbers[row - 1 : row + 1]
        return f"{place} (frame_index {number} follows on {before})"
    if step > 0:
        return f"{place} ({step:.3g} s in place of {typical:.3g} s)"
    return (
        f"{place} (time goes back by {-step:.3g} s)" if step else f"{place} (the same time twice)"
    )
