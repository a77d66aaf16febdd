"""Claims about angles that jump by a full turn, on made-up joints, grippers and positions."""

import numpy as np
import pytest

from pacnet.datasets.format.angles import find_wraps

FPS = 10.0
# convention -> (period, start of the interval that holds an angle)
CONVENTIONS = {
    "-180 to 180": (360.0, -180.0),
    "0 to 360": (360.0, 0.0),
    "-pi to pi": (2 * np.pi, -np.pi),
    "0 to 2 pi": (2 * np.pi, 0.0),
}


def in_convention(degrees: np.ndarray, convention: str) -> np.ndarray:
    period, start = CONVENTIONS[convention]
    return (degrees / 360 * period - start) % period + start


def notes_of(*episodes: np.ndarray) -> list[str]:
    values = [episode[:, None].astype(np.float32) for episode in episodes]
    return find_wraps(values, range(len(values)), ["wrist"], FPS, "action")


def joints(rng: np.random.Generator) -> dict[str, np.ndarray]:
    """Joints in degrees that cross the end of each convention in one episode of 300 frames."""
    frames = np.arange(300)
    noise = rng.normal(size=300)
    return {
        "slow": 0.5 * frames + 60 + 0.05 * noise,
        "turning": np.cumsum(rng.uniform(2, 20) * (1 + 0.2 * noise)),
        "fast": np.cumsum(np.clip(rng.uniform(30, 58) + noise, 0, 60)),
        "backwards": -np.cumsum(np.full(300, 60.0)) + rng.uniform(0, 60),
        "swinging": 90 + 200 * np.sin(frames / rng.uniform(6, 30)),
    }


def others(rng: np.random.Generator, period: float) -> dict[str, np.ndarray]:
    """Signals of 300 frames as wide as a full turn that are no angles."""
    frames, half = np.arange(300), period / 2
    held = np.repeat(rng.uniform(-half, half, 100), rng.integers(3, 20))[:300]
    toggled = np.where(np.cumsum(rng.random(300) < 0.05) % 2, 0.95 * half, -0.95 * half)
    filtered = np.convolve(np.pad(toggled, 1, "edge"), [0.2, 0.6, 0.2], "valid")
    burst = np.zeros(300)
    burst[100:112] = rng.uniform(-half, half, 12)
    burst[[120, 140]] = -half, half
    return {
        "burst": burst,
        "toggled": toggled,
        "filtered": filtered,
        "ramped": np.convolve(np.pad(toggled, 1, "edge"), [0, 0.6, 0.4], "valid"),
        "chattering": 0.95 * half * (-1.0) ** frames,
        "held": held,
        "uniform": rng.uniform(-half, half, 300),
        "normal": np.clip(rng.normal(size=300) * period / 6, -half, half),
        "walk": np.clip(np.cumsum(rng.normal(size=300)) * period / 30, -half, half),
        "sawtooth": frames % 50 / 49 * 0.9 * period,
        "constant": np.full(300, half),
        "dropouts": np.where(rng.random(300) < 0.03, 0.0, 0.9 * period),
    }


@pytest.mark.parametrize("convention", CONVENTIONS)
@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("name", joints(np.random.default_rng(0)))
def test_a_joint_that_turns_past_its_end_is_told(convention, name, seed):
    degrees = joints(np.random.default_rng(seed))[name]
    # Turned so that the end is crossed in the middle of the range.
    end = 180.0 if "-" in convention else 0.0
    assert len(notes_of(in_convention(degrees - np.median(degrees) + end, convention))) == 1


@pytest.mark.parametrize("convention", CONVENTIONS)
@pytest.mark.parametrize("deviation", [0.05, 0.5, 4.0])
def test_a_joint_at_rest_whose_noise_flips_its_sign_is_told(convention, deviation):
    noise = np.random.default_rng(0).normal(size=300) * deviation
    end = 180.0 if "-" in convention else 0.0
    assert len(notes_of(in_convention(end + noise, convention))) == 1


def test_an_encoder_at_rest_between_its_last_and_first_count_is_told():
    counts = np.repeat([4095, 0, 4095, 0], [30, 5, 20, 8])
    assert len(notes_of(counts / 4096 * 360)) == 1


@pytest.mark.parametrize("direction", [1, -1])
def test_a_joint_that_is_read_every_second_frame_and_starts_at_its_end_is_told(direction):
    # 175 degrees, then 10 more every second frame: no step beside the wrap moves.
    degrees = np.concatenate([np.full(20, 175.0), np.repeat(185 + 10.0 * np.arange(20), 2)])
    assert len(notes_of(in_convention(degrees[::direction], "-180 to 180"))) == 1


def test_a_joint_that_passes_its_end_for_one_frame_is_told():
    there = np.arange(-2.0, 182.0, 6.0)  # -2 to 178
    assert len(notes_of(np.concatenate([there, [-178.0], there[::-1]]))) == 1


@pytest.mark.parametrize("period", [360.0, 2 * np.pi])
@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("name", others(np.random.default_rng(0), 1.0))
def test_what_only_looks_like_a_wide_angle_is_not_told(period, seed, name):
    assert notes_of(others(np.random.default_rng(seed), period)[name]) == []


@pytest.mark.parametrize("jitter", [0.0, 0.01, 0.02])
def test_a_gripper_that_toggles_between_minus_three_and_three_is_no_angle(jitter):
    gripper = np.repeat([-3.0, 3.0, -3.0, 3.0], [40, 3, 17, 20])
    assert notes_of(gripper + jitter * np.random.default_rng(0).normal(size=80)) == []


def test_a_wide_position_in_pixels_is_no_angle():
    turning = np.arange(100) * 7.0
    assert len(notes_of(turning % 360)) == 1
    assert notes_of(turning % 360 / 360 * 512) == []
    assert notes_of(turning % 360 + 100) == []  # 100 to 460 is no convention of angles


def test_a_step_between_episodes_is_no_wrap():
    rising = np.arange(-179.0, 180.0, 2.0)  # as if it went on from 179 to 181
    assert notes_of(rising, rising, rising) == []


def test_a_note_names_the_dimension_the_first_wrap_and_what_to_do():
    # 10 degrees a frame from 0: frame 18 is at -180, frame 54 again.
    turning = (np.arange(60) * 10.0 + 180) % 360 - 180
    still = np.zeros(60)
    values = [np.stack(columns, axis=1) for columns in ((still, still), (still, turning))]
    (note,) = find_wraps(values, [4, 7], ["elbow", "wrist"], FPS, "observation.state")
    assert note == (
        "'observation.state', 'wrist': an angle that jumps by a full turn, 360 degrees (2 times, "
        "first in episode 7 at 1.80 s). The imitator takes its two ends for far apart: store it "
        "unwrapped (numpy.unwrap(angle, period=360)) or as its sine and cosine."
    )
    (note,) = find_wraps([values[1] / 180 * np.pi], [7], ["elbow", "wrist"], FPS, "action")
    assert "2 pi (2 times, " in note
    assert "(numpy.unwrap(angle))" in note


def test_one_wrap_among_other_jumps_is_not_enough():
    glitches = np.zeros(200)
    glitches[20:180:20] = 200.0  # 16 jumps that nothing beside them explains
    one_wrap = in_convention(np.linspace(100, 250, 80), "-180 to 180")
    assert len(notes_of(one_wrap)) == 1
    assert notes_of(one_wrap, glitches - 100) == []


def test_episodes_of_one_frame_or_none_are_no_angles():
    empty = np.empty((0, 2))
    assert find_wraps([], [], ["a", "b"], FPS, "action") == []
    assert find_wraps([empty, np.ones((1, 2))], [0, 1], ["a", "b"], FPS, "action") == []
