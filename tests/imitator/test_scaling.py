"""The scale of percepts, chosen from demonstrations."""

import math

import pytest
import torch

from pacnet.imitator.scaling import noise_scaling


def moving(noise: tuple[float, ...], spread: tuple[float, ...], seed: int = 0) -> torch.Tensor:
    """One episode [4000, D] of a slow movement in each dimension, and white noise."""
    generator = torch.Generator().manual_seed(seed)
    phase = torch.linspace(0, 4 * math.pi, 4000, dtype=torch.float64)[:, None]
    white = torch.randn(4000, len(noise), generator=generator, dtype=torch.float64)
    # A sine has a standard deviation of 1 / sqrt(2).
    path = math.sqrt(2) * torch.tensor(spread) * phase.sin()
    return (path + torch.tensor(noise) * white).float()


def test_dimensions_are_measured_in_units_of_their_noise():
    scaling = noise_scaling([moving(noise=(0.1, 0.02), spread=(1.0, 1.0))])
    assert scaling.scale[1] / scaling.scale[0] == pytest.approx(5, rel=0.05)


def test_a_dimension_that_is_mostly_noise_counts_for_little():
    scaling = noise_scaling([moving(noise=(0.05, 0.05), spread=(1.0, 0.0))])
    percepts = moving(noise=(0.05, 0.05), spread=(1.0, 0.0), seed=1) * torch.tensor(scaling.scale)
    assert percepts[:, 1].var() < 0.01 * percepts[:, 0].var()


def test_scaled_percepts_are_one_away_from_their_mean():
    episodes = [moving((0.1, 0.02, 0.3), (1.0, 5.0, 0.5), seed) for seed in range(3)]
    scaled = torch.cat(episodes) * torch.tensor(noise_scaling(episodes).scale)
    apart = (scaled - scaled.mean(dim=0)).square().sum(dim=1).mean().sqrt()
    assert float(apart) == pytest.approx(1, abs=1e-3)


def test_the_length_of_the_noise():
    # In units of their noise both have a length of 1, sqrt(2) together; they are 1 / 0.1 and
    # 2 / 0.1 wide, sqrt(1.01) and sqrt(4.01) with the noise itself: scaled down by that.
    scaling = noise_scaling([moving(noise=(0.1, 0.1), spread=(1.0, 2.0))])
    assert scaling.noise == pytest.approx(math.sqrt(2) / math.sqrt(101 + 401), rel=0.05)


def test_a_jump_in_the_recording_is_not_noise():
    episode = moving((0.05,), (1.0,))
    jumped = episode.clone()
    jumped[2000:] += 0.5
    calm, jumpy = noise_scaling([episode]), noise_scaling([jumped])
    ratio = float(episode.std() / jumped.std())  # the factor takes the spread to 1
    assert jumpy.scale[0] == pytest.approx(calm.scale[0] * ratio, rel=1e-3)


def test_without_noise_a_dimension_is_scaled_by_its_spread():
    scaling = noise_scaling([moving(noise=(0.0, 0.0), spread=(1.0, 100.0))])
    assert scaling.scale[0] == pytest.approx(100 * scaling.scale[1], rel=1e-3)


def test_a_dimension_that_never_changes_gets_the_median_factor():
    episode = torch.cat([moving((0.1, 0.2, 0.4), (1.0,) * 3), torch.full((4000, 1), 7.0)], dim=1)
    scale = noise_scaling([episode]).scale
    assert scale[3] == pytest.approx(scale[1])


@pytest.mark.parametrize("frames", [1, 2])
def test_episodes_too_short_to_measure_noise(frames: int):
    episodes = [torch.full((frames, 1), float(number)) for number in range(3)]
    # Means are 0, 1, 2, a standard deviation of sqrt(2 / 3).
    assert noise_scaling(episodes).scale == pytest.approx((math.sqrt(1.5),))


def test_constant_percepts_and_no_episodes_are_refused():
    with pytest.raises(ValueError, match="at least one episode"):
        noise_scaling([])
    with pytest.raises(ValueError, match="expected percepts that change"):
        noise_scaling([torch.ones(10, 2)])
