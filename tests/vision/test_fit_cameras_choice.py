"""Which cameras help, and what looks at their pictures."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from discs import (
    FPS,
    HEIGHT,
    SIDE,
    TOP,
    WIDTH,
    demonstrate,
    demonstrations,
    hands_of,
    path_to,
    picture_of,
    places,
    shown,
)

from pacnet.datasets.demonstrations import Demonstration, Demonstrations
from pacnet.vision import Cameras
from pacnet.vision.fitting import CameraReport, fit_cameras

HAND = ("x", "y")
DRAWS = 10


def fitted(
    seen: Demonstrations, encoder: str = "auto"
) -> tuple[Cameras | None, dict[str, CameraReport]]:
    cameras, reports = fit_cameras(seen, hands_of(seen), HAND, encoder)
    return cameras, {report.feature: report for report in reports}


def with_pictures(disc: np.ndarray, number: int, pictures: np.ndarray) -> Demonstration:
    """A demonstration in which one picture is seen all the time."""
    frames = len(path_to(disc))
    still = np.broadcast_to(pictures, (frames, *pictures.shape))
    return replace(demonstrate(disc, number, cameras=()), pictures={TOP: still})


def test_a_camera_that_sees_helps_and_a_blind_one_does_not():
    cameras, reports = fitted(demonstrations(5, cameras=(SIDE, TOP)))
    assert cameras is not None
    assert cameras.features == (TOP,)
    assert reports[TOP].kind == "patches"
    assert reports[TOP].helps
    assert reports[TOP].told.error < 0.2 * reports[TOP].told.alone
    assert not reports[SIDE].helps
    assert reports[SIDE].kind == "none"


def noise(seed: int) -> np.ndarray:
    """Blots that are elsewhere in each picture."""
    generator = torch.Generator().manual_seed(seed)
    coarse = torch.rand(1, 3, HEIGHT // 4, WIDTH // 4, generator=generator)
    big = torch.nn.functional.interpolate(coarse, (HEIGHT, WIDTH), mode="bilinear")
    return (255 * big[0]).byte().permute(1, 2, 0).numpy()


@pytest.mark.parametrize("count", [5, pytest.param(12, marks=pytest.mark.slow)])
def test_pictures_that_tell_nothing_are_said_not_to_help(count: int):
    """At most one draw in ten may look as if they did."""
    helps = 0
    for seed in range(DRAWS):
        discs = places(count, seed=500 + seed)
        episodes = [
            with_pictures(disc, number, noise(100 * seed + number))
            for number, disc in enumerate(discs)
        ]
        cameras, _ = fitted(shown(*episodes))
        helps += cameras is not None
    assert helps <= DRAWS / 10


@pytest.mark.parametrize("count", [5, pytest.param(12, marks=pytest.mark.slow)])
def test_a_disc_that_moves_is_said_to_help(count: int):
    helps = 0
    for seed in range(DRAWS):
        discs = enumerate(places(count, seed=500 + seed))
        episodes = [with_pictures(disc, n, picture_of(disc, seed=n)) for n, disc in discs]
        cameras, _ = fitted(shown(*episodes))
        helps += cameras is not None
    assert helps >= 0.9 * DRAWS


@pytest.mark.parametrize("count", [1, 2])
def test_too_few_demonstrations_to_tell(count: int):
    cameras, reports = fitted(demonstrations(count))
    assert cameras is None
    assert reports[TOP].told.chance == 1


@pytest.mark.parametrize("kind", ["patches", "pca"])
def test_a_kind_that_is_asked_for_is_taken(kind: str):
    cameras, reports = fitted(demonstrations(5), kind)
    assert cameras is not None
    assert [encoder.config.kind for encoder in cameras.encoders.values()] == [kind]
    assert reports[TOP].kind == kind


def test_no_camera_on_request():
    cameras, reports = fitted(demonstrations(5), "none")
    assert cameras is None
    assert not reports[TOP].helps


def test_an_unknown_kind_is_refused():
    with pytest.raises(ValueError, match="expected an encoder out of auto, patches, pca"):
        fitted(demonstrations(3), "eyes")


def test_a_camera_that_some_episodes_lack_is_left_out():
    seen = demonstrations(5)
    lacking = replace(seen.episodes[2], pictures={})
    cameras, reports = fitted(shown(*seen.episodes[:2], lacking, *seen.episodes[3:]))
    assert cameras is None
    assert TOP not in reports


def test_a_camera_of_several_sizes_is_left_out():
    seen = demonstrations(5)
    first = seen.episodes[0]
    cut = replace(first, pictures={TOP: first.pictures[TOP][:, :-2]})
    cameras, reports = fitted(shown(cut, *seen.episodes[1:]))
    assert cameras is None
    assert TOP not in reports


def test_episodes_that_begin_in_the_middle_are_not_fitted_to():
    seen = demonstrations(6)
    parts = [one.part(5, len(one.state)) for one in seen.episodes[3:]]
    cameras, _ = fitted(shown(*seen.episodes[:3], *parts))
    three, _ = fitted(shown(*seen.episodes[:3]), "patches")
    assert three is not None
    if cameras is not None:
        assert len(cameras.encoders[TOP].shown) == 3
    assert fitted(shown(*parts))[0] is None


@pytest.mark.parametrize("size", [(1, 1), (2, 8), (4, 4), (7, 40)])
@pytest.mark.parametrize("kind", ["auto", "patches", "pca"])
def test_a_camera_of_tiny_pictures_is_left_out(size: tuple[int, int], kind: str):
    generator = np.random.default_rng(0)
    episodes = [
        with_pictures(disc, number, generator.integers(0, 255, (*size, 3), np.uint8))
        for number, disc in enumerate(places(5, seed=0))
    ]
    cameras, reports = fitted(shown(*episodes), kind)
    assert cameras is None
    assert TOP not in reports


def test_pictures_that_are_not_reduced_are_refused():
    """Those it acts on are, so that it would never find anything."""
    pictures = np.zeros((96, 129, 3), np.uint8)
    wide = shown(*(with_pictures(disc, n, pictures) for n, disc in enumerate(places(5, seed=0))))
    with pytest.raises(ValueError, match=r"up to 128 pixels, .*got 129 x 96"):
        fitted(wide, "auto")


@pytest.mark.parametrize("size", [(8, 8), (9, 40), (8, 128)])
@pytest.mark.parametrize("kind", ["patches", "pca"])
def test_small_pictures_are_no_error(size: tuple[int, int], kind: str):
    generator = np.random.default_rng(0)
    pictures = generator.integers(0, 255, (6, *size, 3), np.uint8)
    discs = enumerate(places(5, seed=0))
    cameras, _ = fitted(shown(*(with_pictures(disc, n, pictures[n]) for n, disc in discs)), kind)
    assert cameras is not None
    assert bool(cameras.encoders[TOP].look(torch.from_numpy(pictures[5])).goals.isfinite().all())


def test_grey_pictures_tell_as_well():
    """All three colours the same, as of a camera that sees none."""
    episodes = []
    for one in demonstrations(5):
        red = one.pictures[TOP][..., :1]
        episodes.append(replace(one, pictures={TOP: np.repeat(red, 3, axis=3)}))
    cameras, _ = fitted(shown(*episodes))
    assert cameras is not None


def test_looking_ends_before_the_hand_hides_the_disc():
    seen = demonstrations(8)
    cameras, _ = fitted(seen)
    assert cameras is not None
    shortest = min(len(one.state) for one in seen) - FPS // 2  # it rests on the disc
    assert 2 <= cameras.config.until < shortest


def test_it_is_the_same_each_time():
    first, _ = fitted(demonstrations(5))
    torch.rand(1)
    second, _ = fitted(demonstrations(5))
    assert first is not None
    assert second is not None
    assert first.config == second.config
    for name, tensor in first.state_dict().items():
        assert torch.equal(tensor, second.state_dict()[name])
