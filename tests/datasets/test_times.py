"""Claims about frames whose time contradicts `fps` or itself, on times written by hand."""

from collections.abc import Sequence

import numpy as np
import pytest

from pacnet.datasets.format.times import Timing, find_gaps

UNEVEN = "in time, which learning does not cross"


def seconds(*times: float) -> np.ndarray:
    return np.array(times, dtype=np.float64)


def even(count: int, fps: float = 10, start: float = 0.0) -> np.ndarray:
    return start + np.arange(count) / fps


def look(fps: float, episodes: Sequence[int], times: Sequence, numbers: Sequence) -> Timing:
    """What is found in the times and numbers of each episode, None without the column."""
    lengths = [len(one if two is None else two) for one, two in zip(times, numbers, strict=True)]
    columns = [
        None if any(part is None for part in parts) else np.concatenate(parts or [[]])
        for parts in (times, numbers)
    ]
    return find_gaps(fps, episodes, lengths, *columns)


def test_frames_that_follow_on_each_other_have_no_gaps():
    timing = look(10, [0, 1], [even(5), even(4)], [np.arange(5), np.arange(4)])
    assert timing == ([(), ()], [])


@pytest.mark.parametrize(
    ("times", "gaps", "event"),
    [
        # A step of 0.4 s in place of 0.1 s leads to frame 3.
        (seconds(0, 0.1, 0.2, 0.6, 0.7), (3,), "after 0.200 s (0.4 s in place of 0.1 s)"),
        (seconds(0, 0.1, 0.2, 0.05, 0.15), (3,), "after 0.200 s (time goes back by 0.15 s)"),
        (seconds(0, 0.1, 0.1, 0.2, 0.3), (2,), "after 0.100 s (the same time twice)"),
        (seconds(0, 0.1, 0.2, 0.349, 0.449), (), None),  # 1.49 steps
        (seconds(0, 0.1, 0.2, 0.351, 0.451), (3,), "0.151 s in place of 0.1 s"),
    ],
)
def test_a_step_that_is_too_long_or_does_not_rise_is_a_gap(times, gaps, event):
    timing = look(10, [4], [times], [None])
    assert timing.gaps == [gaps]
    assert len(timing.notes) == (event is not None)
    for note in timing.notes:
        assert note.startswith(f"1 gap {UNEVEN}: episode 4, frame {gaps[0]}, ")
        assert event in note


def test_a_lost_frame_is_told_once_by_time_and_number():
    numbers = np.array([0, 1, 4, 5])
    timing = look(10, [0], [numbers / 10], [numbers])
    assert timing.gaps == [(2,)]
    assert timing.notes == [
        f"1 gap {UNEVEN}: episode 0, frame 2, after 0.100 s (0.3 s in place of 0.1 s)."
    ]


@pytest.mark.parametrize("times", [even(4), None])
def test_a_frame_index_that_does_not_rise_by_one_is_a_gap(times):
    timing = look(10, [7], [times], [np.array([3, 4, 4, 5])])
    assert timing.gaps == [(2,)]
    (note,) = timing.notes
    assert "episode 7, frame 2" in note
    assert "frame_index 4 follows on 4" in note


def test_numbers_and_times_may_begin_anywhere():
    timing = look(10, [0], [even(5, start=1234.5)], [np.arange(100, 105)])
    assert timing == ([()], [])


def test_gaps_are_relative_to_the_rate_of_the_timestamps_which_is_told():
    # 20 frames per second where 30 are promised: a step of 0.1 s is two of them.
    times = [even(50, 20), seconds(0, 0.05, 0.15, 0.2)]
    timing = look(30, [0, 1], times, [None, None])
    assert timing.gaps == [(), (2,)]
    assert timing.notes[0].startswith(
        "The timestamps have 20 frames per second, meta/info.json gives fps 30:"
    )
    assert len(timing.notes) == 2


@pytest.mark.parametrize(("rate", "told"), [(10.4, False), (9.6, False), (10.6, True)])
def test_a_rate_within_five_percent_is_that_of_the_description(rate, told):
    timing = look(10, [0], [even(30, rate)], [None])
    assert timing.gaps == [()]
    assert bool(timing.notes) is told


@pytest.mark.parametrize("fps", [10, 30, 60, 250, 700, 1000, 2000])
@pytest.mark.parametrize("start", [0, 1000, 9000])
def test_rounding_to_float32_makes_no_gaps(fps, start):
    times = even(1000, fps, start).astype(np.float32)
    assert look(fps, [0], [times], [np.arange(1000)]) == ([()], [])


@pytest.mark.parametrize("seed", range(5))
def test_jitter_of_two_fifths_of_a_step_makes_no_gaps(seed):
    steps = (1 + np.random.default_rng(seed).uniform(-0.4, 0.4, 999)) / 30
    assert look(30, [0], [np.cumsum([0, *steps])], [None]) == ([()], [])


@pytest.mark.parametrize(
    ("times", "reason"),
    [
        (np.zeros(5), "do not rise"),
        (even(5)[::-1], "do not rise"),
        (seconds(0, 0, 0, 1, 1, 1), "do not rise"),
        (np.full(5, np.nan), "not finite"),
        (np.full(5, np.inf), "not finite"),
    ],
)
def test_times_that_tell_nothing_are_told_and_make_no_gaps(times, reason):
    numbers = np.arange(len(times))
    numbers[-1] += 1  # what frame_index says still counts
    timing = look(10, [0], [times], [numbers])
    assert timing.gaps == [(len(times) - 1,)]
    unusable, gap = timing.notes
    assert unusable.startswith("The timestamps are unusable")
    assert reason in unusable
    assert "frame_index" in gap


def test_one_episode_whose_clock_stands_still_does_not_spoil_the_others():
    timing = look(10, [3, 5], [even(9), np.full(4, 2.0)], [None, None])
    assert timing.gaps == [(), ()]
    assert timing.notes == [
        "The timestamps of episode 5 stand still and are unusable: "
        "frames are taken as evenly spaced."
    ]


def test_single_timestamps_that_are_not_finite_are_told_and_make_no_gaps():
    timing = look(10, [6], [seconds(0, 0.1, np.nan, 0.3, 0.4)], [None])
    assert timing.gaps == [()]
    (note,) = timing.notes
    assert "not finite: 1, the first in episode 6, frame 2." in note


def test_three_events_are_spelled_out():
    times = np.cumsum([0, 0.1, 0.1, 0.1, 0.9, 0.1, 0.1, 0.8, 0.1, 0.7, 0.1, 0.6, 0.1, 0.5, 0.1])
    (note,) = look(10, [0], [times], [None]).notes
    assert note.startswith(f"5 gaps {UNEVEN}")
    assert [f"{step} s in place" in note for step in (0.9, 0.8, 0.7, 0.6)] == [True] * 3 + [False]
    assert note.endswith("; and 2 more.")


def test_episodes_of_one_frame_of_none_and_without_columns_have_no_gaps():
    times = [seconds(5.0), seconds(), even(3)]
    numbers = [np.array([8]), np.array([], dtype=np.int64), np.arange(3)]
    assert look(10, range(3), times, numbers) == ([()] * 3, [])
    assert look(10, range(3), times, [None] * 3) == ([()] * 3, [])
    assert look(10, range(3), [None] * 3, numbers) == ([()] * 3, [])
    assert look(10, [], [], []) == ([], [])


def test_the_step_between_two_episodes_is_no_gap():
    timing = look(10, [0, 1, 2], [even(3), even(3, start=50), even(3)], [None] * 3)
    assert timing == ([()] * 3, [])


def test_two_frames_at_one_time_are_a_gap():
    timing = look(10, [3, 5], [even(9), np.full(2, 2.0)], [None, None])
    assert timing.gaps == [(), (1,)]


def test_clock_times_in_doubles_are_not_rounded():
    """Seconds since 1970, of which float32 holds every 128th."""
    times = 1.7e9 + np.array([0, 0.1, 0.2, 5.3, 5.4])
    assert look(10, [0], [times], [None]).gaps == [(3,)]


@pytest.mark.parametrize("numbers", [np.zeros(5, int), np.arange(5)[::-1]])
def test_numbers_of_frames_that_do_not_rise_are_unusable(numbers: np.ndarray):
    timing = look(10, [0], [even(5)], [numbers])
    assert timing.gaps == [()]
    assert "frame_index is unusable" in timing.notes[0]


def test_every_third_frame_of_a_recording_has_no_gaps():
    assert look(10, [0], [even(5)], [3 * np.arange(5)]) == ([()], [])
    assert look(10, [0], [even(5)], [np.array([0, 3, 6, 12, 15])]).gaps == [(3,)]
