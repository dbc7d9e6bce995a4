"""Linear-Gaussian models: what is checked, and the conversion from filterpy."""

from __future__ import annotations

import pickle

import numpy as np
import pytest

from navopt.errors import InvalidInput
from navopt.models.linear_gaussian import LinearGaussianModel, check_covariance

F = np.array([[1.0, 0.1], [0.0, 1.0]])
H = np.array([[1.0, 0.0]])
Y = np.sin(np.arange(20.0))


def model(**changes) -> LinearGaussianModel:
    return LinearGaussianModel(**{"F": F, "H": H, "y": Y, **changes})


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"F": np.ones((2, 3))}, r"F: got shape \(2, 3\)"),
        ({"F": np.array([[1.0, np.inf], [0.0, 1.0]])}, r"F\[0, 1\]: got inf"),
        ({"F": np.stack([F] * 3)}, r"F: got shape \(3, 2, 2\).*20 of them"),
        ({"F": [["a"]]}, "F: .*give an array of numbers"),
        ({"H": np.array([[1.0, np.nan]])}, r"H\[0, 1\]: got nan"),
        ({"H": np.eye(2)}, r"H: got shape \(2, 2\)"),
        ({"G": np.ones((3, 1))}, r"G: got shape \(3, 1\)"),
        ({"B": np.ones((2, 1))}, "u: got None; B and u belong together"),
        ({"u": np.ones(20)}, "B: got None"),
        ({"B": np.ones((2, 1)), "u": np.ones(19)}, r"u: got shape \(19, 1\)"),
        ({"B": np.ones((2, 1)), "u": np.r_[np.ones(19), np.nan]}, r"u\[19, 0\]: got nan"),
        ({"x0": np.zeros(3)}, r"x0: got shape \(3,\)"),
        ({"x0": np.array([0.0, np.nan])}, r"x0\[1\]: got nan"),
        ({"P0": np.array([[1.0, 0.5], [0.4, 1.0]])}, r"P0\[0, 1\]: got 0.5, but P0\[1, 0\] = 0.4"),
        ({"P0": np.array([[1.0, 2.0], [2.0, 1.0]])}, "P0: .*eigenvalue -1"),
        ({"P0": np.diag([1.0, -1.0])}, r"P0\[1, 1\]: got -1"),
        ({"P0": np.eye(3)}, r"P0: got shape \(3, 3\)"),
        ({"y": np.r_[np.inf, Y]}, r"y\[0, 0\]: got inf"),
        ({"y": Y[:2]}, "y: got 2 steps of 1 channels; give more than 2"),
        ({"y": np.full(20, np.nan)}, r"y\[:, 0\]: got no measurement at all"),
        ({"y": np.stack([Y, np.full(20, np.nan)], 1), "H": np.eye(2)}, r"y\[:, 1\]: got no measurement"),
        ({"time": np.r_[np.arange(19.0), 30.0]}, r"time\[19\] - time\[18\]: got 12.0; the usual step is 1"),
        ({"time": np.zeros(20)}, r"time\[1\]: got 0.0; times must increase"),
        ({"F": np.diag([1.0, 1.2]), "P0": np.eye(2)}, "state 1 grows by a factor 1.2 each step"),
        ({"F": np.diag([1.0, 0.5])}, "P0: got None; state 1 cannot be seen"),
    ],
)
def test_what_cannot_be_used_is_named(changes, message) -> None:
    with pytest.raises(InvalidInput, match=message):
        model(**changes)


def test_what_is_unusual_but_sound_is_taken() -> None:
    # a constant state that nobody sees, a singular prior, missing measurements, steps that vary with F
    model(F=np.eye(2), P0=np.diag([1.0, 0.0]))
    assert np.isnan(model(y=np.where(Y > 0.9, np.nan, Y)).y).any()
    model(F=np.stack([F] * 20), time=np.cumsum(np.linspace(1.0, 2.0, 20)))
    assert not model().F.flags.writeable


def test_a_prior_nobody_gave_is_wide_in_the_states_own_units() -> None:
    here = model()
    millimetres = model(y=1e3 * Y)
    assert np.allclose(millimetres.P0, 1e6 * here.P0)
    assert here.P0[0, 0] == pytest.approx((10.0 * np.abs(Y).max()) ** 2)
    # a velocity can be as large as two measurements of opposite sign within one step
    assert here.P0[1, 1] == pytest.approx((10.0 * 2.0 * np.abs(Y).max() / 0.1) ** 2)


def test_a_pickled_model_is_the_same() -> None:
    again = pickle.loads(pickle.dumps(model()))
    assert np.array_equal(again.F, F)
    assert again.drive.shape == (20, 2)


def test_covariances_are_judged_whatever_their_units() -> None:
    units = np.diag([1e-9, 1e6])
    correlation = np.array([[1.0, 0.9], [0.9, 1.0]])
    assert check_covariance("Q", units @ correlation @ units, 2, definite=True).shape == (2, 2)
    with pytest.raises(InvalidInput, match=r"eigenvalue -0.5"):
        check_covariance("Q", units @ np.array([[1.0, 1.5], [1.5, 1.0]]) @ units, 2)


def test_a_filterpy_filter_becomes_a_model() -> None:
    filterpy = pytest.importorskip("filterpy.kalman")
    from navopt.filters.batch_kalman import BatchKalman

    rng = np.random.default_rng(3)
    kalman = filterpy.KalmanFilter(dim_x=2, dim_z=1, dim_u=1)
    kalman.F, kalman.H, kalman.B = F, H, np.array([[0.005], [0.1]])
    kalman.Q, kalman.R = np.array([[0.02, 0.01], [0.01, 0.03]]), np.array([[0.4]])
    kalman.x, kalman.P = np.array([[0.3], [-0.2]]), np.diag([2.0, 3.0])
    us = rng.normal(size=20)
    for first in (True, False):
        ours = LinearGaussianModel.from_filterpy(kalman, Y, us=us, predict_first=first)
        run = BatchKalman(ours).run(kalman.Q, kalman.R)
        import copy

        theirs = copy.deepcopy(kalman)
        for k, z in enumerate(Y):
            if first or k:
                theirs.predict(u=us[k])
            theirs.update(z)
            assert np.allclose(run.estimates[0, k], theirs.x[:, 0], rtol=1e-11, atol=1e-12)
            assert np.allclose(run.covariances[0, k], theirs.P, rtol=1e-11, atol=1e-12)
    assert np.array_equal(kalman.P, np.diag([2.0, 3.0]))
    with pytest.raises(InvalidInput, match="kalman: got dict"):
        LinearGaussianModel.from_filterpy({}, Y)
