"""Members of a model: parameters, bodies with joints, loops, couplings, conditions on points, prescribed motion."""

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
"""A joint's type, with the facts for all engines."""


@dataclass(frozen=True, slots=True)
class Parameter:
    """A design parameter: an input of every function at run time, with derivatives."""

    name: str
    value: float
    unit: str = ""
    min: float | None = None
    max: float | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Joint:
    """A joint, with its frame in the parent body.

    Attributes
    ----------
    type : str
        A name of `joints.JOINTS`.
    axes : tuple of Vector
        Axes of its motion, not normalised. At zero coordinates the child's frame coincides with the joint's.
    at : Vector
        Origin of the joint frame in the parent's body frame, m.
    rotation : tuple of (Vector, Expression)
        Fixed rotation of the joint frame relative to the parent's body frame: rotations by an angle (rad) about an axis
        (not normalised), in sequence about the rotated axes. Empty: the axes are parallel at q = 0.
    factors : tuple of Expression
        Factors of its motion, such as the pitch of a screw joint.
    armature : tuple of Expression
        Reflected inertia of its rotors, one for each speed, kg m^2 or kg; empty if there are none.
    """

    type: str
    axes: tuple[Vector, ...]
    at: Vector
    rotation: tuple[tuple[Vector, Expression], ...] = ()
    factors: tuple[Expression, ...] = ()
    armature: tuple[Expression, ...] = ()

    @property
    def kind(self) -> Kind:
        """The class of the joint's type, with its facts for all engines."""
        return JOINTS[self.type]

    @property
    def is_fixed(self) -> bool:
        """Whether the joint has no degree of freedom."""
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
        Solids and meshes that views show. None: lines between its joints and points.
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
    """A joint that closes a loop. It imposes conditions and has no coordinates.

    Attributes
    ----------
    type : str
        A name of `joints.JOINTS`, of a type with a closure.
    axes : tuple of Vector
        Axes of the file, not normalised. A single axis has the same components in both faces; of two axes the first is fixed in
        `start`, the second in `end`.
    start, end : Face
        ``from`` and ``to`` of the file; the joint type documents the conditions on them.
    turned : bool
        Whether the faces are exchanged, so that conditions are along the axes of ``to``. See `Model.with_turned`.
    """

    name: str
    type: str
    axes: tuple[Vector, ...]
    start: Face
    end: Face
    turned: bool = field(default=False, kw_only=True)

    @property
    def closure(self) -> Closure:
        """The conditions that a joint of this type imposes."""
        return CLOSURE_ROWS[self.type]

    @property
    def is_coupling(self) -> bool:
        """Whether the loop is a coupling, which relates coordinates and has no faces."""
        return False

    @property
    def surfaces(self) -> tuple[SurfaceFunction, ...]:
        """For a condition on a point: one function for each condition, zero when it holds. Empty for joints and couplings."""
        return ()


@dataclass(frozen=True, slots=True, eq=False)
class Term:
    """A coordinate in a coupling, with its factor.

    Attributes
    ----------
    body, index : int
        The body with the coordinate's joint, and the index of the coordinate in it; the joint has no quaternion.
    factor : Expression
        An expression of parameters.
    """

    body: int
    index: int
    factor: Expression


@dataclass(frozen=True, slots=True, eq=False)
class Coupling(Loop):
    """A relation between coordinates of joints: ``q_0 = r_1 q_1 + r_2 q_2 + ... + c``. It counts as a loop without faces.

    It is one condition, ``sum of factor q - offset = 0``, in the unit of the first coordinate. The first factor is 1;
    the other factors are minus the ratios. The faces of a coupling are on the ground, and are never used.

    Attributes
    ----------
    terms : tuple of Term
        The coupled coordinates; the first is the one that the file expresses by the others.
    offset : Expression
        c, an expression of parameters.
    """

    terms: tuple[Term, ...] = ()
    offset: Expression = ZERO

    @property
    def closure(self) -> Closure:
        """One condition that does not compare faces; it takes the place of an angular condition."""
        return Closure(0, 1)

    @property
    def is_coupling(self) -> bool:
        """True for every coupling."""
        return True


@dataclass(frozen=True, slots=True, eq=False)
class PointCondition(Loop):
    """A condition on the position of the origin of `end` in the face `start`: a distance, a surface or a curve.

    Attributes
    ----------
    type : str
        A name of `conditions.CONDITIONS`.
    equations : tuple of Expression
        Expressions of parameters and `surfaces.COORDINATES` that must be zero, one per condition. For a distance: a sphere.
    length : Expression or None
        For a distance: its length, m.
    """

    equations: tuple[Expression, ...] = ()
    length: Expression | None = None

    @property
    def surfaces(self) -> tuple[SurfaceFunction, ...]:
        """The functions of the equations, with their derivatives."""
        return tuple(surface_function(e) for e in self.equations)


COUPLING = "coupling"
"""The type name of couplings in `Loop.type`."""


def coupling(name: str, terms: tuple[Term, ...], offset: Expression) -> Coupling:
    """A coupling of the coordinates in `terms`, with an offset."""
    nowhere = Face(GROUND, (ZERO, ZERO, ZERO))
    return Coupling(name, COUPLING, (), nowhere, nowhere, terms, offset)


CLOSURE_ROWS = {
    **{kind.name: kind.closure for kind in JOINTS.values() if kind.closure},
    **{kind.name: kind.closure for kind in CONDITIONS.values()},
}
"""Numbers of linear and angular conditions of a loop joint, or of a condition on a point."""


def closure_row_names(loop: Loop) -> tuple[str, ...]:
    """``name.l1 ...`` for the linear conditions of a loop joint, then ``name.a1 ...`` for the angular ones.

    The directions of both are fixed in the start face, in the following order. Let a be the joint's (first) axis. If a
    is along one of the face's axes x, y, z, the directions are these axes. If a points in the negative direction of one
    of them, that direction and one other are reversed. For any other a, the directions are t1, t2 and a: t1 is along
    e x a, with e the base vector most nearly perpendicular to a, and t2 = a x t1. If a joint has no condition along its
    axis, the other two directions follow in cyclic order: y, z for x; z, x for y; x, y for z; t1, t2. A coupling has
    ``name.q``. The conditions on a point are its equations, each along its gradient.
    """
    if loop.is_coupling:
        return (f"{loop.name}.q",)
    linear, angular = loop.closure
    return tuple(f"{loop.name}.{c}{i + 1}" for c, n in (("l", linear), ("a", angular)) for i in range(n))


def outward(bodies: Sequence[Body]) -> tuple[list[list[int]], list[int]]:
    """The children of every body of a tree, and all bodies in depth-first order, so that each subtree is contiguous."""
    children: list[list[int]] = [[] for _ in (*bodies, GROUND)]  # the ground, with index -1, is the last
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

    A joint with one coordinate gives it the body's name, other joints ``body.suffix``. Quaternions convert child components into
    parent components. Angular velocity and velocity of the body's origin are relative to the parent, in child components.
    """
    kind = JOINTS[type]
    if kind.coordinates == ("",):
        return (name,), (name,)
    return tuple([f"{name}.{s}" for s in kind.coordinates]), tuple([f"{name}.{s}" for s in kind.speeds])


@dataclass(frozen=True, slots=True)
class Prescribed:
    """A coordinate that is a function of time, parameters and inputs. It is not in q, and its rate is not in u.

    Attributes
    ----------
    name : str
    body, index : int
        The body with the coordinate's joint, and the index of the coordinate in it.
    values : tuple of Expression
        The coordinate, its rate and its acceleration.
    """

    name: str
    body: int
    index: int
    values: tuple[Expression, Expression, Expression]

    @property
    def value(self) -> Expression:
        """The coordinate as an expression."""
        return self.values[0]
