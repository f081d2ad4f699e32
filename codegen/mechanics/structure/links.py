"""From the bodies of a model to links, and the constants of a link as functions of the design parameters.

A body's joint becomes one or more links, all but the last without mass: a universal joint becomes two revolute ones. A body on a
fixed joint becomes part of the link that carries it. Expressions are compared by identity, so repeated bodies of a chain are
analysed once.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import field
from typing import NamedTuple, Protocol

from ...model.expressions import Expression
from ...model.model import GROUND, Body, Joint, Model, coordinate_axis
from ...model.model import Vector as ExpressionVector
from ...model.motions import Ball, Displacement, Motion, Slide, Turn
from ...model.quarter_turns import cosine_and_sine, quarter_turns
from ...program.field import XYZ
from ...program.scalar import Matrix, Value, Vector
from ...records import dataclass
from ..joints import DRIVEN_JOINTS, LINK_JOINTS, LinkJoint
from ..spatial import add, cross, dot, matmul, matvec, scale, transpose

Evaluate = Callable[[Expression], Value]
NumberOf = Callable[[Expression], float]
"""The type of a function that gives the value of an expression at the default parameters."""


class Function(Protocol):
    """A function of values."""

    def __call__(self, *arguments: Value) -> Value: ...


Functions = Mapping[str, Function]
"""Type of a mapping from ``sqrt``, ``cos``, ``sin`` and ``at_least`` to these functions, for numbers or symbols."""
Let = Callable[[str, Value], Value]
Placement = tuple[ExpressionVector, tuple[tuple[ExpressionVector, Expression], ...]]
"""Type of the placement of one frame in another: origin, and rotations about axes of the rotated frame."""
Carrier = tuple[int, tuple[Placement, ...]]
"""Type of a body's carrier: the link that carries it, and the placements from that link's body to the body."""


@dataclass(slots=True, eq=False)
class Frame:
    """A link's frame in its body: one of the frame's coordinate axes is the axis of the joint.

    `index` is that coordinate axis. `vector` is the axis along the body's axes; None if the link has the body's axes. For an axis
    that is not a coordinate axis of the body, `start` is the body axis from which the frame's first axis is constructed; None:
    the one along which the axis has its smallest component with the parameters of a call.
    """

    index: int
    vector: ExpressionVector | None = None
    flipped: bool = False
    start: int | None = 0

    def form(self) -> tuple[object, ...]:
        """A key, equal for frames whose matrices differ only in numbers."""
        return () if self.vector is None else (self.flipped, self.flipped and self.index, self.start)

    def key(self) -> tuple[object, ...]:
        return (self.index, self.flipped, self.start, None if self.vector is None else tuple(map(id, self.vector)))


@dataclass(slots=True, eq=False)
class Link:
    """A rigid part, and the joint by which it moves.

    Attributes
    ----------
    name : str
        Name of the body, or of a part of its joint.
    parent : int
        Index of a link, or `GROUND`.
    q, u : int
        First of its coordinates and speeds in the model's arrays.
    steps : tuple of Placement
        From the parent's body frame, by way of fixed bodies, to the joint frame.
    parent_frame, frame : Frame
    axis : int
        The coordinate axis of the link's frame that the joint rotates about or slides along.
    factors : tuple of Expression
        Factors of the joint's motion, such as a pitch.
    turned : float
        Angle added to the joint angle, rad: the constant rotation of the joint's frame about its own axis.
    driven : int
        Number of its prescribed coordinate; -1 if none is prescribed.
    moves : tuple of bool
        Whether the prescribed coordinate, its rate and its acceleration can differ from zero.
    armature : tuple of Expression
        Reflected inertia of the rotor of each speed, including a prescribed one; empty if there are no rotors.
    speed : int
        First of its speeds in `Model.released`, in which prescribed coordinates are free.
    members : list of (Body, tuple of Placement)
        Bodies that move with the link, with the placements from its body to theirs.
    """

    name: str
    parent: int
    joint: type[LinkJoint]
    q: int
    u: int
    steps: tuple[Placement, ...]
    parent_frame: Frame
    frame: Frame
    axis: int
    factors: tuple[Expression, ...] = ()
    turned: float = 0.0
    driven: int = -1
    moves: tuple[bool, ...] = ()
    armature: tuple[Expression, ...] = ()
    speed: int = -1
    members: list[tuple[Body, tuple[Placement, ...]]] = field(default_factory=list)

    def structure(self) -> tuple[object, ...]:
        """A key, equal for links whose constants differ only in numbers and parameters."""
        return (
            self.parent_frame.form(), self.frame.form(), form_of_steps(self.steps),
            tuple(form_of_steps(steps) for _, steps in self.members), len(self.factors), self.aligned, self.geared(),
        )  # fmt: skip

    def expressions(self) -> list[Expression]:
        """The expressions in its constants, in a fixed order."""
        found = [*(self.parent_frame.vector or ()), *(self.frame.vector or ()), *expressions_of_steps(self.steps)]
        for _, steps in self.members:
            found += expressions_of_steps(steps)
        for body, _ in self.members:
            found += [body.mass, *body.com, *body.inertia]
        return [*found, *self.factors, *self.armature]

    def geared(self) -> tuple[bool, ...]:
        """Whether each speed of the joint has a rotor."""
        return tuple(e.tree != ("number", 0) for e in self.armature)

    @property
    def aligned(self) -> bool:
        """Whether the link's axes coincide with its parent's at q = 0, because both frames have the same axis
        vector."""
        is_same = self.frame.vector is not None and self.frame.key() == self.parent_frame.key()
        return is_same and not any(rotation for _, rotation in self.steps)

    def write_constants(self, evaluate: Evaluate, functions: Functions, let: Let) -> dict[str, Value]:
        """Mass, first moment, inertia about the link's origin, and position of the joint, along the link's axes.

        Returns
        -------
        dict
            ``m``; ``h.i`` = mass times centre of mass; ``J.ij`` about the origin; ``r.i`` joint's position along the parent's
            axes; ``R.ij`` parent from link components at q = 0; ``factor`` of the joint, if any; ``rotor0``, ... of speeds with
            rotors. SI units.
        """
        Q_parent = frame_matrix(self.parent_frame, evaluate, functions, let)
        Q = frame_matrix(self.frame, evaluate, functions, let)
        r, R = place(self.steps, evaluate, functions, let)
        r = matvec(transpose(Q_parent), r)
        half = [[let("Rh", e) for e in row] for row in matmul(transpose(Q_parent), R)]
        R = identity() if self.aligned else [[let("R", e) for e in row] for row in matmul(half, Q)]
        m, h, J = rigid_inertia(self.members, evaluate, functions, let)
        h = [let("h", e) for e in matvec(transpose(Q), h)]
        if self.frame.vector is not None:
            half = [[let("Jh", e) for e in row] for row in matmul(transpose(Q), J)]
            J = matmul(half, Q)
        out: dict[str, Value] = {"m": m}
        for k, i in enumerate(XYZ):
            out[f"h.{i}"] = h[k]
            out[f"r.{i}"] = let(f"r_{i}", r[k])
            for n, j in enumerate(XYZ):
                if n >= k:
                    out[f"J.{i}{j}"] = let(f"J_{i}{j}", J[k][n])
                out[f"R.{i}{j}"] = R[k][n]
        for value in self.factors:
            out["factor"] = let("factor", evaluate(value))
        for speed, value in enumerate(self.armature):
            if self.geared()[speed]:
                out[f"rotor{speed}"] = let("rotor", evaluate(value))
        return out


BODY_FRAME = Frame(2)
ZERO = Expression.number(0)
ORIGIN: ExpressionVector = (ZERO, ZERO, ZERO)


def axis_frame(axis: ExpressionVector, evaluate: NumberOf, is_seen: bool = True) -> Frame:
    """The frame of a joint with this axis. It has the body's axes if the joint axis points along one of them.

    `is_seen`: results depend on the directions across the axis, so these remain those of the default parameters. Otherwise no
    parameters may turn the axis into the direction from which the others are constructed.
    """
    along = coordinate_axis(axis)
    if along is not None:
        i, sign = along
        return Frame(i, axis, flipped=True) if sign < 0 else Frame(i)
    if not is_seen and all(a.names for a in axis):
        return Frame(2, axis, start=None)
    defaults = [abs(evaluate(a)) for a in axis]
    return Frame(2, axis, start=defaults.index(min(defaults)))


class Part(NamedTuple):
    """The part of a body's joint that one link represents.

    Attributes
    ----------
    joint : type of LinkJoint
    q, u : int
        First of its coordinates and speeds among those of the body's joint.
    axis : int or None
        Index, among the axes of the body's joint, of the first axis of this link's joint.
    factors : tuple of int
        Indices of the joint's factors.
    """

    joint: type[LinkJoint]
    q: int
    u: int
    axis: int | None
    factors: tuple[int, ...]


def parts_of(chain: Sequence[Motion], triad: bool = False, held: Collection[int] = ()) -> list[Part]:
    """Joints of links that represent a chain of motions; each takes the longest possible part of the chain.

    `triad`: the axes form a right-handed frame; only then may one link's joint have several axes. Prescribed coordinates (`held`)
    get links of their own.

    Raises
    ------
    TypeError
        No joint of a link represents some motion, or two links would share a coordinate.
    """
    found: list[Part] = []
    while chain:
        held_first = _is_held(chain[0], held)
        for joint in DRIVEN_JOINTS if held_first else LINK_JOINTS:
            of_joint = chain[: len(joint.motion)]
            part = _share(joint, of_joint, triad)
            if part is not None and all(_is_held(m, held) == held_first for m in of_joint):
                found.append(part)
                chain = chain[len(joint.motion) :]
                break
        else:
            raise TypeError(f"no joint of a link (mechanics/joints) represents the motion {chain[0]}")
    speeds = [part.u + j for part in found for j in range(part.joint.freedoms)]
    if len(set(speeds)) < len(speeds):
        raise TypeError("no joint of a link (mechanics/joints) represents motions that share a coordinate")
    return found


def _is_held(motion: Motion, held: Collection[int]) -> bool:
    return isinstance(motion, Turn | Slide) and motion.index in held


def _share(joint: type[LinkJoint], chain: Sequence[Motion], triad: bool) -> Part | None:
    """The part of the chain that this joint can represent; None if joint and chain differ in more than numbering."""
    places: set[tuple[int, int]] = set()
    own_axes: set[int] = set()
    axes: set[int] = set()
    factors: list[int] = []
    if len(chain) != len(joint.motion):
        return None
    for own, m in zip(joint.motion, chain, strict=True):
        if isinstance(own, Ball | Displacement) and isinstance(m, type(own)):
            places.add((m.coordinate - own.coordinate, m.speed - own.speed))
        elif isinstance(own, Turn | Slide) and isinstance(m, type(own)) and len(_factors(own)) == len(_factors(m)):
            places.add((m.index - own.index, m.index - own.index))
            own_axes.add(own.axis)
            axes.add((m.axis - own.axis) % 3)
            factors += _factors(m)
        else:
            return None
    if len(places) != 1 or len(axes) > 1 or (len(own_axes) > 1 and not triad):
        return None
    (q, u), axis = places.pop(), axes.pop() if axes else None
    return Part(joint, q, u, axis, tuple(factors))


def _factors(motion: Motion) -> list[int]:
    return [motion.factor] if isinstance(motion, Slide) and motion.factor is not None else []


def links_of(model: Model, evaluate: NumberOf) -> tuple[list[Link], list[Carrier]]:
    """The links of a model in outward order, and the carrier of each body.

    Parameters
    ----------
    model : Model
    evaluate : callable
        Values of expressions at the default parameters; used only to choose between equivalent frames.
    """
    links: list[Link] = []
    carriers: list[Carrier] = [(GROUND, ())] * len(model.bodies)
    held: dict[int, dict[int, int]] = {}
    for (k, i), n in model.places_of_prescribed.items():
        held.setdefault(k, {})[i] = n
    for k in model.outward:
        body = model.bodies[k]
        parent, steps = carriers[body.parent] if body.parent != GROUND else (GROUND, ())
        parent_frame = links[parent].frame if parent != GROUND else BODY_FRAME
        joint = body.joint
        steps = (*steps, (joint.at, tuple(r for r in joint.rotation if quarter_turns(r[1]) != 0)))
        q, u = (s.start for s in model.coordinate_slices[k])
        parts = parts_of(joint.kind.motion, joint.kind.triad, held.get(k, {}))
        if not parts:
            carriers[k] = parent, steps
            if parent != GROUND:
                links[parent].members.append((body, steps))
            continue
        for n, part in enumerate(parts, 1):
            name = body.name if len(parts) == 1 else f"{body.name}.{n}"
            frame, axis = _frame_of(joint, part, evaluate)
            factors = tuple(joint.factors[i] for i in part.factors)
            before = sum(i < part.q for i in held.get(k, ()))  # all coordinates of such a joint are scalars
            places = q + part.q - before, u + part.u - before
            angle = 0.0
            if part.axis is not None and part.joint.angle is not None:
                (at, rotation), along = steps[-1], joint.axes[0 if joint.kind.triad else part.axis]
                rotation, angle = turned_about(rotation, along) if axis == frame.index else (rotation, 0.0)
                steps = (*steps[:-1], (at, rotation))
            link = Link(name, parent, part.joint, *places, steps, parent_frame, frame, axis, factors, angle)
            link.armature = joint.armature[part.u : part.u + part.joint.speeds()]
            if not any(link.geared()):
                link.armature = ()
            link.speed = model.released.coordinate_slices[k][1].start + part.u
            if part.joint.driven:
                link.driven = held[k][part.q]
                link.moves = tuple(e.tree != ("number", 0) for e in model.prescribed[link.driven].values)
            links.append(link)
            parent, parent_frame, steps = len(links) - 1, frame, ((ORIGIN, ()),)
        links[-1].members.append((body, ()))
        carriers[k] = len(links) - 1, ()
    return links, carriers


def turned_about(
    rotation: tuple[tuple[ExpressionVector, Expression], ...], axis: ExpressionVector
) -> tuple[tuple[tuple[ExpressionVector, Expression], ...], float]:
    """Splits off the last part of the rotation of a joint's frame, if that part is a rotation by a number about the joint's
    own axis; returns the remaining rotation, and the angle of that part, rad.

    The angle is added to the joint angle, which costs less than a constant rotation. Only one angle is split off, since a sum
    of several would be rounded. Quarter turns stay, since they cost nothing.
    """
    if not rotation:
        return rotation, 0.0
    about, angle = rotation[-1]
    along, own = coordinate_axis(about), coordinate_axis(axis)
    same = 1 if about == axis else 0 if along is None or own is None or along[0] != own[0] else along[1] * own[1]
    if not same or not angle.is_number or quarter_turns(angle) is not None:
        return rotation, 0.0
    return rotation[:-1], same * float(angle.value)


def _frame_of(joint: Joint, part: Part, evaluate: NumberOf) -> tuple[Frame, int]:
    """The frame of a link, and the index of its coordinate axis that is the joint axis."""
    if part.axis is None:
        return BODY_FRAME, BODY_FRAME.index
    if joint.kind.triad:  # all links of the joint have the axes of the first one
        frame = axis_frame(joint.axes[0], evaluate)
        return frame, (frame.index + part.axis) % 3
    frame = axis_frame(joint.axes[part.axis], evaluate, is_seen=False)
    return frame, frame.index


# -- constants: the same lines for floats and symbols -------------------------------------------------------------


def identity() -> Matrix:
    return [[int(i == j) for j in range(3)] for i in range(3)]


def unit(v: Vector, sqrt: Function, let: Let) -> Vector:
    length = let("length", sqrt(dot(v, v)))
    inverse = let("inverse", 1 / length)
    return [let("e", x * inverse) for x in v]


def frame_matrix(frame: Frame, evaluate: Evaluate, functions: Functions, let: Let) -> Matrix:
    """Rotation matrix of the frame: body from link components."""
    if frame.vector is None:
        return identity()
    if frame.flipped:
        turned = identity()
        for i in (frame.index, (frame.index + 2) % 3):
            turned[i][i] = -1
        return turned
    sqrt = functions["sqrt"]
    z = unit([evaluate(a) for a in frame.vector], sqrt, let)
    start = [int(i == frame.start) for i in range(3)] if frame.start is not None else _least_along(z, functions, let)
    x = unit([let("across", e) for e in cross(start, z)], sqrt, let)
    y = [let("e", e) for e in cross(z, x)]
    return transpose([x, y, z])


def _least_along(z: Vector, functions: Functions, let: Let) -> Vector:
    """The base vector with the smallest component along z."""
    a, b, c = (let("square", e * e) for e in z)
    at_least = functions["at_least"]
    first = let("first", at_least(b, a) * at_least(c, a))
    second = let("second", (1 - first) * at_least(c, b))
    return [first, second, let("third", 1 - first - second)]


def rotation_matrix(axis: Vector, cos: Value, sin: Value, sqrt: Function, let: Let) -> Matrix:
    """Rotation matrix about an axis (any length), from the cosine and sine of the angle."""
    nonzero = [i for i in range(3) if not (axis[i] == 0)]
    along = axis[nonzero[0]] if len(nonzero) == 1 else None
    if isinstance(along, (int, float)):
        e: Vector = [0, 0, 0]
        e[nonzero[0]] = 1 if along > 0 else -1
    else:
        e = unit(axis, sqrt, let)
    versine = let("versine", 1 - cos)
    R = [[let("R", e[i] * e[j] * versine + (cos if i == j else 0)) for j in range(3)] for i in range(3)]
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        R[j][i] = let("R", R[j][i] + e[k] * sin)
        R[i][j] = let("R", R[i][j] - e[k] * sin)
    return R


def place(steps: Sequence[Placement], evaluate: Evaluate, functions: Functions, let: Let) -> tuple[Vector, Matrix]:
    """Origin and rotation of the frame after the last step, relative to the frame before the first step."""
    origin: Vector = [0, 0, 0]
    R = identity()
    turned = False
    for at, rotation in steps:
        v = [evaluate(a) for a in at]
        origin = [let("r", x) for x in add(origin, matvec(R, v) if turned else v)]
        for axis, angle in rotation:
            cos, sin = _cosine_and_sine(angle, evaluate, functions, let)
            one = rotation_matrix([evaluate(a) for a in axis], cos, sin, functions["sqrt"], let)
            R = [[let("R", e) for e in row] for row in matmul(R, one)] if turned else one
            turned = True
    return origin, R


def _cosine_and_sine(angle: Expression, evaluate: Evaluate, functions: Functions, let: Let) -> tuple[Value, Value]:
    quarters = quarter_turns(angle)
    if quarters is not None:
        return cosine_and_sine(quarters)
    value = evaluate(angle)
    return let("cosine", functions["cos"](value)), let("sine", functions["sin"](value))


def expressions_of_steps(steps: Sequence[Placement]) -> list[Expression]:
    """The expressions in a chain of placements, in a fixed order."""
    return [e for at, rotation in steps for e in (*at, *(x for axis, angle in rotation for x in (*axis, angle)))]


def form_of_steps(steps: Sequence[Placement]) -> tuple[object, ...]:
    """A key, equal for chains of placements whose statements differ only in numbers."""
    return tuple(tuple(quarter_turns(angle) for _, angle in rotation) for _, rotation in steps)


def rigid_inertia(
    members: Sequence[tuple[Body, tuple[Placement, ...]]],
    evaluate: Evaluate,
    functions: Functions,
    let: Let,
) -> tuple[Value, Vector, Matrix]:
    """Mass, first moment and inertia about the origin of bodies that move together, along the carrying body's axes."""
    mass: Value = 0
    moment: Vector = [0, 0, 0]
    inertia: Matrix = [[0] * 3 for _ in range(3)]
    for body, steps in members:
        m = let("m", evaluate(body.mass))
        c = [evaluate(e) for e in body.com]
        xx, yy, zz, xy, xz, yz = (evaluate(e) for e in body.inertia)
        I: Matrix = [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]
        if steps:
            origin, R = place(steps, evaluate, functions, let)
            c = [let("c", e) for e in add(origin, matvec(R, c))]
            half = [[let("Ih", e) for e in row] for row in matmul(R, I)]
            I = [[let("I", e) for e in row] for row in matmul(half, transpose(R))]
        h = [let("h", e) for e in scale(m, c)]
        for i in range(3):
            for j in range(i, 3):
                steiner = sum(h[k] * c[k] for k in range(3) if k != i) if i == j else -h[i] * c[j]
                inertia[i][j] = inertia[j][i] = let("J", inertia[i][j] + I[i][j] + steiner)
        mass = let("m", mass + m)
        moment = [let("h", e) for e in add(moment, h)]
    return mass, moment, inertia
