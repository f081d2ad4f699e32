"""The data from which the templates in ``templates/c`` produce the files of a solver in C."""

from __future__ import annotations

import re
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

from ...program.procedure import ANGLES, Columns, Primitives, Procedure, within
from ...program.store import MODES
from ..function import Function, in_lines
from ..runs import widest_first
from ..templates import render
from . import functions as c_functions
from . import sines, vectors
from .call_memory import Memory, call_memory, lays_out
from .columns import GROUP
from .functions import CFunctions
from .legend import about_names, legend
from .libraries import LIBRARIES, number_of
from .prepared import CPrepared
from .states import over_states, states_context, widths_of_states
from .types import ENERGIES, NUMBER_TYPE, TYPES, UNUSED_WORK, cast
from .vectors import words

_MEMBER = re.compile(r"\ba->(\w+)")


class CWriter(CPrepared):
    """Writes the C source of a program."""

    def context(self) -> dict[str, Any]:
        """The variables with which the templates are rendered."""
        model = self.model
        context = self.shared_context()
        found = context["interfaces"]
        memory = call_memory(found)
        switching = model.switches.have_modes
        if switching:  # functions that are never called with modes read a null pointer
            memory.fields.setdefault(MODES.name, False)
        of_memory, in_workspace = self._memory(memory)
        lines = CFunctions(model.name, self.scalar, memory, self.prepared, lambda p: self.laid_out(p, in_workspace))
        of_columns = self.columns.width
        used = sorted({w for widths in self.sets_of_widths for w in widths}, key=lambda w: (w != of_columns, w))
        apart = sorted({w for f in found for w in f.apart})
        states = over_states(found)
        return context | of_memory | self._functions(context | of_memory, lines, used) | {
            **words(self.scalar),
            "sines": sines.words(self.scalar),
            "column_lanes": vectors.columns(self.scalar, of_columns, GROUP),
            "NAME": model.name.upper(),
            "about_names": about_names(bool(model.loops)),
            "legend": legend(model, len(self.plan.links), self.scalar.words, self.singular_outputs, found),
            "headers": ["string.h"] if self.columns.symmetric else [],
            "column_types": ["c/column_types.c.jinja"] if of_columns else [],
            "part_files": ["c/parts.c.jinja"] if self.has_parts else [],
            "sine_files": self.sines(),
            "inclusions": self.inclusions(used, apart, states),
            "ends": ["#endif"] if apart or states else [],
            "of_one_state": " && !defined(ORDERNM_STATES)" if states else "",
            "before_one_state": ["#ifndef ORDERNM_STATES"] if states else [],
            "after_one_state": ["#endif"] if states else [],
            "sweep_files": [
                *(["c/aligned.c.jinja"] if used or any(_reads_work(lines.laid_out(p)) for p in found) else []),
                *(["c/lay_out.c.jinja"] if any(map(lays_out, found)) else []),
            ],
            "matrix_files": [
                *(["c/component.c.jinja"] if any(map(fills_lanes, found)) else []),
                *(["c/columns.c.jinja"] if of_columns else []),
            ],
            "mode_words": ["c/modes.c.jinja"] if switching else [],
            "called": (library := self.printer.library()),
            "first_library": number_of(LIBRARIES[0]),
            **states_context(lines, states, self.workspace, self.scalar, library),
            "own_words": [f"c/{w}.c.jinja" for w in self.printer.words],
            "own_words_of_states": [f"c/{w}_of_states.c.jinja" for w in self.printer.words],
            "along_words": ["c/along.c.jinja"] if "Along" in self.printer.own else [],
            "along_widths": sorted({8, 2, *([of_columns] if of_columns else [])} - {1, 4}),
        }  # fmt: skip

    def _memory(self, memory: Memory) -> tuple[dict[str, Any], dict[str, int]]:
        """Description of memory, and offsets of the regions of values in the workspace."""
        layout = self.layout
        _ = self.swept
        of_sweeps = self.regions()
        own = [("own", False, memory.size)] if memory.size else []
        # the arrays of the call come before the lanes; after the lanes, some functions were a tenth slower
        regions = [*(r for r in of_sweeps if not r[1]), *own, *(r for r in of_sweeps if r[1])]
        values: dict[str, int] = {}
        lanes: dict[str, int] = {}
        at = 0
        for name, along, count in regions:
            (lanes if along else values)[name] = at
            at += -(-count * (8 if along else 1) // 8) * 8
        self.workspace = at + self.scalar.per_line
        columns = {r[0] for r in self.column_regions()}
        self.memory_of_sweeps = sum(n * (8 if along else 1) for name, along, n in of_sweeps if name not in columns)
        types = {n: self._type(n, False) for n in values}, {n: self._type(n, True) for n in lanes}
        fields, lane_fields = memory.declarations(*types, self.scalar.word)
        return {
            "sizes_in_c": [
                ("LINKS", len(self.plan.links)),
                *([("NEAR_SIZE", layout.near_size)] if layout.near_size else []),
                *((("ANGLES", layout.angles_padded), ("COSINE", 0), ("SINE", "ANGLES")) if layout.angles_padded else ()),
                *((name, i) for i, name in enumerate(ENERGIES) if "energy" in memory.fields),
            ],
            "near_names": self.near_names(), "types": self.types(False), "lane_types": self.types(True),
            "workspace": self.workspace,
            "fields": fields, "lane_fields": [*lane_fields, *self.columns.members()], "columns": self.columns,
            "value_places": [(n, f"{cast(n)}(work + {at})" if n in TYPES else f"work + {at}") for n, at in values.items()],
            "lane_places": [(n, f"({types[1][n]} *)(work + {at})") for n, at in lanes.items()],
            "tables": [*self.flat_tables(), *((head, [f"{{{row}}}," for row in rows]) for head, rows in self.tables)],
        }, values  # fmt: skip

    def _functions(self, context: Mapping[str, Any], lines: CFunctions, used: list[int]) -> dict[str, Any]:
        """Routines, the functions of the header, and their loops over batches."""
        found = context["interfaces"]
        public = [f for f in found if not f.internal]
        of_width = [(f, w) for f in public for w in (f.widths or (None,))]
        of_lanes: dict[str, list[tuple[list[str], list[str], list[Function]]]] = {
            "lane_functions": [
                (*guard(widths, used), functions) for widths, functions in context["lane_functions"] if functions
            ],
            "lane_routines": [
                (*guard(widths, used), functions)
                for widths, of in context["lane_routines"]
                if (functions := self.where_run((r.name, [lines.routine(r)]) for r in of))
            ],
        }
        read = {"masks"} | ({"own"} if any(a.lanes for a in lines.memory.own) else set())
        for *_, functions in (x for group in of_lanes.values() for x in group):
            read |= {name for f in functions for line in f.lines for name in _MEMBER.findall(line)}
        copied = [(type_, name) for type_, name in context["fields"] if name in read]
        lines.copied = {name for _, name in copied} - {name for name, _ in context["value_places"]}
        return of_lanes | {
            "copied": copied,
            "routines": self.where_run((r.name, [lines.routine(r)]) for r in context["routines"]),
            "lane_interfaces": [
                (*guard(widths, used), functions)
                for widths in self.sets_of_widths
                if (functions := [of for f in found if widest_first(f) == widths for of in lines.functions(f)])
            ],
            "header_functions": [of for f in found if not f.seeds for of in lines.functions(f)],
            "prototypes": [
                (Function(f.doc, "").head, c_functions.signatures(f, lines.model, self.scalar.word)) for f in found
            ],
            "batch_arrays": c_functions.batch_members(public, "given", "rows"),
            "batches": c_functions.batch_lines(of_width),
            "batch_signatures": [c_functions.batch_signature(f, lines.model, w) for f, w in of_width],
        }

    def inclusions(self, used: list[int], apart: list[int], states: list[Procedure]) -> list[str]:
        """Lines that include the functions over directions, if the including file requests them."""
        name, lines = self.model.name, []
        if states:
            lines += [
                "#if defined(ORDERNM_STATES)",
                *inclusions(name, [*(of := widths_of_states(states))], {w: guard for w, guard in of.items() if guard}),
            ]
        if apart:
            lines += [f"#{'el' if lines else ''}if defined(ORDERNM_APART)", *inclusions(name, apart)]
        lines += ["#else"] if lines else []
        guards = {self.columns.width: self.columns.guard}
        return [*lines, *inclusions(name, [w for w in used if w not in apart], guards)]

    def flat_tables(self) -> list[tuple[str, list[str]]]:
        """Declarations and lines of tables that are plain lists: numbers, offsets of angles and, unless the angles are the
        first coordinates, indices of angles."""
        numbers, angles = [self.text(v) for v in self.layout.numbers], self.layout.angles
        found = (
            [(f"static const {NUMBER_TYPE} numbers[{len(numbers)}]", in_lines(numbers, 6))]
            if self.reads_numbers
            else []
        )
        listed = self.prepares(ANGLES) and not self.few_angles
        if listed and angles != list(range(len(angles))):
            found.append((f"static const int angle_of[{len(angles)}]", in_lines(list(map(str, angles)), 16)))
        if listed and (driven := self.layout.driven_angles):
            found.append((f"static const int driven_angle_of[{len(driven)}]", in_lines(list(map(str, driven)), 16)))
        if listed and any(added := self.layout.added_angles):
            found.append(
                (f"static const {NUMBER_TYPE} added_angle[{len(added)}]", in_lines(list(map(self.text, added)), 6))
            )
        return found + self.columns.tables()


def _reads_work(lines: list[str]) -> bool:
    """Whether the lines that assign memory to a call have any effect."""
    return bool(lines) and lines != UNUSED_WORK


def fills_lanes(procedure: Procedure) -> bool:
    """Whether a function computes several columns of a matrix at once."""
    steps = within(procedure.steps)
    return any((isinstance(s, Columns) and s.unit.lanes) or isinstance(s, Primitives) for s in steps)


def guard(widths: tuple[int, ...], used: list[int]) -> tuple[list[str], list[str]]:
    """Preprocessor lines before and after code that only some widths need."""
    if sorted(widths) == sorted(used):
        return [], []
    return [f"#if {' || '.join(f'WIDTH == {w}' for w in widths)}"], ["#endif"]


def inclusions(name: str, used: list[int], guards: Mapping[int, str] = MappingProxyType({})) -> list[str]:
    """Lines that include the functions over directions once for every width. ``WIDTH`` stays defined as the last width.

    Some widths are in libraries of their own, by the conditions of `guards`.
    """
    lines = []
    for w in used:
        lines += ["#undef WIDTH"] if w != used[0] else []
        include = f'#include "{name}_directions.h"'
        lines += [f"#define WIDTH {w}", *([f"#if {guards[w]}", include, "#endif"] if w in guards else [include])]
    return lines


def write_c(context: dict[str, Any]) -> dict[str, str]:
    """The C files of a solver by name, except those that are compiled separately."""
    name = context["name"]
    files = {f"{name}.c": "c/module.c.jinja", f"{name}.h": "c/module.h.jinja"}
    if any(line.startswith("#include") for line in context["inclusions"]):
        files[f"{name}_directions.h"] = "c/directions.h.jinja"
    return {file: render(template, context) for file, template in files.items()}


__all__ = ["CWriter", "write_c"]
