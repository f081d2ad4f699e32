"""Writes the C of a solver: functions of links, loops over links, tables.

Everything is prepared here as ready lines; the templates in ``templates/c`` put them in place and hold the functions
of the header.
"""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property, partial
from itertools import groupby
from types import MappingProxyType
from typing import Any

from ..mechanics import procedures
from ..mechanics.expansion import Program
from ..mechanics.fields import field_of, identifier
from ..mechanics.formulas import FormulaKind
from ..mechanics.outputs.outputs import RecordFormula, pivoted_outputs
from ..mechanics.stores import KEPT, LANE, MARGIN, ME, MODES, SLOT
from ..mechanics.structure.kinds import UnitKind
from ..mechanics.sweeps import FALLING, SWEEP
from ..model.model import Model
from ..program.block import Block, symbols_of
from ..program.expressions import Expr, Symbol
from ..program.field import AnyField
from ..program.parts import in_parts
from ..program.passes import by_results
from ..program.procedure import AllColumns, Columns, Own, Perform, Prepare, Primitives, Procedure, Run, within
from ..program.store import Store
from . import c_functions
from .c_functions import CFunctions, in_all
from .columns import ColumnsInC
from .divided import arrays_used, handed_on, in_stack, is_overwritten, linkage, reads, stack
from .function import COMMENT, Function, called_with, in_lines
from .libraries import guard_of_run, guard_of_width, sharing
from .printer import C_FUNCTIONS, Printer
from .states import over_states, states_context
from .templates import render
from .writer import Located, Place, Writer, called_for, called_once, notes, widest_first

TYPES = {
    "records": "link_record", "slots": "link_slot", "lanes": "link_lanes", "ears": "ear_record",
    "regions": "region_record", "region_lanes": "region_lanes", "couplings": "coupling_block", "kept": "link_kept",
    "kept_regions": "region_kept", "columns": "link_columns",
}  # fmt: skip
"""What a row of each region of memory is called."""

ABOUT = {
    "records": "A link, for one call.", "ears": "An ear of loops, for one call.",
    "regions": "A region of loops, for one call.", "couplings": "What couples two links.",
    "kept": "Scalars of a link that sweeps run backwards read again.",
    "kept_regions": "Scalars of a region that sweeps run backwards read again.",
    "lanes": "A link, for every direction.", "region_lanes": "A region of loops, for every direction.",
    "columns": "A link, for every column of a matrix.",
    "slots": "What links tell their neighbours, for every direction: memory that every sweep uses anew.",
}  # fmt: skip
"""What it is, for a comment."""

ENERGIES = ("KINETIC", "POTENTIAL")
"""Places in the array of energies."""

LANE_REGIONS = ("slots", "lanes", "region_lanes", "columns")
"""Regions with a value for every direction."""


NUMBER_TYPE = "number"
"""What tables of numbers consist of: they are the same where a double holds several states."""

UNUSED_WORK = ["(void)work;"]
"""Lines of a function that needs no memory."""

MEMBERS, COMMENTED = 100, 120
"""How long lines of members of structs are, and those with a comment."""


def stored_once(block: Block) -> set[Symbol]:
    """Symbols that what is stored for all directions together is made of."""
    if not any(store.lanes for store, _, _ in block.stores):
        return {*block.loads, *(s.target for s in block.statements)}
    wanted = {s for store, _, value in block.stores if not store.lanes for s in symbols_of(value)}
    for s in reversed(block.statements):
        if s.target in wanted:
            wanted |= symbols_of(s.expression)
    return wanted


@dataclass(frozen=True, slots=True)
class Type:
    """A type of rows of memory: what it is, struct or union, its lines, its name."""

    about: str
    kind: str
    lines: list[str]
    name: str


FEW_ANGLES = 16
"""Of so many angles sines wait for the last ones to be written, one by one; of more, most have been written long before."""

SHARES = {1: 3, 2: 2}
"""How many of the parts of long functions each unit of a library compiles: the second has more functions over directions."""


class CWriter(Writer):
    """C source of a program."""

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
        self.has_parts = False
        """Whether a function is divided."""
        self.lines_of_units = dict.fromkeys(SHARES, 0)
        """Lines of parts that each unit of a library compiles for both."""
        self.touched: dict[str, set[str]] = {}
        """By sweep: the regions of memory, arguments and results that it reads or writes."""

    # -- the language ----------------------------------------------------------------------------------------------

    def each(self, kinds: Sequence[UnitKind], sweep: str) -> str:
        groups = SWEEP[sweep].groups
        if not groups:
            return "EACH_VECTOR {"
        rows = [self.addresses.of_links(kind, sweep, ME, "NUMBER") for kind in kinds]
        link = self.addresses.expression(kinds, sweep, rows)
        if groups == "rest":
            return f"EACH_GROUP(a->all_groups & ~a->below_groups[{link}]) {{"
        return f"EACH_GROUP(a->{groups}_groups[{link}]) {{"

    def lines(
        self,
        block: Block,
        place: Place,
        culprit: Callable[[str], str] | None = None,
        each: str = "EACH_VECTOR {",
    ) -> list[str]:
        stored = {place(store, n) for store, n, _ in block.stores if store.memory is not MARGIN}
        written = {at.variable for at in stored}
        names = self.called_by(block, place)
        printer = self.printer.calling(names)
        taken = {s.name for s in block.loads} | {s.target.name for s in block.statements} | set(names.values())
        pointers: dict[str, str] = {}
        body: list[str] = []

        def access(store: Store, name: str) -> str:
            at = place(store, name)
            variable = f"{at.variable}_at" if at.variable in taken else at.variable
            if variable not in pointers:
                const = "" if at.variable in written else "const "
                pointers[variable] = f"{const}{at.type} *restrict {variable} = {at.row};"
            return f"{variable}{at.text}{'.at[h]' if store.lanes else ''}"

        # Before the loop over vectors stands what is stored once for all directions. Other numbers that they share stay in
        # the order of the block: compilers take them out of the loop, and know better which to keep in registers.
        passes: list[str] = []
        shared = stored_once(block)
        tags = {False: "", True: ""}
        overwritten = {(at.row, at.text) for at in stored}
        waiting: dict[Symbol, tuple[int, list[str], str]] = {}
        soon: list[Symbol] = []
        for number, (symbol, (store, name)) in enumerate(block.loads.items()):
            at = place(store, name)
            lines = body if symbol in shared or (not store.lanes and at in stored) else passes
            value = access(store, name)
            if at.type == NUMBER_TYPE:
                value = in_all(value)
            if store is MODES:
                value = f"MODE({value.partition('[')[0]}, {value})"
            type_ = "VECTOR" if store.lanes else "double"
            waiting[symbol] = number, lines, f"const {type_} {names.get(symbol.name, symbol.name)} = {value};"
            soon += [symbol] if (at.row, at.text) in overwritten else []

        def load(symbols: Iterable[Symbol]) -> None:
            """Load what has not been loaded yet."""
            for _, lines, line in sorted(waiting.pop(s) for s in symbols if s in waiting):
                lines.append(line)

        # What is needed late is loaded late: compilers keep the order, and move hundreds of values to the stack and back
        # otherwise, in quadratic time.
        load(soon)
        # blocks over directions keep their order: they gain nothing by another
        along = any(store.lanes for store, _, _ in block.stores)
        for statements, stores in [(block.statements, block.stores)] if along else by_results(block):
            for s in statements:
                load(symbols_of(s.expression))
                first = s.target in shared
                comment = f" /* {s.tag} */" if s.tag and s.tag != tags[first] else ""
                tags[first] = s.tag
                text = in_all(printer(s.expression)) if _is_number(s.expression) else printer(s.expression)
                (body if first else passes).append(
                    f"const {'VECTOR' if s.lanes else 'double'} {s.target} = {text};{comment}"
                )
            for store, name, value in stores:
                load(symbols_of(value))
                text = printer(value)
                if store.memory is MARGIN:
                    assert culprit is not None
                    text = in_all(text) if _is_number(value) else text
                    body.append(f"REQUIRE({text} > 0.0, {culprit(name)} + 1);")
                    continue
                if store.lanes and value.is_Number:
                    text = "(VECTOR){0}" if value == 0 else f"(VECTOR){{0}} + {text}"
                elif _is_number(value):
                    text = in_all(text)
                line = f"{access(store, name)} {'+=' if store.adds else '='} {text};"
                (passes if store.lanes else body).append(line)
        if passes:
            passes = [each, *(f"    {line}" for line in passes), "}"]
        return [*pointers.values(), *body, *passes]

    def link_functions(self, sweep: str, kinds: tuple[UnitKind, ...]) -> list[Function]:
        block = self.program.blocks[sweep][kinds[0].index]
        place = cache(partial(self.place, kinds, sweep))
        parts, places = in_parts(block, handed_on, is_overwritten(block, place))
        if len(parts) == 1:
            return [self.link_function(sweep, kinds)]
        self.has_parts = True
        lanes, indexed = SWEEP[sweep].lanes, len(self.instances(kinds, sweep)) != 1
        name = f"{sweep}_{kinds[0].index}"
        whole = Function(
            f"{block.title}; {self.called(kinds)}", self.signature(name, lanes, indexed), stack(places), notes(block)
        )
        shared = "" if lanes else self.shared_by_units(sweep)  # functions over directions are in one unit each
        culprit, each = self.addresses.culprit(kinds, sweep), self.each(kinds, sweep)
        functions = []
        for i, part in enumerate(parts, 1):
            lines, used = self.lines(part, in_stack(place), culprit, each), arrays_used(part)
            parameters = [("a", "REQUIRE"), *([("i", "")] if indexed else [])]
            lines = [*(f"(void){n};" for n, by in parameters if not reads(lines, n, by)), *lines]
            called = f"{name}_part_{i}"
            whose = "PART" if shared else "STATIC_PART"
            f = Function(
                f"part {i} of {name}", self.signature(called, lanes, indexed, whose, used), lines, declared=bool(shared)
            )
            if shared:
                unit = min(SHARES, key=lambda n: (self.lines_of_units[n] / SHARES[n], n))
                self.lines_of_units[unit] += len(lines)
                f.guard = f"!{shared} || ORDERNM_UNIT == {unit}"
            functions.append(f)
            arguments = [*(n for n, _ in parameters), *(n for _, n in used)]
            whole.lines.append(f"{_function(called, lanes)}({', '.join(arguments)});")
        functions[0].before = linkage(shared) if shared else []
        return [*functions, whole]

    @cached_property
    def all_widths(self) -> dict[str, tuple[int, ...]]:
        """For how many directions at once each function is written."""
        return {p.name: widest_first(p) for p in self.asked}

    @cached_property
    def runs(self) -> dict[str, dict[int | None, dict[str, set[int]]]]:
        """Which functions run something, by its name and width; of each function for how many directions at once."""
        found: dict[str, dict[int | None, dict[str, set[int]]]] = {}
        for p in self.asked:
            for name in called_once(p):
                found.setdefault(name, {}).setdefault(None, {})[p.name] = {*self.all_widths[p.name]}
            for (name, width), its_widths in called_for(p).items():
                found.setdefault(name, {}).setdefault(width, {})[p.name] = its_widths
        return found

    def where_run(self, named: Iterable[tuple[str, list[Function]]]) -> list[Function]:
        found: list[Function] = []
        for condition, several in groupby(named, lambda x: self.condition(*x)):
            functions = [f for _, of in several for f in of]
            if condition and functions:
                lines = textwrap.wrap(f"#if {condition}", COMMENT, subsequent_indent="    ")
                functions[0].before = [*(f"{line} \\" for line in lines[:-1]), lines[-1], *functions[0].before]
                functions[-1].after = ["#endif"]
            found += functions
        return found

    def condition(self, name: str, functions: list[Function]) -> str:
        """When the functions of a sweep, of formulas or of a routine are compiled; nothing if always."""
        if name not in self.runs:
            return ""
        shared = any(f.declared for f in functions)
        return guard_of_run(self.runs[name], self.all_widths, shared)

    def shared_by_units(self, sweep: str) -> str:
        """The condition under which units of a library share the parts of a sweep."""
        return sharing(self.runs[sweep][None], self.all_widths)

    def signature(
        self, name: str, lanes: bool, indexed: bool, whose: str = "static void", arrays: Sequence[tuple[str, str]] = ()
    ) -> str:
        type_ = "DIRECTIONS(call)" if lanes else "call"
        parameters = [f"{type_} *a", *(["int i"] if indexed else []), *(f"{t} *{n}" for t, n in arrays)]
        return f"{whose} {_function(name, lanes)}({', '.join(parameters)})"

    def call(self, name: str, lanes: bool, index: str | None) -> str:
        return f"{_function(name, lanes)}(a{'' if index is None else f', {index}'});"

    def repeat(self, start: int, end: int, step: int, inward: bool, calls: list[str]) -> list[str]:
        if inward:
            head = f"for (int i = {end - step}; i >= {start}; i -= {step}) {{"
        else:
            head = f"for (int i = {start}; i < {end}; i += {step}) {{"
        return [head, *(f"    {c}" for c in calls), "}"]

    def dispatch(self, count: int, inward: bool, entry: str, calls: list[tuple[list[int], str]]) -> list[str]:
        lines = [f"for (int i = {count - 1}; i >= 0; --i) {{" if inward else f"for (int i = 0; i < {count}; ++i) {{"]
        lines.append(f"    switch ({entry}) {{")
        lines += [f"    {' '.join(f'case {kind}:' for kind in kinds)} {call} break;" for kinds, call in calls]
        return [*lines, "    default: break;", "    }", "}"]

    def repeat_rows(self, name: str, lanes: bool, count: int) -> list[str]:
        return [f"for (int i = 0; i < {count}; ++i) {_function(name, lanes)}(a, i);"]

    def add_table(self, name: str, rows: list[list[int]] | list[list[float]]) -> None:
        type_ = "int" if isinstance(rows[0][0], int) else NUMBER_TYPE
        head = f"static const {type_} {name}[{len(rows)}][{len(rows[0])}]"
        if head not in (h for h, _ in self.tables):
            self.tables.append((head, [", ".join(map(repr, row)) for row in rows]))

    def loop(self, sweep: str) -> Function:
        f = super().loop(sweep)
        f.lines = self.ground(sweep) + f.lines or ["(void)a;"]
        return f

    def unused_index(self) -> list[str]:
        return ["(void)i;"]

    # -- places ----------------------------------------------------------------------------------------------------

    def element(self, array: str, index: str, lanes: bool = False) -> Located:
        type_ = "LANES" if lanes else "double"
        if array in ("energy", "denergy") and index.isdigit():
            index = ENERGIES[int(index)]
        start = "&a->t" if array == "t" else f"a->{array}"
        return Located(array, start, f"[{index}]", type_, self.names_of(array, index))

    def in_row(self, variable: str, region: str, row: str, sweep: str, name: str) -> Located:
        """Where a component lies in a row of memory that is laid out."""
        if region == "near":
            # numbers, not a struct: where compilers can tell these from records, they move loads until registers are short
            place = f"[{near_name(self.layout.near_forms[sweep], name)}]"
            return Located(
                variable,
                f"a->near + NEAR_SIZE*({row})" if " " in row else f"a->near + NEAR_SIZE*{row}",
                place,
                "double",
            )
        start, type_ = f"&a->{region}[{row}]", TYPES[region]
        if region in LANE_REGIONS:
            type_ = f"DIRECTIONS({type_})"
        # through the union, so that compilers see that sweeps share this memory
        of = f"{self.layout.slot_forms[sweep]}." if region == "slots" else ""
        return Located(variable, start, f"->{of}{identifier(name)}", type_)

    def field_of_record(self, store: Store, link: str, name: str) -> Located:
        variable = store.label.replace("#", "_")
        if store.memory is SLOT:
            return self.in_row(variable, "slots", "0", "moment_tangents", name)
        return self.in_row(variable, "lanes" if store.memory is LANE else "records", link, "", name)

    def constant(self, shape: int, constants: str, name: str) -> Located:
        return self.in_constants("c", constants, self.layout.forms[shape], name)

    def in_constants(self, variable: str, row: str, form: int, name: str) -> Located:
        """Where a constant lies: they begin at a row."""
        type_ = f"constants_of_shape_{form}"
        return Located(variable, f"({type_} *)(a->constants + {row})", f"->{identifier(name)}", type_)

    def place_of_constants(self, index: int) -> int:
        return self.layout.constant_offsets[index]

    def number_of_row(self, table: str, row: str, index: int) -> Located:
        return Located("k", f"{table}[{row}]", f"[{index}]", NUMBER_TYPE)

    def place(self, kinds: Sequence[UnitKind], sweep: str, store: Store, name: str) -> Located:
        at = self.addresses.placed(kinds, sweep, store, name)
        self.touched.setdefault(sweep, set()).add(at.region)
        if at.region in TYPES or at.region == "near":
            return self.in_row(at.variable, at.region, at.row, sweep, name)
        if at.region == "constants":
            return self.in_constants(at.variable, at.row, at.form, name)
        if at.region == "numbers":
            self.reads_numbers = True
            return Located(at.variable, f"numbers + {at.row}", f"[{at.component}]", NUMBER_TYPE)
        if at.region == "trig":
            return Located(at.variable, f"a->trig + {at.row}", "[COSINE]" if name == "cos" else "[SINE]", "double")
        type_ = "LANES" if store.lanes else "double"
        if at.row.isdigit() or not at.row:
            index = str(int(at.row or 0) + int(at.component)) if at.component.isdigit() else at.component
            return replace(self.element(at.region, index, store.lanes), variable=at.variable)
        return Located(at.variable, f"a->{at.region} + {at.row}", f"[{at.component}]", type_)

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
                region, place = "near", f"a->near[{near_name(self.layout.near_forms[sweep], name)}]"
            elif name in kept:
                region, place = "kept", f"a->kept[LINKS].{identifier(name)}"
            elif not sweep and name in self.layout.record:
                region, place = "records", f"a->records[LINKS].{identifier(name)}"
            else:
                continue
            self.touched.setdefault(sweep or "", set()).add(region)
            value = in_all("0.0")
            if name.endswith(("W.xx", "W.yy", "W.zz")):
                value = in_all("1.0")
            elif name in self.system.fields_of_gravity:
                value = f"a->gravity[{'xyz'.index(name[-1])}]"
                self.touched[sweep or ""].add("gravity")
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
            lines.append(f"a->gravity[{i}] = {value if value.startswith('a->') else in_all(value)};")
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
            place = f"{self._ground_slot()}.{identifier(name)}"
            text = " + ".join(f"{self._gravity(factor)}*a->dp[{p}].at[h]" for factor, p in terms) or "(VECTOR){0}"
            lines.append(f"EACH_VECTOR {place}.at[h] = {text};")
            zero.append(f"{place} = NOTHING;")
        return lines, zero

    def _ground_slot(self) -> str:
        forms = self.layout.slot_forms  # those of all these sweeps are alike
        return f"a->slots[0].{next(forms[s] for s in FALLING if s in forms)}"

    def ground_transposed(self) -> list[str]:
        """Lines that add to adjoints of parameters what those of the ground's tangent give."""
        return [
            f"EACH_VECTOR a->dp[{p}].at[h] += {self._gravity(factor)}*{self._ground_slot()}.{identifier(name)}.at[h];"
            for name, terms in self.ground_tangents()
            for factor, p in terms
        ]

    # -- the files -------------------------------------------------------------------------------------------------

    @property
    def few_angles(self) -> bool:
        """Whether angles are few enough to be named one by one."""
        return len(self.layout.angles) + len(self.layout.driven_angles) <= FEW_ANGLES

    def sines(self) -> list[str]:
        """Templates of what sines and cosines take."""
        if not self.layout.angles_padded or not self.prepares(procedures.ANGLES):
            return []
        return [
            "c/angles_at_once.c.jinja", *(["c/put_angles.c.jinja"] if self.few_angles else []), "c/sincos.c.jinja"
        ]  # fmt: skip

    def prepared(self, what: str) -> list[str]:
        layout = self.layout
        angles, driven = layout.angles, layout.driven_angles
        free, n = len(angles), len(angles) + len(driven)
        match what:
            case procedures.CONSTANTS:
                return self.constants[1]
            case procedures.GROUND:
                return self.gravity() + self.ground()
            case procedures.ANGLES if n and self.few_angles:
                each = [*(f"a->q[{i}]" for i in angles), *(f"a->prescribed[{i}]" for i in driven)]
                each = [f"{x} + {in_all(repr(v))}" if v else x for x, v in zip(each, layout.added_angles, strict=True)]
                each += [in_all("0.0")] * (-n % 4)
                return [
                    *(f"PUT_ANGLES(a->trig + ANGLES + {i}, {', '.join(each[i : i + 4])});" for i in range(0, n, 4)),
                    f"sines_and_cosines({n}, a->trig);",
                ]
            case procedures.ANGLES if n:
                angle = "i" if angles == list(range(free)) else "angle_of[i]"
                places = f"a->trig[ANGLES + {free} + i] = a->prescribed[driven_angle_of[i]];"
                return [
                    *([f"for (int i = 0; i < {free}; ++i) a->trig[ANGLES + i] = a->q[{angle}];"] if angles else []),
                    *([f"for (int i = 0; i < {n - free}; ++i) {places}"] if driven else []),
                    *(
                        [f"for (int i = 0; i < {n}; ++i) a->trig[ANGLES + i] += added_angle[i];"]
                        if any(layout.added_angles)
                        else []
                    ),
                    f"for (int i = {n}; i < ANGLES; ++i) a->trig[ANGLES + i] = {in_all('0.0')};",
                    f"sines_and_cosines({n}, a->trig);",
                ]
            case procedures.GROUND_AT_REST if self.system.gravity is not None:
                record = [line for line in self.ground() if "gravity" in line]
                return [f"for (int i = 0; i < 3; ++i) a->gravity[i] = {in_all('0.0')};", *record]
            case procedures.GROUND_TANGENT:
                return self.ground_tangent()[0]
            case procedures.GROUND_TANGENT_AT_REST:
                return self.ground_tangent()[1]
            case procedures.GROUND_TANGENT_TRANSPOSED:
                return self.ground_transposed()
            case procedures.ADJOINTS | procedures.PASSING_ADJOINTS:
                return [
                    f"for (long i = 0; i < {n}L; ++i) {f'((LANES *)a->{name})' if name in TYPES else f'a->{name}'}[i] = NOTHING;"
                    for name, lanes, n in self.regions()
                    if lanes and name != "columns" and (name != "lanes" or what == procedures.ADJOINTS)
                ]
        return []

    def regions(self) -> list[tuple[str, bool, int]]:
        """What sweeps keep in the workspace: name, whether per direction, number of entries."""
        layout, model, regions = self.layout, self.model, self.system.regions
        links, forced = len(self.system.links), model.nu if model.forces else 0
        # sweeps that only NumPy runs, column by column, have no slots here
        slot_size = max((len(of) for sweep, of in layout.slots.items() if sweep in self.blocks), default=0)
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
            *((name, False, n) for name, n in self.system.arrays.items()),
            *self.columns.regions(len(layout.column), links),
            ("slots", True, slot_size * self.system.slots),
            ("lanes", True, len(layout.lane) * links),
            ("region_lanes", True, len(layout.region_lane) * len(regions.regions)),
            ("dtau", True, forced),
            *((f"d{name}", True, n) for name, n in self.system.arrays.items()),
        ]
        return [r for r in found if r[2]]

    @staticmethod
    def _type(region: str, lanes: bool) -> str:
        """What a region of memory consists of."""
        type_ = TYPES.get(region, "LANES" if lanes else "double")
        return f"DIRECTIONS({type_})" if region in LANE_REGIONS else type_

    def types(self, lanes: bool) -> list[Type]:
        """Types of rows of memory, of values or of what is per direction."""
        layout, number = self.layout, "LANES" if lanes else "double"
        found: list[Type] = []

        def add(about: str, name: str, lines: list[str], kind: str = "struct") -> None:
            attribute = "DIRECTIONS(ALIASES) " if lanes else ""
            found.append(Type(about, kind, lines, f"{attribute}{_of_width(name, lanes)}"))

        if not lanes:
            for form, constants in layout.constant_fields.items():
                if constants and layout.forms[form] == form:
                    about = "Constants of one shape; _d0: derivative by the first parameter that they depend on."
                    add(about, f"constants_of_shape_{form}", members(constants, number))
        else:
            chosen = self.used_forms(layout.slot_forms, layout.slots)
            for sweep, users in chosen.items():
                add(f"In {', '.join(users)}.", f"slot_{sweep}", members(layout.slots[sweep], number))
            if chosen:
                lines = [f"{_of_width(f'slot_{sweep}', lanes)} {sweep};" for sweep in chosen]
                add(ABOUT["slots"], TYPES["slots"], lines, "union")
        kept = {
            "records": layout.record, "ears": layout.ear, "regions": layout.region, "couplings": layout.coupling,
            "kept": layout.kept, "kept_regions": layout.kept_region, "lanes": layout.lane,
            "region_lanes": layout.region_lane, "columns": layout.column,
        }  # fmt: skip
        for region, fields in kept.items():
            if fields and (region in LANE_REGIONS) == lanes:
                add(ABOUT[region], TYPES[region], members(fields, number))
        return found

    def used_forms(self, forms: dict[str, str], fields: dict[str, dict[str, int]]) -> dict[str, list[str]]:
        """What sweeps tell neighbours: the first sweep with some fields, and all that have these."""
        users = {f: [s for s, of in forms.items() if of == f and s in self.blocks] for f in forms if fields[f]}
        return {sweep: found for sweep, found in users.items() if found}

    def near_names(self) -> list[tuple[str, list[str]]]:
        """Places in the memory that links share with their neighbours, by sweep: who uses them, lines of an enum."""
        layout = self.layout
        return [
            (f"In {', '.join(users)}.", members(layout.near[sweep], "", ",", partial(near_name, sweep)))
            for sweep, users in self.used_forms(layout.near_forms, layout.near).items()
        ]

    def laid_out(self, procedure: Procedure, places: dict[str, int]) -> list[str]:
        """Lines that give a call the memory of the workspace: all of it, or what a few sweeps need."""
        if lays_out(procedure):
            return ["lay_out(&c, work);"]
        touched = set[str]().union(*(self.touched.get(s.sweep, ()) for s in procedure.steps if isinstance(s, Run)))
        lines = [f"c.{name} = {_cast(name)}(aligned(work) + {at});" for name, at in places.items() if name in touched]
        return lines if lines or procedure.seeds else UNUSED_WORK

    def context(self) -> dict[str, Any]:
        """What the templates are rendered with."""
        model, layout = self.model, self.layout
        context = self.shared_context()
        found = context["interfaces"]
        places: dict[str, int] = {}
        at = 0
        memory = c_functions.memory(found)
        switching = bool(model.switches.found)
        if switching:  # functions that nobody calls with modes read that there are none
            memory.fields.setdefault(MODES.name, False)
        _ = self.swept
        of_sweeps = self.regions()
        own = [("own", False, memory.size)] if memory.size else []
        # the call's own arrays before the lanes: behind them they would cost some functions a tenth
        regions = [*(r for r in of_sweeps if not r[1]), *own, *(r for r in of_sweeps if r[1])]
        for name, lanes, count in regions:
            places[name] = at
            at += -(-count * (8 if lanes else 1) // 8) * 8
        kept = {name: lanes for name, lanes, _ in regions}
        self.workspace = at + 8
        columns = {r[0] for r in self.columns.regions(len(layout.column), len(self.system.links))}
        self.memory_of_sweeps = sum(n * (8 if lanes else 1) for name, lanes, n in of_sweeps if name not in columns)
        types = {name: self._type(name, lanes) for name, lanes in kept.items()}
        fields, lane_fields = memory.declarations({n: t for n, t in types.items() if not kept[n]},
                                                  {n: t for n, t in types.items() if kept[n]})  # fmt: skip
        in_workspace = {name: at for name, at in places.items() if not kept[name]}
        lines = CFunctions(model.name, memory, self.prepared, lambda p: self.laid_out(p, in_workspace))
        of_columns = self.columns.width
        used = sorted({w for widths in self.sets_of_widths for w in widths}, key=lambda w: (w != of_columns, w))
        apart = sorted({w for f in found for w in f.apart})
        states = over_states(found)
        public = [f for f in found if not f.internal]
        of_width = [(f, w) for f in public for w in (f.widths or (None,))]
        return context | {
            "NAME": model.name.upper(),
            "about_names": about_names(bool(model.loops)),
            "legend": legend(model, len(self.system.links)),
            "sizes_in_c": [
                ("LINKS", len(self.system.links)),
                *([("NEAR_SIZE", layout.near_size)] if layout.near_size else []),
                *((("ANGLES", layout.angles_padded), ("COSINE", 0), ("SINE", "ANGLES")) if layout.angles_padded else ()),
                *((name, i) for i, name in enumerate(ENERGIES) if "energy" in memory.fields),
            ],
            "near_names": self.near_names(), "types": self.types(False), "lane_types": self.types(True),
            "workspace": self.workspace,
            "fields": fields, "lane_fields": [*lane_fields, *self.columns.members()], "columns": self.columns,
            "value_places": [(n, f"{_cast(n)}(work + {at})" if n in TYPES else f"work + {at}")
                             for n, at in in_workspace.items()],
            "headers": ["string.h"] if self.columns.symmetric else [],
            "column_types": ["c/column_types.c.jinja"] if self.columns.width else [],
            "lane_places": [(n, f"({types[n]} *)(work + {at})") for n, at in places.items() if kept[n]],
            "tables": [*self.flat_tables(), *((head, [f"{{{row}}}," for row in rows]) for head, rows in self.tables)],
            "part_files": ["c/parts.c.jinja"] if self.has_parts else [],
            "sines": self.sines(),
            "routines": self.where_run((r.name, [lines.routine(r)]) for r in context["routines"]),
            "lane_functions": [(*guard(widths, used), functions) for widths, functions in context["lane_functions"] if functions],
            "lane_routines": [
                (*guard(widths, used), functions)
                for widths, of in context["lane_routines"]
                if (functions := self.where_run((r.name, [lines.routine(r)]) for r in of))
            ],
            "lane_interfaces": [
                (*guard(widths, used), functions)
                for widths in self.sets_of_widths
                if (functions := [of for f in found if widest_first(f) == widths for of in lines.functions(f)])
            ],
            "inclusions": self.inclusions(used, apart, states),
            "ends": ["#endif"] if apart or states else [],
            "before_one_state": ["#ifndef ORDERNM_STATES"] if states else [],
            "after_one_state": ["#endif"] if states else [],
            **states_context(lines, states, self.workspace),
            "sweep_files": [
                *(["c/aligned.c.jinja"] if used or any(_reads_work(lines.laid_out(p)) for p in found) else []),
                *(["c/lay_out.c.jinja"] if any(map(lays_out, found)) else []),
            ],
            "matrix_files": [
                *(["c/component.c.jinja"] if any(map(fills_lanes, found)) else []),
                *(["c/columns.c.jinja"] if self.columns.width else []),
            ],
            "header_functions": [of for f in found if not f.seeds for of in lines.functions(f)],
            "prototypes": [(Function(f.doc, "").head, c_functions.signatures(f, model.name)) for f in found],
            "mode_words": ["c/modes.c.jinja"] if switching else [],
            "batch_arrays": [
                (type_, called_with("", names, ";").split("\n"))
                for type_, names in zip(("given", "rows"), c_functions.batch_arrays(public), strict=True)
                if names
            ],
            "batches": [
                Function(
                    "",
                    c_functions.batch_signature(f, model.name, w),
                    c_functions.batch_lines(f, model.name, w),
                    guard=guard_of_width(f.name, w),
                )
                for f, w in of_width
            ],
            "own_words": [f"c/{w}.c.jinja" for w in self.printer.words],
            "own_words_of_states": [f"c/{w}_of_states.c.jinja" for w in self.printer.words],
            "along_words": ["c/along.c.jinja"] if "Along" in self.printer.own else [],
            "along_widths": sorted({8, 2, *([of_columns] if of_columns else [])} - {1, 4}),
        }  # fmt: skip

    def inclusions(self, used: list[int], apart: list[int], states: list[Procedure]) -> list[str]:
        """Lines that include the functions over directions, by what the file that includes this one wants."""
        name, lines = self.model.name, []
        if states:
            lines += [
                "#if defined(ORDERNM_STATES)",
                *inclusions(name, [max(procedures.WIDTHS)] if any(f.seeds for f in states) else []),
            ]
        if apart:
            lines += [f"#{'el' if lines else ''}if defined(ORDERNM_APART)", *inclusions(name, apart)]
        lines += ["#else"] if lines else []
        guards = {self.columns.width: self.columns.guard}
        return [*lines, *inclusions(name, [w for w in used if w not in apart], guards)]

    def flat_tables(self) -> list[tuple[str, list[str]]]:
        """Declarations and lines of tables without rows: numbers; coordinates that are angles if they are not the first."""
        numbers, angles = [repr(v) for v in self.layout.numbers], self.layout.angles
        found = (
            [(f"static const {NUMBER_TYPE} numbers[{len(numbers)}]", in_lines(numbers, 6))]
            if self.reads_numbers
            else []
        )
        listed = self.prepares(procedures.ANGLES) and not self.few_angles
        if listed and angles != list(range(len(angles))):
            found.append((f"static const int angle_of[{len(angles)}]", in_lines(list(map(str, angles)), 16)))
        if listed and (driven := self.layout.driven_angles):
            found.append((f"static const int driven_angle_of[{len(driven)}]", in_lines(list(map(str, driven)), 16)))
        if listed and any(added := self.layout.added_angles):
            found.append((f"static const {NUMBER_TYPE} added_angle[{len(added)}]", in_lines(list(map(repr, added)), 6)))
        return found + self.columns.tables()

    @cached_property
    def columns(self) -> ColumnsInC:
        """What computes all columns of matrices at once."""
        return ColumnsInC(self.asked)


def legend(model: Model, links: int) -> list[str]:
    """Lines that say what arguments and results are."""

    def some(names: Sequence[str]) -> str:
        return " ".join(names[:12]) + (" ..." if len(names) > 12 else "") or "none"

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
    if model.switches.found:
        lines.append(
            f"  modes[{len(model.switches.found)}]: of switches, for functions whose name has _in_modes, which integrators call:"
        )
        lines.append(
            "            a number for each, or NULL where branches are to follow from the arguments; see motion/motion.h"
        )
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
    if pivoted_outputs(model):
        above = links + len(model.loops) + len(model.loads)
        lines.append(f"Numbers above {above}: an output has a value there, but no derivative; in their order.")
    return lines


def lays_out(procedure: Procedure) -> bool:
    """Whether a function needs all of the workspace, not what a few sweeps keep."""
    return any(isinstance(s, (Prepare, Perform, Own, AllColumns)) for s in within(procedure.steps))


def _is_number(e: Expr) -> bool:
    """Whether an expression is the same for all states."""
    return not e.free_symbols


def _reads_work(lines: list[str]) -> bool:
    """Whether lines that give a call its memory give it any."""
    return bool(lines) and lines != UNUSED_WORK


def fills_lanes(procedure: Procedure) -> bool:
    """Whether a function computes several columns of a matrix at once."""
    steps = within(procedure.steps)
    return any((isinstance(s, Columns) and s.unit.lanes) or isinstance(s, Primitives) for s in steps)


def guard(widths: tuple[int, ...], used: list[int]) -> tuple[list[str], list[str]]:
    """Lines around what only some widths need."""
    if sorted(widths) == sorted(used):
        return [], []
    return [f"#if {' || '.join(f'WIDTH == {w}' for w in widths)}"], ["#endif"]


def inclusions(name: str, used: list[int], guards: Mapping[int, str] = MappingProxyType({})) -> list[str]:
    """Lines that include the functions over directions once for every width; the last one stays.

    Those of some widths are in libraries of their own, by the conditions of `guards`.
    """
    lines = []
    for w in used:
        lines += ["#undef WIDTH"] if w != used[0] else []
        include = f'#include "{name}_directions.h"'
        lines += [f"#define WIDTH {w}", *([f"#if {guards[w]}", include, "#endif"] if w in guards else [include])]
    return lines


def near_name(sweep: str, component: str) -> str:
    """The place of a component in the memory that links share with their neighbours."""
    return f"{sweep}_{identifier(component)}".upper()


def members(
    components: Iterable[str], type_: str, end: str = ";", called: Callable[[str], str] = identifier
) -> list[str]:
    """Lines of a struct or an enum: the components of a field together, with its meaning."""
    found: list[tuple[AnyField | None, list[str]]] = []
    for component in components:
        field = field_of(component)
        if not found or found[-1][0] is not field:
            found.append((field, []))
        found[-1][1].append(called(component))
    lines = []
    for field, names in found:
        lines += textwrap.wrap(f"{type_} {', '.join(names)}{end}".strip(), MEMBERS, subsequent_indent="    ")
        if field is not None:
            unit = "" if field.unit in ("", "1") else f", {field.unit.replace('*/', '* /')}"
            comment = f"/* {field.meaning}{unit} */"
            if len(lines[-1]) + len(comment) <= COMMENTED:
                lines[-1] += f" {comment}"
            else:
                lines.append(f"    {comment}")
    return lines


def _of_width(name: str, lanes: bool) -> str:
    return f"DIRECTIONS({name})" if lanes else name


def _cast(region: str) -> str:
    """What makes a region of memory of numbers."""
    return f"({TYPES[region]} *)" if region in TYPES else ""


def _function(name: str, lanes: bool) -> str:
    return f"DIRECTIONS({name})" if lanes else name


def write_c(context: dict[str, Any]) -> dict[str, str]:
    """The C files of a solver, by name, but for those that are compiled apart."""
    name = context["name"]
    files = {f"{name}.c": "c/module.c.jinja", f"{name}.h": "c/module.h.jinja"}
    if any(line.startswith("#include") for line in context["inclusions"]):
        files[f"{name}_directions.h"] = "c/directions.h.jinja"
    return {file: render(template, context) for file, template in files.items()}


__all__ = ["CWriter", "write_c"]


def about_names(loops: bool) -> list[str]:
    """What the pointers that functions of links get are called, for the head of the file."""
    several = "; in loops there are several links (me0, me1), those they start from (root), their region and its base"
    text = (
        f"Functions of links are called by sweeps: me is the link, up its parent, c its constants{several if loops else ''}. "
        "What names with near point to is memory that neighbours share while one sweep passes; lme, lup, lane and names "
        'with d hold one value per direction. "in" and "out" list what a function reads and writes.'
    )
    return textwrap.wrap(text, COMMENT)
