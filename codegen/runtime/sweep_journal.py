"""The journal of a sweep: a line of JSON for every case that was computed, so that a sweep goes on where it was stopped.

The first line says of what solver and measure it is; each of the others holds a case and what was measured, or why it failed.
Lines are added and never changed, so that whatever stops the program leaves at most one that is cut short, which is forgotten.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, NamedTuple

from .sweep_cases import Case, key

FORMAT, VERSION = "ordernm sweep", 1
SOURCES = (".c", ".h", ".py", ".json")
"""Of these files a package's identity is made."""


class SweepJournalError(ValueError):
    """A journal that belongs to something else, or that another sweep is writing."""


class Row(NamedTuple):
    """What is known of one case: what was measured, or why it failed."""

    case: Case
    values: Case | None
    failure: str | None


class Journal:
    """A journal that is open for writing.

    Parameters
    ----------
    path
        A file, which is made where it is not there.
    solver : Solver
    measure : callable

    Attributes
    ----------
    rows : dict of str to Row
        What it held, by `sweep_cases.key`.

    Raises
    ------
    SweepJournalError
    OSError
    """

    def __init__(self, path: str | os.PathLike[str], solver: Any, measure: Callable[..., Any]):
        self.path = Path(path)
        self._file = open(self.path, "a+b")  # noqa: SIM115, closed by `close`
        try:
            self._lock()
            self.rows = self._read(_header(solver, measure))
        except BaseException:
            self._file.close()
            raise

    def add(self, rows: Iterable[Row]) -> None:
        """Write rows behind the others; they are with the operating system when this returns."""
        lines = [
            json.dumps({"case": r.case} | ({"values": r.values} if r.failure is None else {"failed": r.failure}))
            for r in rows
        ]
        self._file.write("".join(f"{line}\n" for line in lines).encode())
        self._file.flush()

    def close(self) -> None:
        """End writing."""
        self._file.close()

    def _lock(self) -> None:
        """Two sweeps that wrote one file would mix their lines."""
        with contextlib.suppress(ImportError):  # there is none on Windows
            import fcntl

            try:
                fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except OSError:
                raise SweepJournalError(
                    f"{self.path} is being written by another sweep; wait for it, or choose another file"
                ) from None

    def _read(self, header: Case) -> dict[str, Row]:
        self._file.seek(0)
        whole, _, cut = self._file.read().rpartition(b"\n")
        if cut:
            self._file.truncate(len(whole) + 1 if whole else 0)
        lines = whole.split(b"\n") if whole else []
        if not lines:
            self._file.write(json.dumps(header).encode() + b"\n")
            self._file.flush()
            return {}
        try:
            seen, *rows = [json.loads(line) for line in lines]
            if not isinstance(seen, dict) or seen.get("format") != FORMAT:
                raise ValueError
        except ValueError:
            raise SweepJournalError(
                f"{self.path} is no journal of a sweep, and is left as it is; choose another file"
            ) from None
        for name, mine in header.items():
            if seen.get(name) != mine:
                raise SweepJournalError(
                    f"{self.path} is the journal of another sweep: {name} was {seen.get(name)!r}, here {mine!r}; "
                    f"choose another file, or remove this one to begin anew"
                )
        found = (Row(r["case"], r.get("values"), r.get("failed")) for r in rows)
        return {key(row.case): row for row in found}


def _header(solver: Any, measure: Callable[..., Any]) -> Case:
    whole = hashlib.sha256()
    for path in sorted(Path(solver.folder).rglob("*")):
        if path.suffix in SOURCES and "__pycache__" not in path.parts:
            whole.update(str(path.relative_to(solver.folder)).encode() + b"\0" + path.read_bytes())
    name = getattr(measure, "__qualname__", type(measure).__qualname__)
    return {
        "format": FORMAT,
        "version": VERSION,
        "solver": solver.name,
        "package": whole.hexdigest()[:16],
        "measure": name,
    }


__all__ = ["Journal", "Row", "SweepJournalError"]
