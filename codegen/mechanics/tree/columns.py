"""Columns of Jacobians and mass matrices, all at once: every link computes only the columns that it affects.

A column belongs to a coordinate or a speed of one link. It needs the factors of the triangularization and the response
to rotation (`turning`), but no derivative of the inverse dynamics:

    inward    from its own link, the force P that the column causes: r = -P^T P_k, propagated as in Eq. 45
    outward   on links that it does not rotate, ``d udot = r/D - G . (X dA_pr)``, as for any right side (Eqs. 53-55)
    outward   on its own link and all links outboard of it, also ``- t . dw_pr`` in ``d udot``, and
              ``dA = X dA_pr + C dw_pr + P d udot``

With udot held, a coordinate or speed of a link changes the link's own motion as its kinematics says, and its force by
``I dA + W dw``. The force on the parent changes also because the transmitted force rotates.
"""

from __future__ import annotations

from dataclasses import replace

from ...program.block import Scope
from ...program.scalar import Vector
from ...program.store import Store
from .. import fields
from ..elimination import OF_FREEDOMS, eliminate_force, substitute
from ..joints import LinkJoint
from ..joints.quaternion import QuaternionJoint
from ..rotors import rotor
from ..spatial import ZERO, inner, is_zero
from ..stores import DFORCE, DUDOT, ME, MY_COLUMNS, RIGHT_SIDE, UP_COLUMNS
from ..structure.kinds import LinkKind
from .back_substitution import carry
from .inverse_dynamics import joint_acceleration
from .kinematics import accelerate, angular_velocity
from .tangents import differentiate, tangent
from .triangularization import articulated_inertia, force_to_parent
from .turning import carried_change

OF_COLUMNS = replace(OF_FREEDOMS, right_side=fields.column_drive, moving="P")
"""The factors of the triangularization, and the stores of right sides of columns."""


def column_clear(x: Scope, kind: LinkKind) -> None:
    """Set the force of each column to zero."""
    nothing: Vector = [0] * 6
    x.store(MY_COLUMNS, fields.column_force, nothing)


def column_rest(x: Scope, kind: LinkKind) -> None:
    """Set the right side of a column to zero on links that are not inboard of the column's link."""
    for j in range(kind.joint.freedoms):
        x.store(MY_COLUMNS, fields.column_drive(j), 0)


def column_begin(x: Scope, kind: LinkKind) -> None:
    """For columns of the link, set the parent's change of angular velocity to zero."""
    x.store(UP_COLUMNS, fields.column_turning, ZERO)


def column_turns(x: Scope, kind: LinkKind) -> None:
    """Rotation vector of a quaternion's seed."""
    joint = kind.joint(x, kind)
    assert isinstance(joint, QuaternionJoint)
    joint.write_turn(MY_COLUMNS)


def column_seed(x: Scope, kind: LinkKind) -> None:
    """Changes of the link's motion due to its own coordinates and speeds, and the forces due to these changes."""
    joint = kind.joint(x, kind)
    carried, w = angular_velocity(x, joint)
    al, a = joint_acceleration(x, joint, *accelerate(x, joint, carried, fields.total))
    x.recall(ME, fields.parents_velocity, carried)
    x.recall(ME, fields.angular_velocity, w)
    moved: Vector = []
    if kind.has_parent:
        phi = x.load(ME, fields.joint_force)
        moved = force_to_parent(x, joint, phi, "Eq. 45")
    d = differentiate(x, kind, joint, own=True)
    turned = [tangent(d, e) for e in w]
    dA = [tangent(d, e) for e in (*al, *a)]
    x.store(MY_COLUMNS, fields.seed_turning, turned)
    x.store(MY_COLUMNS, fields.seed_acceleration, dA)
    W = [*x.load(ME, fields.all_turning_moment), *x.load(ME, fields.all_turning_push)]
    P = [
        x.let("P", inner(row, dA) + inner(turns, turned), "d Eq. 45", lanes=True)
        for row, turns in zip(articulated_inertia(x), W, strict=True)
    ]
    _add(x, MY_COLUMNS, P)
    if kind.has_parent:
        _add(x, UP_COLUMNS, [tangent(d, e) for e in moved])


def column_unit(x: Scope, kind: LinkKind) -> None:
    """A unit force along each degree of freedom: a wrench on the link, and its opposite on the parent."""
    joint = kind.joint(x, kind, lanes=True)
    wrench: Vector = [0] * 6
    for j, s in enumerate(joint.columns):
        wrench[s.lead] = wrench[s.lead] - x.entry(RIGHT_SIDE, j)
    _add(x, MY_COLUMNS, wrench)
    if kind.has_parent:
        _add(x, UP_COLUMNS, force_to_parent(x, joint, [-e for e in wrench], "Eq. 45"))


def column_in(x: Scope, kind: LinkKind) -> None:
    """For each column, the driving force of one joint, and the force that is propagated to the parent. Eqs. 45, 53."""
    joint = kind.joint(x, kind, lanes=True)
    P = x.load(MY_COLUMNS, fields.column_force)
    for j in reversed(range(joint.freedoms)):
        left, own = range(6 if kind.has_parent or j else 0), rotor(x, kind, j)
        eliminate_force(x, OF_COLUMNS, MY_COLUMNS, j, joint.columns[j], P, 0, [""] * 6, left, own)
    if kind.has_parent:
        _add(x, UP_COLUMNS, force_to_parent(x, joint, P, "Eq. 45"))


def column_back(x: Scope, kind: LinkKind) -> None:
    """Back substitution for columns whose coordinate or speed does not rotate the link. Eqs. 53-55."""
    joint = kind.joint(x, kind, lanes=True)
    A = _carried(x, joint)
    drive = [x.load(MY_COLUMNS, fields.column_drive(j)) for j in range(joint.freedoms)]
    found = _substitute(x, kind, joint, A, drive)
    x.store(MY_COLUMNS, fields.column_acceleration, _moved(x, joint, A, found))


def column_turn(x: Scope, kind: LinkKind) -> None:
    """Back substitution for columns whose coordinate or speed rotates the link."""
    joint = kind.joint(x, kind, lanes=True)
    A = _carried(x, joint)
    drive = [x.load(MY_COLUMNS, fields.column_drive(j)) for j in range(joint.freedoms)]
    turned: Vector = [0, 0, 0]
    if kind.has_parent:
        turned = joint.to_child(x.load(UP_COLUMNS, fields.column_turning), "dw", "d Eq. 18")
        for j in range(joint.freedoms):
            gain = [x.load(ME, fields.turning_gain(j, k)) for k in range(3)]
            drive[j] = drive[j] + inner(gain, turned)
    found = _substitute(x, kind, joint, A, drive)
    if kind.has_parent:
        values = kind.joint(x, kind)
        C = carried_change(x, values, x.load(ME, fields.parents_velocity))
        A = [x.let("A", e + inner(row, turned), "d Eq. 21", lanes=True) for e, row in zip(A, C, strict=True)]
    x.store(MY_COLUMNS, fields.column_turning, turned)
    x.store(MY_COLUMNS, fields.column_acceleration, _moved(x, joint, A, found))


def column_add(x: Scope, kind: LinkKind) -> None:
    """Add the changes that the link's own coordinates and speeds cause, including the response of its joint."""
    for field, seed in (
        (fields.column_turning, fields.seed_turning),
        (fields.column_acceleration, fields.seed_acceleration),
    ):
        for part, of in zip(field.scalars(), seed.scalars(), strict=True):
            x.store(
                MY_COLUMNS,
                part,
                x.let("own", x.load(MY_COLUMNS, part) + x.load(MY_COLUMNS, of), "d Eq. 21", lanes=True),
            )


def composite_seed(x: Scope, kind: LinkKind) -> None:
    """The force that a link and everything outboard require for a unit acceleration of each degree of freedom of the
    link."""
    freedoms = range(kind.joint.freedoms)
    forces = [x.load(ME, fields.composite_force(j)) for j in freedoms]
    units = [x.entry(RIGHT_SIDE, j) for j in freedoms]
    _add(x, MY_COLUMNS, [inner(list(of), units) for of in zip(*forces, strict=True)])


def composite_in(x: Scope, kind: LinkKind) -> None:
    """Entries of the mass matrix. The force for a unit acceleration is propagated inward; its components along degrees of
    freedom are the entries."""
    joint = kind.joint(x, kind, lanes=True)
    P = x.load(MY_COLUMNS, fields.column_force)
    for j, s in enumerate(joint.columns):
        own = rotor(x, kind, j)
        x.set_entry(DFORCE, j, s.along(P) if is_zero(own) else s.along(P) + own * x.entry(RIGHT_SIDE, j))
    if kind.has_parent:
        _add(x, UP_COLUMNS, force_to_parent(x, joint, P, "Eq. 45"))


def _add(x: Scope, store: Store, value: Vector) -> None:
    """Add a wrench to the force of each column. A component that has not been stored yet counts as zero."""
    for part, e in zip(fields.column_force.scalars(), value, strict=True):
        if not is_zero(e):
            x.store(store, part, x.let("P", x.load(store, part) + e, "d Eq. 45", lanes=True))


def _carried(x: Scope, joint: LinkJoint) -> Vector:
    """``X dA_pr``: the change of the parent's accelerations, along the link's axes."""
    return carry(joint, x.load(UP_COLUMNS, fields.column_acceleration), "d Eq. 54", "d")


def _substitute(x: Scope, kind: LinkKind, joint: LinkJoint, A: Vector, drive: Vector) -> Vector:
    """Accelerations of the degrees of freedom, in reverse order of elimination. Eq. 53."""
    a = list(A)
    found: Vector = []
    for j, s in enumerate(joint.columns):
        geared = not is_zero(rotor(x, kind, j))
        found.append(substitute(x, OF_FREEDOMS, drive[j], j, s, a, "udot", True, geared, "d "))
        x.set_entry(DUDOT, j, found[j])
    return found


def _moved(x: Scope, joint: LinkJoint, A: Vector, found: Vector) -> Vector:
    """Accelerations of the link: A, the parent's, plus the contribution `found` of the joint's degrees of freedom."""
    a = list(A)
    for s, value in zip(joint.columns, found, strict=True):
        for i, moved in s.added(a, value).items():
            a[i] = x.let("A", moved, "d Eq. 54", lanes=True)
    return a
