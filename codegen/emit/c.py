"""Writes the C of a solver: link functions, loops over links, tables, and the functions of the header.

Everything is prepared here as ready lines; the templates in ``templates/c`` put them in place.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from ..mechanics.expansion import Program
from ..mechanics.formulas import FormulaKind
from ..mechanics.joints import freedom_axes
from ..mechanics.kinds import LinkKind, System
from ..mechanics.sweeps import INWARD, SWEEPS
from ..model.model import GROUND
from ..program.block import Block
from .printer import C_FUNCTIONS, Printer
from .templates import render

__version__ = "0.1"

MAX_SEGMENTS = 24
"""More different stretches of links than this, and a sweep dispatches on the kind instead."""

LANE_ARRAYS = {"lme", "lup", "lane", "dq", "du", "dp", "dinputs", "dt", "dtau", "b", "dudot", "dforce"}


@dataclass(slots=True)
class Function:
    """A generated C function: comment, signature, ready lines."""

    comment: str
    signature: str
    lines: list[str] = field(default_factory=list)


class Columns:
    """The table of links: columns are added when something uses them."""

    def __init__(self, system: System, trig_of: list[int], constant_offsets: dict[int, int], number_offsets: list[int]):
        n = len(system.links)
        parents = [n if link.parent == GROUND else link.parent for link in system.links]
        parent_slots = [0 if link.parent == GROUND else system.slot_of[link.parent] for link in system.links]
        self.values: dict[str, list[int]] = {
            "KIND": [k.index for k in system.kind_of],
            "UP": parents,
            "Q": [link.q for link in system.links],
            "U": [link.u for link in system.links],
            "TRIG": trig_of,
            "CONSTANTS": [constant_offsets[c.index] for c in system.constants_of],
            "NUMBERS": number_offsets,
            "SLOT": system.slot_of,
            "UPSLOT": parent_slots,
        }
        places = {name: i for i, name in enumerate(system.model.parameter_names)}
        for j in range(max((len(c.parameters) for c in system.constants_of), default=0)):
            self.values[f"P{j}"] = [
                places[c.parameters[j]] if j < len(c.parameters) else 0 for c in system.constants_of
            ]
        self.used: list[str] = []

    def index(self, column: str, kind: LinkKind) -> str:
        """C expression of an entry of link i of a kind: a number where all its links agree."""
        entries = {self.values[column][i] for i in kind.members}
        if len(entries) == 1:
            return str(entries.pop())
        if column == "UP" and all(self.values["UP"][i] == i - 1 for i in kind.members):
            return "(i - 1)"
        for name in ("Q", "U", "TRIG"):
            if column == name and all(self.values[name][i] == i for i in kind.members):
                return "i"
        if column not in self.used:
            self.used.append(column)
        return f"link[i][{column}]"


class CWriter:
    """C source of a program.

    Parameters
    ----------
    program : Program
    formulas : list of FormulaKind
        Joint forces.
    """

    def __init__(self, program: Program, formulas: list[FormulaKind]):
        self.program = program
        self.system = program.system
        self.model = program.system.model
        self.formulas = formulas
        self.printer = Printer(C_FUNCTIONS)
        self.record = {name: i for i, name in enumerate(program.records)}
        self.lane = {name: i for i, name in enumerate(program.lanes)}
        self.slots = {sweep: {name: i for i, name in enumerate(fields)} for sweep, fields in program.slots.items()}
        self.slot_size = max((len(f) for f in program.slots.values()), default=0)
        self._constants()
        trig_of, count = [], 0
        for link in self.system.links:
            trig_of.append(count)
            count += link.joint == "revolute"
        self.angles = [link.q for link in self.system.links if link.joint == "revolute"]
        self.padded = -(-len(self.angles) // 8) * 8
        self.uses_time = any("t" in e.names for e in self.model.expressions())
        self.lay_out_workspace()
        self.columns = Columns(self.system, trig_of, self.constant_offsets, self.number_offsets)

    def _constants(self) -> None:
        """Where constants that depend on parameters lie, and the table of numbers of each link."""
        self.constant_fields: dict[int, dict[str, int]] = {}
        for shape in self.system.shapes:
            names = [name for _, name, _ in shape.block.stores]
            self.constant_fields[shape.index] = {n: i for i, n in enumerate(names)}
        self.constant_offsets: dict[int, int] = {}
        size = 0
        for c in self.system.constants:
            self.constant_offsets[c.index] = size
            size += len(self.constant_fields[c.shape.index])
        self.constants_size = size
        self.numbers: list[float] = []
        self.number_offsets = []
        rows: dict[tuple[float, ...], int] = {}
        for i in range(len(self.system.links)):
            kind, c = self.system.kind_of[i], self.system.constants_of[i]
            row = tuple(c.values.get(name, 0.0) for name in kind.data)
            if row not in rows:
                rows[row] = len(self.numbers)
                self.numbers += row
            self.number_offsets.append(rows[row])

    # -- link functions --------------------------------------------------------------------------------------------

    def place(self, kind: LinkKind, sweep: str, array: str, name: str) -> tuple[str, str, int | str]:
        """Pointer name, pointer expression and index of a field."""
        index = self.columns.index
        single = len(kind.members) == 1
        me = str(kind.members[0]) if single else "i"
        if array == "me":
            return array, f"a->records + RECORD*{me}", self.record[name]
        if array == "up":
            return array, f"a->records + RECORD*{index('UP', kind)}", self.record[name]
        if array in ("lme", "lup"):
            column = "SLOT" if array == "lme" else "UPSLOT"
            return array, f"a->slots + SLOT_SIZE*{index(column, kind)}", self.slots[sweep][name]
        if array == "lane":
            return array, f"a->lanes + LANE_SIZE*{me}", self.lane[name]
        if array in ("q", "dq"):
            return array, f"a->{array} + {index('Q', kind)}", int(name)
        if array in ("u", "du", "udot", "dudot", "tau", "dtau", "b", "force", "dforce"):
            return array, f"a->{array} + {index('U', kind)}", int(name)
        if array == "trig":
            return array, f"a->trig + {index('TRIG', kind)}", 0 if name == "cos" else "ANGLES"
        if array == "dp":
            return array, "a->dp", index(f"P{name}", kind)
        if array == "energy":
            return array, "a->energy", 0
        if array == "c":
            if name in kind.data:
                return "k", f"numbers + {index('NUMBERS', kind)}", kind.data[name]
            return "c", f"a->constants + {index('CONSTANTS', kind)}", self.constant_fields[kind.shape.index][name]
        raise KeyError(array)

    def link_function(self, sweep: str, kind: LinkKind, block: Block) -> Function:
        single = len(kind.members) == 1
        name = self.function_name(sweep, kind)
        call = "DIRECTIONS(call)" if is_lanes(sweep) else "call"
        argument = "a" if single else "a, int i"
        links = self.system.links
        who = links[kind.members[0]].name if single else f"{len(kind.members)} links, {links[kind.members[0]].name} ..."
        f = Function(f"{block.title}; {who}", f"static void {name}({call} *{argument})")
        body, pointers = self.body(block, lambda array, field_: self.place(kind, sweep, array, field_))
        f.lines = pointers + body
        return f

    def body(
        self, block: Block, place: Callable[[str, str], tuple[str, str, int | str]]
    ) -> tuple[list[str], list[str]]:
        """Statements of a block as C lines, and the pointers that they need."""
        written = {place(a, n)[0] + "_at" for a, n, _ in block.stores if a != "pivot"}
        pointers: dict[str, str] = {}
        body: list[str] = []

        def access(array: str, name: str) -> str:
            pointer, expression, i = place(array, name)
            pointer += "_at"
            if pointer not in pointers:
                type_ = "LANES" if array in LANE_ARRAYS else "double"
                const = "" if pointer in written else "const "
                pointers[pointer] = f"{const}{type_} *restrict {pointer} = {expression};"
            return f"{pointer}[{i}]"

        for symbol, (array, name) in block.loads.items():
            type_ = "LANES" if array in LANE_ARRAYS else "double"
            body.append(f"const {type_} {symbol} = {access(array, name)};")
        tag = ""
        for s in block.statements:
            comment = f" /* {s.tag} */" if s.tag and s.tag != tag else ""
            tag = s.tag
            body.append(f"const {'LANES' if s.lanes else 'double'} {s.target} = {self.printer(s.expression)};{comment}")
        for array, name, value in block.stores:
            if array == "pivot":
                body.append(f"if (!({self.printer(value)} > 0)) a->singular = {self._singular};")
            elif array in LANE_ARRAYS and value.is_Number:
                body.append(f"{access(array, name)} = NOTHING;" if value == 0 else f"{access(array, name)} = NOTHING + {self.printer(value)};")
            elif array == "energy":
                body.append(f"{access(array, name)} += {self.printer(value)};")
            else:
                body.append(f"{access(array, name)} = {self.printer(value)};")
        return body, list(pointers.values())

    def function_name(self, sweep: str, kind: LinkKind) -> str:
        return f"DIRECTIONS({sweep}_{kind.index})" if is_lanes(sweep) else f"{sweep}_{kind.index}"

    # -- sweeps ----------------------------------------------------------------------------------------------------

    def sweep(self, sweep: str) -> Function:
        """The loop over links of a sweep."""
        spec = next(s for s in SWEEPS if s.name == sweep)
        blocks = self.program.blocks[sweep]
        kinds = [k.index for k in self.system.kind_of]
        inward = spec.direction == INWARD
        segments = stretches(kinds)
        lines: list[str] = []

        def call(kind: int, argument: str) -> str | None:
            block = blocks.get(kind)
            if block is None or not block.stores:
                return None
            k = self.system.kinds[kind]
            name = self.function_name(sweep, k)
            return f"{name}(a);" if len(k.members) == 1 else f"{name}(a, {argument});"

        if len(segments) <= MAX_SEGMENTS or len(self.system.kinds) == len(kinds):
            if inward:
                segments = segments[::-1]
            for start, pattern, count in segments:
                offsets = range(len(pattern))
                calls = [call(pattern[o], f"i + {o}" if o else "i") for o in (reversed(offsets) if inward else offsets)]
                calls = [c for c in calls if c]
                if not calls:
                    continue
                if count == 1:
                    for c in calls:
                        single = c.replace("(a, i + ", f"(a, {start} + ").replace("(a, i)", f"(a, {start})")
                        lines.append(single)
                else:
                    end = start + len(pattern) * count
                    step = len(pattern)
                    if inward:
                        lines.append(f"for (int i = {end - step}; i >= {start}; i -= {step}) {{")
                    else:
                        lines.append(f"for (int i = {start}; i < {end}; i += {step}) {{")
                    lines += [f"    {c}" for c in calls] + ["}"]
        else:
            n = len(kinds)
            self.columns.used.append("KIND") if "KIND" not in self.columns.used else None
            lines.append(f"for (int i = {n - 1}; i >= 0; --i) {{" if inward else f"for (int i = 0; i < {n}; ++i) {{")
            lines.append("    switch (link[i][KIND]) {")
            for kind in self.system.kinds:
                c = call(kind.index, "i")
                lines.append(f"    case {kind.index}: {c + ' ' if c else ''}break;")
            lines += ["    default: break;", "    }", "}"]
        name = f"DIRECTIONS({sweep})" if spec.lanes else sweep
        return Function(spec.title, f"static void {name}({'DIRECTIONS(call)' if spec.lanes else 'call'} *a)", lines)

    def sweep_functions(self, sweep: str) -> list[Function]:
        functions = []
        for kind in self.system.kinds:
            block = self.program.blocks[sweep].get(kind.index)
            if block is not None and block.stores:
                self._singular = f"{kind.members[0]} + 1" if len(kind.members) == 1 else "i + 1"
                functions.append(self.link_function(sweep, kind, block))
        functions.append(self.sweep(sweep))
        return functions

    # -- the file --------------------------------------------------------------------------------------------------

    def context(self) -> dict[str, Any]:
        """What the templates are rendered with."""
        model, system = self.model, self.system
        scalar = [f for s in self.program.blocks if not is_lanes(s) for f in self.sweep_functions(s)]
        lanes = [f for s in self.program.blocks if is_lanes(s) for f in self.sweep_functions(s)]
        constants = self.constants_functions()
        formulas = self.formula_functions()
        start = Function("Constants, sines and cosines, joint forces: what depends on no other link", "static void start(call *a, double *work)")
        start.lines = self.start_lines(constants["calls"], formulas["calls"])
        columns = self.columns.used
        n = len(system.links)
        return {
            "name": model.name,
            "NAME": model.name.upper(),
            "version": __version__,
            "nq": model.nq, "nu": model.nu, "np": len(model.parameters), "ninputs": len(model.inputs),
            "parameter_names": model.parameter_names,
            "input_names": model.inputs,
            "workspace": self.workspace,
            "sizes": self.sizes,
            "call_pointers": self.call_pointers,
            "lane_pointers": self.lane_pointers,
            "columns": columns,
            "link_rows": [", ".join(str(self.columns.values[c][i]) for c in columns) for i in range(n)],
            "numbers": [repr(v) for v in self.numbers],
            "angles": len(self.angles),
            "tables": constants["tables"] + formulas["tables"] + self.angle_table(),
            "functions": constants["functions"] + formulas["functions"] + scalar + [start],
            "lane_functions": formulas["lane_functions"] + lanes,
            "api": self.api(),
        }  # fmt: skip

    # -- memory ----------------------------------------------------------------------------------------------------

    def lay_out_workspace(self) -> None:
        """Places of everything in the caller's workspace, in doubles, each on a cache line."""
        model, system = self.model, self.system
        regions = [
            ("records", len(self.record) * (len(system.links) + 1)),
            ("constants", self.constants_size),
            ("trig", 2 * self.padded),
            ("tau", model.nu if self.formulas else 0),
            ("slots", 8 * self.slot_size * system.slots),
            ("lanes", 8 * len(self.lane) * len(system.links)),
            ("dtau", 8 * model.nu if self.formulas else 0),
        ]
        self.offsets: dict[str, int] = {}
        at = 0
        for name, size in regions:
            if size:
                self.offsets[name] = at
                at += -(-size // 8) * 8
        self.scratch = at
        self.workspace = at + 8  # the caller's memory need not begin on a cache line
        self.sizes = [
            ("LINKS", len(system.links)),
            ("RECORD", max(1, len(self.record))),
            ("SLOT_SIZE", max(1, self.slot_size)),
            ("LANE_SIZE", max(1, len(self.lane))),
            ("ANGLES", max(1, self.padded)),
        ]
        self.call_pointers = ["const double *q", "const double *u"]
        if model.parameters:
            self.call_pointers.append("const double *p")
        if model.inputs:
            self.call_pointers.append("const double *inputs")
        if self.uses_time:
            self.call_pointers.append("double t")
        self.call_pointers += ["double *udot"]
        self.call_pointers += [f"double *{name}" for name in ("records", "constants", "trig", "tau") if name in self.offsets]
        self.lane_pointers = ["const LANES *dq", "const LANES *du"]
        if model.parameters:
            self.lane_pointers.append("const LANES *dp")
        if model.inputs:
            self.lane_pointers.append("const LANES *dinputs")
        if self.uses_time:
            self.lane_pointers.append("LANES dt")
        self.lane_pointers += ["LANES *dudot"]
        self.lane_pointers += [f"LANES *{name}" for name in ("slots", "lanes", "dtau") if name in self.offsets]

    def start_lines(self, constants: list[str], formulas: list[str]) -> list[str]:
        lines = ["work = (double *)(((uintptr_t)work + 63) & ~(uintptr_t)63);"]
        for name in ("records", "constants", "trig", "tau"):
            if name in self.offsets:
                lines.append(f"a->{name} = work + {self.offsets[name]};")
        lines.append("a->singular = 0;")
        lines += constants
        lines += self.ground()
        if self.angles:
            lines += [
                "double angle[ANGLES];" if self.padded <= 1024 else "double *angle = a->records;",
            ] if False else []
            source = "a->q[angle_of[i]]" if self.angles != list(range(len(self.angles))) else "a->q[i]"
            lines += [
                f"double *angle = a->trig + ANGLES;  /* the sines come here */",
                f"for (int i = 0; i < {len(self.angles)}; ++i) angle[i] = {source};",
            ]
            if self.padded != len(self.angles):
                lines.append(f"for (int i = {len(self.angles)}; i < ANGLES; ++i) angle[i] = 0.0;")
            lines.append("sines_and_cosines(ANGLES, a->trig);")
        lines += formulas
        if "rotations" in self.program.blocks and self.program.blocks["rotations"]:
            lines.append("rotations(a);")
        return lines

    def angle_table(self) -> list[tuple[str, list[str]]]:
        if self.angles and self.angles != list(range(len(self.angles))):
            return [(f"static const int angle_of[{len(self.angles)}]", [str(i) for i in self.angles])]
        return []

    # -- the functions of the header -------------------------------------------------------------------------------

    def state_arguments(self) -> list[str]:
        names = [p for p in self.call_pointers if p.split()[-1].lstrip("*") in ("q", "u", "p", "inputs", "t")]
        return names

    def api(self) -> list[Function]:
        state = self.state_arguments()
        fill = [f"a->{p.split()[-1].lstrip('*')} = {p.split()[-1].lstrip('*')};" for p in state]
        forward = ["kinematics(a);", "triangularize(a);", "if (a->singular) return a->singular;", "back_substitute(a);"]
        name = self.model.name
        functions = [
            Function(
                "Forward dynamics (Eqs. 18-24, 42-56).",
                f"int {name}_accelerations({', '.join([*state, 'double *udot', 'double *work'])})",
                ["call c, *a = &c;", *fill, "a->udot = udot;", "start(a, work);", *forward, "return 0;"],
            )
        ]
        for width in (8, 2, 1):
            seeds = [f"const double *d{p.split()[-1].lstrip('*')}" for p in state]
            lines = ["call c, *a = &c;", *fill, "a->udot = udot;", "start(a, work);", *forward]
            lines += [f"call_{width} d, *b = &d;"]
            for p in self.call_pointers:
                n = p.split()[-1].lstrip("*")
                lines.append(f"b->{n} = a->{n};")
            for p in state:
                n = p.split()[-1].lstrip("*")
                lines.append(f"b->dt = *(const lanes_{width} *)dt;" if n == "t" else f"b->d{n} = (const lanes_{width} *)d{n};")
            lines.append("work = (double *)(((uintptr_t)work + 63) & ~(uintptr_t)63);")
            for n in ("slots", "lanes", "dtau"):
                if n in self.offsets:
                    lines.append(f"b->{n} = (lanes_{width} *)(work + {self.offsets[n]});")
            lines.append(f"b->dudot = (lanes_{width} *)dudot;")
            for line in self.ground_slot():
                lines.append(line.replace("a->", "b->"))
            if self.formulas:
                lines.append(f"force_tangents_{width}(b);")
            if self.program.blocks.get("turns"):
                lines.append(f"turns_{width}(b);")
            lines += [f"balance_out_{width}(b);", f"balance_in_{width}(b);", f"balance_back_{width}(b);", "return 0;"]
            functions.append(
                Function(
                    f"Forward dynamics and its derivative along {width} seeds.",
                    f"int {name}_sensitivities_{width}({', '.join([*state, *seeds, 'double *udot', 'double *dudot', 'double *work'])})",
                    lines,
                )
            )
        return functions

    def formula_functions(self) -> dict[str, Any]:
        return {"functions": [], "lane_functions": [], "calls": [], "tables": []}

    def constants_functions(self) -> dict[str, Any]:
        """Functions that compute constants from parameters, and the calls."""
        functions, calls, tables = [], [], []
        places = {name: i for i, name in enumerate(self.model.parameter_names)}
        for shape in self.system.shapes:
            if not shape.block.stores:
                continue
            rows = [c for c in self.system.constants if c.shape is shape]
            fields = self.constant_fields[shape.index]
            single = len(rows) == 1
            int_row = f"constants_of_{shape.index}[i]"
            first = rows[0]

            def place(array: str, name: str) -> tuple[str, str, int | str]:
                if array == "pc":
                    base = str(self.constant_offsets[first.index]) if single else f"{int_row}[0]"
                    return "c", f"a->constants + {base}", fields[name]
                if array == "parameter":
                    index = str(places[first.parameters[int(name)]]) if single else f"{int_row}[{1 + int(name)}]"
                    return "p", "a->p", index
                return "k", f"numbers_of_{shape.index}[{'0' if single else 'i'}]", int(name)

            body, pointers = self.body(shape.block, place)
            f = Function(shape.block.title, f"static void constants_{shape.index}(call *a{'' if single else ', int i'})")
            f.lines = pointers + body
            functions.append(f)
            if any(array == "k" for array, _ in shape.block.loads.values()):
                tables.append(
                    (f"static const double numbers_of_{shape.index}[{len(rows)}][{shape.numbers}]",
                     [", ".join(repr(v) for v in c.numbers) for c in rows])
                )  # fmt: skip
            if single:
                calls.append(f"constants_{shape.index}(a);")
            else:
                tables.append(
                    (f"static const int constants_of_{shape.index}[{len(rows)}][{1 + shape.parameters}]",
                     [", ".join(map(str, [self.constant_offsets[c.index], *(places[p] for p in c.parameters)])) for c in rows])
                )  # fmt: skip
                calls.append(f"for (int i = 0; i < {len(rows)}; ++i) constants_{shape.index}(a, i);")
        return {"functions": functions, "calls": calls, "tables": tables}

    def ground(self) -> list[str]:
        """Lines that set the ground's record: at rest, accelerating by -g."""
        g = self.system.gravity
        lines = []
        for name in sorted(self.program.ground_fields, key=lambda n: self.record[n]):
            value = "0.0"
            plain = name.removeprefix("t")
            if name in ("W.xx", "W.yy", "W.zz"):
                value = "1.0"
            elif g is not None and plain in g.shape.fields:
                if plain in g.shape.varying:
                    field_ = self.constant_fields[g.shape.index][g.shape.varying[plain]]
                    value = f"a->constants[{self.constant_offsets[g.index] + field_}]"
                else:
                    value = repr(g.values.get(plain, 0.0))
            lines.append(f"a->records[RECORD*LINKS + {self.record[name]}] = {value};")
        return lines

    def ground_slot(self) -> list[str]:
        """Lines that set the ground's tangent, where gravity depends on parameters."""
        g = self.system.gravity
        lines: list[str] = []
        for name, i in self.slots.get("balance_out", {}).items():
            value = []
            if g is not None and name in g.shape.varying:
                places = {n: k for k, n in enumerate(self.model.parameter_names)}
                for j, p in enumerate(g.parameters):
                    key = f"{name}/{j}"
                    if key in g.shape.fixed:
                        factor = repr(float(g.shape.fixed[key]))
                    else:
                        field_ = self.constant_fields[g.shape.index][g.shape.varying[key]]
                        factor = f"a->constants[{self.constant_offsets[g.index] + field_}]"
                    value.append(f"{factor}*a->dp[{places[p]}]")
                lines.append(f"a->slots[{i}] = {' + '.join(value)};")
        return lines


def is_lanes(sweep: str) -> bool:
    return next(s.lanes for s in SWEEPS if s.name == sweep)


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
        if covered == 1:
            result.append((i, (kinds[i],), 1))
            i += 1
        else:
            result.append((i, tuple(kinds[i : i + best]), covered // best))
            i += covered
    return result


def write_c(program: Program, formulas: list[FormulaKind]) -> dict[str, str]:
    """The C files of a solver, by name."""
    context = CWriter(program, formulas).context()
    name = context["name"]
    return {
        f"{name}.c": render("c/module.c.jinja", context),
        f"{name}_directions.h": render("c/directions.h.jinja", context),
        f"{name}.h": render("c/module.h.jinja", context),
    }
