"""Linear and angular momentum of the system, along an axis."""

from __future__ import annotations

from typing import Any, ClassVar, Final

from ..entry_reader import EntryReader
from .center_of_mass import MASSLESS
from .keys import OptionalAxis, word
from .output import Measure, Output, Speaker

KINDS: Final = ("linear", "angular")
CENTERS: Final = ("ground", "center_of_mass")


class Momentum(Measure):
    """Of all bodies, along an axis of the ground frame: kg m/s, or kg m^2/s about the ground's origin or the centre of mass."""

    name = "momentum"
    keys: ClassVar[dict[str, Any]] = {"momentum": word(*KINDS), "axis": OptionalAxis, "about": word(*CENTERS)}
    hints: ClassVar[dict[str, str]] = {"axis": "x, y, z or a vector in the ground frame"}

    @classmethod
    def unit_of(cls, output: Output) -> str:
        return "kg m/s" if output.choice[0] == "linear" else "kg m^2/s"

    @classmethod
    def read(cls, entry: Any, x: EntryReader) -> Output | None:
        axis = x.direction(entry.axis, "axis")
        if entry.momentum == "linear" and entry.about is not None:
            x.report(
                ("about",),
                "about beside linear momentum, which is about no point; leave it out, or take momentum: angular",
            )
            return None
        about = CENTERS[0] if entry.about is None else entry.about
        if about == "center_of_mass" and x.mass() == 0:
            x.report(("about",), MASSLESS)
            return None
        return Output(x.name, cls.name, axis=axis, choice=(entry.momentum, about))

    @classmethod
    def words(cls, output: Output, say: Speaker) -> str:
        kind, about = output.choice
        center = {"ground": "the ground's origin", "center_of_mass": "the centre of mass"}[about]
        assert output.axis is not None
        found = f"{kind} momentum along {say.axis(output.axis)}"
        return found if kind == "linear" else f"{found} about {center}"
