"""Writes ``NAME_states.c``: functions over a batch with several states at once, in the lanes of vectors, and
``NAME_threads.c``, which shares such a batch among threads.

The first includes ``NAME.c`` with vectors in place of doubles, so every statement is the same as for one state. It needs only a
few macros, which ``module.c.jinja`` defines for one state and ``states.c.jinja`` for several.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from ...elementary import named
from ...program.procedure import Check, Procedure, Step
from ...records import dataclass
from ..function import Function, called_with
from ..target import Scalar
from ..templates import render
from . import library_function
from .functions import CFunctions, Lines, batch_members, parameters
from .vectors import most_lanes, short, short_rows

OVER_STATES = ("accelerations", "sensitivities")
"""Functions that exist for several states at once."""

DIRECTIONS = 8
"""Number of directions that a sweep processes in each pass, where each statement takes one direction after the
other."""

OF_TWO = (*named("c", lambda e: e.arity == 2), "pow")
"""Functions of the C library that have two arguments."""


def over_states(procedures: Iterable[Procedure]) -> list[Procedure]:
    """Functions of the solver that have a variant over several states."""
    return [p for p in procedures if p.name in OVER_STATES]


class StateLines(Lines):
    """Writer of the lines of one function over several states."""

    def of(self, step: Step) -> list[str]:
        if isinstance(step, Check):
            base = self.base(step.lanes)
            return [f"if (STOPPED(&{base[0]})) return {self.found()};"]
        return super().of(step)

    def open(self) -> list[str]:
        return [*super().open(), "d.directions = directions;"]

    def function(self) -> list[str]:
        lines = super().function()
        each = next((i for i, line in enumerate(lines) if "EACH_VECTOR" in line), None)
        if each is not None:
            lines.insert(each, "DIRECTIONS(call) *const a = &d;")
        return lines

    def found(self) -> str:
        """The return value for each state: 0, or the number of the first singular link, loop or element."""
        return "FIRST(c.singular, d.singular)" if self.opened else "c.singular"

    def end(self) -> list[str]:
        return [f"return {self.found()};"]


@dataclass(frozen=True, slots=True)
class StateArray:
    """An array of a function: its name, number of entries, and offset in the workspace, counted in vectors."""

    name: str
    size: int
    at: int


def states_context(
    lines: CFunctions, procedures: list[Procedure], workspace: int, scalar: Scalar, library: list[str]
) -> dict[str, Any]:
    """The data of ``NAME_states.c`` and its part of the header; empty if no function has a variant over states."""
    found = []
    room = 0
    for p in procedures:
        at = 0
        placed: dict[str, list[StateArray]] = {}
        for role, arrays in (("arguments", p.arguments), ("seeds", p.seeds), ("results", p.results)):
            placed[role] = []
            for a in arrays:
                placed[role].append(StateArray(a.name, a.size, at))
                at += a.size * (DIRECTIONS if a.lanes else 1)
        room = max(room, at)
        passed = [f"*{a.name}" if not a.shape and not a.lanes else a.name for a in (*p.arguments, *p.seeds, *p.results)]
        found.append(
            {
                "name": p.name, "doc": p.doc, "seeds": placed["seeds"], "arguments": placed["arguments"],
                "found": [a for a, r in zip(placed["results"], p.results, strict=True) if not r.lanes],
                "derived": [a for a, r in zip(placed["results"], p.results, strict=True) if r.lanes],
                "inner": Function(
                    p.doc,
                    called_with(
                        f"static status {p.name}_of_states(",
                        [*parameters(p, scalar.word), *(["int directions"] if p.seeds else [])],
                    ),
                    StateLines(lines, p, False).function(),
                ),
                "call": f"{p.name}_of_states({', '.join([*passed, 'work', *(['m'] if p.seeds else [])])})",
                "room": [
                    "states *const room = (states *)(((uintptr_t)b->work + 63) & ~(uintptr_t)63);",
                    *(f"states *const {a.name} = room + {a.at};" for of in placed.values() for a in of),
                    f"states *const work = room + {at};",
                    "states sum = (states){0};",
                    "b->failed = -1;",
                    "b->code = 0;",
                ],
                "inside": "    " if p.seeds else "",
                "turns": [
                    f"for (long k = 0; !k || k < b->directions; k += {DIRECTIONS}) {{",
                    f"    const int m = b->directions - k < {DIRECTIONS} ? (int)(b->directions - k) : {DIRECTIONS};",
                ] if p.seeds else [],
                "turned": ["}"] if p.seeds else [],
            }
        )  # fmt: skip
    few = short(scalar, (a.size for p in procedures for a in (*p.arguments, *p.seeds, *p.results)))
    return {
        "functions_over_states": found,
        "short": few,
        "short_rows": short_rows(scalar, few),
        "states_workspace": most_lanes(scalar) * (room + workspace) + most_lanes(scalar),
        "state_structs": [batch_members(procedures, "seen", "filled")] if procedures else [],
        "of_one": [library_function(f, scalar) for f in library if f not in OF_TWO],
        "of_two": [library_function(f, scalar) for f in library if f in OF_TWO],
        "directions": DIRECTIONS,
    }


def write_states(context: dict[str, Any]) -> str:
    """The C text of ``NAME_states.c``."""
    return render("c/states.c.jinja", context)


def write_threads(context: dict[str, Any], arrays: Iterable[str]) -> str:
    """The data that ``on_threads.h`` of the run time needs to run batches on threads; `arrays` are the arrays of the
    struct of a batch."""
    each = [f"DO({array})" for array in arrays]
    rows = [" ".join(each[i : i + 8]) for i in range(0, len(each), 8)]
    return render("c/threads.c.jinja", {**context, "arrays": rows})


__all__ = ["OVER_STATES", "over_states", "states_context", "write_states", "write_threads"]
