"""The scale of percepts, chosen from demonstrations."""

import numpy as np
import pytest
import torch
from reaching import FPS, reach, shown

from pacnet.imitator import Imitator
from pacnet.imitator.scaling import Scaling, choose_scaling, kinds_of


def columns(*values: object) -> torch.Tensor:
    """An episode `[T, D]` of these dimensions."""
    return torch.tensor(np.stack(values, axis=1), dtype=torch.float32)


def named(*names: str) -> dict[str, tuple[str, ...]]:
    return {"observation.state": names}


def scale_of(*episodes: torch.Tensor, names: tuple[str, ...]) -> np.ndarray:
    return np.array(choose_scaling(episodes, named(*names), FPS).scale)


def test_each_dimension_is_divided_by_its_spread_over_all_episodes():
    # 0, 0, 4, 4: a standard deviation of 2, though it rests in each episode; and 1, 5, 1, 5.
    episodes = columns([0, 0], [1, 5]), columns([4, 4], [1, 5])
    assert scale_of(*episodes, names=("a", "b")) == pytest.approx([1 / 2, 1 / 2])


def test_a_dimension_that_hardly_moves_is_no_finer_than_a_tenth_of_those_that_are_alike():
    there = np.repeat([-1.0, 1.0], 50)  # a standard deviation of 1
    episode = columns(there, 3 * there, 5 * there, 1e-3 * there)
    scale = scale_of(episode, names=("a", "b", "c", "d"))
    # The median of 0.001, 1, 3 and 5 is 2.
    assert 1 / scale == pytest.approx([1, 3, 5, 0.2])


def test_a_dimension_that_settles_at_the_beginning_and_then_rests_does_not_decide():
    frames = 500
    turn = np.linspace(0, 20, frames)
    settles = 0.01 * np.exp(-np.arange(frames))
    scaling = choose_scaling(
        [columns(np.sin(turn), np.cos(turn), settles)], named("a", "b", "c"), FPS
    )
    # Where it settles, it moves by a share of what the others do all the time.
    assert np.ptp(settles) * scaling.scale[2] < 0.2
    assert 1 / scaling.scale[2] == pytest.approx(0.1 * np.sin(turn).std(), rel=0.1)


def test_a_dimension_that_never_changes_is_no_finer_either():
    there = np.repeat([-1.0, 1.0], 50)
    episode = columns(there, np.full(100, 7.0))
    assert 1 / scale_of(episode, names=("a", "b")) == pytest.approx([1, 0.1])


def test_only_dimensions_of_one_unit_are_alike():
    there = np.repeat([-1.0, 1.0], 50)
    episode = columns(100 * there, 100 * there, 0.5 * there, 0.5 * there)
    names = ("arm.pos", "hand.pos", "arm.vel", "hand.vel")
    assert 1 / scale_of(episode, names=names) == pytest.approx([100, 100, 0.5, 0.5])
    assert 1 / scale_of(episode, names=("a", "b", "c", "d")) == pytest.approx(
        [100, 100, 5.025, 5.025]  # of the median of 0.5 and 100, a tenth
    )


def test_dimensions_are_alike_in_their_feature_and_their_unit():
    features = {"observation.state": ("base.x", "base.y", "base.yaw"), "glass": ("x", "knob")}
    assert kinds_of(features) == [
        ("observation.state", "place"), ("observation.state", "place"),
        ("observation.state", "turn"), ("glass", "place"), ("glass", ""),
    ]  # fmt: skip


def test_changes_are_a_quadratic_mean_of_one_also_of_what_moves_at_one_speed():
    steady, turn = np.linspace(0, 4, 400), np.linspace(0, 20, 400)
    episode, features = columns(steady, np.sin(turn)), named("a", "b")
    scaling = choose_scaling([episode], features, FPS)
    recent = scaling.recent(FPS)
    changes = recent.changes((episode.numpy() * scaling.array).astype(np.float32))
    changes = changes * scaling.change_ratio
    assert np.sqrt(np.square(changes).mean(axis=0)) == pytest.approx([1, 1], rel=1e-3)


def test_movement_is_a_tenth_of_the_mean_step():
    # 0, 1, ..., 99: a variance of (100² − 1) / 12, and steps of 1 each.
    movement = choose_scaling([columns(np.arange(100))], named("a"), FPS).movement
    assert movement == pytest.approx(0.1 / (9999 / 12) ** 0.5)


def noisy(noise: float, frames: int = 20_000) -> torch.Tensor:
    """A slow wave of a standard deviation of 1, and noise."""
    rng, turn = np.random.default_rng(0), np.linspace(0, 8 * np.pi, frames)
    return columns(2**0.5 * np.sin(turn), noise * rng.standard_normal(frames))


@pytest.mark.parametrize("noise", [0.3, 1.0])
def test_a_dimension_of_pure_noise_counts_a_fifth(noise: float):
    scale = scale_of(noisy(noise), names=("a", "b"))
    assert scale == pytest.approx([1, 1 / (5 * noise)], rel=0.03)


def test_a_dimension_that_is_partly_noise_counts_less_by_its_share():
    wave, noise = noisy(0.5).numpy().T
    # A variance of 1 + 0.25, of which a fifth is noise.
    scale = scale_of(columns(wave, wave + noise), names=("a", "b"))
    assert 1 / scale[1] == pytest.approx(1.25**0.5 * (1 + 4 * 0.2), rel=0.03)


def test_the_change_of_pure_noise_counts_less_too():
    episode = noisy(1.0)
    scaling = choose_scaling([episode], named("a", "b"), FPS)
    changes = scaling.recent(FPS).changes((episode.numpy() * scaling.array).astype(np.float32))
    wave, noise = np.sqrt(np.square(changes * scaling.change_ratio).mean(axis=0))
    assert wave == pytest.approx(1, rel=0.05)
    # No less than a fifth; the noise of percepts that lie apart is larger than that of all.
    assert 0.2 < noise < 0.4


def test_noise_is_no_movement():
    # A fifth is the length of the noise, scaled; two draws of it are seldom 2.5 lengths apart.
    assert choose_scaling([noisy(1.0)], named("a", "b"), FPS).movement == (
        pytest.approx(2.5 / 5, rel=0.03)
    )


@pytest.mark.parametrize("seed", range(12))
def test_a_robot_that_stands_where_the_path_ends_and_begins_does_not_begin_again(seed: int):
    demonstrations = shown(reach(seed))
    imitator = Imitator.from_demonstrations(demonstrations)
    imitator.learn(demonstrations)
    rng, at, progress = np.random.default_rng(seed), np.zeros(2), []
    for _ in range(400):  # 300 were shown
        step = imitator.step(np.float32([*at, 0.005 * rng.standard_normal()]))
        at = at if step.action is None else step.action
        progress.append(step.progress)
    assert min(progress[:100]) < 0.1
    assert min(progress[330:]) > 0.99


def test_the_scale_does_not_depend_on_the_frame_rate():
    scales = []
    for fps in (10, 50, 200):
        time = np.linspace(0, 4, 4 * fps)
        episode = columns(np.sin(time), time)
        scaling = choose_scaling([episode], named("a", "b"), fps)
        scales.append([*scaling.scale, *scaling.change_scale])
    np.testing.assert_allclose(scales, [scales[1]] * 3, rtol=0.05)


def test_one_frame_of_each_episode_is_enough():
    scaling = choose_scaling([columns([0.0]), columns([2.0])], named("a"), FPS)
    assert scaling == Scaling((1.0,), (1.0,), 0.0)


def test_constant_percepts_and_no_episodes_are_refused():
    with pytest.raises(ValueError, match="at least one episode"):
        choose_scaling([], named("a"), FPS)
    with pytest.raises(ValueError, match="expected percepts that change"):
        choose_scaling([torch.ones(10, 2)], named("a", "b"), FPS)


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"scale": (0.0,)}, "Scaling.scale as positive"),
        ({"scale": (float("inf"),)}, "Scaling.scale as positive"),
        ({"scale": (1.0, 1.0)}, "Scaling.scale as positive"),
        ({"scale": (), "change_scale": ()}, "Scaling.scale as positive"),
        ({"change_scale": (-1.0,)}, "Scaling.change_scale as factors"),
        ({"movement": -1.0}, "Scaling.movement ≥ 0"),
        ({"movement": float("nan")}, "Scaling.movement ≥ 0"),
    ],
)
def test_other_factors_are_refused(fields: dict, message: str):
    with pytest.raises(ValueError, match=f"expected {message}"):
        Scaling(**{"scale": (1.0,), "change_scale": (1.0,), "movement": 0.0, **fields})
