"""Closed-form transforms of the plane against scipy, singular values and numerical minimisation."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation

from baselines.rigid_transform import fit_affine, fit_rigid, fit_similarity
from navopt.errors import InvalidInput

CASES = range(20)


def cloud(seed: int, n: int = 12) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points, targets that no rigid transform reaches, and weights."""
    rng = np.random.default_rng(seed)
    x = rng.normal(size=(n, 2)) * [5e3, 800.0] + [2e4, -7e3]
    angle = rng.uniform(-np.pi, np.pi)
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    y = (x - x.mean(axis=0)) @ turn.T * rng.uniform(0.7, 1.4) + rng.normal(size=(n, 2)) * 700.0 + [900.0, 4e3]
    return x, y, rng.uniform(0.1, 3.0, n)


def umeyama(x, y, w, *, scaled):
    """Umeyama 1991, eqs. (34)-(43), by singular values: rotation, scale and shift."""
    w = w / w.sum()
    mx, my = w @ x, w @ y
    u, d, vt = np.linalg.svd(np.einsum("k,ki,kj->ij", w, y - my, x - mx))
    sign = np.diag([1.0, np.sign(np.linalg.det(u) * np.linalg.det(vt))])
    rotation = u @ sign @ vt
    scale = np.trace(np.diag(d) @ sign) / (w @ ((x - mx) ** 2).sum(axis=1)) if scaled else 1.0
    return scale * rotation, my - scale * rotation @ mx


@pytest.mark.parametrize("seed", CASES)
def test_the_rotation_is_that_of_scipy(seed):
    x, y, w = cloud(seed)
    centred = [np.column_stack([p - np.average(p, axis=0, weights=w), np.zeros(len(p))]) for p in (y, x)]
    # points of a plane leave its normal open, so it is given as one more pair with a large weight
    pairs = [np.vstack([p, [0.0, 0.0, 1e4]]) for p in centred]
    rotation, _ = Rotation.align_vectors(*pairs, weights=np.append(w, 1e6))
    found = fit_rigid(x, y, w)
    np.testing.assert_allclose(found.matrix, rotation.as_matrix()[:2, :2], atol=1e-9)
    np.testing.assert_allclose(np.average(found(x), axis=0, weights=w), np.average(y, axis=0, weights=w))


@pytest.mark.parametrize("seed", CASES)
@pytest.mark.parametrize("scaled", [False, True])
def test_rigid_and_similarity_are_those_of_umeyama(seed, scaled):
    x, y, w = cloud(seed)
    found = (fit_similarity if scaled else fit_rigid)(x, y, w)
    matrix, shift = umeyama(x, y, w, scaled=scaled)
    np.testing.assert_allclose(found.matrix, matrix, atol=1e-12)
    np.testing.assert_allclose(found.shift, shift, atol=1e-7)


@pytest.mark.parametrize("seed", range(5))
def test_a_limited_scale_is_the_constrained_minimum(seed):
    x, y, w = cloud(seed)
    free = fit_similarity(x, y, w)
    for limits in ((0.5 * free.stretches[0], 0.8 * free.stretches[0]), (1.2 * free.stretches[0], 9.0)):
        found = fit_similarity(x, y, w, scale_limits=limits)

        def cost(v):
            a, b, n, e = v
            return (
                w
                @ ((y - (x @ np.array([[a, -b], [b, a]]).T + 1e3 * np.array([n, e]))) ** 2).sum(axis=1)
                / 1e8
            )

        def room(v, limits=limits):
            squared = v[0] ** 2 + v[1] ** 2
            return [squared - limits[0] ** 2, limits[1] ** 2 - squared]

        inside = {"type": "ineq", "fun": room}
        at = [found.matrix[0, 0], found.matrix[1, 0], *(found.shift / 1e3)]
        start = at + np.random.default_rng(seed).normal(size=4) * 0.05
        best = minimize(
            cost, start, constraints=inside, method="SLSQP", options={"ftol": 1e-14, "maxiter": 500}
        )
        assert limits[0] * (1 - 1e-9) <= found.stretches[0] <= limits[1] * (1 + 1e-9)
        assert cost(at) <= best.fun * (1 + 1e-6)


@pytest.mark.parametrize("seed", range(5))
def test_affine_without_ridge_is_least_squares(seed):
    x, y, w = cloud(seed)
    root = np.sqrt(w)[:, None]
    answer = np.linalg.lstsq(np.column_stack([x, np.ones(len(x))]) * root, y * root, rcond=None)[0]
    found = fit_affine(x, y, w, ridge=0.0)
    np.testing.assert_allclose(found.matrix, answer[:2].T, atol=1e-9)
    np.testing.assert_allclose(found.shift, answer[2], rtol=1e-8)


@pytest.mark.parametrize("ridge", [0.01, 0.3, 5.0])
def test_affine_minimises_its_regularised_cost(ridge):
    x, y, w = cloud(3)
    similar = fit_similarity(x, y, w)
    centred = [p - np.average(p, axis=0, weights=w) for p in (x, y)]
    mu = ridge * 0.5 * (w @ (centred[0] ** 2).sum(axis=1))

    def cost(v):
        a = v.reshape(2, 2)
        misfit = w @ ((centred[1] - centred[0] @ a.T) ** 2).sum(axis=1)
        return (misfit + mu * ((a - similar.matrix) ** 2).sum()) / 1e8

    best = minimize(cost, np.eye(2).ravel(), method="BFGS", options={"gtol": 1e-10})
    np.testing.assert_allclose(fit_affine(x, y, w, ridge=ridge).matrix.ravel(), best.x, atol=1e-5)


def test_a_straight_track_keeps_its_similarity_across():
    x = np.linspace(-1e4, 1e4, 12)[:, None] * [0.6, -0.8]
    y = fit_similarity(x, x)(x) @ np.array([[0.9, -0.2], [0.2, 0.9]]).T + [30.0, 40.0]
    found = fit_affine(x, y, ridge=0.1)
    np.testing.assert_allclose(found.matrix, [[0.9, -0.2], [0.2, 0.9]], atol=1e-9)


@pytest.mark.parametrize("seed", range(5))
def test_affine_stretches_keep_their_limits(seed):
    x, y, w = cloud(seed)
    free = fit_affine(x, y, w, ridge=0.0)
    low, high = free.stretches[1] * 1.02, free.stretches[0] * 0.98
    low, high = min(low, high), max(low, high)
    cut = fit_affine(x, y, w, ridge=0.0, scale_limits=(low, high))
    u, d, vt = np.linalg.svd(free.matrix)
    np.testing.assert_allclose(cut.matrix, u @ np.diag(np.clip(d, low, high)) @ vt, atol=1e-9)
    np.testing.assert_allclose(np.average(cut(x), axis=0, weights=w), np.average(y, axis=0, weights=w))


def test_a_reflection_is_not_a_rotation():
    x, _, _ = cloud(1)
    mirrored = x * [1.0, -1.0]
    for fit in (fit_rigid, fit_similarity, fit_affine):
        found = fit(x, mirrored, **({"scale_limits": (0.5, 2.0), "ridge": 1e-6} if fit is fit_affine else {}))
        assert np.linalg.det(found.matrix) > 0.0


def test_points_of_no_weight_do_not_count():
    x, y, w = cloud(2)
    w[[1, 5]] = 0.0
    spoilt = y.copy()
    spoilt[[1, 5]] = np.nan
    np.testing.assert_array_equal(fit_rigid(x, spoilt, w).matrix, fit_rigid(x, y, w).matrix)


def test_the_angle_is_recovered_from_an_exact_rotation():
    x, _, _ = cloud(4)
    for angle in np.linspace(-3.1, 3.1, 13):
        turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        assert fit_rigid(x, x @ turn.T + [5.0, 6.0]).rotation == pytest.approx(angle, abs=1e-12)


@pytest.mark.parametrize(
    ("arguments", "keywords", "name"),
    [
        ((np.zeros((3, 2)), np.zeros((3, 2))), {}, "source"),
        ((np.zeros((3, 2)), np.zeros((4, 2))), {}, "source"),
        ((np.eye(2), np.eye(2), [1.0, -1.0]), {}, "weights"),
        ((np.eye(2), np.eye(2), [1.0, 0.0]), {}, "source"),
        ((np.eye(2), np.eye(2), [np.nan, 1.0]), {}, "weights"),
    ],
)
def test_what_determines_no_transform_is_refused(arguments, keywords, name):
    for fit in (fit_rigid, fit_similarity, fit_affine):
        with pytest.raises(InvalidInput, match=name):
            fit(*arguments, **keywords)


def test_unusable_limits_are_refused():
    with pytest.raises(InvalidInput, match="scale_limits"):
        fit_similarity(np.eye(2), np.eye(2), scale_limits=(2.0, 1.0))
    with pytest.raises(InvalidInput, match="ridge"):
        fit_affine(np.eye(2), np.eye(2), ridge=-1.0)
    with pytest.raises(InvalidInput, match="source"):
        fit_affine([[0.0, 0.0], [1.0, 1.0], [2.0, 2.0]], np.zeros((3, 2)), ridge=0.0)
