"""Blocks: short straight-line programs of scalar statements, and the two ways to run the code that writes them.

A block is a list of assignments ``symbol = small expression of earlier symbols``. It reads fields of stores (`Scope.load`) and
writes fields (`Scope.store`). The layout decides later where a field lies in memory.

The functions in `codegen.mechanics` that write blocks run twice. The first run, with a `StructuralExpansion`, only finds the
fields that can differ from zero. The second, with an `Expansion`, writes the statements. Supported: sums, products, integer
powers, quotients and elementary functions. Not supported: branches, loops.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Hashable, Iterable, Sequence
from dataclasses import field
from functools import partial
from typing import TypeVar

from ..elementary import named
from ..records import dataclass
from . import algebra
from .algebra import Expr, Number, Symbol
from .digits import number
from .field import XYZ, AnyField, Field, Readable
from .functions import SYMBOLIC
from .scalar import Value, Vector
from .store import Store

V = TypeVar("V")
V_co = TypeVar("V_co", covariant=True)
Component = tuple[Store, str]
"""A component of a field, such as ``w.x``, with its store."""


def symbols_of(e: Expr) -> frozenset[Symbol]:
    """The symbols of an expression."""
    found: frozenset[Symbol] = e.free_symbols
    return found


def up_to_sign(e: Expr) -> Hashable:
    """A key that an expression shares with its negative; cheaper than a negation."""
    return frozenset(map(_unsigned, e.args)) if e.is_Add else _unsigned(e)


def _unsigned(term: Expr) -> Hashable:
    """A term of a sum without its numerical factor."""
    if term.is_Mul:
        factors: tuple[Expr, ...] = term.args[1:] if term.args[0].is_Number else term.args
        return factors if len(factors) > 1 else factors[0]
    return None if term.is_Number else term


@dataclass(frozen=True, slots=True)
class Statement:
    """One assignment. `tag` names its equation; `lanes` is true if there is one value per direction."""

    target: Symbol
    expression: Expr
    tag: str = ""
    lanes: bool = False


@dataclass(slots=True)
class Block:
    """A straight-line program.

    Attributes
    ----------
    name : str
    title : str
        What the block computes, with its equations; printed as a comment in generated code.
    loads : dict of Symbol to (Store, str)
        Symbols that the block reads, with store and component.
    statements : list of Statement
    stores : list of (Store, component, expression)
    otherwise : dict of Symbol to Expr
        For values named by `Scope.either`: the alternative expression, until one of the two is chosen.
    early : bool
        If true, values per direction are stored as soon as they are known; otherwise at the end.
    ordered : bool
        If true, targets print all statements in this order, including those whose values are common to all directions.
    """

    name: str
    title: str
    loads: dict[Symbol, Component] = field(default_factory=dict)
    statements: list[Statement] = field(default_factory=list)
    stores: list[tuple[Store, str, Expr]] = field(default_factory=list)
    otherwise: dict[Symbol, Expr] = field(default_factory=dict)
    early: bool = False
    ordered: bool = False

    @property
    def length(self) -> int:
        """The number of symbols that statements and stores read."""
        values = (*(s.expression for s in self.statements), *(e for _, _, e in self.stores))
        return sum(len(symbols_of(e)) for e in values)

    def symbols_stored(self) -> set[Symbol]:
        found: set[Symbol] = set()
        for _, _, e in self.stores:
            found |= symbols_of(e)
        return found


RESERVED = frozenset(
    ["pow", *named("c")]
    + "a h i l y0 y1 yn j0 j1 jn np int double const static link numbers call values carried_over".split()
)
"""Names with another meaning in generated code."""


class FieldError(Exception):
    """A block uses a field that is not in the tables, reads one that is never written, or writes one that is never read.

    This is an internal error of ordernm.
    """


class Scope(ABC):
    """Interface for code that writes a block: reads and writes fields, and names values.

    Attributes
    ----------
    tangents : bool
        Whether the block will be differentiated.
    units : bool
        Whether the units of its sweep have several links.
    structural : bool
        Whether values are zero patterns; otherwise they are expressions.
    title : str
        Title of the block.
    asked : dict of (Store, str) to Field
        Components that have been read, with their fields.
    told : dict of (Store, str) to Field
        Components that have been written, with their fields.
    """

    structural: bool

    def __init__(self, title: str, tangents: bool, units: bool):
        self.title = title
        self.tangents = tangents
        self.units = units
        self.reads: dict[Component, AnyField] = {}
        self.writes: dict[Component, AnyField] = {}

    @abstractmethod
    def component(self, store: Store, name: str) -> Value:
        """The value of a component: a symbol, or a number if the value is known."""

    @abstractmethod
    def set_component(self, store: Store, name: str, value: Value) -> None:
        """Write a component. Zeros are written too; a pass removes unread ones."""

    @abstractmethod
    def let(self, name: str, value: Value, tag: str = "", lanes: bool = False) -> Value:
        """Name an intermediate value. Returns its symbol, or the value itself where a name would only be a copy."""

    @abstractmethod
    def name(self, name: str, value: Value, tag: str = "") -> Value:
        """Name a value even if the name is only a copy; copy propagation removes the copy."""

    def either(self, name: str, value: Value, otherwise: Value, tag: str = "") -> Value:
        """Name a value for which there are two expressions. The second one, `otherwise`, is chosen if it costs less, or if
        only the first one reads values that are not needed elsewhere."""
        return self.let(name, value, tag)

    @abstractmethod
    def number(self, value: float | Number) -> Value:
        """A number as generated code writes it; zero patterns distinguish 0, 1 and -1."""

    @abstractmethod
    def sqrt(self, value: Value) -> Value:
        """The square root of a value; the result gets no name."""

    @abstractmethod
    def call(self, function: str, *arguments: Value) -> Value:
        """The value of an elementary function, by the function's name in the expression grammar; the value gets no
        name."""

    @property
    def half(self) -> Value:
        """The number one half."""
        return self.number(algebra.HALF)

    def let_vector(self, name: str, v: Sequence[Value], tag: str = "", lanes: bool = False) -> Vector:
        """Name the three components of a vector."""
        return [self.let(f"{name}_{i}", value, tag, lanes) for i, value in zip(XYZ, v, strict=True)]

    @abstractmethod
    def recall(self, store: Store, field: Field[V], value: V) -> None:
        """Mark a value as stored by an earlier block: it is loaded instead of computed, but still differentiated."""

    def load(self, store: Store, field: Readable[V_co]) -> V_co:
        """The value of a field."""
        self._check(store, field)
        reads = self.reads
        for name in field.components:
            reads[store, name] = field
        return field.read(partial(self.component, store))

    def store(self, store: Store, field: Field[V], value: V) -> None:
        """Write a value to a field."""
        self._check(store, field)
        for name, part in field.parts(value):
            self.writes[store, name] = field
            self.set_component(store, name, part)

    def _check(self, store: Store, field: AnyField) -> None:
        if not field.family.listed:
            raise FieldError(f"{self.title}: {store} has no field {field}: it is not in the table of fields")

    def entry(self, store: Store, index: int) -> Value:
        """An entry of an argument, a seed or the like; entries of a link are numbered from its first."""
        return self.component(store, str(index))

    def set_entry(self, store: Store, index: int, value: Value) -> None:
        """Write an entry of a result."""
        self.set_component(store, str(index), value)


class Expansion(Scope):
    """Writes a block: drops zeros and ones, names intermediate values, and gives equal expressions one name.

    Parameters
    ----------
    name, title : str
    nonzero : callable (store, component) -> bool
        Returns whether a component can differ from zero; otherwise it is loaded as the number 0.
    number : callable (store, component) -> Number or None
        Returns the value of a component that is known at generation time.
    alias : callable (store, component) -> str
        Returns the component to load among those of equal value.
    tangents, units : bool
        See `Scope`.
    """

    structural = False

    def __init__(
        self,
        name: str,
        title: str,
        nonzero: Callable[[Store, str], bool],
        number: Callable[[Store, str], Expr | None] = lambda store, name: None,
        alias: Callable[[Store, str], str] = lambda store, name: name,
        tangents: bool = False,
        units: bool = False,
    ):
        super().__init__(title, tangents, units)
        self.block = Block(name, title)
        self._nonzero = nonzero
        self._number = number
        self._alias = alias
        self.recalled: dict[Symbol, Component] = {}
        """Values that are loaded instead of computed, since an earlier block has stored them; see `recall`."""
        self.stored_before: list[tuple[Store, str, Expr]] = []
        """All values that an earlier block has stored."""
        self.equal: dict[Symbol, Expr] = {}
        """Values that equal another value except for rounding errors, and therefore have the same tangent."""
        self._loaded: dict[Component, Expr] = {}
        self._named: dict[Expr, Expr] = {}
        self._named_up_to_sign: set[Hashable] = set()
        self._used: dict[str, int] = {}
        self._taken: set[str] = set(RESERVED)

    # -- reading and writing ---------------------------------------------------------------------------------------

    def component(self, store: Store, name: str) -> Expr:
        name = self._alias(store, name)
        key = (store, name)
        value = self._loaded.get(key)
        if value is None:
            number = self._number(store, name)
            if number is not None:
                value = number
            elif not self._nonzero(store, name):
                value = algebra.ZERO
            else:
                value = self._symbol(f"{store.label}_{name}")
                self.block.loads[value] = key
            self._loaded[key] = value
        return value

    def entry(self, store: Store, index: int) -> Expr:
        return self.component(store, str(index))

    def symbol(self, store: Store, index: int) -> Symbol:
        """The symbol of an entry whose value is not a known number."""
        found = self.entry(store, index)
        assert isinstance(found, Symbol), f"{store}[{index}] is {found}"
        return found

    def set_component(self, store: Store, name: str, value: Value) -> None:
        self.block.stores.append((store, name, algebra.expression(value)))

    # -- statements ------------------------------------------------------------------------------------------------

    def let(self, name: str, value: Value, tag: str = "", lanes: bool = False) -> Expr:
        e: Expr = algebra.expression(value)
        if e.is_Symbol or e.is_Number:
            return e
        known = self.find(e)
        if known is not None:
            return known
        if e.is_Mul and len(e.args) == 2 and e.args[0] is algebra.MINUS_ONE and e.args[1].is_Symbol:
            return e
        symbol = self._symbol(name)
        self.block.statements.append(Statement(symbol, e, tag, lanes))
        self._named[e] = symbol
        self._named_up_to_sign.add(up_to_sign(e))
        return symbol

    def name(self, name: str, value: Value, tag: str = "") -> Symbol:
        symbol = self._symbol(name)
        self.block.statements.append(Statement(symbol, algebra.expression(value), tag))
        return symbol

    def either(self, name: str, value: Value, otherwise: Value, tag: str = "") -> Symbol:
        symbol = self.name(name, value, tag)
        self.block.otherwise[symbol] = algebra.expression(otherwise)
        return symbol

    def number(self, value: float | Number) -> Expr:
        return value if isinstance(value, Number) else number(value)

    def sqrt(self, value: Value) -> Expr:
        return algebra.sqrt(value)

    def call(self, function: str, *arguments: Value) -> Expr:
        result: Expr = SYMBOLIC[function](*arguments)
        return result

    def recall(self, store: Store, field: Field[V], value: V) -> None:
        self._check(store, field)
        for name, part in field.parts(value):
            self.reads[store, name] = field
            self.stored_before.append((store, name, algebra.expression(part)))
            if isinstance(part, Symbol) and part not in self.block.loads:
                self.recalled[part] = (store, name)

    def resume(self, block: Block) -> Expansion:
        """Continue to write a finished block."""
        self.block.loads, self.block.statements = dict(block.loads), list(block.statements)
        self.block.stores = list(block.stores)
        self._loaded |= {at: symbol for symbol, at in block.loads.items()}
        for s in block.statements:
            self._named.setdefault(s.expression, s.target)
            self._named_up_to_sign.add(up_to_sign(s.expression))
        self.reserve(s.name for s in (*block.loads, *(s.target for s in block.statements)))
        return self

    def reserve(self, names: Iterable[str]) -> None:
        """Exclude names from the symbols that are made from now on."""
        self._taken.update(names)

    def finish(self) -> Block:
        """Complete the block: recalled values become loads, each place keeps its last store, and added zeros are dropped."""
        last = {(store, name): i for i, (store, name, _) in enumerate(self.block.stores)}
        self.block.stores = [
            (store, name, value)
            for i, (store, name, value) in enumerate(self.block.stores)
            if (value is not algebra.ZERO if store.adds else last[store, name] == i)
        ]
        self.block.statements = [s for s in self.block.statements if s.target not in self.recalled]
        self.block.loads.update(self.recalled)
        return self.block

    def find(self, value: Expr) -> Expr | None:
        """The existing name of an expression, or minus the name of its negative; None without a name."""
        known = self._named.get(value)
        if known is None and up_to_sign(value) in self._named_up_to_sign:
            opposite = self._named.get(-value)
            if opposite is not None:
                known = -opposite
        return known

    def _symbol(self, name: str) -> Symbol:
        name = name.replace(".", "_").replace("/", "_d").replace("#", "")
        unique = name
        while unique in self._taken:
            self._used[name] = self._used.get(name, 0) + 1
            unique = f"{name}_{self._used[name]}"
        self._taken.add(unique)
        return Symbol(unique)


class Nonzero:
    """The structural value "may differ from zero"; its counterpart is the integer 0."""

    __slots__ = ()

    def _any(self, other: object) -> Nonzero:
        return self

    def _product(self, other: object) -> Nonzero | int:
        return 0 if isinstance(other, int) and other == 0 else self

    __add__ = __radd__ = __sub__ = __rsub__ = _any
    __mul__ = __rmul__ = _product

    def __neg__(self) -> Nonzero:
        return self

    def __truediv__(self, other: object) -> Nonzero:
        return self

    def __rtruediv__(self, other: object) -> Nonzero | int:
        return self._product(other)

    def __pow__(self, other: object) -> Nonzero:
        return self


ANY = Nonzero()


class StructuralExpansion(Scope):
    """Runs block-writing code on zero patterns only; `stored` receives the patterns of written fields.

    The numbers 1 and -1 are distinguished from varying values, since components of axes often are 1 or -1 in every state.
    """

    structural = True

    def __init__(
        self,
        title: str,
        nonzero: Callable[[Store, str], bool],
        tangents: bool = False,
        known: Callable[[Store, str], int | None] = lambda store, name: None,
        units: bool = False,
    ):
        super().__init__(title, tangents, units)
        self._nonzero = nonzero
        self._known = known
        self.stored: dict[Component, int | None] = {}
        """The constant value 0, 1 or -1 of each component; None for a component that varies."""

    def component(self, store: Store, name: str) -> Value:
        if not self._nonzero(store, name):
            return 0
        known = self._known(store, name)
        return ANY if known is None else known

    def set_component(self, store: Store, name: str, value: Value) -> None:
        value = self.let(name, value)
        if store.adds:
            # another block may also add to this component, so the component's value is unknown
            value = ANY if value else 0
        number = value if isinstance(value, int) else None
        key = store, name
        self.stored[key] = number if self.stored.get(key, number) == number else None

    def let(self, name: str, value: Value, tag: str = "", lanes: bool = False) -> Value:
        if isinstance(value, Nonzero):
            return value
        # zero patterns distinguish only 0, 1 and -1, and a quotient of them is a float
        return int(value) if isinstance(value, (int, float)) and value in (0, 1, -1) else ANY

    def name(self, name: str, value: Value, tag: str = "") -> Value:
        return self.let(name, value)

    def either(self, name: str, value: Value, otherwise: Value, tag: str = "") -> Value:
        return ANY if value or otherwise else 0

    def number(self, value: float | Number) -> Value:
        return int(value) if value in (0, 1, -1) else ANY

    def sqrt(self, value: Value) -> Value:
        return ANY

    def call(self, function: str, *arguments: Value) -> Value:
        return ANY

    def recall(self, store: Store, field: Field[V], value: V) -> None:
        self.load(store, field)
