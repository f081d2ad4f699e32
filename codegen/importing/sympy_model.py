"""Conversion of a `System` of `sympy.physics.mechanics` into a model."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any, Final

from ..model import ModelError, parse_model
from ..model.errors import Problem, nearest
from .importer import Imported
from .naming import model_name, names_a_model
from .robot import Effect
from .sympy_conditions import read_conditions
from .sympy_loads import read_loads
from .sympy_system import FILE, JOINTS, SympySystem, read_bodies
from .sympy_text import model_text
from .words import number, one_line, wrapped

_SECTIONS: Final = (
    "gravity",
    "parameters",
    "inputs",
    "bodies",
    "loops",
    "couplings",
    "motion",
    "forces",
    "initial",
    "independent",
)
_LONGEST_LIST: Final = 12


def from_sympy(system: Any, values: Mapping[Any, float] | None = None, name: str | None = None) -> Imported:
    """Make a model of a `System` of `sympy.physics.mechanics`.

    Bodies on pin, prismatic, cylindrical, planar, spherical and weld joints are read with their loads and actuators.
    Gravity that acts on all bodies becomes that of the model. Holonomic constraints become couplings and loops. Symbols
    become parameters, and functions of time that are neither coordinate nor speed become inputs. The coordinates of the
    model are those of the joints; `Imported.symbols` has the name of each.

    Parameters
    ----------
    system : sympy.physics.mechanics.System or JointsMethod
        The system.
    values : mapping of sympy.Basic or str to float, optional
        Values of parameters, SI units, and initial values of coordinates and speeds. A parameter without a value is 1,
        a product of inertia 0, with a warning.
    name : str, optional
        Name of the model. Default: ``system``.

    Returns
    -------
    Imported
        The model, its text, and the names of the symbols.

    Raises
    ------
    TypeError
        If the object has no joints, such as a `KanesMethod`.
    ModelError
        If the system has parts that a model cannot express. The exception lists all of them.

    Examples
    --------
    >>> import sympy
    >>> from sympy.physics.mechanics import PinJoint, RigidBody, System
    >>> m, l, g = sympy.symbols("m l g")
    >>> ceiling, rod = RigidBody("ceiling"), RigidBody("rod", mass=m)
    >>> system = System.from_newtonian(ceiling)
    >>> system.add_joints(PinJoint("pin", ceiling, rod, joint_axis=ceiling.z, child_point=l * rod.y))
    >>> system.apply_uniform_gravity(-g * ceiling.y)
    >>> found = ordernm.from_sympy(system, values={m: 2, l: 0.5, g: 9.81})
    >>> found.model.coordinate_names
    ('rod',)
    >>> found.symbols[system.q[0]]
    'q.rod'
    """
    # long: the example in the docstring builds a system
    joints, frame, origin = _parts(system)
    found = SympySystem(system)
    with_conditions = list(getattr(system, "holonomic_constraints", ()))
    found.reserved = ("x", "y", "z") if with_conditions else ()
    read_bodies(found, joints, list(system.bodies), frame, origin)
    _check_speeds(found, system)
    if not found.problems:
        read_loads(found, system.loads, getattr(system, "actuators", ()))
        read_conditions(found, with_conditions, getattr(system, "q_dep", ()))
    _check_rest(found, system)
    if found.problems:
        raise ModelError(found.problems)
    if name is not None and not names_a_model(name):
        message = f"{name!r} cannot name a model; use a lower-case identifier such as four_bar"
        raise ModelError([Problem(FILE, None, None, "name", message)])
    if with_conditions and list(getattr(system, "q_dep", ())):
        found.sections["independent"] = [found.scalars[q][0] for q in system.q_ind if q in found.scalars]
    _give_values(found, dict(values or {}))
    return _imported(found, model_name(name or "system") if name is None else name, joints)


def _parts(system: Any) -> tuple[list[Any], Any, Any]:
    """Joints, inertial frame and fixed point of a system."""
    try:
        from sympy.physics.mechanics import JointsMethod, System
    except ImportError as error:
        raise ImportError(
            f"a sympy with sympy.physics.mechanics.System is needed ({error}); pip install 'sympy>=1.13'"
        ) from None
    if isinstance(system, System):
        return list(system.joints), system.frame, system.fixed_point
    if isinstance(system, JointsMethod):
        return list(system._joints), system.frame, None
    kind = type(system).__name__
    kept = f"; {kind} keeps no joints; pass the System that it was made from" if kind.endswith("Method") else ""
    raise TypeError(f"from_sympy takes a sympy.physics.mechanics.System, not {kind}{kept}")


def _check_speeds(found: SympySystem, system: Any) -> None:
    """Check that all speeds are rates of coordinates and belong to joints."""
    from sympy.physics.mechanics import dynamicsymbols

    rates = [e.expand() for e in system.kdes]
    for q, (_, u) in found.scalars.items():
        expected = u - q.diff(dynamicsymbols._t)
        if expected not in rates and -expected not in rates:
            message = (
                f"kdes lacks the kinematical equation {u} = {q.diff(dynamicsymbols._t)}; speeds of a model are rates"
            )
            found.report(f"kdes of {q}", message)
    speeds = {u for _, u in found.scalars.values()}
    for what, listed, known in (("q", system.q, set(found.scalars)), ("u", system.u, speeds)):
        for e in listed:
            if e not in known:
                found.report(f"{what} {e}", f"belongs to no joint; coordinates and speeds are those of {JOINTS}")


def _check_rest(found: SympySystem, system: Any) -> None:
    """Report the parts of a system that the model format lacks."""
    refused = {
        "nonholonomic_constraints": "velocity constraints are not read; holonomic constraints are",
        "u_aux": "auxiliary speeds are not read; forces in joints are reactions of the solver",
    }
    for key, message in refused.items():
        if len(getattr(system, key, ())):
            found.report(key, message)
    own = list(getattr(system, "velocity_constraints", ()))
    derived = [c.diff(_time()) for c in getattr(system, "holonomic_constraints", ())]
    derived += list(getattr(system, "nonholonomic_constraints", ()))
    if len(own) != len(derived):
        found.report("velocity_constraints", refused["nonholonomic_constraints"])


def _time() -> Any:
    from ..model.sympy_names import time

    return time()


def _give_values(found: SympySystem, values: dict[Any, float]) -> None:
    """Fill the sections ``parameters`` and ``initial`` of the model."""
    given: dict[str, float] = {}
    known = {**{str(s): n for s, n in found.symbols.items()}, **{n: n for n in found.symbols.values()}}
    for key, value in values.items():
        which = found.symbols.get(key, known.get(str(key)))
        if which is None:
            message = f"is not a symbol of this system; symbols are {_listed(map(str, found.symbols))}{nearest(str(key), known)}"
            found.report(f"values[{key}]", message)
        else:
            given[which] = float(value)
    if found.problems:
        raise ModelError(found.problems)
    unknown = [n for n, s in found.parameters.items() if n not in given and s not in found.products]
    none = [n for n, s in found.parameters.items() if n not in given and s in found.products]
    for names, default in ((unknown, "1"), (none, "0")):
        if names:
            message = f"no value is given for {_listed(names)}; {default} is used; values={{...}} sets others"
            found.robot.warnings.append(Problem(FILE, None, None, "values", message, "warning"))
    defaults = {**dict.fromkeys(unknown, 1.0), **dict.fromkeys(none, 0.0)}
    found.sections["parameters"] = {n: number(given.get(n, defaults.get(n, 1.0))) for n in sorted(found.parameters)}
    initial = {w: {n[2:]: number(v) for n, v in given.items() if n.startswith(f"{w}.")} for w in "qu"}
    found.sections["initial"] = {w: entries for w, entries in initial.items() if entries}
    found.sections["inputs"] = found.inputs


def _imported(found: SympySystem, name: str, joints: Iterable[Any]) -> Imported:
    """The model that the sections describe."""
    robot = found.robot
    lines = ["A System of sympy.physics.mechanics, imported by ordernm.", *map(one_line, robot.notes)]
    if robot.left_out:
        lines += ["Left out:", *(f"  {entry}" for entry in robot.listed())]
    head = [part for line in lines for part in (wrapped(line) if not line.startswith(" ") else [line])]
    sections = {key: found.sections[key] for key in _SECTIONS if found.sections.get(key)}
    text = model_text([*head], {"model": name, **sections})
    model = parse_model(text, FILE)
    frames = {str(b.name): f for b, f in found.frames.items()}
    return Imported(
        text=text,
        model=model,
        left_out=tuple(map(str, robot.listed())),
        differences=tuple(str(entry) for entry in robot.listed() if entry.effect is Effect.DIFFERS),
        warnings=tuple(str(p) for p in robot.warnings),
        bodies={body: frame.name for body, frame in frames.items()},
        joints={str(f.joint.name): f.name for f in frames.values() if f.joint is not None},
        renamed={body: f.name for body, f in frames.items() if f.joint is not None and body != f.name},
        symbols=dict(found.symbols),
    )


def _listed(names: Iterable[str]) -> str:
    every = list(names)
    return ", ".join(every[:_LONGEST_LIST]) + (", ..." if len(every) > _LONGEST_LIST else "")
