"""Derivative of the articulated force with respect to a link's angular velocity, and transmitted forces: an inward sweep.

The articulated force of a link and everything outboard of it (Eq. 45) depends on the link's rotation: with the accelerations
A and the angular velocity w of the link, the joint transmits ``phi = I A + p(w)``. The derivative W with respect to w,
a 6x3 matrix, is propagated like the articulated inertia. With ``dA = X dA_pr + C dw_pr`` for a link that moves with its
parent,

    W_pr += S (T (W + I C)) R^T,    d udot = -G . (X dA_pr) - t . dw_pr,    t = P^T (W + I C) / D:

T removes the part to which the joint yields (section 3 of the theory page). So for any change at a link, the response of all
links outboard follows from two vectors, dA and dw, and needs no sweep inward (`columns`).
"""

from __future__ import annotations

from ...program.block import Scope
from ...program.scalar import Matrix, Value, Vector
from .. import fields
from ..elimination import OF_FREEDOMS
from ..joints import LinkJoint
from ..propagation import accumulate, accumulate_force
from ..rotors import rotor, transmitted_along
from ..spatial import SIX, cross, inner, is_zero, matvec, skew, transpose
from ..stores import ME, UP
from ..structure.kinds import LinkKind
from .kinematics import own_inertia
from .triangularization import articulated_inertia, force_to_parent, is_first


def centrifugal_change(x: Scope, w: Vector, r: Vector) -> Matrix:
    """The derivative of ``w x (w x r)`` with respect to w: ``(w . r) 1 + w r^T - 2 r w^T``."""
    tag = "d Eq. 21"
    along = [x.let("wr", w[i] * r[i], tag) for i in range(3)]
    E = [[w[i] * r[k] - 2 * r[i] * w[k] for k in range(3)] for i in range(3)]
    for i in range(3):
        E[i][i] = along[(i + 1) % 3] + along[(i + 2) % 3]
    return [[x.let("E", e, tag) for e in row] for row in E]


def carried_change(x: Scope, joint: LinkJoint, carried: Vector) -> Matrix:
    """The 6x3 matrix C: change of the link's accelerations with the parent's angular velocity along the link's axes."""
    r = joint.to_child(joint.offset(), "rc", "d Eq. 21")
    E = centrifugal_change(x, carried, r)
    units = [[int(i == k) for i in range(3)] for k in range(3)]
    biases = [joint.bias_change(list(unit)) for unit in units]
    angular = [[biases[k][0][i] for k in range(3)] for i in range(3)]
    linear = [[x.let("C", E[i][k] + biases[k][1][i], "d Eq. 21") for k in range(3)] for i in range(3)]
    return angular + linear


def own_change(x: Scope, w: Vector) -> Matrix:
    """Derivative (6x3) of the force that a link's own inertia requires with respect to its angular velocity."""
    _, h, J = own_inertia(x)
    tag = "d Eq. 24"
    Jw = [x.let("Jw", e, tag) for e in matvec(J, w)]
    across = transpose([cross(w, column) for column in transpose(J)])
    moment = [[a - b for a, b in zip(*rows, strict=True)] for rows in zip(across, skew(Jw), strict=True)]
    return moment + centrifugal_change(x, w, h)


def turning(x: Scope, kind: LinkKind) -> None:
    """The force that a joint transmits, and the change of the articulated force with the link's angular velocity."""
    joint = kind.joint(x, kind)
    _transmitted(x, kind, joint)
    w = x.load(ME, fields.angular_velocity)
    children = [*x.load(ME, fields.turning_moment), *x.load(ME, fields.turning_push)]
    own = own_change(x, w)
    W = [
        [x.let("W", a + b, "d Eq. 45") for a, b in zip(*rows, strict=True)] for rows in zip(own, children, strict=True)
    ]
    x.store(ME, fields.all_turning_moment, W[:3])
    x.store(ME, fields.all_turning_push, W[3:])
    if not kind.has_parent:
        return
    I = articulated_inertia(x)
    C = carried_change(x, joint, x.load(ME, fields.parents_velocity))
    columns = []
    for k in range(3):
        IC = [inner(I[i], [row[k] for row in C]) for i in SIX]
        columns.append([x.let("W", W[i][k] + IC[i], "d Eq. 45") for i in SIX])
    for j in reversed(range(joint.freedoms)):
        s = joint.columns[j]
        D = x.load(ME, OF_FREEDOMS.inverse(j))
        G = [1 if i == s.lead else x.load(ME, OF_FREEDOMS.gain(j, i)) for i in SIX]
        gains: dict[int, Value] = {}
        for k, P in enumerate(columns):
            r = x.let("r", -s.along(P), "d Eq. 53")
            gains[k] = x.let("t", r * D, "d Eq. 53")
            x.store(ME, fields.turning_gain(j, k), gains[k])
            for i in SIX:
                if i != s.lead:
                    P[i] = x.let("W", P[i] + G[i] * r, "d Eq. 45")
            a = rotor(x, kind, j)
            along = 0 if is_zero(a) else -a * gains[k]
            P[s.lead] = x.let("W", s.completed(P, along), "d Eq. 45")
    moved = [force_to_parent(x, joint, P, "d Eq. 45") for P in columns]
    rows = [joint.to_parent([P[i] for P in moved], "W", "d Eq. 45") for i in SIX]
    first = is_first(x, kind)
    accumulate(x, UP, fields.turning_moment, rows[:3], first, "d Eq. 45")
    accumulate(x, UP, fields.turning_push, rows[3:], first, "d Eq. 45")


def _transmitted(x: Scope, kind: LinkKind, joint: LinkJoint) -> None:
    """The force that a joint transmits with all accelerations known."""
    if not kind.has_parent:
        return  # forces on the ground are not computed
    own, children = x.load(ME, fields.total_needed), x.load(ME, fields.transmitted)
    phi = [x.let("phi", a + b, "Eq. 45") for a, b in zip(own, children, strict=True)]
    # in equilibrium a joint transmits its own force along its degrees of freedom, minus that of its rotor
    for j, s in enumerate(joint.columns):
        phi[s.lead] = s.completed(phi, transmitted_along(x, kind, j))
    x.store(ME, fields.joint_force, phi)
    force = force_to_parent(x, joint, phi, "Eq. 45")
    accumulate_force(x, UP, fields.transmitted, force, is_first(x, kind), "Eq. 45")
