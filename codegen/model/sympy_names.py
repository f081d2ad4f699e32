"""Names in a model of sympy symbols: parameters, inputs, time, coordinates and speeds."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from typing import Any, Final

from .entries import Misread
from .errors import Problem, nearest
from .grammar import MEASURED, ExpressionError, Tree
from .joints import JOINTS
from .sympy_trees import from_sympy_expression, is_sympy

_GIVE: Final = 'ModelBuilder.symbols({...: "q.NAME"}) gives it a name of the model'
_SECTIONS: Final = ("constants", "parameters", "expressions")
_QUALIFIED: Final = ("q.", "u.", *(f"{what}." for what in MEASURED))
_NAMING: Final = ("joint", "driving_force", "independent", "follows")
"""Keys whose value is the name of a coordinate."""
_MOST: Final = 12
"""Number of names that a message lists."""


class SympyNames:
    """Finds the names that sympy symbols have in a model.

    A `Symbol` keeps its name. A function of time, such as those of `dynamicsymbols`, is the coordinate of the body of
    the same name if this body is on a joint with one coordinate. It may also be the input of the same name, or have the
    name of a quantity: ``q.NAME``, ``u.NAME``. The time derivative of a coordinate is the speed.

    Parameters
    ----------
    root : dict
        The sections of the model, as plain data.
    given : mapping of sympy.Basic to str
        Names given by the caller.
    """

    def __init__(self, root: Mapping[str, Any], given: Mapping[Any, str]) -> None:
        self.given = given
        self.inputs = [n for n in root.get("inputs", ()) if isinstance(n, str)]
        self.tables = root.get("tables") or {}
        self.values = {n for section in _SECTIONS for n in root.get(section) or ()}
        self.joints: dict[str, Any] = {}
        for name, body in (root.get("bodies") or {}).items():
            joint = body.get("joint") if isinstance(body, Mapping) else None
            kind = joint.get("type") if isinstance(joint, Mapping) else joint
            self.joints[name] = JOINTS.get(kind) if isinstance(kind, str) else None

    def __call__(self, e: Any) -> Tree:
        """The tree of a symbol, of a function of time or of a time derivative.

        Raises
        ------
        ExpressionError
            If the model has no such name.
        """
        import sympy

        if e in self.given:
            return ("name", self.given[e])
        if isinstance(e, sympy.Derivative):
            return ("name", self.rate(e))
        if isinstance(e, sympy.Dummy):
            raise ExpressionError(f"the dummy symbol {e} has no name of its own; {_GIVE}")
        if e.is_Symbol:
            return ("name", "t" if e == time() else e.name)
        name, arguments = str(e.func), e.args
        if name in self.tables:
            return ("indexed", name, tuple(from_sympy_expression(a, self).tree for a in arguments), "")
        if arguments != (time(),):
            kinds = "a function of time, or of a table of the model, is needed"
            raise ExpressionError(f"{e}: unknown function {name!r} of {_listed(map(str, arguments))}; {kinds}")
        return ("name", self.function(name))

    def function(self, name: str) -> str:
        """The name in the model of a function of time."""
        if name.startswith(_QUALIFIED):
            return name
        if name in self.inputs and name in self.joints:
            raise ExpressionError(f"{name}(t) may be the input {name!r} or the coordinate 'q.{name}'; {_GIVE}")
        if name in self.inputs or name in self.values:
            return name
        if name in self.joints:
            joint = self.joints[name]
            if joint is None or len(joint.coordinates) == 1:
                return f"q.{name}"
            own = [f"q.{name}.{c}" for c in joint.coordinates]
            has = (
                f"the joint of {name!r} has the coordinates {_listed(own)}"
                if own
                else f"the joint of {name!r} is fixed"
            )
            raise ExpressionError(f"{name}(t): {has}; {_GIVE}")
        known = [*self.inputs, *(n for n, j in self.joints.items() if j is None or len(j.coordinates) == 1)]
        raise ExpressionError(
            f"{name}(t) is not a coordinate, speed or input of this model; functions of time here are {_listed(known)}"
            f"{nearest(name, known)}; {_GIVE}"
        )

    def rate(self, e: Any) -> str:
        """The name in the model of a time derivative."""
        if any(v != time() for v in e.variables):
            raise ExpressionError(f"{e}: only time derivatives of coordinates are allowed")
        if not (e.expr.is_Symbol or e.expr.func.__class__.__name__ == "UndefinedFunction"):
            raise ExpressionError(f"{e}: sympy finds no closed form of this derivative; write the result")
        tree = self(e.expr)
        name = tree[1]
        if tree[0] != "name":
            raise ExpressionError(f"{e} is the derivative of table {name!r}; only those of coordinates are allowed")
        if len(e.variables) > 1:
            raise ExpressionError(f"{e} is an acceleration; only coordinates and speeds are allowed in expressions")
        what, _, rest = str(name).partition(".")
        if what == "position":
            return f"velocity.{rest}"
        joint = self.joints.get(rest.partition(".")[0])
        if what == "q" and joint is not None and joint.quaternions:
            speeds = [f"u.{rest.partition('.')[0]}.{s}" for s in joint.speeds]
            raise ExpressionError(f"{e}: rates of this joint's coordinates are not speeds; use {_listed(speeds)}")
        if what == "q":
            return f"u.{rest}"
        what_it_is = "speed" if what == "u" else "input" if name in self.inputs else "quantity"
        raise ExpressionError(f"{e} is the derivative of {what_it_is} {name!r}; only those of coordinates are allowed")

    def key(self, e: Any) -> str:
        """The name of a coordinate or speed as a key of the model, without ``q.`` or ``u.``."""
        tree = self(e)
        if tree[0] != "name":
            raise ExpressionError(f"{e}: the name of a coordinate or a speed is needed")
        name: str = tree[1]
        return name[2:] if name.startswith(("q.", "u.")) else name


def time() -> Any:
    """The symbol of time: that of `dynamicsymbols`, or ``t``."""
    import sympy

    loaded = sys.modules.get("sympy.physics.vector")
    return sympy.Symbol("t") if loaded is None else loaded.dynamicsymbols._t


def checked_names(names: Mapping[Any, Any]) -> dict[Any, str]:
    """Names that a caller gives to sympy symbols, checked.

    Raises
    ------
    TypeError
        If a key is not a sympy object, or a name is not a text.
    """
    for symbol, name in names.items():
        if not is_sympy(symbol) or not isinstance(name, str):
            raise TypeError(
                f"symbols takes a mapping from sympy's symbols to names of the model, not {symbol!r}: {name!r}"
            )
    return {symbol: str(name) for symbol, name in names.items()}


def resolved(value: Any, names: SympyNames, path: tuple[str, ...], problems: list[Problem]) -> Any:
    """Plain data in which sympy objects are replaced by expressions, lists and names.

    Parameters
    ----------
    value : Any
        Mappings, lists and scalars.
    names : SympyNames
    path : tuple of str
        Path of the value in the model.
    problems : list of Problem
        Receives the errors in keys.

    Returns
    -------
    Any
        The data; a value with an error becomes a `Misread`.
    """
    if isinstance(value, dict):
        found: dict[str, Any] = {}
        for key, inner in value.items():
            try:
                name = names.key(key) if is_sympy(key) else key
                if name in found:
                    raise ExpressionError(f"name {name!r} is given twice; each name may be given once")
            except ExpressionError as error:
                problems.append(Problem("builder", None, None, ".".join(path), error.message))
                continue
            found[name] = resolved(inner, names, (*path, name), problems)
        return found
    if isinstance(value, list):
        return [resolved(inner, names, path, problems) for inner in value]
    if not is_sympy(value):
        return value
    try:
        if path[-1] in _NAMING:
            return names.key(value)
        if not getattr(value, "is_Indexed", False) and getattr(value, "shape", None) is not None:
            return resolved(_entries(value, path[-1]), names, path, problems)
        return from_sympy_expression(value, names)
    except ExpressionError as error:
        return Misread(error.message)


def _entries(matrix: Any, key: str) -> Any:
    """A vector as a list, or the inertia matrix as the mapping of a model file."""
    if len(matrix.shape) == 1:
        return list(matrix)
    if len(matrix.shape) > 2:
        raise ExpressionError(f"an array has the shape {matrix.shape}; a row or a column is allowed")
    rows, columns = matrix.shape
    if 1 in (rows, columns):
        return list(matrix)
    if key != "inertia" or (rows, columns) != (3, 3):
        allowed = "a row or a column" + (", or 3 by 3" if key == "inertia" else "")
        raise ExpressionError(f"a matrix has the shape {matrix.shape}; {allowed} is allowed")
    if (matrix - matrix.T).expand() != 0 * matrix:
        raise ExpressionError("the inertia matrix is not symmetric; it must be")
    return {"xyz"[i] + "xyz"[j]: matrix[i, j] for i in range(3) for j in range(i, 3) if matrix[i, j] != 0}


def _listed(names: Any) -> str:
    every = list(names)
    return (", ".join(every[:_MOST]) + (", ..." if len(every) > _MOST else "")) or "(none)"
