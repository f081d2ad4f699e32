"""The page "How accurate, how fast" of the manual, from results of the benchmark."""

from __future__ import annotations

from typing import Any

from ..measure.operations import plain
from ..measure.tables import error, markdown
from ..runtime.standalone.files.whole_file import MARK
from .lines import family_table, growth, peer_table, point_table, robot_table
from .problem import JOINT, SPEED, setting_of

TITLE = "How accurate, how fast"


def _prose(text: str) -> str:
    """A paragraph in one line."""
    return " ".join(text.split())


ORIGIN = _prose("""
Written by `ordernm bench --page`; do not edit. `ordernm bench` measures all of it anew, `ordernm bench --compare OLD.json` puts
two runs beside each other.
""")
MACHINE = _prose("""
**Machine.** One core of: {processor}, {instructions}; {compiler}, `{flags}`; {system}, Python {python}, NumPy {numpy}, ordernm
{ordernm}. Others may have used the machine meanwhile: times are the least of several turns.
""")
QUICK = "These are figures of `--quick`, a cheap part of each problem."
MOTIONS = _prose("""
Errors are absolute, the largest of the quantities named, at the end. Evaluations are those of the accelerations; times are the
integrator's in C, with the closing of loops. Tolerances are rtol = atol where atol is not named.
""")
EXACT = _prose("""
Derivatives of the motion's end against the exact ones, the largest relative error of those by each parameter; the evaluations are
with all derivatives:
""")
DIGITS = _prose("""
Relative error of the accelerations and of each derivative: the largest difference over the largest entry, against {source}. Total
length and mass are 1; speeds are 0.2 cos k. The mass matrix of the coiled chain has the condition 4e4, 4e8 and 3.9e12 with 10,
100 and 1000 rods. The accelerations do not follow it: no mass matrix is factored. Nor do the derivatives, those that are
small beside the accelerations among them, as that by the middle joint of a coil. "Any one joint", "any one speed": the worst of
the derivatives by each joint's angle, by each joint's speed; with 1000 rods by twenty of them, from the first to the last.
""")
FAMILIES = _prose("""
Operations are additions and multiplications, for each coordinate; times are those of one evaluation called from C, one core.
Errors are relative, the worst of the accelerations and all directions that were compared.
""")
ROBOTS = _prose("""
Times of one call from Python, one core, ours and Pinocchio's as it is installed, in turns: accelerations, their derivatives by
coordinates, speeds and a force along every freedom, mass matrix and its inverse; of a batch of 1024 states, the time a state (for
Pinocchio calls one after the other). Difference: the largest of all of these, over the largest entry. Reference: {source}. In C,
with Pinocchio compiled for the machine, they are in [benchmarks.md](benchmarks.md).
""")
PEERS = _prose("""
The same models and the same end, in the same run, taking turns, each at the best build and method that was found for it. Times
are CPU time from Python, ours too. Where ours has derivatives by a parameter, its time is with them, under error control; beside
it only CasADi's has derivatives.
""")


def page_of(results: dict[str, Any]) -> str:
    """The page, Markdown."""
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
        parts += ["What was asked, and the cheapest setting that gives it:",
                  markdown(("problem", "error asked for", "", "error", "evaluations", "ms", "setting"), aims)]  # fmt: skip
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
            f"`{name}`: {', '.join(r['quantities'])} at {r['end']:g} s. Reference: {r['source']}. An evaluation has "
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
    """Whether its directions are single ones with names."""
    return row["errors"] is not None and "direction 1" not in row["errors"]


def _worst_of_each_kind(errors: dict[str, float]) -> dict[str, float]:
    """Errors by direction, those of single joints put together."""
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
        grows = f" Time grows with the size to the power: {slopes}." if (slopes := growth(r)) else ""
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
