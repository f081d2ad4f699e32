"""Writes the C of a solver: functions of links, loops over links, tables.

Everything is prepared here as ready lines; the templates in ``templates/c`` put them in place and hold the functions
of the header.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property
from typing import Any

from sympy import Symbol

from ..mechanics import procedures
from ..mechanics.expansion import Program
from ..mechanics.formulas import FormulaKind
from ..mechanics.outputs.outputs import RecordFormula
from ..mechanics.stores import KEPT, LANE, MARGIN, SLOT
from ..mechanics.structure.kinds import UnitKind
from ..model.model import Model
from ..program.block import Block, symbols_of
from ..program.passes import by_results
from ..program.procedure import Own, Perform, Prepare, Procedure, Run
from ..program.store import Store
from . import c_functions
from .c_functions import CFunctions
from .function import Function, in_lines
from .printer import C_FUNCTIONS, Printer
from .templates import render
from .writer import Located, Place, RowPlace, Writer

SIZES = {
    "records": "RECORD", "near": "NEAR_SIZE", "slots": "SLOT_SIZE", "lanes": "LANE_SIZE", "ears": "EAR_SIZE",
    "regions": "REGION_SIZE", "region_lanes": "REGION_LANE_SIZE", "couplings": "COUPLING_SIZE", "kept": "KEPT_SIZE",
    "kept_regions": "KEPT_REGION_SIZE",
}  # fmt: skip
"""How long a row of each region of memory is."""


def stored_once(block: Block) -> set[Symbol]:
    """Symbols that what is stored for all directions together is made of."""
    if not any(store.lanes for store, _, _ in block.stores):
        return {*block.loads, *(s.target for s in block.statements)}
    wanted = {s for store, _, value in block.stores if not store.lanes for s in symbols_of(value)}
    for s in reversed(block.statements):
        if s.target in wanted:
            wanted |= symbols_of(s.expression)
    return wanted


class CWriter(Writer):
    """C source of a program; a place is (name of a pointer, its expression, index)."""

    def __init__(
        self,
        program: Program,
        formulas: list[FormulaKind],
        records: list[RecordFormula],
        asked: tuple[Procedure, ...],
    ):
        super().__init__(program, formulas, records, asked)
        self.printer = Printer(C_FUNCTIONS)
        self.tables: list[tuple[str, list[str]]] = []

    # -- the language ----------------------------------------------------------------------------------------------

    def lines(self, block: Block, place: Place, culprit: Callable[[str], str] | None = None) -> list[str]:
        stored = {place(store, n) for store, n, _ in block.stores if store.memory is not MARGIN}
        written = {pointer for pointer, _, _ in stored}
        pointers: dict[str, str] = {}
        body: list[str] = []

        def access(store: Store, name: str) -> str:
            pointer, expression, i = place(store, name)
            variable = pointer + "_at"
            if pointer not in pointers:
                type_ = "LANES" if store.lanes else "double"
                const = "" if pointer in written else "const "
                pointers[pointer] = f"{const}{type_} *restrict {variable} = {expression};"
            return f"{variable}[{i}]{'.at[h]' if store.lanes else ''}"

        # Before the loop over vectors stands what is stored once for all directions. Other numbers that they share stay in
        # the order of the block: compilers take them out of the loop, and know better which to keep in registers.
        passes: list[str] = []
        shared = stored_once(block)
        tags = {False: "", True: ""}
        for symbol, (store, name) in block.loads.items():
            first = symbol in shared or (not store.lanes and place(store, name) in stored)
            line = f"const {'VECTOR' if store.lanes else 'double'} {symbol} = {access(store, name)};"
            (body if first else passes).append(line)
        # blocks over directions keep their order: they gain nothing by another
        along = any(store.lanes for store, _, _ in block.stores)
        for statements, stores in [(block.statements, block.stores)] if along else by_results(block):
            for s in statements:
                first = s.target in shared
                comment = f" /* {s.tag} */" if s.tag and s.tag != tags[first] else ""
                tags[first] = s.tag
                (body if first else passes).append(
                    f"const {'VECTOR' if s.lanes else 'double'} {s.target} = {self.printer(s.expression)};{comment}"
                )
            for store, name, value in stores:
                text = self.printer(value)
                if store.memory is MARGIN:
                    assert culprit is not None
                    body.append(f"if (!a->singular && !({text} > 0.0)) a->singular = {culprit(name)} + 1;")
                    continue
                if store.lanes and value.is_Number:
                    text = "(VECTOR){0}" if value == 0 else f"(VECTOR){{0}} + {text}"
                line = f"{access(store, name)} {'+=' if store.adds else '='} {text};"
                (passes if store.lanes else body).append(line)
        if passes:
            passes = ["EACH_VECTOR {", *(f"    {line}" for line in passes), "}"]
        return [*pointers.values(), *body, *passes]

    def signature(self, name: str, lanes: bool, indexed: bool) -> str:
        type_ = "DIRECTIONS(call)" if lanes else "call"
        return f"static void {_function(name, lanes)}({type_} *a{', int i' if indexed else ''})"

    def call(self, name: str, lanes: bool, index: str | None) -> str:
        return f"{_function(name, lanes)}(a{'' if index is None else f', {index}'});"

    def repeat(self, start: int, end: int, step: int, inward: bool, calls: list[str]) -> list[str]:
        if inward:
            head = f"for (int i = {end - step}; i >= {start}; i -= {step}) {{"
        else:
            head = f"for (int i = {start}; i < {end}; i += {step}) {{"
        return [head, *(f"    {c}" for c in calls), "}"]

    def dispatch(self, count: int, inward: bool, entry: str, calls: list[tuple[int, str]]) -> list[str]:
        lines = [f"for (int i = {count - 1}; i >= 0; --i) {{" if inward else f"for (int i = 0; i < {count}; ++i) {{"]
        lines.append(f"    switch ({entry}) {{")
        lines += [f"    case {kind}: {call} break;" for kind, call in calls]
        return [*lines, "    default: break;", "    }", "}"]

    def repeat_rows(self, name: str, lanes: bool, count: int) -> list[str]:
        return [f"for (int i = 0; i < {count}; ++i) {_function(name, lanes)}(a, i);"]

    def add_table(self, name: str, rows: list[list[int]] | list[list[float]]) -> None:
        type_ = "int" if isinstance(rows[0][0], int) else "double"
        head = f"static const {type_} {name}[{len(rows)}][{len(rows[0])}]"
        if head not in (h for h, _ in self.tables):
            self.tables.append((head, [", ".join(map(repr, row)) for row in rows]))

    def loop(self, sweep: str) -> Function:
        f = super().loop(sweep)
        f.lines = self.ground(sweep) + f.lines
        if not any("(a" in line for line in f.lines):
            f.lines = ["(void)a;"]
        return f

    def rows_function(
        self,
        name: str,
        block: Block,
        place: RowPlace,
        integers: list[list[int]],
        numbers: list[list[float]],
        lanes: bool = False,
    ) -> tuple[Function, list[str]]:
        f, calls = super().rows_function(name, block, place, integers, numbers, lanes)
        if "int i" in f.signature and not any("[i]" in line for line in f.lines):
            f.lines.insert(0, "(void)i;")
        return f, calls

    # -- places ----------------------------------------------------------------------------------------------------

    def element(self, array: str, index: str) -> Located:
        return array, "&a->t" if array == "t" else f"a->{array}", index

    def field_of_record(self, store: Store, link: str, name: str) -> Located:
        layout = self.layout
        variable = store.label.replace("#", "_")
        if store.memory is SLOT:
            return variable, "a->slots", layout.slots["moment_tangents"][name]
        if store.memory is LANE:
            return variable, f"a->lanes + LANE_SIZE*{link}", layout.lane[name]
        return variable, f"a->records + RECORD*{link}", layout.record[name]

    def constant(self, shape: int, constants: str, name: str) -> Located:
        return "c", f"a->constants + {constants}", self.layout.constant_fields[shape][name]

    def place_of_constants(self, index: int) -> int:
        return self.layout.constant_offsets[index]

    def number_of_row(self, table: str, row: str, index: int) -> Located:
        return "k", f"{table}[{row}]", index

    def place(self, kind: UnitKind, sweep: str, store: Store, name: str) -> Located:
        at, layout = self.addresses.address(kind, sweep, store, name), self.layout
        if at.region in SIZES:
            places = {
                "records": layout.record, "near": layout.near.get(sweep, {}), "slots": layout.slots.get(sweep, {}),
                "lanes": layout.lane, "ears": layout.ear, "regions": layout.region, "region_lanes": layout.region_lane,
                "couplings": layout.coupling, "kept": layout.kept, "kept_regions": layout.kept_region,
            }  # fmt: skip
            return at.variable, f"a->{at.region} + {SIZES[at.region]}*{at.row}", places[at.region][name]
        if at.region == "numbers":
            return at.variable, f"numbers + {at.row}", int(at.component)
        row = f" + {at.row}" if at.row else ""
        if at.region == "constants":
            fields = layout.constant_fields[self.addresses.shape_of(kind, store)]
            return at.variable, f"a->constants{row}", fields[name]
        component: int | str = int(at.component) if at.component.isdigit() else at.component
        if at.region == "trig":
            component = 0 if name == "cos" else "ANGLES"
        return at.variable, f"a->{at.region}{row}", component

    # -- the ground ------------------------------------------------------------------------------------------------

    @cached_property
    def keeping(self) -> set[str]:
        """Sweeps that keep scalars for those that run backwards."""
        return {
            s
            for s, of in self.blocks.items()
            if any(a.memory in KEPT.values() for b in of.values() for a, _, _ in b.stores)
        }

    def ground(self, sweep: str | None = None) -> list[str]:
        """Lines that set what is read of the ground: at rest, accelerating by -g. For a sweep, or for all of them."""
        lines = []
        near = self.layout.near.get(sweep, {}) if sweep else {}
        kept = self.layout.kept if sweep in self.keeping else {}
        for name in sorted(self.program.ground_fields):
            if sweep and name in near:
                place = f"a->near[{near[name]}]"
            elif name in kept:
                place = f"a->kept[KEPT_SIZE*LINKS + {kept[name]}]"
            elif not sweep and name in self.layout.record:
                place = f"a->records[RECORD*LINKS + {self.layout.record[name]}]"
            else:
                continue
            value = "0.0"
            if name.endswith(("W.xx", "W.yy", "W.zz")):
                value = "1.0"
            elif name.removeprefix("t") in ("a.x", "a.y", "a.z"):
                value = f"a->gravity[{'xyz'.index(name[-1])}]"
            lines.append(f"{place} = {value};")
        return lines

    def gravity(self) -> list[str]:
        """Lines that set the acceleration of the ground, -g."""
        g = self.system.gravity
        if g is None:
            return []
        lines = []
        for i, name in enumerate(("a.x", "a.y", "a.z")):
            value = self._gravity(g.shape.varying.get(name) or g.values.get(name, 0.0))
            lines.append(f"a->gravity[{i}] = {value};")
        return lines

    def _gravity(self, value: float | str) -> str:
        """A number, or a constant of gravity's."""
        if not isinstance(value, str):
            return repr(value)
        g = self.system.gravity
        assert g is not None
        index = self.layout.constant_offsets[g.index] + self.layout.constant_fields[g.shape.index][value]
        return f"a->constants[{index}]"

    def ground_tangent(self) -> tuple[list[str], list[str]]:
        """Lines that set the ground's tangent where gravity depends on parameters, and that set it to zero."""
        lines: list[str] = []
        zero: list[str] = []
        for name, terms in self.ground_tangents():
            place = f"a->slots[{self.layout.slots['balance_out'][name]}]"
            text = " + ".join(f"{self._gravity(factor)}*a->dp[{p}].at[h]" for factor, p in terms) or "(VECTOR){0}"
            lines.append(f"EACH_VECTOR {place}.at[h] = {text};")
            zero.append(f"{place} = NOTHING;")
        return lines, zero

    def ground_transposed(self) -> list[str]:
        """Lines that add to adjoints of parameters what those of the ground's tangent give."""
        slots = self.layout.slots.get("balance_out", {})
        return [
            f"EACH_VECTOR a->dp[{p}].at[h] += {self._gravity(factor)}*a->slots[{slots[name]}].at[h];"
            for name, terms in self.ground_tangents()
            for factor, p in terms
        ]

    # -- the files -------------------------------------------------------------------------------------------------

    def prepared(self, what: str) -> list[str]:
        angles = self.layout.angles
        n = len(angles)
        match what:
            case procedures.CONSTANTS:
                return self.constants[1]
            case procedures.GROUND:
                return self.gravity() + self.ground()
            case procedures.ANGLES if angles:
                angle = "i" if angles == list(range(n)) else "angle_of[i]"
                return [
                    f"for (int i = 0; i < {n}; ++i) a->trig[ANGLES + i] = a->q[{angle}];",
                    f"for (int i = {n}; i < ANGLES; ++i) a->trig[ANGLES + i] = 0.0;",
                    "sines_and_cosines(ANGLES, a->trig);",
                ]
            case procedures.GROUND_AT_REST if self.system.gravity is not None:
                record = [line for line in self.ground() if "gravity" in line]
                return ["for (int i = 0; i < 3; ++i) a->gravity[i] = 0.0;", *record]
            case procedures.GROUND_TANGENT:
                return self.ground_tangent()[0]
            case procedures.GROUND_TANGENT_AT_REST:
                return self.ground_tangent()[1]
            case procedures.GROUND_TANGENT_TRANSPOSED:
                return self.ground_transposed()
            case procedures.ADJOINTS | procedures.PASSING_ADJOINTS:
                return [
                    f"for (long i = 0; i < {n}L; ++i) a->{name}[i] = NOTHING;"
                    for name, lanes, n in self.regions()
                    if lanes and (name != "lanes" or what == procedures.ADJOINTS)
                ]
        return []

    def regions(self) -> list[tuple[str, bool, int]]:
        """What sweeps keep in the workspace: name, whether per direction, number of entries."""
        layout, model, regions = self.layout, self.model, self.system.regions
        links, forced = len(self.system.links), model.nu if model.forces else 0
        found = [
            ("records", False, len(layout.record) * (links + 1)),
            ("near", False, layout.near_size * self.system.slots),
            ("ears", False, len(layout.ear) * len(regions.ears)),
            ("couplings", False, len(layout.coupling) * regions.elimination.slots),
            ("regions", False, len(layout.region) * len(regions.regions)),
            ("kept", False, len(layout.kept) * (links + 1)),
            ("kept_regions", False, len(layout.kept_region) * len(regions.regions)),
            ("gravity", False, 3 if self.system.gravity is not None else 0),
            ("constants", False, layout.constants_size),
            ("trig", False, 2 * layout.angles_padded),
            ("tau", False, forced),
            *((name, False, n) for name, n in self.system.coefficient_counts.items()),
            ("slots", True, layout.slot_size * self.system.slots),
            ("lanes", True, len(layout.lane) * links),
            ("region_lanes", True, len(layout.region_lane) * len(regions.regions)),
            ("dtau", True, forced),
            *((f"d{name}", True, n) for name, n in self.system.coefficient_counts.items()),
        ]
        return [r for r in found if r[2]]

    def laid_out(self, procedure: Procedure, places: dict[str, int]) -> list[str]:
        """Lines that give a call the memory of the workspace: all of it, or what a few sweeps need."""
        if any(isinstance(s, (Prepare, Perform, Own)) for s in procedure.steps):
            return ["lay_out(&c, work);"]
        sweeps = [s.sweep for s in procedure.steps if isinstance(s, Run)]
        text = "\n".join(line for s in sweeps for f in self.swept[s] for line in f.lines)
        lines = [f"c.{name} = aligned(work) + {at};" for name, at in places.items() if f"a->{name} " in text]
        return lines if lines or procedure.seeds else ["(void)work;"]

    def context(self) -> dict[str, Any]:
        """What the templates are rendered with."""
        model, layout = self.model, self.layout
        context = self.shared_context()
        found = context["interfaces"]
        places: dict[str, int] = {}
        at = 0
        memory = c_functions.memory(found)
        of_sweeps = self.regions()
        own = [("own", False, memory.size)] if memory.size else []
        # the call's own arrays before the lanes: behind them they would cost some functions a tenth
        regions = [*(r for r in of_sweeps if not r[1]), *own, *(r for r in of_sweeps if r[1])]
        for name, lanes, count in regions:
            places[name] = at
            at += -(-count * (8 if lanes else 1) // 8) * 8
        kept = {name: lanes for name, lanes, _ in regions}
        self.workspace = at + 8
        fields, lane_fields = memory.declarations(kept)
        in_workspace = {name: at for name, at in places.items() if not kept[name]}
        lines = CFunctions(model.name, memory, self.prepared, lambda p: self.laid_out(p, in_workspace))
        of_width = [(f, w) for f in found for w in (f.widths or (None,))]
        batches = [(c_functions.batch_signature(f, model.name, w), f, w) for f, w in of_width]
        return context | {
            "NAME": model.name.upper(),
            "legend": legend(model, len(self.system.links)),
            "sizes_in_c": [
                ("LINKS", len(self.system.links)), ("RECORD", max(1, len(layout.record))),
                ("NEAR_SIZE", max(1, layout.near_size)), ("SLOT_SIZE", max(1, layout.slot_size)),
                ("LANE_SIZE", max(1, len(layout.lane))),
                *((n, len(f)) for n, f in (("EAR_SIZE", layout.ear), ("COUPLING_SIZE", layout.coupling),
                                           ("REGION_SIZE", layout.region), ("REGION_LANE_SIZE", layout.region_lane),
                                           ("KEPT_SIZE", layout.kept), ("KEPT_REGION_SIZE", layout.kept_region)) if f),
                ("ANGLES", max(1, layout.angles_padded)),
            ],
            "workspace": self.workspace,
            "fields": fields, "lane_fields": lane_fields, "field_names": [f.split()[-1].lstrip("*") for f in fields],
            "value_places": in_workspace, "lane_places": {n: at for n, at in places.items() if kept[n]},
            "tables": [*self.flat_tables(), *((head, [f"{{{row}}}," for row in rows]) for head, rows in self.tables)],
            "sines": ["c/sincos.c.jinja"] if layout.angles else [],
            "routines": [lines.routine(r) for r in context["routines"]],
            "lane_routines": [lines.routine(r) for r in context["lane_routines"]],
            "other_lane_routines": [lines.routine(r) for r in context["other_lane_routines"]],
            "header_functions": [lines.function(f) for f in found if not f.seeds],
            "header_lane_functions": [lines.function(f) for f in found if 2 in f.widths],
            "other_header_lane_functions": [lines.function(f) for f in found if f.seeds and 2 not in f.widths],
            "prototypes": [
                (f.doc if not w else f"{f.doc} Directions: {w}.",
                 c_functions.signature(f, f"{model.name}_{c_functions.symbol(f, w)}")) for f, w in of_width
            ],
            "batches": [Function("", head, c_functions.batch_lines(f, model.name, w)) for head, f, w in batches],
        }  # fmt: skip

    def flat_tables(self) -> list[tuple[str, list[str]]]:
        """Declarations and lines of tables without rows: numbers; coordinates that are angles if they are not the first."""
        numbers, angles = [repr(v) for v in self.layout.numbers], self.layout.angles
        found = [(f"static const double numbers[{len(numbers)}]", in_lines(numbers, 6))] if numbers else []
        if angles != list(range(len(angles))):
            found.append((f"static const int angle_of[{len(angles)}]", in_lines(list(map(str, angles)), 16)))
        return found


def legend(model: Model, links: int) -> list[str]:
    """Lines that say what arguments and results are."""

    def some(names: Sequence[str]) -> str:
        return " ".join(names[:12]) + (" ..." if len(names) > 12 else "")

    nq, nu, outputs = model.nq, model.nu, [o.name for o in model.outputs]
    lines = [
        f"  q[{nq}]     coordinates: {some(model.coordinate_names)}",
        f"  u[{nu}]     speeds: {some(model.speed_names)}",
        f"  udot[{nu}]  their time derivatives",
    ]
    if model.parameters:
        where = f"{model.name}_model.h has defaults, initial state and indices"
        lines.append(f"  p[{len(model.parameters)}]     design parameters; {where}:")
        for p in model.parameters[:64]:
            unit = p.unit.replace("*/", "* /").replace("/*", "/ *") if p.unit else ""
            lines.append(f"             {p.name}{f' [{unit}]' if unit else ''}")
    if model.inputs:
        lines.append(f"  inputs[{len(model.inputs)}]: {' '.join(model.inputs)}")
    if any("t" in e.names for e in model.expressions()):
        lines.append("  t         time, s")
    if outputs:
        lines.append(f"  outputs[{len(outputs)}]: {some(outputs)}")
    lines += [
        "  energy[2]  kinetic and potential energy, J",
        f"  M[{nu}*{nu}] and J_x[{nu}*n] are stored row by row.",
        "A function whose name ends in _8, _2 or _1 works on so many directions at once: seeds (dq, du, ...) and derivatives",
        f"have the direction as last index, dq[{nq}][8].",
        f"work: {model.name.upper()}_WORKSPACE doubles of the caller's. Nothing in it is kept between calls; functions are "
        f"re-entrant.",
        "Functions return 0, or the number (from 1) of the link about whose joint nothing outboard has inertia.",
    ]
    if model.loops:
        lines.append(f"Numbers above {links}, the number of links: a loop has lost rank.")
    if any(e.singular for e in model.loads):
        lines.append(f"Numbers above {links + len(model.loops)}: a force element has no direction.")
    return lines


def _function(name: str, lanes: bool) -> str:
    return f"DIRECTIONS({name})" if lanes else name


def write_c(context: dict[str, Any]) -> dict[str, str]:
    """The C files of a solver, by name."""
    name = context["name"]
    return {
        f"{name}.c": render("c/module.c.jinja", context),
        f"{name}_directions.h": render("c/directions.h.jinja", context),
        f"{name}.h": render("c/module.h.jinja", context),
    }


__all__ = ["CWriter", "write_c"]
