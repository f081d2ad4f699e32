"""Comparison of two reports of a model: numbers must be equal, and times must agree within the spread of both
reports."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..ending import Failure
from ..measure.core import FIXED_WORK

SPREAD = 0.15
"""Times of two runs agree if their ranges overlap after each is widened by this fraction. A range goes from the least
time to the 90th percentile over several processes. If the fixed work shows that the core or its caches were slower in
one run, the lower end of the range of that run is reduced by `slowed`."""

MOST_SLOWED = 2.0
"""Exponent: other processes on the core slow code down by up to the square of the factor by which they slow the fixed
work. On two AVX2 cores of a virtual machine, fixed work took 1.6 times as long. So did most functions; long code and
long arrays took up to 2.5 times as long."""

DIGITS = 1e-9
"""Relative tolerance of numbers; on one machine, results differ at most in the last digits of LAPACK results."""

SAME_MACHINE = ("processor", "instructions", "compiler", "flags")

MEASURED = {
    "seconds",
    "seconds_high",
    "core",
    "cache",
    "cpu_seconds",
    "date",
    "machine",
    "times",
    "roofline",
    "errors",
    "skipped",
    "differences",
    "written",
    "files",
}
"""Keys that are not compared entry by entry: dates, times that were taken once, and parts that are compared
separately."""

NOTABLE = 1.1
"""Ratio of the times of the fixed work above which a slower core is reported."""

MOST_LINES = 12
"""Largest number of differences listed for a part."""


class NoReportError(Failure):
    """Raised for a file or folder that contains no report."""


def read(path: Path) -> dict[str, Any]:
    """The numbers of a report, from its folder or its ``report.json``."""
    file = path / "report.json" if path.is_dir() else path
    try:
        found = json.loads(file.read_text(encoding="utf-8"))
    except OSError as error:
        raise NoReportError(f"{file} cannot be read: {error.strerror or error}") from None
    except (ValueError, RecursionError) as error:
        raise NoReportError(f"{file} contains no report: it is not valid JSON ({error})") from None
    if not isinstance(found, dict) or "generated" not in found or "model" not in found:
        raise NoReportError(f"{file} contains no report; give the folder that ordernm report wrote, or its report.json")
    try:
        disagreements(found, found)
        agreed(found, found)
    except (KeyError, TypeError, AttributeError, ValueError, IndexError, ArithmeticError, RecursionError) as error:
        raise NoReportError(f"{file} is damaged, or of another version: {type(error).__name__}: {error}") from None
    return found


def read_gallery(folder: Path) -> dict[str, dict[str, Any]]:
    """All reports of a gallery, by the names of their folders.

    Raises
    ------
    NoReportError
        If there are none.
    """
    found = {p.parent.name: read(p) for p in sorted(folder.glob("*/report.json"))}
    if not found:
        raise NoReportError(
            f"{folder} contains no folders with a report.json; give the folder that ordernm report wrote"
        )
    return found


def disagreements(one: Mapping[str, Any], other: Mapping[str, Any], most: int = MOST_LINES) -> list[str]:
    """Differences between two reports of one model, in sentences; empty if they agree.

    Parameters
    ----------
    one, other : mapping
        Reports as `read` returns them.
    most : int
        Largest number of sentences of each kind; the others are counted.
    """
    if why := incomparable(one, other):
        return [why]
    found = _first(list(_different("", one, other)), most)
    found += _first(list(_errors(one, other)), most)
    return found + _first(list(_times(one, other)), most)


def incomparable(one: Mapping[str, Any], other: Mapping[str, Any]) -> str:
    """Reasons why two reports cannot be compared, from their entries ``model`` and ``machine``; empty if they can
    be."""
    if one["model"] != other["model"]:
        return f"the reports are of different models, {one['model']} and {other['model']}"
    elsewhere = [k for k in SAME_MACHINE if one["machine"][k] != other["machine"][k]]
    several = [f"{k}: {one['machine'][k]}, {other['machine'][k]}" for k in elsewhere]
    return f"the reports are from different machines: {'; '.join(several)}" if several else ""


def agreed(one: Mapping[str, Any], other: Mapping[str, Any]) -> str:
    """The sentence for two reports that agree, with the change in speed of the core."""
    cores = [
        Beside.of({w: (r.get("times") or {}).get(w, {}).get("median", 1.0) for w in FIXED_WORK}) for r in (one, other)
    ]
    return "agrees with the earlier report" + _of_the_core(*cores)


@dataclass(frozen=True)
class Beside:
    """Seconds of the fixed work during a measurement, see `Core.turn`; 1 if it was not timed."""

    core: float
    cache: float

    @classmethod
    def of(cls, record: Mapping[str, Any]) -> Beside:
        return cls(*(record.get(work, 1.0) for work in FIXED_WORK))

    def slower(self, than: Beside) -> float:
        """Ratio by which the core or its caches were slower than in another run; at least 1."""
        return max(self.core / than.core, self.cache / than.cache, 1.0)


def slowed(beside: Beside, other: Beside) -> float:
    """Ratio by which times of this run may exceed those of another run, because the fixed work was slower."""
    return beside.slower(other) ** MOST_SLOWED


def _of_the_core(before: Beside, now: Beside) -> str:
    slower, faster = now.slower(before), before.slower(now)
    if max(slower, faster) < NOTABLE:
        return ""
    return f"; fixed work now takes {slower if slower > faster else 1 / faster:.2f} times as long"


def _first(lines: list[str], most: int) -> list[str]:
    more = len(lines) - most
    return lines if more <= 0 else [*lines[:most], f"and {more} more"]


def _different(place: str, a: Any, b: Any) -> Iterator[str]:
    """Entries that differ, each with its place in the report."""
    if isinstance(a, Mapping) and isinstance(b, Mapping):
        for key in dict.fromkeys([*a, *b]):
            if key in MEASURED:
                continue
            here = f"{place}.{key}" if place else key
            if key not in a or key not in b:
                yield f"only one report has {here}"
            else:
                yield from _different(here, a[key], b[key])
    elif isinstance(a, list) and isinstance(b, list):
        if len(a) != len(b):
            yield f"{place} has {len(a)} entries in one report and {len(b)} in the other"
        for i, (x, y) in enumerate(zip(a, b, strict=False)):
            yield from _different(f"{place}[{i}]", x, y)
    elif not _same(a, b):
        yield f"{place} is {a} in one report and {b} in the other"


def _same(a: Any, b: Any) -> bool:
    if isinstance(a, bool) or isinstance(b, bool) or not isinstance(a, int | float) or not isinstance(b, int | float):
        return bool(a == b)
    return math.isclose(a, b, rel_tol=DIGITS)


def _errors(one: Mapping[str, Any], other: Mapping[str, Any]) -> Iterator[str]:
    """Differences between the errors at states and directions that both reports have. One may have more than the other,
    because the time of the reference is limited."""
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
    noted = any("errors" in s["what"] for r in (one, other) for s in r["skipped"])
    if set(a) != set(b) and not noted:
        yield f"errors are at the states {', '.join(a)} in one report and {', '.join(b)} in the other"


def _times(one: Mapping[str, Any], other: Mapping[str, Any]) -> Iterator[str]:
    a, b = dict(_ranges(one)), dict(_ranges(other))
    for name in (n for n in a if n in b):
        x, y = a[name], b[name]
        lows = x.low / slowed(x.beside, y.beside), y.low / slowed(y.beside, x.beside)
        if lows[0] > y.high * (1 + SPREAD) or lows[1] > x.high * (1 + SPREAD):
            core = _of_the_core(x.beside, y.beside)
            yield f"{name}: {x.low:.3g} to {x.high:.3g} in one report, {y.low:.3g} to {y.high:.3g} in the other{core}"


@dataclass(frozen=True)
class Range:
    """Range of a time in seconds, and the time of the fixed work during the measurement."""

    low: float
    high: float
    beside: Beside


def _ranges(report: Mapping[str, Any]) -> Iterator[tuple[str, Range]]:
    """The ranges of all times in a report, by name."""

    def of(record: Mapping[str, Any]) -> Range:
        return Range(record["least"], record["high"], Beside.of(record))

    times = report.get("times") or {}
    for name, x in times.get("functions", {}).items():
        yield f"seconds of {name}, in C", of(x["compiled"])
        yield f"seconds of {name}, one call", of(x["call"])
    for n, x in times.get("batches", {}).items():
        yield f"seconds of a state in a batch of {n}", of(x)
    roofline = report.get("roofline") or {}
    for name, best in roofline.get("peaks", {}).items():
        beside = Beside.of({work: roofline.get(work, {}).get(name, 1.0) for work in FIXED_WORK})
        yield f"peak, seconds per operation or byte, {name}", Range(1 / best, 1 / roofline["peaks_low"][name], beside)
    motions = report.get("motions") or {}
    for method, points in motions.get("methods", {}).items():
        for p in points:
            name = f"seconds of {method} at {p['setting']:g}"
            yield name, Range(p["seconds"], p["seconds_high"], Beside.of(p))
