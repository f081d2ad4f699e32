"""Forces along the degrees of freedom of a joint that depend on positions and velocities of points."""

from __future__ import annotations

from collections.abc import Sequence

from ..spatial import add, cross, is_zero, matvec, minus
from .element import Element, Law, Wrench


class JointLoadLaw(Law):
    """A force on the body through its origin, and a torque; the opposite wrench, about the same point, acts on the parent."""

    def wrenches(self, e: Element) -> Sequence[Wrench]:
        body, joint = e.ends[:2]
        torque, force = (
            e.vector(
                name, add(matvec(joint.axes, e.coefficients(name)), matvec(body.axes, e.coefficients(f"own_{name}")))
            )
            for name in ("torque", "force")
        )
        back = torque
        if not all(map(is_zero, force)):
            back = e.vector("back", add(torque, cross(minus(body.position, joint.position), force)))
        return Wrench(force, torque), Wrench([-c for c in force], [-c for c in back])
