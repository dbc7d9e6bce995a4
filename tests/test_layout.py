"""Directions of import, what `import navopt` may load, and that every public name is there and documented."""

from __future__ import annotations

import ast
import importlib
import inspect
import json
import subprocess
import sys
from importlib.metadata import entry_points
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(__file__).resolve().parent.parent
PACKAGES = ("navopt", "baselines", "comparisons")
FORBIDDEN = {"navopt": {"baselines", "comparisons"}, "baselines": {"comparisons"}, "comparisons": set()}
#: Loaded on use only, so that `import navopt` stays quick.
HEAVY = ("numba", "pyins", "cma", "casadi", "cvxpy", "matplotlib", "pandas", "dask", "xarray")


def sources(package: str) -> list[Path]:
    return sorted((ROOT / package).rglob("*.py"))


def module_name(path: Path) -> str:
    return ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")


MODULES = [module_name(path) for package in PACKAGES for path in sources(package)]


def imported_packages(path: Path) -> set[str]:
    """First parts of everything a file imports, in functions and by `import_module` too."""
    found: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name.partition(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            # a relative import cannot leave the package it is in
            if node.level == 0:
                found.add(str(node.module).partition(".")[0])
        elif isinstance(node, ast.Call) and node.args:
            called = node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")
            first = node.args[0]
            if called in ("import_module", "__import__") and isinstance(first, ast.Constant):
                found.add(str(first.value).partition(".")[0])
    return found


@pytest.mark.parametrize("package", PACKAGES)
def test_direction_of_imports(package: str) -> None:
    wrong = {
        path.relative_to(ROOT).as_posix(): sorted(imported_packages(path) & FORBIDDEN[package])
        for path in sources(package)
    }
    assert not {path: names for path, names in wrong.items() if names}


def test_import_is_quick_and_light() -> None:
    code = (
        "import json, sys, time; start = time.perf_counter(); import navopt; "
        "print(json.dumps([time.perf_counter() - start, sorted(m.partition('.')[0] for m in sys.modules)]))"
    )
    times = []
    for _ in range(3):  # the best of three: other processes may be busy
        run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
        elapsed, loaded = json.loads(run.stdout)
        assert not set(HEAVY) & set(loaded)
        times.append(elapsed)
    assert min(times) < 1.0


def test_nothing_is_printed_or_logged_at_import() -> None:
    code = f"import importlib\nfor name in {MODULES!r}: importlib.import_module(name)"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert (run.stdout, run.stderr) == ("", "")


def test_the_three_packages_are_ours() -> None:
    homes = {name: Path(str(importlib.import_module(name).__file__)).parent.parent for name in PACKAGES}
    assert len(set(homes.values())) == 1
    for name in PACKAGES:
        assert (homes[name] / name / "py.typed").is_file()


def is_command(node: ast.FunctionDef | ast.ClassDef) -> bool:
    """Whether a definition is a command of the command line, public by that name and not by Python's."""
    return any("app.command" in ast.unparse(decorator) for decorator in node.decorator_list)


@pytest.mark.parametrize("name", MODULES)
def test_all_is_complete(name: str) -> None:
    module = importlib.import_module(name)
    path = Path(str(module.__file__))
    defined = [
        node.name
        for node in ast.parse(path.read_text(encoding="utf-8")).body
        if isinstance(node, ast.FunctionDef | ast.ClassDef)
        and not node.name.startswith("_")
        and not is_command(node)
    ]
    public = list(getattr(module, "__all__", []))
    assert public or not defined, f"{name} defines {defined} and has no __all__"
    assert len(public) == len(set(public))
    for item in public:
        assert hasattr(module, item), f"{name}.__all__ names {item}, which is not there"
    assert not sorted(set(defined) - set(public)), f"not in {name}.__all__; list them or begin them with _"


def undocumented(module: ModuleType) -> list[str]:
    missing = [] if (module.__doc__ or "").strip() else [module.__name__]
    for name in getattr(module, "__all__", []):
        item = getattr(module, name)
        if getattr(item, "__module__", None) != module.__name__ or not callable(item):
            continue
        if not (item.__doc__ or "").strip():
            missing.append(name)
        if inspect.isclass(item):
            for member, value in vars(item).items():
                documentable = callable(value) or isinstance(value, property | classmethod)
                if member.startswith("_") or not documentable:
                    continue
                if not (getattr(value, "__doc__", "") or "").strip():
                    missing.append(f"{name}.{member}")
    return missing


@pytest.mark.parametrize("name", MODULES)
def test_every_public_name_has_a_docstring(name: str) -> None:
    assert not undocumented(importlib.import_module(name))


@pytest.mark.parametrize("kind", ["problem", "solver"])
def test_entry_points_load(kind: str) -> None:
    ours = [e for e in entry_points(group=f"navopt.{kind}s") if e.value.partition(".")[0] in PACKAGES]
    assert ours
    for entry in ours:
        assert getattr(entry.load(), f"{kind}_info").name == entry.name


def test_the_command_loads() -> None:
    (command,) = [e for e in entry_points(group="console_scripts") if e.name == "navopt"]
    assert callable(command.load())


def test_versions_agree() -> None:
    import navopt

    pyproject = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    citation = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    assert f'\nversion = "{navopt.__version__}"\n' in pyproject
    assert f"\nversion: {navopt.__version__}\n" in citation
    assert f"\n## {navopt.__version__} " in (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")


def test_constraints_are_versions_only() -> None:
    lines = (ROOT / "constraints.txt").read_text(encoding="utf-8").splitlines()
    pins = [line for line in lines if line and not line.startswith("#")]
    assert pins
    assert not [pin for pin in pins if "@" in pin or "://" in pin or "--" in pin or pin.count("==") != 1]
    assert not [pin for pin in pins if pin.startswith("navopt")]
