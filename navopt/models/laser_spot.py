"""Heading from two laser spots, and from marks on the ground to check it: eqs (1)-(3) of paper 002.

A fan of laser light stands along the centre line of a roadway. Two receivers across the machine, `spacing`
apart along its axis, each see where the fan crosses them. The printed equations are missing from the copies
of the paper that a machine can read; its figures' geometry leaves no choice but the signs, which are here:
spots count to the right of the machine's axis, `rear` is the first, and angles are clockwise::

    angle = atan((rear - front) / spacing)                          eq (1)
    heading = angle + road heading                                  eq (2)
    angle on the ground = acos((a^2 + b^2 - c^2) / (2 a b))         eq (3)
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import ArrayLike, NDArray

from navopt.errors import InvalidInput

__all__ = [
    "LaserSpot",
    "SpotTest",
    "check_heading",
    "ground_angle",
    "ground_angle_sigma",
    "simulate_spot_test",
]

Array = NDArray[np.float64]

#: Largest number that can be a heading in rad: beyond it, somebody gave degrees.
TURN = 2.0 * np.pi


def check_heading(name: str, heading: ArrayLike, *, gaps: bool = False) -> Array:
    """Return headings in rad as an array, or refuse what cannot be any.

    Parameters
    ----------
    name : str
        Of the argument, for the message.
    heading : array_like
        Clockwise from north, rad, anywhere in (-2 pi, 2 pi): both ways of counting a turn will do.
    gaps : bool
        Whether NaN, a missing reading, is allowed.

    Returns
    -------
    ndarray

    Raises
    ------
    InvalidInput
        If a value is not finite, or so large that it must be in degrees.
    """
    values = np.asarray(heading, dtype=np.float64)
    known = values[~np.isnan(values)] if gaps else values
    if not np.isfinite(known).all():
        raise InvalidInput(name, "values that are not finite", "give headings in rad, clockwise from north")
    if known.size and np.abs(known).max() > TURN + 1e-9:
        raise InvalidInput(
            name,
            f"{float(known.flat[np.abs(known).argmax()]):g} rad",
            "these look like degrees: give np.radians",
        )
    return values


@dataclass(frozen=True, kw_only=True)
class LaserSpot:
    """Two receivers on a machine, and how well everything about them is known.

    Attributes
    ----------
    spacing : float
        Between the receivers along the axis, m.
    road_heading : float
        Of the centre line of the roadway, clockwise from north, rad.
    spot_sigma : float
        1 sigma of each spot on its receiver, m; independent of the other.
    spacing_sigma, mounting_sigma, road_sigma : float
        1 sigma of the spacing (m), of the receivers' axis against the machine's (rad) and of the survey
        of the roadway (rad). Each is one draw: it does not average out.

    Raises
    ------
    InvalidInput
        If a value cannot be used.

    Notes
    -----
    Paper 002 prints neither the spacing nor the size of the photosensitive elements. Elements 1.2 mm apart,
    a row of which is wrong by ``1.2 mm / sqrt(12)``, and a spacing of 1 m make the 0.028 degrees that it
    measures.
    """

    spacing: float = 1.0
    road_heading: float = 0.0
    spot_sigma: float = 1.2e-3 / 12.0**0.5
    spacing_sigma: float = 0.0
    mounting_sigma: float = 0.0
    road_sigma: float = 0.0

    def __post_init__(self) -> None:
        if not np.isfinite(self.spacing) or not self.spacing > 0.0:
            raise InvalidInput("spacing", self.spacing, "give the distance of the receivers, m, positive")
        check_heading("road_heading", self.road_heading)
        for item in fields(self)[2:]:
            value = getattr(self, item.name)
            if not np.isfinite(value) or value < 0.0:
                raise InvalidInput(item.name, value, "give a standard deviation, zero or more")

    def angle(self, rear: ArrayLike, front: ArrayLike) -> Array:
        """Return the angle to the roadway from the two spots (m, to the right of the axis), eq (1), rad."""
        difference = np.asarray(rear, dtype=np.float64) - np.asarray(front, dtype=np.float64)
        if not np.isfinite(difference).all():
            raise InvalidInput("rear, front", "spots that are not finite", "leave such readings out")
        return np.arctan2(difference, self.spacing)

    def heading(self, rear: ArrayLike, front: ArrayLike) -> Array:
        """Return the heading from the two spots, eq (2), clockwise from north, rad in (-pi, pi]."""
        turned = self.angle(rear, front) + self.road_heading
        return np.arctan2(np.sin(turned), np.cos(turned))

    def spots(self, angle: ArrayLike, offset: ArrayLike = 0.0) -> tuple[Array, Array]:
        """Return where the fan crosses the receivers, the inverse of `angle`.

        Parameters
        ----------
        angle : array_like
            Of the machine against the roadway, clockwise, rad, below a quarter turn.
        offset : array_like
            Of the fan from the middle between the receivers, across the machine to its right, m.

        Returns
        -------
        rear, front : ndarray
            In m.
        """
        half = 0.5 * self.spacing * np.tan(np.asarray(angle, dtype=np.float64))
        middle = np.asarray(offset, dtype=np.float64)
        return middle + half, middle - half

    def reading_sigma(self, angle: ArrayLike = 0.0) -> Array:
        """Return 1 sigma of one reading's own noise, rad, at an angle to the roadway: averaging lowers it."""
        cosine = np.cos(np.asarray(angle, dtype=np.float64))
        return cosine**2 * np.sqrt(2.0) * self.spot_sigma / self.spacing

    def constant_sigma(self, angle: ArrayLike = 0.0) -> Array:
        """Return 1 sigma of what is wrong with every reading alike, rad: spacing, mounting and survey."""
        turned = np.asarray(angle, dtype=np.float64)
        stretch = 0.5 * np.sin(2.0 * turned) * self.spacing_sigma / self.spacing
        return np.sqrt(stretch**2 + self.mounting_sigma**2 + self.road_sigma**2)

    def heading_sigma(self, angle: ArrayLike = 0.0, readings: int = 1) -> Array:
        """Return 1 sigma of the mean heading of some readings, rad: the first order of all that is known."""
        if readings < 1:
            raise InvalidInput("readings", readings, "give one reading or more")
        return np.sqrt(self.reading_sigma(angle) ** 2 / readings + self.constant_sigma(angle) ** 2)


def ground_angle(a: ArrayLike, b: ArrayLike, c: ArrayLike) -> Array:
    """Return the angle between two lines on the ground from three distances, eq (3), rad in [0, pi].

    Parameters
    ----------
    a, b : array_like
        From where the lines meet to a mark on each, m.
    c : array_like
        Between the marks, m.

    Returns
    -------
    ndarray
        Without a sign: which way the machine turned must be written down.

    Raises
    ------
    InvalidInput
        If a distance is not positive, or the three make no triangle.
    """
    a, b, c = np.broadcast_arrays(*(np.asarray(v, dtype=np.float64) for v in (a, b, c)))
    for name, value in (("a", a), ("b", b)):
        if not (value > 0.0).all() or not np.isfinite(value).all():
            raise InvalidInput(name, value.tolist(), "give positive distances in m")
    cosine = (a * a + b * b - c * c) / (2.0 * a * b)
    if not (np.abs(cosine) <= 1.0 + 1e-12).all():
        raise InvalidInput("c", c.tolist(), "three such distances make no triangle: measure again")
    return np.arccos(np.clip(cosine, -1.0, 1.0))


def ground_angle_sigma(a: ArrayLike, b: ArrayLike, c: ArrayLike, tape_sigma: float) -> Array:
    """Return 1 sigma of `ground_angle`, rad, to first order in that of each distance, m.

    With marks equally far from where the lines meet it is ``tape_sigma / a`` for a small angle; with marks
    that are not, a small angle cannot be told from a difference of the lengths, and it grows without bound.
    """
    a, b, c = np.broadcast_arrays(*(np.asarray(v, dtype=np.float64) for v in (a, b, c)))
    angle = ground_angle(a, b, c)
    cosine, area = np.cos(angle), a * b * np.sin(angle)
    with np.errstate(divide="ignore", invalid="ignore"):
        slope = np.sqrt((a - b * cosine) ** 2 + (b - a * cosine) ** 2 + c**2) / area
    # isosceles marks: numerator and area vanish together
    same = np.isclose(a, b, rtol=1e-12) & (angle < 1e-9)
    return tape_sigma * np.where(same, 1.0 / a, slope)


@dataclass(frozen=True)
class SpotTest:
    """A machine turned on the spot: what the laser and what the marks on the ground say.

    Attributes
    ----------
    truth, laser, ground : ndarray, shape (N,)
        True angle to the roadway, and as measured, rad, clockwise.
    mean, sigma : float
        Mean and standard deviation (with ``N - 1``) of laser minus ground, rad.
    ground_sigma : float
        Root of the mean variance of the ground angles, as far as the tape goes, rad.
    """

    truth: Array
    laser: Array
    ground: Array
    mean: float
    sigma: float
    ground_sigma: float


def simulate_spot_test(
    rng: np.random.Generator,
    *,
    receivers: LaserSpot | None = None,
    bias: float = float(np.radians(0.05)),
    turns: int = 4,
    largest: float = float(np.radians(12.0)),
    readings: int = 1,
    mark_distance: float = 5.0,
    tape_sigma: float = 1e-3,
) -> SpotTest:
    """Repeat the experiment of paper 002 (section 2.4): left some times, back, right some times, at random.

    Parameters
    ----------
    rng : numpy.random.Generator
        Of everything drawn.
    receivers : LaserSpot, optional
        With the spot noise; defaults if not given.
    bias : float
        Constant error of the laser, rad. The paper finds a mean of 0.05 degrees.
    turns : int
        To each side; the original position is measured once, between them.
    largest : float
        Angle, rad.
    readings : int
        Of the laser at each position; their mean counts.
    mark_distance, tape_sigma : float
        Of the marks from where the lines meet, and 1 sigma of each measured distance, m. The paper prints
        neither.

    Returns
    -------
    SpotTest

    Notes
    -----
    At the original position the two lines are one and there is no triangle: the ground angle is zero with
    the error of the tape across the lines.
    """
    device = LaserSpot() if receivers is None else receivers
    if turns < 1 or readings < 1:
        raise InvalidInput("turns, readings", (turns, readings), "give one or more of each")
    left = -rng.uniform(0.1, 1.0, turns) * largest
    truth = np.concatenate([left, [0.0], rng.uniform(0.1, 1.0, turns) * largest])
    rear, front = device.spots(truth[:, None] + bias, rng.uniform(-0.05, 0.05, (truth.size, 1)))
    noise = device.spot_sigma * rng.standard_normal((2, truth.size, readings))
    laser = device.angle(rear + noise[0], front + noise[1]).mean(axis=1)
    a, b = (mark_distance + tape_sigma * rng.standard_normal(truth.size) for _ in range(2))
    c = 2.0 * mark_distance * np.sin(0.5 * np.abs(truth))
    read = tape_sigma * rng.standard_normal(truth.size)
    moved = truth != 0.0
    ground = read / mark_distance
    ground[moved] = np.sign(truth[moved]) * ground_angle(a[moved], b[moved], (c + read)[moved])
    gap = laser - ground
    spread = np.full(truth.size, tape_sigma / mark_distance)
    spread[moved] = ground_angle_sigma(mark_distance, mark_distance, c[moved], tape_sigma)
    return SpotTest(
        truth, laser, ground, float(gap.mean()), float(gap.std(ddof=1)), float(np.sqrt(np.mean(spread**2)))
    )
