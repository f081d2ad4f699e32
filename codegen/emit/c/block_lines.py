"""The C lines of a block: when values are loaded, and which lines precede the loop over directions."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator

from ...program import algebra
from ...program.algebra import ZERO, Expr, Symbol
from ...program.block import Block, symbols_of
from ...program.passes import as_computed, by_results
from ...program.store import MARGIN, MODES, Store
from ..language import Language, Located, Place
from .divided import reads
from .functions import in_all
from .printer import CPrinter
from .types import NUMBER_TYPE

FEW = 60
"""Values common to all directions are computed before the loop over vectors if there are at most this many."""


class BlockLines:
    """Writes the lines of one block.

    Results that are stored once for all directions are computed before the loop over vectors. Other values common to
    all directions stay inside the loop, in the order of the block: compilers move them out of the loop, and know better
    which of them to keep in registers. But in functions that run once for each member of a kind, rows have a variable
    index, so compilers must assume that stored vectors overwrite the operands of such values. There, these values are
    computed just before the loop if they are few (`FEW`).

    Attributes
    ----------
    body, common, passes : list of str
        Lines before the loop over vectors; values common to all directions, just before it; lines inside it.
    pointers : dict of str to str
        Declarations of variables for rows of memory.
    waiting : dict
        Loads that have not been written yet: their number, the list that receives their line, and the line.
    """

    def __init__(
        self, of: Language, printer: CPrinter, block: Block, place: Place, culprit: Callable[[str], str] | None
    ):
        self.block, self.place, self.culprit = block, place, culprit
        self.real, self.zero = of.scalar.word, of.scalar.literal("0.0")
        # `place` gives names to rows: first to the rows of stores, then to the rows of loads
        to = [place(store, n) for store, n, _ in block.stores if store.memory is not MARGIN]
        names = of.called_by(block, place)
        self.stored = {*to}
        self.written = {at.variable for at in to}
        self.taken = {s.name for s in block.loads} | {s.target.name for s in block.statements} | set(names.values())
        places = [*(place(*of) for of in block.loads.values()), *to]
        self.accesses = Counter(at.variable for at in places)
        indexed = reads([at.row for at in places], "i")
        self.shared = stored_once(block)
        self.few = few_common(block) - self.shared if indexed and not block.ordered else set()
        self.pointers: dict[str, str] = {}
        self.body: list[str] = []
        self.common: list[str] = []
        self.passes: list[str] = []
        self.tags = {False: "", True: ""}
        self.waiting: dict[Symbol, tuple[int, list[str], str]] = {}
        self.printer = printer.calling({**names, **self._loads(names)})

    def access(self, store: Store, name: str) -> str:
        """The C expression of a component in memory."""
        at = self.place(store, name)
        along = ".at[h]" if store.lanes else ""
        if self.accesses[at.variable] == 1 or is_array(at.row):
            return in_full(at) + along
        variable = f"{at.variable}_at" if at.variable in self.taken else at.variable
        if variable not in self.pointers:
            const = "" if at.variable in self.written else "const "
            self.pointers[variable] = f"{const}{at.type} *restrict {variable} = {at.row};"
        return f"{variable}{at.text}{along}"

    def _loads(self, names: dict[str, str]) -> dict[str, str]:
        """Prepare the lines of all loads; return the expressions of loads that need no variable."""
        overwritten = {(at.row, at.text) for at in self.stored}
        once = read_once(self.block) - {Symbol(name) for name in names}
        direct: dict[str, str] = {}
        soon: list[Symbol] = []
        for number, (symbol, (store, name)) in enumerate(self.block.loads.items()):
            at = self.place(store, name)
            before = symbol in self.shared or (not store.lanes and at in self.stored)
            read = self.access(store, name)
            if at.type == NUMBER_TYPE:
                read = in_all(read)
            if store is MODES:
                read = f"MODE({read.partition('[')[0]}, {read})"
            if symbol in once and (at.row, at.text) not in overwritten:
                direct[symbol.name] = read
                continue
            type_ = "VECTOR" if store.lanes else self.real
            line = f"const {type_} {names.get(symbol.name, symbol.name)} = {read};"
            self.waiting[symbol] = number, self.body if before else self._lines_with(symbol), line
            soon += [symbol] if (at.row, at.text) in overwritten else []
        self.load(soon)
        return direct

    def load(self, symbols: Iterable[Symbol]) -> None:
        """Load values that are not loaded yet.

        Values are loaded where they are first needed. Compilers keep the order of loads; early loads would move hundreds of
        values to the stack and back, in quadratic compile time.
        """
        for _, lines, line in sorted(self.waiting.pop(s) for s in symbols if s in self.waiting):
            lines.append(line)

    def lines(self, each: str) -> list[str]:
        """All lines of the block; `each` begins the loop over directions."""
        block = self.block
        # for blocks over directions, another order of the statements gains nothing
        along = any(store.lanes for store, _, _ in block.stores)
        if not along:
            order = by_results(block)
        else:
            order = as_computed(block) if block.early else [(block.statements, block.stores)]
        for statements, stores in order:
            for s in statements:
                self.load(symbols_of(s.expression))
                first = s.target in self.shared
                comment = f" /* {s.tag} */" if s.tag and s.tag != self.tags[first] else ""
                self.tags[first] = s.tag
                type_ = "VECTOR" if s.lanes else self.real
                line = f"const {type_} {s.target} = {self._value(s.expression)};{comment}"
                (self.body if first else self._lines_with(s.target)).append(line)
            for store, name, value in stores:
                self._store(store, name, value)
        passes = [each, *(f"    {line}" for line in self.passes), "}"] if self.passes else []
        return [*self.pointers.values(), *self.body, *self.common, *passes]

    def _lines_with(self, symbol: Symbol) -> list[str]:
        """The list of lines that receives the line of a value, if no result that is stored once depends on the value."""
        return self.common if symbol in self.few else self.passes

    def _value(self, e: Expr) -> str:
        return in_all(self.printer(e)) if _is_number(e) else self.printer(e)

    def _store(self, store: Store, name: str, value: Expr) -> None:
        self.load(symbols_of(value))
        if store.memory is MARGIN:
            assert self.culprit is not None
            refused = is_not_positive(value, self.printer, self.zero)
            self.body.append(f"REFUSE({refused}, {self.culprit(name)} + 1);")
            return
        if store.lanes and value.is_Number:
            text = "(VECTOR){0}" if value is ZERO else f"(VECTOR){{0}} + {self.printer(value)}"
        else:
            text = self._value(value)
        line = f"{self.access(store, name)} {'+=' if store.adds else '='} {text};"
        (self.passes if store.lanes else self.body).append(line)


def stored_once(block: Block) -> set[Symbol]:
    """Symbols on which the results stored once for all directions depend."""
    if not any(store.lanes for store, _, _ in block.stores):
        return {*block.loads, *(s.target for s in block.statements)}
    wanted = {s for store, _, value in block.stores if not store.lanes for s in symbols_of(value)}
    for s in reversed(block.statements):
        if s.target in wanted:
            wanted |= symbols_of(s.expression)
    return wanted


def few_common(block: Block) -> set[Symbol]:
    """Values common to all directions that are needed inside the loop over vectors only, and the loads on which they
    depend. Empty if more than `FEW` of them have a variable."""
    computed = {s.target for s in block.statements if not s.lanes}
    loaded = {s for s, (store, _) in block.loads.items() if not store.lanes}
    count = len((computed | (loaded - read_once(block))) - stored_once(block))
    return computed | loaded if count <= FEW else set()


def read_once(block: Block) -> set[Symbol]:
    """Symbols that occur once in the text of a block; loads of these symbols need no variable."""
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
    """The operands of nested sums and products: symbols, powers and calls."""
    if not (e.is_Add or e.is_Mul):
        yield e
        return
    for a in e.args:
        if a.is_Symbol:
            yield a
        else:
            yield from _parts(a)


def in_full(at: Located) -> str:
    """The C expression of a component of a row that has no pointer variable."""
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
    """Whether a row is an array in the memory of the call, at a fixed offset; such a row needs no variable."""
    start, _, offset = row.partition(" + ")
    return start.startswith("a->") and (offset or "0").isdigit()


def is_not_positive(e: Expr, printer: Callable[[Expr], str], zero: str) -> str:
    """The condition that an expression is zero or less; a difference is written as a comparison of its terms."""
    if _is_number(e):
        return f"{in_all(printer(e))} <= {zero}"
    terms = [algebra.coefficient(t) for t in (e.args if e.is_Add else (e,))]
    more = [algebra.multiply(c, t) for c, t in terms if c > 0]
    less = [algebra.multiply(algebra.negative(c), t) for c, t in terms if c < 0]
    return f"{printer(algebra.add(*more))} <= {printer(algebra.add(*less)) if less else zero}"


def _is_number(e: Expr) -> bool:
    """Whether an expression is the same for all states."""
    return not e.free_symbols
