"""Labels by hand of where demonstrations are cut, and the comparison with attention."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import torch

from benchmarks.metaworld.cuts import Compared, compare, landmarks_by_attention, starts, table
from benchmarks.metaworld.features import ACTION, STATE, environment_names
from benchmarks.metaworld.labels import LABELS, labelled
from benchmarks.metaworld.tasks import DEVELOPMENT, HELD_OUT
from pacnet.datasets.demonstrations import Demonstration, Demonstrations


def test_labels_begin_at_the_first_frame_and_change_at_each() -> None:
    assert set(LABELS) <= {*DEVELOPMENT, *HELD_OUT}
    for starting in LABELS.values():
        assert starting[0][0] == 0
        assert all(at < later and name != other
                   for (at, name), (later, other) in pairwise(starting))  # fmt: skip


def test_every_frame_has_the_label_of_the_last_start() -> None:
    landmarks = labelled("pick-place", 63)
    assert landmarks == ["object"] * 28 + ["goal"] * 35


def test_starts_are_told_with_their_frames() -> None:
    assert starts(["goal", "object", "object", "goal"]) == "0 goal, 1 object, 3 goal"


def test_the_table_counts_the_frames_in_which_both_agree() -> None:
    compared = [
        Compared("push", ["object"] * 2 + ["goal"] * 2, ["object"] + ["goal"] * 3),
        Compared("hammer", ["goal"] * 6, ["goal"] * 6),
    ]
    drawn = table(compared)
    assert [row[3] for row in drawn.rows] == ["75%", "100%"]
    assert "9 of 10 frames, 90.0%" in " ".join(drawn.text.split())


def test_attention_goes_to_the_object_and_then_carries_it_to_the_goal() -> None:
    """The hand comes from 0 to an object at 0.3, waits, and carries it to 0.9: 1 cm a frame."""
    hand = np.zeros((110, 3), np.float32)
    hand[:, 0] = np.concatenate(
        [np.linspace(0, 0.3, 30), np.full(10, 0.3), np.linspace(0.3, 0.9, 60), np.full(10, 0.9)]
    )
    thing, goal = np.full_like(hand, 0), np.full_like(hand, 0)
    thing[:, 0], goal[:, 0] = np.maximum(hand[:, 0], 0.3), 0.9
    state = np.concatenate([hand, np.ones((110, 1), np.float32)], axis=1)
    names = {
        "observation.state": STATE,
        "observation.environment_state": environment_names(("object", "goal")),
        "action": ACTION,
    }
    surroundings = torch.from_numpy(np.concatenate([thing, goal], axis=1))
    one = Demonstration(0, "", torch.from_numpy(state), surroundings, torch.from_numpy(state))
    landmarks = landmarks_by_attention(Demonstrations(80, names, (one,)))
    assert landmarks[:38] == ["object"] * 38
    assert landmarks[45:95] == ["goal"] * 50


def test_a_demonstration_that_was_not_recorded_is_asked_for(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match=r"--tasks drawer-open"):
        compare(tmp_path)
