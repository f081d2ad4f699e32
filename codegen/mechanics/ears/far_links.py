"""Far links of a region: their positions and motions relative to the region's base, along the base's axes.

If a region starts from several links, one of them is its base, which carries it rigidly. The motions of the others (the
far links) relative to the base are sources of the region (`structure.Region.far`). The ground can be a far link. Fields of
the region: ``far0.W`` attitude, ``far0.o`` origin, ``far0.w`` and ``far0.v`` relative velocity, ``far0.aw``,
``far0.al``, ``far0.a``, ``far0.B`` motion relative to the ground.
"""

from __future__ import annotations

from ...program.block import Scope
from ...program.store import Store
from .. import fields
from ..couplings import partner_store
from ..fields import MotionFields
from ..spatial import ZERO, add, cross, matmul, matvec, minus, rotate, transpose
from ..stores import BASE, GROUND, LBASE, LGROUND, LREGION, REGION
from ..structure.kinds import RegionKind
from ..tree.kinematics import acceleration_matrix

TWIST = (fields.closing_twist.angular, fields.closing_twist.linear)


def _store(kind: RegionKind, m: int, lanes: bool = False) -> Store:
    """The record (or slot) of a far link; m is the link's position among the partners, -1 for the ground."""
    return (LGROUND if lanes else GROUND) if m < 0 else partner_store(kind, m, lanes)


def far_poses(x: Scope, kind: RegionKind) -> None:
    """Outward block of a region, with the closures: attitude, origin and relative velocity of far links. Eqs. 18, 22."""
    for f, m in enumerate(kind.far):
        far = _store(kind, m)
        W_base = x.load(BASE, fields.closing_attitude)
        back = transpose(W_base)
        W = [x.let_vector("W", row, "Eq. 22") for row in matmul(back, x.load(far, fields.closing_attitude))]
        apart = x.let_vector(
            "apart", minus(x.load(far, fields.closing_position), x.load(BASE, fields.closing_position)), "Eq. 22"
        )
        o = x.let_vector("o", matvec(back, apart), "Eq. 22")
        w_base, v_base = x.load(BASE, fields.closing_twist.angular), x.load(BASE, fields.closing_twist.linear)
        w, v = (x.let_vector("turned", rotate(W, x.load(far, field)), "Eq. 18") for field in TWIST)
        x.store(REGION, fields.far_attitude(f), W)
        x.store(REGION, fields.far_position(f), o)
        x.store(REGION, fields.far_velocity(f).angular, x.let_vector("w", minus(w, w_base), "Eq. 30"))
        x.store(
            REGION, fields.far_velocity(f).linear, x.let_vector("v", minus(v, add(v_base, cross(w_base, o))), "Eq. 30")
        )


def far_displacements(x: Scope, kind: RegionKind) -> None:
    """Outward block over directions: rotation vector, displacement and tangent of the relative velocity of far links."""
    for f, m in enumerate(kind.far):
        W, o = x.load(REGION, fields.far_attitude(f)), x.load(REGION, fields.far_position(f))
        theta_base, d_base = x.load(LBASE, fields.closing_shift.angular), x.load(LBASE, fields.closing_shift.linear)
        w_base = x.load(BASE, fields.closing_twist.angular)
        dw_base, dv_base = x.load(LBASE, fields.closing_twist.angular), x.load(LBASE, fields.closing_twist.linear)
        theta, d, dw, dv = [list(ZERO) for _ in range(4)]
        if m >= 0:
            far = partner_store(kind, m, lanes=True)
            shift = fields.closing_shift
            turned = [rotate(W, x.load(far, field)) for field in (shift.angular, shift.linear, *TWIST)]
            theta, d, dw, dv = (x.let_vector("turned", v, "d Eq. 22", lanes=True) for v in turned)
        theta = x.let_vector("th", minus(theta, theta_base), "d Eq. 22", lanes=True)
        d = x.let_vector("d", minus(d, add(d_base, cross(theta_base, o))), "d Eq. 22", lanes=True)
        if m >= 0:
            # W v also rotates by theta
            w, v = (x.let_vector("own", rotate(W, x.load(partner_store(kind, m), f)), "Eq. 18") for f in TWIST)
            dw, dv = add(dw, cross(theta, w)), add(dv, cross(theta, v))
        carried = add(dv_base, cross(dw_base, o), cross(w_base, d))
        x.store(LREGION, fields.far_shift(f).angular, theta)
        x.store(LREGION, fields.far_shift(f).linear, d)
        x.store(LREGION, fields.far_velocity(f).angular, x.let_vector("dw", minus(dw, dw_base), "d Eq. 18", lanes=True))
        x.store(LREGION, fields.far_velocity(f).linear, x.let_vector("dv", minus(dv, carried), "d Eq. 18", lanes=True))


def far_motions(
    x: Scope, kind: RegionKind, own: MotionFields = fields.remainder, found: MotionFields = fields.far_remainder
) -> None:
    """Angular velocity and accelerations of far links relative to the ground, rotated from the links' axes into the
    region's."""
    for f, m in enumerate(kind.far):
        far, W = _store(kind, m), x.load(REGION, fields.far_attitude(f))
        w, al = [list(ZERO) for _ in range(2)]
        if m >= 0:
            w, al = (x.let_vector("turned", rotate(W, x.load(far, field)), "Eq. 21") for field in (own.w, own.al))
        a = x.let_vector("turned", rotate(W, x.load(far, own.a)), "Eq. 21")
        motion = found(f)
        for field, v in ((motion.w, w), (motion.al, al), (motion.a, a)):
            x.store(REGION, field, v)
        x.store(REGION, motion.B, acceleration_matrix(x, w, al))


def far_own_motions(x: Scope, kind: RegionKind) -> None:
    """Motion of far links relative to the ground along their own axes, with total accelerations, and the tangent of
    this motion.

    Fields ``far0.ow``, ``far0.oal``, ``far0.oa``, ``far0.oB``; the ground has its acceleration only.
    """
    for f, m in enumerate(kind.far):
        record, slot = _store(kind, m), _store(kind, m, lanes=True)
        own, found = fields.total, fields.far_own(f)
        x.store(REGION, found.a, x.load(record, own.a))
        x.store(LREGION, found.a, x.load(slot, fields.remainder.a))
        if m < 0:  # the ground does not rotate
            for store in (REGION, LREGION):
                x.store(store, found.w, list(ZERO))
                x.store(store, found.al, list(ZERO))
                x.store(store, found.B, [list(ZERO) for _ in range(3)])
            continue
        for field, whole, tangent in ((found.w, own.w, own.w), (found.al, own.al, fields.remainder.al)):
            x.store(REGION, field, x.load(record, whole))
            x.store(LREGION, field, x.load(slot, tangent))
        x.store(REGION, found.B, x.load(record, own.B))
        x.store(LREGION, found.B, x.load(slot, fields.remainder.B))
