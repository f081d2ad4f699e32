"""Which files of the run time a package carries: those of the sections that its functions need, and what these import."""

from __future__ import annotations

import ast
import functools
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

STANDALONE = Path(__file__).parent / "standalone"
"""The run time: the standard library, NumPy and cffi is all it imports."""

CARRIED = "_runtime"
"""What it is called in a package."""

SECTIONS: dict[str, str | None] = {
    "Dynamics": None, "Energies": "energies", "Outputs": None, "TreeForces": "mass_matrix", "Reactions": "reactions",
    "Loops": "closure", "States": None, "Redundancy": "opening", "Partitions": None,
}  # fmt: skip
"""Sections of `Solver`, and what a manifest names, among its functions or beside them, where they are needed: None for
sections that all packages carry."""

ALWAYS = ("errors", "jacobians")
"""Modules that the ``__init__.py`` of every package imports beside sections."""


def sections_of(manifest: Mapping[str, Any]) -> dict[str, str]:
    """The sections that a package needs, as classes and their modules, in the order of the classes of `Solver`."""
    named = {key for m in (manifest, manifest.get("second", {})) for key in (*m, *m.get("functions", ()))}
    found = {name: _module(name) for name, needed in SECTIONS.items() if needed is None or needed in named}
    if "Loops" in found:
        del found["States"]  # which it is derived from
    return found


def carried_files(manifest: Mapping[str, Any]) -> dict[str, str]:
    """The files of the run time in a package, by name."""
    modules, left = set[str](), {*ALWAYS, *sections_of(manifest).values()}
    while left:
        modules |= left
        left = set().union(*map(_imported, left)) - modules
    return {f"{CARRIED}/{m}.py": _text(m) for m in ("__init__", *sorted(modules))}


@functools.cache
def _module(section: str) -> str:
    """The module of a section: TreeForces stands in ``tree_forces``."""
    return "".join(f"_{c.lower()}" if c.isupper() else c for c in section).removeprefix("_")


@functools.cache
def _text(module: str) -> str:
    return (STANDALONE / f"{module}.py").read_text(encoding="utf-8")


def _imported(module: str) -> Iterator[str]:
    """Modules of the run time that one imports."""
    for node in ast.walk(ast.parse(_text(module))):
        if isinstance(node, ast.ImportFrom) and node.level:
            assert node.module is not None
            yield node.module


__all__ = ["CARRIED", "STANDALONE", "carried_files", "sections_of"]
