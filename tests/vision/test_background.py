"""Taking the background away leaves what differs, in another light and from a camera nudged."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from discs import HEIGHT, WIDTH, draw_disc, places, table

from pacnet.vision import ImageEncoder, ImageEncoderConfig
from pacnet.vision.background import Background
from pacnet.vision.correlation import as_tensor

THING = (120, 100, 70)  # hardly another colour than the table


def picture_of(place, seed: int) -> torch.Tensor:
    """A small dull thing on the table between bright bars, uint8 `[H, W, 3]`."""
    picture = table().astype(np.float64)
    picture[:, ::16] = 255
    draw_disc(picture, place, THING, radius=2.0)
    grain = np.random.default_rng(seed).normal(0, 2, picture.shape)
    return torch.from_numpy(np.clip(picture + grain, 0, 255).astype(np.uint8))


def background(count: int = 9) -> Background:
    found = Background(HEIGHT, WIDTH)
    found.fit(as_tensor(torch.stack([picture_of(p, n) for n, p in enumerate(places(count, 0))])))
    return found


def left(found: Background, picture: torch.Tensor, shift: torch.Tensor | None = None) -> np.ndarray:
    """What is left of a picture, `[H, W]`, of 255."""
    return 255 * found.taken_from(as_tensor(picture[None]), shift)[0].norm(dim=0).numpy()


@pytest.mark.parametrize("light", [1.0, 0.7, 1.3])
def test_what_differs_is_left_in_any_light(light: float):
    place = np.array([0.5, 0.5])
    picture = table().astype(np.float64)
    draw_disc(picture, place, (200, 40, 40))
    shown = torch.from_numpy(np.clip(light * picture, 0, 255).astype(np.uint8))
    found = Background(HEIGHT, WIDTH)
    found.fit(as_tensor(torch.from_numpy(table().astype(np.uint8))[None]))
    rest = left(found, shown)
    inside = rest > 40
    assert 30 < inside.sum() < 60  # a disc with a radius of 3.5 pixels has 38
    assert np.median(rest[~inside]) < 3
    rows, columns = inside.nonzero()
    assert (rows.mean(), columns.mean()) == pytest.approx((24, 32), abs=0.5)


@pytest.mark.parametrize("shift", [(2, 0), (0, -3), (1.5, 1.0)])
def test_it_moves_with_the_camera(shift: tuple[float, float]):
    """A smooth ground of which every pixel is known, also between pixels."""

    def ground(down: float, right: float) -> torch.Tensor:
        rows, columns = np.mgrid[:HEIGHT, :WIDTH].astype(np.float64)
        waves = 128 + 60 * np.sin((rows - down) / 5) + 60 * np.cos((columns - right) / 7)
        return torch.from_numpy(waves.astype(np.uint8)).unsqueeze(2).expand(-1, -1, 3)

    found = Background(HEIGHT, WIDTH)
    found.fit(as_tensor(ground(0, 0)[None]))
    inner = slice(4, -4)
    rest = left(found, ground(*shift), torch.tensor(shift))[inner, inner]
    assert rest.max() < 6
    assert left(found, ground(*shift))[inner, inner].max() > 20


def test_pictures_that_are_dark_are_left_as_they_are():
    found = Background(HEIGHT, WIDTH)
    dark = torch.zeros(HEIGHT, WIDTH, 3, dtype=torch.uint8)
    found.fit(as_tensor(dark[None]))
    assert left(found, dark).max() == 0


def told(encoder: ImageEncoder, count: int = 20) -> float:
    """The median error of the end at places that were not shown."""
    apart = []
    for number, place in enumerate(places(count, 7)):
        goals = encoder.look(picture_of(place, 1000 + number)).goals.reshape(4, 2)
        apart.append(np.linalg.norm(goals[-1].numpy() - place))
    return float(np.median(apart))


def test_a_small_dull_thing_between_bright_ones_is_found():
    """In pictures as they are, the bright bars are all that a patch is alike to."""
    encoder = ImageEncoder(ImageEncoderConfig("patches", HEIGHT, WIDTH, 8, patch=5))
    for number, place in enumerate(places(15, 3)):
        picture = picture_of(place, number)
        goals = torch.from_numpy(np.linspace([0.5, 0.05], place, 5)[1:]).float().flatten()
        encoder.add(picture, picture, goals, number)
    encoder.fit()
    assert encoder.seen is not None
    assert encoder.seen.rows.live("stands_out").any()  # pyright: ignore[reportAttributeAccessIssue]
    assert told(encoder) < 0.04
