"""Long functions of links in parts, in C: where values lie that parts hand on, and whose the parts are."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from functools import cache

from ...program.block import Block, Component
from ...program.store import MARGIN, Memory, Owner, Store
from ..language import Located, Place

HANDED_ON = {along: Store(name, Owner("function"), Memory("stack", along)) for along, name in
             ((False, "handed_on"), (True, "handed_lanes"))}  # fmt: skip
"""What parts hand on to later ones: numbers that all directions share, or one value each."""

STACK = {False: "values", True: "lane_values"}
"""Arrays where that lies, in the function that calls the parts."""


def _type(along: bool, real: str) -> str:
    """What they consist of; `real` is the scalar type."""
    return "LANES" if along else real


def handed_on(number: int, along: bool) -> Component:
    """A place for what is handed on."""
    return HANDED_ON[along], str(number)


def in_stack(place: Place, real: str) -> Place:
    """Where a component of a part lies: there, or where it lies in the whole function."""

    def placed(store: Store, name: str) -> Located:
        for along, of in HANDED_ON.items():
            if store is of:
                return Located(store.name, STACK[along], f"[{name}]", _type(along, real))
        return place(store, name)

    return placed


def is_overwritten(block: Block, place: Place) -> Callable[[Component], bool]:
    """Whether a block stores something where a component lies."""

    @cache
    def stored() -> set[tuple[str, str]]:
        return {_address(place(store, name)) for store, name, _ in block.stores if store.memory is not MARGIN}

    return lambda at: _address(place(*at)) in stored()


def _address(at: Located) -> tuple[str, str]:
    """Where it is, whatever the variable is called that points there."""
    return at.row, at.text


def stack(places: Mapping[bool, int], real: str) -> list[str]:
    """Declarations of the arrays; how many places each needs."""
    return [f"{_type(along, real)} {STACK[along]}[{n}];" for along, n in sorted(places.items())]


def arrays_used(part: Block, real: str) -> list[tuple[str, str]]:
    """Types and names of the arrays that a part reads or writes."""
    used = {store for store, _ in part.loads.values()} | {store for store, _, _ in part.stores}
    return [(_type(along, real), STACK[along]) for along, store in HANDED_ON.items() if store in used]


def linkage(shared: str) -> list[str]:
    """Lines that say whose the parts of a function are: units of a library share them under this condition."""
    return ["#undef PART", f"#if {shared}", "#define PART SHARED_PART", "#else", "#define PART STATIC_PART", "#endif"]


def reads(lines: list[str], parameter: str, macro: str = "") -> bool:
    """Whether lines read a parameter, themselves or by a macro."""
    found = re.compile(rf"\b(?:{parameter}{'|' if macro else ''}{macro})\b")
    return any(map(found.search, lines))


__all__ = ["arrays_used", "handed_on", "in_stack", "is_overwritten", "linkage", "reads", "stack"]
