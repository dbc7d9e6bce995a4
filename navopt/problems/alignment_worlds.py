"""Runs of an alignment: what its filter gets, from the model, from simulated sensors, or from a recording."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from navopt.errors import InvalidInput
from navopt.filters.batch_kalman import BatchKalman
from navopt.models.alignment_sensors import ImuGrade, coarse_covariance, simulate_static_imu
from navopt.models.coarse_alignment import coarse_alignment, level
from navopt.models.enu_attitude import corrected_attitude, misalignment, tilted_attitude
from navopt.models.linear_gaussian import LinearGaussianModel
from navopt.models.static_alignment import AlignmentModel, StaticSite
from navopt.models.static_strapdown import free_inertial
from navopt.problem import stream
from navopt.problems.alignment_scenario import AlignmentScenario

__all__ = ["AlignmentRun", "recorded_run", "simulated_run"]

NAME = "static-alignment"
#: Time over which the start of a free run is levelled, s.
LEVELLING_S = 1.0


@dataclass(frozen=True, kw_only=True)
class AlignmentRun:
    """What an alignment leaves to its filter.

    Attributes
    ----------
    site : StaticSite
        Where the system stands.
    grade : ImuGrade
        1 sigma of the errors of its sensors, as far as is known.
    steps : AlignmentModel
        The model in steps of the clock.
    velocity : ndarray, shape (T, 2)
        Computed velocities east and north, which are errors, m/s.
    x0 : ndarray, shape (10,)
        Mean of the state at the first of them.
    P0 : ndarray, shape (10, 10)
        Its covariance.
    velocity_sigma : float
        1 sigma of the disturbance of each velocity, m/s.
    computed : ndarray, shape (3, 3)
        C_b^n as the system computes it at the last of them, without any correction.
    states : ndarray, shape (T, 10), or None
        The true errors, of a simulated run.
    attitude : ndarray, shape (3, 3), or None
        The true C_b^n, of a simulated run.
    true_grade : ImuGrade or None
        What the sensors of a simulated run really are.
    """

    site: StaticSite
    grade: ImuGrade
    steps: AlignmentModel
    velocity: np.ndarray
    x0: np.ndarray
    P0: np.ndarray
    velocity_sigma: float
    computed: np.ndarray
    states: np.ndarray | None = None
    attitude: np.ndarray | None = None
    true_grade: ImuGrade | None = None

    @property
    def Q(self) -> np.ndarray:
        """Covariance that noise as declared adds in a step, shape (5, 5)."""
        return self.steps.process_covariance(self.grade.accelerometer_noise, self.grade.gyro_noise)

    @property
    def true_Q(self) -> np.ndarray | None:
        """Covariance that the noise of a simulated run adds in a step."""
        grade = self.true_grade
        if grade is None:
            return None
        return self.steps.process_covariance(grade.accelerometer_noise, grade.gyro_noise)

    @property
    def R(self) -> np.ndarray:
        """Covariance of a measured velocity, shape (2, 2)."""
        return np.eye(2) * self.velocity_sigma**2

    @property
    def model(self) -> LinearGaussianModel:
        """Model and measurements."""
        return LinearGaussianModel(
            F=self.steps.transition,
            H=self.steps.measurement,
            y=self.velocity,
            G=self.steps.noise_input,
            x0=self.x0,
            P0=self.P0,
        )


def simulated_run(scenario: AlignmentScenario, seed: int, draw: int | None = None) -> AlignmentRun:
    """Draw one run.

    Parameters
    ----------
    scenario : AlignmentScenario
        All but the seed.
    seed : int
        Of the constant errors: of the sensors and of the initial attitude.
    draw : int, optional
        Another draw of all noise.

    Returns
    -------
    AlignmentRun
    """
    site, true, count = scenario.site, scenario.attitude, scenario.steps
    world = stream(f"world:{NAME}", seed)
    kicks = world.standard_normal(11)
    if scenario.errors == "published":
        kicks = np.ones(11)
    powers = world.uniform(-scenario.spread_decades, scenario.spread_decades, 2)
    factors = 10.0 ** (0.5 * (powers[[0, 0]] if scenario.same_spread else powers))
    grade = replace(
        scenario.grade,
        accelerometer_noise=float(scenario.grade.accelerometer_noise * factors[0]),
        gyro_noise=float(scenario.grade.gyro_noise * factors[1]),
    )
    noise = stream(f"noise:{NAME}", *([seed] if draw is None else [seed, draw]))
    sigma = scenario.sigma
    start = sigma * kicks[:10]
    common: dict[str, Any] = {
        "site": site, "grade": scenario.grade, "true_grade": grade, "attitude": true,
        "velocity_sigma": scenario.velocity_sigma,
    }  # fmt: skip
    steps = AlignmentModel.of(site, scenario.step_s, true)
    disturbance = scenario.velocity_sigma * noise.standard_normal((count + 1, 2))
    if scenario.data == "model":
        Q = steps.process_covariance(grade.accelerometer_noise, grade.gyro_noise)
        pushes = noise.standard_normal((count, 5)) @ _root(Q).T
        states = np.empty((count + 1, 10))
        states[0] = start
        for k, push in enumerate(pushes):
            states[k + 1] = steps.transition @ states[k]
            states[k + 1, :5] += push
        P0, x0 = np.diag(sigma**2), np.zeros(10)
        computed = tilted_attitude(true, states[-1, 2:5])
    else:
        start[:2] = 0.0
        bias = np.append(start[5:7], grade.accelerometer_bias * kicks[10])
        readings = simulate_static_imu(
            site, true, grade, steps=count, step=scenario.step_s, gyro_bias=start[7:],
            accelerometer_bias=bias, rng=noise,
        )  # fmt: skip
        velocity, attitudes = free_inertial(
            *readings, scenario.step_s, site, tilted_attitude(true, start[2:5])
        )
        constant = np.broadcast_to(start[5:], (count + 1, 5))
        states = np.hstack(
            [velocity, misalignment(attitudes, np.broadcast_to(true, attitudes.shape)), constant]
        )
        P0, x0, computed = np.diag(sigma**2), np.zeros(10), attitudes[-1]
    return AlignmentRun(
        steps=steps, velocity=states[:, :2] + disturbance, x0=x0, P0=P0, computed=computed, states=states,
        **common,
    )  # fmt: skip


def recorded_run(
    gyro: Any,
    accelerometer: Any,
    step: float,
    site: StaticSite,
    grade: ImuGrade,
    *,
    coarse_s: float,
    clock_s: float = 1.0,
    velocity_sigma: float = 0.01,
    azimuth_sigma: float | None = None,
    heading: float | None = None,
    restarts: int = 2,
) -> AlignmentRun:
    """Align coarsely with the first part of a recording and run freely through the rest.

    Parameters
    ----------
    gyro, accelerometer : array_like, shape (N, 3)
        Angular rate and specific force in axes right, forward, up, rad/s and m/s^2, of a system at rest.
    step : float
        Time between two samples, s.
    site, grade
        Where it stood, and how good its sensors are.
    coarse_s : float
        Length of the coarse alignment, s.
    clock_s : float
        Time between two measured velocities, s.
    velocity_sigma : float
        1 sigma of the velocity with which the vehicle sways, m/s.
    azimuth_sigma : float, optional
        1 sigma of the heading, rad, required with it; or of the azimuth of the coarse alignment beside what
        the sensors' constant errors do to it: what its scatter tells if not given.
    heading : float, optional
        Heading from elsewhere, clockwise from north, rad, where the gyros cannot tell it.
    restarts : int
        How often the free run is repeated from the azimuth and the tilt that were found, so that an error
        of many degrees does not meet a model of small angles. The prior stays about the first start.

    Returns
    -------
    AlignmentRun

    Raises
    ------
    InvalidInput
        If the recording is too short, or as for `navopt.models.coarse_alignment.coarse_alignment`.

    Notes
    -----
    A vehicle that is disturbed also turns: the free run follows that, which a coarse alignment cannot.
    The start is levelled by the first second of the free run. The velocities are points, not means.
    """
    w, f = np.asarray(gyro, dtype=float), np.asarray(accelerometer, dtype=float)
    first, every = round(coarse_s / step), round(clock_s / step)
    if every < 1 or abs(every * step - clock_s) > 1e-6 * clock_s:
        raise InvalidInput("clock_s", clock_s, f"give a multiple of the sampling interval, {step:g} s")
    if len(w) < first + 20 * every:
        raise InvalidInput(
            "gyro",
            f"{len(w) * step:g} s of samples",
            f"give more than the coarse alignment of {coarse_s:g} s and twenty steps of {clock_s:g} s",
        )
    coarse = coarse_alignment(
        w[:first], f[:first], site.latitude, heading=heading, gyro_error=grade.gyro_bias, gravity=site.g
    )
    if heading is not None and azimuth_sigma is None:
        raise InvalidInput("azimuth_sigma", None, "say how well the heading is known, in rad")
    sigma = float(coarse.angle_sigma[2] if azimuth_sigma is None else azimuth_sigma)
    begin = slice(first, first + max(1, round(LEVELLING_S / step)))
    start = level(f[begin].mean(axis=0), coarse.yaw)
    P0 = coarse_covariance(
        site, start, grade, duration=LEVELLING_S, velocity_sigma=velocity_sigma,
        heading_sigma=None if heading is None else sigma,
    )  # fmt: skip
    if heading is None:
        P0[4, 4] += sigma**2
    # the vehicle sways while it is levelled: the change of its velocity is taken for gravity
    P0[[2, 3], [2, 3]] += 2.0 * (velocity_sigma / LEVELLING_S / site.g) ** 2
    x0 = np.zeros(10)
    for restart in range(restarts + 1):
        velocity, attitudes = free_inertial(w[first:], f[first:], step, site, start)
        chosen = np.arange(0, len(velocity), every)
        run = AlignmentRun(
            site=site, grade=grade, steps=AlignmentModel.of(site, clock_s, attitudes[0]),
            velocity=velocity[chosen], x0=x0, P0=P0, velocity_sigma=velocity_sigma,
            computed=attitudes[chosen[-1]],
        )  # fmt: skip
        if restart < restarts:
            found = BatchKalman(run.model).smooth(run.Q, run.R).estimates[0, 0]
            start = corrected_attitude(start, found[2:5])
            # what was known of the angles stays where it was: about the start that is now behind
            x0 = np.concatenate([x0[:2], x0[2:5] - found[2:5], x0[5:]])
    return run


def _root(covariance: np.ndarray) -> np.ndarray:
    """Root of a covariance whose entries differ by many orders, by its correlations."""
    sigma = np.sqrt(np.diag(covariance))
    scale = np.where(sigma > 0.0, sigma, 1.0)
    values, vectors = np.linalg.eigh(covariance / np.outer(scale, scale))
    return scale[:, None] * vectors * np.sqrt(np.maximum(values, 0.0))
