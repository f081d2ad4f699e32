"""Closure of loops in accelerations: residuals of the conditions for given accelerations of the faces. Eq. 31."""

from __future__ import annotations

from collections.abc import Sequence

from ...program.block import Scope
from ...program.scalar import Vector
from ..spatial import ZERO, add, cross, dot, matvec, minus, scale
from ..tree.kinematics import acceleration_matrix
from .closures import named_root_velocities
from .conditions import Condition, components_along
from .geometry import EarGeometry
from .motions import FaceMotion, Twist


def closing_accelerations(
    x: Scope,
    ear: EarGeometry,
    rows: list[Condition],
    face: FaceMotion,
    joints: Sequence[Vector],
    name: str,
    root_speeds: list[Twist] | None = None,
) -> Vector:
    """Residuals of the conditions in acceleration, from accelerations of faces and joints. They include the terms due to
    the rotation of the conditions' directions. Eq. 31."""
    slips = (
        slip_velocities(x, ear, named_root_velocities(ear) if root_speeds is None else root_speeds)
        if ear.slides
        else []
    )
    at_cuts, relative = cut_accelerations(x, ear, face, joints, slips)
    result: Vector = []
    for row, value in zip(rows, components_along(ear, rows, at_cuts, name, "Eq. 31"), strict=True):
        if row.surface is not None:
            bent = row.surface.curvature(slips[row.loop].linear)
            result.append(x.let(name, value + row.share * bent, "Eq. 31"))
            continue
        w = relative[row.loop]
        for weight, c, d in row.turning:  # c rotates with the end face: ((w x c) x d) . w
            turned = [x.let("nd", v, "Eq. 31") for v in cross([x.let("nc", v, "Eq. 31") for v in cross(w, c)], d)]
            value = value + weight * x.let("nrate", dot(turned, w), "Eq. 31")
        result.append(x.let(name, value, "Eq. 31") if row.turning else value)
    return result


def cut_accelerations(
    x: Scope, ear: EarGeometry, face: FaceMotion, joints: Sequence[Vector], slips: list[Twist]
) -> tuple[list[Twist], list[Vector]]:
    """Relative accelerations and angular velocities of the faces at every cut. Eq. 31.

    Directions of conditions rotate with the start face, so ``w_a x w_rel`` is subtracted from the angular part. If the
    joint slides, ``2 w_a x v_rel`` is subtracted from the linear part.
    """
    found = []
    turning: list[Vector] = []
    for c, closure in enumerate(ear.kind.closures):
        if closure.is_coupling:
            found.append(ear.coupled(c, joints, "ca", "Eq. 31"))
            turning.append(list(ZERO))
            continue
        if closure.roots == (-1, -1) and not any(closure.paths):
            found.append(Twist.zero())
            turning.append(list(ZERO))
            continue
        sides = []
        for side in (0, 1):
            w, al, a = face(c, side)
            slip = ear.slip(c) if side == 0 else None
            if slip is not None:
                a = add(a, matvec(acceleration_matrix(x, w, al), slip))
            sides.append((w, al, a))
        (w_a, al_a, a_a), (w_b, al_b, a_b) = sides
        relative = [x.let("wrel", e, "Eq. 31") for e in minus(w_b, w_a)]
        angular = minus(al_b, al_a)
        if closure.holds.angular:
            angular = minus(angular, cross(w_a, relative))
        if closure.holds.angular == 1 and not closure.gaps:
            angular = universal_bias(x, ear, c, angular, w_a, w_b, relative)
        linear = minus(a_b, a_a)
        if closure.slides:
            linear = minus(linear, scale(2, cross(w_a, slips[c].linear)))
        found.append(Twist([x.let("ca", e, "Eq. 31") for e in angular], [x.let("cl", e, "Eq. 31") for e in linear]))
        turning.append(relative)
    return found, turning


def slip_velocities(x: Scope, ear: EarGeometry, roots: list[Twist]) -> list[Twist]:
    """Relative velocities of the faces at the cuts; zero for loop joints that do not slide."""
    velocities = ear.walk(roots, [m.speeds for m in ear.members], "s", "Eq. 30")
    return ear.face_difference(velocities, roots, [m.speeds for m in ear.members])


def universal_bias(
    x: Scope, ear: EarGeometry, c: int, angular: Vector, w_a: Vector, w_b: Vector, relative: Vector
) -> Vector:
    """For a universal joint with axes a and b: ``d/dt (n . w_rel)``, n = a x b, as an angular vector along n.

    `angular` contains ``- w_a x w_rel``, which is right for directions fixed in the start face, but n rotates with both
    faces.
    """
    a, b = ear.universal_axes(c)
    # d n/dt = (w_a x a) x b + a x (w_b x b) = w_a x n + a x (w_rel x b)
    turning = cross(a, cross(relative, b))
    rate = x.let("nrate", dot([x.let("nd", e, "Eq. 31") for e in turning], relative), "Eq. 31")
    n = [x.let("n", e, "Eq. 33") for e in cross(a, b)]
    return [angular[i] + rate * n[i] for i in range(3)]
