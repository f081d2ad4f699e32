"""Events of Model Exchange: switches at known times, and switches with an event indicator."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from typing import Any

from ...model.expressions import Expression
from ...model.grammar import Tree
from ...model.model import Model
from ...model.products import HELD
from ...model.switches import MODE, varies_in_motion

HELD_LINEAR = frozenset(HELD + name for name in ("abs", "max", "min"))
"""Functions that are linear in their arguments while their branch is held."""


def held_switches(model: Model, manifest: Mapping[str, Any]) -> list[int]:
    """Numbers of the switches with modes that motions hold."""
    if not manifest.get("switches"):
        return []
    return [k for k, s in enumerate(model.switches.found) if s.kind != "point" and (s.drives or s.moves)]


def scheduled(model: Model, manifest: Mapping[str, Any]) -> list[int]:
    """Numbers of the held switches whose functions are linear in time, and read nothing else that varies in a motion."""
    found: list[int] = []
    moves = varies_in_motion(model.inputs)

    def varies(tree: Tree) -> bool:
        return any(moves(n) or n.startswith(MODE) for n in Expression(tree).names)

    for k in held_switches(model, manifest):
        switch = model.switches.found[k]
        if switch.value and _is_linear(switch.value, varies, {f"{MODE}{n}" for n in found}):
            found.append(k)
    return found


def indicators(model: Model, manifest: Mapping[str, Any]) -> list[int]:
    """Numbers of the held switches with an event indicator."""
    known = scheduled(model, manifest)
    return [k for k in held_switches(model, manifest) if k not in known]


def _is_linear(tree: Tree, varies: Callable[[Tree], bool], modes: Collection[str]) -> bool:
    """Whether a tree is linear in time while some modes are held."""
    kind, *parts = tree
    if not varies(tree):
        return True
    if kind == "name":
        return parts[0] == "t"
    linear = [_is_linear(part, varies, modes) for part in parts if isinstance(part, tuple)]
    if kind in ("*", "/"):
        return all(linear) and not (varies(parts[1]) and (kind == "/" or varies(parts[0])))
    if kind == "call":
        return parts[0] in HELD_LINEAR and parts[-1][1] in modes and all(linear[:-1])
    return kind in ("+", "-", "neg") and all(linear)
