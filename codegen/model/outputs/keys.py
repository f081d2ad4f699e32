"""Types of keys that measures have in common: points, bodies, axes, words to choose from."""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated, Any

from pydantic import PlainValidator, WrapValidator

from ..entries import Axis, PointOrName, Reference, complaint, seen, written

OptionalPoint = Annotated[PointOrName | None, WrapValidator(written)]
OptionalAxis = Annotated[Axis | None, WrapValidator(written)]
OptionalBody = Annotated[Reference | None, WrapValidator(written)]


def _two(value: Any, handler: Callable[[Any], Any]) -> Any:
    if not isinstance(value, (list, tuple)) or len(value) != 2:
        raise complaint(f"{seen(value)}; a list of two points is needed, such as [tip, ground]")
    return handler(value)


TwoPoints = Annotated[tuple[PointOrName, PointOrName] | None, WrapValidator(_two)]


def word(*allowed: str) -> Any:
    """One of some words, or left out."""

    def check(value: Any) -> str:
        if value not in allowed:
            raise complaint(f"{seen(value)}; {', '.join(allowed[:-1])} or {allowed[-1]} is allowed")
        return str(value)

    return Annotated[str | None, PlainValidator(check)]
