"""A body model: exact for hinges, finds what moves the hand, reaches, refuses what it cannot."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import torch
from hinge_chains import Array, Chain, exact_model, make_chain, postures, rotation
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from pacnet.core.checkpoint import read_checkpoint, write_checkpoint
from pacnet.forward_models.config import KinematicModelConfig
from pacnet.forward_models.kinematics import KinematicModel

SIZES = [(2, 2, 300), (2, 11, 300), (4, 11, 1500), (6, 8, 3500)]  # moving, joints, postures


def seen(chain: Chain, count: int, noise: float = 0.0) -> tuple[Array, Array, Array]:
    """Postures and where the hand was seen, off by `noise` in metres, and as much in radians."""
    rng = np.random.default_rng(1)
    angles = postures(chain, count, seed=2)
    places, turns = chain.poses(angles)
    shaken = Rotation.from_rotvec(rng.normal(0, noise, (count, 3))) * rotation(turns)
    quaternions = np.roll(shaken.as_quat(), 1, axis=1)
    return angles, places + rng.normal(0, noise, places.shape), quaternions


def largest_angle(first: Any, second: Any) -> float:
    """Return the largest angle between quaternions [rad]."""
    between = rotation(np.asarray(first)) * rotation(np.asarray(second)).inv()
    return float(between.magnitude().max())


@pytest.mark.parametrize(("moving", "joints", "count"), SIZES)
def test_what_moves_the_hand_is_found_and_predicted_exactly(moving: int, joints: int, count: int):
    chain = make_chain(moving, joints)
    model, fit = KinematicModel.fitted(chain.joints, *seen(chain, count))
    assert model.config.moving == chain.moving
    assert fit.moving == tuple(chain.joints[joint] for joint in chain.moving)
    assert fit.place_rms < 1e-9
    assert fit.turn_rms < 1e-7
    angles = postures(chain, 50, seed=3)
    pose = model(torch.from_numpy(angles))
    places, turns = chain.poses(angles)
    np.testing.assert_allclose(pose.place, places, atol=1e-9)
    assert largest_angle(pose.turn, turns) < 1e-7
    assert bool((pose.turn[:, 0] >= 0).all())


@pytest.mark.parametrize(("moving", "joints", "count"), SIZES)
def test_noise_is_averaged_over_postures(moving: int, joints: int, count: int):
    chain, noise = make_chain(moving, joints, seed=5), 0.01
    model, fit = KinematicModel.fitted(chain.joints, *seen(chain, count, noise))
    assert model.config.moving == chain.moving
    angles = postures(chain, 500, seed=3)
    places, turns = chain.poses(angles)
    pose = model(torch.from_numpy(angles))
    error = np.sqrt(np.square(pose.place.numpy() - places).sum(axis=1).mean())
    # Of N postures, the noise of 3**K products stays; at the ends of the range more than elsewhere.
    share = 3**moving / count
    assert error < 2 * noise * np.sqrt(3 * share)
    # A posture that was left out is missed by that, and by its own noise in three dimensions.
    assert fit.place_rms == pytest.approx(np.hypot(error, np.sqrt(3) * noise), rel=0.1)
    off = (rotation(pose.turn.numpy()) * rotation(turns).inv()).magnitude()
    turn_error = np.sqrt(np.square(off).mean())
    assert turn_error < 2 * noise * np.sqrt(3 * share)
    assert fit.turn_rms == pytest.approx(np.hypot(turn_error, np.sqrt(3) * noise), rel=0.1)


def test_predicting_each_posture_from_the_others_needs_no_second_fit():
    chain = make_chain(2, 2)
    angles, places, turns = seen(chain, 80, noise=0.01)
    _, fit = KinematicModel.fitted(chain.joints, angles, places, turns)
    missed = []
    for left_out in range(80):
        rest = np.arange(80) != left_out
        model, _ = KinematicModel.fitted(chain.joints, angles[rest], places[rest], turns[rest])
        missed.append(model(torch.from_numpy(angles[left_out])).place.numpy() - places[left_out])
    assert fit.place_rms == pytest.approx(float(np.sqrt(np.square(missed).sum(axis=1).mean())))


def test_a_constant_angle_moves_nothing():
    chain = make_chain(3, 3)
    angles, places, turns = seen(chain, 400)
    angles = np.insert(angles, 1, 0.7, axis=1)
    names = ("a", "held", "b", "c")
    model, fit = KinematicModel.fitted(names, angles, places, turns)
    assert fit.moving == ("a", "b", "c")
    place = model(torch.from_numpy(angles[:5])).place
    np.testing.assert_allclose(place, places[:5], atol=1e-9)


def test_a_joint_is_found_whose_effect_alone_averages_out():
    """Three hinges at right angles, each shown all around, hide one another's mean effect."""
    chain = Chain(("z", "y", "x"), (0, 1, 2), np.eye(3)[::-1], 0.3 * np.eye(3))
    angles = postures(chain, 2000, seed=4, widest=np.pi)
    model, _ = KinematicModel.fitted(chain.joints, angles, *chain.poses(angles))
    assert model.config.moving == (0, 1, 2)


def test_joints_that_hardly_move_are_fitted_too():
    chain = make_chain(4, 5)
    angles = postures(chain, 600, seed=4, widest=0.05)
    model, fit = KinematicModel.fitted(chain.joints, angles, *chain.poses(angles))
    assert model.config.moving == chain.moving
    assert fit.place_rms < 1e-6


def test_tensors_are_taken_as_arrays_are():
    chain = make_chain(2, 3)
    rows = seen(chain, 200)
    one, _ = KinematicModel.fitted(chain.joints, *rows)
    other, _ = KinematicModel.fitted(list(chain.joints), *map(torch.from_numpy, rows))
    assert one.config == other.config
    assert torch.equal(one.coefficients, other.coefficients)
    assert one.lowest.tolist() == rows[0].min(axis=0).tolist()
    assert one.highest.tolist() == rows[0].max(axis=0).tolist()


def spoil(number: int, change: Callable[[Array], Array]) -> tuple[Array, ...]:
    rows = list(seen(make_chain(2, 3), 100))
    rows[number] = change(rows[number])
    return tuple(rows)


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        (spoil(0, lambda rows: rows[:, :2]), r"expected angles as an array \[N, 3\].*\[100, 2\]"),
        (spoil(0, lambda rows: rows[0]), r"expected angles as an array \[N, 3\].*got \[3\]"),
        (spoil(1, lambda rows: rows[:99]), r"expected places as an array \[100, 3\].*\[99, 3\]"),
        (spoil(2, lambda rows: rows[:, :3]), r"expected turns as an array \[100, 4\].*\[100, 3\]"),
        (spoil(1, lambda rows: np.where(rows > 0, np.nan, rows)), "expected finite places"),
        (spoil(0, lambda rows: rows + np.inf), "expected finite angles"),
        (spoil(2, lambda rows: 2 * rows), "expected unit quaternions w, x, y, z .* 2"),
        (spoil(1, lambda rows: rows.astype(str)[:, :1]), "expected places as an array"),
        (tuple(rows[:20] for rows in spoil(0, np.copy)), "at least 24 postures of 3 .* 20"),
        (spoil(0, lambda rows: np.ones_like(rows)), "expected one or more angles that move"),
    ],
)  # fmt: skip
def test_rows_that_cannot_be_fitted_are_refused(rows: tuple[Array, ...], message: str):
    with pytest.raises(ValueError, match=message):
        KinematicModel.fitted(("a", "b", "c"), *rows)


def test_too_few_postures_for_what_moves_are_refused_with_how_many_it_takes():
    chain = make_chain(4, 4)
    rows = seen(chain, 200)
    with pytest.raises(ValueError, match=r"at least 324 postures, as angles .* got 200"):
        KinematicModel.fitted(chain.joints, *rows)  # 4 · 3⁴
    with pytest.raises(ValueError, match="joints as one or more names, all different"):
        KinematicModel.fitted(("a", "a", "b", "c"), *rows)


def test_a_hand_that_rests_is_refused():
    angles = postures(make_chain(2, 3), 100, seed=0)
    places, turns = np.zeros((100, 3)), np.tile([1.0, 0.0, 0.0, 0.0], (100, 1))
    noise = np.random.default_rng(0).normal(0, 0.01, places.shape)
    for rows in (places, places + noise):
        with pytest.raises(ValueError, match="angles that move the hand, got none"):
            KinematicModel.fitted(("a", "b", "c"), angles, rows, turns)


def test_postures_of_any_shape_are_posed():
    chain = make_chain(2, 3)
    model = exact_model(chain)
    angles = torch.from_numpy(postures(chain, 6, seed=1))
    flat, square, one = model(angles), model(angles.reshape(2, 3, 3)), model(angles[4])
    assert square.place.shape == (2, 3, 3)
    assert square.turn.shape == (2, 3, 4)
    assert torch.equal(square.place.flatten(0, 1), flat.place)
    torch.testing.assert_close(one.turn, flat.turn[4])
    assert model(angles[:0]).turn.shape == (0, 4)


@pytest.mark.parametrize(
    ("angles", "got"),
    [
        (torch.zeros(2), r"got torch.float32 \[2\]"),
        (torch.zeros(3).long(), "got torch.int64"),
        (np.zeros(3), "got float64"),
        (torch.tensor([0.0, torch.nan, 0.0]), "got NaN or infinity"),
    ],
)
def test_angles_of_another_kind_are_refused(angles: Any, got: str):
    with pytest.raises(ValueError, match=f"expected angles as a tensor .*{got}"):
        exact_model(make_chain(2, 3))(angles)


def test_a_given_function_is_fitted_exactly_as_quaternions_or_matrices():
    chain = make_chain(4, 6)
    ends = np.full(6, 1.2)

    def as_quaternion(angles: Array) -> tuple[Array, Array]:
        place, turn = chain.pose(angles)
        return place, -np.roll(turn.as_quat(), 1)

    models = [
        KinematicModel.from_function(as_quaternion, chain.joints, -ends, ends, seed=3),
        exact_model(chain),
    ]
    angles = postures(chain, 50, seed=3)
    places, turns = chain.poses(angles)
    for model in models:
        assert model.config.moving == chain.moving
        assert model.highest.tolist() == ends.tolist()
        pose = model(torch.from_numpy(angles))
        np.testing.assert_allclose(pose.place, places, atol=1e-10)
        assert largest_angle(pose.turn, turns) < 1e-7


UNTURNED = (1.0, 0.0, 0.0, 0.0)
ARM = (np.zeros(1), np.ones(1))


@pytest.mark.parametrize(
    ("function", "message"),
    [
        (lambda q: (np.array([np.exp(3 * q[0]), 0, 0]), UNTURNED), "expected a chain of hinges"),
        (lambda _: (np.zeros(3), UNTURNED), "1 to 7 angles that move the hand, got none"),
        (lambda q: (q, UNTURNED), r"the function's place as an array \[3\]"),
        (lambda q: (np.append(q, [0, 0]), (2.0, 0, 0, 0)), "unit quaternions"),
        (lambda q: (np.append(q, [0, 0]), np.diag([1, 1, -1])), "expected a rotation matrix"),
        (lambda q: np.append(q, [0, 0]), "expected a function that gives a place and a turn"),
    ],
)
def test_functions_that_are_no_chain_of_hinges_are_refused(function: Any, message: str):
    with pytest.raises(ValueError, match=message):
        KinematicModel.from_function(function, ("a",), *ARM)


def test_a_range_that_is_none_is_refused():
    with pytest.raises(ValueError, match="expected lowest ≤ highest, got another range of 'a'"):
        KinematicModel.from_function(lambda q: (q, UNTURNED), ("a",), *ARM[::-1])
    with pytest.raises(ValueError, match="expected finite highest"):
        KinematicModel.from_function(lambda q: (q, UNTURNED), ("a",), [0.0], [np.inf])


def test_the_hand_is_taken_to_places_and_turns_in_reach():
    chain = make_chain(6, 7, seed=2)
    model = exact_model(chain)
    inside = 0.8 * postures(chain, 20, seed=5)
    for angles, near in zip(inside, postures(chain, 20, seed=6), strict=True):
        place, turn = chain.pose(angles)
        reach = model.solve(near, place, np.roll(turn.as_quat(), 1))
        there, turned = chain.pose(reach.angles)
        assert np.linalg.norm(there - place) < 1e-6
        assert (turned * turn.inv()).magnitude() < 1e-5
        assert reach.distance < 1e-6
        assert reach.turn < 1e-5
        assert (np.abs(reach.angles) <= 1.2).all()
        idle = [joint for joint in range(7) if joint not in chain.moving]
        assert (reach.angles[idle] == near[idle]).all()


def test_of_the_postures_that_arrive_it_is_the_nearest():
    chain = make_chain(5, 5, seed=4)
    model = exact_model(chain)
    near = np.zeros(5)
    place = chain.pose(np.full(5, 0.15))[0]
    reach = model.solve(near, place)
    assert reach.distance < 1e-8
    assert reach.turn == 0
    # A second method: least squares whose pull towards the posture fades.
    angles = near
    for pull in (1e-2, 1e-3, 1e-4):
        angles = least_squares(
            lambda q, pull=pull: np.append(chain.pose(q)[0] - place, pull * (q - near)), angles
        ).x
    assert np.linalg.norm(reach.angles) == pytest.approx(np.linalg.norm(angles), rel=0.02)


def test_a_place_out_of_reach_is_approached_and_its_distance_told():
    # An arm of 0.3 m and 0.2 m in a plane, from −1.2 to 1.2 rad.
    links = np.array([[0.3, 0.0, 0.0], [0.2, 0.0, 0.0]])
    chain = Chain(("shoulder", "elbow"), (0, 1), np.array([[0.0, 0, 1], [0, 0, 1]]), links)
    model = exact_model(chain)
    far = model.solve([0.5, 0.5], [0.8, 0.0, 0.0])
    np.testing.assert_allclose(far.angles, 0, atol=1e-3)
    assert far.distance == pytest.approx(0.3)  # 0.8 − 0.5
    above = model.solve([0.5, 0.5], [0.45, 0.0, 0.4])
    assert above.distance == pytest.approx(0.4)
    behind = model.solve([0.0, 0.0], [-0.5, 0.1, 0.0])
    ends = np.array([1.2, 1.2])
    np.testing.assert_allclose(behind.angles, ends, atol=1e-6)
    assert behind.distance == pytest.approx(np.linalg.norm(chain.pose(ends)[0] - [-0.5, 0.1, 0]))


def test_places_that_are_none_are_refused():
    model = exact_model(make_chain(2, 3))
    for arguments, message in (
        (([0.0, 0.0], [0.0] * 3), r"expected near as an array \[3\] of numbers, got \[2\]"),
        (([0.0] * 3, [0.0] * 2), r"expected place as an array \[3\]"),
        (([0.0] * 3, [0.0, np.nan, 0.0]), "expected finite place, got nan"),
        (([0.0] * 3, [0.0] * 3, [0.0] * 4), "expected unit quaternions"),
    ):
        with pytest.raises(ValueError, match=message):
            model.solve(*arguments)


def test_a_saved_model_comes_back_whole(tmp_path):
    chain = make_chain(3, 5)
    model, _ = KinematicModel.fitted(chain.joints, *seen(chain, 300, noise=0.01))
    model.save_pretrained(tmp_path)
    loaded = KinematicModel.from_pretrained(tmp_path)
    assert loaded.config == model.config
    for name, tensor in model.state_dict().items():
        assert torch.equal(loaded.state_dict()[name], tensor), name
    arrays = loaded.arrays()
    arrays.coefficients.fill(0.0)  # a copy
    assert torch.equal(loaded.coefficients, model.coefficients)


def test_a_new_model_rests_at_the_origin():
    pose = KinematicModel(KinematicModelConfig(("a", "b"), (1,)))(torch.ones(2))
    assert pose.place.tolist() == [0, 0, 0]
    np.testing.assert_allclose(pose.turn, UNTURNED, atol=1e-12)


@pytest.mark.parametrize(
    ("name", "tensor", "message"),
    [
        ("lowest", None, r"got \['lowest'\] missing, none extra"),
        ("more", torch.zeros(1), r"got none missing, \['more'\] extra"),
        ("coefficients", torch.zeros(3, 12).double(), r"coefficients .*float64 \[3, 12\]"),
        ("coefficients", torch.full((9, 12), torch.inf).double(), "expected finite coefficients"),
        ("highest", torch.full((3,), -9.0).double(), "expected lowest ≤ highest"),
        ("highest", torch.zeros(3), r"highest .* as torch.float64 .* got torch.float32"),
    ],
)  # fmt: skip
def test_a_damaged_checkpoint_is_refused(tmp_path, name: str, tensor: Any, message: str):
    exact_model(make_chain(2, 3)).save_pretrained(tmp_path)
    fields, tensors = read_checkpoint(tmp_path)
    tensors.pop(name, None)
    write_checkpoint(tmp_path, fields, tensors if tensor is None else tensors | {name: tensor})
    with pytest.raises(ValueError, match=message):
        KinematicModel.from_pretrained(tmp_path)


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"moving": [0, 1, 2]}, r"coefficients .* \[27, 12\], got torch.float64 \[9, 12\]"),
        ({"moving": [0, 3]}, "moving as 1 to 7 ascending indices below 3"),
        ({"moving": [1, 0]}, "moving as 1 to 7 ascending indices"),
        ({"moving": [0, 0]}, "moving as 1 to 7 ascending indices"),
        ({"moving": []}, "moving as 1 to 7 ascending indices"),
        ({"moving": [0.0]}, "moving as 1 to 7 ascending indices"),
        ({"joints": ["a", "a", "b"]}, "joints as one or more names, all different"),
        ({"joints": ["a", "b"], "moving": [0, 1]}, r"lowest .* \[2\], got torch.float64 \[3\]"),
        ({"joints": "abc"}, "joints as one or more names"),
        (
            {"joints": [str(joint) for joint in range(60)], "moving": list(range(60))},
            "moving as 1 to 7 ascending indices below 60",  # 3⁶⁰ products fit into no memory
        ),
    ],
)
def test_a_config_that_cannot_be_is_refused(tmp_path, fields: dict[str, Any], message: str):
    exact_model(make_chain(2, 3)).save_pretrained(tmp_path)
    config, tensors = read_checkpoint(tmp_path)
    write_checkpoint(tmp_path, config | fields, tensors)
    with pytest.raises(ValueError, match=message):
        KinematicModel.from_pretrained(tmp_path)
