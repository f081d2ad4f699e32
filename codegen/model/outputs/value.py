"""An expression of the motion."""

from __future__ import annotations

from typing import Any, ClassVar

from ..entries import OptionalExpr
from ..entry_reader import EntryReader
from .output import Measure, Output, Speaker


class Value(Measure):
    """Of p, inputs, t, q.x and u.x."""

    name = "value"
    keys: ClassVar[dict[str, Any]] = {"value": OptionalExpr}

    @classmethod
    def read(cls, entry: Any, x: EntryReader) -> Output:
        return Output(x.name, cls.name, expression=x.bound(entry.value, "value", scope="motion"))

    @classmethod
    def words(cls, output: Output, say: Speaker) -> str:
        assert output.expression is not None
        return say.long(output.expression)
