"""Models built in Python: the same structure as a file, through the same checks."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping, Sequence
from os import PathLike, fspath
from typing import Any

from .assembly import assemble
from .errors import Problem
from .expressions import Expression
from .model import Model
from .positions import Document
from .sympy_trees import is_sympy

Scalar = str | int | float | Expression | Any
"""A number, an expression as the format writes it, or one of sympy's."""
Vector3 = str | Sequence[Scalar]
"""Three of them, or an expression of vectors."""


class ModelBuilder:
    """Builds a `Model` step by step; every argument means what the key of that name means in a model file.

    Nothing is checked before `build`, which reports all problems at once.

    Parameters
    ----------
    name : str
        Names the generated package.
    gravity : sequence of three numbers, optional
        m/s^2 in the ground frame.
    loop_tolerance : number, optional
        See `Model.loop_tolerance`.
    folder : str or path, optional
        Where the files of submodels, and included ones, are.

    Examples
    --------
    >>> b = ModelBuilder("pendulum", gravity=[0, 0, -9.81])
    >>> L = b.parameter("L", 1.0, unit="m")
    >>> arm = b.body("arm", joint="revolute", axis="y", mass=2, com=[0, 0, -L / 2], inertia={"yy": 0.1})
    >>> b.joint_force("damper", arm, f"-0.1*u.{arm}")
    >>> model = b.build()
    >>> model.nu
    1
    """

    def __init__(
        self,
        name: str,
        gravity: Vector3 | None = None,
        loop_tolerance: Scalar | None = None,
        folder: str | PathLike[str] | None = None,
    ) -> None:
        self._folder = None if folder is None else fspath(folder)
        self._root: dict[str, Any] = {"model": name}
        if gravity is not None:
            self._root["gravity"] = _plain(gravity)
        if loop_tolerance is not None:
            self._root["loop_tolerance"] = _plain(loop_tolerance)
        self._problems: list[Problem] = []
        self._symbols: dict[Any, str] = {}

    def symbols(self, names: Mapping[Any, str]) -> None:
        """Give symbols of sympy, and functions of time, the names that they have in the model; may be called several times.

        Without it a symbol is the parameter, constant or input of its name, ``t`` is the time, and a function of time, as
        `dynamicsymbols` makes them, is the input of its name or the coordinate of the body of its name.

        Parameters
        ----------
        names : mapping of sympy.Symbol or sympy.Function to str
            ``{theta: "q.arm", omega: "u.arm"}``.

        Raises
        ------
        TypeError
            A key that is no object of sympy's, or a name that is no str.

        Examples
        --------
        >>> import sympy
        >>> from sympy.physics.mechanics import dynamicsymbols
        >>> theta, m = dynamicsymbols("theta"), sympy.Symbol("m")
        >>> b = ModelBuilder("pendulum", gravity=[0, 0, -9.81])
        >>> b.parameter("m", 2)
        'm'
        >>> arm = b.body("arm", joint="revolute", axis="y", mass=m, com=[0, 0, sympy.Rational(-1, 2)], inertia={"yy": m / 12})
        >>> b.symbols({theta: f"q.{arm}"})
        >>> b.joint_force("spring", arm, -3 * sympy.tanh(theta) - theta.diff() / 10)
        >>> print(b.build().forces[0].value[0])
        -(3*tanh(q.arm)) - u.arm/10
        """
        from .sympy_names import checked_names

        self._symbols.update(checked_names(names))

    def constant(self, name: str, value: Scalar | Sequence[Scalar]) -> Name:
        """A number known at generation time."""
        self._put("constants", name, _plain(value))
        return Name(name)

    def parameter(
        self,
        name: str,
        value: Scalar | Sequence[Scalar],
        unit: str = "",
        min: Scalar | Sequence[Scalar] | None = None,
        max: Scalar | Sequence[Scalar] | None = None,
    ) -> Name:
        """A design parameter, or a vector of three; the result may be used in expressions as it is or by its name."""
        self._put("parameters", name, _given(value=value, unit=unit, min=min, max=max))
        return Name(name)

    def input(self, name: str) -> Name:
        """A run-time input."""
        self._root.setdefault("inputs", []).append(_plain(name))
        return Name(name)

    def expression(self, name: str, value: Scalar) -> Name:
        """A name for an expression that several entries have in common."""
        self._put("expressions", name, _plain(value))
        return Name(name)

    def table(
        self,
        name: str,
        x: Sequence[Scalar],
        y: Sequence[Scalar],
        outside: str,
        kind: str = "linear",
        period: Scalar | None = None,
    ) -> None:
        """A function of one number by its points, called in expressions by its name: ``torque(u.wheel)``."""
        self._put("tables", name, _given(x=x, y=y, outside=outside, kind=kind, period=period))

    def body(
        self,
        name: str,
        parent: str = "ground",
        joint: str | Mapping[str, Any] = "revolute",
        *,
        axis: str | Sequence[Scalar] | None = None,
        axes: Sequence[str | Sequence[Scalar]] | None = None,
        normal: str | Sequence[Scalar] | None = None,
        pitch: Scalar | None = None,
        armature: Scalar | Sequence[Scalar] | None = None,
        at: Vector3 | None = None,
        rotate: Sequence[Mapping[str, Any]] | None = None,
        rpy: Vector3 | None = None,
        mass: Scalar | None = None,
        com: Vector3 | None = None,
        inertia: Mapping[str, Scalar] | None = None,
        shape: Mapping[str, Any] | None = None,
    ) -> str:
        """A body and its joint; the result is its name, for use as a parent.

        Parameters
        ----------
        name, parent : str
        joint : str or mapping
            Type of the joint, with `axis`, `axes`, `normal`, `pitch`, `armature`, `at`, `rotate` and `rpy` beside it; or
            everything in a mapping.
        mass, com, inertia, shape
            As in a model file; left out: 0, or from `shape`.
        """
        placed = _given(
            axis=axis, axes=axes, normal=normal, pitch=pitch, armature=armature, at=at, rotate=rotate, rpy=rpy
        )
        whole = {**_plain(joint), **placed} if isinstance(joint, Mapping) else {"type": joint, **placed}
        entry = _given(parent=parent, joint=whole, mass=mass, com=com, inertia=inertia, shape=shape)
        self._put("bodies", name, entry)
        return name

    def submodel(
        self,
        name: str,
        use: str,
        on: str = "ground",
        *,
        at: Vector3 | None = None,
        rotate: Sequence[Mapping[str, Any]] | None = None,
        rpy: Vector3 | None = None,
        given: Mapping[str, Scalar | Sequence[Scalar]] | None = None,
    ) -> str:
        """A model file that is read once more, its names behind ``NAME_``; the result is the body that its ground is.

        Parameters
        ----------
        name : str
        use : str
            The file, by its path from the folder of the builder.
        on : str
            The body that its ground is fixed to, `at` and turned by `rotate` or `rpy` there.
        given : mapping
            Numbers that stand in the place of the file's own constants, parameters and inputs: ``with`` in a file.
        """
        entry = _given(use=use, on=on, at=at, rotate=rotate, rpy=rpy)
        if given:
            entry["with"] = _plain(given)
        self._put("submodels", name, entry)
        return name

    def include(self, file: str) -> None:
        """Read the sections of another file too, as if they stood here."""
        self._root.setdefault("include", []).append(_plain(file))

    def point(self, name: str, body: str, at: Vector3 = (0, 0, 0)) -> str:
        """A named point fixed in a body."""
        self._put("points", name, {"body": body, "at": _plain(at)})
        return name

    def loop(
        self,
        name: str,
        joint: str | Mapping[str, Any],
        start: str | Mapping[str, Any],
        end: str | Mapping[str, Any],
        *,
        axis: str | Sequence[Scalar] | None = None,
        axes: Sequence[str | Sequence[Scalar]] | None = None,
        normal: str | Sequence[Scalar] | None = None,
        length: Scalar | None = None,
        equation: Scalar | None = None,
        equations: Sequence[Scalar] | None = None,
    ) -> None:
        """A joint, or a condition on a point, that closes a loop.

        Parameters
        ----------
        name : str
        joint : str or mapping
            Type of the joint, with `axis`, `axes` or `normal` beside it, or of the condition, with `length`, `equation` or
            `equations`; or everything in a mapping.
        start, end : str or mapping
            ``from`` and ``to`` of a model file: a body with ``at`` and ``rotate`` or ``rpy``, or the name of a point.
        """
        placed = _given(axis=axis, axes=axes, normal=normal, length=length, equation=equation, equations=equations)
        whole = {**_plain(joint), **placed} if isinstance(joint, Mapping) else {"type": joint, **placed}
        self._put("loops", name, {"joint": whole, "from": _plain(start), "to": _plain(end)})

    def coupling(
        self, name: str, joint: str, follows: str | Mapping[str, Scalar], *, offset: Scalar | None = None
    ) -> None:
        """A coordinate that follows others: ``joint = sum of ratio * other + offset``.

        Parameters
        ----------
        name : str
        joint : str
            The coordinate, or a joint that has one only.
        follows : str or mapping
            Others with their ratios, expressions of parameters; a name alone is followed one to one.
        offset : number or str, optional
            rad or m.
        """
        whole = {"joint": joint, "follows": _plain(follows), **_given(offset=offset)}
        self._put("couplings", name, whole)

    def independent(self, *names: str) -> None:
        """Coordinates that shall be independent, or joints for all of theirs; may be called several times."""
        self._root.setdefault("independent", []).extend(_plain(names))

    def motion(self, name: str, value: Scalar | Sequence[Scalar]) -> None:
        """Prescribe a coordinate, or all of a joint, as a function of ``t``, parameters and inputs."""
        self._put("motion", name, value)

    def joint_force(self, name: str, joint: str, value: Scalar | Sequence[Scalar]) -> None:
        """A generalised force on the freedoms of a joint, positive where it raises u."""
        self._put("forces", name, {"type": "joint", "joint": joint, "value": _plain(value)})

    def force(self, name: str, type: str, **keys: Any) -> None:
        """A force element of any type, with the keys of a model file; ``start`` and ``end`` stand for ``from`` and ``to``."""
        renamed = {"start": "from", "end": "to"}
        self._put("forces", name, {"type": type, **{renamed.get(k, k): _plain(v) for k, v in keys.items()}})

    def spring(
        self,
        name: str,
        start: str | Mapping[str, Any],
        end: str | Mapping[str, Any],
        stiffness: Scalar,
        damping: Scalar | None = None,
        free_length: Scalar | None = None,
    ) -> None:
        """A spring and damper between two points, ``from`` and ``to`` of a model file; left out: 0."""
        given = _given(stiffness=stiffness, damping=damping, free_length=free_length)
        self._put("forces", name, {"type": "spring", "from": _plain(start), "to": _plain(end), **given})

    def output(
        self,
        name: str,
        measure: str | None = None,
        **keys: Any,
    ) -> None:
        """A named scalar: ``"kinetic_energy"``, ``"potential_energy"``, or keys as in a file: ``position=tip, axis="z"``."""
        given = _given(**keys)
        self._put("outputs", name, {**given, **_given(measure=measure)} if given else measure)

    def initial(
        self,
        q: Mapping[str, Scalar | Sequence[Scalar]] | None = None,
        u: Mapping[str, Scalar | Sequence[Scalar]] | None = None,
        equilibrium: bool | None = None,
    ) -> None:
        """Initial coordinates and speeds, and whether to begin at rest near them; may be called several times."""
        initial = self._root.setdefault("initial", {})
        if equilibrium is not None:
            initial["equilibrium"] = equilibrium
        for key, values in (("q", q), ("u", u)):
            if values is not None and not isinstance(values, Mapping):
                problem = f"{type(values).__name__}; a mapping from names to values is needed"
                self._problems.append(Problem("builder", None, None, f"initial.{key}", problem))
                continue
            for name, value in (values or {}).items():
                self._put_into(initial.setdefault(key, {}), f"initial.{key}", name, _plain(value))

    def build(self) -> Model:
        """The model.

        Raises
        ------
        ModelError
            With every problem; the place is ``builder`` and the path of the key.
        """
        root, problems = self._root, list(self._problems)
        if "sympy" in sys.modules:
            from .sympy_names import SympyNames, resolved

            root = resolved(root, SympyNames(root, self._symbols), ("",), problems)
        document = Document("builder", root)
        document.problems.extend(problems)
        return assemble(document, self._folder)

    def _put(self, section: str, name: str, value: Any) -> None:
        self._put_into(self._root.setdefault(section, {}), section, name, value)

    def _put_into(self, mapping: dict[str, Any], section: str, name: Any, value: Any) -> None:
        problem = None
        if is_sympy(name):
            problem = f"{name} is given twice; each name may be given once" if name in mapping else None
        elif not isinstance(name, str):
            problem = f"{name!r} is not a valid name; a str is needed"
        elif name.startswith("repeat ") or "(" in name:
            problem = f"{name!r} is not a valid name; in Python, repeat with a loop"
        elif name in mapping:
            problem = f"name {name!r} is given twice; each name may be given once"
        if problem is None:
            mapping[name] = _plain(value)
        else:
            self._problems.append(Problem("builder", None, None, f"{section}.{name}", problem))


def _operation(operator: str, swapped: bool = False) -> Callable[[object, object], Name]:
    """A method of `Name`: the text of an operation."""

    def of(one: object, other: object) -> Name:
        if is_sympy(other):
            return NotImplemented  # sympy takes the name as `_sympy_` gives it
        left, right = (other, one) if swapped else (one, other)
        return Name(f"({_operand(left)} {operator} {_operand(right)})")

    return of


class Name(str):
    """Name of a parameter, constant or input that may be calculated with: ``L / 2`` is the expression of that text."""

    __slots__ = ()

    __add__, __radd__ = _operation("+"), _operation("+", swapped=True)
    __sub__, __rsub__ = _operation("-"), _operation("-", swapped=True)
    __mul__, __rmul__ = _operation("*"), _operation("*", swapped=True)
    __truediv__, __rtruediv__ = _operation("/"), _operation("/", swapped=True)
    __pow__ = _operation("**")

    def __neg__(self) -> Name:
        return Name(f"(-{_operand(self)})")

    def _sympy_(self) -> Any:
        """What sympy computes with."""
        from .parsing import parse
        from .sympy_output import to_sympy

        return to_sympy(parse(self))


def _operand(value: object) -> str:
    return str(value) if isinstance(value, Name) else f"({value})"


def _plain(value: Any) -> Any:
    """Mappings, lists and scalars, whatever kinds of sequence and array they came as."""
    if isinstance(value, str):
        return str(value)
    if isinstance(value, (int, float, Expression)) or value is None or is_sympy(value):
        return value
    if isinstance(value, Mapping):
        return {k if is_sympy(k) else str(k): _plain(v) for k, v in value.items()}
    if hasattr(value, "tolist"):
        return value.tolist()
    if isinstance(value, Sequence):
        return [_plain(v) for v in value]
    return value


def _given(**values: Any) -> dict[str, Any]:
    return {k: _plain(v) for k, v in values.items() if v is not None}
