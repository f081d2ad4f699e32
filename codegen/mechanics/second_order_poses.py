"""Tangents of poses for second derivatives: a rotation vector and a displacement of each link, along the ground's axes.

Three components of a rotation vector take the place of nine tangents of a rotation matrix W: every entry of W is a function
of the rotation, ``dW = [rotation] W``. The adjoints of the two vectors are a moment and a force on the link. Second derivatives
follow from the statements that propagate this moment and this force; rotation vectors are not composed.
"""

from __future__ import annotations

from ..program import algebra
from ..program.algebra import Expr, Symbol
from ..program.block import Expansion
from ..program.derivatives import Tangents
from ..program.field import XYZ
from ..program.scalar import Matrix, Vector
from ..program.store import Store
from . import fields
from .joints.quaternion import QuaternionJoint
from .second_order_stores import in_memory
from .spatial import add, matmul, matvec
from .stores import ME, RECORD, TANGENT, UP
from .structure.kinds import LinkKind

Primitives = dict[Symbol, dict[Symbol, Expr]]


def is_attitude(store: Store, name: str) -> bool:
    """Whether a component is an entry of the rotation matrix of a link."""
    return store.memory is RECORD and name in fields.attitude.components


def attitudes(x: Expansion) -> tuple[Primitives, dict[Symbol, Expr]]:
    """The entries of rotation matrices that a block loads as functions of rotations, and the tangents of these."""
    transparent: Primitives = {}
    roots: dict[Symbol, Expr] = {}
    for symbol, (store, name) in list(x.block.loads.items()):
        if not is_attitude(store, name):
            continue
        found = transparent[symbol] = {}
        row, column = XYZ.index(name[-2]), name[-1]
        for by, other, sign in (((row + 1) % 3, (row + 2) % 3, 1), ((row + 2) % 3, (row + 1) % 3, -1)):
            turn = x.component(in_memory(TANGENT, store), fields.attitude_turn.components[by])
            slope = sign * x.component(store, f"{fields.attitude.name}.{XYZ[other]}{column}")
            if isinstance(turn, Symbol) and slope is not algebra.ZERO:
                found[turn], roots[turn] = slope, turn
    return transparent, roots


def rotation(kind: LinkKind, d: Tangents) -> list[tuple[Store, str, Expr]]:
    """The stores of a link's rotation vector, which are appended to the tangent of the block `kinematics.pose`."""
    x, tag = d.expansion, "d Eq. 22"
    joint = kind.joint(x, kind)
    W = x.load(UP, fields.attitude)
    turn: Vector = [x.component(in_memory(TANGENT, UP), name) for name in fields.attitude_turn.components]
    if joint.fixed is not None:
        turn = add(turn, matvec(W, _turn_of(d, joint.fixed)))
        W = [[x.let("W", e, "Eq. 22") for e in row] for row in matmul(W, joint.fixed)]
    own = _turn_of(d, joint.matrix) if isinstance(joint, QuaternionJoint) else joint.displacement()[0]
    turn = [x.let("turn", e, tag, lanes=True) for e in add(turn, matvec(W, own))]
    at = in_memory(TANGENT, ME)
    return [(at, name, algebra.expression(e)) for name, e in zip(fields.attitude_turn.components, turn, strict=True)]


def _turn_of(d: Tangents, R: Matrix) -> Vector:
    """The rotation vector of the tangent dR of a rotation matrix R: the axial vector of ``dR R^T``."""
    x = d.expansion
    rows = [[d.value(e) for e in row] for row in R]
    turn = [sum(a * b for a, b in zip(rows[i], R[j], strict=True)) for i, j in ((2, 1), (0, 2), (1, 0))]
    return [x.let("turn", e, "d Eq. 22", lanes=True) for e in turn]
