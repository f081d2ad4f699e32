"""A `System` of `sympy.physics.mechanics`: bodies and joints as sections of a model."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, Final

from ..model import ModelError
from ..model.errors import Problem
from ..model.expressions import Expression
from ..model.grammar import ExpressionError, Tree
from ..model.sympy_names import time
from ..model.sympy_trees import from_sympy_expression
from .naming import free_name, made_name, names_for
from .robot import Effect, Robot
from .sympy_rotations import rotation_keys

FILE: Final = "System"
"""Name of the system in messages."""
GROUND: Final = "ground"
JOINTS: Final = "PinJoint, PrismaticJoint, CylindricalJoint, PlanarJoint, SphericalJoint and WeldJoint"


class Trouble(Exception):
    """Raised if a model cannot express a part of the system; the reader adds the place."""


@dataclass(slots=True)
class Frame:
    """A body of the model in terms of sympy.

    Attributes
    ----------
    name : str
        The body's name in the model, or ``ground``.
    axes : ReferenceFrame
        The axes of the model's body.
    origin : Point
        The body's origin.
    joint : Joint or None
        The joint that carries it.
    sign : int
        -1 if that joint's child carries its parent, otherwise 1.
    """

    name: str
    axes: Any
    origin: Any
    joint: Any = None
    sign: int = 1


@dataclass(slots=True)
class Step:
    """A joint of the model: its type and keys, and sympy's coordinates and speeds in the model's order."""

    keys: dict[str, Any]
    q: tuple[Any, ...] = ()
    u: tuple[Any, ...] = ()


@dataclass(slots=True)
class SympySystem:
    """A system that is being read, and the sections of the model so far.

    Attributes
    ----------
    system : System
    frames : dict of body to Frame
        Every sympy body; those of the ground share one frame.
    sections : dict of str to dict
        Sections of the model file, as plain data.
    symbols : dict of sympy.Basic to str
        Names in the model of coordinates, speeds, parameters and inputs.
    robot : Robot
        Collects warnings and what is left out.
    problems : list of Problem
    inputs : list of str
    parameters : dict of str to sympy.Symbol
    scalars : dict of sympy.Function to (str, sympy.Function)
        For every sympy coordinate its name after ``q.``, and its speed.
    products : set of sympy.Symbol
        Parameters that are products of inertia.
    reserved : tuple of str
        Names that parameters must not have.
    """

    system: Any
    frames: dict[Any, Frame] = field(default_factory=dict)
    sections: dict[str, Any] = field(default_factory=dict)
    symbols: dict[Any, str] = field(default_factory=dict)
    robot: Robot = field(default_factory=lambda: Robot("system", FILE))
    problems: list[Problem] = field(default_factory=list)
    inputs: list[str] = field(default_factory=list)
    parameters: dict[str, Any] = field(default_factory=dict)
    scalars: dict[Any, tuple[str, Any]] = field(default_factory=dict)
    products: set[Any] = field(default_factory=set)
    reserved: tuple[str, ...] = ()

    def report(self, where: str, message: str) -> None:
        """Report an error in a part of the system."""
        self.problems.append(Problem(FILE, None, None, where, message))

    def expression(self, value: Any) -> Expression:
        """An expression of the model; new symbols become parameters, new functions of time become inputs."""
        import sympy

        try:
            return from_sympy_expression(sympy.sympify(value), self.named)
        except ExpressionError as error:
            raise Trouble(error.message) from None

    def text(self, value: Any) -> str:
        """The text of an expression for the model file."""
        return str(self.expression(value))

    def named(self, e: Any) -> Tree:
        """The name of a symbol, of a function of time, or of a coordinate's rate."""
        import sympy

        if e in self.symbols:
            return ("name", self.symbols[e])
        if isinstance(e, sympy.Derivative):
            rate = self.symbols.get(e.expr, "")
            if len(e.variables) == 1 and rate.startswith("q."):
                return ("name", f"u.{rate[2:]}")
            allowed = "time derivatives of the joints' coordinates are allowed"
            raise ExpressionError(f"{e}: {allowed}, but not accelerations or rates of inputs")
        if e == time():
            return ("name", "t")
        if e.is_Symbol:
            name = self._new_name(e.name)
            self.parameters[name] = e
        elif e.args == (time(),):
            name = self._new_name(str(e.func))
            self.inputs.append(name)
        else:
            raise ExpressionError(
                f"{e} is an unknown function; coordinates, speeds and functions of time alone are allowed"
            )
        self.symbols[e] = name
        return ("name", name)

    def _new_name(self, text: str) -> str:
        name = free_name(made_name(text), {*self.parameters, *self.inputs, *self.reserved})
        if name != text:
            self.robot.notes.append(f"{text} of the system is {name} here.")
        return name

    def vector(self, vector: Any, axes: Any) -> list[str]:
        """Components of a vector, as texts."""
        return [self.text(c) for c in components(vector, axes)]

    def fixed(self, vector: Any, axes: Any, what: str) -> list[str]:
        """Components, as texts, of a vector that must be constant in these axes."""
        found = components(vector, axes)
        if any(moves(c) for c in found):
            raise Trouble(f"{what} is not constant in its body: {vector}")
        return [self.text(c) for c in found]

    def body_of_point(self, point: Any) -> tuple[Frame, list[str]]:
        """The body in which a point is fixed, and the point's components."""
        places = [(frame, _place(point, frame)) for frame in self.all_frames()]
        for simplified in (False, True):
            for frame, place in places:
                if place is not None:
                    found = [c.simplify() for c in place] if simplified else place
                    if not any(map(moves, found)):
                        return frame, [self.text(c) for c in found]
        raise Trouble(f"point {point} is not fixed in a body; forces need points that are fixed in bodies")

    def body_of_frame(self, axes: Any) -> Frame:
        """The body in which a reference frame is fixed."""
        for frame in self.all_frames():
            try:
                turned = frame.axes.dcm(axes)
            except ValueError:
                continue
            if not any(map(moves, turned)):
                return frame
        raise Trouble(f"frame {axes} is not fixed in a body; torques need frames of bodies")

    def all_frames(self) -> list[Frame]:
        """The frames of the bodies, each once, moving bodies first."""
        every = {id(f): f for f in self.frames.values()}.values()
        return sorted(every, key=lambda f: f.name == GROUND)


def components(vector: Any, axes: Any) -> list[Any]:
    """The three components of a sympy vector in some axes."""
    if vector == 0:
        import sympy

        return [sympy.Integer(0)] * 3
    return list(vector.to_matrix(axes))


def moves(e: Any) -> bool:
    """Whether an expression depends on time, directly or through functions of time."""
    from sympy.core.function import AppliedUndef

    return bool(e.atoms(AppliedUndef)) or time() in e.free_symbols


def _place(point: Any, frame: Frame) -> list[Any] | None:
    """Position of a point from the origin of a body, in its axes; None if sympy does not know it."""
    try:
        return components(point.pos_from(frame.origin), frame.axes)
    except ValueError:
        return None


def read_bodies(found: SympySystem, joints: Iterable[Any], bodies: Iterable[Any], inertial: Any, origin: Any) -> None:
    """Read the tree of bodies and joints of a system.

    Parameters
    ----------
    found : SympySystem
        Receives frames, symbols and the section ``bodies``.
    joints, bodies : iterable of Joint and of body
    inertial : ReferenceFrame
        The inertial axes.
    origin : Point or None
        A point at rest; by default the mass centre of the first body on the ground.
    """
    waiting = list(joints)
    known, carried = _in_order(list(bodies), waiting), {id(j.child) for j in waiting}
    roots = [b for b in known if b.masscenter is origin or getattr(b, "frame", None) is inertial]
    at_rest = [b for b in known if b not in roots and id(b) not in carried and _is_at_rest(b, inertial)]
    if not roots and not at_rest:
        message = (
            "no body is at rest in the inertial frame; a joint must carry the first body, see System.from_newtonian"
        )
        raise ModelError([Problem(FILE, None, None, "bodies", message)])
    ground = Frame(GROUND, inertial, (roots or at_rest)[0].masscenter if origin is None else origin)
    names = names_for(dict.fromkeys(str(b.name) for b in known if b not in roots))
    for on_ground in (roots, at_rest):  # bodies that joints carry may also be at rest
        found.frames |= {body: ground for body in on_ground if body not in found.frames}
        waiting = _follow(found, waiting, names)
    for body in known:
        if body not in found.frames:
            message = f"no joint carries this body; every body needs one of these joints: {JOINTS}"
            found.report(f"bodies.{body.name}", message)


def _follow(found: SympySystem, joints: list[Any], names: Mapping[str, str]) -> list[Any]:
    """Read the joints on known bodies, outward from the ground; returns the joints that remain."""
    waiting, count = joints, -1
    while len(waiting) != count:
        count, joints, waiting = len(waiting), waiting, []
        for joint in joints:
            ends = [b in found.frames for b in (joint.parent, joint.child)]
            if all(ends):
                found.report(f"joints.{joint.name}", "closes a loop; write the loop as holonomic constraints")
            elif any(ends):
                try:
                    _read_joint(found, joint, names, 1 if ends[0] else -1)
                except Trouble as error:
                    found.report(f"joints.{joint.name}", str(error))
            else:
                waiting.append(joint)
    return waiting


def _in_order(bodies: list[Any], joints: list[Any]) -> list[Any]:
    """All bodies once each, including those that only joints name."""
    every = [*bodies, *(b for j in joints for b in (j.parent, j.child))]
    return list({id(b): b for b in every}.values())


def _is_at_rest(body: Any, inertial: Any) -> bool:
    """Whether the axes of a body are fixed to the ground."""
    axes = getattr(body, "frame", None)
    if axes is None:
        return False
    try:
        return not any(map(moves, axes.dcm(inertial)))
    except ValueError:
        return False


def _read_joint(found: SympySystem, joint: Any, names: Mapping[str, str], sign: int) -> None:
    """Add a joint, and the body that it carries.

    The body in the model has the axes of sympy's interframe, and its origin is the joint's point.
    """
    parent, child = (joint.parent, joint.child)[::sign]
    inner, outer = (joint.parent_interframe, joint.child_interframe)[::sign]
    at, origin = (joint.parent_point, joint.child_point)[::sign]
    base = found.frames[parent]
    steps = joint_steps(joint, sign)
    for step in steps:
        if isinstance(step.keys.get("axis"), list):
            step.keys["axis"] = _axis([found.text(c) for c in step.keys["axis"]])
    name = names[str(child.name)]
    frame = found.frames[child] = Frame(name, outer, origin, joint, sign)
    bodies = found.sections.setdefault("bodies", {})
    place = found.fixed(at.pos_from(base.origin), base.axes, "the point of the joint")
    turned = base.axes.dcm(inner)
    keys = {**({"at": place} if place != ["0"] * 3 else {}), **rotation_keys(turned, found.text)}
    above = base.name
    for k, step in enumerate(steps):
        own = name if k == len(steps) - 1 else free_name(f"{name}_{k + 1}", {*bodies, *names.values()})
        bodies[own] = {"parent": above, "joint": {**step.keys, **keys}}
        several = len(step.q) > 1
        for i, (q, u) in enumerate(zip(step.q, step.u, strict=True)):
            coordinate = f"{own}.{i + 1}" if several else own
            found.symbols |= {q: f"q.{coordinate}", u: f"u.{coordinate}"}
            found.scalars[q] = coordinate, u
        above, keys = own, {}
    bodies[name] |= _mass(found, child, frame)


def _axis(texts: list[str]) -> Any:
    """Text of an axis: ``x``, ``-z``, or three components."""
    along = [i for i in range(3) if texts[i] != "0"]
    if len(along) == 1 and texts[along[0]] in ("1", "-1"):
        return texts[along[0]].rstrip("1") + "xyz"[along[0]]
    return texts


def _mass(found: SympySystem, body: Any, frame: Frame) -> dict[str, Any]:
    """Mass, centre of mass and inertia of a body."""
    entry: dict[str, Any] = {}
    if body.mass != 0:
        entry["mass"] = found.text(body.mass)
    com = found.fixed(body.masscenter.pos_from(frame.origin), frame.axes, "the mass centre")
    if com != ["0"] * 3:
        entry["com"] = com
    if hasattr(body, "central_inertia") and body.central_inertia != 0:
        matrix = body.central_inertia.to_matrix(frame.axes)
        if any(map(moves, matrix)):
            raise Trouble("the inertia is not constant in the body; it must be")
        six = {"xyz"[i] + "xyz"[j]: matrix[i, j] for i in range(3) for j in range(i, 3)}
        found.products |= {value for key, value in six.items() if key[0] != key[1] and value.is_Symbol}
        if inertia := {key: found.text(value) for key, value in six.items() if value != 0}:
            entry["inertia"] = inertia
    if body.potential_energy != 0:
        remark = "sympy uses it in Lagrange's method but not in Kane's; forces are read from loads only"
        found.robot.leave_out("potential_energy of bodies", None, Effect.UNKNOWN, remark)
    return entry


def joint_steps(joint: Any, sign: int) -> list[Step]:
    """The joints of the model that are equivalent to a sympy joint, outward."""
    kind = type(joint).__name__
    q, u = tuple(joint.coordinates), tuple(joint.speeds)
    if kind == "WeldJoint":
        return [Step({"type": "fixed"})]
    if kind in ("PinJoint", "PrismaticJoint", "CylindricalJoint"):
        axis = [sign * c for c in components(joint.joint_axis, joint.parent_interframe)]
        keys = {"type": {"PinJoint": "revolute", "PrismaticJoint": "prismatic"}.get(kind, "cylindrical"), "axis": axis}
        order = slice(None, None, -1 if kind == "CylindricalJoint" else 1)  # the model's joint slides, then rotates
        return [Step(keys, q[order], u[order])]
    if kind not in ("PlanarJoint", "SphericalJoint"):
        raise Trouble(f"a {kind} is not supported; joints of a model are {JOINTS}")
    if sign < 0:
        raise Trouble(f"the child of this {kind} carries its parent; exchange the two bodies")
    if kind == "PlanarJoint":
        return [Step({"type": "planar", "normal": "x"}, (*q[1:], q[0]), (*u[1:], u[0]))]
    return _spherical(joint, q, u)


def _spherical(joint: Any, q: tuple[Any, ...], u: tuple[Any, ...]) -> list[Step]:
    """Three revolute joints that replace a spherical joint, since sympy's coordinates are angles."""
    letters = str(joint._rot_order).upper().translate(str.maketrans("123", "XYZ"))
    amounts = list(q if joint._amounts is None else joint._amounts)
    if sorted(map(str, amounts)) != sorted(map(str, q)):
        raise Trouble(f"amounts {amounts} are not supported; use the three coordinates, each once")
    turns = list(zip(letters, amounts, strict=True))
    if joint._rot_type.upper() == "SPACE":
        turns.reverse()
    return [
        Step({"type": "revolute", "axis": letter.lower()}, (angle,), (u[q.index(angle)],)) for letter, angle in turns
    ]
