"""An imitator that sees goes to discs at places that were not shown."""

from __future__ import annotations

import copy
import threading
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
import torch
from discs import (
    FASTEST,
    FPS,
    SIDE,
    START,
    TOP,
    demonstrations,
    picture_of,
    places,
    shown,
)
from safetensors.torch import load_file, save_file

from pacnet.datasets.demonstrations import Demonstrations
from pacnet.imitator import Imitator

POINTS = ["hand=observation.state[0:2]"]
NEAR = 0.05  # [m] from the disc
UNSEEN = places(20, seed=1)


def taught(seen: Demonstrations, encoder: str = "auto") -> Imitator:
    imitator = Imitator.from_demonstrations(seen, points=POINTS, encoder=encoder)
    imitator.learn(seen)
    return imitator


@pytest.fixture(scope="module")
def five() -> Demonstrations:
    return demonstrations(5, cameras=(SIDE, TOP))


@pytest.fixture(scope="module")
def trained(five: Demonstrations) -> Imitator:
    return taught(five)


class Went(NamedTuple):
    """How an episode went."""

    apart: float
    """Of the hand from the disc in the end [m]."""
    novel: int
    """Frames without an action because of novelty."""


def nothing(_frame: int, picture: np.ndarray) -> np.ndarray:
    return picture


def go(
    imitator: Imitator,
    disc: np.ndarray,
    change: Callable[[int, np.ndarray], np.ndarray] = nothing,
    frames: int = 60,
) -> Went:
    """Let it act; a picture may be changed before it is seen."""
    imitator.reset()
    hand, novel = START.copy(), 0
    for frame in range(frames):
        picture = change(frame, picture_of(disc, hand, seed=frame))
        seen = None if imitator.cameras is None else {TOP: picture}
        step = imitator.step(hand.astype(np.float32), seen)
        if step.action is None:
            novel += 1
            continue
        hand = hand + np.clip(step.action - hand, -FASTEST / FPS, FASTEST / FPS)
        if step.is_done:
            break
    return Went(float(np.linalg.norm(hand - disc)), novel)


def reached(episodes: list[Went]) -> float:
    return float(np.mean([one.apart < NEAR for one in episodes]))


def test_discs_at_unseen_places_are_reached(trained: Imitator):
    went = [go(trained, disc) for disc in UNSEEN]
    assert reached(went) >= 0.95
    assert np.mean([one.novel > 0 for one in went]) <= 0.05


@pytest.mark.filterwarnings("ignore:.*no landmark:UserWarning")
def test_without_a_camera_they_are_not(five: Demonstrations):
    blind = shown(*(replace(one, pictures={}) for one in five))
    imitator = Imitator.from_demonstrations(blind, points=None)
    imitator.learn(blind)
    assert imitator.cameras is None
    assert reached([go(imitator, disc) for disc in UNSEEN]) <= 0.2


def test_the_camera_that_sees_is_used_and_the_goals_are_named(trained: Imitator):
    assert trained.cameras is not None
    assert trained.cameras.features == (TOP,)
    assert [*trained.cameras.encoders] == [TOP]
    assert trained.percept_names[:2] == ("hand.x", "hand.y")
    assert "goal 100%.x" in trained.percept_names
    reports = {report.feature: report.helps for report in trained.camera_reports}
    assert reports == {TOP: True, SIDE: False}


def test_an_absent_disc_is_new_before_anything_is_done(trained: Imitator):
    for seed in range(10):
        trained.reset()
        picture = picture_of(None, seed=900 + seed)
        step = trained.step(START.astype(np.float32), {TOP: picture})
        assert step.is_novel
        assert step.action is None
        assert step.dimension == TOP


def test_one_bad_picture_changes_nothing(trained: Imitator):
    """The first one is black: it waits a moment, and looks again."""

    def spoil(frame: int, picture: np.ndarray) -> np.ndarray:
        return np.zeros_like(picture) if frame in (0, 5) else picture

    went = [go(trained, disc, spoil) for disc in UNSEEN]
    assert reached(went) >= 0.95
    assert min(one.novel for one in went) >= 1


def test_another_light_changes_nothing(trained: Imitator):
    went = [go(trained, disc, lambda _, seen: (0.8 * seen).astype(np.uint8)) for disc in UNSEEN]
    assert reached(went) >= 0.95


def test_a_larger_picture_is_reduced_alike():
    """Demonstrated and seen with 128 pixels, then with 256, each pixel four times."""
    seen = []
    for one in demonstrations(5):
        grown = one.pictures[TOP].repeat(2, axis=1).repeat(2, axis=2)
        seen.append(replace(one, pictures={TOP: grown}))
    imitator = taught(shown(*seen))

    def doubled(times: int) -> Callable[[int, np.ndarray], np.ndarray]:
        return lambda _, picture: picture.repeat(times, axis=0).repeat(times, axis=1)

    same = [go(imitator, disc, doubled(2)) for disc in UNSEEN[:5]]
    assert [go(imitator, disc, doubled(4)) for disc in UNSEEN[:5]] == same
    assert reached(same) == 1


def episode_of(imitator: Imitator, disc: np.ndarray) -> list[np.ndarray | None]:
    imitator.reset()
    hand = START.astype(np.float32)
    pictures = [{TOP: picture_of(disc, seed=seed)} for seed in range(5)]
    return [imitator.step(hand, seen).action for seen in pictures]


def assert_same_actions(imitator: Imitator, other: Imitator) -> None:
    for disc in UNSEEN[:3]:
        for one, same in zip(episode_of(imitator, disc), episode_of(other, disc), strict=True):
            np.testing.assert_array_equal(one, same)
            assert one is not None


def test_a_checkpoint_acts_the_same(trained: Imitator, tmp_path: Path):
    trained.save_pretrained(tmp_path)
    loaded = Imitator.from_pretrained(tmp_path)
    assert loaded.config == trained.config
    assert_same_actions(trained, loaded)
    for name, tensor in trained.state_dict().items():
        assert torch.equal(tensor, loaded.state_dict()[name]), name


@pytest.mark.parametrize(
    ("name", "value"),
    [("readout.centre", float("nan")), ("seen.rows.worst", 0.0), ("shown.demonstration", -1)],
)
def test_a_corrupted_checkpoint_is_refused(
    trained: Imitator, tmp_path: Path, name: str, value: float
):
    trained.save_pretrained(tmp_path)
    tensors = load_file(tmp_path / "model.safetensors")
    tensors[f"cameras.parts.0.{name}"].view(-1)[0] = value
    save_file(tensors, tmp_path / "model.safetensors")
    with (
        pytest.warns(UserWarning, match="no digest"),
        pytest.raises(ValueError, match=r"expected (finite|the tensors of an Imitator)"),
    ):
        Imitator.from_pretrained(tmp_path)


def test_cameras_that_tell_something_else_are_refused(trained: Imitator):
    config = trained.config
    assert config.cameras is not None
    other = replace(config.cameras, hand=("x", "z"))
    percepts = {name: config.percepts[name] for name in reversed(config.percepts)}
    changes = {"cameras": other}, {"percepts": percepts}, {"cameras": "top"}, {"frames": None}
    for change in changes:
        with pytest.raises(ValueError, match=r"expected ImitatorConfig\.(cameras|state)"):
            replace(config, **change)


@pytest.mark.parametrize("copied", [Imitator.fork, copy.deepcopy], ids=["fork", "deepcopy"])
def test_what_a_copy_learns_is_its_own(trained: Imitator, copied: Callable[[Imitator], Imitator]):
    before = {name: tensor.clone() for name, tensor in trained.state_dict().items()}
    other = copied(trained)
    assert_same_actions(trained, other)
    other.learn(demonstrations(3, seed=5))
    for name, tensor in trained.state_dict().items():
        assert torch.equal(tensor, before[name]), name
    assert other.cameras is not None
    assert len(other.cameras.encoders[TOP].shown) == 8


def test_nothing_is_learned_in_eval_mode(trained: Imitator):
    twin = copy.deepcopy(trained).eval()
    assert twin.learn(demonstrations(2, seed=5)) == []
    for name, tensor in twin.state_dict().items():
        assert torch.equal(tensor, trained.state_dict()[name]), name


def test_more_demonstrations_are_kept_and_what_was_fitted_stays(trained: Imitator):
    """Goals of all demonstrations are told by one fit; a new one is `from_demonstrations`."""
    imitator = trained.fork()
    assert imitator.cameras is not None
    assert trained.cameras is not None
    encoder, before = imitator.cameras.encoders[TOP], trained.cameras.encoders[TOP]
    imitator.learn(demonstrations(6, seed=3))
    assert len(imitator.reports) == 11
    assert encoder.shown.live("demonstration").tolist() == [*range(11)]
    assert len(encoder.later) == 0  # what it was fitted to is no longer needed
    picture = torch.from_numpy(picture_of(UNSEEN[0]))
    assert torch.equal(encoder.look(picture).goals, before.look(picture).goals)
    assert reached([go(imitator, disc) for disc in UNSEEN]) >= 0.95


def test_learning_one_after_the_other_ends_where_learning_all_does(five: Demonstrations):
    together, apart = taught(five), Imitator.from_demonstrations(five, points=POINTS)
    for one in five:
        apart.learn(shown(one))
    for name, tensor in together.state_dict().items():
        if name.startswith("cameras."):
            assert torch.equal(tensor, apart.state_dict()[name]), name
    assert reached([go(apart, disc) for disc in UNSEEN[:8]]) == 1


def test_it_acts_while_another_thread_learns(trained: Imitator):
    imitator, problems, stop = trained.fork(), [], threading.Event()

    def learn() -> None:
        try:
            for seed in range(3):
                imitator.learn(demonstrations(2, seed=20 + seed))
        except Exception as error:
            problems.append(error)
        stop.set()

    thread = threading.Thread(target=learn)
    thread.start()
    steps = 0
    while not stop.is_set():
        actions = episode_of(imitator, UNSEEN[steps % len(UNSEEN)])
        assert all(action is None or np.isfinite(action).all() for action in actions)
        steps += 1
    thread.join()
    assert problems == []
    assert steps > 0
    assert imitator.cameras is not None
    assert len(imitator.cameras.encoders[TOP].shown) == 5 + 6
    imitator.check_state(imitator.state_dict())


def test_mixed_precision_of_a_caller_changes_nothing(trained: Imitator):
    plain = episode_of(trained, UNSEEN[2])
    with torch.autocast("cpu", dtype=torch.bfloat16), torch.inference_mode():
        mixed = episode_of(trained, UNSEEN[2])
    for one, other in zip(plain, mixed, strict=True):
        np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize(
    ("pictures", "message"),
    [
        (None, "expected pictures of observation.images.top, got none"),
        ({}, "expected a picture of 'observation.images.top', got none"),
        ({SIDE: np.zeros((48, 64, 3), np.uint8)}, "got observation.images.side"),
        ({TOP: np.zeros((48, 64), np.uint8)}, "uint8 .height, width, 3., got uint8 .48, 64"),
        ({TOP: np.zeros((48, 64, 3), np.float32)}, "got float32"),
        ({TOP: np.zeros((64, 48, 3), np.uint8)}, "64 x 48 pixels when reduced, got 48 x 64"),
        ({TOP: np.zeros((0, 48, 3), np.uint8)}, "got uint8 .0, 48, 3"),
        ({TOP: torch.zeros(48, 64, 3, dtype=torch.uint8)}, "got Tensor"),
        ([np.zeros((48, 64, 3), np.uint8)], "got list"),
    ],
)
def test_what_is_no_picture_of_the_camera_is_refused(
    trained: Imitator, pictures: object, message: str
):
    trained.reset()
    with pytest.raises(ValueError, match=message):
        trained.step(START.astype(np.float32), pictures)  # pyright: ignore[reportArgumentType]
    assert go(trained, UNSEEN[0]).apart < NEAR


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"state": torch.empty(0, 2)}, "expected state .* got an empty one"),
        ({"state": torch.zeros(9, 1)}, "expected state .*rows, 2. .*got shape .9, 1."),
        ({"pictures": {TOP: np.zeros((3, 48, 64, 3), np.uint8)}}, "got uint8 .3, 48, 64, 3."),
        ({"pictures": {TOP: np.zeros((60, 48, 64), np.uint8)}}, "got uint8 .60, 48, 64."),
        ({"pictures": {TOP: np.zeros((60, 48, 64, 3), np.float32)}}, "got float32"),
        ({"pictures": {TOP: None}}, "expected pictures of 'observation.images.top' as uint8"),
    ],
)
def test_demonstrations_that_do_not_fit_are_refused_by_name(
    trained: Imitator, change: dict, message: str
):
    other = trained.fork()
    wrong = replace(demonstrations(1, seed=9).episodes[0], **change)
    with pytest.raises(ValueError, match=f"episode 0: .*{message}"):
        other.learn(shown(wrong))
    assert len(other.reports) == 5


def test_demonstrations_without_pictures_are_no_harm_or_refused_by_name(trained: Imitator):
    """Whole ones say where the hand will be; those that begin in the middle need pictures."""
    other, bare = trained.fork(), [replace(one, pictures={}) for one in demonstrations(2, seed=9)]
    other.learn(shown(*bare))
    assert other.cameras is not None
    assert len(other.cameras.encoders[TOP].shown) == 5
    middle = bare[0].part(4, len(bare[0].state))
    with pytest.raises(ValueError, match="episode 0: expected a picture of"):
        other.learn(shown(middle))
    assert len(other.reports) == 7


@pytest.mark.parametrize(
    "change",
    [
        lambda pictures: pictures[..., 0],
        lambda pictures: pictures[:0],
        lambda pictures: pictures[:-1],
        lambda pictures: pictures.astype(np.float32) / 255,
        lambda pictures: pictures.astype(np.uint16) * 257,
    ],
    ids=["grey", "none", "one too few", "float", "16 bits"],
)
def test_settings_are_not_chosen_from_what_are_no_pictures(
    five: Demonstrations, change: Callable[[np.ndarray], np.ndarray]
):
    first, *others = five.episodes
    pictures = {TOP: change(first.pictures[TOP])}
    strange = replace(five, episodes=(replace(first, pictures=pictures), *others))
    frames = len(first.state)
    with pytest.raises(ValueError, match=rf"episode 0: .*{TOP}.*uint8 \[{frames}, height, width"):
        Imitator.from_demonstrations(strange, points=POINTS)


def test_what_was_interrupted_in_a_first_episode_with_a_gap_can_be_saved(
    five: Demonstrations, tmp_path: Path
):
    """Its first part is learned, so its beginning is not remembered as that of a whole."""
    first, *others = five.episodes
    torn = replace(five, episodes=(replace(first, gaps=(8,)), *others))
    imitator = Imitator.from_demonstrations(torn, points=POINTS)

    def interrupt(_: int) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        imitator.learn(torn, interrupt)
    assert len(imitator.reports) == 1
    imitator.learn(shown(*others))
    imitator.save_pretrained(tmp_path)
    cameras = Imitator.from_pretrained(tmp_path).cameras
    assert cameras is not None
    (encoder,) = cameras.encoders.values()
    assert encoder.shown.live("demonstration").tolist() == [1, 2, 3, 4]


def test_a_checkpoint_with_pictures_of_unknown_demonstrations_is_refused(
    trained: Imitator, tmp_path: Path
):
    trained.save_pretrained(tmp_path)
    tensors = load_file(tmp_path / "model.safetensors")
    name = next(name for name in tensors if name.endswith("shown.demonstration"))
    tensors[name] = tensors[name] + 1000
    save_file(tensors, tmp_path / "model.safetensors")
    damaged = pytest.warns(UserWarning, match="digest")
    with damaged, pytest.raises(ValueError, match="pictures of the 5 demonstrations"):
        Imitator.from_pretrained(tmp_path)


def test_while_it_holds_for_another_reason_it_goes_on_looking(trained: Imitator):
    """The hand is where it never was: nothing is done, so it does not come nearer either."""
    trained.reset()
    disc, elsewhere = UNSEEN[0], np.float32([30.0, 30.0])
    for frame in range(60):
        step = trained.step(elsewhere, {TOP: picture_of(disc, seed=frame)})
        assert step.action is None
    assert trained.is_looking
