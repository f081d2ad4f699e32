"""Reads tables: functions of one number, given by points."""

from __future__ import annotations

from itertools import pairwise

from ..entries import ZERO
from ..parts import Instance
from ..reading import Reader
from ..schema import TableEntry
from ..tables import MAX_POINTS, Table


def read_tables(reader: Reader) -> list[Instance]:
    """Read the section; expressions that are read later may call the tables."""
    found = []
    for at, name, spec in reader.entries("tables", TableEntry, "table", "value"):
        if name is None or not reader.is_whole(spec):
            continue
        before = reader.errors
        x = [float(reader.bound(e, at, ("x", i), "constants").value) for i, e in enumerate(spec.x)]
        scope = "parameters" if spec.kind == "linear" else "constants"
        for i, e in enumerate(spec.y):
            reader.bound(e, at, ("y", i), scope)
        if len(x) != len(spec.y):
            reader.report(at, ("y",), f"{len(spec.y)} values for {len(x)} arguments x; each x needs one y")
        elif not 2 <= len(x) <= MAX_POINTS:
            reader.report(at, ("x",), f"{len(x)} points; 2 to {MAX_POINTS} are allowed, since each costs operations")
        for i, (a, b) in enumerate(pairwise(x)):
            if not a < b:
                reader.report(at, ("x", i + 1), f"{b:g} after {a:g}; arguments x must increase")
                break
        period = None if spec.period is None else float(reader.bound(spec.period, at, ("period",), "constants").value)
        if reader.errors == before:
            _check_period(reader, at, spec, x, period)
        y = [ZERO, ZERO]
        if reader.errors > before:  # a placeholder prevents further errors by calls of the table
            x = [0.0, 1.0]
        else:  # names as in the file; a call of the table replaces them by names of the model
            y = [at.part.binder(e, at.indices) for e in spec.y]
            if period is not None and x[0] + period > x[-1]:
                x, y = [*x, x[0] + period], [*y, y[0]]
        at.part.tables[at.part.written(name)] = Table(tuple(x), tuple(y), spec.kind, spec.outside)
        found.append(at)
    return found


def _check_period(reader: Reader, at: Instance, spec: TableEntry, x: list[float], period: float | None) -> None:
    """Report an impossible period, or a periodic table whose last value differs from its first."""
    length = x[-1] - x[0]
    if spec.outside != "periodic":
        if period is not None:
            message = f"a period is given with outside: {spec.outside}; a table with a period needs outside: periodic"
            reader.report(at, ("period",), message, key=True)
        return
    if period is not None and not period >= length:
        message = f"the period {period:g} is shorter than the distance {length:g} from the first point to the last one"
        reader.report(at, ("period",), message)
        return
    first, last = (at.part.binder(spec.y[i], at.indices) for i in (0, -1))
    if (period is None or period == length) and first is not last:
        message = (
            f"{last} at the end, {first} at the beginning; the last point of a periodic table is the first one again: give "
            f"both the same value, or leave the last point out and write its period: {length:g}"
        )
        reader.report(at, ("y", len(spec.y) - 1), message)
