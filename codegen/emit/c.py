"""Writes the C of a solver: functions of links, loops over links, tables.

Everything is prepared here as ready lines; the templates in ``templates/c`` put them in place and hold the functions
of the header.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from ..version import __version__
from ..mechanics.expansion import Program
from ..mechanics.formulas import FormulaKind
from ..mechanics.kinds import LinkKind
from ..mechanics.outputs import RecordFormula
from ..mechanics.sweeps import INWARD, SWEEP
from ..model.model import GROUND
from ..program.block import Block
from .interface import WIDTHS, Interface, interfaces, sizes, uses
from .memory import Layout, LinkTable
from .printer import C_FUNCTIONS, Printer
from .templates import render

MAX_STRETCHES = 24
"""More different stretches of links than this, and a sweep dispatches on the kind instead."""

LANES = frozenset(
    {"lme", "lup", "lane", "dq", "du", "dp", "dinputs", "dt", "dtau", "b", "dudot", "dforce", "dqdot", "denergy",
     "denergy_sum", "doutputs"}
)  # fmt: skip
"""Arrays that hold one value per direction."""

PIVOT_FLOOR = 1e-14
"""A pivot below this fraction of the joint's articulated inertia means that nothing outboard has inertia about it."""

Place = Callable[[str, str], tuple[str, str, int | str]]


@dataclass(slots=True)
class Function:
    """A generated C function: comment, signature, ready lines."""

    comment: str
    signature: str
    lines: list[str] = field(default_factory=list)


class BlockWriter:
    """C lines of a block; `place` tells pointer name, pointer expression and index of a field."""

    def __init__(self) -> None:
        self.printer = Printer(C_FUNCTIONS)

    def lines(self, block: Block, place: Place, link: str = "") -> list[str]:
        written = {place(a, n)[0] for a, n, _ in block.stores if a != "pivot"}
        pointers: dict[str, str] = {}
        body: list[str] = []

        def access(array: str, name: str) -> str:
            pointer, expression, i = place(array, name)
            variable = pointer + "_at"
            if pointer not in pointers:
                type_ = "LANES" if array in LANES else "double"
                const = "" if pointer in written else "const "
                pointers[pointer] = f"{const}{type_} *restrict {variable} = {expression};"
            return f"{variable}[{i}]"

        for symbol, (array, name) in block.loads.items():
            body.append(f"const {'LANES' if array in LANES else 'double'} {symbol} = {access(array, name)};")
        tag = ""
        for s in block.statements:
            comment = f" /* {s.tag} */" if s.tag and s.tag != tag else ""
            tag = s.tag
            body.append(f"const {'LANES' if s.lanes else 'double'} {s.target} = {self.printer(s.expression)};{comment}")
        for array, name, value in block.stores:
            text = self.printer(value)
            if array == "pivot":
                body.append(f"if (!({text} > 0.0)) a->singular = {link} + 1;")
                continue
            if array in LANES and value.is_Number:
                text = "NOTHING" if value == 0 else f"NOTHING + {text}"
            body.append(f"{access(array, name)} {'+=' if array.endswith('_sum') else '='} {text};")
        return list(pointers.values()) + body


class CWriter:
    """C source of a program.

    Parameters
    ----------
    program : Program
    formulas : list of FormulaKind
        Joint forces and outputs.
    records : list of RecordFormula
        Outputs of links, potential energy.
    energy_outputs : list of (int, int)
        Outputs that are energies: output index, 0 kinetic or 1 potential.
    """

    def __init__(
        self,
        program: Program,
        formulas: list[FormulaKind],
        records: list[RecordFormula],
        energy_outputs: list[tuple[int, int]],
    ):
        self.program = program
        self.system = program.system
        self.model = program.system.model
        self.formulas = formulas
        self.records = records
        self.energy_outputs = energy_outputs
        self.layout = Layout(program)
        self.table = LinkTable(self.layout)
        self.writer = BlockWriter()
        self.uses = uses(self.system)
        self.tables: list[tuple[str, list[str]]] = []

    # -- functions of links ----------------------------------------------------------------------------------------

    def place(self, kind: LinkKind, sweep: str, array: str, name: str) -> tuple[str, str, int | str]:
        """Pointer name, pointer expression and index of a field of a link of a kind."""
        entry = self.table.entry
        layout = self.layout
        me = str(kind.members[0]) if len(kind.members) == 1 else "i"
        near = layout.near.get(sweep, {})
        if array == "me" and name in near:
            return "near", f"a->near + NEAR_SIZE*{entry('SLOT', kind)}", near[name]
        if array == "up" and name in near:
            return "up_near", f"a->near + NEAR_SIZE*{entry('UPSLOT', kind)}", near[name]
        if array == "me":
            return array, f"a->records + RECORD*{me}", layout.record[name]
        if array == "up":
            return array, f"a->records + RECORD*{entry('UP', kind)}", layout.record[name]
        if array in ("lme", "lup"):
            column = "SLOT" if array == "lme" else "UPSLOT"
            return array, f"a->slots + SLOT_SIZE*{entry(column, kind)}", layout.slots[sweep][name]
        if array == "lane":
            return array, f"a->lanes + LANE_SIZE*{me}", layout.lane[name]
        if array in ("q", "dq", "qdot", "dqdot"):
            return array, f"a->{array} + {entry('Q', kind)}", int(name)
        if array in ("u", "du", "udot", "dudot", "tau", "dtau", "b", "force", "dforce"):
            return array, f"a->{array} + {entry('U', kind)}", int(name)
        if array == "trig":
            return array, f"a->trig + {entry('TRIG', kind)}", 0 if name == "cos" else "ANGLES"
        if array == "dp":
            return array, "a->dp", entry(f"P{name}", kind)
        if array in ("energy_sum", "denergy_sum"):
            return array, f"a->{array.removesuffix('_sum')}", 0
        if array == "c" and name in kind.data:
            return "k", f"numbers + {entry('NUMBERS', kind)}", kind.data[name]
        if array == "c":
            offset = layout.constant_fields[kind.shape.index][name]
            return "c", f"a->constants + {entry('CONSTANTS', kind)}", offset
        raise KeyError(array)

    def link_function(self, sweep: str, kind: LinkKind, block: Block) -> Function:
        single = len(kind.members) == 1
        first = self.system.links[kind.members[0]].name
        who = first if single else f"{len(kind.members)} links: {first}, ..."
        f = Function(
            f"{block.title}; {who}",
            f"static void {self.function_name(sweep, kind)}({call_type(sweep)} *a{'' if single else ', int i'})",
        )
        link = str(kind.members[0]) if single else "i"
        f.lines = self.writer.lines(block, lambda array, name: self.place(kind, sweep, array, name), link)
        return f

    def function_name(self, sweep: str, kind: LinkKind) -> str:
        name = f"{sweep}_{kind.index}"
        return f"DIRECTIONS({name})" if SWEEP[sweep].lanes else name

    def loop(self, sweep: str) -> Function:
        """The loop over links of a sweep."""
        spec = SWEEP[sweep]
        blocks = self.program.blocks[sweep]
        kinds = [k.index for k in self.system.kind_of]
        inward = spec.direction == INWARD
        f = Function(
            spec.title, f"static void {f'DIRECTIONS({sweep})' if spec.lanes else sweep}({call_type(sweep)} *a)"
        )

        def call(kind: int, i: str) -> list[str]:
            block = blocks.get(kind)
            if block is None or not block.stores:
                return []
            k = self.system.kinds[kind]
            argument = "" if len(k.members) == 1 else f", {i}"
            return [f"{self.function_name(sweep, k)}(a{argument});"]

        f.lines += self.ground(sweep)
        parts = stretches(kinds)
        if len(parts) <= MAX_STRETCHES or len(self.system.kinds) == len(kinds):
            for start, pattern, count in reversed(parts) if inward else parts:
                order = list(reversed(range(len(pattern)))) if inward else list(range(len(pattern)))
                if count == 1:
                    for o in order:
                        f.lines += call(pattern[o], str(start + o))
                    continue
                calls = [c for o in order for c in call(pattern[o], f"i + {o}" if o else "i")]
                if not calls:
                    continue
                step, end = len(pattern), start + len(pattern) * count
                if inward:
                    f.lines.append(f"for (int i = {end - step}; i >= {start}; i -= {step}) {{")
                else:
                    f.lines.append(f"for (int i = {start}; i < {end}; i += {step}) {{")
                f.lines += [f"    {c}" for c in calls] + ["}"]
        else:
            self.table.use("KIND")
            n = len(kinds)
            f.lines.append(f"for (int i = {n - 1}; i >= 0; --i) {{" if inward else f"for (int i = 0; i < {n}; ++i) {{")
            f.lines.append("    switch (link[i][KIND]) {")
            for kind in self.system.kinds:
                calls = call(kind.index, "i")
                if calls:
                    f.lines.append(f"    case {kind.index}: {calls[0]} break;")
            f.lines += ["    default: break;", "    }", "}"]
        if not any("(a" in line for line in f.lines):
            f.lines = ["(void)a;"]
        return f

    def sweep_functions(self, sweep: str) -> list[Function]:
        functions = [
            self.link_function(sweep, kind, block)
            for kind in self.system.kinds
            if (block := self.program.blocks[sweep].get(kind.index)) is not None and block.stores
        ]
        return [*functions, self.loop(sweep)]

    # -- constants and formulas ------------------------------------------------------------------------------------

    def rows_function(
        self,
        name: str,
        block: Block,
        place: Callable[[Callable[[int], str], str, str], tuple[str, str, int | str]],
        integers: list[list[int]],
        numbers: list[list[float]],
        call: str = "call",
    ) -> tuple[Function, str]:
        """A function for blocks that are the same but for table rows, and the statement that calls it for all rows.

        `place` gets a function that makes the C expression of an integer column.
        """
        single = len(integers) == 1
        plain = name.removeprefix("DIRECTIONS(").removesuffix(")")
        table = f"rows_of_{plain.removeprefix('d')}" if plain.startswith("d") else f"rows_of_{plain}"
        used: list[bool] = [False]

        def column(j: int) -> str:
            values = {row[j] for row in integers}
            if len(values) == 1:
                return str(values.pop())
            used[0] = True
            return f"{table}[i][{j}]"

        def located(array: str, field_: str) -> tuple[str, str, int | str]:
            if array == "k":
                return "k", f"numbers_of_{plain}[{0 if single else 'i'}]", int(field_)
            return place(column, array, field_)

        f = Function(block.title, f"static void {name}({call} *a{'' if single else ', int i'})")
        f.lines = self.writer.lines(block, located)
        if not single and not any("[i]" in line for line in f.lines):
            f.lines.insert(0, "(void)i;")
        if used[0] and not any(head.startswith(f"static const int {table}[") for head, _ in self.tables):
            head = f"static const int {table}[{len(integers)}][{len(integers[0])}]"
            self.tables.append((head, [", ".join(map(str, row)) for row in integers]))
        if any(a == "k" for a, _ in block.loads.values()):
            head = f"static const double numbers_of_{plain}[{len(numbers)}][{len(numbers[0])}]"
            self.tables.append((head, [", ".join(map(repr, row)) for row in numbers]))
        if single:
            return f, f"{name}(a);"
        return f, f"for (int i = 0; i < {len(integers)}; ++i) {name}(a, i);"

    def constants_functions(self) -> tuple[list[Function], list[str]]:
        """Functions that compute constants from parameters, and the calls."""
        functions, calls = [], []
        places = {name: i for i, name in enumerate(self.model.parameter_names)}
        for shape in self.system.shapes:
            if not shape.block.stores:
                continue
            rows = [c for c in self.system.constants if c.shape is shape]
            fields = self.layout.constant_fields[shape.index]

            def place(column: Callable[[int], str], array: str, name: str, f: Any = fields) -> tuple[str, str, int | str]:
                if array == "pc":
                    return "c", f"a->constants + {column(0)}", f[name]
                return "p", "a->p", column(1 + int(name))

            integers = [[self.layout.constant_offsets[c.index], *(places[p] for p in c.parameters)] for c in rows]
            f, call = self.rows_function(
                f"constants_{shape.index}", shape.block, place, integers, [list(c.numbers) for c in rows]
            )
            functions.append(f)
            calls.append(call)
        return functions, calls

    def formula_functions(self, target: str) -> dict[str, Any]:
        """Functions of the formulas of a target, for values and for tangents."""
        result: dict[str, Any] = {"functions": [], "lane_functions": [], "calls": [], "lane_calls": []}

        def place_formula(column: Callable[[int], str], array: str, name: str) -> tuple[str, str, int | str]:
            if array in (target, f"d{target}"):
                return array, f"a->{array}", column(0)
            if array in ("t", "dt"):
                return array, f"&a->{array}" if array == "t" else "a->dt", 0
            return array, f"a->{array}", column(1 + int(name))

        for kind in self.formulas:
            if kind.target != target:
                continue
            integers = [[i, *slots] for i, slots, _ in kind.rows]
            self._add_pair(result, f"{target}_{kind.index}", kind, place_formula, integers, [n for _, _, n in kind.rows])
        ground = len(self.system.links)
        layout = self.layout

        def place_record(column: Callable[[int], str], array: str, name: str) -> tuple[str, str, int | str]:
            if array in (target, f"d{target}"):
                return array, f"a->{array}", column(0)
            if array == "me":
                return array, f"a->records + RECORD*{column(1)}", layout.record[name]
            if array == "lane":
                return array, f"a->lanes + LANE_SIZE*{column(1)}", layout.lane[name]
            if array == "lme":
                return array, "a->slots", layout.slots["moment_tangents"][name]
            return array, f"a->{array}", column(2 + int(name))

        for record in self.records:
            if record.target != target:
                continue
            integers = [[i, ground if link == GROUND else link, *slots] for i, link, slots, _ in record.rows]
            numbers = [n for *_, n in record.rows]
            self._add_pair(result, f"{target}_of_link_{record.index}", record, place_record, integers, numbers)
        return result

    def _add_pair(self, result: dict[str, Any], name: str, kind: Any, place: Any, integers: Any, numbers: Any) -> None:
        f, call = self.rows_function(name, kind.value, place, integers, numbers)
        result["functions"].append(f)
        result["calls"].append(call)
        f, call = self.rows_function(f"DIRECTIONS(d{name})", kind.tangent, place, integers, numbers, "DIRECTIONS(call)")
        result["lane_functions"].append(f)
        result["lane_calls"].append(call)

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
            if name in ("W.xx", "W.yy", "W.zz"):
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
            value = self._gravity(g.shape.varying[name]) if name in g.shape.varying else repr(g.values.get(name, 0.0))
            lines.append(f"a->gravity[{i}] = {value};")
        return lines

    def _gravity(self, name: str) -> str:
        g = self.system.gravity
        assert g is not None
        index = self.layout.constant_offsets[g.index] + self.layout.constant_fields[g.shape.index][name]
        return f"a->constants[{index}]"

    def ground_tangent(self) -> tuple[list[str], list[str]]:
        """Lines that set the ground's tangent where gravity depends on parameters, and that set it to zero."""
        g = self.system.gravity
        lines: list[str] = []
        zero: list[str] = []
        places = {n: k for k, n in enumerate(self.model.parameter_names)}
        for name, i in self.layout.slots.get("balance_out", {}).items():
            if g is None or name not in g.shape.varying:
                continue
            terms = []
            for j, p in enumerate(g.parameters):
                key = f"{name}/{j}"
                factor = repr(float(g.shape.fixed[key])) if key in g.shape.fixed else ""
                if not factor and key in g.shape.varying:
                    factor = self._gravity(g.shape.varying[key])
                if factor:
                    terms.append(f"{factor}*a->dp[{places[p]}]")
            lines.append(f"a->slots[{i}] = {' + '.join(terms)};")
            zero.append(f"a->slots[{i}] = NOTHING;")
        return lines, zero

    # -- the files -------------------------------------------------------------------------------------------------

    def context(self) -> dict[str, Any]:
        """What the templates are rendered with."""
        model, layout, use = self.model, self.layout, self.uses
        blocks = self.program.blocks
        scalar = [f for s in blocks if not SWEEP[s].lanes for f in self.sweep_functions(s)]
        lanes = [f for s in blocks if SWEEP[s].lanes for f in self.sweep_functions(s)]
        constants, constant_calls = self.constants_functions()
        tau, outputs, energy = (self.formula_functions(t) for t in ("tau", "outputs", "energy"))
        size = sizes(model)
        ground_tangent, ground_tangent_rest = self.ground_tangent()
        links = len(self.system.links)
        state = ["q", "u"] + [n for n, name in (("p", "parameters"), ("inputs", "inputs")) if use[name]]
        regions = [
            ("records", "", len(layout.record) * (links + 1)),
            ("near", "", layout.near_size * self.system.slots),
            ("gravity", "", 3 if use["gravity"] else 0),
            ("constants", "", layout.constants_size),
            ("trig", "", 2 * layout.angles_padded),
            ("tau", "", model.nu if use["forces"] else 0),
            ("rest_u", "", model.nu),
            ("numbers_1", "", model.nu),
            ("numbers_2", "", model.nu),
            ("slots", "L", layout.slot_size * self.system.slots),
            ("lanes", "L", len(layout.lane) * links),
            ("dtau", "L", model.nu if use["forces"] else 0),
            ("lanes_1", "L", model.nu),
            ("lanes_2", "L", model.nu),
            *((f"rest_d{n}", "L", size[n]) for n in state),
            ("rest_dt", "L", int(use["time"])),
        ]
        at, placed = 0, []
        for name, kind, count in regions:
            if count:
                placed.append((name, kind == "L", at))
                at += -(-count * (8 if kind == "L" else 1) // 8) * 8
        functions = interfaces(self.system)
        scratch = max((sum(size[n] for n in f.seeds_sizes() + f.derived()) for f in functions if f.widths), default=0)
        self.workspace = at + 8 + scratch
        pointers = ["double *" + n for n in ("udot", "qdot", "force", "energy", "outputs")]
        sources = [f"const double *{n}" for n in state] + (["double t"] if use["time"] else [])
        seeds = [f"const LANES *d{n}" for n in state] + (["const LANES *dt"] if use["time"] else [])
        names = lambda declarations: [d.split()[-1].lstrip("*") for d in declarations]  # noqa: E731
        call_pointers = [*sources, *pointers, *(f"double *{n}" for n, lane, _ in placed if not lane)]
        lane_pointers = [
            *seeds,
            "const LANES *b",
            *(f"LANES *{n}" for n in ("dudot", "dqdot", "dforce", "denergy", "doutputs")),
            *(f"LANES *{n}" for n, lane, _ in placed if lane),
        ]
        return {
            "name": model.name,
            "NAME": model.name.upper(),
            "version": __version__,
            "nq": model.nq, "nu": model.nu, "np": len(model.parameters), "ninputs": len(model.inputs),
            "noutputs": len(model.outputs),
            "coordinates": model.coordinate_names, "speeds": model.speed_names,
            "parameters": model.parameters, "input_names": model.inputs, "outputs": model.outputs,
            "uses": use,
            "has": set(blocks),
            "quaternions": any(b.stores for b in blocks.get("rotations", {}).values()),
            "state": names(sources),
            "size": size,
            "constants_in_c": [
                ("LINKS", links), ("RECORD", max(1, len(layout.record))), ("NEAR_SIZE", max(1, layout.near_size)), ("SLOT_SIZE", max(1, layout.slot_size)),
                ("LANE_SIZE", max(1, len(layout.lane))), ("ANGLES", max(1, layout.angles_padded)),
            ],
            "workspace": self.workspace,
            "scratch": at,
            "regions": placed,
            "region_names": {n for n, _, _ in placed},
            "call_pointers": call_pointers, "call_names": names(call_pointers),
            "lane_pointers": lane_pointers,
            "columns": self.table.used, "link_rows": self.table.rows() if self.table.used else [],
            "numbers": [repr(v) for v in layout.numbers],
            "tables": self.tables,
            "angles": layout.angles,
            "angles_in_order": layout.angles == list(range(len(layout.angles))),
            "functions": constants + tau["functions"] + scalar + outputs["functions"] + energy["functions"],
            "lane_functions": tau["lane_functions"] + lanes + outputs["lane_functions"] + energy["lane_functions"],
            "constant_calls": constant_calls,
            "tau": tau, "output_formulas": outputs, "potential": energy,
            "energy_outputs": self.energy_outputs,
            "ground": self.gravity() + self.ground(),
            "ground_tangent": ground_tangent, "ground_tangent_rest": ground_tangent_rest,
            "interfaces": functions,
            "prototypes": [
                (f.comment if not w else f"{f.comment} Directions: {w}.", f.signature(model.name, w))
                for f in functions for w in (f.widths or (None,))
            ],
            "fallbacks": [fallback(f, model.name, w, size) for f in functions for w in f.widths if w > 1],
            "signature": {f.name: f.signature(model.name) for f in functions},
            "lane_signature": {
                f.name: f.signature(model.name).replace(f"{model.name}_{f.name}", f"DIRECTIONS({model.name}_{f.name})")
                for f in functions
            },
            "jacobian_groups": [(n, size[n]) for n in next(f for f in functions if f.name == "accelerations").arguments],
        }  # fmt: skip


def fallback(f: Interface, model: str, width: int, size: dict[str, int]) -> Function:
    """A function of several directions in plain C: one direction after the other."""
    result = Function(f"{f.comment} Directions: {width}.", f.signature(model, width))
    lines = result.lines
    at = 0
    pieces: list[tuple[str, int, int]] = []
    for name in [*f.seeds, *f.derived_names()]:
        n = size[name.removeprefix("d")]
        pieces.append((name, at, n))
        at += n
    lines.append("double *s = work + SCRATCH;")
    lines.append(f"for (int l = 0; l < {width}; ++l) {{")
    for name, offset, n in pieces:
        if name in f.seeds:
            lines.append(f"    for (int i = 0; i < {n}; ++i) s[{offset} + i] = {name}[{width}*i + l];")
    arguments = [*f.arguments, *(f"s + {o}" for name, o, _ in pieces if name in f.seeds)]
    places = {name: o for name, o, _ in pieces}
    arguments += [f"s + {places[r]}" if r in places else r for r in f.results]
    lines.append(f"    const int singular = {model}_{f.name}_1({', '.join([*arguments, 'work'])});")
    lines.append("    if (singular) return singular;")
    for name, offset, n in pieces:
        if name not in f.seeds:
            lines.append(f"    for (int i = 0; i < {n}; ++i) {name}[{width}*i + l] = s[{offset} + i];")
    lines += ["}", "return 0;"]
    return result


def call_type(sweep: str) -> str:
    return "DIRECTIONS(call)" if SWEEP[sweep].lanes else "call"


def stretches(kinds: list[int], longest: int = 8) -> list[tuple[int, tuple[int, ...], int]]:
    """Cut a sequence into repeated patterns: (start, pattern, repetitions). Greedy, linear in its length."""
    result: list[tuple[int, tuple[int, ...], int]] = []
    i, n = 0, len(kinds)
    while i < n:
        best, covered = 1, 1
        for period in range(1, longest + 1):
            j = i
            while j + period < n and kinds[j] == kinds[j + period]:
                j += 1
            total = (j - i) // period * period + period
            if total >= 2 * period and total > covered:
                best, covered = period, total
        result.append((i, tuple(kinds[i : i + best]), covered // best))
        i += covered
    return result


def write_c(context: dict[str, Any]) -> dict[str, str]:
    """The C files of a solver, by name."""
    name = context["name"]
    return {
        f"{name}.c": render("c/module.c.jinja", context),
        f"{name}_directions.h": render("c/directions.h.jinja", context),
        f"{name}.h": render("c/module.h.jinja", context),
    }


__all__ = ["WIDTHS", "CWriter", "write_c"]
