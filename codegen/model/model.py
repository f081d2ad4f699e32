"""The model: what a file or the builder describes, checked and ready for the engines and the generator.

Every quantity that a model may give as an expression is an `Expression`; nothing is evaluated here, so one
model serves floats, mpmath numbers and symbols alike. Repeated structure is shared: bodies made by the same
lines of a ``repeat`` hold the same `Expression` objects, and the generator recognises them by identity.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property

from .expressions import Expression

GROUND = -1
"""Index of the ground in `Body.parent` and `Point.body`."""

Vector = tuple[Expression, Expression, Expression]


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
        One of ``fixed revolute prismatic universal spherical free``.
    axes : tuple of Vector
        Joint axes, not normalised: one for revolute and prismatic, two for universal (first fixed in the
        parent side, second in the child), none for the others. At q = 0 both joint frames coincide.
    at : Vector
        Origin of the joint frame in the parent's body frame, m.
    rotation : tuple of (Vector, Expression)
        Fixed rotation of the joint frame in the parent's body frame: rotations by an angle (rad) about an axis
        (not normalised), in sequence about the moving axes. Empty: the axes are parallel at q = 0.
    """

    type: str
    axes: tuple[Vector, ...]
    at: Vector
    rotation: tuple[tuple[Vector, Expression], ...] = ()


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
    """

    name: str
    parent: int
    joint: Joint
    mass: Expression
    com: Vector
    inertia: tuple[Expression, Expression, Expression, Expression, Expression, Expression]


@dataclass(frozen=True, slots=True, eq=False)
class JointForce:
    """Generalised forces on the freedoms of a joint; positive raises u. Expressions of p, inputs, t, q.x, u.x."""

    name: str
    body: int
    values: tuple[Expression, ...]


@dataclass(frozen=True, slots=True, eq=False)
class Point:
    """A point fixed in a body (or the ground), in body axes, m."""

    name: str
    body: int
    at: Vector


@dataclass(frozen=True, slots=True, eq=False)
class Output:
    """A named scalar of interest.

    ``measure`` is ``position`` or ``velocity`` (of `point` in the ground frame along `axis`, normalised),
    ``kinetic_energy``, ``potential_energy`` or ``value`` (`expression` of p, inputs, t, q.x, u.x).
    """

    name: str
    measure: str
    point: Point | None = None
    axis: Vector | None = None
    expression: Expression | None = None


_COORDINATES = {
    "fixed": ((), ()),
    "revolute": (None, None),
    "prismatic": (None, None),
    "universal": (("1", "2"), ("1", "2")),
    "spherical": (("qw", "qx", "qy", "qz"), ("wx", "wy", "wz")),
    "free": (("px", "py", "pz", "qw", "qx", "qy", "qz"), ("wx", "wy", "wz", "vx", "vy", "vz")),
}


def joint_coordinates(name: str, type: str) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Names of a joint's coordinates and speeds, in array order.

    Joints of one freedom are called after their body, the others ``body.suffix``. Quaternions turn child components
    into parent components; angular velocity and velocity of the body origin are relative to the parent in child
    components.
    """
    q, u = _COORDINATES[type]
    if q is None or u is None:
        return (name,), (name,)
    return tuple(f"{name}.{s}" for s in q), tuple(f"{name}.{s}" for s in u)


@dataclass(frozen=True, eq=False)
class Model:
    """A checked multibody model. Made by `codegen.load_model` or `codegen.ModelBuilder`, never by hand.

    Attributes
    ----------
    gravity : Vector or None
        m/s^2 in the ground frame.
    bodies : tuple of Body
        In file order after ``repeat``; arrays q and u follow it.
    initial_q, initial_u : dict of str to Expression
        Initial values by coordinate and speed name (missing: 0, unit quaternion).
    warnings : tuple of str
    """

    name: str
    gravity: Vector | None
    parameters: tuple[Parameter, ...]
    inputs: tuple[str, ...]
    bodies: tuple[Body, ...]
    forces: tuple[JointForce, ...] = ()
    outputs: tuple[Output, ...] = ()
    initial_q: dict[str, Expression] = field(default_factory=dict)
    initial_u: dict[str, Expression] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()

    @cached_property
    def coordinate_names(self) -> tuple[str, ...]:
        return tuple(q for b in self.bodies for q in joint_coordinates(b.name, b.joint.type)[0])

    @cached_property
    def speed_names(self) -> tuple[str, ...]:
        return tuple(u for b in self.bodies for u in joint_coordinates(b.name, b.joint.type)[1])

    @cached_property
    def parameter_names(self) -> tuple[str, ...]:
        return tuple(p.name for p in self.parameters)

    @property
    def nq(self) -> int:
        return len(self.coordinate_names)

    @property
    def nu(self) -> int:
        return len(self.speed_names)

    @cached_property
    def coordinate_slices(self) -> tuple[tuple[slice, slice], ...]:
        """For each body, where its joint's coordinates stand in q and its speeds in u."""
        result, i, j = [], 0, 0
        for b in self.bodies:
            q, u = joint_coordinates(b.name, b.joint.type)
            result.append((slice(i, i + len(q)), slice(j, j + len(u))))
            i, j = i + len(q), j + len(u)
        return tuple(result)

    @cached_property
    def outward(self) -> tuple[int, ...]:
        """Body indices, every parent before its children, each subtree contiguous (depth first)."""
        children: dict[int, list[int]] = {}
        for k, b in enumerate(self.bodies):
            children.setdefault(b.parent, []).append(k)
        order: list[int] = []
        stack = children.get(GROUND, [])[::-1]
        while stack:
            k = stack.pop()
            order.append(k)
            stack.extend(children.get(k, [])[::-1])
        return tuple(order)

    def expressions(self) -> Iterator[Expression]:
        """Every expression of the model, shared ones as often as they are used."""
        if self.gravity:
            yield from self.gravity
        for b in self.bodies:
            yield from b.joint.at
            for axis in b.joint.axes:
                yield from axis
            for axis, angle in b.joint.rotation:
                yield from axis
                yield angle
            yield b.mass
            yield from b.com
            yield from b.inertia
        for f in self.forces:
            yield from f.values
        for o in self.outputs:
            if o.point:
                yield from o.point.at
            if o.axis:
                yield from o.axis
            if o.expression:
                yield o.expression
