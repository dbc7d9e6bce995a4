"""Files of a result written as one, all of them or none, and the checksums of what it was made from."""

from __future__ import annotations

import hashlib
import os
import shutil
import tempfile
from collections.abc import Mapping
from pathlib import Path

from navopt.errors import InvalidInput

__all__ = ["checksums_of", "write_files"]


def checksums_of(inputs: Mapping[str, Path] | None) -> dict[str, dict[str, str]]:
    """Return name and SHA-256 of the files that were read, by what each was read as."""
    return {
        label: {"name": path.name, "sha256": hashlib.sha256(path.read_bytes()).hexdigest()}
        for label, path in (inputs or {}).items()
    }


def write_files(folder: str | Path, contents: Mapping[str, bytes]) -> list[Path]:
    """Write files into a folder, replacing those of an earlier result; others are not touched.

    Parameters
    ----------
    folder : path-like
        Where to; made if need be.
    contents : mapping of str to bytes
        What to write, by file name.

    Returns
    -------
    list of pathlib.Path
        The files, in the order of `contents`.

    Raises
    ------
    InvalidInput
        If the folder cannot be made or written; then it is as it was before.
    """
    target = Path(folder)
    if target.exists() and not target.is_dir():
        raise InvalidInput("--out", str(folder), "give a folder, not a file")
    for name in contents:
        if (target / name).is_dir():
            raise InvalidInput("--out", str(folder), f"there is a folder {name} in it: give another one")
    made = [parent for parent in (target, *target.parents) if not parent.exists()]
    waiting: Path | None = None
    try:
        target.mkdir(parents=True, exist_ok=True)
        # first everything beside its place, then one rename each
        waiting = Path(tempfile.mkdtemp(prefix=".result-", dir=target))
        for name, content in contents.items():
            (waiting / name).write_bytes(content)
        for name in contents:
            os.replace(waiting / name, target / name)
    except OSError as error:
        if waiting is not None:
            shutil.rmtree(waiting, ignore_errors=True)
        for parent in made:
            if parent.is_dir() and not any(parent.iterdir()):
                parent.rmdir()
        raise InvalidInput(
            "--out", str(folder), f"give a folder that can be written ({error.strerror})"
        ) from None
    shutil.rmtree(waiting, ignore_errors=True)
    return [target / name for name in contents]
