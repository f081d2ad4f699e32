"""The journal of a sweep: a line of JSON for every computed case, so that an interrupted sweep can continue.

The first line identifies solver and measure. Each other line holds a case with its results, or the reason of its failure. Lines
are added and never changed, so an interruption leaves at most one incomplete line, which is ignored. A file is checked before
anything is written to it. A damaged journal, or a file that is not a journal, is left unchanged.
"""

from __future__ import annotations

import contextlib
import json
import os
import stat
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, NamedTuple

from .measure_digest import measure_digest, package_digest
from .sweep_cases import Case, key

FORMAT, VERSION = "ordernm sweep", 2
BEGIN = json.dumps({"format": FORMAT}).encode().rstrip(b"}")
DAMAGE = (ValueError, RecursionError, TypeError, KeyError)
"""Errors while reading a line that show that it is not part of a journal."""


class SweepJournalError(ValueError):
    """Raised for a file that is not a journal, belongs to another sweep, or is being written by another sweep."""


class Row(NamedTuple):
    """Result of one case: its values, or the reason of its failure."""

    case: Case
    values: Case | None
    failure: str | None


class Journal:
    """A journal that is open for writing.

    Parameters
    ----------
    path
        File name; the file is created if it does not exist.
    solver : Solver
    measure : callable

    Attributes
    ----------
    rows : dict of str to Row
        Rows found in the file, by `sweep_cases.key`.

    Raises
    ------
    SweepJournalError
    OSError
    """

    def __init__(self, path: str | os.PathLike[str], solver: Any, measure: Callable[..., Any]):
        self.path = Path(path)
        if self.path.exists() and not stat.S_ISREG(self.path.stat().st_mode):
            raise SweepJournalError(f"{self.path} is not a regular file; a journal needs one: choose another name")
        self._file = open(self.path, "a+b")  # noqa: SIM115, closed by `close`
        try:
            self._lock()
            self.rows = self._read(_header(solver, measure))
        except BaseException:
            self._file.close()
            raise

    def add(self, rows: Iterable[Row]) -> None:
        """Append rows; when this returns, the operating system has received them."""
        lines = [
            json.dumps({"case": r.case} | ({"values": r.values} if r.failure is None else {"failed": r.failure}))
            for r in rows
        ]
        self._file.write("".join(f"{line}\n" for line in lines).encode())
        self._file.flush()

    def close(self) -> None:
        """Close the file of the journal."""
        self._file.close()

    def _lock(self) -> None:
        """Lock the file, since lines of two sweeps would mix."""
        with contextlib.suppress(ImportError):  # Windows has no fcntl
            import fcntl

            try:
                fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except OSError:
                raise SweepJournalError(
                    f"{self.path} is being written by another sweep; wait for it, or choose another file"
                ) from None

    def _read(self, header: Case) -> dict[str, Row]:
        """The rows of the file, which is checked completely before anything is written."""
        self._file.seek(0)
        whole, _, cut = self._file.read().rpartition(b"\n")
        first = json.dumps(header).encode()
        if not whole:
            if cut and not (first.startswith(cut) and cut.startswith(BEGIN)):  # the first line may be cut, too
                raise self._no_journal()
            self._file.truncate(0)
            self._file.write(first + b"\n")
            self._file.flush()
            return {}
        top, *lines = whole.split(b"\n")
        self._compare(top, header)
        rows = [self._row(number, line) for number, line in enumerate(lines, 2)]
        if cut:
            self._file.truncate(len(whole) + 1)
        return {key(row.case): row for row in rows}

    def _compare(self, line: bytes, header: Case) -> None:
        try:
            seen = json.loads(line)
        except DAMAGE:
            raise self._no_journal() from None
        if not isinstance(seen, dict) or seen.get("format") != FORMAT:
            raise self._no_journal()
        for name, mine in header.items():
            if seen.get(name) == mine:
                continue
            what = f"{name} was {seen.get(name)!r}, but is {mine!r} here"
            if name == "code":
                what = "the code of the measure, or a value that it refers to, has changed"
            raise SweepJournalError(
                f"{self.path} is the journal of another sweep: {what}; "
                f"choose another file, or remove this one to start again"
            )

    def _row(self, number: int, line: bytes) -> Row:
        try:
            seen = json.loads(line)
            case, values, failure = seen["case"], seen.get("values"), seen.get("failed")
            if not _is_flat(case) or not (_is_flat(values) if failure is None else isinstance(failure, str)):
                raise ValueError
        except (*DAMAGE, AttributeError):
            raise SweepJournalError(
                f"{self.path} is damaged in line {number} and was not changed; remove this line so that its case is computed "
                f"again, or choose another file"
            ) from None
        return Row(case, values, failure)

    def _no_journal(self) -> SweepJournalError:
        return SweepJournalError(f"{self.path} is not the journal of a sweep and was not changed; choose another file")


def _is_flat(row: Any) -> bool:
    """Whether an entry is a mapping of names to numbers, words and truth values."""
    return isinstance(row, dict) and all(x is None or isinstance(x, (bool, int, float, str)) for x in row.values())


def _header(solver: Any, measure: Callable[..., Any]) -> Case:
    """The key of a journal. It covers everything that affects results, except rounding and what `measure_digest` leaves out."""
    return {
        "format": FORMAT,
        "version": VERSION,
        "solver": solver.name,
        "package": package_digest(solver.folder),
        "bad_states": solver.bad_states,
        "measure": getattr(measure, "__qualname__", type(measure).__qualname__),
        "code": measure_digest(measure),
    }


__all__ = ["Journal", "Row", "SweepJournalError"]
