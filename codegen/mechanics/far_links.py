"""Far links of a region: where they are and how they move against the region's base, in the base's axes.

A region that starts from several links hangs on one of them, its base, which carries it rigidly; the motion of the others
relative to that are sources of the region (`structure.Region.far`). The ground can be one of them. Fields of the region:
``far0.W`` attitude, ``far0.o`` origin, ``far0.w`` and ``far0.v`` relative velocity, ``far0.aw``, ``far0.al``, ``far0.a``,
``far0.B`` motion against the ground.
"""

from __future__ import annotations

from typing import Any

from .couplings import partner_array
from .ears import rotate
from .kinematics import acceleration_matrix, load_matrix, load_vector, store_matrix, store_vector
from .spatial import XYZ, Vec, add, cross, matmul, matvec, transpose

ZERO: Vec = [0, 0, 0]


def _let3(x: Any, name: str, v: Vec, tag: str, lanes: bool = False) -> Vec:
    return [x.let(f"{name}_{i}", v[k], tag, lanes=lanes) for k, i in enumerate(XYZ)]


def _minus(a: Vec, b: Vec) -> Vec:
    return [p - q for p, q in zip(a, b, strict=True)]


def _array(kind: Any, m: int, prefix: str = "") -> str:
    """The array of a far link; m is its place among the partners, -1 for the ground."""
    return f"{prefix}ground" if m < 0 else partner_array(kind, m, prefix)


def far_poses(x: Any, kind: Any) -> None:
    """Outward block of a region, with the closures: attitude, origin and relative velocity of far links. Eqs. 18, 22."""
    for f, m in enumerate(kind.far):
        array = _array(kind, m)
        W_base = load_matrix(x, "base", "cW")
        back = transpose(W_base)
        W = [_let3(x, "W", row, "Eq. 22") for row in matmul(back, load_matrix(x, array, "cW"))]
        apart = _let3(x, "apart", _minus(load_vector(x, array, "co"), load_vector(x, "base", "co")), "Eq. 22")
        o = _let3(x, "o", matvec(back, apart), "Eq. 22")
        w_base, v_base = load_vector(x, "base", "cw"), load_vector(x, "base", "cv")
        w, v = (_let3(x, "turned", rotate(W, load_vector(x, array, n)), "Eq. 18") for n in ("cw", "cv"))
        store_matrix(x, "region", f"far{f}.W", W)
        store_vector(x, "region", f"far{f}.o", o)
        store_vector(x, "region", f"far{f}.w", _let3(x, "w", _minus(w, w_base), "Eq. 30"))
        store_vector(x, "region", f"far{f}.v", _let3(x, "v", _minus(v, add(v_base, cross(w_base, o))), "Eq. 30"))


def far_displacements(x: Any, kind: Any) -> None:
    """Outward block over directions: rotation vector, displacement and tangent of the relative velocity of far links."""
    for f, m in enumerate(kind.far):
        W, o = load_matrix(x, "region", f"far{f}.W"), load_vector(x, "region", f"far{f}.o")
        theta_base, d_base = load_vector(x, "lbase", "ct"), load_vector(x, "lbase", "cd")
        w_base = load_vector(x, "base", "cw")
        dw_base, dv_base = load_vector(x, "lbase", "cw"), load_vector(x, "lbase", "cv")
        theta, d, dw, dv = [list(ZERO) for _ in range(4)]
        if m >= 0:
            array = partner_array(kind, m, "l")
            turned = [rotate(W, load_vector(x, array, n)) for n in ("ct", "cd", "cw", "cv")]
            theta, d, dw, dv = (_let3(x, "turned", v, "d Eq. 22", True) for v in turned)
        theta = _let3(x, "th", _minus(theta, theta_base), "d Eq. 22", True)
        d = _let3(x, "d", _minus(d, add(d_base, cross(theta_base, o))), "d Eq. 22", True)
        if m >= 0:
            # W v turns with theta besides
            w, v = (
                _let3(x, "own", rotate(W, load_vector(x, partner_array(kind, m), n)), "Eq. 18") for n in ("cw", "cv")
            )
            dw, dv = add(dw, cross(theta, w)), add(dv, cross(theta, v))
        carried = add(dv_base, cross(dw_base, o), cross(w_base, d))
        store_vector(x, "lregion", f"far{f}.th", theta)
        store_vector(x, "lregion", f"far{f}.d", d)
        store_vector(x, "lregion", f"far{f}.w", _let3(x, "dw", _minus(dw, dw_base), "d Eq. 18", True))
        store_vector(x, "lregion", f"far{f}.v", _let3(x, "dv", _minus(dv, carried), "d Eq. 18", True))


def far_motions(x: Any, kind: Any, prefix: str = "") -> None:
    """Angular velocity and accelerations of far links against the ground. `prefix` ``t``: all of the accelerations."""
    for f, m in enumerate(kind.far):
        array, W = _array(kind, m), load_matrix(x, "region", f"far{f}.W")
        w, al = [list(ZERO) for _ in range(2)]
        if m >= 0:
            w, al = (_let3(x, "turned", rotate(W, load_vector(x, array, n)), "Eq. 21") for n in ("w", f"{prefix}al"))
        a = _let3(x, "turned", rotate(W, load_vector(x, array, f"{prefix}a")), "Eq. 21")
        store_vector(x, "region", f"far{f}.aw", w)
        store_vector(x, "region", f"far{f}.{prefix}al", al)
        store_vector(x, "region", f"far{f}.{prefix}a", a)
        store_matrix(x, "region", f"far{f}.{prefix}B", acceleration_matrix(x, w, al))


def far_own_motions(x: Any, kind: Any) -> None:
    """Motion of far links against the ground in their own axes, with all of the accelerations, and its tangents.

    Fields ``far0.ow``, ``far0.oal``, ``far0.oa``, ``far0.oB``; the ground has its acceleration only.
    """
    for f, m in enumerate(kind.far):
        array, moved = _array(kind, m), _array(kind, m, "l")
        store_vector(x, "region", f"far{f}.oa", load_vector(x, array, "ta"))
        store_vector(x, "lregion", f"far{f}.oa", load_vector(x, moved, "a"))
        if m < 0:
            continue
        for name, own, tangent in (("ow", "w", "w"), ("oal", "tal", "al")):
            store_vector(x, "region", f"far{f}.{name}", load_vector(x, array, own))
            store_vector(x, "lregion", f"far{f}.{name}", load_vector(x, moved, tangent))
        store_matrix(x, "region", f"far{f}.oB", load_matrix(x, array, "tB"))
        store_matrix(x, "lregion", f"far{f}.oB", load_matrix(x, moved, "B"))


__all__ = ["far_displacements", "far_motions", "far_own_motions", "far_poses"]
