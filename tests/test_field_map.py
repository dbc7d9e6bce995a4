"""The field map: look-up against scipy, borders, longitudes, immutability, files and their faults."""

import copy
import pickle

import numba
import numpy as np
import pytest
import xarray as xr
from scipy.interpolate import RegularGridInterpolator
from scipy.ndimage import map_coordinates

from navopt.errors import InvalidInput, UnknownName
from navopt.models import field_map
from navopt.models.field_map import FieldMap

METHODS = ("bilinear", "bicubic")


@pytest.fixture(scope="module")
def rough():
    """A small map of noise: nothing smooth that could hide an index error."""
    rng = np.random.default_rng(7)
    return FieldMap.from_degrees(
        np.linspace(10, 13, 31), np.linspace(100, 104, 41), rng.normal(0, 40, (31, 41)), name="rough"
    )


@pytest.fixture(scope="module")
def points(rough):
    """Points all over the map, with every border and corner among them."""
    rng = np.random.default_rng(8)
    lat = rng.uniform(rough.latitude[0], rough.latitude[-1], 4000)
    lon = rng.uniform(rough.longitude[0], rough.longitude[-1], 4000)
    lat[:200], lat[200:400] = rough.latitude[0], rough.latitude[-1]
    lon[100:300], lon[300:500] = rough.longitude[0], rough.longitude[-1]
    return lat, lon


def indices(field, lat, lon):
    _, lat0, lon0, dlat, dlon = field.grid
    return np.array([(lat - lat0) / dlat, (lon - lon0) / dlon])


# ---- look-up -------------------------------------------------------------------------------------


def test_bilinear_is_scipys(rough, points):
    other = RegularGridInterpolator((rough.latitude, rough.longitude), rough.values)
    np.testing.assert_allclose(rough.value(*points), other(np.stack(points, -1)), rtol=0, atol=1e-10)


@pytest.mark.parametrize(("method", "order"), [("bilinear", 1), ("bicubic", 3)])
def test_both_are_map_coordinates(rough, points, method, order):
    at = np.clip(indices(rough, *points), 0, np.array(rough.shape)[:, None] - 1)
    other = map_coordinates(rough.values, at, order=order, mode="mirror")
    np.testing.assert_allclose(rough.value(*points, method), other, rtol=0, atol=1e-10)
    assert np.abs(rough.value(*points, method) - other).max() / np.abs(rough.values).max() < 1e-12


@pytest.mark.parametrize("method", METHODS)
def test_nodes_are_reproduced(rough, method):
    lat, lon = np.meshgrid(rough.latitude, rough.longitude, indexing="ij")
    np.testing.assert_allclose(rough.value(lat, lon, method), rough.values, rtol=0, atol=1e-9)


def test_bilinear_reproduces_a_linear_field():
    lat, lon = np.radians(np.linspace(-3, 4, 50)), np.radians(np.linspace(170, 190, 80))
    field = FieldMap(lat, lon, 3 * lat[:, None] - 5 * lon + 2)
    rng = np.random.default_rng(1)
    at = rng.uniform(lat[0], lat[-1], 500), rng.uniform(lon[0], lon[-1], 500)
    np.testing.assert_allclose(field.value(*at), 3 * at[0] - 5 * at[1] + 2, rtol=0, atol=2e-14)
    north, east = field.gradient(*at)
    np.testing.assert_allclose(north, 3, atol=1e-10)
    np.testing.assert_allclose(east, -5, atol=1e-10)


def test_bicubic_reproduces_a_linear_field_inside():
    lat, lon = np.radians(np.linspace(-3, 4, 80)), np.radians(np.linspace(0, 20, 80))
    field = FieldMap(lat, lon, 3 * lat[:, None] - 5 * lon + 2, method="bicubic")
    # Mirroring bends the field at the border; the bend dies out by a factor of 3.7 a cell.
    rng = np.random.default_rng(1)
    at = rng.uniform(lat[30], lat[-30], 500), rng.uniform(lon[30], lon[-30], 500)
    np.testing.assert_allclose(field.value(*at), 3 * at[0] - 5 * at[1] + 2, rtol=0, atol=1e-13)


@pytest.mark.parametrize("method", METHODS)
def test_gradient_is_the_difference_quotient(rough, points, method):
    lat, lon = points[0][500:], points[1][500:]
    row, column = indices(rough, lat, lon)
    # The bilinear derivative jumps on grid lines, so stay off them.
    off = (np.abs(row - np.round(row)) > 1e-3) & (np.abs(column - np.round(column)) > 1e-3)
    lat, lon = lat[off], lon[off]
    h = 1e-4 * rough.grid[3]
    north, east = rough.gradient(lat, lon, method)
    by_lat = (rough.value(lat + h, lon, method) - rough.value(lat - h, lon, method)) / (2 * h)
    by_lon = (rough.value(lat, lon + h, method) - rough.value(lat, lon - h, method)) / (2 * h)
    scale = np.abs(np.concatenate([north, east])).max()
    np.testing.assert_allclose(north, by_lat, rtol=0, atol=1e-6 * scale)
    np.testing.assert_allclose(east, by_lon, rtol=0, atol=1e-6 * scale)


@pytest.mark.parametrize("method", METHODS)
def test_bits_do_not_depend_on_the_batch(rough, points, method):
    lat, lon = points
    many = rough.value(lat, lon, method)
    north, east = rough.gradient(lat, lon, method)
    for k in range(0, lat.size, 97):
        assert rough.value(lat[k], lon[k], method) == many[k]
        assert rough.gradient(lat[k], lon[k], method) == (north[k], east[k])
    order = np.random.default_rng(3).permutation(lat.size)[:1001]
    assert np.array_equal(rough.value(lat[order], lon[order], method), many[order])


def test_points_broadcast(rough):
    lat, lon = np.radians([[10.5], [11.5], [12.5]]), np.radians([100.5, 101.5])
    assert rough.value(lat, lon).shape == (3, 2)
    assert rough.contains(lat, lon).shape == (3, 2)
    assert rough.gradient(lat, lon)[1].shape == (3, 2)
    assert isinstance(rough.value(lat[0, 0], lon[0]), np.float64)
    assert rough.value(np.empty((0, 3)), np.empty((0, 3))).shape == (0, 3)
    assert rough.value(lat[:, ::-1].T, 1.76).shape == (1, 3)
    with pytest.raises(InvalidInput, match="broadcast"):
        rough.value(np.zeros(2), np.zeros(3))


# ---- where the map ends --------------------------------------------------------------------------


@pytest.mark.parametrize("method", METHODS)
def test_outside_is_nan_and_the_last_line_is_inside(rough, method):
    west, east, south, north = np.radians(rough.bounds_deg)
    corner_lat, corner_lon = np.array([south, south, north, north]), np.array([west, east, west, east])
    corners = rough.values[[0, 0, -1, -1], [0, -1, 0, -1]]
    np.testing.assert_allclose(rough.value(corner_lat, corner_lon, method), corners, atol=1e-9)
    assert rough.covers(corner_lat, corner_lon)
    small = 1e-6 * rough.grid[3]
    lat = np.array([south - small, north + small, south, south, np.nan, 0.2, np.inf, 0.2, -np.inf])
    lon = np.array([west, west, west - small, east + small, 1.77, np.nan, 1.77, np.inf, 1.77])
    assert np.isnan(rough.value(lat, lon, method)).all()
    assert np.isnan(rough.gradient(lat, lon, method)).all()
    assert not rough.contains(lat, lon).any()
    assert not rough.covers(np.append(corner_lat, lat[0]), np.append(corner_lon, lon[0]))


def test_longitudes_are_the_same_modulo_a_turn():
    values = np.random.default_rng(0).normal(size=(5, 21))
    written = [np.linspace(170, 190, 21), np.linspace(-190, -170, 21)]
    for lon in written:
        field = FieldMap.from_degrees(np.arange(5), lon, values)
        for degrees in (190, -170, 170, -190, 180, -180, 530):
            column = round((degrees - 170) % 360)
            got = field.value(np.radians(2.0), np.radians(degrees))
            assert got == pytest.approx(values[2, column], abs=1e-9)
        assert np.isnan(field.value(np.radians(2.0), np.radians([169.9, -169.9, 0.0]))).all()


def test_a_closed_map_has_no_seam():
    lon = np.arange(0, 361, 10)
    field = FieldMap.from_degrees([-10, 0, 10], lon, np.tile(np.cos(np.radians(lon)), (3, 1)))
    at = np.radians(np.linspace(-400, 400, 333))
    np.testing.assert_allclose(field.value(0.0, at), np.cos(at), atol=0.005)


# ---- what it is ----------------------------------------------------------------------------------


def test_it_cannot_be_changed(rough):
    for array in (rough.values, rough.latitude, rough.longitude, rough.spline_grid[0]):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1
    with pytest.raises(AttributeError, match="immutable"):
        rough.unit = "m"
    with pytest.raises(AttributeError, match="immutable"):
        del rough.unit
    assert copy.deepcopy(rough) is rough
    assert copy.copy(rough) is rough
    given = np.zeros((2, 2))
    field = FieldMap.from_degrees([0, 1], [0, 1], given)
    given[:] = 9
    assert field.statistics()["max"] == 0


def test_pickle_keeps_every_bit(rough, points):
    back = pickle.loads(pickle.dumps(rough))
    assert repr(back) == repr(rough)
    assert back.sha256 == rough.sha256
    for method in METHODS:
        assert np.array_equal(back.value(*points, method), rough.value(*points, method))


def test_embedded_maps_travel_by_name():
    field = FieldMap.embedded(720)
    assert len(pickle.dumps(field)) < 200
    assert pickle.loads(pickle.dumps(field)) is field
    assert FieldMap.embedded(720) is field
    assert FieldMap.embedded(720, method="bicubic").method == "bicubic"
    with pytest.raises(InvalidInput, match="free_air_anomaly"):
        FieldMap.embedded(360)


def test_description(rough):
    assert rough.bounds_deg == (100.0, 104.0, 10.0, 13.0)
    assert rough.step_deg == (0.1, 0.1)
    assert rough.shape == (31, 41)
    assert "rough" in repr(rough)
    assert "31 x 41" in repr(rough)
    assert rough.statistics()["std"] == rough.values.std()


def test_checksum_sees_values_axes_and_unit(rough):
    def make(shift=0.0, change=0.0, unit="mGal"):
        values = np.arange(6.0).reshape(2, 3)
        values[0, 0] += change
        return FieldMap.from_degrees([0 + shift, 1 + shift], [0, 1, 2], values, unit=unit).sha256

    assert make() == "84399f18efd9f8c232b1273407a5c4faae56bc1c4637e0e1ace59fc72177763d"
    assert len({make(), make(shift=1e-6), make(change=1e-12), make(unit="m")}) == 4


def test_crop(rough):
    part = rough.crop((101.05, 102.0, 10.9, 12.0))
    assert part.bounds_deg == (101.0, 102.0, 10.9, 12.0)
    assert part.unit == rough.unit
    at = np.radians([10.95, 11.234, 12.0]), np.radians([101.06, 101.5, 102.0])
    np.testing.assert_allclose(part.value(*at), rough.value(*at), atol=1e-9)
    assert rough.crop(rough.bounds_deg).sha256 == rough.sha256
    for bad in ((99, 102, 11, 12), (101, 101, 11, 12), (101, 102, 12, 11)):
        with pytest.raises(InvalidInput, match="region_deg"):
            rough.crop(bad)


def test_wrong_input_is_named(rough):
    good = np.radians([0.0, 1.0, 2.0])
    z = np.zeros((3, 3))
    hole = z.copy()
    hole[1, 2] = np.nan
    cases = [
        ((np.radians([0, 1, 3]), good, z), "uniform"),
        ((good[::-1], good, z), "ascending"),
        ((good, good[::-1], z), "ascending"),
        ((good[:1], good, z[:1]), "two grid lines"),
        ((good * [1, np.nan, 1], good, z), "finite"),
        (([20, 21, 22], good, z), "from_degrees"),
        ((good, [140, 141, 142], z), "from_degrees"),
        ((good, good, z[:2]), r"\(3, 3\)"),
        ((good, good, hole), r"1 cells.*1\.0000°, 2\.0000°"),
    ]
    for arguments, pattern in cases:
        with pytest.raises(InvalidInput, match=pattern):
            FieldMap(*arguments)
    with pytest.raises(UnknownName, match="bicubic"):
        FieldMap(good, good, z, method="cubic")
    with pytest.raises(UnknownName, match="bilinear"):
        rough.value(0.2, 1.76, "bilinaer")


def test_kernels_serve_other_kernels(rough, points):
    @numba.njit
    def mean(values, lat0, lon0, dlat, dlon, coefficients, lat, lon):
        total = 0.0
        for k in range(lat.size):
            row, column = field_map.fractional_index(lat[k], lon[k], lat0, lon0, dlat, dlon, *values.shape)
            total += field_map.bilinear_at(values, row, column)
            total += field_map.bspline_at(coefficients, row, column)
        return total / lat.size

    expected = np.mean(rough.value(*points) + rough.value(*points, "bicubic"))
    assert mean(*rough.grid, rough.spline_grid[0], *points) == pytest.approx(expected, abs=1e-9)
    value, by_row, by_column = field_map.bspline_gradient_at(rough.spline_grid[0], 3.25, 7.5)
    assert value == field_map.bspline_at(rough.spline_grid[0], 3.25, 7.5)
    assert np.isfinite([by_row, by_column]).all()
    assert field_map.bilinear_gradient_at(rough.values, 3.25, 7.5)[0] == field_map.bilinear_at(
        rough.values, 3.25, 7.5
    )
    for off in ((-0.1, 0.0), (0.0, 40.1), (np.nan, 0.0)):
        assert np.isnan(field_map.bilinear_at(rough.values, *off))
        assert np.isnan(field_map.bspline_gradient_at(rough.spline_grid[0], *off)).all()


# ---- files ---------------------------------------------------------------------------------------


def dataset(values, lat, lon, names=("lat", "lon", "z"), units="mGal", **attributes):
    y, x, z = names
    named = {} if units is None else {"units": units}
    return xr.Dataset({z: ((y, x), values, named)}, coords={y: lat, x: lon}, attrs=attributes)


@pytest.fixture
def base():
    values = np.random.default_rng(2).normal(0, 30, (4, 5))
    return values, np.array([10.0, 10.5, 11.0, 11.5]), np.array([150.0, 150.5, 151.0, 151.5, 152.0])


def test_round_trip(rough, points, tmp_path):
    path = tmp_path / "map.nc"
    rough.to_netcdf(path)
    back = FieldMap.from_netcdf(path, name="rough")
    assert back.sha256 == rough.sha256
    assert repr(back) == repr(rough)
    np.testing.assert_allclose(back.value(*points), rough.value(*points), atol=1e-9)
    with xr.open_dataset(path, engine="h5netcdf") as data:
        assert data["z"].attrs["units"] == "mGal"
        assert data["lat"].attrs["units"] == "degrees_north"
        assert np.array_equal(data["z"].values, rough.values)


@pytest.mark.parametrize("engine", ["h5netcdf", "scipy"])
@pytest.mark.parametrize(
    "names", [("lat", "lon", "z"), ("latitude", "longitude", "anomaly"), ("y", "x", "z")]
)
def test_both_formats_and_all_names(base, tmp_path, engine, names):
    path = tmp_path / "map.grd"
    dataset(*base, names=names).to_netcdf(path, engine=engine)
    back = FieldMap.from_netcdf(path)
    np.testing.assert_allclose(back.values, base[0])
    assert back.bounds_deg == (150.0, 152.0, 10.0, 11.5)
    assert back.name == "map.grd"


def test_descending_and_transposed(base, tmp_path):
    values, lat, lon = base
    path = tmp_path / "map.nc"
    dataset(values[::-1, ::-1], lat[::-1], lon[::-1]).transpose().to_netcdf(path, engine="h5netcdf")
    np.testing.assert_array_equal(FieldMap.from_netcdf(path).values, values)


def test_longitudes_of_files(base):
    values, lat, _ = base
    around = FieldMap.from_xarray(dataset(values, lat, [178.0, 179.0, -180.0, -179.0, -178.0]))
    assert around.bounds_deg[:2] == (178.0, 182.0)
    same = FieldMap.from_xarray(dataset(values, lat, [178.0, 179.0, 180.0, 181.0, 182.0]))
    assert same.sha256 == around.sha256
    for degrees in (-178.5, 181.5):
        expected = (values[1, 3] + values[1, 4]) / 2
        assert same.value(np.radians(10.5), np.radians(degrees)) == pytest.approx(expected, abs=1e-9)
    for lon in (np.arange(0, 360, 72.0), np.arange(-180, 180, 72.0)):
        globe = FieldMap.from_xarray(dataset(values, lat, lon))
        assert globe.shape == (4, 6)
        at = np.radians(lon[-1] + 36)
        assert globe.value(np.radians(10.5), at) == pytest.approx((values[1, 4] + values[1, 0]) / 2)


@pytest.mark.parametrize(
    ("units", "factor"),
    [("mGal", 1), ("milligal", 1), ("m/s^2", 1e5), ("m s-2", 1e5), ("m s**-2", 1e5), ("µm/s²", 0.1),
     ("um s-2", 0.1), ("Gal", 1000), ("cm s-2", 1000), ("nm s-2", 1e-4), ("µGal", 1e-3)],
)  # fmt: skip
def test_units_become_milligal(base, units, factor):
    field = FieldMap.from_xarray(dataset(*base, units=units))
    np.testing.assert_allclose(field.values, base[0] * factor)
    assert field.unit == "mGal"


def test_unknown_units_ask(base):
    for units in (None, "parsec"):
        with pytest.raises(InvalidInput, match="unit='mGal'"):
            FieldMap.from_xarray(dataset(*base, units=units))
        assert FieldMap.from_xarray(dataset(*base, units=units), unit="m/s2").unit == "mGal"
    terrain = FieldMap.from_xarray(dataset(*base, units=None), unit="m")
    assert terrain.unit == "m"
    np.testing.assert_array_equal(terrain.values, base[0])


def test_packed_integers_and_holes(base, tmp_path):
    values, lat, lon = base
    path = tmp_path / "packed.nc"
    packing = {"dtype": "int16", "scale_factor": 0.01, "add_offset": 5.0, "_FillValue": np.int16(-32768)}
    dataset(values, lat, lon).to_netcdf(path, engine="h5netcdf", encoding={"z": packing})
    np.testing.assert_allclose(FieldMap.from_netcdf(path).values, values, atol=0.00501)
    values = values.copy()
    values[2, 1:3] = np.nan
    dataset(values, lat, lon).to_netcdf(path, engine="h5netcdf", encoding={"z": packing})
    with pytest.raises(InvalidInput, match=r"2 cells.*11\.0000°, 150\.5000°.*grdfill"):
        FieldMap.from_netcdf(path)


def test_pixel_registration(base):
    values, lat, lon = base
    data = dataset(values, lat, lon, node_offset=1)
    data["lat"].attrs["actual_range"] = np.array([9.75, 11.75])
    data["lon"].attrs["actual_range"] = np.array([149.75, 152.25])
    assert FieldMap.from_xarray(data).bounds_deg == (150.0, 152.0, 10.0, 11.5)
    data["lon"].attrs["actual_range"] = np.array([150.0, 152.0])
    with pytest.raises(InvalidInput, match="centres"):
        FieldMap.from_xarray(data)


@pytest.mark.parametrize(
    ("offset", "bounds"), [(0, (150.0, 152.0, 10.0, 11.5)), (1, (150.2, 151.8, 10.1875, 11.3125))]
)
def test_gmt_before_version_4(base, tmp_path, offset, bounds):
    values, lat, lon = base
    old = xr.Dataset(
        {
            "x_range": ("side", lon[[0, -1]]),
            "y_range": ("side", lat[[0, -1]]),
            "spacing": ("side", [0.5, 0.5]),
            "dimension": ("side", np.array([5, 4], dtype=np.int32)),
            "z": ("xysize", values[::-1].ravel(), {"scale_factor": 1.0, "node_offset": np.int32(offset)}),
        }
    )
    path = tmp_path / "old.grd"
    old.to_netcdf(path, engine="scipy")
    field = FieldMap.from_netcdf(path, unit="mGal")
    assert field.bounds_deg == bounds
    np.testing.assert_array_equal(field.values, values)


def test_single_precision_axes(base):
    values = np.zeros((4, 541))
    lon = np.linspace(147.6, 156.6, 541).astype(np.float32)
    field = FieldMap.from_xarray(dataset(values, base[1].astype(np.float32), lon))
    assert field.step_deg[1] == pytest.approx(1 / 60, abs=1e-7)


def test_faults_of_files(base, tmp_path):
    values, lat, lon = base
    with pytest.raises(InvalidInput, match="no such file"):
        FieldMap.from_netcdf(tmp_path / "none.nc")
    (tmp_path / "text.nc").write_text("hello")
    with pytest.raises(InvalidInput, match="not NetCDF"):
        FieldMap.from_netcdf(tmp_path / "text.nc")
    with pytest.raises(InvalidInput, match="resample"):
        FieldMap.from_xarray(dataset(values, np.array([10, 10.5, 11.2, 11.5]), lon))
    with pytest.raises(InvalidInput, match="monotonic"):
        FieldMap.from_xarray(dataset(values, np.array([10, 11, 10.5, 11.5]), lon))
    with pytest.raises(InvalidInput, match="at least two"):
        FieldMap.from_xarray(dataset(values[:1], lat[:1], lon))
    two = dataset(values, lat, lon, names=("lat", "lon", "a"))
    two["b"] = two["a"] * 2
    with pytest.raises(InvalidInput, match="a, b"):
        FieldMap.from_xarray(two)
    np.testing.assert_array_equal(FieldMap.from_xarray(two, "b", unit="mGal").values, values * 2)
    with pytest.raises(InvalidInput, match="a, b"):
        FieldMap.from_xarray(two, "c")
    with pytest.raises(InvalidInput, match="rename"):
        FieldMap.from_xarray(dataset(values, lat, lon, names=("rows", "lon", "z")))
    stack = dataset(values, lat, lon).expand_dims(time=2)
    with pytest.raises(InvalidInput, match="one map"):
        FieldMap.from_xarray(stack)
    np.testing.assert_array_equal(FieldMap.from_xarray(stack.isel(time=[0])).values, values)
