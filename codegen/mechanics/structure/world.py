"""Choice of the ground's axes, so that loops that close on the ground keep the simple form in which they were designed.

Suppose that a model file gives all bearings of a planar mechanism on the ground the same rotation. Along the ground's
axes its conditions then have terms in all three directions, and rounding changes its lengths: a parallelogram whose
sides differ in the last digit does not pass through its flat configuration. The ground therefore gets the axes of these
bearings. Gravity, and positions and axes on the ground, are rotated to the new axes. The rotation of the bearings
cancels symbolically. The rotation of rounded vectors leaves small numbers in place of zeros, and long numbers in
place of short decimals; `tidied` restores the zeros and decimals.
"""

from __future__ import annotations

import math
from bisect import bisect_left
from collections.abc import Iterator, Sequence
from dataclasses import replace

import mpmath

from ...model.expressions import Expression, combine
from ...model.forces.on_body import OnBody
from ...model.grammar import Tree
from ...model.model import GROUND, Body, Face, Loop, Model, Output, Vector
from ...program.scalar import Matrix
from ..spatial import transpose
from .links import ORIGIN, Placement, place

Rotation = tuple[tuple[Vector, Expression], ...]

DIGITS = 50
"""Number of decimal digits of rotated vectors."""

ROUNDED = 8 * 2.0**-52
"""Bound on rounding errors of a vector's components, relative to its length."""

BY_CHANCE = 1e-3
"""Largest probability that a number is this close to a decimal number by chance."""

_ONE: Tree = ("number", 1)


def turned_ground(model: Model) -> tuple[Model, tuple[Placement, ...]]:
    """The same system with other ground axes, if the conditions of loops on the ground are simpler along these axes.

    Parameters
    ----------
    model : Model

    Returns
    -------
    model : Model
        Gravity, axes, forces, joints and loops on the ground have components along the new axes. Coordinates are the same.
    way : tuple of Placement
        From the new axes to the model's, in which points, faces of force elements and rotations are given; empty if nothing
        has changed.
    """
    rotation = common_rotation(model)
    if not rotation:
        return model, ()
    turn = Turn(model, rotation)
    return (
        replace(
            model,
            gravity=None if model.gravity is None else turn.vector(model.gravity),
            bodies=tuple(turn.body(b) for b in model.bodies),
            loops=tuple(loop if loop.is_coupling else turn.loop(loop) for loop in model.loops),
            loads=tuple(
                replace(e, value=turn.vector(e.value)) if isinstance(e, OnBody) and e.axes == "ground" else e
                for e in model.loads
            ),
            outputs=tuple(turn.output(o) for o in model.outputs),
        ),
        ((ORIGIN, inverse(rotation)),),
    )


def common_rotation(model: Model) -> Rotation:
    """The rotation shared by most joints and faces on the ground; empty if no loop closes on the ground, or if force
    laws read positions.

    A rotation that depends on a parameter is not used: the parameter is there to move the mechanism in the world.
    """
    grounded = {GROUND}
    for k in model.outward:
        if model.bodies[k].joint.is_fixed and model.bodies[k].parent in grounded:
            grounded.add(k)
    closed = any(
        face.body in grounded for loop in model.loops if not loop.is_coupling for face in (loop.start, loop.end)
    )
    if not closed or any(e.measured for e in model.elements):
        return ()
    votes: dict[Rotation, int] = {}
    mounts = 0
    for rotation in _rotations_on_ground(model):
        mounts += 1
        for n in range(1, len(rotation) + 1):
            axis, angle = rotation[n - 1]
            if not all(e.is_number for e in (*axis, angle)):
                break
            votes[rotation[:n]] = votes.get(rotation[:n], 0) + 1
    best = max(votes, key=lambda r: (votes[r], len(r)), default=())
    return best if 2 * votes.get(best, 0) > mounts else ()


def _rotations_on_ground(model: Model) -> Iterator[Rotation]:
    yield from (b.joint.rotation for b in model.bodies if b.parent == GROUND)
    for loop in (x for x in model.loops if not x.is_coupling):
        yield from (face.rotation for face in (loop.start, loop.end) if face.body == GROUND)


def inverse(rotation: Rotation) -> Rotation:
    """The inverse of a rotation."""
    return tuple((axis, Expression(combine("neg", angle.tree))) for axis, angle in reversed(rotation))


class Turn:
    """Transforms quantities from the model's axes of the ground to new ones.

    Parameters
    ----------
    model : Model
    rotation : tuple of (Vector, Expression)
        From the model's axes to the new ones, with numbers only.
    """

    def __init__(self, model: Model, rotation: Rotation):
        self.rotation = rotation
        self.back = inverse(rotation)
        with mpmath.workdps(DIGITS):
            functions = {name: getattr(mpmath, name) for name in ("sqrt", "cos", "sin")}
            self.to_new: Matrix = transpose(
                place([(ORIGIN, rotation)], lambda e: mpmath.mpf(e.value), functions, lambda _, value: value)[1]
            )
        self.known = sorted({abs(c) for v in _places(model) for terms in linear(v).values() for c in terms if c})

    def body(self, b: Body) -> Body:
        if b.parent != GROUND:
            return b
        joint = replace(b.joint, at=self.vector(b.joint.at), rotation=self.rotated(b.joint.rotation))
        return replace(b, joint=joint)

    def loop(self, loop: Loop) -> Loop:
        return replace(loop, start=self.face(loop.start), end=self.face(loop.end))

    def face(self, face: Face) -> Face:
        return face if face.body != GROUND else Face(GROUND, self.vector(face.at), self.rotated(face.rotation))

    def output(self, o: Output) -> Output:
        return o if o.axis is None or "body" in o.choice else replace(o, axis=self.vector(o.axis))

    def rotated(self, rotation: Rotation) -> Rotation:
        """A rotation relative to the new axes, from one relative to the model's."""
        n = len(self.rotation)
        return rotation[n:] if rotation[:n] == self.rotation else (*self.back, *rotation)

    def vector(self, v: Vector) -> Vector:
        """Components of a vector along the new axes."""
        found: list[Tree] = [("number", 0)] * 3
        with mpmath.workdps(DIGITS):
            for base, coefficients in linear(v).items():
                size = ROUNDED * math.hypot(*coefficients)
                for i, row in enumerate(self.to_new):
                    c = tidied(float(mpmath.fdot(row, coefficients)), size, self.known)
                    found[i] = combine("+", found[i], times(c, base))
        x, y, z = map(Expression, found)
        return x, y, z


def _places(model: Model) -> Iterator[Vector]:
    """Positions of joints and loop faces in bodies."""
    yield from (b.joint.at for b in model.bodies if b.parent != GROUND)
    yield from (face.at for loop in model.loops for face in (loop.start, loop.end) if face.body != GROUND)


def linear(v: Vector) -> dict[Tree, list[float]]:
    """A vector as a sum of expressions, each with a vector of numbers as its coefficient."""
    found: dict[Tree, list[float]] = {}
    for i, component in enumerate(v):
        for base, c in terms(component.tree).items():
            found.setdefault(base, [0, 0, 0])[i] += c
    return found


def terms(tree: Tree) -> dict[Tree, float]:
    """An expression as a sum of expressions, each with a number as its coefficient."""
    kind = tree[0]
    if kind == "number":
        return {_ONE: tree[1]} if tree[1] else {}
    if kind == "neg":
        return {base: -c for base, c in terms(tree[1]).items()}
    if kind in ("+", "-"):
        found = terms(tree[1])
        for base, c in terms(tree[2]).items():
            found[base] = found.get(base, 0) + (c if kind == "+" else -c)
        return found
    if kind == "*":
        for factor, other in ((tree[1], tree[2]), (tree[2], tree[1])):
            if factor[0] == "number":
                return {base: factor[1] * c for base, c in terms(other).items()}
        inner = terms(tree[1]), terms(tree[2])
        if all(len(found) == 1 for found in inner):
            (one, a), (other, b) = (next(iter(found.items())) for found in inner)
            return {combine("*", one, other): a * b}
    if kind == "/":
        inner_terms = terms(tree[1])
        if tree[2][0] == "number":
            return {base: c / tree[2][1] for base, c in inner_terms.items()}
        if len(inner_terms) == 1:
            ((base, c),) = inner_terms.items()
            return {("/", base, tree[2]): c}
    return {tree: 1}


def times(number: float, tree: Tree) -> Tree:
    """The product of an expression and a number; a factor of -1 becomes a sign."""
    return combine("neg", tree) if number == -1 else combine("*", Expression.number(number).tree, tree)


def tidied(value: float, size: float, known: Sequence[float] = ()) -> float:
    """The number that a value was before rounding, if that can be recognised.

    Parameters
    ----------
    value : float
    size : float
        Bound on the rounding error.
    known : sequence of float
        Positive numbers in increasing order; a value within rounding of one is replaced by it.

    Returns
    -------
    float
        One of the known numbers or its negative; otherwise a decimal with too few digits to be this close by chance;
        otherwise the value.
    """
    if abs(value) <= size:
        return 0.0
    at = bisect_left(known, abs(value) - size)
    if at < len(known) and known[at] <= abs(value) + size:
        return known[at] if value > 0 else -known[at]
    digits = 0
    while size * 10.0**digits < 0.5 * BY_CHANCE:
        decimal = round(value, digits)
        if abs(decimal - value) <= size:
            return decimal
        digits += 1
    return value
