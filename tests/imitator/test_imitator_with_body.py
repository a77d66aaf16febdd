"""An imitator keeps its body: checkpoints, copies and forks of it act alike; damage is refused."""

from __future__ import annotations

import math
from copy import deepcopy
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from lifting import CUP, FPS, JOINTS, NAMES, STATE, SURROUNDINGS, arm, hand_of, lift, lifts
from numpy.typing import NDArray
from reaching import assert_same
from torch import Tensor

from pacnet.core.checkpoint import read_checkpoint, write_checkpoint
from pacnet.datasets.demonstrations import Demonstrations
from pacnet.datasets.format import DatasetWarning
from pacnet.forward_models.config import KinematicModelConfig
from pacnet.forward_models.kinematics import KinematicModel
from pacnet.imitator import Imitator, ImitatorStep

FIRST, SECOND, NEW = (0.35, 0.1, 0.02), (0.3, 0.0, 0.02), (0.33, 0.06, 0.02)
BODY = "frames.body."


def taught(*places: tuple[float, ...]) -> Imitator:
    demonstrations = lifts(*places)
    imitator = Imitator.from_demonstrations(demonstrations, points=[CUP], body=arm())
    imitator.learn(demonstrations)
    return imitator


@pytest.fixture(scope="module")
def lifter() -> Imitator:
    return taught(FIRST, SECOND)


def steps_of(imitator: Imitator, frames: slice = slice(None)) -> list[ImitatorStep]:
    """What it does at an episode that was not shown."""
    return [imitator.step(percept) for percept in lift(7, NEW).percepts[frames]]


def acted(steps: list[ImitatorStep]) -> list[tuple[bytes, float, str | None, int | None]]:
    """All that decides, to the bit."""
    return [
        (b"" if step.action is None else step.action.tobytes(), step.novelty, step.landmark,
         step.segment)
        for step in steps
    ]  # fmt: skip


def begun(imitator: Imitator) -> Imitator:
    imitator.reset()
    return imitator


def test_a_loaded_one_acts_and_learns_like_the_saved_one(lifter: Imitator, tmp_path: Path):
    lifter.save_pretrained(tmp_path)
    loaded = Imitator.from_pretrained(tmp_path)
    assert loaded.config == lifter.config
    assert_same(loaded, lifter)
    expected = acted(steps_of(begun(lifter)))
    assert any(action for action, *_ in expected)
    assert acted(steps_of(begun(loaded))) == expected
    both = deepcopy(lifter), loaded
    for imitator in both:
        imitator.learn(lifts((0.38, 0.05, 0.02), seed=3))
    assert_same(*both)
    first, second = (acted(steps_of(begun(imitator))) for imitator in both)
    assert first == second


def test_angles_take_the_hand_to_where_the_cup_is(lifter: Imitator):
    for place in (FIRST, NEW):
        shown = lift(9, place)
        lifter.reset()
        steps = [lifter.step(percept) for percept in shown.percepts[:40]]
        last = [step for step in steps if step.segment == 0][-1]
        assert last.target is not None
        hand, _ = hand_of(last.target.astype(np.float64))
        assert hand == pytest.approx(np.array(place), abs=0.01)


def test_copies_begin_and_go_on_alike(lifter: Imitator):
    expected = acted(steps_of(begun(lifter)))
    begun(lifter)
    half = acted(steps_of(lifter, slice(0, 50)))
    for copied in (deepcopy(lifter), lifter.fork()):
        assert acted(steps_of(begun(copied))) == expected
        assert copied.frames is not None
        assert copied.frames.has_body(arm())
    assert half + acted(steps_of(lifter, slice(50, None))) == expected


def test_what_a_fork_learns_is_its_own(lifter: Imitator):
    fork, before = lifter.fork(), acted(steps_of(begun(lifter)))
    fork.learn(lifts(NEW, seed=4))
    assert acted(steps_of(begun(lifter))) == before
    assert acted(steps_of(begun(fork))) != before


def test_it_learns_one_demonstration_after_the_other():
    later, shown = taught(FIRST), lifts(FIRST, SECOND)
    later.learn(replace(shown, episodes=shown.episodes[1:]))
    # The settings are of the first demonstrations, so the whole is compared with its settings.
    whole = Imitator(later.config)
    assert whole.frames is not None
    whole.frames.take_body(arm())
    whole.learn(shown)
    assert acted(steps_of(begun(later))) == acted(steps_of(begun(whole)))


def test_a_state_is_loaded_with_the_body(lifter: Imitator):
    empty = Imitator(lifter.config)
    assert empty.frames is not None
    assert not empty.frames.has_body(arm())
    empty.load_state_dict(lifter.state_dict())
    empty.reports = [*lifter.reports]
    assert empty.frames.has_body(arm())
    assert acted(steps_of(begun(empty))) == acted(steps_of(begun(lifter)))


def test_the_body_is_copied():
    model = deepcopy(arm())
    demonstrations = lifts(FIRST)
    imitator = Imitator.from_demonstrations(demonstrations, points=[CUP], body=model)
    model.coefficients.zero_()
    assert imitator.frames is not None
    assert imitator.frames.has_body(arm())
    assert not imitator.frames.has_body(model)


def _infinite(tensors: dict[str, Tensor]) -> None:
    tensors[f"{BODY}coefficients"][0, 0] = math.inf


def _huge(tensors: dict[str, Tensor]) -> None:
    tensors[f"{BODY}coefficients"][0, 0] = 1e200  # its square is not finite


def _short(tensors: dict[str, Tensor]) -> None:
    tensors[f"{BODY}coefficients"] = tensors[f"{BODY}coefficients"][:-1]


def _missing(tensors: dict[str, Tensor]) -> None:
    del tensors[f"{BODY}lowest"]


def _all_missing(tensors: dict[str, Tensor]) -> None:
    for name in [name for name in tensors if name.startswith(BODY)]:
        del tensors[name]


def _extra(tensors: dict[str, Tensor]) -> None:
    tensors[f"{BODY}weight"] = torch.zeros(3, dtype=torch.float64)


def _crossed(tensors: dict[str, Tensor]) -> None:
    low, high = (tensors[f"{BODY}{end}"] for end in ("lowest", "highest"))
    tensors[f"{BODY}lowest"], tensors[f"{BODY}highest"] = high, low


def _integers(tensors: dict[str, Tensor]) -> None:
    tensors[f"{BODY}coefficients"] = tensors[f"{BODY}coefficients"].long()


DAMAGES = (_infinite, _huge, _short, _missing, _all_missing, _extra, _crossed, _integers)


@pytest.mark.parametrize("damage", DAMAGES)
def test_damaged_tensors_of_the_body_are_refused(damage, lifter: Imitator, tmp_path: Path):
    lifter.save_pretrained(tmp_path)
    fields, tensors = read_checkpoint(tmp_path)
    damage(tensors)
    write_checkpoint(tmp_path, fields, tensors)
    with pytest.raises(ValueError, match="expected"):
        Imitator.from_pretrained(tmp_path)
    state = {name: one.clone() for name, one in lifter.state_dict().items()}
    damage(state)
    other = deepcopy(lifter)
    with pytest.raises(ValueError, match="expected"):
        other.load_state_dict(state)
    assert_same(other, lifter)  # nothing of it was loaded


def test_a_damaged_body_is_not_saved(lifter: Imitator, tmp_path: Path):
    other = deepcopy(lifter)
    assert other.frames is not None
    assert other.frames.body is not None
    other.frames.body.coefficients[0, 0] = math.nan
    with pytest.raises(ValueError, match="finite"):
        other.save_pretrained(tmp_path / "out")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    "change",
    [
        {"angles": [0, 1, 2]},
        {"angles": [0, 1, 2, 99]},
        {"commands": [0, 0, 1, 2]},
        {"commands": [0, 1, 2, 4]},
        {"commands": [0, 1, 2, -1]},
        {"model": {"joints": ["turn", "shoulder"], "moving": [0, 1]}},
        {"model": {"joints": [*JOINTS], "moving": [0, 1]}},
        {"model": {"joints": [*JOINTS], "moving": [9]}},
        {"model": None},
    ],
)
def test_a_config_of_another_body_is_refused(change: dict, lifter: Imitator, tmp_path: Path):
    lifter.save_pretrained(tmp_path)
    fields, tensors = read_checkpoint(tmp_path)
    fields["frames"]["body"] |= change
    write_checkpoint(tmp_path, fields, tensors)
    with pytest.raises(ValueError, match="expected"):
        Imitator.from_pretrained(tmp_path)


@pytest.mark.parametrize(
    ("point", "change"),
    [
        (0, {"place": [0, 1, 2]}),  # the hand is where the body says
        (0, {"orientation": []}),
        (2, {"orientation": [0, 1, 2]}),  # where the cup stood has no orientation
        (2, {"place": [19, 18, 17]}),
        (1, {"place": [4, 5, 20]}),  # not perceived
    ],
)
def test_a_config_of_points_that_a_percept_does_not_imply_is_refused(
    point: int, change: dict, lifter: Imitator, tmp_path: Path
):
    lifter.save_pretrained(tmp_path)
    fields, tensors = read_checkpoint(tmp_path)
    points = fields["frames"]["points"]
    [points["moved"], *points["landmarks"]][point].update(change)
    write_checkpoint(tmp_path, fields, tensors)
    with pytest.raises(ValueError, match="expected"):
        Imitator.from_pretrained(tmp_path)


def refused(message: str, demonstrations: Demonstrations, **options: object) -> None:
    with pytest.raises(ValueError, match=message):
        Imitator.from_demonstrations(demonstrations, **{"body": arm(), **options})


def test_what_is_no_body_here_is_refused():
    shown = lifts(FIRST)
    refused("expected a KinematicModel as the body, got str", shown, body="arm")
    refused("within 0.00 to 0.00 rad", shown, body=KinematicModel(arm().config))  # not fitted
    leg = KinematicModel(KinematicModelConfig(("turn", "knee"), (0, 1)))
    refused("percepts with an angle of each of the 2 joints .* none of 'knee'", shown, body=leg)
    twice = {**NAMES, STATE: ("turn.pos", "shoulder.pos", "turn", "elbow.pos")}
    refused("got 2 of 'turn'", replace(shown, names=twice))
    motors = {**NAMES, "action": ("turn", "shoulder", "neck", "motor")}
    refused("expected actions with an angle .* none of 'elbow'", replace(shown, names=motors))


def test_targets_and_landmarks_are_checked():
    shown = lifts(FIRST)
    refused("expected a body with targets of 'action', got .* 'state'", shown, targets="state")
    refused("a landmark beside the body's hand", shown, points=None)
    refused("3 dimensions beside a body's hand, .* got none", shown, points=[])
    refused("landmarks alone beside a body, got 'hand'", shown, points=["hand=" + CUP[4:]])
    unnamed = {**NAMES, SURROUNDINGS: tuple("012345")}
    refused("a landmark beside the body's hand", replace(shown, names=unnamed))


def with_more(more: NDArray[np.float32], names: tuple[str, ...]) -> Demonstrations:
    """A demonstration with more surroundings, `[T, N]`."""
    one = lift(0, FIRST)
    around = torch.cat([one.environment_state, torch.from_numpy(more)], dim=1)
    shown = replace(one, environment_state=around)
    return Demonstrations(FPS, {**NAMES, SURROUNDINGS: NAMES[SURROUNDINGS] + names}, (shown,), "x")


def test_found_landmarks_that_are_not_there_are_left_out():
    frames = len(lift().state)
    padded = with_more(np.zeros((frames, 3), np.float32), ("lid.x", "lid.y", "lid.z"))
    imitator = Imitator.from_demonstrations(padded, body=arm())
    assert imitator.config.points is not None
    assert imitator.config.points.names == ("hand", "cup", "cup's place")
    twice = lift(0, FIRST).environment_state[:, :3].numpy()
    same = with_more(twice, ("lid.x", "lid.y", "lid.z"))
    with pytest.warns(DatasetWarning, match="'lid' to be another place than 'cup'"):
        imitator = Imitator.from_demonstrations(same, body=arm())
    assert imitator.config.points is not None
    assert "lid" not in imitator.config.points.names


def test_a_hand_that_is_perceived_too_is_no_landmark():
    hands = np.float32([hand_of(one)[0] for one in lift(0, FIRST).state.double().numpy()])
    shown = with_more(hands, ("hand.x", "hand.y", "hand.z"))
    imitator = Imitator.from_demonstrations(shown, body=arm())
    assert imitator.config.points is not None
    assert imitator.config.points.names == ("hand", "cup", "cup's place")
    imitator.learn(shown)
    landmarks = [segment.landmark for segment in imitator.cuts[0].segments]
    assert landmarks == ["cup", "world", "cup's place", "world"]
