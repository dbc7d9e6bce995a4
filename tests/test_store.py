from __future__ import annotations

import sqlite3

import numpy as np
import pytest
from study_tools import small_study

from comparisons.store import ResultsStore, RunRecord
from comparisons.store_file import SCHEMA, FolderLock, pack, unpack
from navopt.errors import StoreError, UnknownName
from navopt.evaluation import TRACE_DTYPE


def record(spec, **changes):
    values = {
        "key": spec.key,
        "world_key": spec.world_key,
        "status": "budget",
        "settings": {"solver": spec.solver},
        "loss": 0.1 + 0.2,
        "elapsed_s": 1.5,
        "counts": {"loss": 60, "cost": 60},
        "scores": {"distance_1": 0.3},
        "x": np.array([0.1, np.nextafter(0.2, 1)]),
        "trace": np.array([(1, 2.0, 0.1), (60, 0.3, 1.5)], TRACE_DTYPE),
        "estimate": {"position": np.arange(6.0).reshape(2, 3)},
    }
    return RunRecord(**{**values, **changes})


@pytest.fixture
def filled(tmp_path):
    """A folder whose store has two of eight runs: one done, one failed."""
    study = small_study()
    first, second = study.runs()[:2]
    with ResultsStore.open_for_study(tmp_path, study) as store:
        store.add(record(first, illustration={"map": np.eye(2)}, held_out={"distance_1": 0.4}))
        store.add(
            RunRecord(second.key, second.world_key, "failed", {"solver": "abc"}, error="ValueError: no [x]")
        )
    return tmp_path


def test_everything_comes_back_bit_for_bit(filled):
    study = small_study()
    first, second = study.runs()[:2]
    with ResultsStore(filled) as store:
        assert store.study == study
        assert store.planned == 8
        frame = store.runs()
        assert list(frame["key"]) == [first.key, second.key]
        done, failed = frame.iloc[0], frame.iloc[1]
        assert (done["scenario"], done["world"], done["solver"], done["seed"]) == (
            "plane",
            0,
            "random-search",
            1,
        )
        assert done["loss"] == 0.1 + 0.2
        assert done["score.distance_1"] == 0.3
        assert done["held_out.distance_1"] == 0.4
        assert (done["cost"], done["n_eval"]) == (60, 60)
        assert done["x"].tobytes() == record(first).x.tobytes()
        assert failed["status"] == "failed"
        assert failed["error"] == "ValueError: no [x]"
        assert np.isnan(failed["loss"])
        assert failed["x"].shape == (0,)
        trace = store.traces()[first.key]
        assert trace.dtype == TRACE_DTYPE
        assert trace.tobytes() == record(first).trace.tobytes()
        assert store.traces()[second.key].dtype == TRACE_DTYPE
        np.testing.assert_array_equal(store.estimate(first.key)["position"], np.arange(6.0).reshape(2, 3))
        assert store.estimate(second.key) == {}
        np.testing.assert_array_equal(store.illustration("plane", 0)["map"], np.eye(2))
        assert store.illustration("space", 0) == {}
        assert store.illustrated() == {first.world_key}
        assert store.score_names() == {"distance_1"}
        assert {"study", "versions", "created", "updated", "schema"} <= set(store.meta)
        with pytest.raises(UnknownName, match="key"):
            store.estimate("nothing")


def test_the_closed_store_is_one_file(filled):
    ResultsStore(filled).close()
    assert [path.name for path in filled.iterdir()] == ["results.sqlite"]


def test_an_empty_study_has_an_empty_table(tmp_path):
    with ResultsStore.open_for_study(tmp_path, small_study()) as store:
        frame = store.runs()
        assert len(frame) == 0
        assert {"key", "status", "x", "loss", "scores"} <= set(frame.columns)
        assert store.score_names() is None


def test_rows_outside_the_definition_stay_but_are_not_shown(filled):
    changed = small_study(budget=61)
    with ResultsStore.open_for_study(filled, changed) as store:
        assert len(store.runs()) == 0
        assert store.traces() == {}
        assert len(store.statuses()) == 2
    with ResultsStore.open_for_study(filled, small_study()) as store:
        assert len(store.runs()) == 2


def test_a_run_done_again_replaces_its_row_and_counts(filled):
    second = small_study().runs()[1]
    with ResultsStore.open_for_study(filled, small_study()) as store:
        store.add(record(second, estimate={"other": np.zeros(1)}))
        row = store.runs().iloc[1]
        assert (row["status"], row["attempts"], row["error"]) == ("budget", 2, None)
        assert list(store.estimate(second.key)) == ["other"]


def test_no_pickle_is_written_or_read(filled):
    with pytest.raises(ValueError, match="allow_pickle"):
        pack(np.array([object()]))
    connection = sqlite3.connect(filled / "results.sqlite")
    data = pack(np.ones(3))[0]
    assert data[:6] == b"\x93NUMPY"
    connection.close()


def test_a_damaged_array_is_noticed(filled):
    data, crc = pack(np.ones(3))
    with pytest.raises(StoreError, match="damaged"):
        unpack(data[:-1] + b"\x01", crc, filled)
    connection = sqlite3.connect(filled / "results.sqlite")
    with connection:
        connection.execute("UPDATE run_arrays SET crc32 = crc32 + 1")
    connection.close()
    with ResultsStore(filled) as store, pytest.raises(StoreError, match=r"results\.sqlite.*damaged"):
        store.runs()


# -- files that are refused, and left as they were -------------------------------------------------
def spoil_schema(path):
    connection = sqlite3.connect(path)
    connection.execute(f"PRAGMA user_version={SCHEMA + 1}")
    connection.close()


def spoil_header(path):
    path.write_bytes(b"not a database, whatever its name says" * 100)


def spoil_page(path):
    data = bytearray(path.read_bytes())
    data[4096 : 4096 + 2048] = b"\xff" * 2048
    path.write_bytes(bytes(data))


def spoil_end(path):
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])


def foreign_database(path):
    path.unlink()
    connection = sqlite3.connect(path)
    connection.execute("CREATE TABLE mine (a)")
    connection.close()


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (spoil_schema, "newer navopt.*update navopt"),
        (spoil_header, "damaged.*copy"),
        (spoil_page, "damaged.*copy"),
        (spoil_end, "damaged.*copy"),
        (foreign_database, "not a results store.*another folder"),
    ],
)
def test_a_refused_file_is_left_as_it_was(filled, spoil, words):
    path = filled / "results.sqlite"
    spoil(path)
    before = path.read_bytes()
    for attempt in (lambda: ResultsStore(filled), lambda: ResultsStore.open_for_study(filled, small_study())):
        with pytest.raises(StoreError, match=words) as caught:
            attempt()
        assert str(path) in str(caught.value)
        assert path.read_bytes() == before
        assert [item.name for item in filled.iterdir()] == ["results.sqlite"]


@pytest.mark.parametrize(
    "other", [{"name": "other"}, {"problem": "gravity-matching", "scenarios": {"3 h": {"hours": 3.0}}}]
)
def test_a_folder_of_another_study_is_refused(filled, other):
    before = (filled / "results.sqlite").read_bytes()
    study = small_study(**other)
    with pytest.raises(StoreError, match=r"belongs to the study 'small'.*--out"):
        ResultsStore.open_for_study(filled, study, [])
    assert (filled / "results.sqlite").read_bytes() == before


def test_a_foreign_store_with_an_unmerged_log_is_left_as_it_was(filled, tmp_path_factory):
    # a killed run leaves its last commits in the log beside the file
    folder = tmp_path_factory.mktemp("killed")
    with ResultsStore.open_for_study(filled, small_study()) as store:
        store.add(record(small_study().runs()[2]))
        for path in filled.glob("results.sqlite*"):
            if not path.name.endswith("-shm"):
                (folder / path.name).write_bytes(path.read_bytes())
    before = {path.name: path.read_bytes() for path in folder.iterdir()}
    assert "results.sqlite-wal" in before
    with pytest.raises(StoreError, match="belongs to"):
        ResultsStore.open_for_study(folder, small_study(name="other"))
    assert {name: (folder / name).read_bytes() for name in before} == before
    with ResultsStore.open_for_study(folder, small_study()) as store:
        assert len(store.runs()) == 3


def test_no_store_and_an_empty_one(tmp_path):
    with pytest.raises(StoreError, match=r"no results store here.*navopt run"):
        ResultsStore(tmp_path)
    (tmp_path / "results.sqlite").touch()  # killed between creating the file and the first commit
    with pytest.raises(StoreError, match="still empty"):
        ResultsStore(tmp_path)
    with ResultsStore.open_for_study(tmp_path, small_study()) as store:
        assert store.planned == 8


def test_a_folder_that_cannot_be_made_is_one_clear_error(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(StoreError, match="cannot be used"):
        ResultsStore.open_for_study(tmp_path / "file" / "out", small_study())


def test_one_writer_at_a_time(tmp_path):
    with ResultsStore.open_for_study(tmp_path, small_study()) as store:
        with pytest.raises(StoreError, match=r"another `navopt run` \(process \d+\).*--out"):
            ResultsStore.open_for_study(tmp_path, small_study())
        with ResultsStore(tmp_path) as reader:  # a report of a running study is allowed
            store.add(record(small_study().runs()[0]))
            assert len(reader.runs()) == 1
    ResultsStore.open_for_study(tmp_path, small_study()).close()


def test_an_abandoned_lock_does_not_block(tmp_path):
    (tmp_path / "results.lock").write_text("1")
    lock = FolderLock(tmp_path)
    lock.release()
    lock.release()
    assert not (tmp_path / "results.lock").exists()


def test_a_full_disk_is_one_clear_error_and_keeps_what_was_there(filled):
    specs = small_study().runs()
    with ResultsStore.open_for_study(filled, small_study()) as store:
        pages = store._connection.execute("PRAGMA page_count").fetchone()[0]
        store._connection.execute(f"PRAGMA max_page_count={pages}")
        with pytest.raises(StoreError, match=r"disk is full.*check free space"):
            store.add(record(specs[3], estimate={"large": np.zeros(100_000)}))
        assert len(store.runs()) == 2
    with ResultsStore(filled) as store:
        assert len(store.runs()) == 2


def test_an_interrupted_commit_leaves_nothing_behind(tmp_path):
    specs = small_study().runs()
    with ResultsStore.open_for_study(tmp_path, small_study()) as store:
        with pytest.raises(ValueError, match="allow_pickle"):
            store.add(record(specs[0], estimate={"bad": np.array([object()])}))
        assert store.statuses() == {}
        store.add(record(specs[0]))
        assert len(store.runs()) == 1
