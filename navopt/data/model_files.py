"""A user's filter as a TOML file: matrices, present noise, what may change, and the columns of its log."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from navopt.data.model_matrices import bounds_of, check_noise, check_shape, matrix_of
from navopt.errors import InvalidInput, UnknownName
from navopt.models.linear_gaussian import check_covariance

if TYPE_CHECKING:
    from navopt.data.filter_logs import FilterLog
    from navopt.problems.noise_tuning import NoiseTuning

__all__ = ["FilterFile", "parse_filter", "read_filter"]

_TABLES = {
    "name": str,
    "time_step": (int, float),
    "covariance": str,
    "measurement_covariance": str,
    "states": list,
    "model": Mapping,
    "noise": Mapping,
    "bounds": Mapping,
    "columns": Mapping,
}
_WORDS = {str: "a text", Mapping: "a table", list: "a list of texts", (int, float): "a number"}
_MODEL = ("F", "A", "H", "G", "B", "x0", "P0")
_COLUMNS = ("time", "y", "u", "truth")
#: Largest partial correlation that is searched.
CORRELATION = 0.99


@dataclass(frozen=True, kw_only=True)
class FilterFile:
    """A linear filter that is to be tuned, as its file describes it.

    Attributes
    ----------
    name : str
        Of the filter.
    source : str
        Name of the file; empty if there is none.
    F : ndarray, shape (n, n), or None
        Transition over one time step; None where `A` is given.
    A : ndarray, shape (n, n), or None
        ``dx/dt = A x + B u + G w`` instead of a transition; time steps may then vary.
    H : ndarray, shape (m, n)
        Measurement matrix.
    G : ndarray, shape (n, g)
        Where the process noise enters.
    B : ndarray, shape (n, p), or None
        Where the known input enters.
    x0 : ndarray, shape (n,)
        Mean of the state at the first measurement, before it is used.
    P0 : ndarray, shape (n, n), or None
        Its covariance; None leaves it wide.
    time_step : float or None
        Seconds between measurements.
    Q, R : ndarray, shapes (g, g) and (m, m)
        Noise that the filter assumes now.
    covariance, measurement_covariance : {"scalar", "diagonal", "full", "fixed"}
        What is to be found of Q and R.
    bounds : dict of str to ndarray, shape (2,) or (k, 2)
        Least and largest multiple of the present variances, for ``"Q"`` and ``"R"``.
    states : tuple of str
        Names of the states.
    columns : dict
        ``time`` (text or None), ``y`` and ``u`` (tuples of texts) and ``truth`` (column by state).
    assumed : tuple of str
        What the file does not say and was assumed, in sentences.
    """

    name: str
    source: str = ""
    F: np.ndarray | None
    A: np.ndarray | None
    H: np.ndarray
    G: np.ndarray
    B: np.ndarray | None
    x0: np.ndarray
    P0: np.ndarray | None
    time_step: float | None
    Q: np.ndarray
    R: np.ndarray
    covariance: str
    measurement_covariance: str
    bounds: dict[str, np.ndarray]
    states: tuple[str, ...]
    columns: dict[str, Any]
    assumed: tuple[str, ...] = ()

    def matrices(self, log: FilterLog) -> dict[str, Any]:
        """Transition, input and noise matrices for the times of a log, one per step only where steps vary.

        A continuous model is discretised with u and w held over each step. Q is then the covariance of w
        held over one usual step; over a step of another length dt it is Q times usual step over dt, so that
        the spectral density is the same.
        """
        if self.A is None:
            return {"F": self.F, "G": self.G, "B": self.B}
        steps = log.steps(self.time_step)
        usual = float(np.median(steps))
        if log.regular:
            steps = np.array([usual])
        pairs = {dt: _held(self.A, dt) for dt in np.unique(steps).tolist()}
        F = np.array([pairs[dt][0] for dt in steps.tolist()])
        hold = np.array([pairs[dt][1] for dt in steps.tolist()])
        G = hold @ self.G * np.sqrt(usual / steps)[:, None, None]
        B = None if self.B is None else hold @ self.B
        if len(steps) == 1:
            return {"F": F[0], "G": G[0], "B": None if B is None else B[0]}
        # the matrices that lead away from the last measurement are not used
        return {
            name: None if a is None else np.concatenate([a, a[-1:]])
            for name, a in (("F", F), ("G", G), ("B", B))
        }

    def problem(self, log: FilterLog) -> NoiseTuning:
        """Problem of tuning this filter on a log; it does not hold the log's truth.

        Raises
        ------
        InvalidInput
            If the log is too short or the model does not fit it.
        """
        from navopt.problems.noise_tuning import NoiseTuning

        def reference(matrix: np.ndarray, form: str) -> np.ndarray:
            return np.diag(np.diag(matrix)) if form in ("diagonal", "full") else matrix

        return NoiseTuning(
            H=self.H,
            data=log.y,
            u=log.u,
            x0=self.x0,
            P0=self.P0,
            covariance=self.covariance,
            measurement_covariance=self.measurement_covariance,
            Q_reference=reference(self.Q, self.covariance),
            R_reference=reference(self.R, self.measurement_covariance),
            box=self._box(),
            **self.matrices(log),
        )

    def _box(self) -> np.ndarray:
        """Bounds of the decision vector: logarithms of multiples, then partial correlations."""
        rows: list[np.ndarray] = []
        for name, size, form in (
            ("Q", len(self.Q), self.covariance),
            ("R", len(self.R), self.measurement_covariance),
        ):
            count = {"scalar": 1, "fixed": 0}.get(form, size)
            rows.append(np.broadcast_to(np.log10(self.bounds[name]), (count, 2)))
            pairs = size * (size - 1) // 2 if form == "full" else 0
            rows.append(np.broadcast_to([-CORRELATION, CORRELATION], (pairs, 2)))
        return np.concatenate(rows)


def read_filter(path: str | Path) -> FilterFile:
    """Read a filter from a TOML file; the page "Tune your Kalman filter" describes its keys.

    Parameters
    ----------
    path : path-like
        The file.

    Returns
    -------
    FilterFile

    Raises
    ------
    InvalidInput
        If the file cannot be read, a matrix does not fit, is not finite or is no covariance, or a magnitude
        is impossible: the message names the matrix and the entry.
    UnknownName
        If a key is unknown.
    """
    file = Path(path)
    try:
        document = tomllib.loads(file.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError) as error:
        raise InvalidInput("model", str(path), f"give a readable TOML file ({error})") from None
    except tomllib.TOMLDecodeError as error:
        raise InvalidInput("model", str(path), f"correct the TOML: {error}") from None
    return parse_filter(document, source=file.name, name=file.stem)


def parse_filter(document: Mapping[str, Any], *, source: str = "", name: str = "filter") -> FilterFile:
    """Make a filter of the tables of such a file.

    Parameters
    ----------
    document : mapping
        Keys and tables as in the file.
    source, name : str
        Name of the file, and of the filter if the document gives none.

    Returns
    -------
    FilterFile

    Raises
    ------
    InvalidInput, UnknownName
        As `read_filter`.
    """
    where = source or "the model"
    for key, value in document.items():
        if key not in _TABLES:
            raise UnknownName(f"key of {where}", key, _TABLES)
        kind: Any = _TABLES[key]
        if isinstance(value, bool) or not isinstance(value, kind):
            raise InvalidInput(f"{key} of {where}", value, f"give {_WORDS[kind]}")
    tables = {key: _known(document.get(key, {}), names, key, where) for key, names in (
        ("model", _MODEL), ("noise", ("Q", "R")), ("bounds", ("Q", "R")), ("columns", _COLUMNS),
    )}  # fmt: skip
    model = tables["model"]
    if ("F" in model) == ("A" in model):
        raise InvalidInput(
            f"model of {where}", "both F and A" if "F" in model else "neither F nor A",
            "give F, the transition over one time step, or A of dx/dt = A x + B u + G w",
        )  # fmt: skip
    letter = "F" if "F" in model else "A"
    transition = matrix_of(letter, model[letter])
    n = len(transition)
    check_shape(letter, transition, (n, n))
    if "H" not in model:
        raise InvalidInput(f"H of {where}", "nothing", "give the measurement matrix")
    H = matrix_of("H", model["H"])
    check_shape("H", H, (len(H), n))
    G = matrix_of("G", model["G"], flat="column") if "G" in model else np.eye(n)
    check_shape("G", G, (n, G.shape[1]))
    B = matrix_of("B", model["B"], flat="column") if "B" in model else None
    if B is not None:
        check_shape("B", B, (n, B.shape[1]))
    x0 = matrix_of("x0", model.get("x0", [0.0] * n), flat="column")
    if x0.shape != (n, 1):
        raise InvalidInput("x0", f"shape {x0.shape[:1]}", f"give one value for each of the {n} states")
    P0 = check_covariance("P0", matrix_of("P0", model["P0"], flat="diagonal"), n) if "P0" in model else None
    noise, assumed = {}, []
    for key, size in (("Q", G.shape[1]), ("R", len(H))):
        if key in tables["noise"]:
            given = matrix_of(key, tables["noise"][key], flat="diagonal")
            noise[key] = check_covariance(key, given, size, definite=key == "R")
        else:
            noise[key] = np.eye(size)
            assumed.append(f"no {key} is given: variances of 1 are taken for the present ones")
    form = document.get("covariance", "scalar")
    forms = {"Q": form, "R": document.get("measurement_covariance", form)}
    for key, chosen in forms.items():
        check_noise(key, noise[key], chosen)
    if set(forms.values()) == {"fixed"}:
        raise InvalidInput("covariance", "fixed", "leave something of Q or R to be found")
    return FilterFile(
        name=document.get("name", name),
        source=source,
        F=transition if letter == "F" else None,
        A=transition if letter == "A" else None,
        H=H,
        G=G,
        B=B,
        x0=x0[:, 0],
        P0=P0,
        time_step=_step(document.get("time_step"), where),
        Q=noise["Q"],
        R=noise["R"],
        covariance=forms["Q"],
        measurement_covariance=forms["R"],
        bounds={key: bounds_of(key, tables["bounds"].get(key), noise[key], forms[key]) for key in "QR"},
        states=(states := _texts("states", document.get("states", [f"x{k}" for k in range(n)]), n)),
        columns=_columns(tables["columns"], len(H), None if B is None else B.shape[1], states, where),
        assumed=tuple(assumed),
    )


def _known(table: Any, names: tuple[str, ...], key: str, where: str) -> dict[str, Any]:
    for name in table:
        if name not in names:
            raise UnknownName(f"key of [{key}] in {where}", name, names)
    return dict(table)


def _step(value: Any, where: str) -> float | None:
    if value is None:
        return None
    if not (np.isfinite(value) and value > 0.0):
        raise InvalidInput(f"time_step of {where}", value, "give a positive number of seconds")
    return float(value)


def _texts(name: str, value: Any, count: int) -> tuple[str, ...]:
    """Different names, as many as there are things to be named."""
    value = [value] if isinstance(value, str) else value
    if not isinstance(value, list) or not all(isinstance(item, str) and item for item in value):
        raise InvalidInput(name, value, "give a list of texts")
    if len(value) != count or len(set(value)) < count:
        raise InvalidInput(name, value, f"give {count} different names")
    return tuple(value)


def _columns(
    table: dict[str, Any], m: int, p: int | None, states: tuple[str, ...], where: str
) -> dict[str, Any]:
    def usual(letter: str, count: int) -> list[str]:
        return [letter] if count == 1 else [f"{letter}{k}" for k in range(count)]

    if "u" in table and p is None:
        raise InvalidInput(f"columns.u of {where}", table["u"], "give B too: it says where the input enters")
    if "time" in table and not isinstance(table["time"], str):
        raise InvalidInput(f"columns.time of {where}", table["time"], "give the name of a column")
    truth = table.get("truth", {})
    if not isinstance(truth, Mapping) or not all(isinstance(column, str) for column in truth.values()):
        raise InvalidInput(f"columns.truth of {where}", truth, 'give { state = "column" }')
    for state in truth:
        if state not in states:
            raise UnknownName(f"state in columns.truth of {where}", state, states)
    return {
        "time": table.get("time"),
        "y": _texts(f"columns.y of {where}", table.get("y", usual("y", m)), m),
        "u": () if p is None else _texts(f"columns.u of {where}", table.get("u", usual("u", p)), p),
        "truth": dict(truth),
    }


def _held(A: np.ndarray, dt: float) -> tuple[np.ndarray, np.ndarray]:
    """``exp(A dt)`` and its integral over the step."""
    from scipy.linalg import expm

    n = len(A)
    block = np.zeros((2 * n, 2 * n))
    block[:n, :n], block[:n, n:] = A * dt, np.eye(n) * dt
    whole = expm(block)
    return whole[:n, :n], whole[:n, n:]
