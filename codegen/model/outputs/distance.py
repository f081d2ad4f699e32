"""Distance of two points."""

from __future__ import annotations

from typing import Any, ClassVar

from ..entry_reader import EntryReader
from .keys import TwoPoints
from .output import Measure, Output, Speaker


class Distance(Measure):
    """Of two points of different bodies, m. Where they coincide it has no derivative."""

    name = "distance"
    unit = "m"
    keys: ClassVar[dict[str, Any]] = {"distance": TwoPoints}

    @classmethod
    def read(cls, entry: Any, x: EntryReader) -> Output | None:
        first, second = (x.point(p, (cls.name, i), x.name) for i, p in enumerate(entry.distance))
        if first is None or second is None:
            return None
        if first.body == second.body:
            x.report(
                (cls.name,), "two points of one body, whose distance does not change; points of two bodies are needed"
            )
            return None
        return Output(x.name, cls.name, (first, second))

    @classmethod
    def words(cls, output: Output, say: Speaker) -> str:
        return f"distance of {' and '.join(map(say.point, output.points))}"
