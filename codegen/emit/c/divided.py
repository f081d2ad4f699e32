"""Functions of links that are so long that they are divided into parts, in C: passed values, and linkage of the parts."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from functools import cache

from ...program.block import Block, Component
from ...program.store import MARGIN, Memory, Owner, Store
from ..language import Located, Place

CARRIED_OVER = {along: Store(name, Owner("function"), Memory("stack", along)) for along, name in
             ((False, "carried_over"), (True, "carried_lanes"))}  # fmt: skip
"""Values that one part passes to later parts: one for all directions (False), or one per direction (True)."""

STACK = {False: "values", True: "lane_values"}
"""Names of the arrays for these values, in the function that calls the parts."""


def _type(along: bool, real: str) -> str:
    """Element type of an array of passed values; `real` is the scalar type."""
    return "LANES" if along else real


def carried_over(number: int, along: bool) -> Component:
    """The place of a value that one part passes to another."""
    return CARRIED_OVER[along], str(number)


def in_stack(place: Place, real: str) -> Place:
    """The function that returns places of components in a part: values passed between parts are in arrays on the stack; all
    other components have the same places as in the undivided function."""

    def placed(store: Store, name: str) -> Located:
        for along, of in CARRIED_OVER.items():
            if store is of:
                return Located(store.name, STACK[along], f"[{name}]", _type(along, real))
        return place(store, name)

    return placed


def is_overwritten(block: Block, place: Place) -> Callable[[Component], bool]:
    """Returns a function that tests whether a block stores to the place of a component."""

    @cache
    def stored() -> set[tuple[str, str]]:
        return {_address(place(store, name)) for store, name, _ in block.stores if store.memory is not MARGIN}

    return lambda at: _address(place(*at)) in stored()


def _address(at: Located) -> tuple[str, str]:
    """The address of a component, without the name of the pointer variable."""
    return at.row, at.text


def stack(places: Mapping[bool, int], real: str) -> list[str]:
    """Declarations of the arrays, sized by the number of places."""
    return [f"{_type(along, real)} {STACK[along]}[{n}];" for along, n in sorted(places.items())]


def arrays_used(part: Block, real: str) -> list[tuple[str, str]]:
    """Types and names of the arrays that a part reads or writes."""
    used = {store for store, _ in part.loads.values()} | {store for store, _, _ in part.stores}
    return [(_type(along, real), STACK[along]) for along, store in CARRIED_OVER.items() if store in used]


def linkage(shared: str) -> list[str]:
    """Lines that set the linkage of parts: external if the condition `shared` holds, so that the compile units of a library
    share them; otherwise static."""
    return ["#undef PART", f"#if {shared}", "#define PART SHARED_PART", "#else", "#define PART STATIC_PART", "#endif"]


def reads(lines: list[str], parameter: str, macro: str = "") -> bool:
    """Whether lines read a parameter, directly or through a macro."""
    found = re.compile(rf"\b(?:{parameter}{'|' if macro else ''}{macro})\b")
    return any(map(found.search, lines))


__all__ = ["arrays_used", "carried_over", "in_stack", "is_overwritten", "linkage", "reads", "stack"]
