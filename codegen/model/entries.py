"""Parts of the entries of a model file: expressions, names, axes, points and frames, as Pydantic reads them.

Names and values are not known here: numbers become parsed expressions, and references parsed names.
"""

from __future__ import annotations

import numbers
from collections.abc import Callable
from typing import Annotated, Any, ClassVar, Final

from pydantic import BaseModel, ConfigDict, PlainValidator, WrapValidator, model_validator
from pydantic_core import PydanticCustomError

from .binding import component_of
from .expressions import Expression
from .grammar import FUNCTIONS, ExpressionError
from .parsing import parse

ZERO: Final = Expression.number(0)
ONE: Final = Expression.number(1)

RESERVED: Final = frozenset({"t", "q", "u", "pi", "ground", *FUNCTIONS})


class Misread:
    """Placeholder for a value that could not be converted from an object of another program, such as sympy.

    Attributes
    ----------
    message : str
        What was found and what is allowed.
    """

    def __init__(self, message: str) -> None:
        self.message = message

    def __repr__(self) -> str:
        return self.message


def complaint(message: str, column: int | None = None) -> PydanticCustomError:
    """The exception that reports an error in a value."""
    return PydanticCustomError("model", "{message}", {"message": message, "column": column or 0})


def shown(value: Any) -> str:
    """A value as text for messages."""
    if value is None:
        return "nothing"
    if isinstance(value, dict):
        return "a mapping"
    if isinstance(value, (list, tuple)):
        return f"a list of {len(value)}"
    if isinstance(value, int) and abs(value) >= 10**60:  # Python does not print integers of several thousand digits
        return f"a number of about 10**{int(value.bit_length() * 0.30103)}"
    text = str(value) if isinstance(value, Expression) else repr(value)
    return text if len(text) <= 60 else text[:57] + "..."


def _expression(value: Any) -> Expression:
    if type(value) is str:
        try:
            return parse(value)
        except ExpressionError as error:
            raise complaint(f"{shown(value)}: {error.message}", error.column) from None
    if isinstance(value, Expression):
        return value
    if isinstance(value, numbers.Real) and not isinstance(value, bool):
        try:
            return Expression.number(int(value) if isinstance(value, numbers.Integral) else float(value))
        except (OverflowError, ValueError):
            raise complaint(f"{shown(value)}; a finite number or an expression is needed") from None
    if isinstance(value, Misread):
        raise complaint(value.message)
    raise complaint(f"{shown(value)}; a number or an expression is needed")


def _reference(value: Any) -> Expression:
    tree = parse_name(value)
    return Expression(tree)


def parse_name(value: Any, prefix: str = "") -> tuple[Any, ...]:
    """Tree of a name, or of an indexed name such as ``link(k-1)``, after adding `prefix` (``q.`` or ``u.``).

    Raises
    ------
    PydanticCustomError
        A ValueError with the value found and the form of names.
    """
    if not isinstance(value, str):
        raise complaint(f"{shown(value)}; a name is needed")
    if not prefix and value in RESERVED:
        return ("name", value)  # not parsed, as "pi" would become a number; later checks report unknown names
    try:
        tree = parse(prefix + value).tree
    except ExpressionError:
        tree = ("none",)
    if tree[0] not in ("name", "indexed") or ("." in tree[1] and not prefix):
        raise complaint(
            f"{shown(value)} is not a valid name; a name has letters, digits and _, does not begin with a digit, "
            f"and may have repeat indices: link(k)"
        )
    return tree


_LETTERS: Final = {
    sign + letter: tuple(Expression.number((-1 if sign else 1) if k == i else 0) for k in range(3))
    for i, letter in enumerate("xyz")
    for sign in ("", "-")
}


NO_AXIS: Final = "an axis; x, y, z, -x, -y, -z or a vector [x, y, z] is allowed"
_NO_VECTOR: Final = "a vector; three numbers [x, y, z] are needed, or a parameter or constant that is a vector"


def _axis(value: Any, handler: Callable[[Any], Any]) -> Any:
    if type(value) is str:
        return _LETTERS[value] if value in _LETTERS else _by_name(value, NO_AXIS)
    return _by_name(value, NO_AXIS) if isinstance(value, (Expression, Misread)) else handler(value)


def _vector(value: Any, handler: Callable[[Any], Any]) -> Any:
    if isinstance(value, (str, Expression, Misread)):
        found = _expression(value)
        if found.names:  # an expression without names is a number, which the handler reads
            return _by_name(found, _NO_VECTOR)
    return handler(value)


def _by_name(value: Any, wanted: str) -> Any:
    """The three components of an expression given in place of a vector."""
    tree = _expression(value).tree
    return tuple(Expression(component_of(tree, k, wanted)) for k in range(3))


def list_or_one(value: Any, handler: Callable[[Any], Any]) -> Any:
    return handler(value if isinstance(value, (list, tuple)) else (value,))


def written(value: Any, handler: Callable[[Any], Any]) -> Any:
    """Validator of an optional key: an empty value is an error."""
    if value is None:
        raise complaint("there is nothing after the colon; write a value, or leave the key out")
    return handler(value)


def one_of(*words: str, what: str = "") -> PlainValidator:
    """A validator for one of some words; `what` is the meaning of the words, for messages."""

    def check(value: Any) -> str:
        if value not in words:
            allowed = f"{', '.join(words[:-1])} or {words[-1]} is allowed"
            raise complaint(f"{shown(value)}; {allowed}{what and ': '}{what}")
        return str(value)

    return PlainValidator(check)


def _coordinate(value: Any) -> Expression:
    return Expression(parse_name(value, prefix="q."))


Coordinate = Annotated[Expression, PlainValidator(_coordinate)]
OptionalCoordinate = Annotated[Expression | None, PlainValidator(_coordinate)]
Expr = Annotated[Expression, PlainValidator(_expression)]
OptionalExpr = Annotated[Expression | None, PlainValidator(_expression)]
Reference = Annotated[Expression, PlainValidator(_reference)]
Vector = Annotated[tuple[Expr, Expr, Expr], WrapValidator(_vector)]
Axis = Annotated[tuple[Expr, Expr, Expr], WrapValidator(_axis)]
OptionalVector = Annotated[Vector | None, WrapValidator(written)]
Origin: Final = (ZERO, ZERO, ZERO)


class Entry(BaseModel):
    """Base class of the entries of a model file: mappings with fixed keys.

    Attributes
    ----------
    placeholders : dict of str to Any
        Replacements of required values that are missing or wrong.
    misspelt : dict of str to str
        The correct key for each of some wrong keys.
    """

    placeholders: ClassVar[dict[str, Any]] = {}
    misspelt: ClassVar[dict[str, str]] = {}

    model_config = ConfigDict(extra="forbid", frozen=True, arbitrary_types_allowed=True, defer_build=True)


class RotationEntry(Entry):
    axis: Axis
    angle: Expr


class PlacedEntry(Entry):
    """Base class of entries with a pose: a frame in a body."""

    at: Vector = Origin
    rotate: Annotated[tuple[RotationEntry, ...] | None, WrapValidator(written)] = None
    rpy: OptionalVector = None

    @model_validator(mode="after")
    def _one_rotation(self) -> PlacedEntry:
        if self.rotate is not None and self.rpy is not None:
            raise complaint("rotate and rpy are both given; only one of them is allowed")
        return self


class PointEntry(Entry):
    placeholders: ClassVar[dict[str, Any]] = {"body": "ground"}

    body: Reference
    at: Vector = Origin


def _point(value: Any, handler: Callable[[Any], Any]) -> Any:
    return _reference(value) if isinstance(value, str) else handler(value)


PointOrName = Annotated[PointEntry, WrapValidator(_point)]


class FaceEntry(PlacedEntry):
    """One of the two faces of a loop joint."""

    body: Reference


FaceOrName = Annotated[FaceEntry, WrapValidator(_point)]
