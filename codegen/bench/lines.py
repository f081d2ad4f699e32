"""Results of the benchmark as lines for a terminal."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from ..measure.clock import exponent
from ..measure.operations import plain
from ..measure.tables import error, seconds
from ..summary import table
from .results import COMPARED, compare, other_machine


def machine_line(machine: dict[str, str]) -> str:
    return (
        f"{machine['processor']}, {machine['instructions']}; {machine['compiler']}, {machine['flags']}; "
        f"ordernm {machine['ordernm']}, Python {machine['python']}"
    )


def problem_lines(name: str, result: dict[str, Any], width: int | None) -> list[str]:
    """A problem's title, its table and what was asked of it."""
    body = LINES[result["kind"]](result, width)
    return [f"{name}: {result['title']}", f"  reference: {result['source']}", *body]


def motion_lines(result: dict[str, Any], width: int | None) -> list[str]:
    each = plain(result["operations"])
    lines = table(POINT_HEAD, [point_row(p) for p in result["points"]], width)
    lines.append(
        f"  {each} additions and multiplications an evaluation of udot; generated in {result['generation_seconds']:.1f} s"
    )
    for goal in result.get("goals", ()):
        lines.append(f"  {goal_line(goal)}")
    if "derivatives" in result:
        d = result["derivatives"]
        lines.append(
            f"  derivatives by {', '.join(d['by'])} with {d['setting']}: relative error {d['error']:.1e}, {seconds(d['seconds'])}"
        )
    if result["failed"] and "within" in result:
        lines.append(f"  failed: error above {result['within']:.0e} with {', '.join(result['failed'])}")
    return lines


POINT_HEAD = ("method, tolerance", "error", "evaluations", "steps", "rejected", "in C", "")


def setting(p: dict[str, Any]) -> str:
    """Method and tolerance of a point."""
    return f"{p['method']} {p['rtol']:.2g}" + ("" if p["atol"] == p["rtol"] else f", atol {p['atol']:.2g}")


def error_of(p: dict[str, Any]) -> str:
    """The error of a point; of a motion that ended before its end, that it did."""
    # what a motion says of its end is long; the place is before the first colon
    return error(p["error"]) if p["ended"] == "finished" else f"ended early: {p['ended'].partition(':')[0]}"


def point_row(p: dict[str, Any]) -> list[str]:
    ended = "" if p["ended"] == "finished" else error_of(p)[:72]
    return [
        setting(p),
        error(p["error"]),
        str(p["evaluations"]),
        str(p["steps"]),
        str(p["rejected"]),
        seconds(p["seconds"]),
        ended,
    ]


def goal_line(goal: dict[str, Any]) -> str:
    """An aim, and what reached it."""
    p = goal["reached"]
    if p is None:
        return f"error {goal['goal']}: missed at every tolerance"
    how = f"{error(p['error'])}, {p['evaluations']} evaluations, {seconds(p['seconds'])} with {setting(p)}"
    return f"error {goal['goal']}: {'reached' if goal['met'] else 'missed'}, {how}"


def family_lines(result: dict[str, Any], width: int | None) -> list[str]:
    rows = result["sizes"]
    functions = list(rows[0]["seconds"])
    head = [result["unit"], "coordinates", "relative error", "operations each", "one more direction",
            *(f"{f}, each" for f in functions), *functions]  # fmt: skip
    cells = [
        [str(r["size"]), str(r["bodies"]), error(r["error"]), f"{plain(r['operations']) / r['bodies']:.0f}",
         f"{plain(r['operations_direction']) / r['bodies']:.0f}",
         *(seconds(r["seconds"][f] / r["bodies"]) for f in functions), *(seconds(r["seconds"][f]) for f in functions)]
        for r in rows
    ]  # fmt: skip
    lines = table(head, cells, width)
    if len(rows) > 2:
        sizes = [r["size"] for r in rows]
        slopes = (f"{f} {exponent(sizes, [r['seconds'][f] for r in rows]):.2f}" for f in functions)
        lines.append(f"  exponent of time: {', '.join(slopes)}")
    if result["failed"]:
        lines.append(f"  failed: error above {result['within']:.0e} with {', '.join(result['failed'])}")
    return lines


def robot_head(rows: Sequence[dict[str, Any]]) -> list[str]:
    """What stands above `robot_row`."""
    return ["", "speeds", "difference", *(x for what in rows[0]["seconds"] for x in (what, "Pinocchio", "ratio"))]


def robot_row(row: dict[str, Any]) -> list[str]:
    """A robot: ours, theirs and their ratio by function."""
    found = [row["model"], str(row["speeds"]), error(row["error"])]
    for what, ours in row["seconds"].items():
        theirs = row["theirs"][what]
        found += [seconds(ours), seconds(theirs), f"{ours / theirs:.2f}"]
    return found


def robot_lines(result: dict[str, Any], width: int | None) -> list[str]:
    lines = [f"  {name}: not measured, {why}" for name, why in result["skipped"].items()]
    if result["rows"]:
        lines += table(robot_head(result["rows"]), [robot_row(r) for r in result["rows"]], width)
    if result["failed"]:
        lines.append(f"  failed: difference above {result['within']:.0e} of {', '.join(result['failed'])}")
    return lines


LINES: dict[str, Callable[[dict[str, Any], int | None], list[str]]] = {
    "motion": motion_lines, "family": family_lines, "robots": robot_lines,
}  # fmt: skip


def peer_lines(peers: dict[str, Any], width: int | None) -> list[str]:
    """Other programs on the same problems, the same run."""
    lines = [f"{who}: not compared, {why}" for who, why in peers["skipped"].items()]
    for name, rows in peers["problems"].items():
        lines.append(f"{name}, others beside it, taking turns")
        lines += table(PEER_HEAD, [peer_row(r) for r in rows], width)
    return lines


PEER_HEAD = ("", "setting", "error", "of derivatives", "time")


def peer_row(row: dict[str, Any]) -> list[str]:
    return [row["who"], row["setting"], error(row["error"]), error(row["error_derivatives"]), seconds(row["seconds"])]


def compare_lines(new: dict[str, Any], old: dict[str, Any], width: int | None) -> list[str]:
    """Two runs beside each other."""
    differing = other_machine(new, old)
    rows = compare(new, old)
    lines = [f"warning: another machine: {x}" for x in differing]
    if not rows:
        return [*lines, "the two runs have no figure in common"]
    return [*lines, *table(COMPARED, rows, width)]


def failures(problems: dict[str, Any]) -> list[str]:
    """What is not as it should be, by problem."""
    return [f"{name}: {', '.join(map(str, r['failed']))}" for name, r in problems.items() if r["failed"]]


def list_lines(problems: Sequence[Any]) -> list[str]:
    """Names and titles."""
    longest = max(len(p.name) for p in problems)
    return [f"{p.name.ljust(longest)}  {p.title}" for p in problems]
