"""Segments of the same kind are kept in the frame in which their ends agree."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pacnet.schemas.frame_choice import choose_landmarks
from pacnet.schemas.scene import WORLD, Scene

CUP, PLATE = 0, 1
FRAMES = 10  # of each segment
SHOWN = 4  # segments
EXTENT = 0.5  # [m]
OFFSET = np.array([0.02, -0.05, 0.1])  # of the hand at the end, from whatever it ends at


def shown(end_at: int, noise: float = 0.0, seed: int = 0) -> Scene:
    """Segments of a hand that ends at the same place in one frame; cup and plate are anywhere."""
    rng = np.random.default_rng(seed)
    landmarks = rng.uniform(-0.3, 0.3, (SHOWN, 2, 3))
    axes = Rotation.from_rotvec(rng.uniform(-2, 2, (2 * SHOWN, 3)))
    quaternions = np.roll(axes.as_quat(), 1, axis=1).reshape(SHOWN, 2, 4)
    ends = np.tile(OFFSET, (SHOWN, 1))
    if end_at != WORLD:
        ends = landmarks[:, end_at] + axes[np.arange(SHOWN) * 2 + end_at].apply(OFFSET)
    ends = ends + rng.normal(0, noise, ends.shape)
    begins = rng.uniform(-0.3, 0.3, ends.shape)
    share = np.linspace(0, 1, FRAMES)[None, :, None]
    hand = begins[:, None] + share * (ends - begins)[:, None]
    still = np.repeat(landmarks[:, None], FRAMES, axis=1)
    places = np.concatenate([hand[:, :, None], still], axis=2).reshape(-1, 3, 3)
    turns = np.zeros((len(places), 3, 4))
    turns[:, 0, 0] = 1
    turns[:, 1:] = quaternions.repeat(FRAMES, axis=0)
    return Scene(places, turns)


def chosen(
    scene: Scene,
    attended: int | list[int],
    kinds: list[int] | None = None,
    carried: np.ndarray | None = None,
) -> list[int]:
    landmark = np.broadcast_to(attended, SHOWN).astype(np.int64).copy()
    cuts = {"frames": np.full(SHOWN, FRAMES), "landmark": landmark}
    moves = np.zeros((SHOWN * FRAMES, 2), bool) if carried is None else carried
    of = np.array([0] * SHOWN if kinds is None else kinds)
    result = choose_landmarks(scene, moves, cuts, of, EXTENT)
    assert cuts["landmark"].tolist() == np.broadcast_to(attended, SHOWN).tolist()  # as it was
    return result.tolist()


@pytest.mark.parametrize("attended", [WORLD, CUP, PLATE])
@pytest.mark.parametrize("end_at", [WORLD, CUP, PLATE])
@pytest.mark.parametrize("noise", [0.0, 0.003])
def test_the_frame_in_which_ends_agree_is_chosen(end_at: int, attended: int, noise: float):
    assert chosen(shown(end_at, noise), attended) == [end_at] * SHOWN


@pytest.mark.parametrize("attended", [WORLD, CUP, PLATE])
def test_where_ends_agree_nowhere_attention_decides(attended: int):
    assert chosen(shown(CUP, noise=1.0), attended) == [attended] * SHOWN


def test_where_ends_agree_well_enough_attention_decides():
    """All landmarks are where they always are, so that every frame will do."""
    scene = shown(WORLD, noise=0.001)
    scene.places[:, 1:], scene.turns[:, 1:] = scene.places[:1, 1:], scene.turns[:1, 1:]
    for attended in (WORLD, CUP, PLATE):
        assert chosen(scene, attended) == [attended] * SHOWN


def test_a_millimetre_does_not_make_attention_wrong():
    """The plate stands beside the cup, as near as makes no difference; ends agree at the cup."""
    scene = shown(CUP)
    apart = np.random.default_rng(1).normal(0, 0.001, (SHOWN, 3)).repeat(FRAMES, axis=0)
    scene.places[:, 2], scene.turns[:, 2] = scene.places[:, 1] + apart, scene.turns[:, 1]
    assert chosen(scene, PLATE) == [PLATE] * SHOWN


def test_what_mostly_moves_is_no_frame():
    carried = np.zeros((SHOWN, FRAMES, 2), bool)
    carried[2, 1:, CUP] = True  # in one of the segments
    assert chosen(shown(CUP), PLATE, carried=carried.reshape(-1, 2)) == [PLATE] * SHOWN
    carried[2, 2:, CUP] = False  # but for a moment
    assert chosen(shown(CUP), PLATE, carried=carried.reshape(-1, 2)) == [CUP] * SHOWN


def test_only_segments_of_one_kind_are_compared():
    scene = shown(CUP)
    assert chosen(scene, PLATE, [-1] * SHOWN) == [PLATE] * SHOWN
    assert chosen(scene, PLATE, [0, 1, 2, 3]) == [PLATE] * SHOWN
    assert chosen(scene, PLATE, [5, -1, 5, -1]) == [CUP, PLATE, CUP, PLATE]
