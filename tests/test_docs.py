"""What the documentation shows must run, and print what it says."""

from __future__ import annotations

import contextlib
import doctest
import importlib
import io
import re
import sys
import types
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
PAGES = [
    ROOT / "README.md",
    *(page for page in sorted((ROOT / "docs").rglob("*.md")) if "_build" not in page.parts),
]
FLAGS = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE
FENCE = re.compile(
    r"^(?:<!-- file: (?P<file>[\w.-]+) -->\n)?```(?P<language>\w+)\n(?P<code>.*?)^```$",
    re.MULTILINE | re.DOTALL,
)


def pages_with_code() -> list[Path]:
    return [page for page in PAGES if "```python" in page.read_text(encoding="utf-8")]


def modules_with_doctests() -> list[str]:
    files = [path for name in ("navopt", "baselines", "comparisons") for path in (ROOT / name).rglob("*.py")]
    return sorted(
        ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")
        for path in files
        if ">>> " in path.read_text(encoding="utf-8")
    )


def check(test: doctest.DocTest, namespace: dict[str, object]) -> None:
    report = io.StringIO()
    test.globs = namespace
    failed, _ = doctest.DocTestRunner(optionflags=FLAGS).run(test, out=report.write, clear_globs=False)
    assert not failed, report.getvalue()


@pytest.fixture
def quiet(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder of its own for every page, and no window for any figure."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MPLBACKEND", "agg")
    return tmp_path


@pytest.mark.parametrize("page", pages_with_code(), ids=lambda page: page.relative_to(ROOT).as_posix())
def test_page_runs_as_printed(page: Path, quiet: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    # a module and not a bare dict, so that classes defined on a page can be pickled
    module = types.ModuleType("page_" + re.sub(r"\W", "_", page.stem))
    monkeypatch.setitem(sys.modules, module.__name__, module)
    text = page.read_text(encoding="utf-8")
    printed = ""
    for block in FENCE.finditer(text):
        code = block["code"]
        line = text.count("\n", 0, block.start("code"))
        if block["file"]:
            (quiet / block["file"]).write_text(code, encoding="utf-8")
        elif block["language"] == "text":
            # the output of the block before it
            assert doctest.OutputChecker().check_output(code, printed, FLAGS), f"{page}:{line}\n{printed}"
        elif block["language"] == "python" and code.lstrip().startswith(">>>"):
            parser = doctest.DocTestParser()
            check(parser.get_doctest(code, {}, page.name, str(page), line), module.__dict__)
        elif block["language"] == "python":
            with contextlib.redirect_stdout(io.StringIO()) as output:
                # blank lines before it, so that a traceback names the line of the page
                exec(compile("\n" * line + code, str(page), "exec"), module.__dict__)
            printed = output.getvalue()


@pytest.mark.parametrize("name", modules_with_doctests())
def test_docstring_examples(name: str, quiet: Path) -> None:
    module = importlib.import_module(name)
    for test in doctest.DocTestFinder(exclude_empty=True).find(module):
        if test.examples:
            check(test, dict(test.globs))


def test_relative_links_lead_somewhere() -> None:
    missing = []
    for page in [*PAGES, ROOT / "CONTRIBUTING.md", ROOT / "CHANGELOG.md"]:
        for target in re.findall(r"\]\(([^)#\s]+)", page.read_text(encoding="utf-8")):
            if "://" not in target and not (page.parent / target).exists():
                missing.append(f"{page.relative_to(ROOT)}: {target}")
    assert not missing


def test_every_solver_and_its_options_are_described() -> None:
    import navopt

    page = (ROOT / "docs" / "solvers.md").read_text(encoding="utf-8").partition("## Swarm algorithms")[2]
    missing = []
    for name in navopt.list_solvers():
        # an entry begins with the name at the start of a line and ends with a blank line
        entry = re.search(rf"^`{name}`.*?(?=\n\n|\Z)", page, re.MULTILINE | re.DOTALL)
        options = getattr(navopt.make_solver(name), "settings", {})
        missing += [f"{name}: {key}" for key in options if not entry or f"`{key}`" not in entry[0]]
        missing += [] if entry else [name]
    assert not missing
