"""How far a roof support is pushed, by inertial sensor and Kalman filter (Zhang et al. 2016)."""

from __future__ import annotations

from typing import Any

import numpy as np

from navopt.errors import UnknownName
from navopt.problems.noise_tuning import NoiseTuning
from navopt.problems.pushing_worlds import CASES, build_world
from navopt.registry import problem

__all__ = ["PushingDistance", "integrate_twice"]


@problem(
    "pushing-distance",
    summary="tune the Kalman filter that tells how far a roof support is pushed",
    example={"steps": 120},
)
class PushingDistance(NoiseTuning):
    """Tune the filter of Zhang et al. 2016 (Appl. Sci. 6:299) for the distance a roof support is pushed.

    The state is position and velocity, ``x[k+1] = A x[k] + B (u[k] + w[k])`` with ``A = [1 Δt; 0 1]`` and
    ``B = [Δt²/2; Δt]`` (their eq. 12): the accelerometer is the known input, its noise the process noise.
    The position is measured (13). The constructor is that of `NoiseTuning`, where recorded data go;
    `simulate` draws the paper's two cases.

    Notes
    -----
    Deviations from the paper and what it leaves open. In its eq. (1) the process noise appears in the
    prediction itself, where it cannot be. Its eq. (2) adds a scalar Q to a 2 × 2 matrix; as it says that
    the noise comes by the acceleration, here Q acts through B (``noise_input="acceleration"``), and
    ``noise_input="states"`` takes the literal Q I. The input is ``9.81 sin(k/5)``. Time step, length, noise
    and initial state of the simulation are not printed and are keywords here. Its objective is the oracle's
    mean square error of the position (14), which any common multiple of Q and R minimises as well; the
    default here is the likelihood of the innovations, which needs no truth. In the stroke the accelerometer
    has a bias that no Q describes, so the filter that is told the variance of its noise is far from the best.
    """

    @classmethod
    def simulate(  # type: ignore[override]
        cls,
        seed: int = 0,
        *,
        case: str = "sine",
        steps: int | None = None,
        interval_s: float | None = None,
        process_variance: float | None = None,
        measurement_variance: float | None = None,
        amplitude: float = 9.81,
        phase_step: float = 0.2,
        initial_position_m: float = 0.0,
        initial_velocity: float = 0.0,
        initial_sigma: tuple[float, float] | None = None,
        stroke_m: float = 0.5,
        ramp_s: float = 1.0,
        rest_s: float = 1.0,
        accelerometer_bias: float | None = None,
        sensor_bias_m: float = 0.0,
        missing_fraction: float = 0.0,
        noise_input: str = "acceleration",
        covariance: str = "scalar",
        objective: str = "innovations",
        encoding: str = "log10",
        box: Any = None,
        update: str = "auto",
        noise_seed: int | None = None,
    ) -> PushingDistance:
        """Draw one world.

        Parameters
        ----------
        seed : int
            Seed of everything drawn.
        case : {"sine", "stroke"}
            The artificial signal of section 4.1, or a stroke as in section 4.2: from rest over the
            distance `stroke_m` with a trapezoidal velocity, measured by a biased accelerometer.
        steps : int, optional
            Number of measurements; 1000.
        interval_s : float, optional
            Time step Δt; 0.1 s, and 0.01 s for the stroke.
        process_variance : float, optional
            Variance of the accelerometer's noise, (m/s²)²; 1, and 0.02² for the stroke (an ADIS16448 of
            0.23 mg/√Hz at 50 Hz). In m² and (m/s)² for ``noise_input="states"``.
        measurement_variance : float, optional
            Variance of the measured position, m²; 0.25, and 0.0147467² for the stroke, the printed error of
            the built-in sensor taken as millimetres.
        amplitude, phase_step : float
            ``u[k] = amplitude sin(phase_step k)``, m/s² and rad.
        initial_position_m, initial_velocity : float
            Initial state as the filter is told it, m and m/s.
        initial_sigma : (float, float), optional
            1σ of the true initial state about it, which the filter knows; (0.5, 0.5), and (0.001, 0.001) for
            the stroke, which begins at rest.
        stroke_m, ramp_s, rest_s : float
            For the stroke: its length, how long the velocity rises and falls, and how long the support
            rests before and after. The velocity is constant for the rest of the record.
        accelerometer_bias : float, optional
            Constant error of the accelerometer, m/s², that the filter does not know of; 0, and 0.05 for
            the stroke.
        sensor_bias_m : float
            Constant error of the measured position.
        missing_fraction : float
            Share of measurements that are missing.
        noise_input : {"acceleration", "states"}
            See the class.
        covariance : {"scalar", "diagonal", "full"}
            Form of Q, the paper's three options; R is a number.
        objective, encoding, box, update
            As for the class. The paper's own are ``objective="oracle", encoding="raw"``.
        noise_seed : int, optional
            Another draw of states and noise of the same world.

        Returns
        -------
        PushingDistance
        """
        scenario = {name: v for name, v in locals().items() if name not in ("cls", "seed", "noise_seed")}
        if case not in CASES:
            raise UnknownName("case", case, CASES)
        world = build_world(cls, seed, noise_seed, **scenario)
        object.__setattr__(world, "_world", {"seed": seed, **scenario})
        return world

    def _score(self, estimate: Any) -> dict[str, float]:
        scores = super()._score(estimate)
        Q, R = (np.asarray(a, dtype=float)[None] for a in (estimate.Q, estimate.R))
        run = self.filter.run(Q, R)
        if run.failed[0] is not None:
            return {**scores, "position_rmse_m": np.inf, "final_position_error_m": np.inf}
        errors = run.estimates[0, :, 0] - self.truth.states[:, 0]
        return {
            **scores,
            "position_rmse_m": float(np.sqrt(np.mean(errors**2))),
            "final_position_error_m": float(abs(errors[-1])),
        }

    def illustration(self) -> dict[str, np.ndarray]:
        """Positions: measured, true if known, and by integrating the acceleration twice."""
        out = {"measured_m": self.model.y[:, 0], "integrated_m": integrate_twice(self)[:, 0]}
        if self.truth is not None:
            out["true_m"] = self.truth.states[:, 0]
        return out


def integrate_twice(problem: NoiseTuning) -> np.ndarray:
    """States by the known input alone, without any measurement: what Zhang et al. call direct computation.

    Parameters
    ----------
    problem : NoiseTuning
        A problem whose model has a known input.

    Returns
    -------
    ndarray, shape (T, n)
        From ``x0`` on, ``x[k+1] = F x[k] + B u[k]``.
    """
    model = problem.model
    states, drive = np.empty((model.n_steps, model.n_states)), model.drive
    states[0] = model.x0
    for k in range(model.n_steps - 1):
        states[k + 1] = (model.F if model.F.ndim == 2 else model.F[k]) @ states[k] + drive[k]
    return states
