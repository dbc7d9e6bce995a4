"""What a run returns, and its two files on disk."""

from __future__ import annotations

import dataclasses
import importlib
import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from navopt.errors import InvalidInput
from navopt.evaluation import TRACE_DTYPE, Counts
from navopt.problem import EstimationProblem

__all__ = ["Solution"]

FORMAT = 1


@dataclass(frozen=True)
class Solution:
    """Result of `navopt.solve`.

    Attributes
    ----------
    x : ndarray, shape (n_var,)
        Best decision vector evaluated, or the projection of an attached estimate.
    loss : float
        Its loss, bit for bit ``problem.loss(x)``.
    estimate : object
        The physical answer: ``problem.estimate(x)``, or what a solver attached that knows more.
    fitted : object or None
        What an attaching solver learnt; ``fitted.apply(problem)`` re-runs it on held-out data.
    scores : dict of str to float
        ``problem.score(estimate)``; empty where the problem carries no truth.
    counts : Counts
        What was evaluated.
    trace : ndarray of (cost, loss, elapsed_s)
        One row per improvement, plus the first and the last evaluation.
    elapsed_s : float
        Wall time of the run in seconds.
    status : {"budget", "target", "converged", "stopped", "interrupted", "invalid"}
        Why it ended; ``invalid`` when no candidate could be evaluated.
    message : str
        The same in a sentence.
    invalid : dict of str to int
        Candidates with infinite loss, tallied by reason.
    settings : dict
        Problem, solver and its options, seed, budget, target and versions.
    """

    x: np.ndarray
    loss: float
    estimate: Any
    fitted: Any
    scores: dict[str, float]
    counts: Counts
    trace: np.ndarray
    elapsed_s: float
    status: str
    message: str
    invalid: dict[str, int] = field(default_factory=dict)
    settings: dict[str, Any] = field(default_factory=dict)

    def apply(self, problem: EstimationProblem) -> dict[str, float]:
        """Scores of what was learnt, on another problem of the same kind (the held-out twin)."""
        if self.fitted is not None:
            return problem.score(self.fitted.apply(problem))
        return problem.score(problem.estimate(self.x))

    def save(self, path: str | Path) -> tuple[Path, Path]:
        """Write ``path.json`` (everything readable) and ``path.npz`` (the arrays).

        Returns
        -------
        tuple of pathlib.Path
            The two files.
        """
        arrays: dict[str, np.ndarray] = {"x": self.x, "trace": self.trace}
        document = {
            "format": FORMAT,
            "loss": self.loss,
            "scores": self.scores,
            "counts": dataclasses.asdict(self.counts),
            "elapsed_s": self.elapsed_s,
            "status": self.status,
            "message": self.message,
            "invalid": self.invalid,
            "settings": self.settings,
            "estimate": _describe("estimate", self.estimate, arrays),
            "fitted": _describe("fitted", self.fitted, arrays),
        }
        base = Path(path)
        base.parent.mkdir(parents=True, exist_ok=True)
        files = base.with_name(base.name + ".json"), base.with_name(base.name + ".npz")
        files[0].write_text(json.dumps(document, indent=1, default=_plain), encoding="utf-8")
        np.savez_compressed(files[1], **arrays)  # type: ignore[arg-type]
        return files

    @classmethod
    def load(cls, path: str | Path) -> Solution:
        """Read what `save` wrote; nothing in the files is executed.

        An estimate or a fitted object of a class from outside this distribution comes back as None: a
        file must not choose what is imported. ``problem.estimate(solution.x)`` makes it anew.

        Parameters
        ----------
        path : path-like
            The path given to `save`, without suffix.

        Raises
        ------
        InvalidInput
            If the files are missing or of a newer format.
        """
        base = Path(path)
        texts, data = base.with_name(base.name + ".json"), base.with_name(base.name + ".npz")
        if not (texts.is_file() and data.is_file()):
            raise InvalidInput("path", str(path), "give the path that was passed to save(), without suffix")
        document = json.loads(texts.read_text(encoding="utf-8"))
        if document.get("format") != FORMAT:
            raise InvalidInput("path", str(path), f"format {document.get('format')} is not {FORMAT}; update")
        with np.load(data, allow_pickle=False) as stored:
            arrays = {key: stored[key] for key in stored.files}
        return cls(
            x=arrays["x"],
            loss=float(document["loss"]),
            estimate=_restore("estimate", document["estimate"], arrays),
            fitted=_restore("fitted", document["fitted"], arrays),
            scores=document["scores"],
            counts=Counts(**document["counts"]),
            trace=arrays["trace"].astype(TRACE_DTYPE),
            elapsed_s=document["elapsed_s"],
            status=document["status"],
            message=document["message"],
            invalid=document["invalid"],
            settings=document["settings"],
        )


def _plain(value: Any) -> Any:
    """JSON form of numpy scalars and arrays; anything else by its repr, for the reader only."""
    if isinstance(value, np.generic | np.ndarray):
        return value.tolist()
    return repr(value)


def _describe(label: str, thing: Any, arrays: dict[str, np.ndarray]) -> dict[str, Any] | None:
    if thing is None or not dataclasses.is_dataclass(thing):
        return None
    values = {}
    for item in dataclasses.fields(thing):
        value = getattr(thing, item.name)
        if isinstance(value, np.ndarray):
            arrays[f"{label}.{item.name}"] = value
        else:
            values[item.name] = value
    return {"class": f"{type(thing).__module__}:{type(thing).__qualname__}", "values": values}


def _restore(label: str, description: dict[str, Any] | None, arrays: dict[str, np.ndarray]) -> Any:
    if description is None:
        return None
    module, _, name = description["class"].partition(":")
    # a stored name may only lead to our own dataclasses: a file must not choose what is imported
    if module.partition(".")[0] not in ("navopt", "baselines", "comparisons"):
        return None
    cls = getattr(importlib.import_module(module), name, None)
    if not (isinstance(cls, type) and dataclasses.is_dataclass(cls)):
        return None
    values = dict(description["values"])
    values.update(
        {key.partition(".")[2]: value for key, value in arrays.items() if key.startswith(label + ".")}
    )
    return cls(**values)
