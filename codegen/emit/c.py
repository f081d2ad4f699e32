"""Writes the C of a solver: functions of links, loops over links, tables.

Everything is prepared here as ready lines; the templates in ``templates/c`` put them in place and hold the functions
of the header.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from ..mechanics.kinds import UnitKind
from ..mechanics.stores import LME, MARGIN, MY_LANE
from ..program.block import Block
from ..program.passes import by_results
from ..program.store import Store
from .printer import C_FUNCTIONS, Printer
from .templates import render
from .writer import Function, Located, Place, Writer

SIZES = {
    "records": "RECORD", "near": "NEAR_SIZE", "slots": "SLOT_SIZE", "lanes": "LANE_SIZE", "ears": "EAR_SIZE",
    "regions": "REGION_SIZE", "region_lanes": "REGION_LANE_SIZE", "couplings": "COUPLING_SIZE",
}  # fmt: skip
"""How long a row of each region of memory is."""


def stored_once(block: Block) -> set[Any]:
    """Symbols that what is stored for all directions together is made of."""
    if not any(store.lanes for store, _, _ in block.stores):
        return {*block.loads, *(s.target for s in block.statements)}
    wanted = {s for store, _, value in block.stores if not store.lanes for s in value.free_symbols}
    for s in reversed(block.statements):
        if s.target in wanted:
            wanted |= s.expression.free_symbols
    return wanted


class CWriter(Writer):
    """C source of a program; a place is (name of a pointer, its expression, index)."""

    def __init__(self, *program: Any):
        super().__init__(*program)
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

    def rows_function(self, *arguments: Any, **options: Any) -> tuple[Function, list[str]]:
        f, calls = super().rows_function(*arguments, **options)
        if "int i" in f.signature and not any("[i]" in line for line in f.lines):
            f.lines.insert(0, "(void)i;")
        return f, calls

    # -- places ----------------------------------------------------------------------------------------------------

    def element(self, array: str, index: str) -> Located:
        return array, "&a->t" if array == "t" else f"a->{array}", index

    def field_of_record(self, store: Store, link: str, name: str) -> Located:
        layout = self.layout
        if store is LME:
            return store.name, "a->slots", layout.slots["moment_tangents"][name]
        if store is MY_LANE:
            return store.name, f"a->lanes + LANE_SIZE*{link}", layout.lane[name]
        return store.name, f"a->records + RECORD*{link}", layout.record[name]

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
                "couplings": layout.coupling,
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

    def ground(self, sweep: str | None = None) -> list[str]:
        """Lines that set what is read of the ground: at rest, accelerating by -g. For a sweep, or for all of them."""
        lines = []
        near = self.layout.near.get(sweep, {}) if sweep else {}
        for name in sorted(self.program.ground_fields):
            if sweep and name in near:
                place = f"a->near[{near[name]}]"
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

    # -- the files -------------------------------------------------------------------------------------------------

    def context(self) -> dict[str, Any]:
        """What the templates are rendered with."""
        model, layout, use = self.model, self.layout, self.uses
        context = self.shared_context()
        size = context["size"]
        ground_tangent, ground_tangent_rest = self.ground_tangent()
        links = len(self.system.links)
        state = ["q", "u"] + [n for n, name in (("p", "parameters"), ("inputs", "inputs")) if use[name]]
        regions = [
            ("records", "", len(layout.record) * (links + 1)),
            ("near", "", layout.near_size * self.system.slots),
            ("ears", "", len(layout.ear) * len(self.system.regions.ears)),
            ("couplings", "", len(layout.coupling) * self.system.regions.elimination.slots),
            ("regions", "", len(layout.region) * len(self.system.regions.regions)),
            ("gravity", "", 3 if use["gravity"] else 0),
            ("constants", "", layout.constants_size),
            ("trig", "", 2 * layout.angles_padded),
            ("tau", "", model.nu if use["forces"] else 0),
            ("coefficient", "", 3 * len(model.springs)),
            ("speeds", "", model.nu if use["loops"] else 0),
            ("accelerations", "", model.nu if self.reactions else 0),
            ("rates", "", len(model.closure_names)),
            ("rest_u", "", 0 if use["loops"] else model.nu),
            ("numbers_1", "", 0 if use["loops"] else model.nu),
            ("numbers_2", "", 0 if use["loops"] else model.nu),
            ("slots", "L", layout.slot_size * self.system.slots),
            ("lanes", "L", len(layout.lane) * links),
            ("region_lanes", "L", len(layout.region_lane) * len(self.system.regions.regions)),
            ("dtau", "L", model.nu if use["forces"] else 0),
            ("dcoefficient", "L", 3 * len(model.springs)),
            ("lanes_1", "L", model.nu),
            ("lanes_2", "L", 0 if use["loops"] else model.nu),
            ("own_dq", "L", model.nq if use["loops"] else 0),
            ("own_du", "L", model.nu if use["loops"] else 0),
            *((f"rest_d{n}", "L", size[n]) for n in state),
            ("rest_dt", "L", int(use["time"])),
        ]
        at, placed = 0, []
        for name, kind, count in regions:
            if count:
                placed.append((name, kind == "L", at))
                at += -(-count * (8 if kind == "L" else 1) // 8) * 8
        functions = context["interfaces"]
        self.workspace = at + 8
        pointers = ["double *" + n for n in ("udot", "qdot", "force", "energy", "outputs")]
        pointers += ["double *" + n for n in ("reaction", "loop_reaction") if self.reactions]
        pointers += ["double *" + n for n in ("initial_q", "initial_u") if use["initial"]]
        pointers += ["double *" + n for n in ("position", "velocity", "condition", "step") if use["loops"]]
        sources = [f"const double *{n}" for n in state] + (["double t"] if use["time"] else [])
        seeds = [f"const LANES *d{n}" for n in state] + (["const LANES *dt"] if use["time"] else [])
        if use["loops"]:  # dependent speeds and seeds are written into copies
            sources[1] = "double *u"
            sources.append("const double *given_u")
            seeds[:2] = ["LANES *dq", "LANES *du", "const LANES *given_dq", "const LANES *given_du"]
        names = lambda declarations: [d.split()[-1].lstrip("*") for d in declarations]  # noqa: E731
        call_pointers = [*sources, *pointers, *(f"double *{n}" for n, lane, _ in placed if not lane)]
        lane_pointers = [
            *seeds,
            "const LANES *b",
            *(["LANES *dposition"] if use["loops"] else []),
            *(f"LANES *{n}" for n in ("dinitial_q", "dinitial_u") if use["initial"]),
            *(f"LANES *{n}" for n in ("dudot", "dqdot", "dforce", "denergy", "doutputs")),
            *(f"LANES *{n}" for n, lane, _ in placed if lane),
        ]
        return context | {
            "NAME": model.name.upper(),
            "links": links, "loop_count": len(model.loops),
            "coordinates": model.coordinate_names, "speeds": model.speed_names,
            "parameters": model.parameters, "input_names": model.inputs, "outputs": model.outputs,
            "state": [*state, *(["t"] if use["time"] else [])],
            "constants_in_c": [
                ("LINKS", links), ("RECORD", max(1, len(layout.record))),
                ("NEAR_SIZE", max(1, layout.near_size)), ("SLOT_SIZE", max(1, layout.slot_size)),
                ("LANE_SIZE", max(1, len(layout.lane))),
                *((n, len(f)) for n, f in (("EAR_SIZE", layout.ear), ("COUPLING_SIZE", layout.coupling),
                                           ("REGION_SIZE", layout.region), ("REGION_LANE_SIZE", layout.region_lane)) if f),
                ("ANGLES", max(1, layout.angles_padded)),
            ],
            "workspace": self.workspace,
            "speeds_at": next((offset for n, _, offset in placed if n == "speeds"), 0),
            "regions": placed,
            "region_names": {n for n, _, _ in placed},
            "call_pointers": call_pointers, "call_names": names(call_pointers),
            "lane_pointers": lane_pointers,
            "tables": self.tables,
            "ground": self.gravity() + self.ground(),
            "ground_record": [line for line in self.ground() if "gravity" in line],
            "ground_tangent": ground_tangent, "ground_tangent_rest": ground_tangent_rest,
            "prototypes": [
                (f.comment if not w else f"{f.comment} Directions: {w}.", f.signature(model.name, w))
                for f in functions for w in (f.widths or (None,))
            ],
            "batch_prototypes": [f.batch_signature(model.name, w) for f in functions for w in (f.widths or (None,))],
            "batches": [
                Function("", f.batch_signature(model.name, w), f.batch_lines(model.name, w, size))
                for f in functions for w in (f.widths or (None,))
            ],
            "signature": {f.name: f.signature(model.name) for f in functions},
            "lane_signature": {
                f.name: f.signature(model.name).replace(f"{model.name}_{f.name}", f"DIRECTIONS({model.name}_{f.name})")
                for f in functions
            },
        }  # fmt: skip


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
