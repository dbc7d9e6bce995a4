"""Three sensors on one block: scale factors, misalignments and biases, forward and inverse.

The model is that of Gao et al. (2015), eq. (11), for gyros and accelerometers alike:

    counts = diag(scale) (E x + bias)

with x the true rate or specific force in body axes and E a matrix with unit diagonal. As printed, the
biases are added to the counts without the scale factor; at 645 counts per °/h a bias of 0.0156 °/h would
then be 2e-5 °/h. Here biases have the unit of x, as in the paper's Tables 2 and 3. Misalignments are
printed in degrees but stand beside ones: they are radians.

============================  =========================
element (row, column) of E    the paper's name
============================  =========================
``misalignment_xy`` (0, 1)    E_gxz
``misalignment_xz`` (0, 2)    E_gxy
``misalignment_yx`` (1, 0)    E_gyz
``misalignment_yz`` (1, 2)    E_gyx
``misalignment_zx`` (2, 0)    E_gzy
``misalignment_zy`` (2, 1)    E_gzx
============================  =========================

Here the second letter is the body axis whose motion leaks in; in the paper it is the axis about which the
sensor is turned.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from navopt.errors import InvalidInput, UnknownName

__all__ = [
    "DEGREE_PER_HOUR",
    "MISALIGNMENT_INDEX",
    "PARAMETER_NAMES",
    "AccelerometerTriad",
    "GyroTriad",
    "SensorTriad",
    "residual_error",
]

Array = NDArray[np.float64]

DEGREE_PER_HOUR: float = float(np.pi / 180.0 / 3600.0)
"""One degree per hour, rad/s."""

MISALIGNMENT_INDEX: dict[str, tuple[int, int]] = {
    "misalignment_xy": (0, 1),
    "misalignment_xz": (0, 2),
    "misalignment_yx": (1, 0),
    "misalignment_yz": (1, 2),
    "misalignment_zx": (2, 0),
    "misalignment_zy": (2, 1),
}
"""Row and column in E of each misalignment."""

PARAMETER_NAMES: tuple[str, ...] = (
    "scale_x", "scale_y", "scale_z", "bias_x", "bias_y", "bias_z", *MISALIGNMENT_INDEX,
)  # fmt: skip
"""The twelve parameters of a triad, in the order of `SensorTriad.vector`."""

_ROWS, _COLUMNS = (list(index) for index in zip(*MISALIGNMENT_INDEX.values(), strict=True))
FRAMES = ("lower-triangular", "symmetric")


@dataclass(frozen=True, eq=False)
class SensorTriad:
    """Scale factors, misalignments and biases of three sensors.

    Parameters
    ----------
    scale : array_like, shape (3,)
        Counts per unit of what is measured; not zero.
    misalignment : array_like, shape (3, 3)
        E, rad, with ones on its diagonal: row i says what the sensor i measures.
    bias : array_like, shape (3,)
        In the unit of what is measured.

    Raises
    ------
    InvalidInput
        If a shape is wrong, a value is not finite, a scale factor is zero, or the diagonal is not one.

    Notes
    -----
    ``counts = diag(scale) @ (misalignment @ x + bias)``. Names of the elements: see this module.
    """

    scale: Array
    misalignment: Array
    bias: Array

    def __post_init__(self) -> None:
        for name, shape in (("scale", (3,)), ("misalignment", (3, 3)), ("bias", (3,))):
            value = np.array(getattr(self, name), dtype=np.float64)
            if value.shape != shape or not np.isfinite(value).all():
                raise InvalidInput(
                    name, getattr(self, name), f"give finite numbers of shape {shape}: one triad is x, y, z"
                )
            value.setflags(write=False)
            object.__setattr__(self, name, value)
        if (self.scale == 0.0).any():
            raise InvalidInput("scale", self.scale.tolist(), "a scale factor of zero measures nothing")
        if not np.array_equal(np.diag(self.misalignment), np.ones(3)):
            raise InvalidInput(
                "misalignment",
                np.diag(self.misalignment).tolist(),
                "the diagonal must be one: put what is left into the scale factors (see from_matrix)",
            )

    @property
    def matrix(self) -> Array:
        """Counts per unit along each body axis, ``diag(scale) @ misalignment``, shape (3, 3)."""
        return self.scale[:, None] * self.misalignment

    @property
    def vector(self) -> Array:
        """The twelve parameters in the order of `PARAMETER_NAMES`, shape (12,)."""
        return np.concatenate([self.scale, self.bias, self.misalignment[_ROWS, _COLUMNS]])

    @classmethod
    def from_vector(cls, vector: ArrayLike) -> Self:
        """Build a triad from its twelve parameters.

        Parameters
        ----------
        vector : array_like, shape (12,)
            In the order of `PARAMETER_NAMES`.

        Returns
        -------
        SensorTriad

        Raises
        ------
        InvalidInput
            If there are not twelve, or as for the class.
        """
        values = np.asarray(vector, dtype=np.float64)
        if values.shape != (12,):
            raise InvalidInput("vector", values.shape, "give the twelve parameters of PARAMETER_NAMES")
        misalignment = np.eye(3)
        misalignment[_ROWS, _COLUMNS] = values[6:]
        return cls(values[:3], misalignment, values[3:6])

    @classmethod
    def from_matrix(cls, matrix: ArrayLike, offset: ArrayLike) -> Self:
        """Build a triad from ``counts = matrix @ x + offset``.

        Parameters
        ----------
        matrix : array_like, shape (3, 3)
            Counts per unit; no diagonal element is zero.
        offset : array_like, shape (3,)
            Counts at rest.

        Returns
        -------
        SensorTriad
        """
        m = np.asarray(matrix, dtype=np.float64)
        if m.shape != (3, 3):
            raise InvalidInput("matrix", m.shape, "give a matrix of shape (3, 3)")
        scale = np.diag(m).copy()
        if (scale == 0.0).any():
            raise InvalidInput("matrix", m.tolist(), "each sensor must measure its own axis: a diagonal is 0")
        misalignment = m / scale[:, None]
        np.fill_diagonal(misalignment, 1.0)
        return cls(scale, misalignment, np.asarray(offset, dtype=np.float64) / scale)

    def replace(self, **changes: Any) -> Self:
        """Return a copy with some fields or single parameters changed.

        Parameters
        ----------
        **changes
            Fields (``scale``, ``misalignment``, ``bias``) or names of `PARAMETER_NAMES`.

        Returns
        -------
        SensorTriad

        Raises
        ------
        UnknownName
            If a name is neither.
        """
        known = [field.name for field in fields(SensorTriad)]
        for name in changes:
            if name not in known and name not in PARAMETER_NAMES:
                raise UnknownName("parameter", name, [*known, *PARAMETER_NAMES])
        values = {name: np.array(changes.get(name, getattr(self, name)), dtype=np.float64) for name in known}
        for name, value in changes.items():
            if name in MISALIGNMENT_INDEX:
                values["misalignment"][MISALIGNMENT_INDEX[name]] = value
            elif name not in known:
                quantity, axis = name.split("_")
                values[quantity]["xyz".index(axis)] = value
        return type(self)(**values)

    def forward(self, x: ArrayLike) -> Array:
        """Return the counts of true values.

        Parameters
        ----------
        x : array_like, shape (..., 3)
            True rates or specific forces in body axes.

        Returns
        -------
        ndarray, shape (..., 3)
        """
        return self.scale * (np.asarray(x, dtype=np.float64) @ self.misalignment.T + self.bias)

    def inverse(self, counts: ArrayLike) -> Array:
        """Return what the counts stand for.

        Parameters
        ----------
        counts : array_like, shape (..., 3)
            Output of the three sensors.

        Returns
        -------
        ndarray, shape (..., 3)
            Rates or specific forces in body axes.

        Raises
        ------
        InvalidInput
            If the misalignment matrix cannot be inverted.
        """
        return np.asarray((np.asarray(counts, dtype=np.float64) / self.scale - self.bias) @ self._inverse().T)

    def _inverse(self) -> Array:
        try:
            return np.asarray(np.linalg.inv(self.misalignment), dtype=np.float64)
        except np.linalg.LinAlgError:
            raise InvalidInput(
                "misalignment", self.misalignment.tolist(), "two sensors measure the same axis: no inverse"
            ) from None

    def in_frame(self, frame: str) -> Self:
        """Return the same sensors described in other body axes.

        Norms of rates do not tell the triad with matrix M from that with M R, R a rotation: it is the same
        block of sensors, seen from turned axes. A convention picks one of them.

        Parameters
        ----------
        frame : {"lower-triangular", "symmetric"}
            Axes in which the misalignment matrix is lower triangular (x along the first sensor, y in the
            plane of the first two), or symmetric (axes as near to all three sensors as can be).

        Returns
        -------
        SensorTriad
            With the same norm of the inverse for any counts, to rounding.
        """
        if frame not in FRAMES:
            raise UnknownName("frame", frame, FRAMES)
        matrix, offset = self.matrix, self.scale * self.bias
        gram = matrix @ matrix.T
        if frame == "lower-triangular":
            # Cholesky's factor of M Mᵀ is M R; scales keep their signs
            return type(self).from_matrix(np.linalg.cholesky(gram) * np.sign(self.scale), offset)
        scale = self.scale.copy()
        for _ in range(100):
            values, vectors = np.linalg.eigh(gram / np.outer(scale, scale))
            diagonal = np.diag((vectors * np.sqrt(values)) @ vectors.T)
            scale = scale * diagonal
            if np.abs(diagonal - 1.0).max() < 1e-15:
                break
        values, vectors = np.linalg.eigh(gram / np.outer(scale, scale))
        return type(self).from_matrix(scale[:, None] * ((vectors * np.sqrt(values)) @ vectors.T), offset)


class GyroTriad(SensorTriad):
    """Three gyros: rates and biases in rad/s, scale factors in counts per rad/s.

    See `SensorTriad` for parameters and errors.

    Examples
    --------
    >>> import numpy as np
    >>> gyros = GyroTriad.from_paper_units([640.0, 645.0, 650.0], np.eye(3), [0.01, 0.02, 0.03])
    >>> counts = gyros.forward(np.radians([15.0, 0.0, 0.0]) / 3600)
    >>> [round(float(c), 3) for c in counts]
    [9606.4, 12.9, 19.5]
    """

    @classmethod
    def from_paper_units(cls, scale: ArrayLike, misalignment: ArrayLike, bias_deg_h: ArrayLike) -> GyroTriad:
        """Build a triad from the units of Table 2 of Gao et al. (2015).

        Parameters
        ----------
        scale : array_like, shape (3,)
            Counts per °/h ("bit h/°").
        misalignment : array_like, shape (3, 3)
            E, in radians (printed as degrees, see this module).
        bias_deg_h : array_like, shape (3,)
            °/h.

        Returns
        -------
        GyroTriad
        """
        return cls(
            np.asarray(scale, dtype=np.float64) / DEGREE_PER_HOUR,
            np.asarray(misalignment, dtype=np.float64),
            np.asarray(bias_deg_h, dtype=np.float64) * DEGREE_PER_HOUR,
        )

    def paper_units(self) -> tuple[Array, Array, Array]:
        """Return scale factors (counts per °/h), E (rad), biases (°/h): what `from_paper_units` takes."""
        return self.scale * DEGREE_PER_HOUR, self.misalignment.copy(), self.bias / DEGREE_PER_HOUR


class AccelerometerTriad(SensorTriad):
    """Three accelerometers: specific force and biases in m/s², scale factors in counts per m/s².

    See `SensorTriad` for parameters and errors.
    """


def residual_error(estimated: SensorTriad, true: SensorTriad, x: ArrayLike) -> Array:
    """Return what a wrong calibration does to a measurement.

    Parameters
    ----------
    estimated : SensorTriad
        The calibration that is used.
    true : SensorTriad
        What the sensors are.
    x : array_like, shape (..., 3)
        True rates or specific forces.

    Returns
    -------
    ndarray, shape (..., 3)
        What the estimated triad makes of the true counts, minus x.
    """
    return estimated.inverse(true.forward(x)) - np.asarray(x, dtype=np.float64)
