"""The file under a results store: opening it safely, its tables, its lock, and arrays without pickle.

SQLite in WAL mode with ``synchronous=NORMAL``: a killed process loses at most the run it had not
committed, and the file is never left half-written. Only after a power failure may the last commits be
missing as well; they are then run again, which costs less than a disk flush after each run.
"""

from __future__ import annotations

import io
import json
import os
import sqlite3
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any

import numpy as np

from navopt.errors import StoreError

__all__ = [
    "FILE_NAME",
    "SCHEMA",
    "FolderLock",
    "connect",
    "pack",
    "read_meta",
    "store_errors",
    "store_path",
    "unpack",
]

FILE_NAME = "results.sqlite"
SCHEMA = 1
#: "nvop" in ASCII: tells a results store from any other SQLite file.
APPLICATION_ID = 0x6E766F70

_TABLES = """
CREATE TABLE meta (key TEXT PRIMARY KEY, value TEXT NOT NULL) WITHOUT ROWID;
CREATE TABLE plan (
    key TEXT PRIMARY KEY, position INTEGER NOT NULL, world_key TEXT NOT NULL, scenario TEXT NOT NULL,
    world INTEGER NOT NULL, solver TEXT NOT NULL, seed INTEGER NOT NULL
) WITHOUT ROWID;
CREATE TABLE runs (
    key TEXT PRIMARY KEY, status TEXT NOT NULL, loss REAL, elapsed_s REAL, cost INTEGER, n_eval INTEGER,
    counts TEXT NOT NULL, scores TEXT NOT NULL, held_out TEXT NOT NULL, message TEXT NOT NULL,
    invalid TEXT NOT NULL, error TEXT, settings TEXT NOT NULL, attempts INTEGER NOT NULL,
    finished TEXT NOT NULL
);
CREATE TABLE run_arrays (
    key TEXT NOT NULL, part TEXT NOT NULL, name TEXT NOT NULL, data BLOB NOT NULL, crc32 INTEGER NOT NULL,
    PRIMARY KEY (key, part, name)
);
CREATE TABLE illustrations (
    world_key TEXT NOT NULL, name TEXT NOT NULL, data BLOB NOT NULL, crc32 INTEGER NOT NULL,
    PRIMARY KEY (world_key, name)
);
"""


def store_path(path: str | Path) -> Path:
    """File of a store, given that file or the results folder."""
    path = Path(path)
    return path if path.suffix == ".sqlite" else path / FILE_NAME


def pack(array: np.ndarray) -> tuple[bytes, int]:
    """Bytes of an array in npy format, never pickled, and their CRC-32."""
    buffer = io.BytesIO()
    np.lib.format.write_array(buffer, np.asarray(array), allow_pickle=False)
    data = buffer.getvalue()
    return data, zlib.crc32(data)


def unpack(data: bytes, crc32: int, path: Path) -> np.ndarray:
    """Array of `pack`.

    Raises
    ------
    StoreError
        If the bytes are not those that were written.
    """
    try:
        if zlib.crc32(data) != crc32:
            raise ValueError("checksum differs")
        array: np.ndarray = np.lib.format.read_array(io.BytesIO(data), allow_pickle=False)
    except (ValueError, EOFError, OSError) as error:
        raise StoreError(f"{path}: an array in the store is damaged ({error}); {_ASIDE}") from None
    return array


_ASIDE = "restore the file from a copy, or move it away and run the study again"


@contextmanager
def store_errors(path: Path) -> Iterator[None]:
    """Turn errors of SQLite and the file system into a `StoreError` that names file and remedy."""
    try:
        yield
    except (sqlite3.OperationalError, OSError) as error:
        raise StoreError(
            f"{path}: the results store cannot be used ({error}); check free space, permissions and that "
            "no other program holds it"
        ) from error
    except sqlite3.DatabaseError as error:
        raise StoreError(f"{path}: the results store is damaged ({error}); {_ASIDE}") from error


def connect(path: Path, *, write: bool) -> sqlite3.Connection:
    """Open a results store after making sure that it is one; a refused file is left as it was.

    Parameters
    ----------
    path : pathlib.Path
        The file. For writing it is created, with its tables, where there is none.
    write : bool, keyword-only
        Whether rows will be written.

    Raises
    ------
    StoreError
        If there is no store, or the file is damaged, of a newer version or something else.
    """
    exists = path.exists()
    if not exists and not write:
        raise StoreError(
            f"{path}: there is no results store here; start one with `navopt run STUDY --out DIR`"
        )
    with store_errors(path):
        fresh = not exists or read_meta(path) is None
        if fresh and not write:
            raise StoreError(
                f"{path}: the results store is still empty; continue the study with `navopt run`"
            )
        connection = _open_for_writing(path, fresh) if write else _open_for_reading(path)
        connection.row_factory = sqlite3.Row
        return connection


def read_meta(path: Path) -> dict[str, Any] | None:
    """Meta table of a store, read without changing a byte of it; None for an empty database.

    Raises
    ------
    StoreError
        If the file is damaged, of a newer version or not a results store.
    """
    with store_errors(path):
        probe = _read_only(path)
        try:
            application, schema = (probe.execute(f"PRAGMA {name}").fetchone()[0] for name in _IDENTITY)
            tables = probe.execute("SELECT count(*) FROM sqlite_master").fetchone()[0]
            if not tables and application == 0:
                return None
            if application != APPLICATION_ID:
                raise StoreError(f"{path}: this is not a results store of navopt; choose another folder")
            if schema > SCHEMA:
                raise StoreError(
                    f"{path}: written by a newer navopt (store schema {schema}, this version reads "
                    f"{SCHEMA}); update navopt, or choose another folder"
                )
            fault = probe.execute("PRAGMA quick_check(1)").fetchone()[0]
            if fault != "ok":
                raise StoreError(f"{path}: the results store is damaged ({fault.splitlines()[-1]}); {_ASIDE}")
            return {key: json.loads(value) for key, value in probe.execute("SELECT key, value FROM meta")}
        finally:
            probe.close()


_IDENTITY = ("application_id", "user_version")


def _read_only(path: Path) -> sqlite3.Connection:
    # without a write-ahead log beside it the file is complete, and immutable=1 leaves no files behind
    alone = not Path(f"{path}-wal").exists()
    uri = f"{path.absolute().as_uri()}?mode=ro{'&immutable=1' if alone else ''}"
    return sqlite3.connect(uri, uri=True, timeout=10.0)


def _open_for_reading(path: Path) -> sqlite3.Connection:
    # an ordinary connection takes its log away when it closes, a read-only one would leave it
    connection = sqlite3.connect(path, timeout=10.0)
    try:
        connection.execute("PRAGMA query_only=ON")
        connection.execute("SELECT count(*) FROM meta").fetchone()
    except sqlite3.OperationalError:
        connection.close()
        connection = _read_only(path)  # a medium that cannot be written
    return connection


def _open_for_writing(path: Path, fresh: bool) -> sqlite3.Connection:
    # autocommit here, explicit transactions in the store: one run, one transaction
    connection = sqlite3.connect(path, timeout=10.0, isolation_level=None)
    connection.execute("PRAGMA journal_mode=WAL")
    connection.execute("PRAGMA synchronous=NORMAL")
    if fresh:
        connection.execute("BEGIN IMMEDIATE")
        for statement in _TABLES.strip().split(";"):
            if statement.strip():
                connection.execute(statement)
        connection.execute(f"PRAGMA application_id={APPLICATION_ID}")
        connection.execute(f"PRAGMA user_version={SCHEMA}")
        connection.execute("COMMIT")
    return connection


class FolderLock:
    """Exclusive use of a results folder; the system releases it when the process ends, however it ends.

    Parameters
    ----------
    folder : pathlib.Path
        The results folder, created if there is none.

    Raises
    ------
    StoreError
        If another process is running a study in this folder, or it cannot be written.
    """

    def __init__(self, folder: Path) -> None:
        self.path = folder / "results.lock"
        with store_errors(folder):
            folder.mkdir(parents=True, exist_ok=True)
            while True:
                self._file: IO[str] = open(self.path, "a+", encoding="utf-8")  # noqa: SIM115
                if not _lock(self._file):
                    self._file.seek(0)
                    owner = self._file.read().strip() or "unknown"
                    self._file.close()
                    raise StoreError(
                        f"{folder}: another `navopt run` (process {owner}) is working in this folder; wait "
                        "for it to end, or choose another with --out"
                    )
                # the owner before us may have removed the file between our opening and locking it
                if self.path.exists() and os.path.samestat(os.fstat(self._file.fileno()), self.path.stat()):
                    break
                self._file.close()
            self._file.truncate(0)
            self._file.write(str(os.getpid()))
            self._file.flush()

    def release(self) -> None:
        """Give the folder free again; harmless if done twice."""
        if not self._file.closed:
            if os.name == "posix":  # elsewhere an open file cannot be removed; it then stays, unlocked
                self.path.unlink(missing_ok=True)
            self._file.close()


def _lock(file: IO[Any]) -> bool:
    try:
        if os.name == "posix":
            import fcntl

            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        else:
            import msvcrt

            file.seek(1 << 20)  # a byte far beyond the text, so that others can still read who owns it
            msvcrt.locking(file.fileno(), msvcrt.LK_NBLCK, 1)  # type: ignore[attr-defined, unused-ignore]
    except OSError:
        return False
    return True
