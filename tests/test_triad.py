"""Sensor triads: the printed model, its inverse, other body axes, units."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import linalg

from navopt.errors import InvalidInput, UnknownName
from navopt.models import AccelerometerTriad, GyroTriad, ImuCalibration, SensorTriad, residual_error
from navopt.models.triad import DEGREE_PER_HOUR, MISALIGNMENT_INDEX, PARAMETER_NAMES

E = [[1.0, 0.00099183, 0.00010717], [-0.00037044, 1.0, 0.00014048], [0.00010505, -0.00041586, 1.0]]
PRESET = GyroTriad.from_paper_units(
    [643.50373651, 645.62852456, 645.17583651], E, [0.01562779, 0.03213767, 0.02793626]
)


def rough(seed, size=0.2):
    rng = np.random.default_rng(seed)
    misalignment = np.eye(3) + size * rng.uniform(-1, 1, (3, 3)) * (1 - np.eye(3))
    return SensorTriad(rng.uniform(0.5, 2.0, 3) * [1, -1, 1], misalignment, rng.normal(size=3))


def test_forward_is_equation_11_element_by_element():
    """Printed matrix K E with its own element names, biases scaled as Tables 2 and 3 need."""
    k = dict(zip("xyz", PRESET.paper_units()[0], strict=True))
    e = {"xz": E[0][1], "xy": E[0][2], "yz": E[1][0], "yx": E[1][2], "zy": E[2][0], "zx": E[2][1]}
    w, b = np.array([3.0, -7.0, 12.0]), PRESET.paper_units()[2]
    expected = [
        k["x"] * w[0] + k["x"] * e["xz"] * w[1] + k["x"] * e["xy"] * w[2] + k["x"] * b[0],
        k["y"] * e["yz"] * w[0] + k["y"] * w[1] + k["y"] * e["yx"] * w[2] + k["y"] * b[1],
        k["z"] * e["zy"] * w[0] + k["z"] * e["zx"] * w[1] + k["z"] * w[2] + k["z"] * b[2],
    ]
    np.testing.assert_allclose(PRESET.forward(w * DEGREE_PER_HOUR), expected, rtol=1e-13)


@pytest.mark.parametrize("seed", range(5))
def test_the_inverse_undoes_forward(seed):
    triad, x = rough(seed), np.random.default_rng(seed).normal(size=(4, 5, 3))
    np.testing.assert_allclose(triad.inverse(triad.forward(x)), x, rtol=1e-11, atol=1e-12)
    np.testing.assert_allclose(
        triad.inverse(x), np.linalg.solve(triad.matrix, (x - triad.scale * triad.bias)[..., None])[..., 0]
    )


def test_parameters_have_names_places_and_one_order():
    vector = np.arange(1.0, 13.0)
    triad = SensorTriad.from_vector(vector)
    np.testing.assert_array_equal(triad.vector, vector)
    for name, (row, column) in MISALIGNMENT_INDEX.items():
        assert triad.misalignment[row, column] == vector[PARAMETER_NAMES.index(name)]
        assert name == "misalignment_" + "xyz"[row] + "xyz"[column]
    for place, name in enumerate(PARAMETER_NAMES):
        changed = triad.replace(**{name: -5.0})
        np.testing.assert_array_equal(np.flatnonzero(changed.vector != vector), [place])
    assert triad.replace(bias=[0, 0, 1]).bias[2] == 1.0


def test_paper_units_come_back():
    scale, misalignment, bias = PRESET.paper_units()
    np.testing.assert_allclose(scale, [643.50373651, 645.62852456, 645.17583651])
    np.testing.assert_array_equal(misalignment, E)
    np.testing.assert_allclose(bias, [0.01562779, 0.03213767, 0.02793626])
    # a bias of 1 deg/h is seen with a scale factor's worth of counts
    assert PRESET.replace(bias=np.full(3, DEGREE_PER_HOUR)).forward(np.zeros(3)) == pytest.approx(scale)


@pytest.mark.parametrize("frame", ["lower-triangular", "symmetric"])
@pytest.mark.parametrize("seed", range(4))
def test_another_frame_is_the_same_block_turned(frame, seed):
    triad = rough(seed, 0.1)
    turned = triad.in_frame(frame)
    rotation = np.linalg.solve(triad.matrix, turned.matrix)
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(rotation) == pytest.approx(1.0)
    counts = np.random.default_rng(seed).normal(size=(20, 3))
    np.testing.assert_allclose(
        np.linalg.norm(turned.inverse(counts), axis=1), np.linalg.norm(triad.inverse(counts), axis=1)
    )
    np.testing.assert_allclose(turned.in_frame(frame).vector, turned.vector, atol=1e-12)


def test_conventions_are_what_they_say():
    lower = PRESET.in_frame("lower-triangular").misalignment
    np.testing.assert_array_equal(lower[np.triu_indices(3, 1)], 0.0)
    symmetric = PRESET.in_frame("symmetric")
    np.testing.assert_allclose(symmetric.misalignment, symmetric.misalignment.T, atol=1e-15)
    # against scipy: the symmetric factor of the polar decomposition of E in its own scales
    factor = linalg.polar(PRESET.matrix / symmetric.scale[:, None], side="left")[1]
    np.testing.assert_allclose(symmetric.misalignment, factor, atol=1e-13)


def test_accelerometers_turn_the_whole_unit():
    gyro, accelerometer = rough(1, 0.1), rough(2, 0.1)
    unit = ImuCalibration.of(
        GyroTriad.from_vector(gyro.vector), AccelerometerTriad.from_vector(accelerometer.vector)
    )
    turned = unit.in_frame("lower-triangular")
    assert (turned.accelerometer.misalignment[np.triu_indices(3, 1)] == 0.0).all()
    counts = np.random.default_rng(3).normal(size=(2, 20, 3))
    for one in (unit, turned):
        rates, forces = one.gyro.inverse(counts[0]), one.accelerometer.inverse(counts[1])
        product = np.sum(rates * forces, axis=1)
        if one is unit:
            expected = product
    np.testing.assert_allclose(product, expected, rtol=1e-9)
    np.testing.assert_array_equal(unit.vector, np.concatenate([gyro.vector, accelerometer.vector]))


def test_residual_error_is_what_a_wrong_calibration_does():
    assert np.abs(residual_error(PRESET, PRESET, np.eye(3))).max() < 1e-15
    x = np.array([[1.0, 2.0, 3.0]])
    wrong = PRESET.replace(scale=PRESET.scale * 1.001, bias=PRESET.bias + 0.5)
    shown = np.linalg.solve(np.array(E), (x[0] @ np.array(E).T + PRESET.bias) / 1.001 - PRESET.bias - 0.5)
    np.testing.assert_allclose(residual_error(wrong, PRESET, x)[0], shown - x[0], rtol=1e-9)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (([1, 1], np.eye(3), np.zeros(3)), "scale"),
        (([1, 0, 1], np.eye(3), np.zeros(3)), "zero measures nothing"),
        (([1, 1, 1], 2 * np.eye(3), np.zeros(3)), "diagonal must be one"),
        (([1, 1, 1], np.eye(3), [0, np.nan, 0]), "bias"),
    ],
)
def test_impossible_triads_are_refused(arguments, message):
    with pytest.raises(InvalidInput, match=message):
        SensorTriad(*arguments)


def test_other_mistakes_are_named():
    with pytest.raises(UnknownName, match="misalignment_xx"):
        PRESET.replace(misalignment_xx=1.0)
    with pytest.raises(UnknownName, match="upper"):
        PRESET.in_frame("upper")
    flat = SensorTriad(np.ones(3), [[1, 1, 0], [1, 1, 0], [0, 0, 1]], np.zeros(3))
    with pytest.raises(InvalidInput, match="same axis"):
        flat.inverse([1.0, 2.0, 3.0])
    with pytest.raises(InvalidInput, match="its own axis"):
        SensorTriad.from_matrix([[0, 1, 0], [1, 0, 0], [0, 0, 1]], np.zeros(3))
    with pytest.raises(InvalidInput, match="twelve"):
        SensorTriad.from_vector(np.ones(11))
    assert not PRESET.scale.flags.writeable
