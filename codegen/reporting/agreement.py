"""Whether two reports of a model agree: numbers in all their digits, times within the spread that both state."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

SPREAD = 0.15
"""Times of two runs agree if their ranges meet, each from the least to what nine turns of ten took in several processes, and this
part beyond."""

DIGITS = 1e-9
"""Relative; what is computed is the same on one machine, but for the last digits of what LAPACK gives."""

SAME_MACHINE = ("processor", "instructions", "compiler", "flags")

MEASURED = {
    "seconds",
    "seconds_high",
    "cpu_seconds",
    "date",
    "machine",
    "times",
    "roofline",
    "errors",
    "skipped",
    "differences",
}
"""Keys of what is compared in another way than entry by entry, or not at all: dates, and times that were taken once."""

MOST_LINES = 12
"""So many differences of a part are listed."""


class NoReportError(Exception):
    """A file or folder that holds no report."""


def read(path: Path) -> dict[str, Any]:
    """A report's numbers, from its folder or its ``report.json``.

    Raises
    ------
    NoReportError
    """
    file = path / "report.json" if path.is_dir() else path
    try:
        found = json.loads(file.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise NoReportError(f"{file}: {error}") from None
    if not isinstance(found, dict) or "generated" not in found or "model" not in found:
        raise NoReportError(f"{file} holds no report; give the folder that ordernm report wrote, or its report.json")
    return found


def read_gallery(folder: Path) -> dict[str, dict[str, Any]]:
    """All reports of a gallery by their folders' names.

    Raises
    ------
    NoReportError
        There are none.
    """
    found = {p.parent.name: read(p) for p in sorted(folder.glob("*/report.json"))}
    if not found:
        raise NoReportError(f"{folder} holds no folders with a report.json; give the one that ordernm report wrote")
    return found


def disagreements(one: Mapping[str, Any], other: Mapping[str, Any], most: int = MOST_LINES) -> list[str]:
    """What two reports of one model say differently, in sentences; none if they agree.

    Parameters
    ----------
    one, other : mapping
        As `read` gives them.
    most : int
        So many sentences of a kind, and how many more there are.
    """
    if one["model"] != other["model"]:
        return [f"they are of different models, {one['model']} and {other['model']}"]
    elsewhere = [k for k in SAME_MACHINE if one["machine"][k] != other["machine"][k]]
    if elsewhere:
        return [f"they are of different machines: {k}: {one['machine'][k]}, {other['machine'][k]}" for k in elsewhere]
    found = _first(list(_different("", one, other)), most)
    found += _first(list(_errors(one, other)), most)
    return found + _first(list(_times(one, other)), most)


def _first(lines: list[str], most: int) -> list[str]:
    more = len(lines) - most
    return lines if more <= 0 else [*lines[:most], f"and {more} more"]


def _different(place: str, a: Any, b: Any) -> Iterator[str]:
    """Entries that are not the same, by their place."""
    if isinstance(a, Mapping) and isinstance(b, Mapping):
        for key in dict.fromkeys([*a, *b]):
            if key in MEASURED:
                continue
            here = f"{place}.{key}" if place else key
            if key not in a or key not in b:
                yield f"{here} is in one of them only"
            else:
                yield from _different(here, a[key], b[key])
    elif isinstance(a, list) and isinstance(b, list):
        if len(a) != len(b):
            yield f"{place} has {len(a)} entries, and {len(b)}"
        for i, (x, y) in enumerate(zip(a, b, strict=False)):
            yield from _different(f"{place}[{i}]", x, y)
    elif not _same(a, b):
        yield f"{place} is {a}, and {b}"


def _same(a: Any, b: Any) -> bool:
    if isinstance(a, bool) or isinstance(b, bool) or not isinstance(a, int | float) or not isinstance(b, int | float):
        return bool(a == b)
    return math.isclose(a, b, rel_tol=DIGITS)


def _errors(one: Mapping[str, Any], other: Mapping[str, Any]) -> Iterator[str]:
    """Errors of what both have compared: the time that the reference may take is a matter of seconds."""
    a, b = ({e["state"]: e for e in x.get("errors") or []} for x in (one, other))
    for state in (s for s in a if s in b):
        for key in (k for k in a[state] if k in b[state]):
            x, y = a[state][key], b[state][key]
            if isinstance(x, Mapping):
                both = [name for name in x if name in y]
                x, y = ({name: z[name] for name in both} for z in (x, y))
            yield from _different(f"errors at {state}: {key}", x, y)
    x, y = one.get("differences"), other.get("differences")
    if x and y and x["reference"] == y["reference"]:
        yield from _different("differences", x, y)
    told = any("errors" in s["what"] for r in (one, other) for s in r["skipped"])
    if set(a) != set(b) and not told:
        yield f"errors are at the states {', '.join(a)}, and {', '.join(b)}"


def _times(one: Mapping[str, Any], other: Mapping[str, Any]) -> Iterator[str]:
    a, b = dict(_ranges(one)), dict(_ranges(other))
    for name in (n for n in a if n in b):
        (low, high), (other_low, other_high) = a[name], b[name]
        if low > other_high * (1 + SPREAD) or other_low > high * (1 + SPREAD):
            yield f"{name}: {low:.3g} to {high:.3g}, and {other_low:.3g} to {other_high:.3g}"


def _ranges(report: Mapping[str, Any]) -> Iterator[tuple[str, tuple[float, float]]]:
    """What has a spread: its name, the least and the largest."""
    times = report.get("times") or {}
    for name, x in times.get("functions", {}).items():
        for kind, words in (("compiled", "in C"), ("call", "one call")):
            yield f"seconds of {name}, {words}", (x[kind]["least"], x[kind]["high"])
    for n, x in times.get("batches", {}).items():
        yield f"seconds of a state in a batch of {n}", (x["least"], x["high"])
    peaks = (report.get("roofline") or {}).get("peaks", {})
    for name, best in peaks.items():
        yield f"peak, {name}", (report["roofline"]["peaks_low"][name], best)
    motions = report.get("motions") or {}
    for method, points in motions.get("methods", {}).items():
        for p in points:
            yield f"seconds of {method} at {p['setting']:g}", (p["seconds"], p["seconds_high"])
