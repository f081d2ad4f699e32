"""Runs on plain numbers the code that writes blocks, so that results can be compared with NumPy."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

from codegen.model.expressions import FLOAT_FUNCTIONS
from codegen.program.block import Scope


class Numbers(Scope):
    """Memory that holds numbers, by store and component. What is not there is the int 0, as zeros of a pattern are."""

    structural = False
    tangents = False
    units = True
    title = "numbers"

    def __init__(self) -> None:
        self.memory: dict[tuple[str, str], Any] = {}
        self.reads, self.writes = {}, {}

    def component(self, store: Any, name: str) -> Any:
        return self.memory.get((store.label, name), 0)

    def set_component(self, store: Any, name: str, value: Any) -> None:
        before = self.component(store, name) if store.adds else 0
        self.memory[store.label, name] = before + value

    def let(self, name: str, value: Any, tag: str = "", lanes: bool = False) -> Any:
        return value

    def name(self, name: str, value: Any, tag: str = "") -> Any:
        return value

    def number(self, value: Any) -> Any:
        return float(value)

    def sqrt(self, value: Any) -> Any:
        return math.sqrt(value)

    def call(self, function: str, *arguments: Any) -> Any:
        return FLOAT_FUNCTIONS[function](*arguments)

    def recall(self, store: Any, field: Any, value: Any) -> None:
        self.store(store, field, value)

    def stored(self, store: Any) -> Iterator[tuple[str, Any]]:
        """The components of a store, with their values."""
        return ((name, value) for (label, name), value in self.memory.items() if label == store.label)
