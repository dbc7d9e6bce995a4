"""What a phased search leaves behind: mean and standard deviation of every parameter, phase by phase."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from navopt.errors import InvalidInput

__all__ = ["PhasedFit"]


@dataclass(frozen=True)
class PhasedFit:
    """Phases of a `navopt.algorithms.Phased` search, in the order in which they ended.

    Attributes
    ----------
    parameters : tuple of str
        Names of the problem's parameters, the order of all last axes.
    units : tuple of str
        Their units.
    presets : ndarray, shape (n_var,)
        Where the search began: the problem's nominal values.
    labels : tuple of str
        Group of each phase, by its label.
    repetition : ndarray of int, shape (phases,)
        Repetition of each phase, from 0.
    member : ndarray of bool, shape (phases, n_var)
        Parameters that the phase optimised.
    runs : ndarray, shape (phases, runs, n_var)
        Best point of each run; the held parameters at their values. A run that could evaluate nothing is NaN.
    run_loss : ndarray, shape (phases, runs)
        Its loss.
    mean : ndarray, shape (phases, n_var)
        Mean over the runs; the held parameters at their values.
    sd : ndarray, shape (phases, n_var)
        Standard deviation over the runs (with ``runs - 1``); NaN for held parameters and for fewer than two.
    indicator : ndarray, shape (phases,)
        Loss of the identified values after each phase: all means so far, the presets of the rest.
    x : ndarray, shape (n_var,)
        Answer of the search.
    """

    parameters: tuple[str, ...]
    units: tuple[str, ...]
    presets: np.ndarray
    labels: tuple[str, ...]
    repetition: np.ndarray
    member: np.ndarray
    runs: np.ndarray
    run_loss: np.ndarray
    mean: np.ndarray
    sd: np.ndarray
    indicator: np.ndarray
    x: np.ndarray

    def apply(self, problem: Any) -> Any:
        """Estimate of the same answer on another problem of the same kind."""
        return problem.estimate(self.x)

    def phase_of(self, parameter: str, *, repetition: int = -1) -> int:
        """Index of the phase that identified a parameter, in the last repetition or another one.

        Raises
        ------
        InvalidInput
            If there is no such phase.
        """
        if parameter in self.identified:
            own = self.member[:, self.parameters.index(parameter)]
            phases = np.flatnonzero(own if repetition < 0 else own & (self.repetition == repetition))
            if len(phases):
                return int(phases[-1])
        raise InvalidInput(
            "parameter", parameter, f"no phase has identified it; there are {', '.join(self.identified)}"
        )

    @property
    def identified(self) -> tuple[str, ...]:
        """Parameters that at least one phase has identified."""
        return tuple(name for k, name in enumerate(self.parameters) if self.member[:, k].any())

    def rows(self, *, repetition: int = -1) -> list[dict[str, Any]]:
        """Preset, mean and standard deviation of every identified parameter, for a table.

        Parameters
        ----------
        repetition : int, default -1
            Which repetition, from 0; the last one that identified the parameter if negative.

        Returns
        -------
        list of dict
            ``parameter, unit, group, preset, mean, sd, runs`` of each, in the order of the parameters.
        """
        table = []
        for name in self.identified:
            phase, k = self.phase_of(name, repetition=repetition), self.parameters.index(name)
            table.append(
                {
                    "parameter": name,
                    "unit": self.units[k],
                    "group": self.labels[phase],
                    "preset": float(self.presets[k]),
                    "mean": float(self.mean[phase, k]),
                    "sd": float(self.sd[phase, k]),
                    "runs": int(np.isfinite(self.run_loss[phase]).sum()),
                }
            )
        return table
