"""Recognition of what was shown to an imitator: a timeline of its demonstrations."""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray

from pacnet.competition.belief import RecognitionConfig
from pacnet.competition.recognition import Recognizer
from pacnet.competition.timeline import make_timeline
from pacnet.schemas.demonstration_memory import Shown

_CONFIG = RecognitionConfig()  # its widths suit the map's percepts, whose spread is 1


def recognizer_of(shown: Shown, tasks: int, factor: NDArray[np.float32]) -> Recognizer:
    """Return a recognizer of an episode that begins with the next percept.

    Args:
        shown: all demonstrations.
        tasks: how many there are.
        factor: turns scaled percepts into those of the map, `[1, D]`.

    Raises:
        ValueError: nothing was shown.
    """
    known = np.flatnonzero(np.diff(shown.first) > 0)
    if len(known) == 0:
        raise ValueError("expected an imitator that has learned something, got one that has not")
    states = _CONFIG.n_states
    rows = np.stack([_states(shown, int(number), states) for number in known])
    cues = shown.percepts[rows.ravel()] * factor
    places = torch.arange(rows.size).view(rows.shape)
    task = shown.task[known]
    timeline = make_timeline(
        places,
        torch.from_numpy(known),
        torch.from_numpy(shown.frames[known]),
        torch.as_tensor(task),
    )
    last = shown.percepts[shown.first[known + 1] - 1] * factor
    return Recognizer(timeline, cues, task, tasks, last, _CONFIG)


def _states(shown: Shown, number: int, states: int) -> NDArray[np.int64]:
    """Return the row of a demonstration that is nearest in time to each of its states."""
    first, end = shown.first[number], shown.first[number + 1]
    times = shown.time[first:end]
    middle = (np.arange(states) + 0.5) / states * shown.frames[number] - 0.5
    after = np.searchsorted(times, middle).clip(0, len(times) - 1)
    before = (after - 1).clip(0)
    nearer = np.abs(times[before] - middle) < np.abs(times[after] - middle)
    return first + np.where(nearer, before, after)
