"""Writes the C of a solver: functions of links, loops over links, tables.

Everything is prepared here as ready lines; the templates in ``templates/c`` put them in place and hold the functions
of the header.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from typing import Any

from ..mechanics.kinds import EarKind, LinkKind, SpringKind, UnitKind
from ..program.block import Block
from ..program.passes import by_results
from .printer import C_FUNCTIONS, Printer
from .templates import render
from .writer import Function, Located, Place, Writer

LANES = frozenset(
    {"lme", "lup", "lane", "lroot", "laneroot", "lbase", "lanebase", "lpartner", "lanepartner", "lground", "laneone",
     "lanetwo", "laneone_sum", "lanetwo_sum", "lregion", "lregion_sum", "dq", "du", "dp", "cldp", "csdp", "dinputs", "dt", "dtau",
     "dcoefficient", "b", "dudot", "dforce", "dqdot", "denergy", "denergy_sum", "dpotential_sum", "doutputs", "dposition",
     "dinitial_q", "dinitial_u"}
)  # fmt: skip
"""Arrays that hold one value per direction."""

RECORDS = ("me", "up", "root", "base", "partner", "ground", "one", "two")
SLOTS = ("lme", "lup", "lroot", "lbase", "lpartner", "lground")
LINK_LANES = ("lane", "laneroot", "lanebase", "lanepartner", "laneone", "lanetwo")
OF_COORDINATES = ("q", "dq", "qdot", "dqdot", "step")
OF_SPEEDS = ("u", "given_u", "du", "udot", "dudot", "tau", "dtau", "b", "force", "dforce")


def of_directions(array: str) -> bool:
    """Whether an array holds one value per direction."""
    return array.partition("#")[0] in LANES


def stored_once(block: Block) -> set[Any]:
    """Symbols that what is stored for all directions together is made of."""
    if not any(of_directions(array) for array, _, _ in block.stores):
        return {*block.loads, *(s.target for s in block.statements)}
    wanted = {s for array, _, value in block.stores if not of_directions(array) for s in value.free_symbols}
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

    def lines(self, block: Block, place: Place, culprit: Callable[[str, str], str] | None = None) -> list[str]:
        stored = {place(a, n) for a, n, _ in block.stores if a not in ("pivot", "rank")}
        written = {pointer for pointer, _, _ in stored}
        pointers: dict[str, str] = {}
        body: list[str] = []

        def access(array: str, name: str) -> str:
            pointer, expression, i = place(array, name)
            variable = pointer + "_at"
            if pointer not in pointers:
                type_ = "LANES" if of_directions(array) else "double"
                const = "" if pointer in written else "const "
                pointers[pointer] = f"{const}{type_} *restrict {variable} = {expression};"
            return f"{variable}[{i}]{'.at[h]' if of_directions(array) else ''}"

        # Before the loop over vectors stands what is stored once for all directions. Other numbers that they share stay in
        # the order of the block: compilers take them out of the loop, and know better which to keep in registers.
        passes: list[str] = []
        shared = stored_once(block)
        tags = {False: "", True: ""}
        for symbol, (array, name) in block.loads.items():
            lanes = of_directions(array)
            first = symbol in shared or (not lanes and place(array, name) in stored)
            line = f"const {'VECTOR' if lanes else 'double'} {symbol} = {access(array, name)};"
            (body if first else passes).append(line)
        # blocks over directions keep their order: they gain nothing by another
        along = any(of_directions(array) for array, _, _ in block.stores)
        for statements, stores in [(block.statements, block.stores)] if along else by_results(block):
            for s in statements:
                first = s.target in shared
                comment = f" /* {s.tag} */" if s.tag and s.tag != tags[first] else ""
                tags[first] = s.tag
                (body if first else passes).append(
                    f"const {'VECTOR' if s.lanes else 'double'} {s.target} = {self.printer(s.expression)};{comment}"
                )
            for array, name, value in stores:
                text = self.printer(value)
                if array in ("pivot", "rank"):
                    assert culprit is not None
                    body.append(f"if (!a->singular && !({text} > 0.0)) a->singular = {culprit(array, name)} + 1;")
                    continue
                if of_directions(array) and value.is_Number:
                    text = "(VECTOR){0}" if value == 0 else f"(VECTOR){{0}} + {text}"
                line = f"{access(array, name)} {'+=' if array.endswith('_sum') else '='} {text};"
                (passes if of_directions(array) else body).append(line)
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

    def field_of_record(self, array: str, link: str, name: str) -> Located:
        if array == "lme":
            return array, "a->slots", self.layout.slots["moment_tangents"][name]
        if array == "lane":
            return array, f"a->lanes + LANE_SIZE*{link}", self.layout.lane[name]
        return array, f"a->records + RECORD*{link}", self.layout.record[name]

    def constant(self, shape: int, constants: str, name: str) -> Located:
        return "c", f"a->constants + {constants}", self.layout.constant_fields[shape][name]

    def place_of_constants(self, index: int) -> int:
        return self.layout.constant_offsets[index]

    def number_of_row(self, table: str, row: str, index: int) -> Located:
        return "k", f"{table}[{row}]", index

    def place(self, kind: UnitKind, sweep: str, array: str, name: str) -> Located:
        layout, system = self.layout, self.system
        stem = array.partition("#")[0].removesuffix("_sum")
        variable = array.removesuffix("_sum").replace("#", "_")

        def of_links(column: str, of: list[int] | None = None) -> str:
            return self.of_links(kind, sweep, array, column, of)

        if stem in RECORDS:
            near = layout.near.get(sweep, {})
            if name in near:
                return f"near_{variable}", f"a->near + NEAR_SIZE*{of_links('SLOT', self.slots)}", near[name]
            return variable, f"a->records + RECORD*{of_links('NUMBER')}", layout.record[name]
        if stem in SLOTS:
            return variable, f"a->slots + SLOT_SIZE*{of_links('SLOT', self.slots)}", layout.slots[sweep][name]
        if stem in LINK_LANES:
            return variable, f"a->lanes + LANE_SIZE*{of_links('NUMBER')}", layout.lane[name]
        if stem == "ear":
            numbers = [system.regions.order[i].number for i in kind.units]
            return "ear", f"a->ears + EAR_SIZE*{self.entry(kind, sweep, 'EAR', numbers)}", layout.ear[name]
        if stem in ("own", "pair"):
            return (
                variable,
                f"a->couplings + COUPLING_SIZE*{self.coupling_slot(kind, sweep, array)}",
                layout.coupling[name],
            )
        if stem == "region":
            at = self.entry(kind, sweep, "REGION", self.numbers_of_regions(kind))
            return "region", f"a->regions + REGION_SIZE*{at}", layout.region[name]
        if stem == "lregion":
            at = self.entry(kind, sweep, "REGION", self.numbers_of_regions(kind))
            return "lregion", f"a->region_lanes + REGION_LANE_SIZE*{at}", layout.region_lane[name]
        if stem == "reaction":
            return variable, f"a->reaction + 6*{of_links('NUMBER')}", int(name)
        if stem == "loop_reaction":
            assert isinstance(kind, EarKind)
            at = self.entry(kind, sweep, f"LOOP{array.partition('#')[2]}", self.loops_meant(kind, array))
            return variable, f"a->loop_reaction + 6*{at}", int(name)
        if stem == "condition":
            assert isinstance(kind, EarKind)
            at = self.entry(kind, sweep, f"LOOP{array.partition('#')[2]}", self.loops_meant(kind, array))
            return variable, f"a->condition + {at}", 0
        if stem in ("position", "velocity", "dposition"):
            assert isinstance(kind, EarKind)
            begins = self.closure_offsets
            at = self.entry(
                kind, sweep, f"LOOP{array.partition('#')[2]}_ROWS", [begins[n] for n in self.loops_meant(kind, array)]
            )
            return variable, f"a->{stem} + {at}", int(name)
        if stem in OF_COORDINATES:
            return variable, f"a->{stem} + {of_links('Q', [link.q for link in system.links])}", int(name)
        if stem in OF_SPEEDS:
            return variable, f"a->{stem} + {of_links('U', [link.u for link in system.links])}", int(name)
        if stem == "trig":
            return variable, f"a->trig + {of_links('TRIG', layout.trig_of)}", 0 if name == "cos" else "ANGLES"
        if stem in ("dp", "cldp", "csdp"):
            return "dp", "a->dp", self.parameter(kind, sweep, array, int(name))
        if stem in ("energy", "denergy"):
            return stem, f"a->{stem}", 0
        if stem in ("potential", "dpotential"):
            return stem, f"a->{stem.replace('potential', 'energy')}", 1
        if stem in ("coefficient", "dcoefficient"):
            at = self.entry(kind, sweep, "COEFFICIENTS", [3 * n for n in kind.members])
            return stem, f"a->{stem} + {at}", int(name)
        if stem == "cs":
            assert isinstance(kind, SpringKind)
            if name in kind.data:
                values = [layout.spring_number_offsets[n] for n in kind.members]
                return "k", f"numbers + {self.entry(kind, sweep, 'NUMBERS', values)}", kind.data[name]
            values = [layout.constant_offsets[system.spring_constants[n].index] for n in kind.members]
            at = self.entry(kind, sweep, "CONSTANTS", values)
            return variable, f"a->constants + {at}", layout.constant_fields[kind.shape.index][name]
        if stem == "c":
            place = array.partition("#")[2]
            of_kind = kind.links[int(place)] if isinstance(kind, EarKind) else kind
            assert isinstance(of_kind, LinkKind)
            if name in of_kind.data:
                return f"k_{variable}", f"numbers + {of_links('NUMBERS', layout.number_offsets)}", of_kind.data[name]
            begins = [layout.constant_offsets[c.index] for c in system.constants_of]
            expression = f"a->constants + {of_links('CONSTANTS', begins)}"
            return variable, expression, layout.constant_fields[of_kind.shape.index][name]
        if stem == "cl":
            assert isinstance(kind, EarKind)
            place = array.partition("#")[2]
            closure = kind.closures[int(place)]
            loops = self.loops_meant(kind, array)
            if name in closure.data:
                values = [layout.closure_number_offsets[n] for n in loops]
                at = self.entry(kind, sweep, f"LOOP{place}_NUMBERS", values)
                return f"k_{variable}", f"numbers + {at}", closure.data[name]
            values = [layout.constant_offsets[system.closure_constants[n].index] for n in loops]
            at = self.entry(kind, sweep, f"LOOP{place}_CONSTANTS", values)
            return variable, f"a->constants + {at}", layout.constant_fields[closure.shape.index][name]
        raise KeyError(array)

    @cached_property
    def slots(self) -> list[int]:
        """Slots of links, the ground's last."""
        return [*self.system.slot_of, 0]

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
