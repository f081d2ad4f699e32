"""Residuals of loops in position and velocity, and Newton's step of the dependent coordinates, which closes the loops.

The directions of conditions are fixed in the start face of a loop joint; displacements are those of the end face's origin,
divided by the characteristic length. The residual of a rotation by the angle t is 2 sin(t/2), which grows up to half a turn;
sin(t) would vanish there.
"""

from __future__ import annotations

from ...program import algebra
from ...program.algebra import Number
from ...program.block import Scope
from ...program.limits import limits
from ...program.scalar import Value, Vector
from ...program.store import Store
from .. import fields
from ..couplings import partner_store
from ..spatial import ZERO, add, cross, dot, is_zero, minus, rotate, transpose
from ..stores import BASE, CONDITION, GIVEN_U, ME, POSITION, REGION, STEP, UP, VELOCITY
from ..structure.kinds import EarKind, LinkKind, RegionKind
from .closures import dependents, stored_factor
from .completion import dependent_displacements
from .conditions import components_along, joint_conditions, kept_conditions
from .couplings import coupling_residual
from .geometry import EarGeometry
from .members import MemberView
from .motions import Twist
from .orthogonal import Factor

HALF_TURN = 1e-14
"""A rotation counts as half a turn if the squared cosine of half its angle is smaller."""


def _over_root(x: Scope, value: Value) -> tuple[Value, Value]:
    """``1 / sqrt(value)`` for the square of a cosine, and a flag that is 1 if the square is zero to rounding (half a
    turn)."""
    square = x.let("square", value, "Eq. 32")
    half = x.let("half", x.call("at_least", x.number(limits().rounding(HALF_TURN)), square), "Eq. 32")
    under = x.let("under", square + half, "Eq. 32")
    return x.let("share", 1 / x.let("root", x.sqrt(under), "Eq. 32"), "Eq. 32"), half


def face_differences(x: Scope, ear: EarGeometry) -> tuple[list[Twist], Vector]:
    """The residual of every loop: the displacement from start to end face, and a vector that equals the rotation vector to
    first order near closure.

    Also returns a flag for every loop, which is 1 at half a turn. The vector then has length 2 and an arbitrary direction.
    """
    found: list[Twist] = []
    halves: Vector = [0] * len(ear.kind.closures)
    for c, closure in enumerate(ear.kind.closures):
        if closure.is_coupling:
            found.append(coupling_residual(ear, c))
            continue
        a, b = (ear.position_of_face(c, side) for side in (0, 1))
        linear = [x.let("gap", e, "Eq. 32") for e in minus(b, a)]
        angular: Vector = [0, 0, 0]
        if closure.holds.angular == 1:
            first, second = ear.universal_axes(c)
            off = x.let("off", dot(first, second), "Eq. 32")
            angular = [-off * e for e in cross(first, second)]
        elif closure.holds.angular == 3:
            start, end = ear.face_axes(c, 0), ear.face_axes(c, 1)
            turned = [cross(p, q) for p, q in zip(start, end, strict=True)]
            root, halves[c] = _over_root(x, 1 + sum(dot(p, q) for p, q in zip(start, end, strict=True)))
            angular = [root * sum(t[i] for t in turned) for i in range(3)]
        elif closure.holds.angular == 2:
            p, q = ear.face_axes(c, 0)[closure.axis], ear.face_axes(c, 1)[closure.end_axis]
            root, halves[c] = _over_root(x, x.half + x.half * dot(p, q))
            angular = [root * e for e in cross(p, q)]
        found.append(Twist([x.let("turned", e, "Eq. 32") for e in angular], linear))
    return found, halves


def residuals(x: Scope, kind: EarKind) -> None:
    """Outward block of an ear: position residuals of its loops, and velocity residuals at the given speeds."""
    ear = EarGeometry(x, kind, positions=fields.measured_position)
    gaps, halves = face_differences(x, ear)
    roots = [root.measured_velocity() for root in ear.roots]
    speeds = [m.speeds if m.joint.driven else [m.view.entry(GIVEN_U, f.index) for f in m.freedoms] for m in ear.members]
    velocities = ear.walk(roots, speeds, "g", "Eq. 30")
    rates = ear.face_difference(velocities, roots, speeds)
    for c in range(len(kind.closures)):
        for i, row in enumerate(joint_conditions(ear, c)):
            if row.surface is not None:
                x.set_entry(POSITION[c], i, row.gap)
                x.set_entry(VELOCITY[c], i, x.let("rate", dot(row.n, rates[c].linear), "Eq. 30"))
                continue
            gap, rate = (t[c].angular if row.angular else t[c].linear for t in (gaps, rates))
            value = dot(row.axis or row.n, gap)
            if row.angular and halves[c] != 0:
                value, halves[c] = value + 2 * halves[c], 0
            x.set_entry(POSITION[c], i, x.let("gap", value, "Eq. 32"))
            x.set_entry(VELOCITY[c], i, x.let("rate", dot(row.n, rate), "Eq. 30"))
    for k, velocity in enumerate(velocities):
        x.store(ME[k], fields.measured_velocity, [*velocity.angular, *velocity.linear])
        x.store(ME[k], fields.measured_position, ear.position(k))


def newton_step(x: Scope, kind: EarKind) -> None:
    """Outward block of an ear: the displacements of its dependent joints that close its loops to first order."""
    ear = EarGeometry(x, kind, positions=fields.measured_position)
    gaps, _ = face_differences(x, ear)
    roots = [root.step() for root in ear.roots]
    rows = kept_conditions(ear)
    moved = ear.root_difference(roots)
    total = [gap.plus(by) for gap, by in zip(gaps, moved, strict=True)]
    rates: Vector = []
    if rows:
        b = components_along(ear, rows, total, "b", "Eq. 32")
        for i, row in enumerate(rows):
            if row.surface is not None:
                b[i] = x.let("b", row.gap + dot(row.n, moved[row.loop].linear), "Eq. 32")
            if row.turning:  # the condition's own residual, even if other conditions are open
                sine = sum(weight * dot(one, other) for weight, one, other in row.turning)
                b[i] = x.let("b", sine + dot(row.n, moved[row.loop].angular), "Eq. 32")
        rates = stored_factor(x, kind).solve([-v for v in b], "dx", "Eq. 35")
        for (place, i), value in dependent_displacements(x, ear, rates, lanes=False).items():
            x.set_entry(STEP[place], i, value)
    for k, twist in enumerate(ear.walk(roots, ear.coefficients(rates), "s", "Eq. 35")):
        x.store(ME[k], fields.ear_step, [*twist.angular, *twist.linear])
        x.store(ME[k], fields.measured_position, ear.position(k))
        closed_on = kind.links[k].closed_on
        if closed_on == "origin":
            _store_step(x, ME[k], ZERO, ZERO)
        if closed_on == "moving":
            theta, d = x.load(BASE, fields.step.angular), x.load(BASE, fields.step.linear)
            back = transpose(ear.attitude(k))
            d = add(twist.linear, d, cross(theta, ear.position(k)))
            _store_step(x, ME[k], rotate(back, add(twist.angular, theta)), rotate(back, d))


def _store_step(x: Scope, store: Store, theta: Vector, d: Vector) -> None:
    for field, v in ((fields.step.angular, theta), (fields.step.linear, d)):
        x.store(store, field, x.let_vector(field.name, v, "Eq. 35"))


def link_step(x: Scope, kind: LinkKind) -> None:
    """Outward block of a link from which ears start: rotation vector and displacement of Newton's step, relative to
    the origin, along the link's axes."""
    if kind.closed_on == "origin":
        _store_step(x, ME, ZERO, ZERO)
        return
    joint = kind.joint(x, kind)
    theta, d = x.load(UP, fields.step.angular), x.load(UP, fields.step.linear)
    d = add(d, cross(theta, joint.offset()))
    _store_step(x, ME, joint.to_child(theta, "nt", "Eq. 35"), joint.to_child(d, "nd", "Eq. 35"))


def far_steps(x: Scope, kind: RegionKind) -> None:
    """Outward block of a region: displacements of far links relative to its base, along the base's axes."""
    for f, m in enumerate(kind.far):
        W, o = x.load(REGION, fields.far_attitude(f)), x.load(REGION, fields.far_position(f))
        base, d_base = x.load(BASE, fields.step.angular), x.load(BASE, fields.step.linear)
        theta, d = list(ZERO), list(ZERO)
        if m >= 0:
            far = partner_store(kind, m)
            theta, d = (rotate(W, x.load(far, field)) for field in (fields.step.angular, fields.step.linear))
        carried = add(d_base, cross(base, o))
        step = fields.far_step(f)
        for name, field, v, by in (("nt", step.angular, theta, base), ("nd", step.linear, d, carried)):
            x.store(REGION, field, x.let_vector(name, minus(v, by), "Eq. 35"))


def conditions(x: Scope, kind: EarKind) -> None:
    """Block of an ear: the condition number of its closure matrix, section 4.7 of the theory page.

    With rows and columns scaled, the number is ``|R^-1| max(|R|, sqrt(n))/n`` in Frobenius norms for n columns, and
    ``|1/r|`` for a single column with diagonal entry r. It is 1 if this column belongs to couplings only, and 0 without
    columns.
    """
    f = stored_factor(x, kind)
    n = len(f.order)
    value: Value = 1
    if n == 1 and not all(c.is_coupling for c in kind.closures):
        value = x.let("condition", x.call("abs", _divided(x, f.inverse[0], _units(x, kind, f)[0])), "Eq. 35")
    elif n > 1:
        units = _units(x, kind, f)
        R: dict[tuple[int, int], Value] = {}
        for j in range(n):
            R[j, j] = x.let("r", 1 / f.inverse[j], "Eq. 35")
            R |= {(i, j): f.R[i, j] for i in range(j) if (i, j) in f.R}
        inverse = {(i, j): _divided(x, v, units[i]) for (i, j), v in _inverse(x, R, f.inverse).items()}
        R = {(i, j): v if units[j] == 1 else v * x.number(units[j]) for (i, j), v in R.items()}
        size, share = (x.let("size", sum(v * v for v in m.values()), "Eq. 35") for m in (R, inverse))
        value = x.let("condition", x.sqrt(x.call("max", size, x.number(n)) * share) / n, "Eq. 35")
    for c in range(len(kind.closures)):
        x.set_entry(CONDITION[c], 0, value if n else 0)


def _units(x: Scope, kind: EarKind, f: Factor) -> list[Number]:
    """The unit of each column, in the order of the factor's columns. In these units, displacements and rows are multiples
    of the characteristic length."""
    found = []
    for column in f.order:
        k, j = dependents(kind)[column]
        link = kind.links[k]
        turns = any(not is_zero(e) for e in link.joint(MemberView(x, k), link).all_columns[j].angular)
        found.append(algebra.ratio(kind.per_length if turns else algebra.ONE, kind.scale))
    return found


def _divided(x: Scope, value: Value, unit: Number) -> Value:
    return value if unit is algebra.ONE else value * x.number(algebra.ratio(algebra.ONE, unit))


def _inverse(x: Scope, R: dict[tuple[int, int], Value], diagonal: Vector) -> dict[tuple[int, int], Value]:
    """The entries of the inverse of an upper triangular matrix, from the reciprocals of its diagonal."""
    n = len(diagonal)
    found: dict[tuple[int, int], Value] = {}
    for j in range(n):
        found[j, j] = diagonal[j]
        for i in reversed(range(j)):
            rest = sum(R[i, k] * found[k, j] for k in range(i + 1, j + 1) if (i, k) in R and (k, j) in found)
            found[i, j] = x.let("inv", -rest * diagonal[i], "Eq. 35")
    return found
