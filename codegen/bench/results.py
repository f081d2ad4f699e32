"""Results of a benchmark run as JSON, and the comparison of two runs."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from ..ending import Failure
from ..measure import tables
from ..runtime.standalone.files.whole_file import MARK, write_whole

FORMAT = 1
"""Format number of the file; it is raised when entries change their names or meaning."""


DAMAGE = (KeyError, TypeError, AttributeError, ValueError, IndexError, ArithmeticError)
"""Errors that occur when a file was edited by hand or comes from another version."""


class ResultsError(Failure, ValueError):
    """Raised if a file does not contain results of the benchmark."""


def write_results(results: dict[str, Any], path: Path) -> None:
    """Write results completely, or leave the existing file unchanged."""
    text = json.dumps({"written": MARK, **results}, indent=1, allow_nan=False) + "\n"
    write_whole(path, lambda file: file.write(text.encode()))


def read_results(path: Path) -> dict[str, Any]:
    """Read the results of an earlier run.

    Raises
    ------
    ResultsError
    """
    hint = "give a file that `ordernm bench -o FILE` has written"
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise ResultsError(f"{path} cannot be read: {error.strerror or error}; {hint}") from None
    except (UnicodeDecodeError, ValueError, RecursionError) as error:
        raise ResultsError(f"{path} is not valid JSON ({error}); {hint}") from None
    if isinstance(found, dict) and found.get("format", FORMAT) != FORMAT:
        raise ResultsError(
            f"{path} has format {found['format']!r}; this version reads format {FORMAT}. Measure again with `ordernm bench -o`"
        )
    try:
        compare(found, found)
        other_machine(found, found)
        if not isinstance(found["quick"], bool):
            raise TypeError
        return dict(found)
    except DAMAGE:
        raise ResultsError(f"{path} does not contain benchmark results; {hint}") from None


def joined(parts: Sequence[tuple[Path, dict[str, Any]]]) -> dict[str, Any]:
    """Combine runs of parts of the benchmark; for a problem in several runs, the last one counts.

    Raises
    ------
    ResultsError
        If they are from different machines, or only some used ``--quick``.
    """
    (first, whole), *others = parts
    whole = {**whole, "problems": dict(whole["problems"])}
    for path, part in others:
        if differing := other_machine(part, whole):
            raise ResultsError(
                f"{path} and {first} are from different machines ({differing[0]}); give runs from one machine"
            )
        if part["quick"] != whole["quick"]:
            raise ResultsError(f"only one of {path} and {first} was measured with --quick; give runs of one kind")
        whole["problems"] |= part["problems"]
        whole |= {"peaks": part["peaks"]} if "peaks" in part else {}
        if "peers" in part:
            rows = {**whole.get("peers", {}).get("problems", {}), **part["peers"]["problems"]}
            whole["peers"] = {"skipped": part["peers"]["skipped"], "problems": rows}
    return whole


def figures(results: dict[str, Any]) -> Iterator[tuple[tuple[str, str], float | None, int | None, float]]:
    """Every measured entry: its problem, setting or size, and function; its error, evaluations and seconds."""
    for name, problem in results["problems"].items():
        if problem["kind"] == "motion":
            for p in problem["points"]:
                yield (name, f"{p['method']} {p['rtol']:.2g}"), p["error"], p["evaluations"], p["seconds"]
        elif problem["kind"] == "robots":
            for row in problem["rows"]:
                for function, seconds in row["seconds"].items():
                    yield (name, f"{row['model']}, {function}"), row["error"], None, seconds
        else:
            for row in problem["sizes"]:
                for function, seconds in row["seconds"].items():
                    yield (name, f"{row['size']}, {function}"), row["error"], None, seconds


def other_machine(new: dict[str, Any], old: dict[str, Any]) -> list[str]:
    """Differences between the machines of two runs, in words."""
    keys = [k for k in new["machine"] if k != "ordernm" and new["machine"][k] != old["machine"].get(k)]
    return [f"{k}: {old['machine'].get(k, 'unknown')} then, {new['machine'][k]} now" for k in keys]


def compare(new: dict[str, Any], old: dict[str, Any]) -> list[list[str]]:
    """Rows for entries that both runs contain: problem, setting, errors, evaluations, times, and the ratio of the new
    time to the old."""
    before = {key: (error, evaluations, seconds) for key, error, evaluations, seconds in figures(old)}
    rows = []
    for key, error, evaluations, seconds in figures(new):
        if key not in before:
            continue
        old_error, old_evaluations, old_seconds = before[key]
        work = [] if evaluations is None and old_evaluations is None else [str(old_evaluations), str(evaluations)]
        ratio = f"{seconds / old_seconds:.2f}" if old_seconds > 0 else ""
        errors, times = map(tables.error, (old_error, error)), map(tables.seconds, (old_seconds, seconds))
        rows.append([*key, *errors, *(work or ["", ""]), *times, ratio])
    return rows


COMPARED = ("", "", "error then", "now", "evaluations then", "now", "time then", "now", "ratio")
"""Header of the table that `compare` makes."""
