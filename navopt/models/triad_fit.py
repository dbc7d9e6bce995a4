"""The result of calibrating a triad: parameters, covariance, and which of them the data do not determine."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from navopt.models.triad import PARAMETER_NAMES, SensorTriad

__all__ = ["LIMITS", "PoseFit", "birge", "sandwich_sigma", "triad_jacobian", "undetermined"]

#: A parameter is called undetermined if its sigma exceeds this: share of a scale, share of the reference
#: norm for a bias, rad for a misalignment. A data sheet says more than that.
LIMITS = {"scale": 0.05, "bias": 0.05, "misalignment": 0.05}


@dataclass(frozen=True, kw_only=True)
class PoseFit:
    """Parameters of three sensors with their covariance and the residuals they leave.

    Attributes
    ----------
    triad : SensorTriad
        The parameters. Counts are those above the zero of the recording.
    names : tuple of str
        Estimated parameters, in the order of `covariance`.
    covariance : ndarray, shape (k, k)
        Of the estimated parameters, in the units of the triad, for the stated noise times `excess` squared.
    sandwich : ndarray, shape (k,)
        1 sigma of each from the residuals alone, without any assumption on their size (`sandwich_sigma`).
    before, after : ndarray
        Residuals with the nominal and with the estimated parameters, in the unit named by `unit`.
    stated : ndarray
        1 sigma of each residual that the noise of the averages explains.
    unit : str
        Unit of the residuals.
    chi_square : float
        Sum of squares of the whitened residuals.
    degrees_of_freedom : int
        Their number less that of the parameters.
    method : str
        How it was done, in words.
    """

    triad: SensorTriad
    names: tuple[str, ...]
    covariance: np.ndarray
    sandwich: np.ndarray
    before: np.ndarray
    after: np.ndarray
    stated: np.ndarray
    unit: str
    chi_square: float
    degrees_of_freedom: int
    method: str

    @property
    def excess(self) -> float:
        """Size of the residuals over the stated noise, at least 1: the ratio of Birge (1932)."""
        return birge(self.chi_square, self.degrees_of_freedom)

    @property
    def sigma(self) -> dict[str, float]:
        """1 sigma of every estimated parameter, in the unit of the triad."""
        return dict(zip(self.names, np.sqrt(np.diag(self.covariance)).tolist(), strict=True))

    @property
    def values(self) -> dict[str, float]:
        """All twelve parameters, the fixed ones too."""
        return dict(zip(PARAMETER_NAMES, self.triad.vector.tolist(), strict=True))


def birge(chi_square: float, degrees_of_freedom: int) -> float:
    """Return the factor by which sigmas are enlarged so that the residuals fit them, at least 1."""
    if degrees_of_freedom < 1:
        return 1.0
    return max(float(np.sqrt(chi_square / degrees_of_freedom)), 1.0)


def sandwich_sigma(
    jacobian: np.ndarray, residual: np.ndarray, covariance: np.ndarray, *, group: int = 1
) -> np.ndarray:
    """Return 1 sigma of parameters from the residuals alone.

    White's estimator in the form HC3 of MacKinnon and White (1985): it holds whatever the variance of each
    residual is. With `group` above one, so many consecutive residuals may depend on each other.

    Parameters
    ----------
    jacobian : ndarray, shape (m, k)
        Derivative of the whitened residuals.
    residual : ndarray, shape (m,)
        Whitened residuals.
    covariance : ndarray, shape (k, k)
        Inverse of the normal matrix.
    group : int
        Residuals that belong together.

    Returns
    -------
    ndarray, shape (k,)
    """
    leverage = np.einsum("mi,ij,mj->m", jacobian, covariance, jacobian)
    weighted = jacobian * (residual / np.maximum(1.0 - leverage, 0.05))[:, None]
    score = weighted.reshape(-1, group, jacobian.shape[1]).sum(axis=1)
    return np.sqrt(np.maximum(np.diag(covariance @ (score.T @ score) @ covariance), 0.0))


def triad_jacobian(triad: SensorTriad, x: np.ndarray, names: tuple[str, ...]) -> np.ndarray:
    """Return the derivative of calibrated values with respect to parameters.

    Parameters
    ----------
    triad : SensorTriad
        The parameters.
    x : ndarray, shape (M, 3)
        Calibrated values, ``triad.inverse(counts)``.
    names : tuple of str
        Parameters, of `navopt.models.triad.PARAMETER_NAMES`.

    Returns
    -------
    ndarray, shape (M, 3, k)
        From ``x = E^-1 (counts / scale - bias)``.
    """
    inverse = np.linalg.inv(triad.misalignment)
    # counts / scale
    raw = x @ triad.misalignment.T + triad.bias
    columns = []
    for name in names:
        quantity, axes = name.split("_")
        row = "xyz".index(axes[0])
        if quantity == "scale":
            change = -raw[:, row] / triad.scale[row]
        elif quantity == "bias":
            change = -np.ones(len(x))
        else:
            change = -x[:, "xyz".index(axes[1])]
        columns.append(change[:, None] * inverse[:, row])
    return np.stack(columns, axis=2)


def undetermined(
    jacobian: np.ndarray, names: tuple[str, ...], scale: np.ndarray, norm: float
) -> tuple[tuple[str, ...], np.ndarray]:
    """Return the parameters that whitened residuals do not determine, and the covariance of all.

    Parameters
    ----------
    jacobian : ndarray, shape (M, k)
        Derivative of the whitened residuals.
    names : tuple of str
        The k parameters.
    scale : ndarray, shape (3,)
        Scale factors.
    norm : float
        Reference norm, to which biases are compared.

    Returns
    -------
    names : tuple of str
        Those whose sigma would exceed `LIMITS`.
    covariance : ndarray, shape (k, k)
        Infinite variances on the diagonal of those.

    Notes
    -----
    `navopt.identifiability.assess` asks another question of a Jacobian: which combinations are told better
    than the box. Here weakly seen combinations keep their part in the variances, and each parameter is judged
    by its own sigma.
    """
    size = np.empty(len(names))
    for k, name in enumerate(names):
        quantity, axes = name.split("_")
        size[k] = LIMITS[quantity]
        if quantity == "scale":
            size[k] *= abs(scale["xyz".index(axes)])
        elif quantity == "bias":
            size[k] *= norm
    # in units of the limits, everything determined has a variance below 1
    _, values, directions = np.linalg.svd(jacobian * size, full_matrices=True)
    full = np.zeros(len(names))
    full[: len(values)] = values
    with np.errstate(divide="ignore"):
        inverse = np.where(full > 1e-12 * max(full.max(), 1e-300), 1.0 / full**2, np.inf)
    weights = directions**2
    blind = ~np.isfinite(inverse)
    variance = np.where(blind[:, None], 0.0, np.where(blind, 0.0, inverse)[:, None] * weights).sum(axis=0)
    # an exactly blind direction touches a parameter where it has more than rounding in it
    variance[(weights[blind] > 1e-12).any(axis=0)] = np.inf
    missing = tuple(name for name, value in zip(names, variance, strict=True) if not value < 1.0)
    finite = np.where(blind, 0.0, inverse)
    covariance = (directions.T * finite) @ directions * np.outer(size, size)
    covariance[np.diag_indices_from(covariance)] = variance * size**2
    return missing, covariance
