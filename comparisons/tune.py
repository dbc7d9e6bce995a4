"""Tuning a user's own Kalman filter: from files or a problem to Q and R with what speaks for them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from comparisons.audit_solvers import parse_solver
from comparisons.tune_check import FilterCheck, check_filter
from comparisons.tune_errors import NoiseErrors, standard_errors
from navopt import registry
from navopt.data.filter_logs import FilterLog, read_log
from navopt.data.model_files import FilterFile, read_filter
from navopt.errors import InvalidInput, NavoptError
from navopt.problems.noise_tuning import NoiseEstimate, NoiseTuning
from navopt.solution import Solution
from navopt.solving import solve

__all__ = ["Tuning", "tune_files", "tune_filter"]

#: With fewer measurements per unknown a note says so.
PER_UNKNOWN = 50
#: Standard errors above so many decades are remarked on.
WIDE_DECADES = 0.3


@dataclass(frozen=True, kw_only=True)
class Tuning:
    """A tuned filter and everything needed to judge it.

    Attributes
    ----------
    name : str
        Of the filter.
    problem : NoiseTuning
        What was solved. It holds no truth.
    log : FilterLog
        Measurements with the names of their columns, times, and the truth if there is one.
    states : tuple of str
        Names of the states.
    estimate : NoiseEstimate
        Q and R as the solver gives them, one per step where it adapts.
    Q, R : ndarray, shapes (g, g) and (m, m)
        The same; geometric means over time where the estimate varies.
    errors : NoiseErrors
        Standard errors, or why there are none.
    before, after : FilterCheck
        The filter with its present and with the tuned covariances.
    solution : navopt.Solution
        The solver's answer.
    notes : tuple of str
        What was assumed or looks odd, in sentences.
    """

    name: str
    problem: NoiseTuning
    log: FilterLog
    states: tuple[str, ...]
    estimate: NoiseEstimate
    Q: np.ndarray
    R: np.ndarray
    errors: NoiseErrors
    before: FilterCheck
    after: FilterCheck
    solution: Solution
    notes: tuple[str, ...] = ()

    @property
    def varies(self) -> bool:
        """Whether the estimate varies with time."""
        return np.ndim(self.estimate.Q) == 3 or np.ndim(self.estimate.R) == 3

    @property
    def process_covariance(self) -> np.ndarray:
        """``G Q Gᵀ``, shape (n, n): what filters without a G call Q; that of the first step if G varies."""
        G = self.problem.model.G
        G = G if G.ndim == 2 else G[0]
        return np.asarray(G @ self.Q @ G.T)

    @property
    def gain(self) -> float:
        """Nats of log-likelihood gained."""
        return self.after.log_likelihood - self.before.log_likelihood

    @property
    def consistent(self) -> bool:
        """Whether the innovations of the tuned filter are white and of the size that it states."""
        return self.after.white and self.after.sized

    def scores(self) -> dict[str, float]:
        """Errors against the truth before and after; empty where the log has none."""
        if self.log.truth is None:
            return {}
        found = {}
        for word, check in (("before", self.before), ("after", self.after)):
            rmse, nees = check.state_errors(self.log.truth)
            for state, value in zip(self.states, rmse.tolist(), strict=True):
                if np.isfinite(value):
                    found[f"{state}_rmse_{word}"] = value
            if np.isfinite(nees):
                found[f"nees_{word}"] = nees
        return found

    def write(self, folder: str | Path, *, inputs: dict[str, Path] | None = None) -> list[Path]:
        """Write Q and R, innovations and report; see `comparisons.tune_output.write_tuning`."""
        from comparisons.tune_output import write_tuning

        return write_tuning(self, folder, inputs=inputs)


def tune_files(
    model: FilterFile | str | Path,
    log: FilterLog | str | Path,
    *,
    solver: str | Any = "innovation-likelihood",
    budget: int | None = None,
    seed: int = 1,
) -> Tuning:
    """Tune the filter of a model file on a log.

    Parameters
    ----------
    model : FilterFile or path
        The filter; a path is read by `navopt.data.read_filter`.
    log : FilterLog or path
        Its data; a path is read by `navopt.data.read_log`. A truth in it is used for scores only.
    solver, budget, seed
        As for `tune_filter`.

    Returns
    -------
    Tuning

    Raises
    ------
    InvalidInput
        If model or log cannot be used; see the page "Tune your Kalman filter".
    UnknownName, UnsuitableProblem
        If the solver does not exist or cannot solve such a problem.
    """
    described = model if isinstance(model, FilterFile) else read_filter(model)
    data = log if isinstance(log, FilterLog) else read_log(log, described)
    found = tune_filter(
        described.problem(data),
        before=(described.Q, described.R),
        solver=solver,
        budget=budget,
        seed=seed,
        log=data,
        states=described.states,
        name=described.name,
    )
    notes = (*described.assumed, *data.notes, *found.notes)
    return replace(found, notes=notes)


def tune_filter(
    problem: NoiseTuning,
    *,
    before: tuple[Any, Any] | None = None,
    solver: str | Any = "innovation-likelihood",
    budget: int | None = None,
    seed: int = 1,
    log: FilterLog | None = None,
    states: tuple[str, ...] | None = None,
    name: str = "filter",
) -> Tuning:
    """Tune the filter of a problem and check it before and after.

    Parameters
    ----------
    problem : NoiseTuning
        Model, data and what is to be found. If it carries a truth, that is used for scores only.
    before : (array_like, array_like), optional
        Q, of shape (g, g), and R that the filter has now; the problem's nominal ones if not given.
    solver : str or pymoo.core.algorithm.Algorithm
        Registered solver, with settings if need be (``"em:max_iterations=50"``), or an algorithm.
    budget : int, optional
        Largest cost; the solver's own rule if not given.
    seed : int
        Seed of a stochastic solver.
    log : FilterLog, optional
        Names of the columns, times and truth; made of the problem if not given.
    states : tuple of str, optional
        Names of the states.
    name : str
        Of the filter, for the report.

    Returns
    -------
    Tuning

    Raises
    ------
    InvalidInput
        If the objective of the problem needs a truth, the filter fails with its present noise, or the
        solver finds no covariances.
    UnknownName, UnsuitableProblem
        If the solver does not exist or cannot solve such a problem.
    """
    if not isinstance(problem, NoiseTuning):
        raise InvalidInput("problem", type(problem).__name__, "give a NoiseTuning")
    if problem.objective != "innovations":
        raise InvalidInput(
            "objective", problem.objective, 'tuning must not look at the truth: use "innovations"'
        )
    model = problem.model
    data = _log(problem) if log is None else log
    named = tuple(f"x{k}" for k in range(model.n_states)) if states is None else states
    if len(named) != model.n_states:
        raise InvalidInput("states", named, f"give a name for each of the {model.n_states} states")
    started = _check_present(problem, before)
    blind = _without_truth(problem)
    solution = solve(blind, _algorithm(solver), budget=budget, seed=seed)
    if solution.status == "invalid":
        raise InvalidInput("solver", solution.settings["solver"], f"no covariances found: {solution.message}")
    estimate = solution.estimate
    if getattr(estimate, "Q", None) is None or getattr(estimate, "R", None) is None:
        raise InvalidInput("solver", solution.settings["solver"], "give one that estimates both Q and R")
    try:
        after = check_filter(model, estimate.Q, estimate.R)
    except InvalidInput as error:
        raise InvalidInput(
            "solver", solution.settings["solver"], f"the filter fails with what it found ({error.value})"
        ) from None
    constant = [np.array(a) for a in (estimate.Q, estimate.R)]
    if any(a.ndim == 3 for a in constant):
        constant = [a[0] for a in problem.covariances(problem.project(estimate)[None])]
    found = Tuning(
        name=name,
        problem=blind,
        log=data,
        states=named,
        estimate=estimate,
        Q=constant[0],
        R=constant[1],
        errors=standard_errors(blind, estimate),
        before=started,
        after=after,
        solution=solution,
    )
    return replace(found, notes=tuple(_oddities(found)))


def _log(problem: NoiseTuning) -> FilterLog:
    """Log of a problem from arrays."""
    model = problem.model
    m = model.n_measurements
    return FilterLog(
        y=model.y,
        u=model.u,
        time=model.time,
        truth=None if problem.truth is None else problem.truth.states,
        channels=("y",) if m == 1 else tuple(f"y{k}" for k in range(m)),
    )


def _without_truth(problem: NoiseTuning) -> NoiseTuning:
    """The same problem as another object, from which no solver can learn the truth."""
    if problem.truth is None:
        return problem
    # problems are immutable, so that copying one gives the same object
    blind: NoiseTuning = object.__new__(type(problem))
    blind.__dict__.update(problem.__dict__ | {"truth": None, "true_x": None, "_world": None})
    return blind


def _check_present(problem: NoiseTuning, before: tuple[Any, Any] | None) -> FilterCheck:
    """The filter as it is now."""
    if before is None:
        Q, R = (a[0] for a in problem.covariances(problem.nominal[None]))
    else:
        Q, R = (np.atleast_2d(np.array(a, dtype=float)) for a in before)
    model = problem.model
    for name, a, size in (("Q", Q, model.n_noises), ("R", R, model.n_measurements)):
        if a.shape != (size, size):
            raise InvalidInput(f"before: {name}", f"shape {a.shape}", f"give shape {(size, size)}")
    try:
        return check_filter(model, Q, R)
    except InvalidInput as error:
        if error.argument != "Q, R":
            raise
        raise InvalidInput(
            "present Q and R", str(error.value), "give covariances with which the filter runs"
        ) from None


def _algorithm(solver: Any) -> Any:
    if not isinstance(solver, str):
        return solver
    entry = parse_solver(solver)
    try:
        return registry.make_solver(entry.name, **entry.settings)
    except (TypeError, ValueError) as error:
        if isinstance(error, NavoptError):
            raise
        # a value of another kind than the setting has
        raise InvalidInput("solver", solver, f"give settings that {entry.name} takes ({error})") from None


def _oddities(found: Tuning) -> list[str]:
    """What looks odd about an answer."""
    notes = []
    problem, estimate, after = found.problem, found.estimate, found.after
    seen = int(after.counts.sum())
    if seen < PER_UNKNOWN * problem.n_var:
        notes.append(f"{seen} measurements are few for {problem.n_var} unknowns of Q and R")
    if not getattr(estimate, "converged", True):
        notes.append(f"{found.solution.settings['solver']} did not come to its end")
    if not getattr(estimate, "determined", True):
        notes.append("the data do not determine every unknown: some numbers of Q or R are arbitrary")
    if not found.varies:
        Q, R = (a[0] for a in problem.covariances(problem.project(estimate)[None]))
        pairs = ((estimate.Q, Q), (estimate.R, R))
        if not all(np.allclose(a, b, rtol=1e-3, atol=1e-6 * np.abs(a).max()) for a, b in pairs):
            notes.append("the estimate is outside the bounds, which this solver does not know")
    wide = [name for name, sigma in found.errors.parameters.items() if sigma > WIDE_DECADES]
    if wide:
        notes.append(f"hardly determined by these data: {', '.join(wide)}")
    if found.gain < 0.0:
        notes.append(
            f"the measurements are less likely with these covariances than before, by {-found.gain:.1f} nats"
        )
    if not after.white:
        worst = found.log.channels[int(np.nanargmin(after.whiteness))]
        best = not found.errors.why_not
        notes.append(
            f"the innovations are not white after tuning ({worst}): "
            + (
                "the model (F, H, G, the input) or the assumption of white noise is wrong; no Q and R mend it"
                if best
                else "these are not the best Q and R, or the model (F, H, G, the input) is wrong"
            )
        )
    return notes
