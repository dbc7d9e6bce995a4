"""Table 3 of Gao et al. (2015): its numbers, whether they can be chance, and what is misprinted.

What is said of the printed table is computed from what is printed; ours stands beside it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
from scipy import stats

from navopt.algorithms.phased_fit import PhasedFit
from navopt.errors import InvalidInput
from navopt.models.triad import DEGREE_PER_HOUR
from navopt.problem import EstimationProblem

__all__ = [
    "PRINTED_TABLE_3",
    "Closeness",
    "PrintedRow",
    "closeness",
    "misprints",
    "paper_factor",
    "printed_closeness",
    "standard_errors",
    "table_3",
    "verdicts",
]


@dataclass(frozen=True)
class PrintedRow:
    """One row of Table 3.

    Attributes
    ----------
    parameter : str
        Our name, see `navopt.models.triad`.
    symbol : str
        The paper's.
    unit : str
        Unit of the numbers; misalignments, printed in degrees, are radians.
    preset, identified, sd : float
        Value of the 24-position turntable calibration, mean of 100 runs, and their standard deviation.
    relative_error : str
        As printed, digit by digit: in ppm for scale factors, a ratio otherwise.
    """

    parameter: str
    symbol: str
    unit: str
    preset: float
    identified: float
    relative_error: str
    sd: float


_SCALE, _BIAS = "bit h/°", "°/h"
PRINTED_TABLE_3: tuple[PrintedRow, ...] = (
    PrintedRow("scale_x", "K_gx", _SCALE, 643.50373651, 643.50374138, "0.00912194", 0.01464),
    PrintedRow("scale_y", "K_gy", _SCALE, 645.62852456, 645.62855074, "0.04054963", 0.01458),
    PrintedRow("scale_z", "K_gz", _SCALE, 645.17583651, 645.17586147, "0.03868713", 0.01422),
    PrintedRow("misalignment_xy", "E_gxz", "rad", 0.00099183, 0.00099161, "0.00021812", 2.792e-5),
    PrintedRow("misalignment_xz", "E_gxy", "rad", 0.00010717, 0.00010730, "0.00121303", 3.155e-5),
    PrintedRow("misalignment_yx", "E_gyz", "rad", -0.00037044, -0.00037021, "0.00062088", 3.069e-5),
    PrintedRow("misalignment_yz", "E_gyx", "rad", 0.00014048, 0.00014061, "0.00092540", 2.924e-5),
    PrintedRow("misalignment_zx", "E_gzy", "rad", 0.00010505, 0.00010533, "0.00247501", 3.026e-5),
    PrintedRow("misalignment_zy", "E_gzx", "rad", -0.00041586, -0.00041614, "0.00067330", 3.176e-5),
    PrintedRow("bias_x", "ω_x0", _BIAS, 0.01562779, 0.01565329, "0.001633171", 0.001632),
    PrintedRow("bias_y", "ω_y0", _BIAS, 0.03213767, 0.03217083, "0.001031810", 0.001369),
    PrintedRow("bias_z", "ω_z0", _BIAS, 0.02793626, 0.02790215, "0.001222490", 0.001780),
)
"""The twelve rows, in the paper's order."""

#: Runs of the paper's Monte-Carlo simulation.
PRINTED_RUNS = 100


def paper_factor(parameter: str) -> float:
    """Factor from SI to the paper's unit: counts per rad/s to counts per °/h, rad/s to °/h, rad to rad."""
    if parameter.startswith("scale"):
        return DEGREE_PER_HOUR
    return 1.0 / DEGREE_PER_HOUR if parameter.startswith("bias") else 1.0


@dataclass(frozen=True)
class Closeness:
    """How near means of runs are to presets, in their own standard errors.

    Attributes
    ----------
    z : ndarray, shape (n,)
        ``(mean - preset) / (sd / sqrt(runs))``.
    chance : float
        Probability that the sum of squares of n independent standard normal numbers is no larger than that
        of z: of means as near to the presets as these, or nearer, if runs were independent, their expectation
        the preset and parameters uncorrelated.
    surprise : float
        The same for as far or farther.
    fisher : float
        Probability as `chance`, by Fisher's combination of the probabilities of each.
    product : float
        Product of ``P(|Z| ≤ |z|)``. It is no probability of anything seen beforehand, since each factor has
        its own threshold chosen by the data; reported because it is the figure that is easily quoted.
    """

    z: np.ndarray
    chance: float
    surprise: float
    fisher: float
    product: float


def closeness(
    mean: Sequence[float] | np.ndarray,
    preset: Sequence[float] | np.ndarray,
    sd: Sequence[float] | np.ndarray,
    *,
    runs: int,
) -> Closeness:
    """Compare means of independent runs with presets.

    Parameters
    ----------
    mean, preset, sd : array_like, shape (n,)
        In the same units; standard deviations of single runs, positive.
    runs : int
        How many runs each mean is of.

    Returns
    -------
    Closeness

    Raises
    ------
    InvalidInput
        If a standard deviation is not positive, or there is nothing to compare.
    """
    means, presets, spread = (np.asarray(values, dtype=float) for values in (mean, preset, sd))
    if means.size == 0 or not means.shape == presets.shape == spread.shape:
        raise InvalidInput("mean", means.shape, "give as many presets and standard deviations, at least one")
    if not (spread > 0.0).all() or runs < 2:
        raise InvalidInput("sd", spread.tolist(), "give positive standard deviations of at least two runs")
    z = (means - presets) / (spread / np.sqrt(runs))
    inside = 2.0 * stats.norm.cdf(np.abs(z)) - 1.0
    total = float(z @ z)
    return Closeness(
        z=z,
        chance=float(stats.chi2.cdf(total, z.size)),
        surprise=float(stats.chi2.sf(total, z.size)),
        fisher=float(stats.combine_pvalues(inside).pvalue) if (inside > 0).all() else 0.0,
        product=float(np.prod(inside)),
    )


def printed_closeness() -> Closeness:
    """`closeness` of the twelve printed rows."""
    rows = PRINTED_TABLE_3
    return closeness(
        [r.identified for r in rows], [r.preset for r in rows], [r.sd for r in rows], runs=PRINTED_RUNS
    )


def misprints() -> pd.DataFrame:
    """Printed relative errors that do not follow from the printed values.

    Returns
    -------
    pandas.DataFrame
        Of every row of Table 3: ``symbol, printed, recomputed, lowest, highest, agrees, remark``.
        ``recomputed`` is ``|identified - preset| / |preset|`` of the printed numbers, and ``lowest`` and
        ``highest`` what it can be when both are rounded to the eighth decimal.
    """
    table = []
    for row in PRINTED_TABLE_3:
        unit = 1e6 if row.parameter.startswith("scale") else 1.0
        exact = unit * abs(row.identified - row.preset) / abs(row.preset)
        # half a unit of the last place of either number
        slack = unit * 1e-8 / abs(row.preset)
        printed = float(row.relative_error)
        digit = 0.5 * 10.0 ** -len(row.relative_error.partition(".")[2])
        # authors round at the end: their own decimals agree with ours unless a digit is wrong
        agrees = abs(printed - exact) <= digit + 0.005 * slack
        table.append(
            {
                "symbol": row.symbol,
                "printed": row.relative_error,
                "recomputed": exact,
                "lowest": max(exact - slack, 0.0),
                "highest": exact + slack,
                "agrees": agrees,
                "remark": "" if agrees else _remark(row, printed, exact, unit),
            }
        )
    return pd.DataFrame(table)


def _remark(row: PrintedRow, printed: float, exact: float, unit: float) -> str:
    """What went wrong, where the numbers say."""
    by_identified = unit * abs(row.identified - row.preset) / abs(row.identified)
    if abs(by_identified - printed) < 0.5e-8:
        return "divided by the identified value"
    digits = row.relative_error.partition(".")[2]
    right = f"{exact:.8f}".partition(".")[2]
    if len(digits) == 9 and any(digits[:k] + digits[k + 1 :] == right for k in range(9)):
        return "one digit too many"
    if sorted(digits) == sorted(right):
        return "digits exchanged"
    return f"{printed / exact:.3f} times what the printed values give"


# -- ours beside it ------------------------------------------------------------------------------------
def standard_errors(problem: EstimationProblem) -> np.ndarray:
    """Standard deviation that the noise leaves to each parameter when its group alone is estimated.

    Parameters
    ----------
    problem : EstimationProblem
        With residuals and ``parameter_groups``.

    Returns
    -------
    ndarray, shape (n_var,)
        Square roots of the Cramér-Rao bound with all other groups known; ``inf`` for a group that the data
        do not determine, as the six misalignments.
    """
    x, names = problem.nominal, list(problem.parameter_names)
    slopes = problem.jacobian(x) * (problem.xu - problem.xl)  # without units
    errors = np.full(len(names), np.inf)
    for members in problem.parameter_groups.values():
        places = [names.index(name) for name in members]
        values = np.linalg.svd(slopes[:, places], compute_uv=False)
        # a null direction in first order has a slope in second order of the presets: 1e-3, not 1e-16
        if values[-1] > 1e-2 * values[0]:
            covariance = np.linalg.inv(slopes[:, places].T @ slopes[:, places])
            errors[places] = np.sqrt(np.diag(covariance)) * (problem.xu - problem.xl)[places]
    return errors


def table_3(fits: dict[str, PhasedFit], bound: np.ndarray | None = None) -> pd.DataFrame:
    """Table 3 as printed and as found, in the paper's order and units.

    Parameters
    ----------
    fits : dict of str to PhasedFit
        By reading, from `comparisons.gyro_paper.identify`.
    bound : ndarray, shape (12,), optional
        From `standard_errors`.

    Returns
    -------
    pandas.DataFrame
        One row per parameter: ``symbol, parameter, unit``; ``preset, identified, sd, z`` printed; for every
        reading its own, with the reading in front; ``bound sd`` last.
    """
    printed = printed_closeness()
    table = pd.DataFrame(
        {
            "symbol": [row.symbol for row in PRINTED_TABLE_3],
            "parameter": [row.parameter for row in PRINTED_TABLE_3],
            "unit": [row.unit for row in PRINTED_TABLE_3],
            "printed preset": [row.preset for row in PRINTED_TABLE_3],
            "printed identified": [row.identified for row in PRINTED_TABLE_3],
            "printed sd": [row.sd for row in PRINTED_TABLE_3],
            "printed z": printed.z,
        }
    )
    factor = np.array([paper_factor(row.parameter) for row in PRINTED_TABLE_3])
    for reading, fit in fits.items():
        rows = {row["parameter"]: row for row in fit.rows()}
        own = [rows[row.parameter] for row in PRINTED_TABLE_3]
        for key, name in (("preset", "preset"), ("mean", "identified"), ("sd", "sd")):
            table[f"{reading} {name}"] = factor * np.array([row[key] for row in own])
        near = closeness(
            *(table[f"{reading} {name}"].to_numpy() for name in ("identified", "preset", "sd")),
            runs=own[0]["runs"],
        )
        table[f"{reading} z"] = near.z
    if bound is not None:
        names = list(next(iter(fits.values())).parameters)
        table["bound sd"] = factor * bound[[names.index(row.parameter) for row in PRINTED_TABLE_3]]
    return table


def verdicts(fits: dict[str, PhasedFit]) -> pd.DataFrame:
    """Whether the means lie as near to the presets as independent unbiased runs would.

    Returns
    -------
    pandas.DataFrame
        ``of, runs, rms z, largest z, chance of nearer, chance of farther, Fisher, product``: see `Closeness`.
    """
    cases = {"printed": (printed_closeness(), 100)}
    for reading, fit in fits.items():
        rows = fit.rows()
        near = closeness(*([row[key] for row in rows] for key in ("mean", "preset", "sd")),
                         runs=rows[0]["runs"])  # fmt: skip
        cases[reading] = (near, rows[0]["runs"])
    return pd.DataFrame(
        [
            {
                "of": name,
                "runs": runs,
                "rms z": float(np.sqrt(np.mean(near.z**2))),
                "largest z": float(np.abs(near.z).max()),
                "chance of nearer": near.chance,
                "chance of farther": near.surprise,
                "Fisher": near.fisher,
                "product": near.product,
            }
            for name, (near, runs) in cases.items()
        ]
    )
