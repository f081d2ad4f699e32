"""Forces on the freedoms of a joint: motors, dampers, friction."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal

from pydantic import WrapValidator

from ..entries import Expr, Reference, list_or_one
from ..entry_reader import EntryReader
from ..errors import count_of_values
from ..expressions import Expression
from .force_element import ForceElement, ForceEntry
from .joint_load import JointLoad, along_freedoms


@dataclass(frozen=True, slots=True, eq=False)
class JointForce(ForceElement):
    """Generalised forces on the freedoms of a joint; positive raises u. Expressions of p, inputs, t, q.x, u.x."""

    type: ClassVar[str] = "joint"

    body: int
    values: tuple[Expression, ...]

    @property
    def coefficients(self) -> tuple[Expression, ...]:
        return self.values


class JointForceEntry(ForceEntry):
    type: Literal["joint"]
    joint: Reference
    value: Annotated[tuple[Expr, ...], WrapValidator(list_or_one)]

    def read(self, x: EntryReader) -> JointForce | JointLoad | None:
        values = tuple(x.bound(e, "value", i, scope="measured") for i, e in enumerate(self.value))
        joint = x.joint(self.joint, "joint", self)
        if joint is None:
            return None
        if len(values) != len(joint.speeds):
            needed = f"{len(joint.speeds)} are needed, for {', '.join('u.' + n for n in joint.speeds)}"
            needed = needed if joint.speeds else f"a {joint.type} joint takes no force"
            message = f"{count_of_values(len(values))} for the {joint.type} joint {joint.name!r}; {needed}"
            x.report(("value",), message)
            return None
        points = x.measured(*values)
        if not points:
            return JointForce(x.name, joint.body, values)
        body, frame, motion, axes = x.placed(joint)
        return JointLoad(x.name, body, frame, along_freedoms(motion, axes, values), measured=points)
