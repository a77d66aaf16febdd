"""Principal components: known ellipses, a second method, and the contracts of their fit."""

import numpy as np
import pytest

from pacnet.evaluation.pca import PrincipalComponents


def spread(samples: int = 400, dimensions: int = 5, seed: int = 0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return rng.normal(size=(samples, dimensions)) @ rng.normal(size=(dimensions, dimensions)) + 3


def test_finds_the_axes_of_a_known_cross():
    # Four points: +-3 along (3, 4, 0)/5 and +-1 along (-4, 3, 0)/5, around (1, 2, 3).
    long, short = np.array([0.6, 0.8, 0]), np.array([-0.8, 0.6, 0])
    points = np.array([3 * long, -3 * long, short, -short]) + np.array([1, 2, 3])
    fit = PrincipalComponents.fit(points)
    np.testing.assert_allclose(fit.mean, [1, 2, 3])
    np.testing.assert_allclose(fit.components[0], long, atol=1e-12)
    np.testing.assert_allclose(fit.components[1], -short, atol=1e-12)  # its 0.8 is made positive
    np.testing.assert_allclose(fit.explained_variance_ratio, [0.9, 0.1, 0], atol=1e-12)
    expected = [[3, 0], [-3, 0], [0, -1], [0, 1]]
    np.testing.assert_allclose(fit.project(points), expected, atol=1e-12)


def test_agrees_with_the_eigenvectors_of_the_covariance():
    percepts, scale = spread(), np.array([1, 1, 0.3, 2, 1])
    fit = PrincipalComponents.fit(percepts, scale)
    values, vectors = np.linalg.eigh(np.cov((percepts * scale).T))
    np.testing.assert_allclose(fit.explained_variance_ratio, values[::-1] / values.sum())
    overlap = np.abs(fit.components @ vectors[:, ::-1])
    np.testing.assert_allclose(overlap, np.eye(5), atol=1e-9)
    assert fit.variance(2) == pytest.approx(values[-2:].sum() / values.sum())
    assert fit.variance(5) == pytest.approx(1)


def test_projection_scales_as_the_fit_did():
    percepts, scale = spread(), np.array([1, 1, 0.3, 2, 1])
    scaled = PrincipalComponents.fit(percepts * scale).project(percepts * scale)
    fit = PrincipalComponents.fit(percepts, scale)
    np.testing.assert_allclose(fit.project(percepts), scaled, atol=1e-9)


def test_projection_onto_two_components_loses_least():
    percepts = spread()
    fit = PrincipalComponents.fit(percepts)
    kept = fit.project(percepts).var(axis=0).sum() / percepts.var(axis=0).sum()
    assert kept == pytest.approx(fit.variance(2))
    rng = np.random.default_rng(1)
    for _ in range(20):
        plane = np.linalg.qr(rng.normal(size=(5, 2)))[0]
        assert (percepts @ plane).var(axis=0).sum() / percepts.var(axis=0).sum() <= kept


def test_sign_is_the_same_for_every_order_of_samples():
    percepts = spread()
    shuffled = np.random.default_rng(2).permutation(percepts)
    one, other = PrincipalComponents.fit(percepts), PrincipalComponents.fit(shuffled)
    np.testing.assert_allclose(one.components, other.components, atol=1e-9)
    np.testing.assert_allclose(one.project(percepts), other.project(percepts), atol=1e-9)
    largest = np.take_along_axis(
        one.components, np.abs(one.components).argmax(axis=1, keepdims=True), axis=1
    )
    assert (largest > 0).all()


def test_a_large_offset_costs_no_precision():
    percepts = spread().astype(np.float32).astype(np.float64)
    near, far = PrincipalComponents.fit(percepts), PrincipalComponents.fit(percepts + 1e6)
    np.testing.assert_allclose(far.explained_variance_ratio, near.explained_variance_ratio)


@pytest.mark.parametrize("percepts", [np.ones((1, 3)), np.full((7, 3), 0.1), np.zeros((2, 3))])
def test_percepts_that_do_not_vary_work(percepts):
    fit = PrincipalComponents.fit(percepts)
    assert fit.variance(2) == 0
    np.testing.assert_allclose(fit.project(percepts), 0, atol=1e-12)
    np.testing.assert_allclose(fit.components @ fit.components.T, np.eye(3), atol=1e-12)


def test_fewer_samples_than_dimensions_give_a_whole_basis():
    fit = PrincipalComponents.fit(spread(samples=3, dimensions=6))
    assert fit.variance(2) == pytest.approx(1)
    np.testing.assert_allclose(fit.components @ fit.components.T, np.eye(6), atol=1e-12)


def test_no_percepts_project_to_none():
    assert PrincipalComponents.fit(spread()).project(np.zeros((0, 5))).shape == (0, 2)


def test_inputs_stay_as_they_are():
    percepts, scale = spread(), np.ones(5)
    before = percepts.copy()
    fit = PrincipalComponents.fit(percepts, scale)
    scale[:] = 7
    np.testing.assert_array_equal(percepts, before)
    np.testing.assert_array_equal(fit.scale, np.ones(5))


@pytest.mark.parametrize(
    ("percepts", "scale", "message"),
    [
        (np.zeros((0, 3)), None, r"\[T ≥ 1, D ≥ 2\], got \(0, 3\)"),
        (np.zeros((4, 1)), None, r"\[T ≥ 1, D ≥ 2\], got \(4, 1\)"),
        (np.zeros(3), None, r"as numbers \[T, D\], got float64 \(3,\)"),
        (np.zeros((3, 3), dtype=complex), None, "got complex128"),
        (np.full((3, 3), np.nan), None, "NaN or infinity"),
        (np.zeros((3, 3)), [1.0, 1.0], r"scale as numbers \[3\]"),
        (np.zeros((3, 3)), [1.0, 1.0, 0.0], "scale > 0"),
        (np.zeros((3, 3)), [1.0, 1.0, np.inf], "finite scale"),
    ],
)
def test_bad_input_is_refused(percepts, scale, message):
    with pytest.raises(ValueError, match=message):
        PrincipalComponents.fit(percepts, scale)


def test_projection_and_share_refuse_what_was_not_fitted():
    fit = PrincipalComponents.fit(spread())
    with pytest.raises(ValueError, match=r"percepts as numbers \[T, 5\], got float64 \(2, 4\)"):
        fit.project(np.zeros((2, 4)))
    for k in (0, 6):
        with pytest.raises(ValueError, match="k from 1 to 5"):
            fit.variance(k)
