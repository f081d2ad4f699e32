"""Comments of generated functions: inputs, outputs and operation counts."""

from __future__ import annotations

import re
from functools import cache

from ..program.block import Block
from ..program.field_table import identifier
from ..program.operations import count
from ..program.store import CONSTANT
from .function import COMMENT


def notes(block: Block) -> list[str]:
    """Comment lines of a generated function: inputs, outputs and operation counts."""
    found = []
    for word, components in (("in", list(block.loads.values())), ("out", [(s, n) for s, n, _ in block.stores])):
        by_store: dict[str, dict[str, None]] = {}
        for store, name in components:
            names = by_store.setdefault(CALLED.get(store.label, store.label.replace("#", "")), {})
            if store.memory.region or store.memory is CONSTANT:
                names[_vector(name)] = None
        listed = (f"{store}: {', '.join(names)}" if names else store for store, names in by_store.items())
        found.append(f"{word}: {'; '.join(listed)}")
    once, each = count(block)
    words = [once.words() or ("" if each.words() else "none"), f"{each.words()} per direction" if each.words() else ""]
    found.append(f"operations: {'; '.join(w for w in words if w)}")
    together = ". ".join(found)
    return [together] if len(together) <= COMMENT else found


CALLED = {"pc": "c", "k": "numbers", "parameter": "p", "ceparameter": "p"}
"""Names of stores in comments of generated functions, if they differ from the names in the program."""


@cache
def _vector(component: str) -> str:
    """Name of the vector or field to which a component belongs, in generated code."""
    return _COMPONENT.sub("", identifier(component))


_COMPONENT = re.compile(r"(_[xyz]{1,2})?(_d\d+)?$")
