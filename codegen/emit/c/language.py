"""How statements, loops, tables and places in memory are written in C."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace

from ...model.model import Model
from ...program import algebra
from ...program.addresses import Kind
from ...program.algebra import ZERO, Expr, Symbol
from ...program.block import Block, symbols_of
from ...program.field_table import identifier
from ...program.passes import as_computed, by_results
from ...program.plan import Plan
from ...program.procedure import Procedure
from ...program.store import MARGIN, MODES, Store
from ..language import Located, Place
from ..target import Scalar
from ..writer import Writer
from . import C
from .functions import in_all
from .printer import CPrinter
from .types import ENERGIES, LANE_REGIONS, NUMBER_TYPE, SHARES, TYPES, near_name, of_width


def stored_once(block: Block) -> set[Symbol]:
    """Symbols that what is stored for all directions together is made of."""
    if not any(store.lanes for store, _, _ in block.stores):
        return {*block.loads, *(s.target for s in block.statements)}
    wanted = {s for store, _, value in block.stores if not store.lanes for s in symbols_of(value)}
    for s in reversed(block.statements):
        if s.target in wanted:
            wanted |= symbols_of(s.expression)
    return wanted


def read_once(block: Block) -> set[Symbol]:
    """Symbols that the text of a block has in one place: what is loaded into them needs no name."""
    once: set[Symbol] = set()
    more: set[Symbol] = set()
    for e in (*(s.expression for s in block.statements), *(value for _, _, value in block.stores)):
        for part in _parts(e):
            if isinstance(part, Symbol) and part not in once:
                once.add(part)
            else:
                more |= part.free_symbols
    return once - more


def _parts(e: Expr) -> Iterator[Expr]:
    """The operands of sums and products in these: symbols, powers and calls."""
    if not (e.is_Add or e.is_Mul):
        yield e
        return
    for a in e.args:
        if a.is_Symbol:
            yield a
        else:
            yield from _parts(a)


def in_full(at: Located) -> str:
    """A component of a row that no variable points to."""
    if at.row[0] == "&":
        return at.row[1:] + (f".{at.text[2:]}" if at.text.startswith("->") else "")
    if at.row[0] == "(":
        return f"({at.row}){at.text}"
    start, _, offset = at.row.partition(" + ")
    index = at.text[1:-1]
    if offset.isdigit() and index.isdigit():
        return f"{start}[{int(offset) + int(index)}]"
    return f"{start}[{' + '.join(x for x in (offset, index) if x not in ('', '0')) or 0}]"


def is_array(row: str) -> bool:
    """Whether a row is one of the arrays of a call, from a number on: it needs no variable."""
    start, _, offset = row.partition(" + ")
    return start.startswith("a->") and (offset or "0").isdigit()


class CLanguage(Writer):
    """Writes blocks and loops in C, and where values lie."""

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
        """Whether a function is divided."""
        self.lines_of_units = dict.fromkeys(SHARES, 0)
        """Lines of parts that each unit of a library compiles for both."""
        self.touched: dict[str, set[str]] = {}
        """By sweep: the regions of memory, arguments and results that it reads or writes."""

    # -- numbers ---------------------------------------------------------------------------------------------------

    def text(self, value: float) -> str:
        """A number of a table or a statement."""
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
        to = [place(store, n) for store, n, _ in block.stores if store.memory is not MARGIN]
        stored = {*to}
        written = {at.variable for at in stored}
        names = self.called_by(block, place)
        taken = {s.name for s in block.loads} | {s.target.name for s in block.statements} | set(names.values())
        accesses = Counter(at.variable for at in (*(place(*of) for of in block.loads.values()), *to))
        pointers: dict[str, str] = {}
        body: list[str] = []

        def access(store: Store, name: str) -> str:
            at = place(store, name)
            along = ".at[h]" if store.lanes else ""
            if accesses[at.variable] == 1 or is_array(at.row):
                return in_full(at) + along
            variable = f"{at.variable}_at" if at.variable in taken else at.variable
            if variable not in pointers:
                const = "" if at.variable in written else "const "
                pointers[variable] = f"{const}{at.type} *restrict {variable} = {at.row};"
            return f"{variable}{at.text}{along}"

        # Before the loop over vectors stands what is stored once for all directions. Other numbers that they share stay in
        # the order of the block: compilers take them out of the loop, and know better which to keep in registers.
        passes: list[str] = []
        shared = stored_once(block)
        tags = {False: "", True: ""}
        overwritten = {(at.row, at.text) for at in stored}
        waiting: dict[Symbol, tuple[int, list[str], str]] = {}
        soon: list[Symbol] = []
        once = read_once(block) - {Symbol(name) for name in names}
        direct: dict[str, str] = {}
        for number, (symbol, (store, name)) in enumerate(block.loads.items()):
            at = place(store, name)
            lines = body if symbol in shared or (not store.lanes and at in stored) else passes
            read = access(store, name)
            if at.type == NUMBER_TYPE:
                read = in_all(read)
            if store is MODES:
                read = f"MODE({read.partition('[')[0]}, {read})"
            if symbol in once and (at.row, at.text) not in overwritten:
                direct[symbol.name] = read
                continue
            type_ = "VECTOR" if store.lanes else self.scalar.word
            waiting[symbol] = number, lines, f"const {type_} {names.get(symbol.name, symbol.name)} = {read};"
            soon += [symbol] if (at.row, at.text) in overwritten else []

        printer = self.printer.calling({**names, **direct})

        def load(symbols: Iterable[Symbol]) -> None:
            """Load what has not been loaded yet."""
            for _, lines, line in sorted(waiting.pop(s) for s in symbols if s in waiting):
                lines.append(line)

        # What is needed late is loaded late: compilers keep the order, and move hundreds of values to the stack and back
        # otherwise, in quadratic time.
        load(soon)
        # blocks over directions keep their order: they gain nothing by another
        along = any(store.lanes for store, _, _ in block.stores)
        if not along:
            order = by_results(block)
        else:
            order = as_computed(block) if block.early else [(block.statements, block.stores)]
        for statements, stores in order:
            for s in statements:
                load(symbols_of(s.expression))
                first = s.target in shared
                comment = f" /* {s.tag} */" if s.tag and s.tag != tags[first] else ""
                tags[first] = s.tag
                text = in_all(printer(s.expression)) if _is_number(s.expression) else printer(s.expression)
                (body if first else passes).append(
                    f"const {'VECTOR' if s.lanes else self.scalar.word} {s.target} = {text};{comment}"
                )
            for store, name, value in stores:
                load(symbols_of(value))
                text = printer(value)
                if store.memory is MARGIN:
                    assert culprit is not None
                    body.append(f"REFUSE({is_not_positive(value, printer, self.zero)}, {culprit(name)} + 1);")
                    continue
                if store.lanes and value.is_Number:
                    text = "(VECTOR){0}" if value is ZERO else f"(VECTOR){{0}} + {text}"
                elif _is_number(value):
                    text = in_all(text)
                line = f"{access(store, name)} {'+=' if store.adds else '='} {text};"
                (passes if store.lanes else body).append(line)
        if passes:
            passes = [each or "EACH_VECTOR {", *(f"    {line}" for line in passes), "}"]
        return [*pointers.values(), *body, *passes]

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
        """Where a component lies in a row of memory that is laid out."""
        if region == "near":
            # numbers, not a struct: where compilers can tell these from records, they move loads until registers are short
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
        # through the union, so that compilers see that sweeps share this memory
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
        """Where a constant lies: they begin at a row."""
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


def is_not_positive(e: Expr, printer: Callable[[Expr], str], zero: str) -> str:
    """The condition that an expression is zero or less: of a difference, that what is added is at most what is taken away."""
    if _is_number(e):
        return f"{in_all(printer(e))} <= {zero}"
    terms = [algebra.coefficient(t) for t in (e.args if e.is_Add else (e,))]
    more = [algebra.multiply(c, t) for c, t in terms if c > 0]
    less = [algebra.multiply(algebra.negative(c), t) for c, t in terms if c < 0]
    return f"{printer(algebra.add(*more))} <= {printer(algebra.add(*less)) if less else zero}"


def _is_number(e: Expr) -> bool:
    """Whether an expression is the same for all states."""
    return not e.free_symbols
