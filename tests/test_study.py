from __future__ import annotations

import contextlib
import dataclasses
import enum
import json
import tomllib
from pathlib import Path

import numpy as np
import pytest
from study_tools import small_study, write_toml

from comparisons import run_key
from comparisons.run_key import canonical_json, digest
from comparisons.study import SolverEntry, Study, Success, list_studies, study_title
from navopt.errors import InvalidInput, MissingData, UnknownName


def test_toml_and_python_give_the_same_study(tmp_path):
    assert Study.from_toml(write_toml(tmp_path)) == small_study()


def test_a_study_survives_its_json_form():
    study = small_study(
        display={"scale": 0.001, "unit": "km"},
        success=(Success("distance_1", (0.1, 1.0), ("near", "nearly")),),
        held_out=2,
    )
    assert Study.from_dict(json.loads(json.dumps(study.to_dict()))) == study


def test_worlds_as_count_with_first_or_as_seeds(tmp_path):
    counted = write_toml(tmp_path, ("worlds = 2", "worlds = 3\nfirst_world = 10"))
    assert Study.from_toml(counted).worlds == (10, 11, 12)
    listed = write_toml(tmp_path, ("worlds = 2", "worlds = [5, 3]"))
    assert Study.from_toml(listed).worlds == (5, 3)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("budget = 60", "budgt = 60", ["budgt", "did you mean 'budget'", "small.toml"]),
        ('rank_by = "distance_1"', "rank = 1", ["'rank'", "did you mean 'rank_by'"]),
        ('problem = "sphere"', 'problem = "spheer"', ["problem", "did you mean 'sphere'", "small.toml"]),
        ("n_var = 2", "n_vars = 2", ["n_vars", "did you mean 'n_var'", "'plane'", "small.toml"]),
        ('name = "abc"', 'name = "random-serch"', ["did you mean 'random-search'", "small.toml"]),
        ("pop_size = 6", "popsize = 6", ["popsize", "did you mean 'pop_size'", "'abc'", "small.toml"]),
        ('label = "bees"', 'lable = "bees"', ["lable", "did you mean 'label'", "solvers[1]"]),
    ],
)
def test_unknown_names_are_refused_with_the_nearest(tmp_path, old, new, words):
    with pytest.raises(UnknownName) as caught:
        Study.from_toml(write_toml(tmp_path, (old, new)))
    for word in words:
        assert word in str(caught.value)


def test_unknown_keys_of_display_and_success(tmp_path):
    with pytest.raises(UnknownName, match="scale"):
        Study.from_toml(write_toml(tmp_path, more="[display]\nscal = 1.0\n"))
    with pytest.raises(UnknownName, match="below"):
        Study.from_toml(write_toml(tmp_path, more='[[success]]\nscore = "loss"\nbelo = 1.0\n'))
    with pytest.raises(UnknownName, match="display"):
        small_study(display={"scal": 1})


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("budget = 60", "budget = 0", "at least 1"),
        ("budget = 60", 'budget = "many"', "give a whole number"),
        ("budget = 60", "budget = true", "give a whole number"),
        ("budget = 60", "", "required"),
        ("worlds = 2", "worlds = [1, 1]", "once only"),
        ("worlds = 2", "worlds = [-1]", "at least 0"),
        ("worlds = 2", "worlds = [1]\nfirst_world = 2", "first_world"),
        ('name = "small"', 'name = "../small"', "folder"),
        ("pop_size = 6", "pop_size = 0", "pop_size"),
        ("budget = 60", "budget = = 60", "correct the TOML"),
    ],
)
def test_unusable_values_are_refused_naming_the_file(tmp_path, old, new, words):
    with pytest.raises(InvalidInput) as caught:
        Study.from_toml(write_toml(tmp_path, (old, new)))
    assert words in str(caught.value)
    assert "small.toml" in str(caught.value)


def test_missing_file_is_one_clear_error(tmp_path):
    with pytest.raises(InvalidInput, match="readable TOML"):
        Study.from_toml(tmp_path / "none.toml")


def test_labels_and_runs_must_differ():
    with pytest.raises(InvalidInput, match="once only"):
        small_study(solvers=(SolverEntry("abc"), SolverEntry("abc", settings={"pop_size": 8})))
    with pytest.raises(InvalidInput, match="same solver"):
        small_study(solvers=(SolverEntry("abc"), SolverEntry("abc", "again"))).check()
    with pytest.raises(InvalidInput, match="same scenario"):
        small_study(scenarios={"a": {"n_var": 3}, "b": {}}).check()


def test_success_needs_a_label_for_each_threshold():
    assert Success("loss", (1.0,)).labels == ("< 1",)
    with pytest.raises(InvalidInput, match="label"):
        Success("loss", (1.0, 2.0), ("one",))


def test_runs_are_ordered_and_have_keys_of_their_own():
    runs = small_study(seeds=(1, 2)).runs()
    assert len({spec.key for spec in runs}) == len(runs) == 2 * 2 * 2 * 2
    assert len({spec.world_key for spec in runs}) == 4
    order = [(s.scenario_label, s.world, s.solver_label, s.seed) for s in runs]
    assert order[:3] == [
        ("plane", 0, "random-search", 1),
        ("plane", 0, "random-search", 2),
        ("plane", 0, "bees", 1),
    ]


def test_the_key_changes_with_everything_the_result_depends_on(monkeypatch):
    base = small_study().runs()[0].key
    solvers = small_study().solvers
    changed = {
        "scenario": small_study(scenarios={"plane": {"n_var": 2, "offset": 1.0}}),
        "world": small_study(worlds=(7,)),
        "solver": small_study(solvers=(SolverEntry("abc", settings={"pop_size": 20}),)),
        "setting": small_study(solvers=(SolverEntry("random-search", settings={"pop_size": 21}),)),
        "seed": small_study(seeds=(9,)),
        "budget": small_study(budget=61),
        "held_out": small_study(held_out=1),
    }
    keys = {name: study.runs()[0].key for name, study in changed.items()}
    monkeypatch.setattr(run_key, "version", lambda name: "0" if name == "pymoo" else "1")
    keys["version"] = small_study().runs()[0].key
    monkeypatch.undo()
    from navopt.problems.analytic import Sphere

    monkeypatch.setattr(Sphere, "data_checksum", classmethod(lambda cls, **scenario: "other"))
    keys["data"] = small_study().runs()[0].key
    assert base not in keys.values()
    assert len(set(keys.values())) == len(keys)
    monkeypatch.undo()
    assert small_study(solvers=solvers).runs()[0].key == base


def test_the_key_ignores_labels_and_spelled_out_defaults():
    base = small_study().runs()[0].key
    relabelled = small_study(scenarios={"flat": {"n_var": 2}}, title="other", rank_by="loss").runs()[0]
    spelled = small_study(scenarios={"plane": {"n_var": 2, "offset": 0.0}}).runs()[0]
    assert relabelled.key == spelled.key == base
    default = small_study(solvers=(SolverEntry("random-search"),)).runs()[0].key
    given = small_study(solvers=(SolverEntry("random-search", settings={"pop_size": 100}),)).runs()[0].key
    assert default == given


def test_replaced_worlds_and_budget():
    study = small_study(worlds=(4, 2, 9))
    assert study.replaced(worlds=2).worlds == (4, 2)
    assert study.replaced(worlds=5).worlds == (4, 2, 9, 10, 11)
    assert study.replaced(budget=7).budget == 7
    assert study.replaced() == study
    with pytest.raises(InvalidInput, match="worlds"):
        study.replaced(worlds=0)
    with pytest.raises(InvalidInput, match="budget"):
        study.replaced(budget=0)


class Colour(enum.Enum):
    RED = 1


@dataclasses.dataclass(frozen=True)
class Pair:
    left: float
    right: np.ndarray


def test_canonical_json_is_one_text_for_equal_values():
    assert canonical_json({"b": 1, "a": (1.5, None)}) == '{"a":[1.5,null],"b":1}'
    assert canonical_json(np.float64(0.1)) == canonical_json(0.1) == "0.1"
    assert canonical_json(np.arange(2)) == "[0,1]"
    assert "Colour.RED" in canonical_json(Colour.RED)
    assert "Pair" in canonical_json(Pair(1.0, np.ones(1)))
    assert canonical_json(Path("a") / "b") == '"a/b"'
    assert "test_study.Pair" in canonical_json(Pair)
    assert digest(a=1, b=2) == digest(b=2, a=1) != digest(a=2, b=1)


@pytest.mark.parametrize("value", [object(), lambda: 0, {1: 2}, np.array([object()])])
def test_a_value_without_a_stable_text_has_no_key(value):
    with pytest.raises(InvalidInput, match="setting"):
        canonical_json(value, argument="setting")


def test_embedded_studies_are_listed_and_well_formed():
    names = list_studies()
    assert {"gravity-demo", "gravity-comparison"} <= set(names)
    for name in names:
        assert study_title(name)
        # a study of recorded data has no run keys without the data
        with contextlib.suppress(MissingData):
            study = Study.named(name)
            assert study.name == name
            assert study.runs()
    with pytest.raises(UnknownName, match="gravity-demo"):
        Study.named("gravity-dem")


def test_the_two_gravity_studies_compare_the_same_solvers_in_the_same_way():
    def document(name):
        import comparisons

        path = Path(comparisons.__file__).parent / "studies" / f"{name}.toml"
        table = tomllib.loads(path.read_text(encoding="utf-8"))
        own = ("worlds", "budget", "name", "title", "description", "scenarios")
        sizes = {key: table.pop(key) for key in own}
        return table, sizes

    demo, comparison = document("gravity-demo"), document("gravity-comparison")
    assert demo[0] == comparison[0]
    assert (demo[1]["worlds"], demo[1]["budget"]) == (12, 5000)
    assert (comparison[1]["worlds"], comparison[1]["budget"]) == (50, 10000)
