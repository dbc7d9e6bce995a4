"""Group by group: many runs of a swarm on each group of parameters, their mean passed on (paper 004, 3.3)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Self

import numpy as np
from pymoo.core.population import Population
from pymoo.core.termination import NoTermination

from navopt.algorithms.inner_runs import InnerRuns, inner_runs
from navopt.algorithms.options import at_least, number, one_of
from navopt.algorithms.phased_fit import PhasedFit
from navopt.algorithms.swarm import ContractedAlgorithm
from navopt.errors import InvalidInput, UnknownName, UnsuitableProblem
from navopt.evaluation import CountingEvaluator
from navopt.problem import EstimationProblem
from navopt.problems.restricted import Restricted
from navopt.registry import solver

__all__ = ["Phased"]

#: Groups of parameters: names by label, or lists of names.
Groups = Mapping[str, Sequence[str]] | Sequence[Sequence[str]]
_OPTIONAL = {
    "threshold": "give a loss, or None",
    "tolerance": "give a change of the loss, at least 0, or None",
    "inner_tolerance": "give a change of the loss, at least 0, or None",
}


@solver(
    "phased",
    summary="any solver on one group of parameters after another, the mean of many runs passed on",
    source="Gao et al. 2015, Sensors 15:10547 (sections 3.2 and 3.3, MCS-NAFSA)",
    spends_all=False,
    reasons={
        "spends_all": "it stops by its own conditions: repetitions, threshold or tolerance",
        "comparison_based": "threshold and tolerance look at losses, and so may the inner solver",
    },
)
class Phased(ContractedAlgorithm):
    """Search of one group of parameters after another, by many independent runs of an inner solver.

    A *phase* restricts the problem to one group, the other parameters held, and lets `runs_per_phase` runs of
    the inner solver search it, each with a seed of its own. The mean of their best points is the phase's
    result. All groups in their order make a *repetition*. After every phase the identified values (the means
    so far, presets elsewhere) are evaluated: their loss is the *indicator*, at a cost of 1.

    Parameters
    ----------
    inner : str, default "nafsa"
        Registry name of the inner solver, any but ``phased`` itself.
    groups : mapping of str to sequence of str, or sequence of sequence of str, optional
        Names of the parameters of each group, by label or in order (then labelled ``1``, ``2``, …).
        The problem's ``parameter_groups`` if not given; all parameters in one group where it has none.
        A parameter in no group stays at its preset.
    runs_per_phase : int, default 100
        Runs of the inner solver in each phase, the paper's N.
    cycles : int, default 60
        Cycles of each run: those of a swarm, batches after the first of any other solver. The inner
        solver's `horizon` is not set by it.
    repetitions : int, default 10
        Largest number of repetitions.
    chain : {"means", "presets"}
        Whether a phase holds the others at the means already found, and begins around its own; or at the
        presets, always.
    answer : {"best", "mean"}
        What the search reports: the best point ever evaluated, or the identified values (attached as
        ``estimate``; for the group under way, the mean of what its runs have found so far).
    threshold : float, optional
        Stop when the indicator is this or less; a run of the inner solver ends there too.
    tolerance : float, optional
        Stop when the indicator of a repetition differs from that of the last by this or less.
    inner_tolerance : float, optional
        End a run of the inner solver when a cycle has lowered its best loss by this or less.
    options : mapping, optional
        Keywords of the inner solver in all phases.
    group_options : mapping of str to mapping, optional
        Further keywords by the label of the group.
    **kwargs
        Keywords of `pymoo.core.algorithm.Algorithm`.

    Attributes
    ----------
    repetition : int
        Repetitions completed.
    fitted : PhasedFit or None
        Means and standard deviations of all completed phases; None before the first has ended.

    Notes
    -----
    The three stop conditions are those of section 3.2 of Gao et al. (2015): a number of iterations, a
    threshold on the indicator (their eq. 14), a change from one iteration to the next. The paper names them
    for the swarm and for the three stages around it, so both have them. It lets the change of iterations that
    improve nothing end a search as it is worded; that is why both tolerances are off by default.

    Its section 3.3.2 loads the means of earlier phases, its section 4.1 and Table 2 the presets of all
    categories that are not searched: the two readings of `chain`. What a run hands over is not printed;
    here it is its best point.

    A batch holds the candidates of all runs of a phase. A repetition costs
    ``runs_per_phase × (evaluations of one run)`` per group, plus 1: a budget that is smaller never comes to
    the last group, so choose `runs_per_phase` and `cycles` to fit it. A swarm inside is the same, bit for
    bit, as alone on `navopt.problems.Restricted` with the same seed.
    """

    def __init__(
        self,
        *,
        inner: str = "nafsa",
        groups: Groups | None = None,
        runs_per_phase: int = 100,
        cycles: int = 60,
        repetitions: int = 10,
        chain: str = "means",
        answer: str = "best",
        threshold: float | None = None,
        tolerance: float | None = None,
        inner_tolerance: float | None = None,
        options: Mapping[str, Any] | None = None,
        group_options: Mapping[str, Mapping[str, Any]] | None = None,
        **kwargs: Any,
    ) -> None:
        super().__init__(**kwargs)
        if inner == "phased":
            raise InvalidInput("inner", inner, "give another solver: phases do not nest")
        self.inner = inner
        self.groups = None if groups is None else _labelled(groups)
        self.runs_per_phase = at_least("runs_per_phase", runs_per_phase, 1)
        self.cycles = at_least("cycles", cycles, 1)
        self.repetitions = at_least("repetitions", repetitions, 1)
        self.chain = one_of("chain", chain, ("means", "presets"))
        self.answer = one_of("answer", answer, ("best", "mean"))
        for name, value in (
            ("threshold", threshold),
            ("tolerance", tolerance),
            ("inner_tolerance", inner_tolerance),
        ):
            if value is not None:
                value = number(name, value)
                if name != "threshold" and value < 0:
                    raise InvalidInput(name, value, _OPTIONAL[name])
            setattr(self, name, value)
        self.options = _options("options", options)
        self.group_options = {
            str(label): _options(f"group_options of {label}", own)
            for label, own in _options("group_options", group_options).items()
        }
        self.repetition, self.phase = 0, 0
        self.runs: InnerRuns | None = None
        self.records: list[dict[str, Any]] = []
        self.last_indicator: float | None = None
        self.asked: np.ndarray | None = None
        self.told: tuple[np.ndarray, np.ndarray] | None = None

    @classmethod
    def published(cls, inner: str = "nafsa", **kwargs: Any) -> Self:
        """Build the procedure of paper 004 for tri-axial gyros, on `navopt.problems.GyroCalibration`.

        Scale factors, biases, misalignments; 50 fish, 60 cycles, 100 runs; fields of vision of Table 1 as
        printed, around the presets; the mean is the answer, and one repetition.

        Parameters
        ----------
        inner : {"nafsa", "oafsa", "afsa"}
            Which fish swarm. The paper prints settings of the first only. The other two have the same field
            of vision, half of it as the longest step, and ten attempts.
        **kwargs
            Keywords of `Phased` to be set otherwise.
        """
        from navopt.algorithms.gyro_phases import published_phases

        return cls(**{**published_phases(inner), "inner": inner, **kwargs})

    def setup(self, problem: Any, **kwargs: Any) -> Any:
        """Prepare for a problem: find its groups, and check the inner solver's options on each."""
        if not isinstance(problem, EstimationProblem):
            raise UnsuitableProblem(
                f"phased holds parameters by their names, which {type(problem).__name__} has not: "
                "give a navopt.EstimationProblem"
            )
        if kwargs.get("termination") is None and self.termination is None:
            kwargs["termination"] = NoTermination()  # pymoo's default would stop inside a phase
        self._members = _groups_of(problem, self.groups)
        for label in self.group_options:
            if label not in self._members:
                raise UnknownName("group_options", label, self._members)
        super().setup(problem, **kwargs)
        self.presets = np.array(problem.nominal, dtype=float)
        self.held, self.identified = self.presets.copy(), self.presets.copy()
        self._begin_phase()
        return self

    # -- a phase ---------------------------------------------------------------------------------------
    @property
    def label(self) -> str:
        """Label of the group under way."""
        return list(self._members)[self.phase]

    def _begin_phase(self) -> None:
        names = self._members[self.label]
        self.restricted = Restricted(self.problem, names, self.held)
        self.runs = inner_runs(
            self.inner,
            {**self.options, **self.group_options.get(self.label, {})},
            self.restricted,
            self.random_state.integers(2**32, size=self.runs_per_phase),
            evaluator=self.evaluator,
            cycles=self.cycles,
            threshold=self.threshold,
            tolerance=self.inner_tolerance,
        )

    def _pass_on(self) -> None:
        """Take the mean of the runs as the result of the phase; it is to be evaluated next."""
        runs, free = self.runs, self.restricted.free
        assert runs is not None
        found = np.isfinite(runs.best_loss)
        full = np.where(found[:, None], self.restricted.inward(runs.best), np.nan)
        member = np.zeros(len(self.presets), dtype=bool)
        member[free] = True
        mean, sd = self.held.copy(), np.full(len(self.presets), np.nan)
        mean[free] = self._mean_of_runs()
        if found.sum() > 1:
            sd[free] = full[found][:, free].std(axis=0, ddof=1)
        self.identified = self.identified.copy()
        self.identified[free] = mean[free]
        if self.chain == "means":
            self.held = self.identified.copy()
        self.records.append(
            {
                "labels": self.label,
                "repetition": self.repetition,
                "member": member,
                "runs": full,
                "run_loss": runs.best_loss.copy(),
                "mean": mean,
                "sd": sd,
            }
        )
        self.runs = None

    def _mean_of_runs(self) -> np.ndarray:
        """Mean of the best points, inside the box; where the group began if nothing could be evaluated."""
        assert self.runs is not None
        found = np.isfinite(self.runs.best_loss)
        if not found.any():
            return self.held[self.restricted.free]
        return self.restricted.clip(self.runs.best[found].mean(axis=0))

    def _judge(self, indicator: float) -> None:
        """Stop, or go on to the next phase, knowing the loss of the identified values."""
        self.records[-1]["indicator"] = indicator
        self.phase += 1
        ends = self.threshold is not None and indicator <= self.threshold
        if self.phase == len(self._members):
            self.phase, last = 0, self.last_indicator
            self.repetition, self.last_indicator = self.repetition + 1, indicator
            ends |= self.repetition >= self.repetitions
            if self.tolerance is not None and last is not None:
                # equal infinities have not changed either
                ends |= indicator == last or abs(indicator - last) <= self.tolerance
        if ends:
            self.termination.terminate()
        else:
            self._begin_phase()

    # -- pymoo's side ------------------------------------------------------------------------------------
    def _initialize_infill(self) -> Population:
        return self._infill()

    def _initialize_advance(self, infills: Population | None = None, **kwargs: Any) -> None:
        self._advance(infills)

    def _infill(self) -> Population:
        if not self.has_next():
            # pymoo asks again only if a user goes on after the end: the answer has not changed
            return Population.new(X=self.opt.get("X"))  # type: ignore[union-attr]
        return Population.new(X=self._batch())

    def _batch(self) -> np.ndarray:
        if self.asked is None:
            candidates = np.zeros(0) if self.runs is None else self.runs.ask()
            if self.runs is not None and not len(candidates):
                self._pass_on()
            self.asked = self.identified[None] if self.runs is None else self.restricted.inward(candidates)
        return self.asked

    def next(self) -> None:
        """Take one batch, in pymoo an individual of its best candidate only.

        A hundred runs make batches of thousands, and individuals cost more than such losses and moves
        together. `ask` and `tell` hand out and take all of them, with the same results.
        """
        counted = isinstance(self.evaluator, CountingEvaluator) and self.archive is None
        if not counted or (self.is_initialized and not self.has_next()):
            return super().next()
        if not self.is_initialized:
            self._initialize()
        X = self._batch()
        self.told = (X, self.evaluator.losses(self.problem, X))
        k = int(np.argmin(self.told[1]))
        best = Population.new(X=X[[k]], F=self.told[1][[k], None], n_gen=[self.n_iter], n_iter=[self.n_iter])
        best[0].evaluated.update(("F", "G", "H"))
        self.advance(infills=best)

    def _advance(self, infills: Population | None = None, **kwargs: Any) -> None:
        if not self.has_next():
            return
        if self.told is None:
            X, losses = infills.get("X").astype(float), infills.get("F")[:, 0]  # type: ignore[union-attr]
        else:
            X, losses = self.told
        self.asked = self.told = None
        if self.runs is None:
            self._judge(float(losses[0]))
        else:
            self.runs.tell(X[:, self.restricted.free], losses)

    # -- what it reports -------------------------------------------------------------------------------------
    @property
    def estimate(self) -> Any:
        """Physical answer of the identified values where ``answer="mean"``; otherwise None."""
        if self.answer == "best" or self.problem is None:
            return None
        return self.problem.estimate(self._identified_so_far())

    def _identified_so_far(self) -> np.ndarray:
        values = self.identified.copy()
        if self.runs is not None:
            values[self.restricted.free] = self._mean_of_runs()
        return values

    @property
    def fitted(self) -> PhasedFit | None:
        """Means and standard deviations of all completed phases; None before the first."""
        records = [record for record in self.records if "indicator" in record]
        if not records:
            return None
        columns = {key: [record[key] for record in records] for key in records[0]}
        # the evaluator also knows the part of a batch that the budget has cut
        best = getattr(self.evaluator, "best_x", None)
        if best is None:
            best = self.opt[0].X  # type: ignore[index]
        x = self._identified_so_far() if self.answer == "mean" else np.array(best, dtype=float)
        return PhasedFit(
            parameters=self.problem.parameter_names,
            units=tuple(parameter.unit for parameter in self.problem.parameters),
            presets=self.presets.copy(),
            labels=tuple(columns.pop("labels")),
            x=x,
            **{key: np.array(values) for key, values in columns.items()},
        )


def _options(argument: str, value: Mapping[str, Any] | None) -> dict[str, Any]:
    if value is None:
        return {}
    if not isinstance(value, Mapping):
        raise InvalidInput(argument, value, "give keywords with their values")
    return {str(key): item for key, item in value.items()}


def _labelled(groups: Groups) -> dict[str, tuple[str, ...]]:
    """Groups by label; an error if one is empty or a name is in two."""
    if isinstance(groups, str) or not isinstance(groups, Mapping | Sequence):
        raise InvalidInput("groups", groups, "give lists of parameter names, or such lists by label")
    items = groups.items() if isinstance(groups, Mapping) else enumerate(groups, start=1)
    labelled = {}
    for label, members in items:
        labelled[str(label)] = (members,) if isinstance(members, str) else tuple(str(m) for m in members)
    names = [name for members in labelled.values() for name in members]
    if not labelled or not all(labelled.values()) or len(set(names)) < len(names):
        raise InvalidInput("groups", groups, "give at least one group, none empty and no parameter in two")
    return labelled


def _groups_of(
    problem: EstimationProblem, groups: dict[str, tuple[str, ...]] | None
) -> dict[str, tuple[str, ...]]:
    known = problem.parameter_names
    if groups is None:
        own = getattr(problem, "parameter_groups", None) or {"all": known}
        kept = {str(label): tuple(n for n in members if n in known) for label, members in own.items()}
        return _labelled({label: members for label, members in kept.items() if members})
    for members in groups.values():
        for name in members:
            if name not in known:
                raise UnknownName("groups", name, known)
    return groups
