"""Tables: functions of one number by their points."""

from __future__ import annotations

from itertools import pairwise

from ..entries import ZERO
from ..parts import Instance
from ..reading import Reader
from ..schema import TableEntry
from ..tables import MAX_POINTS, Table


def read_tables(reader: Reader) -> list[Instance]:
    """Read the section: from here on the names may be called in expressions."""
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
            reader.report(at, ("y",), f"{len(spec.y)} values at {len(x)} places; each x has one y")
        elif not 2 <= len(x) <= MAX_POINTS:
            reader.report(at, ("x",), f"{len(x)} points; 2 to {MAX_POINTS} are allowed, for each takes some operations")
        for i, (a, b) in enumerate(pairwise(x)):
            if not a < b:
                reader.report(at, ("x", i + 1), f"{b:g} after {a:g}; places grow from one to the next")
                break
        y = [ZERO, ZERO]
        if reader.errors > before:  # what calls it is sound
            x = [0.0, 1.0]
        else:  # in names of the file: they become the model's where the table is called
            y = [at.part.binder(e, at.indices) for e in spec.y]
        at.part.tables[at.part.written(name)] = Table(tuple(x), tuple(y), spec.kind, spec.outside)
        found.append(at)
    return found


def warn_of_unused_tables(reader: Reader, found: list[Instance]) -> None:
    """Warn of those that nothing calls."""
    for at in found:
        name = reader.local_name(at)
        if name not in at.part.asked:
            reader.report(at, (), f"table {name!r} is not used", key=True, severity="warning")
