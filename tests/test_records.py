"""`codegen.records.dataclass` makes the same classes as the standard decorator."""

import copy
import dataclasses
import pickle
from dataclasses import field, replace
from typing import Any

import pytest

from codegen import records

MAKERS = {"standard": dataclasses.dataclass, "records": records.dataclass}


def _made(maker: Any) -> tuple[Any, Any, Any]:
    @maker(frozen=True, slots=True)
    class Point:
        x: int
        y: int = 2
        note: str = field(default="", compare=False, repr=False)

    @maker(slots=True)
    class Draft:
        names: list[str] = field(default_factory=list)

        def __repr__(self) -> str:
            return "a draft"

    @maker
    class Nothing:
        pass

    return Point, Draft, Nothing


@pytest.mark.parametrize("maker", MAKERS.values(), ids=MAKERS)
def test_values_are_compared_hashed_shown_and_replaced(maker: Any) -> None:
    Point, Draft, Nothing = _made(maker)
    assert Point(1) == Point(1, 2, note="other") != Point(1, 3)
    assert Point(1) != Draft() and Point(1) != (1, 2)
    assert hash(Point(1)) == hash((1, 2)) == hash(Point(1, note="other"))
    assert repr(Point(1)).endswith("Point(x=1, y=2)")
    assert replace(Point(1), y=5) == Point(1, 5) == copy.copy(Point(1, 5))
    assert Draft() == Draft() != Draft(["a"]) and repr(Draft()) == "a draft"
    assert Draft.__hash__ is None
    assert Nothing() == Nothing() and repr(Nothing()).endswith("Nothing()")
    assert [f.name for f in dataclasses.fields(Point)] == ["x", "y", "note"]
    assert not hasattr(Point(1), "__dict__")
    match Point(3, 4):
        case Point(x, y):
            assert (x, y) == (3, 4)


def test_records_are_pickled() -> None:
    from codegen.program.operations import Operations

    assert pickle.loads(pickle.dumps(Operations(1, 2, 3, 4))) == Operations(1, 2, 3, 4)


def test_an_instance_that_holds_itself_is_shown() -> None:
    @records.dataclass
    class Holder:
        of: Any = None

    holder = Holder()
    holder.of = holder
    assert repr(holder).endswith("Holder(of=...)")
