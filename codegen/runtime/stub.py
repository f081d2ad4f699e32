"""The stub of a package, ``__init__.pyi``, for type checkers and editors: names of the model, and the methods of its solver."""

from __future__ import annotations

import ast
import functools
import re
import textwrap
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from .sections import carried_text, sections_of, solver_text
from .standalone.calls.functions import lacks

WIDTH = 110
"""Maximum number of characters in a line of a signature."""

TIE = "\N{NO-BREAK SPACE}"
"""A character in place of a space at which a line must not break."""

ENTRIES = {
    "Coordinates": "coordinate_names", "Speeds": "speed_names", "Parameters": "parameter_names", "Inputs": "input_names",
    "Outputs": "output_names",
}  # fmt: skip
"""Types of mappings from names to numbers, each with the key of the manifest that lists the names."""

MAPPINGS = {
    **dict.fromkeys(("q", "dq", "dq0", "weights_q"), "Coordinates"),
    **dict.fromkeys(("u", "du", "du0", "weights_u", "udot", "dudot", "b", "db"), "Speeds"),
    **dict.fromkeys(("p", "dp"), "Parameters"), **dict.fromkeys(("inputs", "dinputs"), "Inputs"),
    "gradients.weights": "Speeds", "hessian_products.weights": "Speeds",
    "output_hessian_products.weights": "Outputs", "inverse_dynamics_hessian_products.weights": "Speeds",
    "output_gradients.weights": "Outputs", "coordinate_rate_gradients.weights": "Coordinates",
}  # fmt: skip
"""Mapping types by argument, or by method and argument."""

NAMES = {"linearize.outputs": ("OutputName", "output_names"), "Bodies": ("BodyName", "bodies")}
"""Arguments that are names of the model, by method and argument or by type in `Solver`. For each: its type in the stub,
and the key under which a manifest lists the names."""

PLAIN = {
    "Points": "Any", "Times": "ArrayLike", "Times | None": "ArrayLike | None",
    "Progress | None": "Callable[[float, float], None] | None",
}  # fmt: skip
"""Types of `Solver` that a stub writes in full."""

STANDARD = {
    "collections.abc": {"Callable", "Sequence"}, "pathlib": {"Path"}, "typing": {"Any", "Literal", "TypedDict"},
}  # fmt: skip
"""Modules whose types may occur in a stub."""


def stub_context(manifest: Mapping[str, Any]) -> dict[str, Any]:
    """The variables of the template ``init.pyi.jinja``: lines of text."""
    kinds = {kind: manifest[names] for kind, names in ENTRIES.items() if manifest[names]}
    there = [m for m in _methods(tuple(sections_of(manifest))) if not lacks(manifest, m.name)]
    types: set[str] = {"Literal", "Path", *(["TypedDict"] if kinds else [])}
    there.sort(key=lambda m: not m.decorator_list)  # properties come first
    members = [_lines(m, manifest, kinds, types) for m in there]
    used = set(re.findall(r"\w+", " ".join(types)))
    return {
        "standard": [
            f"from {module} import {', '.join(sorted(used & names))}" for module, names in STANDARD.items() if used & names
        ],
        "names": {kind: manifest[names] for kind, names in NAMES.values() if kind in used},
        "entries": {kind: names for kind, names in kinds.items() if kind in used},
        "scalar": np.dtype(manifest.get("scalar", "float64")).name,
        "imports": _imports(used), "members": members,
    }  # fmt: skip


@functools.lru_cache(8)
def _methods(sections: tuple[str, ...]) -> tuple[ast.FunctionDef, ...]:
    """The public methods that all solvers have, and those of `Solver` in selected sections."""
    found = []
    for text in (carried_text("calls.package"), solver_text(sections)):
        text = re.sub(r'""".*?"""', '""', text, flags=re.DOTALL)
        (solver,) = (c for c in ast.parse(text).body if isinstance(c, ast.ClassDef) and c.name in ("Package", "Solver"))
        for definition in solver.body:
            if isinstance(definition, ast.FunctionDef) and not definition.name.startswith("_"):
                found.append(definition)
    return tuple(found)


@functools.cache
def _settings() -> dict[str, str]:
    """Default settings of motions: the text of each constant by its name."""
    return dict(re.findall(r"^([A-Z_]+) = (\S+)$", carried_text("motion.settings"), re.MULTILINE))


def _lines(
    method: ast.FunctionDef, manifest: Mapping[str, Any], kinds: Mapping[str, Sequence[str]], types: set[str]
) -> list[str]:
    """A method in the stub; adds its types to `types`."""
    of = method.args
    assert method.returns is not None

    def written(argument: ast.arg, default: ast.expr | None) -> str:
        if argument.annotation is None:
            return argument.arg
        types.add(kind := _type(method.name, argument, manifest, kinds))
        if default is None:
            return f"{argument.arg}: {kind}"
        known = ast.unparse(default)
        return (
            f"{argument.arg}: {kind} = {known if isinstance(default, ast.Constant) else _settings().get(known, '...')}"
        )

    defaults = [*[None] * (len(of.args) - len(of.defaults)), *of.defaults]
    given = [written(*pair) for pair in zip(of.args, defaults, strict=True)]
    if of.vararg is not None or of.kwonlyargs:
        given.append(f"*{written(of.vararg, None)}" if of.vararg is not None else "*")
    given += [written(*pair) for pair in zip(of.kwonlyargs, of.kw_defaults, strict=True)]
    types.add(returned := ast.unparse(method.returns))
    decorators = [f"@{ast.unparse(decorator)}" for decorator in method.decorator_list]
    start, end, whole = f"def {method.name}(", f") -> {returned}: ...", ", ".join(given)
    if len(start + whole + end) <= WIDTH:
        return [*decorators, start + whole + end]
    tied = ", ".join(one.replace(" ", TIE) for one in given)
    wrapped = textwrap.wrap(tied, WIDTH - 4, break_long_words=False, break_on_hyphens=False)
    return [*decorators, start, *(f"    {line}".replace(TIE, " ") for line in wrapped), end]


def _type(method: str, argument: ast.arg, manifest: Mapping[str, Any], kinds: Mapping[str, Sequence[str]]) -> str:
    """The type of an argument; includes names of the model if the argument takes names."""
    assert argument.annotation is not None
    written, key = ast.unparse(argument.annotation), f"{method}.{argument.arg}"
    kind, names = NAMES.get(key) or NAMES.get(written) or ("", "")
    if manifest.get(names):
        return f"{kind} | Sequence[{kind}] | None"
    if written == "Numbers":
        kind = MAPPINGS.get(key) or MAPPINGS.get(argument.arg, "")
        return kind if kind in kinds else "ArrayLike | None"
    return PLAIN.get(written, written)


def _imports(used: set[str]) -> list[str]:
    """Lines that import types of the run time."""
    found = []
    for module, names in re.findall(r"^from (\.\S+) import (.+)$", carried_text("solver"), re.MULTILINE):
        kept = [name for name in names.split(", ") if name in used - {"Array", "Jacobians"}]
        found += [f"from ._runtime{module} import {', '.join(kept)}"] * bool(kept)
    return found
