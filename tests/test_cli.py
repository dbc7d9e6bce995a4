from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from importlib.metadata import version
from pathlib import Path

import pytest
from study_tools import write_toml
from typer.testing import CliRunner

from comparisons import cli
from comparisons.store import ResultsStore
from comparisons.store_file import FolderLock
from navopt.errors import NavoptError


@pytest.fixture(autouse=True)
def _threads(monkeypatch):
    """The command limits threads for its own process; here that process is the tests'."""
    monkeypatch.setattr(os, "environ", os.environ.copy())


@pytest.fixture
def report(monkeypatch):
    """Stand in for the report: its own tests are elsewhere, and it takes seconds."""

    def write_report(store, path):
        Path(path).write_text(f"report of {store.planned} runs", encoding="utf-8")
        return Path(path)

    monkeypatch.setattr("comparisons.report.write_report", write_report)


def invoke(*arguments, code=0):
    result = CliRunner().invoke(cli.app, [str(argument) for argument in arguments])
    assert result.exit_code == code, (result.output, result.exception)
    return result


def refused(*arguments):
    """Message of a command that must be refused: one message, exit code 2."""
    result = invoke(*arguments, code=2)
    assert result.stdout == ""
    assert result.stderr.startswith("navopt: error: ")
    assert "Traceback" not in result.stderr
    return result.stderr


def test_version_and_help():
    assert invoke("--version").stdout == f"navopt {version('navopt')}\n"
    for command in ("list", "run", "report", "gravity-map"):
        assert command in invoke("--help").stdout


def test_list_names_everything():
    text = invoke("list").stdout
    for name in ("sphere", "random-search", "gravity-demo", "squared distance", "any problem", "stochastic"):
        assert name in text
    solvers = invoke("list", "solvers").stdout
    assert "affine-abc" in solvers
    assert "gravity-demo" not in solvers
    assert "did you mean 'solvers'" in refused("list", "solver")


def test_list_keeps_a_row_for_what_cannot_be_loaded(monkeypatch):
    from comparisons import listing

    monkeypatch.setattr(listing.registry, "list_problems", lambda: ["broken", "sphere"])
    text = " ".join(invoke("list", "problems").stdout.split())
    assert "cannot be loaded: UnknownName" in text
    assert "squared distance" in text


@pytest.mark.usefixtures("report")
def test_run_report_and_overrides(tmp_path):
    study, out = write_toml(tmp_path), tmp_path / "out"
    result = invoke("run", study, "--out", out, "--workers", 1)
    assert "random-search" in result.stdout
    assert "bees" in result.stdout
    assert result.stdout.splitlines()[-1] == str(out / "report.html")
    assert (out / "report.html").read_text() == "report of 8 runs"
    assert "8 of 8 done" in result.stderr
    again = invoke("run", study, "--out", out, "--workers", 1)
    assert "8 of 8 runs are in the store already" in again.stderr
    changed = invoke("run", study, "--out", out, "--workers", 1, "--worlds", 1, "--budget", 50)
    assert "4 of 4 runs to do" in changed.stderr
    with ResultsStore(out) as store:
        assert store.study.worlds == (0,)
        assert store.runs()["cost"].eq(50).all()
    assert invoke("report", out).stdout.splitlines()[-1] == str(out / "report.html")


@pytest.mark.usefixtures("report")
def test_the_default_folder_is_named_after_the_study(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    result = invoke("run", write_toml(tmp_path), "--workers", 1, "--worlds", 1)
    assert result.stdout.splitlines()[-1] == str(Path("results") / "small" / "report.html")


@pytest.mark.usefixtures("report")
def test_failed_runs_are_told_with_their_cause(tmp_path):
    more = '[[solvers]]\nname = "affine-abc"\n'
    study, out = write_toml(tmp_path, more=more), tmp_path / "out"
    result = invoke("run", study, "--out", out, "--workers", 1)
    assert "4 of 12 runs failed (--retry-failed does them again)" in result.stderr
    assert "affine-abc: 4 × UnsuitableProblem: affine-abc cannot solve Sphere" in result.stderr
    retried = invoke("run", study, "--out", out, "--workers", 1, "--retry-failed")
    assert "4 of 12 runs to do" in retried.stderr


def test_a_study_of_failures_only_has_no_report(tmp_path):
    only = write_toml(tmp_path, ('name = "abc"', 'name = "affine-abc"'))
    text = only.read_text().replace('[[solvers]]\nname = "random-search"\nsettings = { pop_size = 20 }\n', "")
    only.write_text(text)
    result = invoke("run", only, "--out", tmp_path / "out", "--workers", 1, code=1)
    assert "4 of 4 runs failed" in result.stderr
    assert result.stdout == ""


def test_every_refusal_is_one_message(tmp_path):
    study, out = write_toml(tmp_path), tmp_path / "out"
    assert "did you mean 'gravity-demo'" in refused("run", "gravity-dmo")
    assert "readable TOML" in refused("run", tmp_path / "none.toml")
    assert "workers: got 0" in refused("run", study, "--out", out, "--workers", 0)
    assert "worlds: got 0" in refused("run", study, "--out", out, "--worlds", 0)
    assert "budget: got 0" in refused("run", study, "--out", out, "--budget", 0)
    assert "no results store here" in refused("report", out)
    wrong = write_toml(tmp_path, ("pop_size = 6", "popsize = 6"))
    assert "did you mean 'pop_size'" in refused("run", wrong, "--out", out)
    assert not (out / "results.sqlite").exists()
    write_toml(tmp_path)
    lock = FolderLock(out)
    assert f"process {os.getpid()}" in refused("run", study, "--out", out)
    lock.release()
    (out / "results.sqlite").write_bytes(b"something else" * 500)
    assert "damaged" in refused("run", study, "--out", out)
    assert "damaged" in refused("report", out)


def test_an_unknown_option_is_refused():
    invoke("run", "gravity-demo", "--world", "3", code=2)


@pytest.mark.parametrize("region", ["1/2/3", "1/2/3/four", ""])
def test_gravity_map_refuses_a_region_it_cannot_read(tmp_path, region):
    assert "west/east/south/north" in refused("gravity-map", "--region", region, "--out", tmp_path / "map.nc")


def test_gravity_map_hands_everything_on(tmp_path, monkeypatch):
    import numpy as np
    import xarray as xr

    from navopt.data import egm2008

    asked: dict[str, object] = {}

    def free_air_anomaly(region, **options):
        asked.update(region=region, **options)
        return xr.Dataset({"free_air_anomaly": (("lat", "lon"), np.eye(2))})

    monkeypatch.setattr(egm2008, "free_air_anomaly", free_air_anomaly)
    out = tmp_path / "map.nc"
    result = invoke("gravity-map", "--region", "-10/-8.5/20/21", "--degree", 360, "--step", 5, "--out", out)
    assert asked == {"region": (-10.0, -8.5, 20.0, 21.0), "degree": 360, "step_arcmin": 5.0}
    assert result.stdout == f"{out}\n"
    with xr.open_dataset(out, engine="h5netcdf") as stored:
        assert stored["free_air_anomaly"].shape == (2, 2)
    assert "create its folder" in refused(
        "gravity-map", "--region", "0/1/0/1", "--out", tmp_path / "none" / "map.nc"
    )


# -- the real command ------------------------------------------------------------------------------
COMMAND = [sys.executable, "-c", "from comparisons.cli import main; main()"]


def test_help_starts_quickly_and_imports_nothing_heavy():
    code = (
        "import sys; from comparisons.cli import app\n"
        "try: app(['--help'])\n"
        "except SystemExit: pass\n"
        "heavy = {'numpy', 'pandas', 'numba', 'matplotlib', 'pymoo', 'scipy', 'sqlite3'} & set(sys.modules)\n"
        "sys.exit(f'imported: {heavy}' if heavy else 0)"
    )
    started = time.monotonic()
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert time.monotonic() - started < 10  # 0.4 s on an idle machine; the imports are the real check


def test_a_real_run_ends_with_the_path_of_its_report(tmp_path):
    study, out = write_toml(tmp_path), tmp_path / "out"
    done = subprocess.run(
        [*COMMAND, "run", study, "--out", out, "--workers", "2", "--worlds", "1"],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines()[-1] == str(out / "report.html")
    assert (out / "report.html").stat().st_size > 1000
    assert not list(out.glob("*-wal")) + list(out.glob("*.lock"))


@pytest.mark.parametrize("workers", [1, 2])
def test_ctrl_c_keeps_what_is_finished_and_says_how_to_go_on(tmp_path, workers):
    study = write_toml(tmp_path, ("worlds = 2", "worlds = 50"), ("budget = 60", "budget = 4000"))
    out = tmp_path / "out"
    process = subprocess.Popen(
        [*COMMAND, "run", study, "--out", out, "--workers", str(workers)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    deadline = time.monotonic() + 40
    while _count(out) < 3 and time.monotonic() < deadline and process.poll() is None:
        time.sleep(0.02)
    os.killpg(process.pid, signal.SIGINT)  # as a terminal does: to the workers as well
    stdout, stderr = process.communicate(timeout=30)
    assert process.returncode == 130, stderr
    assert "Traceback" not in stderr
    assert f"every finished run is kept in {out}" in stderr
    assert "same command" in stderr
    assert stdout == ""
    assert 3 <= _count(out) < 200
    assert sorted(path.name for path in out.iterdir()) == ["results.sqlite"]


def _count(folder):
    try:
        with ResultsStore(folder) as store:
            return len(store.statuses())
    except NavoptError:
        return 0
