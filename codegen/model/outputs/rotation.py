"""Rotation of a body, an entry at a time."""

from __future__ import annotations

from typing import Any, ClassVar, Final

from ..entry_reader import EntryReader
from ..places import GROUND
from .keys import OptionalBody, word
from .output import Measure, Output, Speaker

QUATERNION: Final = ("qw", "qx", "qy", "qz")
MATRIX: Final = tuple(a + b for a in "xyz" for b in "xyz")


class Rotation(Measure):
    """Of a body against the ground or another body: an entry of its quaternion, or of its matrix by row and column."""

    name = "rotation"
    keys: ClassVar[dict[str, Any]] = {
        "rotation": OptionalBody,
        "entry": word(*QUATERNION, *MATRIX),
        "relative_to": OptionalBody,
    }
    hints: ClassVar[dict[str, str]] = {"entry": "qw, qx, qy, qz of the quaternion, or xx, xy, ... zz of the matrix"}

    @classmethod
    def read(cls, entry: Any, x: EntryReader) -> Output | None:
        body = x.body(entry.rotation, "rotation")
        other = GROUND if entry.relative_to is None else x.body(entry.relative_to, "relative_to")
        if body is None or other is None:
            return None
        if body == other:
            at = ("rotation",) if entry.relative_to is None else ("relative_to",)
            x.report(at, "rotation of a body relative to itself, which is none; two different ones are needed")
            return None
        return Output(x.name, cls.name, bodies=(body, other), choice=(entry.entry,))

    @classmethod
    def words(cls, output: Output, say: Speaker) -> str:
        body, other = map(say.name, output.bodies)
        return f"rotation of {body} relative to {other}, {output.choice[0]}"
