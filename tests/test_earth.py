"""Geometry of the ellipsoid against python-ins, against ECEF coordinates and against plain integration."""

import numpy as np
import pytest
from pyins import earth as pyins_earth
from pyins import transform
from scipy.integrate import solve_ivp

from navopt.errors import InvalidInput
from navopt.models import earth


def test_radii_gravity_and_rate_are_those_of_python_ins():
    latitude_deg = np.linspace(-89.0, 89.0, 37)
    meridian, prime_vertical = earth.principal_radii(np.radians(latitude_deg), depth=100.0)
    rn, re, _ = pyins_earth.principal_radii(latitude_deg, -100.0)
    np.testing.assert_allclose(meridian, rn, rtol=1e-14)
    np.testing.assert_allclose(prime_vertical, re, rtol=1e-14)
    gravity = earth.normal_gravity(np.radians(latitude_deg))
    np.testing.assert_allclose(gravity, pyins_earth.gravity(latitude_deg, 0.0), rtol=1e-14)
    assert earth.EARTH_RATE == pyins_earth.RATE


def test_constants():
    assert pytest.approx(1852.0, abs=0) == earth.NAUTICAL_MILE
    assert pytest.approx(1e-5, abs=0) == earth.MILLIGAL
    assert pytest.approx(np.radians(1 / 60), rel=1e-15) == earth.ARC_MINUTE
    assert pytest.approx(84.4, abs=0.05) == earth.SCHULER_PERIOD / 60
    # The nautical mile was one minute of latitude at 45°.
    assert earth.principal_radii(np.radians(45.0))[0] * earth.ARC_MINUTE == pytest.approx(1852.0, rel=1e-3)


def test_tangent_plane_round_trip_broadcasts():
    rng = np.random.default_rng(1)
    north, east = rng.uniform(-2e5, 2e5, (2, 4, 1, 5))
    latitude0, longitude0 = rng.uniform(-1.2, 1.2, (2, 3, 1))
    latitude, longitude = earth.to_geodetic(north, east, latitude0, longitude0)
    assert latitude.shape == longitude.shape == (4, 3, 5)
    n, e = earth.local_tangent_plane(latitude, longitude, latitude0, longitude0)
    np.testing.assert_allclose(n, np.broadcast_to(north, n.shape), atol=1e-8)
    np.testing.assert_allclose(e, np.broadcast_to(east, e.shape), atol=1e-8)


def test_tangent_plane_touches_the_ellipsoid():
    """Near the reference point the plane is the tangent plane of the Earth-centred coordinates."""
    latitude0, longitude0 = np.radians([20.0, 156.0])
    north, east = np.array([300.0, -500.0, 0.0]), np.array([400.0, 0.0, -700.0])
    latitude, longitude = earth.to_geodetic(north, east, latitude0, longitude0)
    lla = np.column_stack([np.degrees(latitude), np.degrees(longitude), np.zeros(3)])
    ned = transform.lla_to_ned(lla, [20.0, 156.0, 0.0])
    # The remainder is second order in the distance: d²/R = 0.08 m at 700 m.
    np.testing.assert_allclose(ned[:, :2], np.column_stack([north, east]), atol=0.08)


def test_separation_is_that_of_python_ins_and_antisymmetric():
    a, b = np.radians([20.0, 156.0]), np.radians([20.4, 155.7])
    expected = transform.compute_lla_difference([*np.degrees(a), 0.0], [*np.degrees(b), 0.0])
    np.testing.assert_allclose(earth.separation(*a, *b), expected[:2], rtol=1e-11)
    np.testing.assert_allclose(earth.separation(*b, *a), -expected[:2], rtol=1e-11)


@pytest.mark.parametrize("latitude_deg", [0.0, 20.0, -45.0, 59.0])
def test_distance_against_the_chord(latitude_deg):
    """Up to 50 km the geodesic is the chord times 1 + chord²/24R²: another path, by ECEF coordinates."""
    start = np.radians([latitude_deg, 10.0])
    bearing = np.radians(np.arange(0, 360, 15))
    latitude, longitude = earth.to_geodetic(5e4 * np.cos(bearing), 5e4 * np.sin(bearing), *start)

    def ecef(lat, lon):
        return transform.lla_to_ecef(np.column_stack([np.degrees(lat), np.degrees(lon), 0.0 * lat]))

    here = ecef(*np.tile(start[:, None], 24))
    chord = np.linalg.norm(ecef(latitude, longitude) - here, axis=1)
    geodesic = chord * (1.0 + chord**2 / 24.0 / 6.37e6**2)
    np.testing.assert_allclose(earth.distance(latitude, longitude, *start), geodesic, rtol=1e-5)


def test_the_date_line_is_no_edge():
    west, east = np.radians(179.9), np.radians(-179.9)
    n, e = earth.local_tangent_plane(0.1, east, 0.1, west)
    assert n == 0.0
    assert e == pytest.approx(np.radians(0.2) * earth.principal_radii(0.1)[1] * np.cos(0.1))
    assert earth.distance(0.1, east, 0.1, west) == pytest.approx(e)
    assert earth.separation(0.1, west, 0.1, east)[1] == pytest.approx(-e)


@pytest.mark.parametrize("azimuth_deg", [0.0, 45.0, 90.0, 90.0001, 180.0, 300.0])
def test_rhumb_line_against_integration(azimuth_deg):
    azimuth, start = np.radians(azimuth_deg), np.radians([20.0, 156.0])

    def rate(_, state):
        meridian, prime_vertical = earth.principal_radii(state[0])
        return [np.cos(azimuth) / meridian, np.sin(azimuth) / (prime_vertical * np.cos(state[0]))]

    travelled = np.array([0.0, 1e3, 1e5, 4.5e5, 1e6])
    run = solve_ivp(rate, (0.0, 1e6), start, method="DOP853", t_eval=travelled, rtol=1e-13, atol=1e-16)
    latitude, longitude = earth.rhumb_line(*start, azimuth, travelled)
    np.testing.assert_allclose(latitude, run.y[0], rtol=0, atol=1e-12)
    np.testing.assert_allclose(longitude, run.y[1], rtol=0, atol=1e-12)
    assert (latitude[0], longitude[0]) == tuple(start)


def test_rhumb_line_due_east_keeps_its_latitude():
    latitude, _ = earth.rhumb_line(0.7, 0.0, np.pi / 2, np.linspace(0.0, 1e6, 7))
    assert np.all(latitude == 0.7)


def test_rhumb_line_refuses_the_pole():
    with pytest.raises(InvalidInput, match="travelled"):
        earth.rhumb_line(np.radians(80.0), 0.0, 0.0, [1e5, 2e6])
