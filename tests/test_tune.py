"""`navopt tune`: a user's own filter and log, from files to covariances that can be judged."""

from __future__ import annotations

import csv
import json
import os
import tomllib

import numpy as np
import pytest
from scipy.signal import cont2discrete
from scipy.stats import norm
from typer.testing import CliRunner

from comparisons import check_filter, cli, tune_files, tune_filter
from comparisons.tune_errors import standard_errors
from comparisons.tune_figures import innovation_picture
from comparisons.tune_output import FILES, innovations_csv, summary_lines, tuning_summary
from comparisons.tune_report import tuning_report
from navopt.data import FilterLog, parse_filter, read_filter, read_log
from navopt.errors import InvalidInput, UnsuitableProblem
from navopt.problems import NoiseTuning
from navopt.problems.noise_tuning import NoiseTruth

STEP = 0.1
F = np.array([[1.0, STEP], [0.0, 1.0]])
G = np.array([[0.5 * STEP**2], [STEP]])
H = np.array([[1.0, 0.0]])
#: The line of F in it.
F_ROWS = "F = [[1.0, 0.1], [0.0, 1.0]]"
MODEL = """
name = "cart"
time_step = 0.1
states = ["position", "velocity"]

[model]
F = [[1.0, 0.1], [0.0, 1.0]]
H = [[1.0, 0.0]]
G = [0.005, 0.1]
B = [0.005, 0.1]
P0 = [1.0, 1.0]

[noise]
Q = 0.05
R = 1.0

[columns]
time = "t"
y = ["position"]
u = ["force"]
"""


@pytest.fixture(autouse=True)
def _threads(monkeypatch):
    """The command limits threads for its own process; here that process is the tests'."""
    monkeypatch.setattr(os, "environ", os.environ.copy())


def drive(steps=400, *, seed=1, q=1.0, r=0.25, every=23):
    """Rows of a log: time, position, force, true position and velocity; every so many positions missing."""
    rng = np.random.default_rng(seed)
    x, rows = np.array([0.3, -0.2]), []
    for k in range(steps):
        force = np.sin(0.7 * k * STEP)
        seen = x[0] + np.sqrt(r) * rng.standard_normal()
        rows.append([k * STEP, None if k % every == 7 else seen, force, *x])
        x = F @ x + G[:, 0] * (force + np.sqrt(q) * rng.standard_normal())
    return rows


def write_log(path, rows, header="t,position,force,true_position,true_velocity"):
    lines = [",".join("" if v is None else repr(float(v)) for v in row) for row in rows]
    path.write_text("\n".join([header, *lines]) + "\n", encoding="utf-8")
    return path


@pytest.fixture
def files(tmp_path):
    (tmp_path / "cart.toml").write_text(MODEL, encoding="utf-8")
    write_log(tmp_path / "log.csv", drive())
    return tmp_path


@pytest.fixture(scope="module")
def tuned(tmp_path_factory):
    folder = tmp_path_factory.mktemp("tune")
    (folder / "cart.toml").write_text(MODEL, encoding="utf-8")
    write_log(folder / "log.csv", drive())
    return tune_files(folder / "cart.toml", folder / "log.csv")


def invoke(*arguments, code=0):
    result = CliRunner().invoke(cli.app, [str(argument) for argument in ("tune", *arguments)])
    assert result.exit_code == code, (result.output, result.exception)
    return result


def refused(folder, model="cart.toml", log="log.csv", *options):
    """Message of a command that must be refused: one message, exit code 2, nothing written."""
    out = folder / "refused"
    result = invoke(folder / model, "--data", folder / log, "--out", out, *options, code=2)
    assert result.stdout == ""
    assert result.stderr.startswith("navopt: error: ")
    assert result.stderr.count("\n") == 1
    assert not out.exists()
    return result.stderr


# -- what comes out -------------------------------------------------------------------------------------
def test_the_command_writes_everything_and_says_what_it_found(files):
    out = files / "out"
    out.mkdir()
    for name in ("covariances.png", "mine.txt"):
        (out / name).write_text("of an earlier tuning, and the user's own")
    result = invoke(files / "cart.toml", "--data", files / "log.csv", "--out", out)
    assert (out / "mine.txt").exists()
    (out / "mine.txt").unlink()
    assert sorted(path.name for path in out.iterdir()) == sorted(set(FILES) - {"covariances.png"})
    assert result.stdout.splitlines()[-1] == str(out)
    document = json.loads((out / "tuned.json").read_text())
    assert document["Q"][0][0] == pytest.approx(1.0, rel=0.9)
    assert document["R"][0][0] == pytest.approx(0.25, rel=0.3)
    assert document["standard_errors"]["why_none"] is None
    assert document["files"]["data"]["name"] == "log.csv"
    assert document["data"] == {"name": "log.csv", "steps": 400, "measurements": 382}
    assert document["consistent"] is True
    assert document["before"]["Q"] == [[0.05]]
    assert np.allclose(document["process_covariance"], G @ np.array(document["Q"]) @ G.T)
    page = (out / "report.html").read_text()
    assert page.count("data:image/png;base64,") == 3
    assert "http:" not in page
    assert "https:" not in page
    rows = list(csv.DictReader((out / "innovations.csv").open()))
    assert len(rows) == 400
    assert rows[7]["position_after"] == ""
    assert rows[7]["measured"] == "0"
    assert rows[7]["nis_after"] == "0"


def test_estimates_are_within_three_standard_errors_of_the_truth(tuned):
    # two normal numbers beyond 3.5 sigma: 0.001
    for name, value in (("log10_q", 0.0), ("log10_r", np.log10(0.25))):
        found = {"log10_q": tuned.Q[0, 0], "log10_r": tuned.R[0, 0]}[name]
        assert abs(np.log10(found) - value) < 3.5 * tuned.errors.parameters[name]


def test_innovations_are_those_of_filterpy(tuned):
    kalman = pytest.importorskip("filterpy.kalman").KalmanFilter(dim_x=2, dim_z=1, dim_u=1)
    kalman.F, kalman.H, kalman.B = F, H, G
    kalman.x, kalman.P = np.zeros((2, 1)), np.eye(2)
    kalman.Q, kalman.R = G @ tuned.Q @ G.T, tuned.R
    rows = list(csv.DictReader(innovations_csv(tuned).splitlines()))
    for k, (_, seen, force, *_) in enumerate(drive()):
        kalman.update(None if seen is None else np.array([[seen]]))
        if seen is not None:
            assert float(rows[k]["position_after"]) == pytest.approx(kalman.y[0, 0], rel=1e-7, abs=1e-9)
            assert float(rows[k]["position_sigma_after"]) ** 2 == pytest.approx(kalman.S[0, 0], rel=1e-7)
        kalman.predict(u=np.array([[force]]))


def test_the_truth_is_scored_and_changes_nothing_else(files, tuned):
    write_log(files / "blind.csv", [row[:3] for row in drive()], "t,position,force")
    blind = tune_files(files / "cart.toml", files / "blind.csv")
    assert blind.scores() == {}
    assert np.array_equal(blind.Q, tuned.Q)
    assert np.array_equal(blind.R, tuned.R)
    assert tuned.problem.truth is None
    scores = tuned.scores()
    truth = np.array([row[3:] for row in drive()])
    errors = tuned.after.estimates - truth
    assert scores["position_rmse_after"] == pytest.approx(np.sqrt(np.mean(errors[:, 0] ** 2)))
    assert scores["position_rmse_after"] < scores["position_rmse_before"]
    squares = np.einsum("ti,tij,tj->t", errors, np.linalg.inv(tuned.after.covariances), errors)
    assert scores["nees_after"] == pytest.approx(squares.mean() / 2)


def test_a_truth_of_one_state_with_holes(files):
    rows = [[*row[:3], None if k % 2 else row[3]] for k, row in enumerate(drive())]
    write_log(files / "log.csv", rows, "t,position,force,reference")
    (files / "cart.toml").write_text(MODEL + 'truth = { position = "reference" }\n', encoding="utf-8")
    found = tune_files(files / "cart.toml", files / "log.csv", solver="nominal")
    errors = found.after.estimates[::2, 0] - np.array([row[3] for row in drive()])[::2]
    assert found.scores()["position_rmse_after"] == pytest.approx(np.sqrt(np.mean(errors**2)))
    assert "velocity_rmse_after" not in found.scores()


@pytest.mark.parametrize("solver", ["em", "cmaes", "nelder-mead"])
def test_other_solvers_of_the_likelihood_agree(files, tuned, solver):
    found = tune_files(files / "cart.toml", files / "log.csv", solver=solver, seed=3)
    sigma = tuned.errors.parameters
    assert abs(np.log10(found.Q[0, 0] / tuned.Q[0, 0])) < 0.1 * sigma["log10_q"]
    assert abs(np.log10(found.R[0, 0] / tuned.R[0, 0])) < 0.1 * sigma["log10_r"]
    assert found.errors.parameters == pytest.approx(sigma, rel=0.02)


def test_an_estimate_that_adapts_is_written_over_time(files):
    found = tune_files(files / "cart.toml", files / "log.csv", solver="innovation-adaptive:adapt=R,window=80")
    assert found.varies
    assert found.errors.why_not == "the covariances vary with time"
    out = files / "out"
    assert "covariances.png" in {path.name for path in found.write(out)}
    rows = list(csv.DictReader((out / "innovations.csv").open()))
    assert float(rows[-1]["R_00"]) == pytest.approx(found.estimate.R[-1, 0, 0], rel=1e-8)
    assert json.loads((out / "tuned.json").read_text())["varies_with_time"] is True
    assert "it varies" in summary_lines(found)[0]


def test_an_innovation_that_no_covariance_explains_is_remarked_on(files):
    # a constant acceleration that the model does not know
    rows = [[t, None if y is None else y + 3.0 * np.sin(2.5 * t), *rest] for t, y, *rest in drive()]
    write_log(files / "log.csv", rows)
    found = tune_files(files / "cart.toml", files / "log.csv")
    assert not found.after.white
    assert not found.consistent
    assert any("no Q and R mend it" in note for note in found.notes)
    assert "not consistent" in "".join(summary_lines(found))


# -- standard errors ------------------------------------------------------------------------------------
def test_standard_errors_are_those_of_the_automatic_derivatives(tuned):
    stated = tuned.solution.estimate.sigma_log10
    assert list(tuned.errors.parameters.values()) == pytest.approx(stated, rel=1e-4)
    assert tuned.errors.R[0, 0] == pytest.approx(np.log(10) * tuned.R[0, 0] * stated[1], rel=1e-4)


def test_standard_errors_of_a_full_covariance_have_a_closed_form():
    # nothing but noise is measured: R is the second moment, with var R_ij = (R_ii R_jj + R_ij^2) / T
    true = np.array([[2.0, 0.6], [0.6, 0.5]])
    y = np.random.default_rng(5).multivariate_normal([0.0, 0.0], true, size=500)
    problem = NoiseTuning(
        [[1.0]], [[1.0], [1.0]], y, P0=[[0.0]], Q_reference=[[0.0]], covariance="fixed",
        measurement_covariance="full",
    )  # fmt: skip
    found = tune_filter(problem, solver="innovation-likelihood")
    moment = y.T @ y / len(y)
    assert pytest.approx(moment, rel=1e-4) == found.R
    variance = (np.outer(np.diag(moment), np.diag(moment)) + moment**2) / len(y)
    assert pytest.approx(np.sqrt(variance), rel=2e-3) == found.errors.R
    assert np.array_equal(found.errors.Q, [[0.0]])


def test_no_standard_error_where_there_is_no_maximum(files):
    found = tune_files(files / "cart.toml", files / "log.csv", solver="nominal")
    assert found.errors.Q is None
    assert "not where the likelihood is largest" in found.errors.why_not
    (files / "cart.toml").write_text(MODEL + "\n[bounds]\nR = [2.0, 3.0]\n", encoding="utf-8")
    found = tune_files(files / "cart.toml", files / "log.csv", solver="cmaes", budget=400)
    assert found.R[0, 0] == pytest.approx(2.0)
    assert "log10_r ended at a bound" in found.errors.why_not
    found = tune_files(files / "cart.toml", files / "log.csv")
    assert any("outside the bounds" in note for note in found.notes)


def test_variances_of_which_only_the_sum_matters_have_no_standard_errors():
    rng = np.random.default_rng(4)
    walk = np.cumsum(rng.standard_normal(400)) + rng.standard_normal(400)
    problem = NoiseTuning([[1.0]], [[1.0]], walk[:, None], G=[[1.0, 1.0]], covariance="diagonal")
    found = tune_filter(problem)
    assert found.errors.Q is None
    assert "do not determine" in found.errors.why_not
    one = tune_filter(NoiseTuning([[1.0]], [[1.0]], walk[:, None], covariance="diagonal"))
    assert found.process_covariance == pytest.approx(one.process_covariance, rel=1e-3)
    assert one.errors.why_not == ""


def test_standard_errors_need_covariances_that_are_constant_and_inside_the_bounds():
    problem = NoiseTuning.simulate(3, steps=300)
    estimate = problem.estimate(problem.true_x)
    varying = type(estimate)(np.tile(estimate.Q, (300, 1, 1)), estimate.R)
    assert "vary with time" in standard_errors(problem, varying).why_not
    outside = type(estimate)(estimate.Q, 1e9 * estimate.R)
    assert "outside the bounds" in standard_errors(problem, outside).why_not


# -- the checks of a filter -----------------------------------------------------------------------------
def test_checks_follow_their_laws_with_the_true_covariances():
    problem = NoiseTuning.simulate(11, steps=2000, missing_fraction=0.1)
    check = check_filter(problem.model, problem.truth.Q, problem.truth.R)
    count = check.counts.sum()
    # three numbers, 0.001 / 3 each: 3.6 sigma
    reach = norm.isf(0.5 * 0.001 / 3)
    assert abs(check.mean_nis - 1.0) < reach * np.sqrt(2.0 / count)
    assert abs(check.inside[0] - 0.95) < reach * np.sqrt(0.95 * 0.05 / count)
    assert check.whiteness[0] > 0.001 / 3
    wrong = check_filter(problem.model, 100.0 * problem.truth.Q, problem.truth.R)
    assert not wrong.white
    assert not wrong.sized


def test_autocorrelation_and_whiteness_are_those_of_statsmodels(tuned):
    tools = pytest.importorskip("statsmodels.tsa.stattools")
    diagnostic = pytest.importorskip("statsmodels.stats.diagnostic")
    problem = NoiseTuning.simulate(11, steps=500)
    check = check_filter(problem.model, problem.truth.Q, 4.0 * problem.truth.R)
    white = check.innovations[:, 0] / check.sigma[:, 0]
    assert check.autocorrelation[0] == pytest.approx(tools.acf(white, nlags=20)[1:], abs=1e-12)
    expected = diagnostic.acorr_ljungbox(white, lags=[20])["lb_pvalue"].iloc[0]
    assert check.whiteness[0] == pytest.approx(expected, rel=1e-6)


def test_every_channel_is_drawn_and_tabled_on_its_own(tmp_path):
    rng = np.random.default_rng(6)
    walk = np.cumsum(rng.standard_normal(300))
    y = walk[:, None] + rng.standard_normal((300, 2)) * [0.5, 2.0]
    y[rng.random((300, 2)) < 0.2] = np.nan
    problem = NoiseTuning([[1.0]], [[1.0], [1.0]], y, covariance="diagonal")
    found = tune_filter(problem, log=FilterLog(y=y, channels=("fine", "coarse & <wide>")))
    figure = innovation_picture(found)
    assert len(figure.axes) == 4
    assert figure.axes[2].get_ylabel().startswith("coarse")
    page = tuning_report(found, {}, tuning_summary(found))
    assert "coarse &amp; &lt;wide&gt;: p of whiteness" in page
    assert "above 0.025" in page
    assert next(csv.DictReader(innovations_csv(found).splitlines()))["step"] == "0"
    both = np.isfinite(y).all(axis=1)
    white = found.after.nis[both].mean() / 2.0
    # chi-square, 2 degrees of freedom each
    assert abs(white - 1.0) < norm.isf(0.0005) / np.sqrt(both.sum())


# -- from Python ----------------------------------------------------------------------------------------
def test_a_filterpy_filter_is_tuned():
    KalmanFilter = pytest.importorskip("filterpy.kalman").KalmanFilter
    kalman = KalmanFilter(dim_x=2, dim_z=1)
    kalman.F, kalman.H, kalman.P = F, H, np.eye(2)
    kalman.Q, kalman.R = 0.05 * G @ G.T, np.array([[1.0]])
    world = NoiseTuning.simulate(2, steps=800, interval_s=STEP)
    problem = NoiseTuning.from_filterpy(
        kalman,
        world.model.y,
        Q_reference=kalman.Q,
        R_reference=kalman.R,
        truth=NoiseTruth(world.truth.states),
    )
    found = tune_filter(problem, before=(kalman.Q, kalman.R))
    sigma = found.errors.parameters["log10_q"]
    assert abs(np.log10(found.Q[1, 1] / (STEP**2 * world.truth.Q[0, 0]))) < 3.5 * sigma
    assert found.process_covariance == pytest.approx(found.Q)
    assert found.gain > 0.0
    scores = found.scores()
    assert scores["x0_rmse_after"] < scores["x0_rmse_before"]


def test_a_problem_that_looks_at_the_truth_is_refused():
    world = NoiseTuning.simulate(2, steps=100, objective="oracle")
    with pytest.raises(InvalidInput, match="must not look at the truth"):
        tune_filter(world)
    with pytest.raises(InvalidInput, match="NoiseTuning"):
        tune_filter(object())


def test_a_truth_in_the_problem_stays_out_of_the_solver():
    world = NoiseTuning.simulate(2, steps=300)
    plain = tune_filter(world, solver="cmaes", budget=200)
    moved = NoiseTuning(
        world.model.F, world.model.H, world.model.y, G=world.model.G, x0=world.model.x0, P0=world.model.P0,
        truth=NoiseTruth(world.truth.states + 7.0),
    )  # fmt: skip
    other = tune_filter(moved, solver="cmaes", budget=200)
    assert np.array_equal(plain.Q, other.Q)
    assert world.truth is not None
    assert plain.problem.truth is None
    assert tuning_summary(plain)["scores"] != tuning_summary(other)["scores"]


# -- continuous models and varying steps ----------------------------------------------------------------
CONTINUOUS = """
time_step = 0.1
[model]
A = [[0.0, 1.0], [-2.0, -0.3]]
B = [0.0, 1.0]
G = [0.0, 1.0]
H = [[1.0, 0.0]]
P0 = [1.0, 1.0]
"""


def test_a_continuous_model_is_held_over_each_step():
    model = parse_filter(tomllib.loads(CONTINUOUS))
    regular = FilterLog(y=np.zeros((5, 1)))
    given = model.matrices(regular)
    expected = cont2discrete((model.A, model.B, model.H, np.zeros((1, 1))), 0.1, method="zoh")
    assert given["F"] == pytest.approx(expected[0])
    assert given["B"] == pytest.approx(expected[1])
    assert given["G"] == pytest.approx(expected[1])
    time = np.array([0.0, 0.1, 0.2, 0.35, 0.45])
    given = model.matrices(FilterLog(y=np.zeros((5, 1)), time=time))
    for k, dt in enumerate(np.diff(time)):
        expected = cont2discrete((model.A, model.B, model.H, np.zeros((1, 1))), dt, method="zoh")
        assert given["F"][k] == pytest.approx(expected[0])
        # white noise held over a longer step varies less
        assert given["G"][k] == pytest.approx(expected[1] * np.sqrt(0.1 / dt))
    assert given["F"].shape == (5, 2, 2)


def test_varying_steps_are_tuned_with_a_continuous_model(files):
    rng = np.random.default_rng(8)
    time = np.cumsum(rng.choice([0.05, 0.1, 0.1, 0.2], size=600))
    x, rows = np.zeros(2), []
    for t, dt in zip(time, np.append(np.diff(time), 0.1), strict=True):
        rows.append([t, x[0] + 0.1 * rng.standard_normal()])
        # exact: random walk of the velocity, spectral density 0.4
        spread = 0.4 * np.array([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]])
        x = np.array([x[0] + dt * x[1], x[1]]) + rng.multivariate_normal([0.0, 0.0], spread)
    write_log(files / "log.csv", rows, "time,y")
    text = "[model]\nA = [[0.0, 1.0], [0.0, 0.0]]\nG = [0.0, 1.0]\nH = [[1.0, 0.0]]\n"
    (files / "cart.toml").write_text(text, encoding="utf-8")
    found = tune_files(files / "cart.toml", files / "log.csv")
    sigma = found.errors.parameters
    # held over the usual step of 0.1 s the noise has the variance 0.4 / 0.1
    assert abs(np.log10(found.Q[0, 0] / 4.0)) < 3.5 * sigma["log10_q"]
    assert abs(np.log10(found.R[0, 0] / 0.01)) < 3.5 * sigma["log10_r"]
    assert any("variances of 1" in note for note in found.notes)


# -- what is refused ------------------------------------------------------------------------------------
def changed(old, new):
    assert old in MODEL
    return MODEL.replace(old, new)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (changed(F_ROWS, "F = [[1.0, 0.1, 0.0], [0.0, 1.0, 0.0]]"), "F: got shape (2, 3)"),
        (changed(F_ROWS, "F = [[1.0, 0.1], [0.0]]"), "F[1]: got 1 entries"),
        (changed(F_ROWS, 'F = [[1.0, "a"], [0.0, 1.0]]'), "F[0, 1]: got a; give a number"),
        (changed(F_ROWS, "F = [[1.0, nan], [0.0, 1.0]]"), "F[0, 1]: got nan"),
        (changed(F_ROWS, ""), "neither F nor A"),
        (changed(F_ROWS, F_ROWS + "\nA = [[1.0]]"), "both F and A"),
        (changed("H = [[1.0, 0.0]]", "H = [[1.0, 0.0, 0.0]]"), "H: got shape (1, 3)"),
        (changed("H = [[1.0, 0.0]]", "H = [[inf, 0.0]]"), "H[0, 0]: got inf"),
        (changed("H = [[1.0, 0.0]]", "H = [1.0, 0.0]"), "give rows of numbers"),
        (changed("H = [[1.0, 0.0]]\n", ""), "H of cart.toml: got nothing"),
        (changed("G = [0.005, 0.1]", "G = [0.005, 0.1, 0.0]"), "G: got shape (3, 1)"),
        (changed("B = [0.005, 0.1]", "B = [0.005]"), "B: got shape (1, 1)"),
        (changed("B = [0.005, 0.1]\n", ""), "columns.u of cart.toml"),
        (changed("P0 = [1.0, 1.0]", "P0 = [[1.0, 0.5], [0.4, 1.0]]"), "P0[0, 1]: got 0.5, but P0[1, 0]"),
        (changed("P0 = [1.0, 1.0]", "P0 = [[1.0, 2.0], [2.0, 1.0]]"), "P0: got a matrix whose correlations"),
        (changed("P0 = [1.0, 1.0]", "P0 = [1.0, -1.0]"), "P0[1, 1]: got -1.0"),
        (changed("P0 = [1.0, 1.0]", "x0 = [0.0, 0.0, 0.0]"), "x0: got shape (3,)"),
        (changed("P0 = [1.0, 1.0]", "x0 = [0.0, inf]"), "x0[1]: got inf"),
        (changed("P0 = [1.0, 1.0]", "PO = [1.0, 1.0]"), "did you mean 'P0'"),
        (changed("Q = 0.05", "Q = [[0.05, 0.0], [0.0, 0.05]]"), "Q: got shape (2, 2)"),
        (changed("Q = 0.05", "Q = -0.05"), "Q[0, 0]: got -0.05"),
        (changed("Q = 0.05", "Q = 1e300"), "Q[0, 0]: got 1e+300; a variance is between"),
        (changed("Q = 0.05", "Q = 1e30"), "would move a measurement"),
        (changed("Q = 0.05", "Q = 0.0"), "Q: got all zero"),
        (changed("R = 1.0", "R = 0.0"), "R[0, 0]: got 0.0"),
        (changed("R = 1.0", "R = nan"), "R[0, 0]: got nan"),
        (changed("R = 1.0", "R = 1e-38"), "R[0, 0]: got 1e-38; column position of log.csv reaches"),
        (changed("R = 1.0", "R = 1e30"), "R[0, 0]: got 1e+30; column position of log.csv reaches"),
        (changed("time_step = 0.1", "time_step = 0.2"), "usual step in column t of log.csv is 0.1 s"),
        (changed("time_step = 0.1", "time_step = -1"), "time_step of cart.toml: got -1"),
        (changed("time_step = 0.1", "covariance = 'diag'"), "covariance of Q"),
        (changed("time_step = 0.1", "covariance = 'fixed'"), "leave something of Q or R to be found"),
        (changed("time_step = 0.1", "tine_step = 0.1"), "did you mean 'time_step'"),
        (changed('"position", "velocity"', '"position"'), "give 2 different names"),
        (changed('["position"]', '["positions"]'), "got 'positions'; did you mean 'position'"),
        (MODEL + "\n[bounds]\nQ = [3.0, 2.0]\n", "bounds of Q: got [3.0, 2.0]"),
        (MODEL + "\n[bounds]\nR = [1e-60, 1.0]\n", "bounds of R"),
        (MODEL + "\n[bounds]\nR = 'wide'\n", "bounds of R: got wide"),
        (MODEL + "truth = { place = 'true_position' }\n", "state in columns.truth"),
        (MODEL.replace("[model]", "[model"), "correct the TOML"),
    ],
)  # fmt: skip
def test_models_that_cannot_be_meant_are_refused(files, text, expected):
    (files / "cart.toml").write_text(text, encoding="utf-8")
    assert expected in refused(files)


def test_a_model_with_a_growing_state_that_nobody_measures_is_refused(files):
    text = changed("F = [[1.0, 0.1], [0.0, 1.0]]", "F = [[1.0, 0.0], [0.0, 1.1]]")
    (files / "cart.toml").write_text(text, encoding="utf-8")
    assert "state 1 grows by a factor 1.1" in refused(files)


def rows_with(change):
    rows = drive()
    change(rows)
    return rows


def cell(row, column, value):
    return rows_with(lambda rows: rows[row].__setitem__(column, value))


@pytest.mark.parametrize(
    ("rows", "expected"),
    [
        (drive(4), "4 measurements; 2 states and 2 numbers of Q and R need more than 4"),
        ([[t, None, *rest] for t, _, *rest in drive()], "column position of log.csv: got no measurement"),
        (rows_with(lambda rows: rows.pop(20)), "column t of log.csv: got a step of 0.2 s before line 22"),
        (cell(30, 0, 2.0), "2 after 2.9 in line 32; times must increase"),
        (cell(30, 0, None), "column t of log.csv"),
        (cell(30, 1, np.inf), "column position of log.csv: got 'inf' in line"),
        (cell(30, 2, None), "force of log.csv: got an empty cell in line 32"),
        ([[t, 4.0, *rest] for t, _, *rest in drive()], "column position of log.csv: got 4 in every row"),
    ],
)  # fmt: skip
def test_logs_that_cannot_be_used_are_refused(files, rows, expected):
    write_log(files / "log.csv", rows)
    assert expected in refused(files)


def test_an_empty_line_without_times_is_refused(files):
    lines = ["y", *("" if k == 9 else f"{np.sin(k)}" for k in range(50))]
    (files / "log.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    (files / "cart.toml").write_text("[model]\nF = [[1.0]]\nH = [[1.0]]\n", encoding="utf-8")
    assert "log.csv: got an empty line 11" in refused(files)


def test_options_that_cannot_be_meant_are_refused(files):
    assert "did you mean 'em'" in refused(files, "cart.toml", "log.csv", "--solver", "emm")
    assert "seed" in refused(files, "cart.toml", "log.csv", "--seed", "-1")
    assert "budget" in refused(files, "cart.toml", "log.csv", "--budget", "0")
    assert "give an existing CSV file" in refused(files, "cart.toml", "none.csv")
    assert "give a readable TOML file" in refused(files, "none.toml")
    assert "tercom" in refused(files, "cart.toml", "log.csv", "--solver", "tercom")
    with pytest.raises(UnsuitableProblem, match="missing"):
        tune_files(files / "cart.toml", files / "log.csv", solver="als")
    (files / "file").write_text("")
    result = invoke(files / "cart.toml", "--data", files / "log.csv", "--out", files / "file", code=2)
    assert "give a folder, not a file" in result.stderr


def test_files_are_read_into_objects(files):
    model = read_filter(files / "cart.toml")
    assert model.name == "cart"
    assert model.bounds["Q"] == pytest.approx([1e-6, 1e6])
    log = read_log(files / "log.csv", model)
    assert log.regular
    assert np.isnan(log.y[7, 0])
    assert log.truth.shape == (400, 2)
    problem = model.problem(log)
    assert problem.truth is None
    assert problem.xl == pytest.approx([-6.0, -6.0])
    Q, R = problem.covariances(problem.nominal[None])
    assert (Q[0, 0, 0], R[0, 0, 0]) == pytest.approx((0.05, 1.0))
    full = parse_filter(
        {
            "covariance": "full",
            "measurement_covariance": "diagonal",
            "model": {"F": [[1.0, 0.1], [0.0, 1.0]], "H": [[1.0, 0.0]]},
            "noise": {"Q": [[1.0, 0.2], [0.2, 4.0]], "R": 2.0},
            "bounds": {"Q": [[0.1, 10.0], [0.01, 100.0]]},
        }
    )
    problem = full.problem(FilterLog(y=np.sin(np.arange(50.0))[:, None]))
    assert problem.xu == pytest.approx([1.0, 2.0, 0.99, 6.0])
    assert np.diag(problem.Q_form.reference) == pytest.approx([1.0, 4.0])
