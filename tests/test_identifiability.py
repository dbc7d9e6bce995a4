"""What data can tell: against linear problems solved by hand, and the ranks derived for gyros."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import linalg

from comparisons.drawing import render
from comparisons.null_directions_figure import CHANGES, norm_change, null_directions_figure
from navopt import simulate
from navopt.errors import InvalidInput, UnsuitableProblem
from navopt.identifiability import identifiability
from navopt.models import GyroNoise, earth_rate, scattered_positions, twenty_four_positions
from navopt.problem import EstimationProblem, Parameter
from navopt.problems import GyroCalibration, Sphere
from navopt.problems.gyro_worlds import PAPER_NOISE, PAPER_PRESET

LATITUDE = np.radians(45.75)


class Linear(EstimationProblem):
    """Residuals A x - y of unit variance, in a box of given half widths about zero."""

    provides = frozenset({"residuals", "bound"})

    def __init__(self, matrix, half, covariance=None, unit="m"):
        self.matrix = np.array(matrix, dtype=float)
        self.covariance = covariance
        super().__init__([Parameter(f"p{k}", unit, -h, h, 0.0) for k, h in enumerate(half)])

    def _loss(self, X):
        return np.sum(self._residuals(X) ** 2, axis=1)

    def _residuals(self, X):
        return X @ self.matrix.T

    def prior(self):
        return None if self.covariance is None else (self.nominal, self.covariance)


def test_without_null_directions_it_is_the_cramer_rao_bound():
    rng = np.random.default_rng(0)
    matrix = rng.normal(size=(12, 4)) * [1.0, 1e3, 1e-5, 50.0]
    problem = Linear(matrix, [100.0, 1.0, 1e8, 10.0])
    found = problem.identifiability()
    assert found.complete
    assert (found.rank, found.n_parameters, found.null_directions) == (4, 4, ())
    expected = np.sqrt(np.diag(np.linalg.inv(matrix.T @ matrix)))
    np.testing.assert_allclose(list(found.sigma.values()), expected, rtol=1e-5)
    bound = np.sqrt(np.diag(problem.error_bound(problem.nominal)))
    np.testing.assert_allclose(list(found.sigma.values()), bound, rtol=1e-5)
    assert "4 of 4 parameters" in found.report()


def test_what_cannot_be_told_is_named_and_the_rest_keeps_its_sigma():
    """p1 and p2 come as a sum only, p4 not at all: by hand."""
    matrix = np.zeros((3, 5))
    matrix[0, 0], matrix[1, 1], matrix[1, 2], matrix[2, 3] = 2.0, 5.0, 5.0, 10.0
    found = identifiability(Linear(matrix, np.ones(5)))
    assert found.rank == 3
    assert {d.words for d in found.null_directions} == {"p1 - p2", "p4"}
    assert found.sigma["p0"] == pytest.approx(0.5)
    assert found.sigma["p3"] == pytest.approx(0.1)
    assert all(np.isinf(found.sigma[name]) for name in ("p1", "p2", "p4"))
    assert all(np.isinf(d.sigma) for d in found.null_directions)
    np.testing.assert_allclose(found.singular_values, [10.0, np.sqrt(50.0), 2.0, 0.0, 0.0], atol=1e-7)
    text = str(found)
    assert "3 of 5" in text
    assert "p1 - p2" in text
    assert "not told" in text


@pytest.mark.parametrize("seed", range(6))
def test_the_null_space_is_the_right_one(seed):
    rng = np.random.default_rng(seed)
    matrix = rng.normal(size=(10, 3)) @ rng.normal(size=(3, 6)) * 50.0
    found = Linear(matrix, np.ones(6)).identifiability()
    assert found.rank == 3
    basis = np.zeros((3, 6))
    for row, direction in zip(basis, found.null_directions, strict=True):
        for name, weight in direction.coefficients.items():
            row[int(name[1:])] = weight
    expected = linalg.null_space(matrix)
    # small weights are left out of the words, so the angle is small but not zero
    assert linalg.subspace_angles(basis.T, expected).max() < 0.1
    assert np.linalg.matrix_rank(basis, tol=0.05) == 3


def test_told_means_better_than_the_box_or_the_prior():
    wide, narrow = Linear(np.eye(2), [1.0, 100.0]), Linear(np.eye(2), [0.1, 0.1])
    assert identifiability(Linear(2.0 * np.eye(2), [1.0, 1.0])).rank == 2
    assert [wide.identifiability().rank, narrow.identifiability().rank] == [1, 0]
    assert identifiability(wide, threshold=1.5).rank == 2
    assert Linear(np.eye(2), [0.1, 0.1], covariance=25.0 * np.eye(2)).identifiability().rank == 2
    weak = narrow.identifiability().null_directions[0]
    assert weak.sigma == pytest.approx(10.0)
    # and the prior takes no part in sigma
    assert Linear(np.eye(2), [9, 9], covariance=4.0 * np.eye(2)).identifiability().sigma[
        "p0"
    ] == pytest.approx(1)


def test_it_works_for_every_problem_with_residuals():
    gravity = simulate("gravity-matching", 0, hours=2.0).identifiability()
    assert gravity.n_parameters == 4
    assert set(gravity.sigma) == {"north", "east", "rotation", "scale"}
    assert "m" in gravity.report()
    sphere = simulate("sphere", 0, n_var=3).identifiability()
    assert sphere.complete
    assert simulate("helical-valley", 0).identifiability().n_parameters == 3
    with pytest.raises(UnsuitableProblem, match="residuals"):
        simulate("ackley", 0, n_var=2).identifiability()


def test_impossible_questions_are_refused():
    with pytest.raises(InvalidInput, match="threshold"):
        identifiability(Sphere([0.0, 0.0]), threshold=0.0)
    world = simulate("gyro-calibration", 0, estimated="scale")
    with pytest.raises(InvalidInput, match="cannot be evaluated"):
        identifiability(world, [0.0, 1e8, 1e8])


# -- gyros -----------------------------------------------------------------------------------------------


def known(estimated, attitudes, **options):
    """Noise-free positions of gyros whose other parameters are known rightly."""
    return GyroCalibration(
        PAPER_PRESET.forward(earth_rate(attitudes, LATITUDE)),
        latitude=LATITUDE,
        noise=PAPER_NOISE,
        fixed=PAPER_PRESET,
        estimated=estimated,
        truth=PAPER_PRESET,
        **options,
    )


@pytest.mark.parametrize(
    ("estimated", "rank", "of"),
    [
        ("all", 9, 12),
        ("misalignment", 3, 6),
        ("scale", 3, 3),
        ("bias", 3, 3),
        (["scale", "bias"], 6, 6),
        ("frame", 9, 9),
    ],
)
@pytest.mark.parametrize("attitudes", [twenty_four_positions(), scattered_positions(48, 1)], ids=["24", "48"])
def test_ranks_of_the_earth_rate_norm(estimated, rank, of, attitudes):
    found = known(estimated, attitudes).identifiability()
    assert (found.rank, found.n_parameters) == (rank, of)
    assert len(found.null_directions) == of - rank
    words = {direction.words for direction in found.null_directions}
    if of > rank:
        assert words == {
            "misalignment_xy - misalignment_yx: rotation of the gyro frame about z",
            "misalignment_xz - misalignment_zx: rotation of the gyro frame about y",
            "misalignment_yz - misalignment_zy: rotation of the gyro frame about x",
        }
        assert all(np.isinf(found.sigma[n]) for n in found.sigma if n.startswith("misalignment"))
    assert all(np.isfinite(found.sigma[n]) for n in found.sigma if not n.startswith("misalignment"))
    if rank == of:
        assert all(np.isfinite(value) for value in found.sigma.values())


def test_with_accelerometers_only_the_common_frame_is_missing():
    found = simulate("gyro-calibration", 2, estimated="all", loss="invariants").identifiability()
    assert (found.rank, found.n_parameters) == (21, 24)
    assert [d.words.partition(": ")[2] for d in found.null_directions] == [
        f"rotation of the frame of the whole unit about {axis}" for axis in "zyx"
    ]
    assert simulate("gyro-calibration", 2, loss="invariants").identifiability().complete
    # accelerometers without the angle: their loss alone cannot be asked for, but its Jacobian can
    world = simulate("gyro-calibration", 2, estimated="all", loss="invariants")
    jacobian = world.jacobian(world.true_x) * 0.5 * (world.xu - world.xl)
    blocks = np.linalg.solve(world._misfit.whitening, jacobian.reshape(-1, 3, 24))
    blocks = blocks / np.abs(blocks).max(axis=(0, 2), keepdims=True)
    for rows, rank in (([0], 9), ([0, 1], 18), ([0, 1, 2], 21)):
        values = np.linalg.svd(blocks[:, rows].reshape(-1, 24), compute_uv=False)
        assert (values > 1e-6 * values[0]).sum() == rank


def test_one_position_tells_one_number():
    still = np.repeat(twenty_four_positions()[:1], 30, axis=0)
    found = known("all", still).identifiability()
    assert found.rank == 1
    assert len(found.null_directions) == 11
    turntable = simulate("gyro-calibration", 0, estimated="all", loss="turntable").identifiability()
    assert turntable.complete


def test_one_axis_turns_tell_no_more_than_they_can():
    """z up at many azimuths: the vertical rate never changes, and the horizontal ones lie on a circle."""
    azimuths = np.linspace(0, 2 * np.pi, 36, endpoint=False)
    turns = np.array([[[np.cos(a), -np.sin(a), 0], [np.sin(a), np.cos(a), 0], [0, 0, 1]] for a in azimuths])
    world = known("frame", turns)
    # x = cos, y = sin, z constant: 1, x, y, xy, x^2 - y^2 are all that a quadratic can be
    values = np.linalg.svd(world.jacobian(world.true_x) * (world.xu - world.xl), compute_uv=False)
    assert (values > 1e-9 * values[0]).sum() == 5
    assert world.identifiability().rank <= 5


def test_less_noise_tells_more():
    loud = GyroNoise.from_datasheet(deg_sqrt_h=0.1)
    counts = PAPER_PRESET.forward(earth_rate(twenty_four_positions(), LATITUDE))
    rank = [
        GyroCalibration(counts, latitude=LATITUDE, noise=noise, fixed=PAPER_PRESET).identifiability().rank
        for noise in (loud, PAPER_NOISE)
    ]
    assert rank[0] < rank[1] == 9


def test_the_picture_shows_the_closed_form():
    """To first order the norm changes by x^2, x, 2xy and nothing."""
    rng = np.random.default_rng(2)
    u = rng.normal(size=(50, 3))
    u /= np.linalg.norm(u, axis=1, keepdims=True)
    closed = (u[:, 0] ** 2, u[:, 0], 2 * u[:, 0] * u[:, 1], np.zeros(50))
    for change, expected in zip(CHANGES.values(), closed, strict=True):
        np.testing.assert_allclose(norm_change(change, u), expected, atol=1e-5)
    figure = null_directions_figure({"all": simulate("gyro-calibration", 0, estimated="all")})
    assert len(figure.axes) == 2 * len(CHANGES) + 2
    assert render(figure, format="png").startswith(b"\x89PNG")
