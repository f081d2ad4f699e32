"""What a model has: parameters, bodies with their joints, loops, couplings and conditions on points, prescribed motion."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from .axes import Vector
from .conditions import CONDITIONS
from .entries import ZERO
from .expressions import Expression
from .joints import JOINTS, Closure, JointType
from .places import GROUND, Face
from .surfaces import SurfaceFunction, surface_function
from .visuals import Visual

Kind = type[JointType]
"""Of a joint: the facts that all engines work from."""


@dataclass(frozen=True, slots=True)
class Parameter:
    """A design parameter: a run-time input of every function, differentiable."""

    name: str
    value: float
    unit: str = ""
    min: float | None = None
    max: float | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Joint:
    """A joint, placed in its parent's body frame.

    Attributes
    ----------
    type : str
        A name of `joints.JOINTS`.
    axes : tuple of Vector
        Those that its motion counts, not normalised. At coordinates of zero the child's frame and the joint's coincide.
    at : Vector
        Origin of the joint frame in the parent's body frame, m.
    rotation : tuple of (Vector, Expression)
        Fixed rotation of the joint frame in the parent's body frame: rotations by an angle (rad) about an axis
        (not normalised), in sequence about the moving axes. Empty: the axes are parallel at q = 0.
    factors : tuple of Expression
        Of its motion, such as the pitch of a screw.
    armature : tuple of Expression
        Reflected inertia of the rotors that drive it, one for each speed, kg m^2 or kg; empty where none has any.
    """

    type: str
    axes: tuple[Vector, ...]
    at: Vector
    rotation: tuple[tuple[Vector, Expression], ...] = ()
    factors: tuple[Expression, ...] = ()
    armature: tuple[Expression, ...] = ()

    @property
    def kind(self) -> Kind:
        """The facts of its type."""
        return JOINTS[self.type]

    @property
    def is_fixed(self) -> bool:
        """Whether it has no freedom."""
        return not JOINTS[self.type].motion


@dataclass(frozen=True, slots=True, eq=False)
class Body:
    """A rigid body and the joint that connects it to its parent.

    Attributes
    ----------
    name : str
    parent : int
        Index into `Model.bodies`, or `GROUND`. May be larger than the body's own index.
    joint : Joint
    mass : Expression
        kg.
    com : Vector
        Centre of mass in the body frame, m.
    inertia : tuple of Expression
        xx, yy, zz, xy, xz, yz: matrix entries about the centre of mass in body axes, kg m^2.
    visuals : tuple of Visual or None
        What views show of it. None: lines between its joints and points.
    """

    name: str
    parent: int
    joint: Joint
    mass: Expression
    com: Vector
    inertia: tuple[Expression, Expression, Expression, Expression, Expression, Expression]
    visuals: tuple[Visual, ...] | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Loop:
    """A joint that closes a loop. It constrains; it has no coordinates of its own.

    Attributes
    ----------
    type : str
        A name of `joints.JOINTS`, of a type with a closure.
    axes : tuple of Vector
        Those of the file, not normalised. A single one has the same components in both faces; of two the first is fixed in
        `start`, the second in `end`.
    start, end : Face
        ``from`` and ``to`` of the file; what a joint holds of them stands with its type.
    turned : bool
        They are exchanged: conditions are along the axes of ``to``. See `Model.with_turned`.
    """

    name: str
    type: str
    axes: tuple[Vector, ...]
    start: Face
    end: Face
    turned: bool = field(default=False, kw_only=True)

    @property
    def closure(self) -> Closure:
        """The conditions that its type sets."""
        return CLOSURE_ROWS[self.type]

    @property
    def is_coupling(self) -> bool:
        """Whether it relates coordinates, and has no faces."""
        return False

    @property
    def surfaces(self) -> tuple[SurfaceFunction, ...]:
        """Of a condition on a point: functions that are zero, one a condition; of joints and couplings none."""
        return ()


@dataclass(frozen=True, slots=True, eq=False)
class Term:
    """A coordinate in a coupling, with what it is multiplied by.

    Attributes
    ----------
    body, index : int
        Whose joint's coordinate it is, and which of that; the joint has no quaternion.
    factor : Expression
        Of parameters.
    """

    body: int
    index: int
    factor: Expression


@dataclass(frozen=True, slots=True, eq=False)
class Coupling(Loop):
    """A relation between coordinates of joints: ``q_0 = r_1 q_1 + r_2 q_2 + ... + c``. A loop without faces.

    It sets one condition, ``sum of factor q - offset = 0``, in the unit of the first coordinate, whose factor is 1; those of the
    others are minus the ratios. Its faces are on the ground, and nobody asks for them.

    Attributes
    ----------
    terms : tuple of Term
        The coordinates that it relates; the first is the one that the file gives by the others.
    offset : Expression
        c, of parameters.
    """

    terms: tuple[Term, ...] = ()
    offset: Expression = ZERO

    @property
    def closure(self) -> Closure:
        """One condition, which is none of faces; it stands where angular ones do."""
        return Closure(0, 1)

    @property
    def is_coupling(self) -> bool:
        """It is."""
        return True


@dataclass(frozen=True, slots=True, eq=False)
class PointCondition(Loop):
    """A condition on where the origin of the face `end` is in the face `start`: a distance, a surface, a curve.

    Attributes
    ----------
    type : str
        A name of `conditions.CONDITIONS`.
    equations : tuple of Expression
        What is zero, each one condition: of parameters and `surfaces.COORDINATES`. Of a distance that of a sphere.
    length : Expression or None
        Of a distance, m.
    """

    equations: tuple[Expression, ...] = ()
    length: Expression | None = None

    @property
    def surfaces(self) -> tuple[SurfaceFunction, ...]:
        """The equations with their derivatives."""
        return tuple(surface_function(e) for e in self.equations)


COUPLING = "coupling"
"""The type of couplings."""


def coupling(name: str, terms: tuple[Term, ...], offset: Expression) -> Coupling:
    """A coupling by what it relates."""
    nowhere = Face(GROUND, (ZERO, ZERO, ZERO))
    return Coupling(name, COUPLING, (), nowhere, nowhere, terms, offset)


CLOSURE_ROWS = {
    **{kind.name: kind.closure for kind in JOINTS.values() if kind.closure},
    **{kind.name: kind.closure for kind in CONDITIONS.values()},
}
"""How many linear and angular conditions a loop joint, or a condition on a point, sets."""


def closure_row_names(loop: Loop) -> tuple[str, ...]:
    """``name.l1 ...`` for the linear conditions of a loop joint, then ``name.a1 ...`` for the angular ones.

    They are along, or about, directions of the start face, in this order. With a the joint's axis (its first) these are the
    face's own axes x, y, z if a is along one of them (two of them reversed if it is along its opposite); otherwise t1, t2
    and a, with t1 along e x a, t2 = a x t1, e the base vector that a is least along. Where a joint leaves out the direction
    of its axis, the other two follow in cyclic order: y, z for x; z, x for y; x, y for z; t1, t2. A coupling has ``name.q``.
    Those of a condition on a point are its equations, each along its gradient.
    """
    if loop.is_coupling:
        return (f"{loop.name}.q",)
    linear, angular = loop.closure
    return tuple(f"{loop.name}.{c}{i + 1}" for c, n in (("l", linear), ("a", angular)) for i in range(n))


def outward(bodies: Sequence[Body]) -> tuple[list[list[int]], list[int]]:
    """The children of every body of a tree, and all bodies, each subtree contiguous (depth first)."""
    children: list[list[int]] = [[] for _ in (*bodies, GROUND)]  # the ground's, whose index is -1, last
    for k, body in enumerate(bodies):
        children[body.parent].append(k)
    order, stack = list[int](), children[GROUND][::-1]
    while stack:
        k = stack.pop()
        order.append(k)
        stack.extend(children[k][::-1])
    return children, order


def joint_coordinates(name: str, type: str) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Names of a joint's coordinates and speeds, in array order.

    Joints of one freedom are called after their body, the others ``body.suffix``. Quaternions turn child components
    into parent components; angular velocity and velocity of the body origin are relative to the parent in child
    components.
    """
    kind = JOINTS[type]
    if kind.coordinates == ("",):
        return (name,), (name,)
    return tuple([f"{name}.{s}" for s in kind.coordinates]), tuple([f"{name}.{s}" for s in kind.speeds])


@dataclass(frozen=True, slots=True)
class Prescribed:
    """A coordinate that is a function of time, parameters and inputs; it is none of q, nor is its rate one of u.

    Attributes
    ----------
    name : str
    body, index : int
        Whose joint's coordinate it is, and which of that.
    values : tuple of Expression
        The coordinate, its rate and its acceleration.
    """

    name: str
    body: int
    index: int
    values: tuple[Expression, Expression, Expression]

    @property
    def value(self) -> Expression:
        """The coordinate."""
        return self.values[0]
