"""The page "How accurate, how fast" of the manual, from benchmark results."""

from __future__ import annotations

from typing import Any

from ..measure.operations import plain
from ..measure.tables import error, markdown
from ..runtime.standalone.files.whole_file import MARK
from .lines import family_table, growth, peer_table, point_table, robot_table
from .problem import JOINT, SPEED, setting_of

TITLE = "How accurate, how fast"


def _prose(text: str) -> str:
    """Join the lines of a paragraph into one."""
    return " ".join(text.split())


ORIGIN = _prose("""
`ordernm bench --page` writes this page; do not edit it. `ordernm bench` repeats all measurements, and `ordernm bench --compare
OLD.json` compares two runs.
""")
MACHINE = _prose("""
**Machine.** One core of: {processor}, {instructions}; {compiler}, `{flags}`; {system}, Python {python}, NumPy {numpy}, ordernm
{ordernm}. Other processes may have used the machine, so each time is the least of several turns.
""")
QUICK = "These are results of `--quick`, which measures only a cheap part of each problem."
MOTIONS = _prose("""
Each error is the largest absolute error of the listed quantities at the final time. Evaluations are those of the accelerations.
Times are those of the integrator in C, including the closure of loops. A single tolerance means rtol = atol.
""")
EXACT = _prose("""
Derivatives of the final state with respect to each parameter, compared with exact ones. The error is the largest relative
error. Evaluations include all derivatives:
""")
DIGITS = _prose("""
Relative error of the accelerations and of each derivative: the largest difference divided by the largest entry. Reference:
{source}. Total length and mass are 1; the speeds are 0.2 cos k. With 10, 100 and 1000 rods, the mass matrix of the straight
chain has the condition number 4.4e4, 4.0e8 and 3.9e12, that of the coiled chain 2.0e4, 1.1e6 and 1.1e8. The errors of the
accelerations do not grow with this number, because no mass matrix is factored. The same holds for the derivatives, even for
those that are much smaller than the accelerations. "Any one joint" and "any one speed" give the worst derivative with respect
to the angle or the speed of a single joint; with 1000 rods, twenty joints are tried.
""")
FAMILIES = _prose("""
Operations are additions and multiplications. Times are those of one evaluation, called from C, on one core. "Each" means per
coordinate. Each error is the largest relative error of the accelerations and of all compared directions.
""")
ROBOTS = _prose("""
Times of one call from Python on one core, where ordernm and Pinocchio as installed by pip take turns. The functions are:
accelerations; their derivatives with respect to coordinates, speeds and generalised forces; the mass matrix; its inverse. For a
batch of 1024 states, the time is per state; Pinocchio is called once per state. The difference is the largest one of all
results, divided by the largest entry. Reference: {source}. [benchmarks.md](benchmarks.md) has times in C, with Pinocchio
compiled for the machine.
""")
PEERS = _prose("""
All programs compute the same models up to the same time and take turns in one run. Each program uses the best build and method
found for it. Times are CPU times of calls from Python. Where a row of ordernm has derivatives, these are under error control,
and the time includes them. Of the other programs, only CasADi computes derivatives.
""")


def page_of(results: dict[str, Any]) -> str:
    """The page of the manual, in Markdown."""
    machine, problems = results["machine"], results["problems"]
    parts = [
        f"# {TITLE}",
        f"<!-- {MARK} -->",
        ORIGIN,
        MACHINE.format(**machine),
        *([QUICK] if results["quick"] else []),
    ]
    motions = {n: r for n, r in problems.items() if r["kind"] == "motion"}
    families = {n: r for n, r in problems.items() if r["kind"] == "family"}
    named = {n: r for n, r in families.items() if any(_named(row) for row in r["sizes"])}
    if motions:
        parts += ["## Motions", *_motions(motions)]
    if named:
        parts += ["## Digits of long chains", *_digits(named)]
    if families:
        parts += ["## Time and operations by size", *_families(families)]
    for r in problems.values():
        if r["kind"] == "robots" and r["rows"]:
            parts += [
                "## Robots beside Pinocchio",
                ROBOTS.format(source=r["source"]),
                markdown(*robot_table(r["rows"])),
            ]
    if "peers" in results:
        parts += ["## Other programs", *_peers(results["peers"])]
    return "\n\n".join(parts) + "\n"


def _motions(motions: dict[str, Any]) -> list[str]:
    parts = [MOTIONS]
    aims = [[f"`{n}`", *_aim(g)] for n, r in motions.items() for g in r.get("goals", ())]
    if aims:
        parts += ["Goals, and the cheapest setting that reaches each of them:",
                  markdown(("problem", "goal: error", "", "error", "evaluations", "ms", "setting"), aims)]  # fmt: skip
    exact = [
        [f"`{n}`", ", ".join(r["derivatives"]["by"]), r["derivatives"]["setting"], f"{r['derivatives']['error']:.1e}",
         str(r["derivatives"]["evaluations"]), f"{1e3 * r['derivatives']['seconds']:.2f}"]
        for n, r in motions.items() if "derivatives" in r
    ]  # fmt: skip
    if exact:
        parts += [EXACT, markdown(("problem", "by", "setting", "error", "evaluations", "ms"), exact)]  # fmt: skip
    for name, r in motions.items():
        parts += [
            f"### {r['title']}",
            f"`{name}`: {', '.join(r['quantities'])} at {r['end']:g} s. Reference: {r['source']}. An evaluation takes "
            f"{plain(r['operations'])} additions and multiplications.",
            markdown(*point_table(r)),
        ]
    return parts


def _aim(goal: dict[str, Any]) -> list[str]:
    p = goal["reached"]
    if p is None:
        return [goal["goal"], "**missed**", "", "", "", ""]
    verdict = "reached" if goal["met"] else "**missed**"
    return [goal["goal"], verdict, error(p["error"]), str(p["evaluations"]), f"{1e3 * p['seconds']:.2f}", setting_of(p)]


def _named(row: dict[str, Any]) -> bool:
    """Whether every direction has a name, so that it stands for a single quantity."""
    return row["errors"] is not None and "direction 1" not in row["errors"]


def _worst_of_each_kind(errors: dict[str, float]) -> dict[str, float]:
    """Errors by direction; of the directions of single joints, only the largest error of each kind."""
    kinds = {SPEED: "any one speed", JOINT: "any one joint"}
    found = {n: x for n, x in errors.items() if not n.startswith(tuple(kinds))}
    for start, words in reversed(kinds.items()):
        some = [x for n, x in errors.items() if n.startswith(start)]
        if some:
            found[words] = max(some)
    return found


def _digits(families: dict[str, Any]) -> list[str]:
    found = [
        (r["title"], str(row["size"]), _worst_of_each_kind(row["errors"]))
        for r in families.values()
        for row in r["sizes"]
        if _named(row)
    ]
    head = max((list(errors) for *_, errors in found), key=len)
    rows = [[*of, *(f"{errors[x]:.1e}" if x in errors else "" for x in head)] for *of, errors in found]
    labels = [head[0], *(f"by {x}" for x in head[1:])]
    source = next(iter(families.values()))["source"]
    return [DIGITS.format(source=source), markdown(("", "rods", *labels), rows)]


def _families(families: dict[str, Any]) -> list[str]:
    parts = [FAMILIES]
    for name, r in families.items():
        grows = f" Exponent of time against size: {slopes}." if (slopes := growth(r)) else ""
        parts += [
            f"### {r['title'][0].upper()}{r['title'][1:]}",
            f"`{name}`. Reference: {r['source']}.{grows}",
            markdown(*family_table(r)),
        ]
    return parts


def _peers(peers: dict[str, Any]) -> list[str]:
    parts = [PEERS]
    parts += [f"{who} was not compared: {why}." for who, why in peers["skipped"].items()]
    for name, rows in peers["problems"].items():
        parts += [f"### Beside `{name}`", markdown(*peer_table(rows))]
    return parts
