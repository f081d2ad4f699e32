"""Results of the benchmark as lines for a terminal."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from ..measure.clock import exponent
from ..measure.operations import plain
from ..measure.tables import error, seconds
from ..summary import table
from .problem import setting_of
from .results import COMPARED, compare, other_machine


def machine_line(machine: dict[str, str]) -> str:
    return (
        f"{machine['processor']}, {machine['instructions']}; {machine['compiler']}, {machine['flags']}; "
        f"ordernm {machine['ordernm']}, Python {machine['python']}"
    )


def result_lines(results: dict[str, Any], width: int | None) -> list[str]:
    """All results as lines: the machine, the problems, and other programs."""
    lines = [machine_line(results["machine"])]
    for name, result in results["problems"].items():
        lines += ["", *problem_lines(name, result, width)]
    return lines + (["", *peer_lines(results["peers"], width)] if "peers" in results else [])


def problem_lines(name: str, result: dict[str, Any], width: int | None) -> list[str]:
    """The lines of a problem: title, table and goals."""
    body = LINES[result["kind"]](result, width)
    return [f"{name}: {result['title']}", f"  reference: {result['source']}", *body]


def motion_lines(result: dict[str, Any], width: int | None) -> list[str]:
    each = plain(result["operations"])
    lines = table(*point_table(result), width)
    lines.append(
        f"  {each} additions and multiplications an evaluation of udot; generated in {result['generation_seconds']:.1f} s"
    )
    for goal in result.get("goals", ()):
        lines.append(f"  {goal_line(goal)}")
    if "derivatives" in result:
        d = result["derivatives"]
        lines.append(
            f"  derivatives with respect to {', '.join(d['by'])}, {d['setting']}: relative error {d['error']:.1e}, "
            f"{seconds(d['seconds'])}"
        )
    if result["failed"] and "within" in result:
        lines.append(f"  failed: error above {result['within']:.0e} with {', '.join(result['failed'])}")
    return lines


Rows = tuple[Sequence[str], list[list[str]]]
"""Type of a table: header and rows; the page uses the same tables."""


def point_table(result: dict[str, Any]) -> Rows:
    """Header and rows of a table with one row for each setting of a motion."""
    head = ("setting", "error", "evaluations", "steps", "rejected", "ms")
    counted = ("evaluations", "steps", "rejected")
    return head, [
        [setting_of(p), error_of(p), *(str(p[n]) for n in counted), f"{1e3 * p['seconds']:.2f}"]
        for p in result["points"]
    ]


def error_of(p: dict[str, Any]) -> str:
    """The error of a point of the diagram; for a motion that ended early, the reason."""
    # the reason of an early end is long; its part before the first colon names the place
    return error(p["error"]) if p["ended"] == "finished" else f"ended early: {p['ended'].partition(':')[0]}"


def goal_line(goal: dict[str, Any]) -> str:
    """The line of a goal, with the setting that reached it."""
    p = goal["reached"]
    if p is None:
        return f"error {goal['goal']}: missed at all tolerances"
    how = f"{error(p['error'])}, {p['evaluations']} evaluations, {seconds(p['seconds'])} with {setting_of(p)}"
    return f"error {goal['goal']}: {'reached' if goal['met'] else 'missed'}, {how}"


def family_lines(result: dict[str, Any], width: int | None) -> list[str]:
    lines = table(*family_table(result), width)
    if slopes := growth(result):
        lines.append(f"  exponent of time: {slopes}")
    if result["failed"]:
        lines.append(f"  failed: error above {result['within']:.0e} with {', '.join(result['failed'])}")
    return lines


def family_table(result: dict[str, Any]) -> Rows:
    """Models of a family by size: error, operations and times; operations and times also per coordinate."""
    functions = list(result["sizes"][0]["seconds"])
    head = [result["unit"], "coordinates", "error", "udot, operations each", "one more direction",
            *(x for f in functions for x in (f, "ns each"))]  # fmt: skip
    rows = []
    for r in result["sizes"]:
        n = r["bodies"]
        each = (f"{plain(r[of]) / n:.0f}" for of in ("operations", "operations_direction"))
        times = (x for s in r["seconds"].values() for x in (seconds(s), f"{1e9 * s / n:.1f}"))
        rows.append([str(r["size"]), str(n), error(r["error"]), *each, *times])
    return head, rows


def growth(result: dict[str, Any]) -> str:
    """Exponent of the time as a power of the size, by function; empty for fewer than three sizes."""
    rows = result["sizes"]
    sizes = [r["size"] for r in rows]
    slopes = (f"{f} {exponent(sizes, [r['seconds'][f] for r in rows]):.2f}" for f in rows[0]["seconds"])
    return ", ".join(slopes) if len(rows) > 2 else ""


def robot_table(rows: Sequence[dict[str, Any]]) -> Rows:
    """Header and rows of a table of robots: times of ordernm and of Pinocchio, and the ratio of the two, by
    function."""
    head = ["", "speeds", "difference", *(x for what in rows[0]["seconds"] for x in (what, "Pinocchio", "ratio"))]
    cells = []
    for r in rows:
        pairs = ((ours, r["theirs"][what]) for what, ours in r["seconds"].items())
        times = (x for ours, theirs in pairs for x in (seconds(ours), seconds(theirs), f"{ours / theirs:.2f}"))
        cells.append([r["model"], str(r["speeds"]), error(r["error"]), *times])
    return head, cells


def robot_lines(result: dict[str, Any], width: int | None) -> list[str]:
    lines = [f"  {name}: not measured, {why}" for name, why in result["skipped"].items()]
    if result["rows"]:
        lines += table(*robot_table(result["rows"]), width)
    if result["failed"]:
        lines.append(f"  failed: difference above {result['within']:.0e} of {', '.join(result['failed'])}")
    return lines


LINES: dict[str, Callable[[dict[str, Any], int | None], list[str]]] = {
    "motion": motion_lines, "family": family_lines, "robots": robot_lines,
}  # fmt: skip


def peer_lines(peers: dict[str, Any], width: int | None) -> list[str]:
    """Lines with the results of other programs on the same problems in the same run."""
    lines = [f"{who}: not compared, {why}" for who, why in peers["skipped"].items()]
    for name, rows in peers["problems"].items():
        lines.append(f"{name}: ordernm and other programs, taking turns")
        lines += table(*peer_table(rows), width)
    return lines


def peer_table(rows: Sequence[dict[str, Any]]) -> Rows:
    """Header and rows of a table: the results of all programs on one problem."""
    return ("", "setting", "error", "of derivatives", "time"), [
        [r["who"], r["setting"], error(r["error"]), error(r["error_derivatives"]), seconds(r["seconds"])] for r in rows
    ]


def compare_lines(new: dict[str, Any], old: dict[str, Any], width: int | None) -> list[str]:
    """Lines that compare two runs."""
    differing = other_machine(new, old)
    rows = compare(new, old)
    lines = [f"warning: another machine: {x}" for x in differing]
    if not rows:
        return [*lines, "the two runs have no results in common"]
    return [*lines, *table(COMPARED, rows, width)]


def failures(problems: dict[str, Any]) -> list[str]:
    """Lines that list the failed checks of each problem."""
    return [f"{name}: {', '.join(map(str, r['failed']))}" for name, r in problems.items() if r["failed"]]


def list_lines(problems: Sequence[Any]) -> list[str]:
    """Lines with the names and titles of problems."""
    longest = max(len(p.name) for p in problems)
    return [f"{p.name.ljust(longest)}  {p.title}" for p in problems]
