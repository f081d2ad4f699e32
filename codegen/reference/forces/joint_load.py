"""Forces on the freedoms of a joint that depend on what points do."""

from __future__ import annotations

from collections.abc import Sequence

from ...model.forces import JointLoad
from ..pairs import Pairs
from .law import End, Law, Wrench


class JointLoadLaw(Law[JointLoad]):
    """A force through the origin of the body and a torque; the opposite wrench, about the same place, on the parent."""

    def wrenches(self, element: JointLoad, pairs: Pairs, ends: Sequence[End]) -> Sequence[Wrench]:
        body, joint = ends
        torque, force, own_torque, own_force = (pairs.vector(element.values[i : i + 3]) for i in range(0, 12, 3))
        torque = joint.R @ torque + body.R @ own_torque
        force = joint.R @ force + body.R @ own_force
        back = torque + pairs.skew(body.x - joint.x) @ force
        return Wrench(force, torque), Wrench(-force, -back)
