"""How all figures look, and their way to bytes: one style per solver, the same bytes twice."""

from __future__ import annotations

import functools
import io
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, ParamSpec, TypeVar

import matplotlib
import numpy as np
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from comparisons.statistics import REFERENCES
from comparisons.wording import format_number
from navopt.errors import UnknownName

__all__ = [
    "UNAIDED",
    "WIDTH",
    "Style",
    "house_style",
    "plain_ticks",
    "render",
    "solver_styles",
    "styled",
    "wants_log",
]

#: Width of a figure of a report, in inches.
WIDTH = 8.4
#: Ratio of largest to smallest value from which an axis is logarithmic.
LOGARITHMIC_SPREAD = 30.0

#: Colours told apart with any colour vision (Okabe & Ito, then Tol's muted), dark enough for thin lines.
COLOURS = (
    "#0072B2",
    "#D55E00",
    "#009E73",
    "#CC79A7",
    "#E69F00",
    "#332288",
    "#56B4E9",
    "#882255",
    "#7A7A1F",
    "#000000",
)
MARKERS = ("s", "^", "D", "v", "P", "X", "<", ">", "p", "h", "d")
LINES = ("-", (0, (6, 2)), (0, (6, 2, 1.5, 2)), (0, (3, 1.5)), (0, (8, 2, 1.5, 2, 1.5, 2)))

CYCLES: tuple[tuple[Any, ...], ...] = (COLOURS, MARKERS, LINES)

#: Settings of matplotlib that would make figures depend on the machine are set, not inherited.
HOUSE = {
    "axes.axisbelow": True,
    "axes.edgecolor": "#444444",
    "axes.grid": True,
    "axes.labelcolor": "#222222",
    "axes.spines.right": False,
    "axes.spines.top": False,
    "axes.titlelocation": "left",
    "axes.titlesize": 11,
    "axes.titleweight": "bold",
    "font.family": ["DejaVu Sans"],
    "font.size": 9.5,
    "grid.color": "#dddddd",
    "grid.linewidth": 0.7,
    "legend.frameon": False,
    "svg.fonttype": "path",
    "svg.hashsalt": "navopt",
}

P = ParamSpec("P")
R = TypeVar("R")


@dataclass(frozen=True)
class Style:
    """How one solver is drawn in every figure.

    Attributes
    ----------
    colour : str
        Hexadecimal colour.
    marker : str
        Marker of matplotlib.
    line : object
        Line style of matplotlib.
    """

    colour: str
    marker: str
    line: Any


#: What has not been estimated by anything: the row of reference and the inertial track.
UNAIDED = Style("#6b6b6b", "o", (0, (1.5, 1.5)))


def solver_styles(study: Any) -> dict[str, Style]:
    """Style of each solver by its label, from its place in the study, so that all figures agree."""
    styles, k = {}, 0
    for entry in study.solvers:
        if entry.name in REFERENCES:
            styles[entry.label] = UNAIDED
            continue
        colour, marker, line = (choices[k % len(choices)] for choices in CYCLES)
        styles[entry.label] = Style(colour, marker, line)
        k += 1
    return styles


@contextmanager
def house_style() -> Iterator[None]:
    """Draw with matplotlib's defaults and our own settings, whatever the user has configured."""
    with matplotlib.rc_context():
        # the backend is not touched: figures are drawn without one
        settings: Any = {
            key: value for key, value in matplotlib.rcParamsDefault.items() if not key.startswith("backend")
        }
        matplotlib.rcParams.update(settings | HOUSE)
        yield


def styled(function: Callable[P, R]) -> Callable[P, R]:
    """Decorate a function that draws, so that it draws in the house style."""

    @functools.wraps(function)
    def draw(*args: P.args, **kwargs: P.kwargs) -> R:
        with house_style():
            return function(*args, **kwargs)

    return draw


def wants_log(values: np.ndarray, spread: float = LOGARITHMIC_SPREAD) -> bool:
    """Whether values are positive and spread over a ratio that needs a logarithmic axis."""
    return bool(values.size and values.min() > 0 and values.max() / values.min() > spread)


def plain_ticks(axis: Axis, low: float, high: float) -> None:
    """Label a logarithmic axis with plain numbers, and between the powers of ten where there is room."""
    decades = np.log10(high / low)
    if decades > 4:
        return
    axis.set_major_locator(LogLocator(subs=(1, 2, 5) if decades < 3 else (1,)))
    axis.set_major_formatter(FuncFormatter(lambda value, _: format_number(value, digits=1)))
    axis.set_minor_formatter(NullFormatter())


@styled
def render(figure: Figure, *, format: str = "svg", dpi: int = 150) -> bytes:
    """Bytes of a figure; the same figure gives the same bytes.

    Parameters
    ----------
    figure : matplotlib.figure.Figure
        What to render.
    format : {"svg", "png"}
        File format.
    dpi : int, default 150
        Dots per inch of a PNG, and of pictures inside an SVG.

    Returns
    -------
    bytes

    Raises
    ------
    UnknownName
        If the format is another one.
    """
    unstamped = {"svg": {"Date": None}, "png": {"Software": None}}
    if format not in unstamped:
        raise UnknownName("format", format, unstamped)
    buffer = io.BytesIO()
    figure.savefig(buffer, format=format, dpi=dpi, metadata=unstamped[format])
    return buffer.getvalue()
