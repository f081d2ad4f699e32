"""The force that prescribed motion takes."""

from __future__ import annotations

from typing import Annotated, Any, ClassVar

from pydantic import PlainValidator

from ..entries import parse_name
from ..entry_reader import EntryReader
from ..expressions import Expression
from .output import Measure, Output, Speaker


def _coordinate(value: Any) -> Expression:
    return Expression(parse_name(value, prefix="q."))


class DrivingForce(Measure):
    """Of a prescribed coordinate: the generalised force, N m or N, that acts on it beside the model's own forces."""

    name = "driving_force"
    keys: ClassVar[dict[str, Any]] = {"driving_force": Annotated[Expression | None, PlainValidator(_coordinate)]}

    @classmethod
    def unit_of(cls, output: Output) -> str:
        return output.choice[1]

    @classmethod
    def read(cls, entry: Any, x: EntryReader) -> Output | None:
        found = x.prescribed(entry.driving_force, cls.name)
        return None if found is None else Output(x.name, cls.name, choice=found)

    @classmethod
    def words(cls, output: Output, say: Speaker) -> str:
        return f"driving force of {output.choice[0]}"
