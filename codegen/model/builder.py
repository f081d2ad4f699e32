"""Models built in Python, with the structure and the checks of a model file."""
# long: each of twenty methods has a signature and a docstring

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
"""A number, an expression as in a model file, or a sympy expression."""
Vector3 = str | Sequence[Scalar]
"""Three scalars, or a vector expression."""


class ModelBuilder:
    """Build a `Model` step by step. Arguments have the meaning of the same keys in a model file.

    Only `build` checks the model. It reports all problems at once.

    Parameters
    ----------
    name : str
        Name of the model and of the generated package.
    gravity : sequence of three numbers, optional
        Gravity in the ground frame, m/s^2.
    loop_tolerance : number, optional
        Tolerance within which loop conditions count as redundant; see `Model.loop_tolerance`.
    folder : str or path, optional
        Folder of included files and submodels.
    visuals : sequence of mappings, optional
        Solids and meshes on the ground that views show.

    Raises
    ------
    ModelError
        From `build`, if the model has errors.

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
        visuals: Sequence[Mapping[str, Any]] | None = None,
    ) -> None:
        self._folder = None if folder is None else fspath(folder)
        self._root: dict[str, Any] = {"model": name}
        if gravity is not None:
            self._root["gravity"] = _plain(gravity)
        if loop_tolerance is not None:
            self._root["loop_tolerance"] = _plain(loop_tolerance)
        if visuals is not None:
            self._root["visuals"] = _plain(visuals)
        self._problems: list[Problem] = []
        self._symbols: dict[Any, str] = {}

    def __repr__(self) -> str:
        counts = [
            f"{len(value)} {key}" for key, value in self._root.items() if isinstance(value, (dict, list)) and value
        ]
        return f"<ModelBuilder {self._root['model']}: {', '.join(counts) or 'nothing yet'}>"

    def symbols(self, names: Mapping[Any, str]) -> None:
        """Assign names in the model to sympy symbols and functions of time; may be called several times.

        Without this call, a symbol is the parameter, constant or input of the same name, and ``t`` is the time. A
        function of time, such as those of `dynamicsymbols`, is the input or the body's coordinate of the same name.

        Parameters
        ----------
        names : mapping of sympy.Symbol or sympy.Function to str
            ``{theta: "q.arm", omega: "u.arm"}``.

        Raises
        ------
        TypeError
            If a key is not a sympy object, or a name is not a str.

        Examples
        --------
        >>> import sympy
        >>> from sympy.physics.mechanics import dynamicsymbols
        >>> theta, m = dynamicsymbols("theta"), sympy.Symbol("m")
        >>> b = ModelBuilder("pendulum", gravity=[0, 0, -9.81])
        >>> mass = b.parameter("m", 2)
        >>> arm = b.body("arm", joint="revolute", axis="y", mass=m, com=[0, 0, sympy.Rational(-1, 2)], inertia={"yy": m / 12})
        >>> b.symbols({theta: f"q.{arm}"})
        >>> b.joint_force("spring", arm, -sympy.tanh(theta) - theta.diff() / 10)
        >>> print(b.build().forces[0].values[0])
        -tanh(q.arm) - u.arm/10
        """
        from .sympy_names import checked_names

        self._symbols.update(checked_names(names))

    def constant(self, name: str, value: Scalar | Sequence[Scalar]) -> Name:
        """Add a number that is known when the solver is generated.

        Parameters
        ----------
        name : str
            Name of the constant.
        value : number, expression, or sequence of these
            Value, SI units.

        Returns
        -------
        Name
            The name, for use in expressions.

        Examples
        --------
        >>> b = ModelBuilder("chain")
        >>> rho = b.constant("rho", 7850)
        >>> arm = b.body("arm", axis="y", mass=2 * rho * 0.001, com=[0, 0, -0.5])
        """
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
        """Add a design parameter, or a vector of three.

        Parameters
        ----------
        name : str
            Name of the parameter. The entries of a vector are ``NAME.x``, ``NAME.y`` and ``NAME.z``.
        value : number, expression, or sequence of three
            Default value, SI units.
        unit : str, optional
            Unit, such as ``"kg"``.
        min, max : number, expression, or sequence of three, optional
            Range of sensible values.

        Returns
        -------
        Name
            The name, for use in expressions.

        Examples
        --------
        >>> b = ModelBuilder("pendulum")
        >>> L = b.parameter("L", 1.0, unit="m", min=0.1, max=3.0)
        >>> arm = b.body("arm", axis="y", mass=2, com=[0, 0, -L / 2])
        """
        self._put("parameters", name, _given(value=value, unit=unit, min=min, max=max))
        return Name(name)

    def input(self, name: str) -> Name:
        """Add a run-time input.

        Parameters
        ----------
        name : str
            Name of the input.

        Returns
        -------
        Name
            The name, for use in expressions.

        Examples
        --------
        >>> b = ModelBuilder("motor")
        >>> torque = b.input("torque")
        >>> wheel = b.body("wheel", axis="z", inertia={"zz": 0.1})
        >>> b.joint_force("drive", wheel, torque)
        """
        self._root.setdefault("inputs", []).append(_plain(name))
        return Name(name)

    def expression(self, name: str, value: Scalar) -> Name:
        """Add a name for an expression that several entries use.

        Parameters
        ----------
        name : str
            Name of the expression.
        value : number or expression
            Expression of coordinates, speeds, parameters, inputs and time.

        Returns
        -------
        Name
            The name, for use in expressions.

        Examples
        --------
        >>> b = ModelBuilder("pendulum")
        >>> arm = b.body("arm", axis="y", mass=1, com=[0, 0, -1])
        >>> bend = b.expression("bend", "sin(q.arm)")
        >>> b.joint_force("spring", arm, f"-3*{bend}")
        """
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
        """Add a function of one number that is interpolated between points.

        Expressions call it by its name: ``torque(u.wheel)``.

        Parameters
        ----------
        name : str
            Name of the function.
        x, y : sequence of numbers or expressions
            Arguments, increasing, and values.
        outside : {"constant", "linear", "error", "periodic"}
            Continuation beyond the points.
        kind : {"linear", "cubic"}, optional
            Straight lines, or a cubic spline.
        period : number or expression, optional
            Period of a periodic table whose first point is not repeated.

        Examples
        --------
        >>> b = ModelBuilder("motor")
        >>> wheel = b.body("wheel", axis="z", inertia={"zz": 0.1})
        >>> b.table("torque", [0, 10, 20], [3, 2.5, 0], outside="constant")
        >>> b.joint_force("drive", wheel, "torque(u.wheel)")
        >>> b.build().nu
        1
        """
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
        visuals: Sequence[Mapping[str, Any]] | None = None,
    ) -> str:
        """Add a body and the joint that connects it to its parent.

        Parameters
        ----------
        name : str
            Name of the body, and of its coordinates.
        parent : str, optional
            Name of a body, or ``"ground"``.
        joint : str or mapping, optional
            Type of the joint, with the following arguments as its keys; or a mapping with all keys.
        axis : str or sequence of three, optional
            Axis of a joint with one axis: ``"x"``, ``"-y"``, or components in the parent.
        axes : sequence of two axes, optional
            Axes of a universal joint.
        normal : str or sequence of three, optional
            Normal of a planar joint.
        pitch : number or expression, optional
            Advance of a screw joint, m/rad.
        armature : number, expression, or sequence of these, optional
            Reflected inertia of the rotor of each degree of freedom, kg m^2 or kg.
        at : sequence of three, optional
            Position of the joint in the parent, m.
        rotate : sequence of mappings, optional
            Rotations of the joint frame in the parent, one after the other.
        rpy : sequence of three, optional
            Roll, pitch and yaw of the joint frame, rad.
        mass : number or expression, optional
            Mass, kg. Default: 0, or from `shape`.
        com : sequence of three, optional
            Centre of mass in the body, m.
        inertia : mapping of str to number or expression, optional
            Moments ``xx``, ``yy``, ``zz`` and products ``xy``, ``xz``, ``yz`` about the centre of mass, kg m^2.
        shape : mapping, optional
            Shape with density or mass, instead of the three above.
        visuals : sequence of mappings, optional
            Solids and meshes that views show. Default: the shape.

        Returns
        -------
        str
            The name, for use as a parent.

        Examples
        --------
        >>> b = ModelBuilder("double_arm")
        >>> upper = b.body("upper", axis="y", shape={"type": "rod", "axis": "x", "length": 1, "mass": 2})
        >>> lower = b.body("lower", upper, axis="y", at=[1, 0, 0], mass=1, com=[0.5, 0, 0])
        >>> b.build().coordinate_names
        ('upper', 'lower')
        """
        # long: the docstring describes every argument
        placed = _given(
            axis=axis, axes=axes, normal=normal, pitch=pitch, armature=armature, at=at, rotate=rotate, rpy=rpy
        )
        whole = {**_plain(joint), **placed} if isinstance(joint, Mapping) else {"type": joint, **placed}
        entry = _given(parent=parent, joint=whole, mass=mass, com=com, inertia=inertia, shape=shape, visuals=visuals)
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
        """Add a model file as a part, with its names prefixed by ``NAME_``.

        Parameters
        ----------
        name : str
            Prefix of the names.
        use : str
            The file, relative to the folder of the builder.
        on : str, optional
            Body to which the ground of the file is fixed.
        at : sequence of three, optional
            Position of that ground in the body, m.
        rotate : sequence of mappings, optional
            Rotations of that ground in the body, one after the other.
        rpy : sequence of three, optional
            Roll, pitch and yaw of that ground in the body, rad.
        given : mapping of str to number or expression, optional
            Values for constants, parameters and inputs of the file; the key ``with`` in a model file.

        Returns
        -------
        str
            The body that the ground of the file becomes.

        Examples
        --------
        >>> b = ModelBuilder("two", folder="examples")
        >>> left = b.submodel("left", "pendulum.yaml", at=[0, 1, 0])
        >>> right = b.submodel("right", "pendulum.yaml", at=[0, -1, 0])
        >>> b.build().nq
        2
        """
        entry = _given(use=use, on=on, at=at, rotate=rotate, rpy=rpy)
        if given:
            entry["with"] = _plain(given)
        self._put("submodels", name, entry)
        return name

    def include(self, file: str) -> None:
        """Read the sections of another model file as if they were written here.

        Parameters
        ----------
        file : str
            The file, relative to the folder of the builder.

        Examples
        --------
        >>> b = ModelBuilder("copied", folder="examples")
        >>> b.include("pendulum.yaml")
        >>> b.build().nq
        1
        """
        self._root.setdefault("include", []).append(_plain(file))

    def point(self, name: str, body: str, at: Vector3 = (0, 0, 0)) -> str:
        """Add a named point that is fixed in a body.

        Parameters
        ----------
        name : str
            Name of the point.
        body : str
            Name of a body, or ``"ground"``.
        at : sequence of three, optional
            Position in the body, m.

        Returns
        -------
        str
            The name of the point.

        Examples
        --------
        >>> b = ModelBuilder("pendulum")
        >>> arm = b.body("arm", axis="y", mass=1, com=[0, 0, -1])
        >>> tip = b.point("tip", arm, [0, 0, -1])
        >>> b.output("height", position=tip, axis="z")
        """
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
        """Add a joint, or a condition on a point, that closes a loop.

        Parameters
        ----------
        name : str
            Name of the loop.
        joint : str or mapping
            Type of the joint or condition, with the following arguments as its keys; or a mapping with all keys.
        start, end : str or mapping
            ``from`` and ``to`` of a model file: a mapping with ``body``, ``at``, and ``rotate`` or ``rpy``; or the name
            of a point.
        axis : str or sequence of three, optional
            Axis of the joint.
        axes : sequence of two axes, optional
            Axes of a universal joint.
        normal : str or sequence of three, optional
            Normal of a planar joint.
        length : number or expression, optional
            Length of a distance, m.
        equation : expression, optional
            Surface on which the point stays: an expression of x, y and z that is zero there.
        equations : sequence of two expressions, optional
            Curve on which the point stays.

        Examples
        --------
        >>> b = ModelBuilder("two_rods")
        >>> a = b.body("a", axis="y", mass=1, com=[0, 0, -1])
        >>> c = b.body("c", axis="y", at=[1, 0, 0], mass=1, com=[0, 0, -1])
        >>> b.loop("rod", "distance", {"body": a, "at": [0, 0, -1]}, {"body": c, "at": [0, 0, -1]}, length=1)
        >>> len(b.build().loops)
        1
        """
        placed = _given(axis=axis, axes=axes, normal=normal, length=length, equation=equation, equations=equations)
        whole = {**_plain(joint), **placed} if isinstance(joint, Mapping) else {"type": joint, **placed}
        self._put("loops", name, {"joint": whole, "from": _plain(start), "to": _plain(end)})

    def coupling(
        self, name: str, joint: str, follows: str | Mapping[str, Scalar], *, offset: Scalar | None = None
    ) -> None:
        """Add a coordinate that follows others: ``joint = sum of ratio * other + offset``.

        Parameters
        ----------
        name : str
            Name of the coupling.
        joint : str
            The coordinate that follows, or a joint with one coordinate.
        follows : str or mapping of str to number or expression
            The other coordinates and their ratios, which may depend on parameters. A name alone has the ratio 1.
        offset : number or expression, optional
            Offset, rad or m.

        Examples
        --------
        >>> b = ModelBuilder("gears")
        >>> pinion = b.body("pinion", axis="z", inertia={"zz": 0.1})
        >>> wheel = b.body("wheel", axis="z", at=[1, 0, 0], inertia={"zz": 0.5})
        >>> b.coupling("gear", wheel, {pinion: -0.25})
        >>> b.build().nu
        2
        """
        whole = {"joint": joint, "follows": _plain(follows), **_given(offset=offset)}
        self._put("couplings", name, whole)

    def independent(self, *names: str) -> None:
        """Request coordinates as independent in models with loops.

        May be called several times.

        Parameters
        ----------
        *names : str
            Coordinates, or joints for all of their coordinates.

        Examples
        --------
        >>> b = ModelBuilder("arms")
        >>> left = b.body("left", axis="y", mass=1, com=[0, 0, -1])
        >>> right = b.body("right", axis="y", at=[1, 0, 0], mass=1, com=[0, 0, -1])
        >>> b.loop("rod", "distance", {"body": left, "at": [0, 0, -1]}, {"body": right, "at": [0, 0, -1]}, length=1)
        >>> b.independent(right)
        >>> b.build().independent
        ('right',)
        """
        self._root.setdefault("independent", []).extend(_plain(names))

    def motion(self, name: str, value: Scalar | Sequence[Scalar]) -> None:
        """Prescribe the motion of a coordinate, or of all coordinates of a joint.

        Parameters
        ----------
        name : str
            The coordinate, or the joint.
        value : expression, or sequence of these
            Function of ``t``, parameters and inputs, rad or m.

        Examples
        --------
        >>> b = ModelBuilder("shaker")
        >>> table = b.body("table", joint="prismatic", axis="z", mass=2)
        >>> b.motion(table, "0.01*sin(20*t)")
        >>> b.build().prescribed_names
        ('table',)
        """
        self._put("motion", name, value)

    def joint_force(self, name: str, joint: str, value: Scalar | Sequence[Scalar]) -> None:
        """Add a generalised force along the degrees of freedom of a joint.

        Parameters
        ----------
        name : str
            Name of the force.
        joint : str
            The joint, by the name of its body.
        value : number or expression, or sequence of these
            Force, N m or N, positive where it increases u. An expression of coordinates, speeds, parameters, inputs and
            time.

        Examples
        --------
        >>> b = ModelBuilder("pendulum")
        >>> arm = b.body("arm", axis="y", mass=1, com=[0, 0, -1])
        >>> b.joint_force("spring", arm, "-3*q.arm - 0.1*u.arm")
        """
        self._put("forces", name, {"type": "joint", "joint": joint, "value": _plain(value)})

    def force(self, name: str, type: str, **keys: Any) -> None:
        """Add a force element of any type.

        Parameters
        ----------
        name : str
            Name of the element.
        type : str
            Type, such as ``"actuator"``, ``"bushing"`` or ``"friction"``.
        **keys
            Keys of the type in a model file; ``start`` and ``end`` replace ``from`` and ``to``.

        Examples
        --------
        >>> b = ModelBuilder("pendulum")
        >>> arm = b.body("arm", axis="y", mass=1, com=[0, 0, -1])
        >>> b.force("push", "force", on={"body": arm, "at": [0, 0, -1]}, value=[1, 0, 0])
        >>> b.build().loads[0].name
        'push'
        """
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
        """Add a spring and damper between two points.

        Parameters
        ----------
        name : str
            Name of the element.
        start, end : str or mapping
            ``from`` and ``to`` of a model file: a mapping with ``body`` and ``at``, or the name of a point.
        stiffness : number or expression
            Stiffness, N/m.
        damping : number or expression, optional
            Damping, N s/m. Default: 0.
        free_length : number or expression, optional
            Length without force, m. Default: 0.

        Examples
        --------
        >>> b = ModelBuilder("pendulum")
        >>> arm = b.body("arm", axis="y", mass=1, com=[0, 0, -1])
        >>> b.spring("cord", {"body": "ground", "at": [2, 0, 0]}, {"body": arm, "at": [0, 0, -1]}, 100, free_length=1)
        >>> b.build().loads[0].name
        'cord'
        """
        given = _given(stiffness=stiffness, damping=damping, free_length=free_length)
        self._put("forces", name, {"type": "spring", "from": _plain(start), "to": _plain(end), **given})

    def output(
        self,
        name: str,
        measure: str | None = None,
        **keys: Any,
    ) -> None:
        """Add a named scalar output.

        Parameters
        ----------
        name : str
            Name of the output.
        measure : str, optional
            ``"kinetic_energy"`` or ``"potential_energy"``.
        **keys
            Otherwise the keys of the output in a model file: ``position=tip, axis="z"``.

        Examples
        --------
        >>> b = ModelBuilder("pendulum")
        >>> arm = b.body("arm", axis="y", mass=1, com=[0, 0, -1])
        >>> b.output("kinetic", "kinetic_energy")
        >>> b.output("height", position={"body": arm, "at": [0, 0, -1]}, axis="z")
        >>> [output.name for output in b.build().outputs]
        ['kinetic', 'height']
        """
        given = _given(**keys)
        self._put("outputs", name, {**given, **_given(measure=measure)} if given else measure)

    def initial(
        self,
        q: Mapping[str, Scalar | Sequence[Scalar]] | None = None,
        u: Mapping[str, Scalar | Sequence[Scalar]] | None = None,
        equilibrium: bool | None = None,
    ) -> None:
        """Set initial coordinates and speeds.

        May be called several times. Values of dependent coordinates are guesses.

        Parameters
        ----------
        q, u : mapping of str to number or expression, optional
            Values by the names of coordinates, speeds or joints, SI units and radians.
        equilibrium : bool, optional
            Begin at rest in the equilibrium that the coordinates lead to.

        Examples
        --------
        >>> b = ModelBuilder("pendulum")
        >>> arm = b.body("arm", axis="y", mass=1, com=[0, 0, -1])
        >>> b.initial(q={arm: 0.5})
        >>> b.build().initial_q
        {'arm': Expression('0.5')}
        """
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
        """Return the checked model.

        Returns
        -------
        Model
            The model. `Model.warnings` lists doubtful entries.

        Raises
        ------
        ModelError
            If the model has errors. The exception lists all of them; their place is ``builder`` and the path of the key.

        Examples
        --------
        >>> b = ModelBuilder("pendulum")
        >>> arm = b.body("arm", axis="y", mass=1, com=[0, 0, -1])
        >>> model = b.build()
        >>> model.name, model.nu
        ('pendulum', 1)
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
            problem = f"{name!r} is not a valid name; a name in Python has no repeat index, so use a for loop that adds each item"
        elif name in mapping:
            problem = f"name {name!r} is given twice; each name may be given once"
        if problem is None:
            mapping[name] = _plain(value)
        else:
            self._problems.append(Problem("builder", None, None, f"{section}.{name}", problem))


def _operation(operator: str, swapped: bool = False) -> Callable[[object, object], Name]:
    """A method of `Name` that returns the text of an operation."""

    def of(one: object, other: object) -> Name:
        if is_sympy(other):
            return NotImplemented  # sympy then converts the name by `_sympy_`
        left, right = (other, one) if swapped else (one, other)
        return Name(f"({_operand(left)} {operator} {_operand(right)})")

    return of


class Name(str):
    """Name of a parameter, constant or input that can be used in arithmetic: ``L / 2`` is an expression text."""

    __slots__ = ()

    __add__, __radd__ = _operation("+"), _operation("+", swapped=True)
    __sub__, __rsub__ = _operation("-"), _operation("-", swapped=True)
    __mul__, __rmul__ = _operation("*"), _operation("*", swapped=True)
    __truediv__, __rtruediv__ = _operation("/"), _operation("/", swapped=True)
    __pow__ = _operation("**")

    def __neg__(self) -> Name:
        return Name(f"(-{_operand(self)})")

    def _sympy_(self) -> Any:
        """The object that sympy computes with."""
        from .parsing import parse
        from .sympy_output import to_sympy

        return to_sympy(parse(self))


def _operand(value: object) -> str:
    return str(value) if isinstance(value, Name) else f"({value})"


def _plain(value: Any) -> Any:
    """Mappings, lists and scalars of any type, as plain Python data."""
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
