"""Closure of an ear, outward: attitudes, closure matrix, motion per unit of the sources, dependent speeds. Eqs. 30-38.

The closure ``E x + b s = 0`` gives the dependent speeds ``x = Y s``, and every link moves with ``Z s``. Here s are the
sources of the region: independent speeds, or the six components of the motion of the base or of the relative motion of
a far link. Y and Z are the paper's Gamma and Xi, here directly in terms of the sources. Accelerations obey the same
maps, plus a remainder.
"""

from __future__ import annotations

from functools import partial

from ...program import algebra
from ...program.block import Scope
from ...program.scalar import Value, Vector
from ...program.store import Store
from .. import fields
from ..spatial import ZERO, add, cross, is_zero, matmul, matvec, transpose
from ..stores import BASE, EAR, ME, REGION, SPEEDS, UP
from ..structure.factor_form import FactorForm
from ..structure.kinds import EarKind, LinkKind
from ..structure.links import identity
from ..tree.kinematics import angular_velocity, origin_velocity
from .conditions import components_along, counted_conditions
from .geometry import EarGeometry
from .members import MemberView
from .motions import Twist
from .orthogonal import Factor, factor, load_factor


def own_sources(kind: EarKind) -> dict[int, tuple[int, int]]:
    """Sources that are degrees of freedom of the ear's own links: maps the source's number to link and degree of
    freedom."""
    return {c: (k, j) for k, columns in enumerate(kind.columns) for j, c in columns.items()}


def dependents(kind: EarKind) -> list[tuple[int, int]]:
    """Dependent degrees of freedom, each as link and index."""
    return [(k, j) for k in range(len(kind.links)) for j in kind.dependent[k]]


def _of_unit(own: tuple[int, int] | None, k: int, j: int) -> int:
    return int(own == (k, j))


def closures(x: Scope, kind: EarKind) -> FactorForm:
    """Outward block of an ear, described in the module; returns the factor's form for blocks that load the factor."""
    ear = EarGeometry(x, kind, fresh=True)
    tag = "Eq. 34"
    rows = counted_conditions(ear)
    dependents = ear.dependents()
    columns = [components_along(ear, rows, ear.column(k, f), "E", tag) for k, f in dependents]
    kept = [i for i in range(len(rows)) if any(not is_zero(c[i]) for c in columns)]
    length = float(
        algebra.ratio(kind.scale, kind.per_length)
    )  # size of linear conditions; 1 if they are divided by the characteristic length
    f = factor(x, [[c[i] for i in kept] for c in columns], "Eq. 35", length)
    checked = len(dependents)
    for row in rows:
        if row.surface is not None and row.surface.check_direction(checked):
            checked += 1
    form = f.store(kept, len(rows))
    kept_rows = [rows[i] for i in kept]
    rates: Vector = [0] * len(dependents)
    for c in range(kind.total):
        roots = [root.twist(c) for root in ear.roots]
        at_cuts = ear.root_difference(roots)
        own = own_sources(kind).get(c)
        if own is not None:
            k, j = own
            for n, moved in enumerate(ear.column(k, ear.members[k].freedoms[j])):
                at_cuts[n] = at_cuts[n].plus(moved)
        b = components_along(ear, kept_rows, at_cuts, "b", "Eq. 36")
        if own is None and all(root.vanishes for root in roots):
            # zeros are stored too: other links of this kind may be in ears in which the source moves them
            for d in range(len(dependents)):
                x.store(EAR, fields.dependent_rate(d, c), 0)
            for k in range(len(ear.members)):
                x.store(ME[k], fields.per_source(c).angular, ZERO)
                x.store(ME[k], fields.per_source(c).linear, ZERO)
            continue
        Y = f.solve([-v for v in b], "Y", "Eq. 37")
        speed = source_speed(x, kind, c, own)
        for d, y in enumerate(Y):
            x.store(EAR, fields.dependent_rate(d, c), y)
            rates[d] = rates[d] + y * speed
        coefficients = ear.coefficients(Y, partial(_of_unit, own))
        for k, twist in enumerate(ear.walk(roots, coefficients, "Z", "Eq. 37")):
            x.store(ME[k], fields.per_source(c).angular, twist.angular)
            x.store(ME[k], fields.per_source(c).linear, twist.linear)
        if own is not None:
            x.store(REGION, fields.source_speed(c), speed)
    rates = [x.let("u", rate, "Eq. 30") for rate in rates]
    for (k, freedom), rate in zip(dependents, rates, strict=True):
        x.set_entry(SPEEDS[k], freedom.index, rate)
    if any(link.closed_on for link in kind.links):
        member_motions(x, ear, rates)
    if kind.positions:
        for k in range(len(ear.members)):
            x.store(ME[k], fields.ear_position, ear.position(k))
    return form


def member_motions(x: Scope, ear: EarGeometry, rates: Vector) -> None:
    """Stores, for links of the ear on whose motion loops of other regions depend, what `link_motion` stores for links
    outside ears: attitude, position and velocity. Eqs. 18, 22."""
    kind = ear.kind
    for k, link in enumerate(kind.links):
        if link.closed_on == "origin":
            at_rest(x, ME[k])
    moving = [k for k, link in enumerate(kind.links) if link.closed_on == "moving"]
    if not moving:  # this ear does not need the base's motion relative to the origin
        return
    W_base, o_base = x.load(BASE, fields.closing_attitude), x.load(BASE, fields.closing_position)
    velocities = member_velocities(x, ear, rates)
    for k in moving:
        twist = velocities[k]
        W, o = ear.members[k].W, ear.position(k)
        x.store(ME[k], fields.closing_attitude, [[x.let("cW", e, "Eq. 22") for e in row] for row in matmul(W_base, W)])
        x.store(ME[k], fields.closing_position, [x.let("co", e, "Eq. 22") for e in add(o_base, matvec(W_base, o))])
        back = transpose(W)
        x.store(ME[k], fields.closing_twist.angular, [x.let("cw", e, "Eq. 18") for e in matvec(back, twist.angular)])
        x.store(ME[k], fields.closing_twist.linear, [x.let("cv", e, "Eq. 18") for e in matvec(back, twist.linear)])


def member_velocities(x: Scope, ear: EarGeometry, rates: Vector) -> list[Twist]:
    """Velocities of an ear's links relative to the origin, along the region's axes."""
    kind = ear.kind
    roots = root_velocities(ear)
    speeds = ear.coefficients(rates, lambda k, j: ear.members[k].joint.speed(j))
    found = ear.walk(roots, speeds, "m", "Eq. 18")
    if not (kind.carried and kind.rigid):
        return found
    w, v = x.load(BASE, fields.closing_twist.angular), x.load(BASE, fields.closing_twist.linear)
    carried = []
    for k, twist in enumerate(found):
        linear = add(twist.linear, v, cross(w, ear.position(k)))
        carried.append(
            Twist([x.let("mw", e, "Eq. 18") for e in add(twist.angular, w)], [x.let("mv", e, "Eq. 18") for e in linear])
        )
    return carried


def root_velocities(ear: EarGeometry) -> list[Twist]:
    """Velocities of the roots relative to a base that carries the region rigidly. Eq. 30."""
    found = []
    for root in ear.roots:
        total = Twist.zero()
        for c in range(ear.kind.total):
            twist = root.twist(c)
            if not twist.vanishes:
                total = total.plus(twist.times(source_speed(ear.x, ear.kind, c, own_sources(ear.kind).get(c))))
        found.append(total)
    return found


def named_root_velocities(ear: EarGeometry) -> list[Twist]:
    """Velocities of the roots. Each entry is a separate symbol, even if it copies another value, because other code sets
    its tangent."""
    found = []
    for twist in root_velocities(ear):
        named = [[0 if is_zero(e) else ear.x.name("V", e, "Eq. 30") for e in v] for v in (twist.angular, twist.linear)]
        found.append(Twist(*named))
    return found


def source_speed(x: Scope, kind: EarKind, c: int, own: tuple[int, int] | None) -> Value:
    """The speed that corresponds to a source."""
    if own is not None:
        k, j = own
        return kind.links[k].joint(MemberView(x, k), kind.links[k]).speed(j)
    if c < kind.sources:
        return x.load(REGION, fields.source_speed(c))
    far, i = divmod(c - kind.sources, 6)
    if kind.rigid:
        return x.load(REGION, fields.far_velocity(far).scalars()[i])
    field = fields.closing_twist.angular if i < 3 else fields.closing_twist.linear
    return x.load(BASE, field.scalars()[i % 3])


def stored_factor(x: Scope, kind: EarKind) -> Factor:
    """The factored closure matrix of the ear."""
    return load_factor(x, kind.form)


def at_rest(x: Scope, store: Store) -> None:
    """The motion of the origin: zero."""
    x.store(store, fields.closing_attitude, identity())
    for field in (fields.closing_position, fields.closing_twist.angular, fields.closing_twist.linear):
        x.store(store, field, ZERO)


def link_motion(x: Scope, kind: LinkKind) -> None:
    """Outward block of a link from which ears start: attitude, position and velocity relative to the origin. Eqs. 18, 22."""
    if kind.closed_on == "origin":
        at_rest(x, ME)
    if kind.closed_on != "moving":
        return
    joint = kind.joint(x, kind)
    W = x.load(UP, fields.closing_attitude)
    o = add(x.load(UP, fields.closing_position), matvec(W, joint.offset()))
    W = joint.attitude(W)
    _, w = angular_velocity(x, joint, fields.closing_twist.angular)
    v = origin_velocity(x, joint, fields.closing_twist.angular, fields.closing_twist.linear)
    x.store(ME, fields.closing_attitude, W)
    x.store(ME, fields.closing_position, [x.let("co", e, "Eq. 22") for e in o])
    x.store(ME, fields.closing_twist.angular, w)
    x.store(ME, fields.closing_twist.linear, v)
