"""The classes of `algebra`, as the code that writes blocks knows them: their types are left open to type checkers.

The same code computes with expressions and with zero patterns, see `block`, and what it makes is an expression where it is
used as one. `algebra` itself is checked.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:  # a library without types, whose classes may be anything to a checker
    from sympy import Expr, Function, Number, Pow, Symbol
else:
    from .algebra import Expr, Function, Number, Pow, Symbol

__all__ = ["Expr", "Function", "Number", "Pow", "Symbol"]
