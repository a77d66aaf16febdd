"""What a camera tells after a few demonstrations: where the hand will be, and what is new."""

from __future__ import annotations

import copy
import functools
from pathlib import Path

import numpy as np
import pytest
import torch
from discs import FPS, HEIGHT, START, WIDTH, draw_disc, film, path_to, picture_of, places
from torch import Tensor

from pacnet.vision import ImageEncoder, ImageEncoderConfig
from pacnet.vision.cameras import pictures_of
from pacnet.vision.goals import SHARES, goals_of

TELLING = ("patches", "pca")
ENOUGH = {"patches": 5, "pca": 40}  # demonstrations


def config(kind: str, **fields: object) -> ImageEncoderConfig:
    """Settings for pictures of discs."""
    features = 768 if kind == "pca" else 0
    size = {"height": HEIGHT, "width": WIDTH, "outputs": 2 * len(SHARES), "features": features}
    return ImageEncoderConfig(kind, **{**size, **fields})


def show(encoder: ImageEncoder, disc: np.ndarray, number: int) -> None:
    path = path_to(disc)
    goals = torch.from_numpy(goals_of(path, FPS))
    encoder.add(*pictures_of(film(disc, path[:20], number), FPS), goals, number)


@functools.cache
def fitted(kind: str, count: int) -> ImageEncoder:
    """Do not change it: it is the same for all tests."""
    encoder = ImageEncoder(config(kind))
    for number, disc in enumerate(places(count, seed=0)):
        show(encoder, disc, number)
    encoder.fit()
    return encoder


def ends(encoder: ImageEncoder, discs: np.ndarray, change=lambda picture: picture) -> np.ndarray:
    """How far from each disc the hand is said to end [m]."""
    seen = [picture_of(disc, seed=900 + n) for n, disc in enumerate(discs)]
    looks = [encoder.look(torch.from_numpy(change(picture))) for picture in seen]
    told = np.stack([look.goals[-2:].numpy() for look in looks])
    return np.linalg.norm(told - discs, axis=1)


UNSEEN = places(20, seed=1)


@pytest.mark.parametrize("kind", TELLING)
def test_the_end_is_told_where_nothing_else_tells_it(kind: str):
    encoder = fitted(kind, ENOUGH[kind])
    shown = places(ENOUGH[kind], seed=0)
    alone = np.linalg.norm(UNSEEN - shown.mean(axis=0), axis=1).mean()
    error = ends(encoder, UNSEEN).mean()
    assert alone > 0.25
    assert error < (0.03 if kind == "patches" else 0.7 * alone)


@pytest.mark.parametrize("kind", TELLING)
def test_the_error_when_left_out_foretells_that_of_what_is_unseen(kind: str):
    encoder = fitted(kind, 12)
    assert encoder.told.chance <= 0.05
    looks = [encoder.look(torch.from_numpy(picture_of(disc, seed=5))) for disc in UNSEEN]
    goals = np.stack([goals_of(path_to(disc), FPS) for disc in UNSEEN])
    apart = (np.stack([look.goals.numpy() for look in looks]) - goals).reshape(20, len(SHARES), 2)
    error = np.linalg.norm(apart, axis=2).mean()
    assert encoder.told.error / 2 < error < 2 * encoder.told.error


@pytest.mark.parametrize(
    "change",
    [
        lambda picture: (0.8 * picture).astype(np.uint8),
        lambda picture: np.minimum(1.15 * picture, 255).astype(np.uint8),
        lambda picture: np.clip(
            picture + np.random.default_rng(3).normal(0, 10, picture.shape), 0, 255
        ).astype(np.uint8),
    ],
    ids=["darker", "brighter", "noisy"],
)
def test_patches_tell_the_same_in_another_light(change):
    assert ends(fitted("patches", 5), UNSEEN, change).mean() < 0.04


def test_a_patch_is_said_to_be_on_the_disc():
    encoder = fitted("patches", 12)
    for disc in UNSEEN[:5]:
        boxes = encoder.look(torch.from_numpy(picture_of(disc))).boxes
        assert 1 <= len(boxes) <= 3
        column = 6 + (WIDTH - 12) * disc[0]
        row = HEIGHT - 6 - (HEIGHT - 12) * disc[1]
        left, top, right, bottom = boxes[0]
        assert right - left == bottom - top == encoder.config.patch
        assert left - 3 <= column <= right + 3
        assert top - 3 <= row <= bottom + 3


def doubts(encoder: ImageEncoder, pictures: list[np.ndarray]) -> np.ndarray:
    return np.array([encoder.look(torch.from_numpy(picture)).doubt for picture in pictures])


@pytest.mark.parametrize("kind", TELLING)
def test_a_picture_without_the_disc_is_new_and_one_with_it_is_not(kind: str):
    encoder = fitted(kind, 20)
    absent = doubts(encoder, [picture_of(None, seed=seed) for seed in range(20)])
    there = doubts(encoder, [picture_of(disc, seed=7) for disc in UNSEEN])
    assert np.mean(there > 1) <= 0.05
    if kind == "patches":
        assert np.mean(absent > 1) >= 0.95


@pytest.mark.parametrize("kind", TELLING)
def test_another_room_is_new(kind: str):
    other = np.random.default_rng(0).integers(0, 255, (HEIGHT, WIDTH, 3), np.uint8)
    assert doubts(fitted(kind, 20), [other]).item() > 1


@pytest.mark.parametrize("kind", TELLING)
@pytest.mark.parametrize("level", [0, 128, 255])
def test_a_picture_without_contrast_is_new_and_tells_no_nonsense(kind: str, level: int):
    encoder = fitted(kind, 12)
    look = encoder.look(torch.full((HEIGHT, WIDTH, 3), level, dtype=torch.uint8))
    assert bool(look.goals.isfinite().all())
    assert np.isfinite(look.doubt)
    assert look.doubt > 1


@pytest.mark.parametrize("kind", TELLING)
def test_goals_stay_within_thrice_the_range_that_was_shown(kind: str):
    encoder = fitted(kind, 5)
    shown = encoder.shown.live("goals")
    low, high = shown.amin(dim=0), shown.amax(dim=0)
    for seed in range(5):
        noise = np.random.default_rng(seed).integers(0, 255, (HEIGHT, WIDTH, 3), np.uint8)
        goals = encoder.look(torch.from_numpy(noise)).goals
        assert bool((goals >= low - (high - low) - 1e-5).all())
        assert bool((goals <= high + (high - low) + 1e-5).all())


@pytest.mark.parametrize("kind", [*TELLING, "none"])
@pytest.mark.parametrize("count", [0, 1, 2])
def test_few_demonstrations_tell_their_mean_alone(kind: str, count: int):
    encoder = fitted(kind, count)
    expected = np.zeros(2 * len(SHARES), np.float32)
    if count:
        shown = [goals_of(path_to(disc), FPS) for disc in places(count, seed=0)]
        expected = np.mean(shown, axis=0)
    look = encoder.look(torch.from_numpy(picture_of(UNSEEN[0])))
    np.testing.assert_allclose(look.goals.numpy(), expected, rtol=1e-5, atol=1e-6)
    assert look.doubt == 0
    assert encoder.told.chance == 1
    assert encoder.told.error == encoder.told.alone


@pytest.mark.parametrize("kind", TELLING)
def test_demonstrations_at_one_place_are_no_error(kind: str):
    """The same pictures and goals each time: nothing is divided by nothing."""
    encoder, disc = ImageEncoder(config(kind)), np.array([0.5, 0.6])
    goals = torch.from_numpy(goals_of(path_to(disc), FPS))
    picture = torch.from_numpy(picture_of(disc))
    for number in range(4):
        encoder.add(picture, picture, goals, number)
    encoder.fit()
    look = encoder.look(picture)
    torch.testing.assert_close(look.goals, goals)
    assert look.doubt <= 1
    assert encoder.told.chance > 0.05


@pytest.mark.parametrize("kind", TELLING)
def test_more_demonstrations_tell_more(kind: str):
    errors = []
    encoder = ImageEncoder(config(kind))
    for number, disc in enumerate(places(24, seed=2)):
        show(encoder, disc, number)
        if number in (3, 23):
            encoder.fit()
            errors.append(ends(encoder, UNSEEN).mean())
    assert errors[1] < 0.75 * errors[0]
    assert encoder.shown.live("demonstration").tolist() == [*range(24)]


def test_hundreds_of_demonstrations_are_fitted_in_a_moment():
    """It fits to forty of them, from the first to the last."""
    encoder, picture = ImageEncoder(config("pca")), torch.from_numpy(picture_of(UNSEEN[0]))
    for number in range(300):
        encoder.add(picture + (number % 7), picture, torch.full((8,), float(number)), number)
    encoder.fit()
    assert encoder.readout.centre[0].item() == pytest.approx(149.5, abs=0.5)


def test_the_way_is_what_is_left_to_the_goals():
    encoder, hand = fitted("patches", 5), torch.tensor([0.4, 0.1])
    picture = torch.from_numpy(picture_of(UNSEEN[0]))
    way, doubt, boxes = encoder(picture, hand)
    look = encoder.look(picture)
    for goal in range(len(SHARES)):
        part = slice(2 * goal, 2 * goal + 2)
        torch.testing.assert_close(way[part] + hand, look.goals[part])
    assert (doubt, boxes) == (look.doubt, look.boxes)


# What it keeps


@pytest.mark.parametrize("kind", [*TELLING, "none"])
def test_a_state_goes_into_another(kind: str):
    encoder, twin = fitted(kind, 5), ImageEncoder(config(kind))
    twin.load_state_dict(encoder.state_dict())
    picture = torch.from_numpy(picture_of(UNSEEN[0]))
    for one, other in zip(encoder.look(picture), twin.look(picture), strict=True):
        assert torch.equal(one, other) if isinstance(one, Tensor) else one == other
    assert twin.told == encoder.told


def corrupted(encoder: ImageEncoder, name: str, value: float) -> dict[str, Tensor]:
    tensors = {key: tensor.clone() for key, tensor in encoder.state_dict().items()}
    tensors[name].view(-1)[0] = value
    return tensors


@pytest.mark.parametrize(
    ("kind", "name", "value"),
    [
        ("patches", "readout.centre", float("nan")),
        ("patches", "readout.lowest", float("inf")),
        ("patches", "readout.inputs.scale", 0.0),
        ("patches", "quality", -1.0),
        ("patches", "quality", float("inf")),
        ("patches", "readout.terms.weight", float("nan")),
        ("patches", "readout.terms.mean", float("inf")),
        ("patches", "shown.goals", float("nan")),
        ("patches", "shown.demonstration", 3),
        ("patches", "shown.demonstration", -1),
        ("patches", "seen.rows.patch", float("nan")),
        ("patches", "seen.rows.low", 1e9),
        ("patches", "seen.rows.high", float("inf")),
        ("patches", "seen.reference.rows.place", -1.0),
        ("patches", "seen.reference.rows.place", float("nan")),
        ("patches", "seen.reference.rows.place", HEIGHT - 10.0),
        ("patches", "seen.rows.worst", 0.0),
        ("pca", "seen.rows.component", float("nan")),
        ("pca", "seen.centre", float("inf")),
        ("pca", "seen.usual", 0.0),
    ],
)
def test_a_corrupted_state_is_refused_and_nothing_changes(kind: str, name: str, value: float):
    encoder = copy.deepcopy(fitted(kind, 5))
    before = encoder.state_dict()
    with pytest.raises(ValueError, match="expected"):
        encoder.load_state_dict(corrupted(encoder, name, value))
    for key, tensor in encoder.state_dict().items():
        assert torch.equal(tensor, before[key])


def test_what_is_remembered_alone_is_not_fitted_to():
    """Its picture on the way is gone: the fit needs both."""
    encoder = copy.deepcopy(fitted("patches", 5))
    size, look = bytes_of(encoder), encoder.look(torch.from_numpy(picture_of(UNSEEN[0])))
    encoder.keep(torch.arange(1, 5))
    assert encoder.shown.live("demonstration").tolist() == [1, 2, 3, 4]
    assert size - bytes_of(encoder) == 6 * 3 * HEIGHT * WIDTH + 8 * 4 + 2 * 8
    assert torch.equal(encoder.look(torch.from_numpy(picture_of(UNSEEN[0]))).goals, look.goals)
    with pytest.raises(ValueError, match="on the way of 4 demonstrations to fit to, got 0"):
        encoder.fit()


def bytes_of(encoder: ImageEncoder) -> int:
    return sum(tensor.numel() * tensor.element_size() for tensor in encoder.state_dict().values())


@pytest.mark.parametrize("rows", [1, 6])
def test_other_pictures_on_the_way_than_at_the_beginning_are_refused(rows: int):
    encoder = copy.deepcopy(fitted("patches", 5))
    later = torch.zeros(rows, HEIGHT, WIDTH, 3, dtype=torch.uint8)
    with pytest.raises(ValueError, match="as many pictures on the way"):
        encoder.load_state_dict({**encoder.state_dict(), "later.picture": later})


@pytest.mark.parametrize("places", [(-30.0, -20.0), (HEIGHT, HEIGHT + 9.0)])
def test_patches_that_are_looked_for_beside_the_picture_are_refused(places: tuple[float, float]):
    encoder = copy.deepcopy(fitted("patches", 5))
    tensors = encoder.state_dict()
    for name, value in zip(("low", "high"), places, strict=True):
        tensors = {**tensors, f"seen.rows.{name}": torch.full_like(tensors["seen.rows.low"], value)}
    with pytest.raises(ValueError, match="expected places in the picture"):
        encoder.load_state_dict(tensors)


@pytest.mark.parametrize("kind", TELLING)
def test_weights_of_other_features_than_are_seen_are_refused(kind: str):
    """A step would fail, or read past them."""
    encoder = copy.deepcopy(fitted(kind, 12))
    more = dict(encoder.state_dict())
    for name in ("inputs.mean", "inputs.scale", "terms.mean", "terms.weight"):
        more[f"readout.{name}"] = torch.cat([more[f"readout.{name}"]] * 8)
    with pytest.raises(ValueError, match=r"expected (inputs that are seen|terms of the features)"):
        encoder.load_state_dict(more)


@pytest.mark.parametrize("kind", TELLING)
def test_what_was_fitted_before_does_not_outlive_what_was_shown(kind: str):
    """Two demonstrations say where they went, not what an earlier fit makes of pictures."""
    encoder = copy.deepcopy(fitted(kind, 12))
    encoder.forget()
    for number, disc in enumerate(places(2, seed=8)):
        show(encoder, disc, number)
    encoder.fit()
    expected = np.mean([goals_of(path_to(disc), FPS) for disc in places(2, seed=8)], axis=0)
    look = encoder.look(torch.from_numpy(picture_of(UNSEEN[0])))
    np.testing.assert_allclose(look.goals.numpy(), expected, rtol=1e-5)


@pytest.mark.parametrize(
    ("fields", "name"),
    [
        ({"height": 0}, "height"),
        ({"width": 5000}, "width"),
        ({"patch": 1}, "patch"),
        ({"patch": HEIGHT}, "patch"),
        ({"outputs": 0}, "outputs"),
        ({"features": -1}, "features"),
        ({"digest": "abc"}, "digest"),
    ],
)
def test_settings_that_are_none_are_refused(fields: dict[str, object], name: str):
    with pytest.raises(ValueError, match=rf"expected ImageEncoderConfig\.{name}"):
        config("patches", **fields)


@pytest.mark.parametrize("kind", ["", "patch", "timm:", "http:x", 3, None])
def test_an_unknown_kind_is_refused(kind: object):
    with pytest.raises(ValueError, match="kind as patches, pca, none"):
        config(kind)  # pyright: ignore[reportArgumentType]


def test_safetensors_take_it(tmp_path: Path):
    from safetensors.torch import load_file, save_file

    encoder = fitted("patches", 5)
    save_file(encoder.state_dict(), tmp_path / "a.safetensors")
    twin = ImageEncoder(config("patches"))
    twin.load_state_dict(load_file(tmp_path / "a.safetensors"))
    assert twin.told == encoder.told


def test_a_hand_that_starts_elsewhere_is_not_attended_to():
    """Its own place tells nothing of where it goes: what rests does."""
    encoder = fitted("patches", 12)
    disc = UNSEEN[3]
    for apart in ((0.0, 0.0), (0.2, 0.1), (-0.3, 0.0)):
        hand = START + np.array(apart)
        look = encoder.look(torch.from_numpy(picture_of(disc, hand)))
        assert np.linalg.norm(look.goals[-2:].numpy() - disc) < 0.06


def test_what_moves_by_a_fraction_of_a_pixel_is_not_attended_to():
    """A mark's place, to a quarter of a pixel, foretells goals better than the disc's does."""
    generator = np.random.default_rng(4)
    goals = places(16, seed=4)
    discs = goals + generator.normal(0, 0.03, goals.shape)
    encoder = ImageEncoder(config("patches"))
    for number, (goal, disc) in enumerate(zip(goals, discs, strict=True)):
        seen = torch.from_numpy(marked(disc, 0.005 * goal, number))
        encoder.add(seen, seen, torch.from_numpy(goals_of(path_to(goal), FPS)), number)
    encoder.fit()
    for number, disc in enumerate(UNSEEN[:5]):
        look = encoder.look(torch.from_numpy(picture_of(disc, None, seed=number)))  # no mark
        assert look.doubt < 1
        assert np.linalg.norm(look.goals[-2:].numpy() - disc) < 0.08


def marked(disc: np.ndarray, by: np.ndarray, seed: int) -> np.ndarray:
    """A picture with a disc, and with a mark in the corner that is moved by a little."""
    picture = picture_of(disc, None, seed=seed).astype(np.float64)
    draw_disc(picture, np.array([0.02, 0.05]) + by, (255, 255, 255), 2.5)
    return picture.astype(np.uint8)
