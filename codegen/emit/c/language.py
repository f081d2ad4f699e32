"""Writes statements, loops, tables and places in memory in C."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

from ...model.model import Model
from ...program.addresses import Kind
from ...program.block import Block
from ...program.field_table import identifier
from ...program.plan import Plan
from ...program.procedure import Procedure
from ...program.store import Store
from ..language import Located, Place
from ..target import Scalar
from ..writer import Writer
from . import C
from .block_lines import BlockLines
from .printer import CPrinter
from .types import ENERGIES, LANE_REGIONS, NUMBER_TYPE, SHARES, TYPES, near_name, of_width


class CLanguage(Writer):
    """Writes blocks and loops in C, and places in memory."""

    def __init__(
        self,
        model: Model,
        plan: Plan,
        asked: tuple[Procedure, ...],
        scalar: Scalar,
        reserved: frozenset[str],
    ):
        super().__init__(model, plan, asked, C, scalar, reserved)
        self.printer = CPrinter(C, scalar)
        self.tables: list[tuple[str, list[str]]] = []
        self.has_parts = False
        """Whether any function of this file is divided into parts."""
        self.lines_of_units = dict.fromkeys(SHARES, 0)
        """For each unit of a library, the number of lines of shared parts that it compiles."""
        self.touched: dict[str, set[str]] = {}
        """Regions of memory, arguments and results that each sweep reads or writes, by name of the sweep."""

    # -- numbers ---------------------------------------------------------------------------------------------------

    def text(self, value: float) -> str:
        """The C text of a number in a table or a statement."""
        return repr(value) if isinstance(value, int) else self.scalar.literal(repr(value))

    @property
    def zero(self) -> str:
        return self.scalar.literal("0.0")

    # -- the language ----------------------------------------------------------------------------------------------

    def each(self, kinds: Sequence[Kind], sweep: str) -> str:
        groups = self.plan.sweeps[sweep].groups
        if not groups:
            return "EACH_VECTOR {"
        rows = [self.addresses.number(kind, sweep) for kind in kinds]
        link = self.addresses.expression(kinds, sweep, rows)
        if groups == "rest":
            return f"EACH_GROUP(a->all_groups & ~a->below_groups[{link}]) {{"
        return f"EACH_GROUP(a->{groups}_groups[{link}]) {{"

    def lines(
        self,
        block: Block,
        place: Place,
        culprit: Callable[[str], str] | None = None,
        each: str = "",
    ) -> list[str]:
        return BlockLines(self, self.printer, block, place, culprit).lines(each or "EACH_VECTOR {")

    def signature(
        self, name: str, lanes: bool, indexed: bool, whose: str = "static void", arrays: Sequence[tuple[str, str]] = ()
    ) -> str:
        type_ = "DIRECTIONS(call)" if lanes else "call"
        parameters = [f"{type_} *a", *(["int i"] if indexed else []), *(f"{t} *{n}" for t, n in arrays)]
        return f"{whose} {of_width(name, lanes)}({', '.join(parameters)})"

    def call(self, name: str, lanes: bool, index: str | None) -> str:
        return f"{of_width(name, lanes)}(a{'' if index is None else f', {index}'});"

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
        return [f"for (int i = 0; i < {count}; ++i) {of_width(name, lanes)}(a, i);"]

    def add_table(self, name: str, rows: list[list[int]] | list[list[float]]) -> None:
        type_ = "int" if isinstance(rows[0][0], int) else NUMBER_TYPE
        head = f"static const {type_} {name}[{len(rows)}][{len(rows[0])}]"
        if head not in (h for h, _ in self.tables):
            self.tables.append((head, [", ".join(map(self.text, row)) for row in rows]))

    def unused_index(self) -> list[str]:
        return ["(void)i;"]

    # -- places ----------------------------------------------------------------------------------------------------

    def element(self, array: str, index: str, lanes: bool = False) -> Located:
        type_ = "LANES" if lanes else self.scalar.word
        if array in ("energy", "denergy") and index.isdigit():
            index = ENERGIES[int(index)]
        start = "&a->t" if array == "t" else f"a->{array}"
        return Located(array, start, f"[{index}]", type_, self.names_of(array, index))

    def in_row(self, variable: str, region: str, row: str, sweep: str, name: str) -> Located:
        """Place of a component in a row of known layout."""
        if region == "near":
            # a plain array, so that compilers must assume that it overlaps the records. Otherwise they move its loads
            # so far forward that registers run out
            place = f"[{near_name(self.layout.near_forms[sweep], name)}]"
            return Located(
                variable,
                f"a->near + NEAR_SIZE*({row})" if " " in row else f"a->near + NEAR_SIZE*{row}",
                place,
                self.scalar.word,
            )
        start, type_ = f"&a->{region}[{row}]", TYPES[region]
        if region in LANE_REGIONS:
            type_ = f"DIRECTIONS({type_})"
        # access goes through the union, so that compilers know that sweeps share this memory
        of = f"{self.layout.slot_forms[sweep]}." if region == "slots" else ""
        return Located(variable, start, f"->{of}{identifier(name)}", type_)

    def field_of_record(self, store: Store, link: str, name: str) -> Located:
        variable = store.label.replace("#", "_")
        if store.memory.region == "slots":
            return self.in_row(variable, "slots", "0", "moment_tangents", name)
        return self.in_row(variable, store.memory.region, link, "", name)

    def constant(self, shape: int, constants: str, name: str) -> Located:
        return self.in_constants("c", constants, self.layout.forms[shape], name)

    def in_constants(self, variable: str, row: str, form: int, name: str) -> Located:
        """Place of a constant, counted from the first constant of its row."""
        type_ = f"constants_of_shape_{form}"
        return Located(variable, f"({type_} *)(a->constants + {row})", f"->{identifier(name)}", type_)

    def place_of_constants(self, index: int) -> int:
        return self.layout.constant_offsets[index]

    def number_of_row(self, table: str, row: str, index: int) -> Located:
        return Located("k", f"{table}[{row}]", f"[{index}]", NUMBER_TYPE)

    def place(self, kinds: Sequence[Kind], sweep: str, store: Store, name: str) -> Located:
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
            return Located(
                at.variable, f"a->trig + {at.row}", "[COSINE]" if name == "cos" else "[SINE]", self.scalar.word
            )
        type_ = "LANES" if store.lanes else self.scalar.word
        if at.row.isdigit() or not at.row:
            index = str(int(at.row or 0) + int(at.component)) if at.component.isdigit() else at.component
            return replace(self.element(at.region, index, store.lanes), variable=at.variable)
        return Located(at.variable, f"a->{at.region} + {at.row}", f"[{at.component}]", type_)
