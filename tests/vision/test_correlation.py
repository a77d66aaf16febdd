"""Patches are found where they are, to a fraction of a pixel, whatever the light."""

from __future__ import annotations

import itertools

import pytest
import torch
from torch import Tensor

from pacnet.vision.correlation import as_tensor, contrast, find, patches_at

HEIGHT, WIDTH, SIZE = 36, 48, 7
WIDE = 2.2  # pixels, standard deviation of a bump


def smooth(down: float = 0.0, right: float = 0.0, seed: int = 0) -> Tensor:
    """A picture `[1, 3, h, w]` of bumps, slanted and of some pixels, all shifted exactly."""
    generator = torch.Generator().manual_seed(seed)
    rows = torch.arange(HEIGHT, dtype=torch.float64)[:, None] - down
    columns = torch.arange(WIDTH, dtype=torch.float64) - right
    picture = torch.full((3, HEIGHT, WIDTH), 0.3, dtype=torch.float64)
    for row, column, slant, *colour in torch.rand(90, 6, generator=generator).tolist():
        y, x = rows - row * HEIGHT, columns - column * WIDTH
        bump = (-(y**2 + x**2 + 1.4 * (slant - 0.5) * x * y) / (2 * WIDE**2)).exp()
        picture += 0.5 * (torch.tensor(colour)[:, None, None] - 0.5) * bump
    return picture[None].float()


CORNERS = [(4, 5), (10, 30), (25, 17), (18, 39)]


def test_a_patch_is_found_where_it_was_cut():
    picture = smooth()
    found = find(picture, patches_at(picture[0], CORNERS, SIZE))
    torch.testing.assert_close(found.scores, torch.ones(1, 4), atol=1e-3, rtol=0)
    expected = torch.tensor(CORNERS, dtype=torch.float32)[None]
    torch.testing.assert_close(found.places, expected, atol=0.25, rtol=0)


@pytest.mark.parametrize(("light", "noise"), [(0.8, 0.0), (1.25, 0.0), (0.5, 0.0), (1.0, 0.02)])
def test_light_and_noise_leave_it_there(light: float, noise: float):
    picture = smooth()
    grain = torch.randn(picture.shape, generator=torch.Generator().manual_seed(1))
    found = find(light * picture + noise * grain, patches_at(picture[0], CORNERS, SIZE))
    apart = (found.places - torch.tensor(CORNERS)).norm(dim=2).max().item()
    assert apart < (0.25 if noise == 0 else 0.5)
    if noise == 0:
        torch.testing.assert_close(found.scores, torch.ones(1, 4), atol=1e-3, rtol=0)


@pytest.mark.parametrize(
    "shift", [*itertools.product((-0.5, -0.25, 0.0, 0.4), (-0.3, 0.0, 0.25, 0.5)), (2.6, -3.3)]
)
def test_a_fraction_of_a_pixel_is_told_to_about_a_tenth(shift: tuple[float, float]):
    patches = patches_at(smooth()[0], CORNERS, SIZE)
    found = find(smooth(*shift), patches)
    expected = torch.tensor(CORNERS) + torch.tensor(shift)
    apart = (found.places[0] - expected).abs()
    assert apart.mean().item() < 0.12
    assert apart.max().item() < 0.25


def test_it_is_found_in_a_corner_of_the_picture():
    picture = smooth()
    corners = [(0, 0), (0, WIDTH - SIZE), (HEIGHT - SIZE, 0), (HEIGHT - SIZE, WIDTH - SIZE)]
    found = find(picture, patches_at(picture[0], corners, SIZE))
    assert found.places[0].tolist() == [list(map(float, corner)) for corner in corners]


def test_the_score_is_the_correlation_of_all_colours():
    picture = smooth(seed=1)[0].double()
    patch = patches_at(smooth(seed=2)[0], [(8, 8)], SIZE)
    unit = patch[0] / patch.norm()
    found = find(picture[None].float(), patch)
    row, column = found.places[0, 0].round().long().tolist()
    best = -1.0
    for at in itertools.product((row - 1, row, row + 1), (column - 1, column, column + 1)):
        part = picture[:, at[0] : at[0] + SIZE, at[1] : at[1] + SIZE]
        if part.shape[1:] == (SIZE, SIZE):
            part = part - part.mean(dim=(1, 2), keepdim=True)
            best = max(best, ((part * unit).sum() / part.norm()).item())
    assert found.scores.item() == pytest.approx(best, abs=1e-4)
    assert found.scores.item() < 0.9


def test_the_margin_is_by_how_much_the_best_place_beats_another():
    """A picture of the same twice leaves no doubt about the patch, and all about its place."""
    once = smooth()
    once[..., WIDTH // 2 :] = 0.5
    twice = torch.cat([once[..., : WIDTH // 2], once[..., : WIDTH // 2]], dim=3)
    patch = patches_at(once[0], [(12, 9)], SIZE)
    assert find(once, patch).margins.item() > 0.15
    assert find(twice, patch).margins.item() == pytest.approx(0, abs=1e-3)


@pytest.mark.parametrize("level", [0, 128, 255])
def test_no_contrast_gives_finite_places_and_no_match(level: int):
    plain = as_tensor(torch.full((2, HEIGHT, WIDTH, 3), level, dtype=torch.uint8))
    of_something = patches_at(smooth()[0], CORNERS, SIZE)
    of_nothing = patches_at(plain[0], CORNERS, SIZE)
    for pictures, patches in ((plain, of_something), (smooth(), of_nothing), (plain, of_nothing)):
        found = find(pictures, patches)
        assert all(bool(part.isfinite().all()) for part in found)
        assert found.scores.max().item() < 0.1
        assert bool((found.places >= 0).all())
        assert bool((found.places <= torch.tensor([HEIGHT - SIZE, WIDTH - SIZE])).all())


def test_a_patch_as_large_as_the_picture_has_one_place():
    picture = smooth()[:, :, :SIZE, :SIZE]
    found = find(picture, patches_at(picture[0], [(0, 0)], SIZE))
    assert found.places.tolist() == [[[0.0, 0.0]]]
    assert found.scores.item() == pytest.approx(1, abs=1e-4)
    assert found.margins.item() == pytest.approx(2, abs=1e-4)  # −1 elsewhere


def test_a_strip_is_searched_along_its_length():
    strip = smooth()[:, :, 10 : 10 + SIZE]
    found = find(strip, patches_at(strip[0], [(0, 20)], SIZE))
    assert found.places[0, 0].tolist() == pytest.approx([0, 20], abs=0.25)


def test_pictures_do_not_depend_on_those_beside_them():
    pictures = torch.cat([smooth(seed=seed) for seed in range(11)])
    patches = patches_at(pictures[3], CORNERS, SIZE)
    together = find(pictures, patches)
    for number in (0, 3, 10):
        alone = find(pictures[number : number + 1], patches)
        for all_of_them, one in zip(together, alone, strict=True):
            torch.testing.assert_close(all_of_them[number], one[0], atol=1e-5, rtol=0)


def test_contrast_is_the_norm_of_what_is_left_of_the_mean():
    picture = smooth()
    part = picture[0, :, 9 : 9 + SIZE, 20 : 20 + SIZE]
    expected = (part - part.mean(dim=(1, 2), keepdim=True)).norm()
    assert contrast(picture, SIZE)[0, 0, 9, 20].item() == pytest.approx(expected.item(), rel=1e-3)
