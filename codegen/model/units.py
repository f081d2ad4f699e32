"""Units of numbers in a model file: ``30 mm``, ``200 N/m``, ``15 deg``.

A number with a unit stands for its value in SI, exact to rounding. Its dimension is compared with the one wanted at its place.
Plain numbers are in SI units and fit everywhere.
"""

from __future__ import annotations

import re
from fractions import Fraction
from typing import Any, Final, NamedTuple

from ..elementary import named
from .errors import nearest

PI: Final = Fraction("3.14159265358979323846264338327950288419716939937510582097494459230781640628620899")


class Dimension(NamedTuple):
    """Exponents of metre, kilogram and second; all zero for angles."""

    length: Fraction | int = 0
    mass: Fraction | int = 0
    time: Fraction | int = 0

    def times(self, other: Dimension, power: Fraction | int = 1) -> Dimension:
        """Dimension of the product with a power of another quantity."""
        return Dimension(*(a + power * b for a, b in zip(self, other, strict=True)))


class Frequency(Dimension):
    """Dimension of a number in Hz alone. It equals that of an angular rate, 1/s, but is never meant as one."""

    __slots__ = ()


NONE: Final = Dimension()
_FORCE, _ENERGY, _POWER = Dimension(1, 1, -2), Dimension(2, 1, -2), Dimension(2, 1, -3)

_SIZES: Final[dict[Dimension, dict[str, str | int | Fraction]]] = {
    Dimension(1): {"m": 1, "mm": "0.001", "cm": "0.01", "dm": "0.1", "km": 1000, "um": "1e-6",
                   "inch": "0.0254", "ft": "0.3048"},
    Dimension(0, 1): {"kg": 1, "g": "0.001", "mg": "1e-6", "lb": "0.45359237"},
    Dimension(0, 0, 1): {"s": 1, "ms": "0.001", "us": "1e-6", "minute": 60, "h": 3600},
    Dimension(0, 0, -1): {"Hz": 1, "rpm": PI / 30},
    _FORCE: {"N": 1, "kN": 1000, "MN": 10**6, "mN": "0.001", "lbf": "4.4482216152605"},
    _ENERGY: {"J": 1, "kJ": 1000, "MJ": 10**6, "mJ": "0.001", "Nm": 1, "kNm": 1000},
    _POWER: {"W": 1, "kW": 1000, "MW": 10**6, "mW": "0.001"},
    Dimension(-1, 1, -2): {"Pa": 1, "kPa": 1000, "MPa": 10**6, "GPa": 10**9, "bar": 10**5},
    NONE: {"rad": 1, "mrad": "0.001", "deg": PI / 180, "rev": 2 * PI},
}  # fmt: skip
UNITS: Final[dict[str, tuple[Fraction, Dimension]]] = {
    name: (Fraction(size), Frequency(*dimension) if name == "Hz" else dimension)
    for dimension, names in _SIZES.items()
    for name, size in names.items()
}
"""SI value and dimension of every unit."""

_FACTOR = r"[A-Za-z]+(?:(?:\*\*|\^)-?[0-9]+)?"
_UNIT = re.compile(rf"{_FACTOR}(?:[*/]{_FACTOR})*")
_PART = re.compile(r"([*/]?)([A-Za-z]+)(?:(?:\*\*|\^)(-?[0-9]+))?")
_LAST_UNIT = re.compile(r"[A-Za-z][A-Za-z0-9*/^-]*$")
_NAMES: Final = {
    NONE: ("a plain number or an angle", "rad"),
    Dimension(1): ("a length", "m"),
    Dimension(2): ("an area", "m**2"),
    Dimension(0, 1): ("a mass", "kg"),
    Dimension(0, 0, 1): ("a time", "s"),
    Dimension(0, 0, -1): ("a rate", "rad/s"),
    Dimension(1, 0, -1): ("a velocity", "m/s"),
    Dimension(1, 0, -2): ("an acceleration", "m/s**2"),
    Dimension(2, 1): ("a moment of inertia", "kg*m**2"),
    Dimension(-3, 1): ("a density", "kg/m**3"),
    Dimension(-1, 1): ("a mass per length", "kg/m"),
    _FORCE: ("a force", "N"),
    _ENERGY: ("a torque or an energy", "N*m"),
    _POWER: ("a power", "W"),
    Dimension(0, 1, -2): ("a stiffness", "N/m"),
    Dimension(0, 1, -1): ("a damping", "N*s/m"),
    Dimension(2, 1, -1): ("a rotational damping", "N*m*s/rad"),
}


class UnitError(ValueError):
    """Raised for a text that is not a unit."""


def unit_at(text: str, start: int) -> tuple[Fraction, Dimension, int]:
    """The unit that begins at a place in a text: SI value, dimension, and the end of the unit in the text.

    It extends over all known units that follow without a space, joined by ``*`` or ``/``.

    Raises
    ------
    UnitError
        If there is no known unit.
    """
    match = _UNIT.match(text, start)
    size, dimension, end = Fraction(1), NONE, start
    for part in _PART.finditer(match.group() if match else ""):
        sign, name, power = part.groups()
        if name not in UNITS:
            break
        exponent = int(power or 1) * (-1 if sign == "/" else 1)
        if abs(exponent) > 9:
            raise UnitError(f"{name}**{power} is not allowed; powers of units go up to 9")
        own, of = UNITS[name]
        dimension = of if end == start and exponent == 1 else dimension.times(of, exponent)
        size, end = size * own**exponent, start + part.end()
    if end == start:
        name = re.compile(r"\w*").match(text, start).group()  # type: ignore[union-attr]
        raise UnitError(f"{name!r} is not a unit; units are {', '.join(UNITS)}{nearest(name, UNITS)}")
    return size, dimension, end


def unit_of(text: str) -> tuple[Fraction, Dimension] | None:
    """The unit that a text denotes; None if the text is only a description."""
    try:
        size, dimension, end = unit_at(text, 0)
    except UnitError:
        return None
    return (size, dimension) if end == len(text) else None


def in_words(dimension: Dimension) -> str:
    """Description of a dimension, such as ``a length (m)``."""
    if isinstance(dimension, Frequency):
        return "a frequency (Hz)"
    if dimension in _NAMES:
        what, unit = _NAMES[dimension]
        return f"{what} ({unit})"
    return f"a quantity in {in_units(dimension)}"


def in_units(dimension: Dimension) -> str:
    """The SI unit of a dimension, such as ``kg*m**2/s``."""
    if isinstance(dimension, Frequency):
        return "Hz"
    if dimension in _NAMES:
        return "" if dimension == NONE else _NAMES[dimension][1]
    exponents = [("kg", dimension.mass), ("m", dimension.length), ("s", dimension.time)]
    parts = [unit if e == 1 else f"{unit}**{e}" for unit, e in exponents if e > 0]
    below = [f"/{unit}" if e == -1 else f"/{unit}**{-e}" for unit, e in exponents if e < 0]
    return ("*".join(parts) or "1") + "".join(below)


def misfit(tree: Any, text: str, found: Dimension, wanted: Dimension) -> str:
    """Message about an expression whose dimension is not the required one.

    Parameters
    ----------
    tree : tuple
        Tree of the parsed `Expression`.
    text : str
        The expression as text.
    """
    number = tree[1] if tree[0] == "neg" else tree
    unit = _LAST_UNIT.search(number[3]) if number[0] == "quantity" else None
    what = "an angle (rad)" if unit and unit.group() in _SIZES[NONE] else in_words(found)
    message = f"{text} is {what}; {in_words(wanted)} is needed"
    for by, time in (("/s", -1), ("/s**2", -2)):
        if unit and found.times(Dimension(time=time)) == wanted:
            message += f": write {text}{by}"
    return message


class DimensionError(ValueError):
    """Raised for dimensions that do not fit each other."""


_PURE: Final = frozenset(named("name", lambda e: e.pure))
_PLAIN: Final = "plain"
"""Dimension of a number without unit: the number has no effect in a product, and fits any dimension in a sum."""


def dimension_of(tree: Any, known: Any) -> Dimension | None:
    """The dimension of an expression; None if it contains a name of unknown dimension.

    Parameters
    ----------
    tree : tuple
        Tree of a parsed `Expression`.
    known : mapping of str to Dimension
        Dimensions of names.

    Raises
    ------
    DimensionError
        If dimensions in a sum, a function or a comparison do not fit.
    """
    found = _dimension(tree, known)
    return None if found == _PLAIN else found


def _dimension(tree: Any, known: Any) -> Any:
    kind = tree[0]
    if kind == "number":
        return _PLAIN
    if kind == "quantity":
        return tree[2]
    if kind == "name":
        return known.get(tree[1].partition(".")[0])
    if kind == "component" or kind == "neg":
        return _dimension(tree[1], known)
    if kind == "indexed" or kind == "%":
        return None
    if kind == "call" and tree[1] == "choice":
        _dimension(tree[2], known)
        return _alike(_dimension(tree[3], known), _dimension(tree[4], known), "an alternative to")
    if kind == "call":
        return _of_call(tree[1], [_dimension(a, known) for a in tree[2:]])
    a, b = (_dimension(x, known) for x in tree[1:])
    if kind in ("+", "-"):
        return _alike(a, b, "added to" if kind == "+" else "subtracted from")
    if kind == "**":
        if b not in (_PLAIN, None) and b != NONE:
            raise DimensionError(f"an exponent is {in_words(b)}; exponents have no unit")
        if a in (_PLAIN, None):
            return a
        exponent = _whole(tree[2])
        return a if a == NONE else None if exponent is None else NONE.times(a, exponent)
    if a is None or b is None:
        return None
    if a == _PLAIN and b == _PLAIN:
        return _PLAIN
    return (NONE if a == _PLAIN else a).times(NONE if b == _PLAIN else b, 1 if kind == "*" else -1)


def _whole(tree: Any) -> Fraction | None:
    """The value of an exponent that is a number; otherwise None."""
    if tree[0] == "neg":
        inner = _whole(tree[1])
        return None if inner is None else -inner
    return Fraction(tree[1]) if tree[0] == "number" else None


def _alike(a: Any, b: Any, what: str) -> Any:
    """The dimension of a sum: the dimension of either term, as far as one is known."""
    for one, other in ((a, b), (b, a)):
        if one is None or one == _PLAIN:
            return other if one == _PLAIN or other != _PLAIN else one
    if a != b:
        raise DimensionError(f"{in_words(b)} is {what} {in_words(a)}")
    return a


def _of_call(function: str, arguments: list[Any]) -> Any:
    if function in _PURE:
        if arguments[0] not in (_PLAIN, None) and arguments[0] != NONE:
            raise DimensionError(f"{function} of {in_words(arguments[0])}; it takes an angle or a plain number")
        return _PLAIN if arguments[0] == _PLAIN else None if arguments[0] is None else NONE
    if function == "sqrt":
        a = arguments[0]
        return a if a in (_PLAIN, None) else NONE.times(a, Fraction(1, 2))
    if function == "sign":
        return NONE
    if function == "abs":
        return arguments[0]
    both = _alike(arguments[0], arguments[1], "compared with")
    return NONE if function == "atan2" else both
