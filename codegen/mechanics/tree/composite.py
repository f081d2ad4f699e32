"""Composite inertias, inward: the inertia of a link and everything outboard with all joints locked (Featherstone 2008,
section 6.2)."""

from __future__ import annotations

from ...program.block import Scope
from ...program.scalar import Matrix, Vector
from .. import fields
from ..propagation import accumulate
from ..spatial import add, cross, matvec, minus
from ..stores import ME, UP
from ..structure.kinds import LinkKind
from .kinematics import own_inertia
from .triangularization import is_first


def composite(x: Scope, kind: LinkKind) -> None:
    """Mass, first moment and inertia for the parent, and the force of a unit acceleration of each degree of freedom. Eq. 23."""
    tag = "Eq. 23"
    joint = kind.joint(x, kind)
    m, h, J = own_inertia(x)
    m = x.let("m", m + x.load(ME, fields.composite_mass), tag)
    h = x.let_vector("h", add(h, x.load(ME, fields.composite_moment)), tag)
    J = _sum(x, J, x.load(ME, fields.composite_inertia))
    for j, s in enumerate(joint.columns):
        n = add(matvec(J, s.angular), cross(h, s.linear))
        f = minus([m * e for e in s.linear], cross(h, s.angular))
        x.store(ME, fields.composite_force(j), [x.let("F", e, tag) for e in (*n, *f)])
    if not kind.has_parent:
        return
    r = joint.offset()
    h = joint.to_parent(h, "h", tag)
    none: Matrix = [[0] * 3 for _ in range(3)]
    J, _, _ = joint.inertia_to_parent(J, none, none, tag)
    first = is_first(x, kind)
    moved = [x.let("hm", h[i] + m * r[i], tag) for i in range(3)]
    accumulate(x, UP, fields.composite_mass, m, first, tag)
    accumulate(x, UP, fields.composite_moment, moved, first, tag)
    accumulate(x, UP, fields.composite_inertia, shifted(x, J, h, moved, r), first, tag)


def shifted(x: Scope, J: Matrix, h: Vector, moved: Vector, r: Vector) -> Matrix:
    """An inertia about a point at -r, from the first moments h, h' about both points: ``(r . (h + h')) 1 - r h^T - h' r^T``."""
    both = [x.let("rh", r[i] * (h[i] + moved[i]), "Eq. 23") for i in range(3)]
    found = [list(row) for row in J]
    for i in range(3):
        found[i][i] = J[i][i] + both[(i + 1) % 3] + both[(i + 2) % 3]
        for k in range(i + 1, 3):
            found[i][k] = found[k][i] = J[i][k] - r[i] * h[k] - moved[i] * r[k]
    return found


def _sum(x: Scope, a: Matrix, b: Matrix) -> Matrix:
    found: Matrix = [[0] * 3 for _ in range(3)]
    for i in range(3):
        for k in range(i, 3):
            found[i][k] = found[k][i] = x.let("J", a[i][k] + b[i][k], "Eq. 23")
    return found
