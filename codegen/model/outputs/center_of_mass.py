"""Centre of mass of the system or of some bodies, along an axis."""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated, Any, ClassVar

from pydantic import WrapValidator

from ..entries import Reference, complaint, seen
from ..entry_reader import EntryReader
from ..places import GROUND
from .keys import OptionalAxis
from .output import Measure, Output, Speaker

SYSTEM = "system"
MASSLESS = "nothing has mass at the default parameters, so there is no centre of mass; give a body some"


def _bodies(value: Any, handler: Callable[[Any], Any]) -> Any:
    if value == SYSTEM:
        return SYSTEM
    if not isinstance(value, (list, tuple)) or not value:
        raise complaint(f"{seen(value)}; system or a list of bodies, such as [hull, arm], is allowed")
    return handler(value)


SystemOrBodies = Annotated[tuple[Reference, ...] | None, WrapValidator(_bodies)]


class CenterOfMass(Measure):
    """In the ground frame, along an axis, m. The system is all bodies, those that are fixed to the ground too."""

    name = "center_of_mass"
    unit = "m"
    keys: ClassVar[dict[str, Any]] = {"center_of_mass": SystemOrBodies, "axis": OptionalAxis}
    hints: ClassVar[dict[str, str]] = {"axis": "x, y, z or a vector in the ground frame"}

    @classmethod
    def read(cls, entry: Any, x: EntryReader) -> Output | None:
        axis = x.direction(entry.axis, "axis")
        if entry.center_of_mass == SYSTEM:
            if x.mass() == 0:
                x.report((cls.name,), MASSLESS)
                return None
            return Output(x.name, cls.name, axis=axis)
        bodies: list[int] = []
        for i, reference in enumerate(entry.center_of_mass):
            body = x.body(reference, cls.name, i)
            if body is None:
                return None
            if body == GROUND or body in bodies:
                what = "the ground, which has no mass" if body == GROUND else "a body that is in the list already"
                x.report((cls.name, i), f"{what}; every body of the list counts once")
                return None
            bodies.append(body)
        if x.mass(bodies) == 0:
            x.report(
                (cls.name,), "bodies without mass at the default parameters have no centre of mass; add one with mass"
            )
            return None
        return Output(x.name, cls.name, axis=axis, bodies=tuple(bodies))

    @classmethod
    def words(cls, output: Output, say: Speaker) -> str:
        of = ", ".join(map(say.name, output.bodies)) or "the system"
        assert output.axis is not None
        return f"centre of mass of {of} along {say.axis(output.axis)}"
