"""Grids of the ICGEM service, written here as its public description and files lay them out."""

from __future__ import annotations

import numpy as np
import pytest

from navopt.data import read_map
from navopt.data.icgem import icgem_header, read_icgem
from navopt.errors import InvalidInput
from navopt.models import FieldMap

KEYS = """\
generating_institute     gfz-potsdam
     generating_date     2024/05/06
        product_type     gravity_field
                body     earth
           modelname     EXAMPLE
     max_used_degree           720
         tide_system     tide_free
          functional     {functional}  (centrifugal term included)
                unit     {unit}
          refsysname     WGS84
       long_lat_unit     degree
      latlimit_north       22.000000000000
      latlimit_south       21.000000000000
      longlimit_west       {west}
      longlimit_east       {east}
            gridstep       0.50000000000000
     height_over_ell          0.0000 m
  latitude_parallels             3
 longitude_parallels             4
number_of_gridpoints            12
            gapvalue        9999999.0000
            maxvalue      1.2E+01 {unit}
         grid_format     {layout}

          longitude    latitude     {functional}
            [deg.]      [deg.]         [{unit}]
end_of_head ============================================
"""
LATITUDES = (22.0, 21.5, 21.0)


def value(i, j):
    return 10.0 * i + j - 12.5


def icgem(
    path, *, west=150.0, functional="gravity_anomaly", unit="mgal", height=False, factor=1.0, change=None
):
    """Three parallels from the north, four meridians from the west, half a degree apart."""
    text = KEYS.format(
        functional=functional,
        unit=unit,
        west=west,
        east=west + 1.5,
        layout="long_lat_h_value" if height else "long_lat_value",
    )
    for i, latitude in enumerate(LATITUDES):
        for j in range(4):
            middle = f"{-3000.0:12.3f} " if height else ""
            text += f"{west + 0.5 * j:18.4f} {latitude:10.4f} {middle}{factor * value(i, j):16.6E}\n"
    path.write_text(change(text) if change else text, encoding="ascii")
    return path


def check(field, west=150.0):
    assert field.unit == "mGal"
    assert field.shape == (3, 4)
    assert field.bounds_deg == (west, west + 1.5, 21.0, 22.0)
    expected = [[value(i, j) for j in range(4)] for i in (2, 1, 0)]  # rows from the south
    np.testing.assert_allclose(field.values, expected, rtol=1e-6)


@pytest.mark.parametrize("height", [False, True])
def test_rows_run_from_north_to_south(tmp_path, height):
    field = read_map(icgem(tmp_path / "a.gdf", height=height))
    check(field)
    assert field.name == "a.gdf (gravity_anomaly)"
    # 22 N, 150.5 E is the second node of the first line of the file
    assert float(field.value(np.radians(22.0), np.radians(150.5))) == pytest.approx(value(0, 1))


@pytest.mark.parametrize("west", [-10.0, 0.0, 179.0, 350.0])
def test_any_turn_of_the_longitude(tmp_path, west):
    check(read_map(icgem(tmp_path / "a.gdf", west=west)), west)


def test_longitudes_that_jump_at_the_date_line(tmp_path):
    def jump(text):
        head, mark, body = text.partition("end_of_head")
        return head + mark + body.replace("180.5000", "-179.5000")

    check(read_map(icgem(tmp_path / "a.gdf", west=179.0, change=jump)), 179.0)


def test_units_are_converted(tmp_path):
    check(read_map(icgem(tmp_path / "a.gdf", unit="m/s**2", factor=1e-5)))
    check(read_map(icgem(tmp_path / "b.gdf", unit="meter", factor=1e-3), unit="Gal"))
    with pytest.raises(InvalidInput, match="meter"):
        read_map(icgem(tmp_path / "c.gdf", unit="meter", functional="height_anomaly"))
    assert read_map(tmp_path / "c.gdf", unit="m").unit == "m"


def test_the_header_is_kept_as_it_stands(tmp_path):
    header = icgem_header(icgem(tmp_path / "a.gdf"))
    assert header["functional"] == "gravity_anomaly  (centrifugal term included)"
    assert header["latitude_parallels"] == "3"
    assert "longitude" not in header


def test_any_order_of_the_nodes_is_understood(tmp_path):
    """From south to north, and meridian by meridian."""

    def turned(text):
        head, mark, body = text.partition("=\n")
        lines = body.splitlines()
        return head + mark + "\n".join(lines[k] for j in range(4) for k in range(8 + j, -1, -4)) + "\n"

    check(read_map(icgem(tmp_path / "a.gdf", change=turned)))


def cut(lines):
    return lambda text: "\n".join(text.splitlines()[:-lines]) + "\n"


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        (cut(1), "11 nodes on 3 parallels and 4 meridians"),
        (cut(4), "2 where the header's latitude_parallels says 3"),
        (cut(12), "0 nodes"),
        (lambda text: text.replace("end_of_head", "end of head"), "not a map"),
        (lambda text: text.replace("1.500000E+00", "one"), "every line after the header"),
        (lambda text: text.replace("long_lat_value", "lat_long_value"), "grid_format"),
        (lambda text: text.replace("long_lat_value", "long_lat_h_value"), "too few"),
        (lambda text: text.replace("-2.500000E+00", "9999999.0000"), "1 cells without a value"),
        (lambda text: text.replace("   21.5000", "   21.4000"), "uniform"),
    ],
)
def test_damaged_files_are_refused(tmp_path, change, expected):
    with pytest.raises(InvalidInput, match=expected):
        read_map(icgem(tmp_path / "a.gdf", change=change))


def test_a_grid_has_one_field(tmp_path):
    with pytest.raises(InvalidInput, match="one field"):
        read_map(icgem(tmp_path / "a.gdf"), "gravity_anomaly")
    with pytest.raises(InvalidInput, match="no such file"):
        read_icgem(tmp_path / "none.gdf")
    (tmp_path / "text.gdf").write_text("hello")
    with pytest.raises(InvalidInput, match="end_of_head"):
        read_icgem(tmp_path / "text.gdf")


def test_netcdf_comes_through_the_same_door(tmp_path):
    field = FieldMap.embedded(720).crop((150.0, 151.0, 20.0, 21.0))
    field.to_netcdf(tmp_path / "map.grd")
    back = read_map(tmp_path / "map.grd")
    np.testing.assert_array_equal(back.values, field.values)
    assert back.sha256 == field.sha256
