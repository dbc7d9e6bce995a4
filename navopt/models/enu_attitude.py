"""Attitude in the axes of the papers on alignment: body right, forward, up; navigation east, north, up.

The angles are pitch (about the right axis, nose up), roll (about the forward axis, right side down) and yaw
(heading of the forward axis, clockwise from north): ``C = Rz(-yaw) Rx(pitch) Ry(roll)``. Paper 000 calls the
rotation about its forward axis x roll and that about y pitch, with x forward in one sentence and y in the
next; these axes are those of its references.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from navopt.errors import InvalidInput

__all__ = ["attitude_angles", "attitude_enu", "corrected_attitude", "misalignment", "tilted_attitude"]

Array = NDArray[np.float64]


def attitude_enu(pitch: ArrayLike, roll: ArrayLike, yaw: ArrayLike) -> Array:
    """Return C_b^n from three angles.

    Parameters
    ----------
    pitch, roll, yaw : array_like, shape (...)
        In rad; broadcast together.

    Returns
    -------
    ndarray, shape (..., 3, 3)
        The columns are the right, forward and up axes of the body in east, north, up.
    """
    a, b, c = np.broadcast_arrays(*(np.asarray(v, dtype=np.float64) for v in (pitch, roll, yaw)))
    sp, cp, sr, cr, sy, cy = np.sin(a), np.cos(a), np.sin(b), np.cos(b), np.sin(c), np.cos(c)
    rows = [
        [cy * cr + sy * sp * sr, sy * cp, cy * sr - sy * sp * cr],
        [cy * sp * sr - sy * cr, cy * cp, -sy * sr - cy * sp * cr],
        [-cp * sr, sp, cp * cr],
    ]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def attitude_angles(attitude: ArrayLike) -> tuple[Array, Array, Array]:
    """Invert `attitude_enu`.

    Parameters
    ----------
    attitude : array_like, shape (..., 3, 3)
        C_b^n.

    Returns
    -------
    pitch, roll, yaw : ndarray, shape (...)
        In rad; pitch in [-pi/2, pi/2], the others in (-pi, pi].
    """
    c = _rotations("attitude", attitude)
    pitch = np.arcsin(np.clip(c[..., 2, 1], -1.0, 1.0))
    return pitch, np.arctan2(-c[..., 2, 0], c[..., 2, 2]), np.arctan2(c[..., 0, 1], c[..., 1, 1])


def tilted_attitude(attitude: ArrayLike, angles: ArrayLike) -> Array:
    """Return the attitude that a system computes whose navigation frame is turned by some angles.

    ``C' = exp(-[phi x]) C``, for small angles ``(I - [phi x]) C``: eq. (29) of paper 000.

    Parameters
    ----------
    attitude : array_like, shape (..., 3, 3)
        The true C_b^n.
    angles : array_like, shape (..., 3)
        phi about east, north, up, rad, of any size.

    Returns
    -------
    ndarray, shape (..., 3, 3)
    """
    return _turned(-_vectors("angles", angles), attitude)


def corrected_attitude(computed: ArrayLike, angles: ArrayLike) -> Array:
    """Undo `tilted_attitude`: ``C = exp([phi x]) C'``, the end of every fine alignment.

    Parameters
    ----------
    computed : array_like, shape (..., 3, 3)
        C_b^n as the system computes it.
    angles : array_like, shape (..., 3)
        phi about east, north, up, rad.

    Returns
    -------
    ndarray, shape (..., 3, 3)
    """
    return _turned(_vectors("angles", angles), computed)


def misalignment(computed: ArrayLike, true: ArrayLike) -> Array:
    """Return phi, the rotation vector from the true to the computed navigation frame.

    Parameters
    ----------
    computed, true : array_like, shape (..., 3, 3)
        C_b^n as the system computes it, and as it is.

    Returns
    -------
    ndarray, shape (..., 3)
        About east, north, up, rad: ``computed = exp(-[phi x]) true``.
    """
    from scipy.spatial.transform import Rotation

    between = _rotations("computed", computed) @ np.swapaxes(_rotations("true", true), -1, -2)
    flat = Rotation.from_matrix(between.reshape(-1, 3, 3)).as_rotvec()
    return -flat.reshape(between.shape[:-1])


def _turned(vectors: Array, attitude: ArrayLike) -> Array:
    from scipy.spatial.transform import Rotation

    turn = Rotation.from_rotvec(vectors.reshape(-1, 3)).as_matrix().reshape(*vectors.shape, 3)
    return turn @ _rotations("attitude", attitude)


def _vectors(name: str, value: ArrayLike) -> Array:
    vectors = np.asarray(value, dtype=np.float64)
    if vectors.shape[-1:] != (3,) or not np.isfinite(vectors).all():
        raise InvalidInput(name, value, "give finite vectors of shape (..., 3)")
    return vectors


def _rotations(name: str, value: ArrayLike) -> Array:
    matrices = np.asarray(value, dtype=np.float64)
    if matrices.ndim < 2 or matrices.shape[-2:] != (3, 3) or not np.isfinite(matrices).all():
        raise InvalidInput(name, value, "give rotation matrices, shape (..., 3, 3)")
    gap = np.abs(matrices @ np.swapaxes(matrices, -1, -2) - np.eye(3)).max(initial=0.0)
    if gap > 1e-6 or (np.linalg.det(matrices) < 0.0).any():
        raise InvalidInput(
            name, f"a matrix that is off a rotation by {gap:.3g}", "make it orthonormal, determinant +1"
        )
    return matrices
