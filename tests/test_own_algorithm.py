"""The algorithm of the page "Write your own algorithm" keeps the contract of every registered solver.

It is registered as a user's would be: a module and an entry point in a folder of their own.
"""

from __future__ import annotations

import inspect
import itertools
import re
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import test_contracts

import navopt
from navopt import registry

PAGE = Path(__file__).resolve().parent.parent / "docs" / "own-algorithm.md"
MODULE = "own_algorithm_of_the_page"


def example() -> tuple[str, str, str]:
    """Code of the page's algorithm, its registry name and its class."""
    blocks = re.findall(r"^```python\n(.*?)^```$", PAGE.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL)
    code = next(block for block in blocks if "@solver(" in block)
    name = re.search(r'@solver\(\s*"([\w-]+)"', code)
    cls = re.search(r"^class (\w+)\(", code, re.MULTILINE)
    assert name
    assert cls
    return code, name[1], cls[1]


CODE, NAME, CLASS = example()


def forget() -> None:
    """Make the registry look at the installed entry points again."""
    registry._entries.cache_clear()
    registry._load.cache_clear()


@pytest.fixture(scope="module")
def registered(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """Name of the page's algorithm, which is registered while the tests of this module run."""
    folder = tmp_path_factory.mktemp("package")
    (folder / f"{MODULE}.py").write_text(CODE, encoding="utf-8")
    metadata = folder / f"{MODULE}-1.0.dist-info"
    metadata.mkdir()
    (metadata / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {MODULE}\nVersion: 1.0\n")
    (metadata / "entry_points.txt").write_text(f"[navopt.solvers]\n{NAME} = {MODULE}:{CLASS}\n")
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(folder)
        forget()
        yield NAME
    sys.modules.pop(MODULE, None)
    test_contracts.world.cache_clear()
    forget()


def contract() -> list[Any]:
    """Every contract test that takes a solver's name, with each combination of its other parameters."""
    cases = []
    for title, function in inspect.getmembers(test_contracts, inspect.isfunction):
        if not title.startswith("test_") or "name" not in inspect.signature(function).parameters:
            continue
        tables: list[list[dict[str, Any]]] = []
        for mark in getattr(function, "pytestmark", []):
            if mark.name == "parametrize" and mark.args[0] != "name":
                keys = [key.strip() for key in mark.args[0].split(",")]
                rows = [value if len(keys) > 1 else (value,) for value in mark.args[1]]
                tables.append([dict(zip(keys, row, strict=True)) for row in rows])
        for rows in itertools.product(*tables):
            given = {key: value for row in rows for key, value in row.items()}
            cases.append(pytest.param(function, given, id="-".join([title, *map(str, given.values())])))
    return cases


CONTRACT = contract()


@pytest.mark.parametrize(("function", "given"), CONTRACT)
def test_contract(
    function: Callable[..., None], given: dict[str, Any], registered: str, request: pytest.FixtureRequest
) -> None:
    fixtures = [
        key for key in inspect.signature(function).parameters if key not in {"name", *given}
    ]  # none today; a contract test may come to use tmp_path or the like
    function(name=registered, **given, **{key: request.getfixturevalue(key) for key in fixtures})


def test_the_contract_has_been_found() -> None:
    titles = {function.values[0].__name__ for function in CONTRACT}
    assert {"test_four_ways_agree_at_whole_batches", "test_nan_is_a_clear_error"} <= titles
    assert len(CONTRACT) >= 20


def test_it_is_registered_here_and_nowhere_else(registered: str) -> None:
    assert registered in navopt.list_solvers()
    assert registered not in test_contracts.SOLVERS
    assert type(navopt.make_solver(registered)).__module__ == MODULE


def test_the_example_is_short() -> None:
    cls = CODE[CODE.index("@solver(") :]
    assert len([line for line in cls.splitlines() if line.strip()]) < 40


def test_stacked_runs_move_as_each_alone(registered: str) -> None:
    algorithm, d = navopt.make_solver(registered), 3
    box = {"lower": np.full(d, -1.0), "upper": np.full(d, 2.0)}
    rng = np.random.default_rng(0)
    X = rng.uniform(-1.0, 2.0, (4, algorithm.pop_size, d))
    losses = rng.random((4, algorithm.pop_size))
    blocks = [algorithm.draw(rng, algorithm.pop_size, d) for _ in range(4)]
    draws = {key: np.stack([block[key] for block in blocks]) for key in blocks[0]}
    state = algorithm.found(box, X, losses)
    for phase in algorithm.phases:
        together, _ = algorithm.move(state, draws, phase)
        for k, block in enumerate(blocks):
            alone, _ = algorithm.move(algorithm.found(box, X[k], losses[k]), block, phase)
            assert (together[k] == alone).all()
