"""The results of a study: one file from which it resumes and every report is made.

Rows are kept by run key, so a run that is asked for again is found and not repeated; only the process
that drives a study writes.
"""

from __future__ import annotations

import json
import sqlite3
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from comparisons.store_file import FolderLock, connect, pack, read_meta, store_errors, store_path, unpack
from comparisons.study import RunSpec, Study
from navopt.errors import StoreError, UnknownName
from navopt.evaluation import TRACE_DTYPE

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["ResultsStore", "RunRecord"]

_JSON = ("counts", "scores", "held_out", "invalid", "settings")


@dataclass(frozen=True)
class RunRecord:
    """What is kept of one run.

    Attributes
    ----------
    key, world_key : str
        As in `comparisons.study.RunSpec`.
    status : str
        Status of the solution, or ``"failed"``.
    settings : dict
        Solver, its full options, seed, budget and versions.
    loss, elapsed_s : float
        NaN for a failed run; seconds.
    counts, scores, invalid : dict
        As in `navopt.Solution`; `counts` with its ``cost``.
    held_out : dict of str to float
        Scores on the redrawn twins, mean over them.
    message : str
        The status in a sentence.
    error : str or None
        Cause of a failed run: type, message and where.
    x : ndarray, shape (n_var,)
        Decision vector; empty for a failed run.
    trace : ndarray of (cost, loss, elapsed_s)
        Best loss against cost.
    estimate : dict of str to ndarray
        Array fields of the estimate.
    illustration : dict of str to ndarray or None
        Picture of the world, where it was asked for.
    """

    key: str
    world_key: str
    status: str
    settings: dict[str, Any]
    loss: float = np.nan
    elapsed_s: float = np.nan
    counts: dict[str, int] = field(default_factory=dict)
    scores: dict[str, float] = field(default_factory=dict)
    invalid: dict[str, int] = field(default_factory=dict)
    held_out: dict[str, float] = field(default_factory=dict)
    message: str = ""
    error: str | None = None
    x: np.ndarray = field(default_factory=lambda: np.empty(0))
    trace: np.ndarray = field(default_factory=lambda: np.empty(0, TRACE_DTYPE))
    estimate: dict[str, np.ndarray] = field(default_factory=dict)
    illustration: dict[str, np.ndarray] | None = None


class ResultsStore:
    """Results of a study, opened for reading; `open_for_study` opens them for writing.

    Parameters
    ----------
    path : path-like
        The results folder, or the ``results.sqlite`` in it.

    Raises
    ------
    StoreError
        If there is no store, or the file is damaged, from a newer version or not a results store.
        A refused file is left as it was, to the last byte.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = store_path(path)
        self._lock: FolderLock | None = None
        self._connection = connect(self.path, write=False)

    @classmethod
    def open_for_study(cls, path: str | Path, study: Study, runs: list[RunSpec] | None = None) -> Self:
        """Open or create the store of a study, define the study in it and lock the folder.

        Parameters
        ----------
        path : path-like
            The results folder, or the ``results.sqlite`` in it.
        study : Study
            The study as it is now; rows of runs that it no longer asks for stay in the file.
        runs : list of RunSpec, optional
            ``study.runs()``, if at hand.

        Raises
        ------
        StoreError
            As the constructor; also if the folder belongs to another study or another process.
        """
        runs = study.runs() if runs is None else runs
        store = cls.__new__(cls)
        store.path = store_path(path)
        lock = FolderLock(store.path.parent)
        try:
            _refuse_foreign(store.path, study)
            store._connection = connect(store.path, write=True)
            store._lock = lock
            store._define(study, runs)
        except BaseException:
            lock.release()
            raise
        return store

    def close(self) -> None:
        """Close the file and free the folder."""
        self._connection.close()
        if self._lock is not None:
            self._lock.release()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    # -- writing ---------------------------------------------------------------------------------
    @contextmanager
    def _transaction(self) -> Iterator[sqlite3.Connection]:
        with store_errors(self.path):
            self._connection.execute("BEGIN IMMEDIATE")
            try:
                yield self._connection
                self._connection.execute("COMMIT")
            except BaseException:
                if self._connection.in_transaction:  # SQLite has rolled back by itself when the disk is full
                    self._connection.execute("ROLLBACK")
                raise

    def _define(self, study: Study, runs: list[RunSpec]) -> None:
        from comparisons.run_key import versions

        now = _now()
        with self._transaction() as connection:
            created = connection.execute("SELECT value FROM meta WHERE key = 'created'").fetchone()
            values = {
                "study": study.to_dict(),
                "created": json.loads(created[0]) if created else now,
                "updated": now,
                "versions": versions(),
            }
            self._write_meta(connection, values)
            connection.execute("DELETE FROM plan")
            connection.executemany(
                "INSERT INTO plan VALUES (?, ?, ?, ?, ?, ?, ?)",
                [
                    (s.key, k, s.world_key, s.scenario_label, s.world, s.solver_label, s.seed)
                    for k, s in enumerate(runs)
                ],
            )

    @staticmethod
    def _write_meta(connection: sqlite3.Connection, values: dict[str, Any]) -> None:
        rows = [(key, json.dumps(value)) for key, value in values.items()]
        connection.executemany("INSERT OR REPLACE INTO meta VALUES (?, ?)", rows)

    def note(self, **values: Any) -> None:
        """Keep JSON values among `meta`."""
        with self._transaction() as connection:
            self._write_meta(connection, values)

    def add(self, record: RunRecord) -> None:
        """Commit one run, in one transaction; an earlier row of the same key is replaced.

        Raises
        ------
        StoreError
            If the file cannot be written.
        """
        arrays = [("run", "x", record.x), ("run", "trace", record.trace)]
        arrays += [("estimate", name, array) for name, array in record.estimate.items()]
        with self._transaction() as connection:
            before = connection.execute("SELECT attempts FROM runs WHERE key = ?", (record.key,)).fetchone()
            connection.execute("DELETE FROM run_arrays WHERE key = ?", (record.key,))
            connection.execute(
                "INSERT OR REPLACE INTO runs VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)",
                (
                    record.key,
                    record.status,
                    record.loss,
                    record.elapsed_s,
                    record.counts.get("cost"),
                    record.counts.get("loss"),
                    *(json.dumps(getattr(record, name)) for name in ("counts", "scores", "held_out")),
                    record.message,
                    json.dumps(record.invalid),
                    record.error,
                    json.dumps(record.settings),
                    1 + (before[0] if before else 0),
                    _now(),
                ),
            )
            connection.executemany(
                "INSERT INTO run_arrays VALUES (?, ?, ?, ?, ?)",
                [(record.key, part, name, *pack(array)) for part, name, array in arrays],
            )
            if record.illustration is not None:
                connection.executemany(
                    "INSERT OR REPLACE INTO illustrations VALUES (?, ?, ?, ?)",
                    [(record.world_key, name, *pack(array)) for name, array in record.illustration.items()],
                )

    # -- reading ---------------------------------------------------------------------------------
    def _rows(self, query: str, *values: Any) -> list[sqlite3.Row]:
        with store_errors(self.path):
            return self._connection.execute(query, values).fetchall()

    @property
    def study(self) -> Study:
        """The study as last defined."""
        return Study.from_dict(self.meta["study"], source=str(self.path))

    @property
    def meta(self) -> dict[str, Any]:
        """Study definition, versions, times of creation and last use (UTC), schema."""
        values = {row["key"]: json.loads(row["value"]) for row in self._rows("SELECT key, value FROM meta")}
        return {**values, "schema": self._rows("PRAGMA user_version")[0][0]}

    def statuses(self) -> dict[str, str]:
        """Status of every finished run in the file by key, whether the study still asks for it or not."""
        return {row["key"]: row["status"] for row in self._rows("SELECT key, status FROM runs")}

    @property
    def planned(self) -> int:
        """Number of runs that the study asks for."""
        return int(self._rows("SELECT count(*) FROM plan")[0][0])

    def score_names(self) -> set[str] | None:
        """Names of the scores of a successful run of the study; None while there is none."""
        rows = self._rows("SELECT scores FROM runs JOIN plan USING (key) WHERE status != 'failed' LIMIT 1")
        return set(json.loads(rows[0][0])) if rows else None

    def illustrated(self) -> set[str]:
        """World keys whose illustration is kept."""
        return {row[0] for row in self._rows("SELECT DISTINCT world_key FROM illustrations")}

    def runs(self) -> pd.DataFrame:
        """Finished runs of the study as last defined, in its order.

        Returns
        -------
        pandas.DataFrame
            Columns key, scenario, world, solver (labels), seed, status, loss, elapsed_s, cost, n_eval,
            counts, scores, held_out, x, message, invalid, error, settings, attempts, finished (UTC), and
            ``score.<key>`` and ``held_out.<key>`` for every score of any run; NaN where a run failed.
        """
        import pandas as pd

        rows = self._rows(
            "SELECT plan.scenario, plan.world, plan.solver, plan.seed, runs.* "
            "FROM plan JOIN runs USING (key) ORDER BY plan.position"
        )
        x = self._arrays("SELECT key, data, crc32 FROM run_arrays WHERE part = 'run' AND name = 'x'")
        records = []
        for row in rows:
            record = {name: row[name] for name in _COLUMNS}
            for name in _JSON:
                record[name] = json.loads(record[name])
            record["x"] = x[record["key"]]
            for prefix, name in (("score", "scores"), ("held_out", "held_out")):
                record.update({f"{prefix}.{key}": value for key, value in record[name].items()})
            records.append(record)
        frame = pd.DataFrame(records, columns=None if records else [*_COLUMNS, "x"])
        numbers = [
            "loss",
            "elapsed_s",
            "cost",
            "n_eval",
            *(c for c in map(str, frame) if c.startswith(_SCORED)),
        ]
        return frame.astype(dict.fromkeys(numbers, float))

    def traces(self) -> dict[str, np.ndarray]:
        """Traces of the finished runs of the study by key: structured arrays (cost, loss, elapsed_s)."""
        return self._arrays(
            "SELECT key, data, crc32 FROM run_arrays JOIN plan USING (key) "
            "WHERE part = 'run' AND name = 'trace' ORDER BY position"
        )

    def estimate(self, key: str) -> dict[str, np.ndarray]:
        """Array fields of the estimate of one run; empty for a failed one.

        Raises
        ------
        UnknownName
            If the store has no run of this key.
        """
        if key not in self.statuses():
            raise UnknownName("key", key, self.statuses())
        return self._arrays(
            "SELECT name, data, crc32 FROM run_arrays WHERE part = 'estimate' AND key = ?", key
        )

    def illustration(self, scenario: str, world: int) -> dict[str, np.ndarray]:
        """Arrays that picture a world, by scenario label and world seed; empty if none were kept."""
        return self._arrays(
            "SELECT name, data, crc32 FROM illustrations WHERE world_key = "
            "(SELECT world_key FROM plan WHERE scenario = ? AND world = ? LIMIT 1)",
            scenario,
            int(world),
        )

    def _arrays(self, query: str, *values: Any) -> dict[str, np.ndarray]:
        return {label: unpack(data, crc, self.path) for label, data, crc in self._rows(query, *values)}


_COLUMNS = (
    *("key", "scenario", "world", "solver", "seed", "status", "loss", "elapsed_s", "cost", "n_eval"),
    *("counts", "scores", "held_out", "message", "invalid", "error", "settings", "attempts", "finished"),
)
_SCORED = ("score.", "held_out.")


def _now() -> str:
    return datetime.now(UTC).isoformat(timespec="microseconds")


def _refuse_foreign(path: Path, study: Study) -> None:
    """Refuse a store of another study before anything in it is touched."""
    # None: a run that was killed before its first commit left an empty database
    stored = ((read_meta(path) if path.exists() else None) or {}).get("study", {})
    for what in ("name", "problem"):
        if what in stored and stored[what] != getattr(study, what):
            raise StoreError(
                f"{path}: this folder belongs to the study {stored['name']!r} on the problem "
                f"{stored['problem']!r}, not to {study.name!r} on {study.problem!r}; "
                "choose another with --out"
            )
