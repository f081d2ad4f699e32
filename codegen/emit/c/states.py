"""Writes ``NAME_states.c``: functions over a batch with several states at once, in the lanes of vectors, and
``NAME_threads.c``, which shares such a batch among threads.

The first includes ``NAME.c`` with vectors in place of doubles, so every statement is the same as for one state. This
takes only a few macros, which ``module.c.jinja`` defines for one state and ``states.c.jinja`` for several.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable
from typing import Any

from ...elementary import named
from ...program.procedure import WIDTHS, Check, Procedure, Step
from ...records import dataclass
from ..function import Function, called_with
from ..target import Scalar
from ..templates import render
from . import library_function
from .functions import CFunctions, Lines, batch_arrays, batch_members, parameters
from .libraries import guard
from .vectors import most_lanes, short, short_rows

OVER_STATES = ("accelerations", "sensitivities", "sensitivities_transposed")
"""Functions that exist for several states at once."""

DIRECTIONS = max(WIDTHS)
"""Number of directions in each pass of a sweep. Lanes of vectors contain states here, so each statement processes the
directions one after the other."""

OF_TWO = (*named("c", lambda e: e.arity == 2), "pow")
"""Functions of the C library that have two arguments."""


def over_states(procedures: Iterable[Procedure]) -> list[Procedure]:
    """Functions of the solver that have a variant over several states."""
    return [p for p in procedures if p.name in OVER_STATES]


def directions_at_once(procedure: Procedure) -> int:
    """Number of directions that a pass of a function processes.

    Gradients are mostly computed for one vector of weights. With memory for eight vectors, only an eighth of each cache line
    would be used.
    """
    return min(WIDTHS) if procedure.name.endswith("_transposed") else DIRECTIONS


def guards(procedures: Iterable[Procedure]) -> dict[str, str]:
    """The condition for the compilation of each function; empty if they are all in one library."""
    found = {p.name: guard(p.name) for p in procedures}
    return found if len({*found.values()}) > 1 else dict.fromkeys(found, "")


def widths_of_states(procedures: list[Procedure]) -> dict[int, str]:
    """The numbers of directions for which sweeps are compiled, with their conditions."""
    found: dict[int, dict[str, None]] = {}
    of = guards(procedures)
    for p in procedures:
        if p.seeds:
            found.setdefault(directions_at_once(p), {})[of[p.name]] = None
    return {width: " || ".join(conditions) for width, conditions in found.items()}


class StateLines(Lines):
    """Writes the lines of one function over several states: first those for values, then separately those over directions."""

    takes_modes = False

    def of(self, step: Step) -> list[str]:
        if isinstance(step, Check):
            base = self.base(step.lanes)
            return [f"if (STOPPED(&{base[0]})) return {self.found()};"]
        return super().of(step)

    def open(self) -> list[str]:
        return [*super().open(), "d.directions = directions;"]

    def found(self) -> str:
        """The return value for each state: 0, or the number of the first singular link, loop or element."""
        return "FIRST(c.singular, d.singular)" if self.opened else "c.singular"

    def parts(self) -> tuple[list[str], list[str]]:
        """Lines of the two functions. The first saves the struct of its call, with which the second begins."""
        before, after = self.body()
        along = self.opened
        before = [*self.head(along, False), *before, *(["*values = c;"] if along else []), "return c.singular;"]
        if not along:
            return before, []
        each = next((i for i, line in enumerate(after) if "EACH_VECTOR" in line), None)
        if each is not None:
            after.insert(each, "DIRECTIONS(call) *const a = &d;")
        return before, ["call c = *values;", "DIRECTIONS(call) d;", *after, f"return {self.found()};"]


def part(p: Procedure, name: str, lines: list[str], real: str, saved: str) -> tuple[Function, str]:
    """One of the two functions of `StateLines.parts`, with the parameters that its lines read, and its call."""
    text = "\n".join(lines)
    given = [saved, *parameters(p, real), "int directions"]
    names = ((x, x.rpartition(" ")[2].lstrip("*")) for x in given if x)
    read = [(x, n) for x, n in names if re.search(rf"(?<![.>])\b{n}\b", text)]
    passed = {a.name: f"*{a.name}" for a in (*p.arguments, *p.results) if not a.shape and not a.lanes}
    passed |= {"values": "&values", "directions": "m"}
    call = f"{p.name}_{name}({', '.join(passed.get(n, n) for _, n in read)})"
    return Function(p.doc, called_with(f"static status {p.name}_{name}(", [x for x, _ in read]), lines), call


@dataclass(frozen=True, slots=True)
class StateArray:
    """An array of a function: its name, number of entries, and offset in the workspace, counted in vectors.

    `seen`: the C expression of the caller's array, for reading.
    """

    name: str
    size: int
    at: int
    seen: str


def one_function(lines: CFunctions, p: Procedure, written: Collection[str], guard: str) -> tuple[dict[str, Any], int]:
    """The template data of one function, and the size of the workspace for its arrays, in vectors.

    `written`: names of arrays that some function over states writes.
    """
    at, width = 0, directions_at_once(p)
    placed: dict[str, list[StateArray]] = {}
    for role, arrays in (("arguments", p.arguments), ("seeds", p.seeds), ("results", p.results)):
        placed[role] = []
        for a in arrays:
            seen = f"&seen_{a.name}" if a.name in written else f"&b->{a.name}"
            placed[role].append(StateArray(a.name, a.size, at, seen))
            at += a.size * (width if a.lanes else 1)
    of_values, along = StateLines(lines, p, False).parts()
    values, call = part(p, "values", of_values, lines.scalar.word, "call *values" if along else "")
    of_along = [part(p, "along", along, lines.scalar.word, "const call *values")] if along else []
    return {
        "name": p.name, "seeds": placed["seeds"], "arguments": placed["arguments"],
        "found": [a for a, r in zip(placed["results"], p.results, strict=True) if not r.lanes],
        "derived": [a for a, r in zip(placed["results"], p.results, strict=True) if r.lanes],
        "inner": [values, *(f for f, _ in of_along)],
        "width": ["#undef WIDTH", f"#define WIDTH {width}"] if along else [],
        "begin": [f"#if {guard}"] if guard else [],
        "end": ["#endif"] if guard else [],
        "directions": width,
        "room": [
            "states *const room = (states *)(((uintptr_t)b->work + 63) & ~(uintptr_t)63);",
            *(f"states *const {a.name} = room + {a.at};" for of in placed.values() for a in of),
            f"states *const work = room + {at};",
            *(
                f"const {lines.model}_seen seen_{n} = {{b->{n}.at, b->{n}.state, b->{n}.direction, b->{n}.entry}};"
                for n in (a.name for a in (*p.arguments, *p.seeds) if a.name in written)
            ),
            "states sum = (states){0};",
            *(["call values;"] if along else []),
            "b->failed = -1;",
            "b->code = 0;",
        ],
        "inside": "    " if p.seeds else "",
        "call": f"{'' if along else 'const '}status found = {call};",
        "turns": [
            f"for (long k = 0; !k || k < b->directions; k += {width}) {{",
            f"    const int m = b->directions - k < {width} ? (int)(b->directions - k) : {width};",
        ] if p.seeds else [],
        "further": [f"if (!all_singular(found)) found = {c};" for _, c in of_along],
        "turned": ["}"] if p.seeds else [],
    }, at  # fmt: skip


def states_context(
    lines: CFunctions, procedures: list[Procedure], workspace: int, scalar: Scalar, library: list[str]
) -> dict[str, Any]:
    """The data of ``NAME_states.c`` and its part of the header; empty if no function has a variant over states."""
    of, (_, written) = guards(procedures), batch_arrays(procedures)
    found = [one_function(lines, p, written, of[p.name]) for p in procedures]
    few = short(scalar, (a.size for p in procedures for a in (*p.arguments, *p.seeds, *p.results)))
    return {
        "functions_over_states": [f for f, _ in found],
        "along_states": ["c/states_along.c.jinja"] if any(p.seeds for p in procedures) else [],
        "short": few,
        "short_rows": short_rows(scalar, few),
        "states_workspace": most_lanes(scalar) * (max([room for _, room in found], default=0) + workspace + 1),
        "state_structs": [batch_members(procedures, "seen", "filled")] if procedures else [],
        "of_one": [library_function(f, scalar) for f in library if f not in OF_TWO],
        "of_two": [library_function(f, scalar) for f in library if f in OF_TWO],
    }


def write_states(context: dict[str, Any]) -> str:
    """The C text of ``NAME_states.c``."""
    return render("c/states.c.jinja", context)


def write_threads(context: dict[str, Any], arrays: Iterable[str]) -> str:
    """The C text of ``NAME_threads.c``, which includes ``on_threads.h`` of the run time; `arrays` are the arrays of the
    struct of a batch."""
    each = [f"DO({array})" for array in arrays]
    rows = [" ".join(each[i : i + 8]) for i in range(0, len(each), 8)]
    return render("c/threads.c.jinja", {**context, "arrays": rows})


__all__ = ["OVER_STATES", "over_states", "states_context", "widths_of_states", "write_states", "write_threads"]
