"""Tables and pictures of the page "Heading-aided alignment compared", from the results of its studies.

``python docs/heading_compared.py results/heading-paper results/robust-alignment results/heading-tuning``
prints the tables of each study. Other arguments need no study: ``pictures`` draws those of the page into
``docs/images``, ``rates`` compares the thinned steps of the studies with all of them, ``horizons`` shows
when one fading factor blows up, ``correlations`` ties the heading state to the azimuth more and less,
``angles`` has mean and variance of each angle, ``spots`` the check of the laser spots.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

import navopt
from comparisons.audit_measures import median_interval
from comparisons.drawing import render
from comparisons.heading_figures import azimuth_figure, course_figure, formulation_figure, spot_figure
from comparisons.heading_paper import FIGURES, angle_statistics, course, courses, ground_check, summary
from comparisons.printed import printed_table
from comparisons.statistics import run_scores
from comparisons.store import ResultsStore
from comparisons.study import Study
from navopt.models.laser_spot import simulate_spot_test
from navopt.problems.heading_settings import HeadingSettings

IMAGES = Path(__file__).resolve().parent / "images"
DEGREES = float(np.degrees(1.0))
#: Degrees of freedom of the normalised squares: ten states, three angles.
FREEDOM = {"nees_1": 10, "angle_nees_1": 3}
#: The picture of the finding: legend, filter of the study `heading-paper`.
WAYS = {
    "no heading": "UKF, no heading",
    "heading state, as printed": "UKF, heading state",
    "heading state, correlated": "UKF, correlated state",
    "heading used directly": "UKF, direct",
}
#: What the paper prints, for that picture: time (s), error (degrees).
PRINTED_POINTS = ((450.0, 0.9, "printed: 0.9° in 450 s"),)
TRUTH_WORLDS = 12
#: Filters that are compared with the plain one, world by world.
RIVALS = ("SST-UKF, per channel", "SST-UKF, one factor, capped", "Sage–Husa UKF", "windowed UKF")


def save(name: str, figure: Figure, dpi: int = 75) -> None:
    """Write a picture of the page."""
    IMAGES.mkdir(exist_ok=True)
    data = render(figure, format="png", dpi=dpi)
    (IMAGES / f"heading-{name}.png").write_bytes(data)
    print(f"images/heading-{name}.png: {len(data) / 1000:.0f} kB")


def interval(values: pd.Series, digits: int = 3) -> str:
    """Median with its 95 % bootstrap interval; "inf" where half of the values are."""
    middle = float(values.median())
    if not np.isfinite(middle):
        return "never" if np.isposinf(middle) else "–"
    if not np.isfinite(values).all():
        return f"{middle:.{digits}g} ({int((~np.isfinite(values)).sum())} failed)"
    _, low, high = median_interval(values.to_numpy())
    if not np.isfinite(low):
        return f"{middle:.{digits}g}"
    return f"{middle:.{digits}g} ({low:.{digits}g}–{high:.{digits}g})"


def consistency(values: pd.Series, freedom: int) -> str:
    """Mean of a normalised square over the worlds with its 95 % interval; in bold within its own band.

    The band is that of chi-square at the number of worlds: the biases of a world are the same all the time,
    so that times of one world hardly count as more than one.
    """
    finite = values[np.isfinite(values)]
    if len(finite) < len(values) or len(finite) < 2:
        return "failed" if len(finite) < len(values) else "–"
    mean = float(finite.mean())
    reach = 1.96 * float(finite.std(ddof=1)) / np.sqrt(len(finite))
    band = 1.96 * np.sqrt(2.0 / (freedom * len(finite)))
    text = f"{mean:.3g} ± {reach:.2g}"
    return f"**{text}**" if abs(mean - 1.0) <= band else text


def of(runs: pd.DataFrame, scenario: str, solver: str) -> pd.DataFrame:
    """Runs of one solver in one scenario."""
    return runs[(runs["scenario"] == scenario) & (runs["solver"] == solver)]


# -- one scenario after another ----------------------------------------------------------------------------
def scenario_tables(store: ResultsStore, runs: pd.DataFrame, *, within: float) -> str:
    """Convergence, errors and consistency of every filter in every scenario."""
    lines = []
    head = (
        "azimuth converges, s | in 20 s | azimuth RMS, ° | horizontal RMS, ° "
        "| NEES | NEES of the angles | NIS | failed"
    )
    for scenario in store.study.scenarios:
        here = runs[runs["scenario"] == scenario]
        if not len(here):
            continue
        lines += [f"| {scenario} | {head} |", "|---" * 9 + "|"]
        for entry in store.study.solvers:
            own = of(here, scenario, entry.label)
            if not len(own):
                continue
            times = run_scores(own, "azimuth_convergence_s")
            cells = [
                interval(times),
                f"{int((times <= within).sum())}/{len(own)}",
                interval(run_scores(own, "azimuth_rms_rad") * DEGREES),
                interval(run_scores(own, "horizontal_rms_rad") * DEGREES),
                consistency(run_scores(own, "nees_1"), FREEDOM["nees_1"]),
                consistency(run_scores(own, "angle_nees_1"), FREEDOM["angle_nees_1"]),
                f"{run_scores(own, 'nis_1').median():.3g}",
                str(int((run_scores(own, "failed_1") > 0.5).sum())),
            ]
            lines.append(f"| {entry.label} | {' | '.join(cells)} |")
        lines += ["", f"({here['world'].nunique()} worlds)", ""]
    return "\n".join(lines)


def overview(store: ResultsStore, runs: pd.DataFrame) -> str:
    """Median azimuth RMS of every filter in all scenarios at once, degrees."""
    scenarios = [s for s in store.study.scenarios if len(runs[runs["scenario"] == s])]
    labels = [entry.label for entry in store.study.solvers]
    lines = [f"| | {' | '.join(labels)} | worlds |", "|---" * (len(labels) + 2) + "|"]
    for scenario in scenarios:
        cells = []
        for label in labels:
            score = run_scores(of(runs, scenario, label), "azimuth_rms_rad") * DEGREES
            middle = score.median()
            cells.append(f"{middle:.3g}" if np.isfinite(middle) else "fails")
        worlds = runs[runs["scenario"] == scenario]["world"].nunique()
        lines.append(f"| {scenario} | {' | '.join(cells)} | {worlds} |")
    return "\n".join(lines)


def formulations(store: ResultsStore, runs: pd.DataFrame) -> str:
    """The ways of using the heading from every azimuth at the start."""
    head = (
        "| azimuth at the start | direct: within 0.1° in 20 s | direct: RMS, ° | direct: NEES "
        "| correlated state: RMS, ° | its NEES of the angles | heading state as printed: RMS, ° "
        "| no heading: RMS, ° | worlds |"
    )
    lines = [head, "|---" * 9 + "|"]
    for scenario in store.study.groups["azimuth at the start"]:
        direct, correlated, state, none = (
            of(runs, scenario, label)
            for label in ("UKF", "UKF, correlated state", "UKF, heading state", "UKF, no heading")
        )
        if not len(direct):
            continue
        key = "azimuth_rms_rad"
        soon = int((run_scores(direct, "azimuth_convergence_s") <= 20.0).sum())
        cells = [
            f"{soon}/{len(direct)}",
            interval(run_scores(direct, key) * DEGREES),
            consistency(run_scores(direct, "nees_1"), FREEDOM["nees_1"]),
            interval(run_scores(correlated, key) * DEGREES),
            consistency(run_scores(correlated, "angle_nees_1"), FREEDOM["angle_nees_1"]),
            interval(run_scores(state, key) * DEGREES),
            interval(run_scores(none, key) * DEGREES),
            str(len(direct)),
        ]
        lines.append(f"| {scenario} | {' | '.join(cells)} |")
    return "\n".join(lines)


def strong_tracking(store: ResultsStore, runs: pd.DataFrame) -> str:
    """Whether strong tracking or learning helps: paired ratios of azimuth RMS to the plain filter's."""
    from scipy.stats import wilcoxon

    lines = [f"| | {' | '.join(RIVALS)} |", "|---" * (len(RIVALS) + 1) + "|"]
    key = "azimuth_rms_rad"
    for scenario in store.study.scenarios:
        base = of(runs, scenario, "UKF").set_index("world")
        cells = []
        for label in RIVALS:
            own = of(runs, scenario, label).set_index("world")
            both = base.index.intersection(own.index)
            if len(both) < 2:
                continue
            ratio = run_scores(own.loc[both], key) / run_scores(base.loc[both], key)
            difference = np.log(ratio.replace(np.inf, 1e9))
            p = float(wilcoxon(difference).pvalue) if (difference != 0).any() else 1.0
            won = int((ratio < 1.0).sum())
            cells.append(f"{interval(ratio)}; {won}/{len(both)}; {p:.1g}")
        if cells:
            lines.append(f"| {scenario} | {' | '.join(cells)} |")
    return "\n".join(lines)


# -- the paper's own numbers ---------------------------------------------------------------------------------
def printed(store: ResultsStore, runs: pd.DataFrame) -> str:
    """Printed values beside ours; angles in degrees."""
    lines = ["| scenario | filter | score | printed | ours, median | lowest | highest |", "|---" * 7 + "|"]
    for row in printed_table(runs, store.study).to_dict("records"):
        unit = DEGREES if row["score"].endswith("_rad") else 1.0
        name = row["score"].removesuffix("_rad").removesuffix("_s").replace("_", " ")
        name += ", °" if unit > 1.0 else ", s"
        numbers = " | ".join(f"{unit * row[key]:.3g}" for key in ("printed", "median", "minimum", "maximum"))
        lines.append(f"| {row['scenario']} | {row['solver']} | {name} | {numbers} |")
    return "\n".join(lines)


def angle_table(worlds: int) -> str:
    """Mean and variance of each angle's error after convergence, and settling times: Tables 2, 3 and 6."""
    study = Study.named("heading-paper")
    solvers = [e.label for e in study.solvers]
    table = summary(angle_statistics(study, worlds=study.worlds[:worlds], solvers=solvers))
    head = "mean E, N, U, ° | variance E, N, U, °² | azimuth settles within 1° of where it ends, s | failed |"
    lines = [f"| scenario | filter | {head}", "|---" * 6 + "|"]
    for row in table.to_dict("records"):
        if row["failed"] == row["worlds"]:
            continue
        mean = ", ".join(f"{row[f'mean_{a}']:.3g}" for a in "ENU")
        variance = ", ".join(f"{row[f'variance_{a}']:.2g}" for a in "ENU")
        settled = f"{row['settled_s']:.0f}"
        lines.append(
            f"| {row['scenario']} | {row['solver']} | {mean} | {variance} | {settled} "
            f"| {row['failed']}/{row['worlds']} |"
        )
    return "\n".join(lines)


def tuned(store: ResultsStore, runs: pd.DataFrame) -> str:
    """Held-out errors and consistency of tuned, untuned and learning filters, and what was found."""
    lines = []
    for scenario in store.study.scenarios:
        here = runs[runs["scenario"] == scenario]
        if not len(here):
            continue
        lines += [
            f"| {scenario} | loss | azimuth RMS, other worlds, ° | NEES | NEES of the angles | NIS | found |",
            "|---" * 7 + "|",
        ]
        for entry in store.study.solvers:
            own = of(here, scenario, entry.label)
            if not len(own):
                continue
            x = np.median(np.array([np.asarray(row, dtype=float) for row in own["x"]]), axis=0)
            found = ", ".join(f"{v:.2f}" for v in x) if own["cost"].max() > 1 else "–"
            lines.append(
                f"| {entry.label} | {own['loss'].median():.4f} "
                f"| {interval(own['held_out.azimuth_rms_rad'] * DEGREES)} "
                f"| {consistency(own['held_out.nees_1'], 10)} "
                f"| {consistency(own['held_out.angle_nees_1'], 3)} "
                f"| {own['held_out.nis_1'].median():.3g} | {found} |"
            )
        lines += ["", f"({here['world'].nunique()} worlds)", ""]
    return "\n".join(lines)


# -- pictures, rates and horizons --------------------------------------------------------------------------
def pictures(worlds: int = TRUTH_WORLDS) -> None:
    """Draw the pictures of the page."""
    study = Study.named("heading-paper")
    save("spots", spot_figure(simulate_spot_test(np.random.default_rng(0))))
    for name, wanted in FIGURES.items():
        found = courses(study, wanted, world=study.worlds[0])
        several = len({scenario for scenario, _ in wanted}) > 1
        labels = {" – ".join(pair) if several else pair[1]: run for pair, run in found.items()}
        save(name, azimuth_figure(labels) if several else course_figure(labels))
    errors: dict[str, list[np.ndarray]] = {legend: [] for legend in WAYS}
    time = np.zeros(0)
    for world in study.worlds[:worlds]:
        pairs = [("Simulation 1", label) for label in WAYS.values()]
        found = courses(study, pairs, world=world)
        for legend, label in WAYS.items():
            run = found["Simulation 1", label]
            errors[legend].append(run.errors[:, 2])
            time = run.time
    save(
        "formulations",
        formulation_figure({k: np.array(v) for k, v in errors.items()}, time, printed=PRINTED_POINTS),
    )


def rates(worlds: int = 10) -> str:
    """Steps of the filter at 10 Hz beside all at 100 Hz: the first 60 s of Simulation 1."""
    lines = [
        "| steps | filter | azimuth error below 0.1° from, s | RMS from 20 s on, ° | worlds |",
        "|---" * 5 + "|",
    ]
    for rate in (10.0, 100.0):
        for angle in (15.0, 60.0):
            for variant in ("ukf", "sst-ukf"):
                times, sizes = [], []
                for world in range(worlds):
                    problem = navopt.simulate(
                        "heading-alignment", seed=world, duration_s=60.0, rate_hz=rate,
                        angles_deg=(1.0, 1.0, angle),
                    )  # fmt: skip
                    settings = HeadingSettings(variant=variant, factors="multiple", cap=1.05)
                    run = course(problem, settings)
                    times.append(problem.score(settings)["azimuth_convergence_s"])
                    sizes.append(float(np.sqrt(np.mean(run.errors[run.time >= 20.0, 2] ** 2))))
                lines.append(
                    f"| {rate:g} Hz, {angle:g}° | {variant} | {max(times):.1f} at most "
                    f"| {max(sizes):.4f} at most | {worlds} |"
                )
    return "\n".join(lines)


def horizons(worlds: int = 10) -> str:
    """When the levels of filters with one fading factor leave ten times their bound, and failures."""
    lines = ["| filter | failed | at, s | levels beyond 0.57° from, s | cause |", "|---" * 5 + "|"]
    one = HeadingSettings(variant="sst-ukf", factors="single")
    printed = HeadingSettings.published()
    cases = {
        "printed": printed,
        "printed, heading used directly": replace(printed, formulation="direct"),
        "printed, three transforms": replace(printed, variant="st-ukf"),
        "printed, capped at 1.05": replace(printed, cap=1.05),
        "one factor, covariance of the faded": replace(one, cap=None, normalise=False),
        "the same, channels normalised": replace(one, cap=None),
        "the same, capped at 1.05": one,
        "the same, only what the process predicts": replace(one, fades="process"),
        "the same, weakening 4": replace(one, weakening=4.0),
        "a factor for each channel, capped at 1.05": replace(one, factors="multiple"),
        "a factor for each channel, no cap": replace(one, factors="multiple", cap=None),
        "a factor for each channel, printed update": replace(
            one, factors="multiple", cap=None, covariance_update="printed"
        ),
    }
    for label, settings in cases.items():
        failed, left, causes = [], [], set()
        for world in range(worlds):
            problem = navopt.simulate("heading-alignment", seed=world, duration_s=300.0, rate_hz=10.0)
            run = course(problem, settings)
            if run.failed is not None:
                failed.append(run.time[np.isfinite(run.errors[:, 0])][-1])
                causes.add(run.failed.split(": ", 1)[1])
                continue
            beyond = (np.abs(run.errors[:, :2]).max(axis=1) > 0.57) & (run.time > 10.0)
            left.append(run.time[beyond][0] if beyond.any() else np.inf)
        when = f"{np.median(failed):.1f}" if failed else "–"
        late = (
            f"{np.median(left):.0f}"
            if left and np.isfinite(np.median(left))
            else ("–" if failed else "never")
        )
        lines.append(
            f"| {label} | {len(failed)}/{worlds} | {when} | {late} | {'; '.join(sorted(causes)) or '–'} |"
        )
    return "\n".join(lines)


def correlations(worlds: int = 10) -> str:
    """Heading states that are tied to the azimuth more and less: Simulation 1 for 500 s."""
    from navopt.filters.heading_filter import filter_heading

    lines = [
        "| correlation at the start | azimuth RMS at 1 to 10 s, ° | at 400 to 500 s, ° "
        "| what the filter believes at 500 s, ° |",
        "|---" * 4 + "|",
    ]
    problems = [
        navopt.simulate("heading-alignment", seed=world, duration_s=500.0, rate_hz=10.0)
        for world in range(worlds)
    ]
    for share in (0.0, 0.5, 0.9, 0.99, 0.9999, 1.0):
        early, late, sigma = [], [], []
        for problem in problems:
            # the noise of the gyros moves both states together in either case
            whole = problem.filter(HeadingSettings(formulation="correlated"))
            P0 = whole.P0.copy()
            P0[5, :5] *= share
            P0[:5, 5] *= share
            run = filter_heading(problem.inputs(), replace(whole, P0=P0, _prepared={}), thin=1)
            size = np.degrees(np.abs(run.estimates[:, 4] - problem.truth.states[:, 4]))
            early.append(np.sqrt(np.mean(size[10:101] ** 2)))
            late.append(np.sqrt(np.mean(size[4000:] ** 2)))
            sigma.append(float(np.degrees(run.deviations[-1, 4])))
        cells = [f"{np.median(v):.3g}" for v in (early, late, sigma)]
        lines.append(f"| {share:g} | {' | '.join(cells)} |")
    return "\n".join(lines)


def study_output(folder: str) -> None:
    """Print the tables of one study."""
    with ResultsStore(folder) as store:
        name, runs = store.study.name, store.runs()
        print(f"\n## {name}\n")
        if name == "heading-paper":
            print(printed(store, runs), "\n")
        if name == "heading-tuning":
            print(tuned(store, runs))
            return
        print(overview(store, runs), "\n")
        if name == "robust-alignment":
            print(formulations(store, runs), "\n")
            print(strong_tracking(store, runs), "\n")
        print(scenario_tables(store, runs, within=20.0 if name == "robust-alignment" else 60.0))


def main(arguments: Sequence[str]) -> None:
    """Make what is asked for, see the module."""
    for argument in arguments:
        if argument == "pictures":
            pictures()
        elif argument == "rates":
            print(rates())
        elif argument == "correlations":
            print(correlations())
        elif argument == "horizons":
            print(horizons())
        elif argument.startswith("angles"):
            print(angle_table(int(argument.removeprefix("angles") or 10)))
        elif argument == "spots":
            print(ground_check().to_string(index=False))
        else:
            study_output(argument)


if __name__ == "__main__":
    main(sys.argv[1:])
