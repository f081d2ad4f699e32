"""Blocks: short straight-line programs of scalar statements, and the two ways to run the code that writes them.

A block is a list of assignments ``symbol = small expression of earlier symbols``. It reads *fields* of named arrays
(`Expansion.load`) and writes fields (`Expansion.store`); where a field lies in memory is decided later, by the layout.

The functions in `codegen.mechanics` that write blocks are run twice: once with a `StructuralExpansion`, which only
finds out which fields can differ from zero, and then with an `Expansion`, which writes the statements with sympy.
Supported: sums, products, integer powers, quotients and elementary functions. Not supported: branches, loops.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache
from typing import Any

import sympy
from sympy import Expr, Symbol
from sympy.core.numbers import Number


@cache
def _symbol_named(name: str) -> Symbol:
    """sympy's own cache of symbols is too small for a program, and making one anew is slow."""
    return Symbol(name)


@dataclass(frozen=True, slots=True)
class Statement:
    """One assignment; `tag` names the equation it comes from, `lanes` tells that it is one per direction."""

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
        What the block computes and its equations, for the comment in the generated code.
    loads : dict of Symbol to (str, str)
        Symbols that are read, with array and field.
    statements : list of Statement
    stores : list of (array, field, expression)
    """

    name: str
    title: str
    loads: dict[Symbol, tuple[str, str]] = field(default_factory=dict)
    statements: list[Statement] = field(default_factory=list)
    stores: list[tuple[str, str, Expr]] = field(default_factory=list)

    def symbols_stored(self) -> set[Symbol]:
        found: set[Symbol] = set()
        for _, _, e in self.stores:
            found |= e.free_symbols
        return found


RESERVED = frozenset(
    "a h i l acos asin atan atan2 cos cosh exp fabs fmax fmin log pow sin sinh sqrt tan tanh y0 y1 yn j0 j1 jn np "
    "int double const static link numbers call".split()
)
"""Names that generated code uses for other things."""


class Expansion:
    """Writes a block: folds zeros and ones, names intermediates, gives equal expressions one name.

    Parameters
    ----------
    name, title : str
    nonzero : callable (array, field) -> bool
        Whether a field can differ from zero; the others are loaded as the number 0.
    number : callable (array, field) -> Number or None
        Fields whose value is known at generation time.
    alias : callable (array, field) -> str
        Fields of equal value: the one to load.
    tangents, units : bool
        Whether the block is to be differentiated, and whether its sweep goes over units of several links; read by the
        code that writes it.
    """

    structural = False

    def __init__(
        self,
        name: str,
        title: str,
        nonzero: Callable[[str, str], bool],
        number: Callable[[str, str], Number | None] = lambda array, name: None,
        alias: Callable[[str, str], str] = lambda array, name: name,
        tangents: bool = False,
        units: bool = False,
    ):
        self.block = Block(name, title)
        self.tangents = tangents
        self.units = units
        self._nonzero = nonzero
        self._number = number
        self._alias = alias
        self._recalled: dict[Symbol, tuple[str, str]] = {}
        self._loaded: dict[tuple[str, str], Expr] = {}
        self._named: dict[Expr, Expr] = {}
        self._used: dict[str, int] = {}
        self._taken: set[str] = set(RESERVED)

    # -- reading and writing ---------------------------------------------------------------------------------------

    def load(self, array: str, name: str) -> Expr:
        """The value of a field: a symbol, or a number where it is known."""
        name = self._alias(array, name)
        key = (array, name)
        value = self._loaded.get(key)
        if value is None:
            number = self._number(array, name)
            if number is not None:
                value = number
            elif not self._nonzero(array, name):
                value = sympy.S.Zero
            else:
                value = self._symbol(f"{array}_{name}")
                self.block.loads[value] = key
            self._loaded[key] = value
        return value

    def store(self, array: str, name: str, value: Expr) -> None:
        """Write a field. Zeros are written too; a pass removes what nobody reads."""
        self.block.stores.append((array, name, sympy.sympify(value)))

    # -- statements ------------------------------------------------------------------------------------------------

    def let(self, name: str, value: Expr, tag: str = "", lanes: bool = False) -> Expr:
        """Name an intermediate: returns its symbol, or the value itself where naming would cost a copy."""
        value = sympy.sympify(value)
        if value.is_Symbol or value.is_Number:
            return value
        known = self.find(value)
        if known is not None:
            return known
        if value.is_Mul and len(value.args) == 2 and value.args[0] is sympy.S.NegativeOne and value.args[1].is_Symbol:
            return value
        symbol = self._symbol(name)
        self.block.statements.append(Statement(symbol, value, tag, lanes))
        self._named[value] = symbol
        return symbol

    def name(self, name: str, value: Expr, tag: str = "") -> Symbol:
        """A symbol for a value even where that costs a copy; copy propagation removes it again."""
        symbol = self._symbol(name)
        self.block.statements.append(Statement(symbol, sympy.sympify(value), tag))
        return symbol

    def recall(self, vectors: dict[str, list[Expr]], array: str = "me") -> None:
        """Values that an earlier block has stored: they are loaded, not computed, but still differentiated."""
        for name, vector in vectors.items():
            self.recall_each({f"{name}.{component}": v for component, v in zip("xyz", vector, strict=True)}, array)

    def recall_each(self, fields: dict[str, Expr], array: str = "me") -> None:
        """The same of single fields."""
        for name, value in fields.items():
            if value.is_Symbol and value not in self.block.loads:
                self._recalled[value] = (array, name)

    def finish(self) -> Block:
        """The block, recalled statements turned into loads."""
        self.block.statements = [s for s in self.block.statements if s.target not in self._recalled]
        self.block.loads.update(self._recalled)
        return self.block

    def find(self, value: Expr) -> Expr | None:
        """The name of an expression (or minus the name of its negative), if it has one."""
        known = self._named.get(value)
        if known is None:
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
        return _symbol_named(unique)


class Nonzero:
    """The structural value "may differ from zero"; the other one is the int 0."""

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


class StructuralExpansion:
    """Runs block-writing code on zero patterns only; `stored` receives the fields that are written.

    The numbers 1 and -1 pass through as they are: the axis of a planar mechanism is one in every link.
    """

    structural = True

    def __init__(
        self,
        nonzero: Callable[[str, str], bool],
        tangents: bool = False,
        known: Callable[[str, str], int | None] = lambda array, name: None,
        units: bool = False,
    ):
        self.units = units
        self._nonzero = nonzero
        self._known = known
        self.tangents = tangents
        self.stored: dict[tuple[str, str], int | None] = {}
        """The 0, 1 or -1 that a field is whatever the state, or None."""

    def load(self, array: str, name: str) -> Any:
        if not self._nonzero(array, name):
            return 0
        known = self._known(array, name)
        return ANY if known is None else known

    def store(self, array: str, name: str, value: Any) -> None:
        value = self.let(name, value)
        if array.partition("#")[0].endswith("_sum"):
            # added to what others store there: what it is cannot be known from one of them
            value = ANY if value else 0
        number = value if isinstance(value, int) else None
        key = array, name
        self.stored[key] = number if self.stored.get(key, number) == number else None

    def let(self, name: str, value: Any, tag: str = "", lanes: bool = False) -> Any:
        if isinstance(value, Nonzero):
            return value
        # of numbers only 0, 1 and -1 are kept apart; quotients of those are floats
        return int(value) if value in (0, 1, -1) else ANY

    def name(self, name: str, value: Any, tag: str = "") -> Any:
        return self.let(name, value)

    def recall(self, vectors: dict[str, Any], array: str = "me") -> None:
        pass

    def recall_each(self, fields: dict[str, Any], array: str = "me") -> None:
        pass
