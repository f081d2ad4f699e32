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
"""How messages name the system."""
GROUND: Final = "ground"
JOINTS: Final = "PinJoint, PrismaticJoint, CylindricalJoint, PlanarJoint, SphericalJoint and WeldJoint"


class Trouble(Exception):
    """Something of the system that a model cannot say; the reader adds where."""


@dataclass(slots=True)
class Frame:
    """A body of the model in terms of sympy.

    Attributes
    ----------
    name : str
        Of the body in the model, or ``ground``.
    axes : ReferenceFrame
        The axes of the model's body.
    origin : Point
        Its origin.
    joint : Joint or None
        The joint that carries it.
    sign : int
        -1 where that joint's child carries its parent.
    """

    name: str
    axes: Any
    origin: Any
    joint: Any = None
    sign: int = 1


@dataclass(slots=True)
class Step:
    """A joint of the model: type, keys, and the coordinates and speeds of sympy in its order."""

    keys: dict[str, Any]
    q: tuple[Any, ...] = ()
    u: tuple[Any, ...] = ()


@dataclass(slots=True)
class SympySystem:
    """What is read of a system so far.

    Attributes
    ----------
    system : System
    frames : dict of body to Frame
        Every body of sympy's; those of the ground share one.
    sections : dict of str to dict
        Sections of the model, as plain data.
    symbols : dict of sympy.Basic to str
        Names of the model: of coordinates, speeds, parameters and inputs.
    robot : Robot
        Collects what is left out, and warnings.
    problems : list of Problem
    inputs : list of str
    parameters : dict of str to sympy.Symbol
    scalars : dict of sympy.Function to (str, sympy.Function)
        For every coordinate of sympy its name behind ``q.``, and its speed.
    products : set of sympy.Symbol
        Parameters that are products of inertia.
    reserved : tuple of str
        Names that no parameter may have.
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
        """Something wrong with a part of the system."""
        self.problems.append(Problem(FILE, None, None, where, message))

    def expression(self, value: Any) -> Expression:
        """A formula of the model; unknown symbols become parameters, unknown functions of time inputs."""
        import sympy

        try:
            return from_sympy_expression(sympy.sympify(value), self.named)
        except ExpressionError as error:
            raise Trouble(error.message) from None

    def text(self, value: Any) -> str:
        """The same as a text of the model file."""
        return str(self.expression(value))

    def named(self, e: Any) -> Tree:
        """The name of a symbol, a function of time or the rate of a coordinate."""
        import sympy

        if e in self.symbols:
            return ("name", self.symbols[e])
        if isinstance(e, sympy.Derivative):
            rate = self.symbols.get(e.expr, "")
            if len(e.variables) == 1 and rate.startswith("q."):
                return ("name", f"u.{rate[2:]}")
            allowed = "time derivatives of the joints' coordinates are allowed"
            raise ExpressionError(f"{e}; {allowed}, no accelerations and no rates of inputs")
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
                f"{e}: an unknown function; coordinates, speeds and functions of time alone are allowed"
            )
        self.symbols[e] = name
        return ("name", name)

    def _new_name(self, text: str) -> str:
        name = free_name(made_name(text), {*self.parameters, *self.inputs, *self.reserved})
        if name != text:
            self.robot.notes.append(f"{text} of the system is {name} here.")
        return name

    def vector(self, vector: Any, axes: Any) -> list[str]:
        """Components of a vector as texts."""
        return [self.text(c) for c in components(vector, axes)]

    def fixed(self, vector: Any, axes: Any, what: str) -> list[str]:
        """Components of a vector that is constant in these axes."""
        found = components(vector, axes)
        if any(moves(c) for c in found):
            raise Trouble(f"{what} is not constant in its body: {vector}")
        return [self.text(c) for c in found]

    def body_of_point(self, point: Any) -> tuple[Frame, list[str]]:
        """The body in which a point is fixed, and where."""
        places = [(frame, _place(point, frame)) for frame in self.all_frames()]
        for simplified in (False, True):
            for frame, place in places:
                if place is not None:
                    found = [c.simplify() for c in place] if simplified else place
                    if not any(map(moves, found)):
                        return frame, [self.text(c) for c in found]
        raise Trouble(f"point {point} is fixed in no body; forces act on points that are fixed in bodies")

    def body_of_frame(self, axes: Any) -> Frame:
        """The body in which a reference frame is fixed."""
        for frame in self.all_frames():
            try:
                turned = frame.axes.dcm(axes)
            except ValueError:
                continue
            if not any(map(moves, turned)):
                return frame
        raise Trouble(f"frame {axes} is fixed in no body; torques act on frames of bodies")

    def all_frames(self) -> list[Frame]:
        """The frames of the bodies, each once, moving ones first."""
        every = {id(f): f for f in self.frames.values()}.values()
        return sorted(every, key=lambda f: f.name == GROUND)


def components(vector: Any, axes: Any) -> list[Any]:
    """Components of a vector of sympy; a list of three expressions."""
    if vector == 0:
        import sympy

        return [sympy.Integer(0)] * 3
    return list(vector.to_matrix(axes))


def moves(e: Any) -> bool:
    """Whether an expression depends on functions of time, or on time."""
    from sympy.core.function import AppliedUndef

    return bool(e.atoms(AppliedUndef)) or time() in e.free_symbols


def _place(point: Any, frame: Frame) -> list[Any] | None:
    """Where a point is, from the origin of a body, in its axes; None where sympy does not know."""
    try:
        return components(point.pos_from(frame.origin), frame.axes)
    except ValueError:
        return None


def read_bodies(found: SympySystem, joints: Iterable[Any], bodies: Iterable[Any], inertial: Any, origin: Any) -> None:
    """The tree of bodies and joints.

    Parameters
    ----------
    found : SympySystem
        Gets frames, symbols and the section ``bodies``.
    joints, bodies : iterable of Joint and of body
    inertial : ReferenceFrame
        The inertial axes.
    origin : Point or None
        A point at rest; left out: the mass centre of the first body on the ground.
    """
    waiting = list(joints)
    known, carried = _in_order(list(bodies), waiting), {id(j.child) for j in waiting}
    roots = [b for b in known if b.masscenter is origin or getattr(b, "frame", None) is inertial]
    at_rest = [b for b in known if b not in roots and id(b) not in carried and _is_at_rest(b, inertial)]
    if not roots and not at_rest:
        message = (
            "no body is at rest in the inertial frame; a joint has to carry the first body, see System.from_newtonian"
        )
        raise ModelError([Problem(FILE, None, None, "bodies", message)])
    ground = Frame(GROUND, inertial, (roots or at_rest)[0].masscenter if origin is None else origin)
    names = names_for(dict.fromkeys(str(b.name) for b in known if b not in roots))
    for on_ground in (roots, at_rest):  # bodies that joints carry may be at rest, too
        found.frames |= {body: ground for body in on_ground if body not in found.frames}
        waiting = _follow(found, waiting, names)
    for body in known:
        if body not in found.frames:
            message = f"no joint carries this body; every body needs one of sympy's joints: {JOINTS}"
            found.report(f"bodies.{body.name}", message)


def _follow(found: SympySystem, joints: list[Any], names: Mapping[str, str]) -> list[Any]:
    """Read the joints that known bodies carry, from the inside to the outside; the others are left."""
    waiting, count = joints, -1
    while len(waiting) != count:
        count, joints, waiting = len(waiting), waiting, []
        for joint in joints:
            ends = [b in found.frames for b in (joint.parent, joint.child)]
            if all(ends):
                found.report(f"joints.{joint.name}", "closes a loop; in sympy, holonomic constraints close loops")
            elif any(ends):
                try:
                    _read_joint(found, joint, names, 1 if ends[0] else -1)
                except Trouble as error:
                    found.report(f"joints.{joint.name}", str(error))
            else:
                waiting.append(joint)
    return waiting


def _in_order(bodies: list[Any], joints: list[Any]) -> list[Any]:
    """All bodies, each once, those of joints too."""
    every = [*bodies, *(b for j in joints for b in (j.parent, j.child))]
    return list({id(b): b for b in every}.values())


def _is_at_rest(body: Any, inertial: Any) -> bool:
    """Whether the axes of a body are those of the ground, or fixed to them."""
    axes = getattr(body, "frame", None)
    if axes is None:
        return False
    try:
        return not any(map(moves, axes.dcm(inertial)))
    except ValueError:
        return False


def _read_joint(found: SympySystem, joint: Any, names: Mapping[str, str], sign: int) -> None:
    """A joint, and the body that it carries.

    The axes of the model's body are those of sympy's interframe, its origin is the point of the joint.
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
    """``x``, ``-z``, or three components."""
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
            raise Trouble("the inertia of the body is not constant in it")
        six = {"xyz"[i] + "xyz"[j]: matrix[i, j] for i in range(3) for j in range(i, 3)}
        found.products |= {value for key, value in six.items() if key[0] != key[1] and value.is_Symbol}
        if inertia := {key: found.text(value) for key, value in six.items() if value != 0}:
            entry["inertia"] = inertia
    if body.potential_energy != 0:
        remark = "counts in Lagrange's method and not in Kane's; forces are read from loads"
        found.robot.leave_out("potential_energy of bodies", None, Effect.UNKNOWN, remark)
    return entry


def joint_steps(joint: Any, sign: int) -> list[Step]:
    """The joints of the model that a joint of sympy's is, from the inside to the outside."""
    kind = type(joint).__name__
    q, u = tuple(joint.coordinates), tuple(joint.speeds)
    if kind == "WeldJoint":
        return [Step({"type": "fixed"})]
    if kind in ("PinJoint", "PrismaticJoint", "CylindricalJoint"):
        axis = [sign * c for c in components(joint.joint_axis, joint.parent_interframe)]
        keys = {"type": {"PinJoint": "revolute", "PrismaticJoint": "prismatic"}.get(kind, "cylindrical"), "axis": axis}
        order = slice(None, None, -1 if kind == "CylindricalJoint" else 1)  # the model format slides first
        return [Step(keys, q[order], u[order])]
    if kind not in ("PlanarJoint", "SphericalJoint"):
        raise Trouble(f"a {kind}; joints of a model are {JOINTS}")
    if sign < 0:
        raise Trouble(f"the child of this {kind} carries its parent; exchange the two bodies")
    if kind == "PlanarJoint":
        return [Step({"type": "planar", "normal": "x"}, (*q[1:], q[0]), (*u[1:], u[0]))]
    return _spherical(joint, q, u)


def _spherical(joint: Any, q: tuple[Any, ...], u: tuple[Any, ...]) -> list[Step]:
    """Three hinges, since sympy's coordinates are angles."""
    letters = str(joint._rot_order).upper().translate(str.maketrans("123", "XYZ"))
    amounts = list(q if joint._amounts is None else joint._amounts)
    if sorted(map(str, amounts)) != sorted(map(str, q)):
        raise Trouble(f"amounts {amounts}; the three coordinates, each once, are allowed")
    turns = list(zip(letters, amounts, strict=True))
    if joint._rot_type.upper() == "SPACE":
        turns.reverse()
    return [
        Step({"type": "revolute", "axis": letter.lower()}, (angle,), (u[q.index(angle)],)) for letter, angle in turns
    ]
