"""The C text of a library with CasADi's interface, from the description of its functions."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from ..emit.templates import render
from ..runtime.standalone.assembly.partitions import scale_of
from ..runtime.standalone.calls.functions import Function, functions_of, shapes_of
from ..version import __version__
from .bridged import CLOSING, Bridged, Pattern

WIDTHS = (1, 2, 4, 8)
"""Numbers of directions of CasADi's functions."""

LINE = 116


def casadi_name(function: str, model: str) -> str:
    """The name of a function in CasADi."""
    return f"{function}_{model}"


def text(manifest: Mapping[str, Any], functions: Iterable[Bridged]) -> str:
    """The C file of all functions."""
    found = list(functions)
    closing = functions_of(manifest, shapes_of(manifest)).get(CLOSING) if any(f.closes for f in found) else None
    context = {
        "name": manifest["name"], "version": __version__, "widths": WIDTHS, "functions": [_described(f, manifest) for f in found],
        "loops": None if closing is None else _closing(manifest, closing), "workspace": f"{manifest['name'].upper()}_WORKSPACE",
    }  # fmt: skip
    return render("casadi/library.c.jinja", context)


def _described(f: Bridged, manifest: Mapping[str, Any]) -> dict[str, Any]:
    """The variables of one function."""
    m = manifest["name"]
    outside = {a: f.size(a) for a in f.arguments}
    dense = [[n, 1, 1] for n in outside.values()]
    jacobian = [ccs(f.jacobian[a]) for a in f.arguments]
    none = {a: [n, f.rows, *[0] * (f.rows + 1)] for a, n in outside.items()}
    hessian = [ccs(f.hessian[a, b]) for a in f.arguments for b in f.arguments] if f.second else []
    transposed = [ccs(f.jacobian[a].T) for a in f.arguments]
    of_adjoint = [
        [*(ccs(f.hessian[a, b]) for b in f.arguments), none[a], transposed[i]]
        for i, a in enumerate(f.arguments) if f.second
    ]  # fmt: skip
    return {
        "name": casadi_name(f.name, m), "of": f"{m}_{f.value.name}", "arguments": f.arguments, "result": f.value.results[0],
        "n_in": len(f.arguments), "rows": f.rows, "sizes": _list(outside.values()), "whole": _list(f.sizes.values()),
        "n_whole": sum(f.sizes.values()), "closes": f.closes, "second": f.second is not None, "back": f.back is not None,
        "places": [_list(f.places[a]) if a in f.places else "" for a in f.arguments],
        "value": _call(f"{m}_{f.value.name}", f, f.value, {f.value.results[0]: "y"}),
        "along": {w: _call(f"{m}_{f.along.name}_{w}", f, f.along, _along_results(f)) for w in (1, 8)},
        "gradient": f.back and _call(f"{m}_{f.back.name}_1", f, f.back, {f.value.results[0]: "y"} | _weights(f)),
        "products": f.second and _call(f"{m}_{f.second.name}_8", f, f.second, {"b": "weights"}),
        "patterns_in": _patterns(dense), "patterns_out": _patterns([[f.rows, 1, 1]]),
        "jacobian": _patterns(jacobian), "hessian": _patterns(hessian),
        "adjoint": _patterns([p for row in of_adjoint for p in row]),
        "transposed": [_list(_transposition(f.jacobian[a])) for a in f.arguments] if f.second else [],
        "forward": {w: _patterns([*dense, _nothing(f.rows), *([n, w, 1] for n in outside.values())]) for w in WIDTHS},
        "forward_out": {w: _patterns([[f.rows, w, 1]]) for w in WIDTHS},
        "reverse": {w: _patterns([*dense, _nothing(f.rows), [f.rows, w, 1]]) for w in WIDTHS},
        "reverse_out": {w: _patterns([[n, w, 1] for n in outside.values()]) for w in WIDTHS},
        "jacobian_in": _patterns([*dense, _nothing(f.rows)]),
        "adjoint_in": _patterns([*dense, _nothing(f.rows), [f.rows, 1, 1], *([n, 1, 0, 0] for n in outside.values())]),
    }  # fmt: skip


def _along_results(f: Bridged) -> dict[str, str]:
    (derived,) = (r for r, d in zip(f.along.results, f.along.derived, strict=True) if d)
    return {f.value.results[0]: "y", derived: "dy"}


def _weights(f: Bridged) -> dict[str, str]:
    assert f.back is not None
    return dict.fromkeys(f.back.seeds, "weights")


def _call(name: str, f: Bridged, function: Function, more: Mapping[str, str]) -> str:
    """A call of a generated function on arrays by argument: x, seeds dx, gradients or their changes g."""
    index = {a: i for i, a in enumerate(f.arguments)}
    known = {a: f"x[{i}]" if a != "t" else f"*x[{i}]" for a, i in index.items()}
    known |= {f"d{a}": f"dx[{i}]" for a, i in index.items()} | {f"dg{a}": f"g[{i}]" for a, i in index.items()}
    known |= {"velocity": "velocity"}
    if function is f.back:
        known |= {f"d{a}": f"g[{i}]" for a, i in index.items()}
    known |= more
    given = [*function.arguments, *function.seeds, *function.results]
    return f"{name}({', '.join(known[a] for a in given)}, work)"


def _closing(manifest: Mapping[str, Any], step: Function) -> dict[str, Any]:
    """What closing the loops needs: Newton's step, the initial state, units of change, and quaternions."""
    own = {manifest["coordinate_names"].index(n) for n in manifest["independent_names"]}
    start = {"q": manifest["initial"]["q"], "p": manifest["parameters"], "t": [0.0]}
    start |= {"inputs": [0.0] * len(manifest["input_names"])}
    return {
        "arguments": step.arguments, "step": f"{manifest['name']}_{CLOSING}",
        "start": {a: _list(map(repr, map(float, start[a]))) for a in step.arguments},
        "scale": _list(map(repr, scale_of(manifest).tolist())),
        "quaternions": _list(i for i in manifest["quaternions"] if i not in own),
        "n_quaternions": sum(i not in own for i in manifest["quaternions"]), "n_q": len(manifest["coordinate_names"]),
    }  # fmt: skip


# -- patterns as C -----------------------------------------------------------------------------------------------------


def ccs(pattern: Pattern) -> list[int]:
    """CasADi's compressed columns: rows, columns, the beginning of each column, and the row of each entry."""
    rows, columns = pattern.shape
    beginnings = np.concatenate([[0], np.cumsum(pattern.sum(axis=0))]).tolist()
    return [rows, columns, *beginnings, *np.nonzero(pattern.T)[1].tolist()]


def _nothing(rows: int) -> list[int]:
    return [rows, 1, 0, 0]


def _transposition(pattern: Pattern) -> list[int]:
    """Where each entry of a compressed Jacobian is in its compressed transpose."""
    number = np.full(pattern.shape, -1)
    rows, columns = np.nonzero(pattern)  # row by row, as the transpose has them
    number[rows, columns] = np.arange(len(rows))
    columns, rows = np.nonzero(pattern.T)
    return [int(x) for x in number[rows, columns]]


def _list(numbers: Iterable[Any]) -> str:
    """Numbers of an initialiser; C has no empty one."""
    return ", ".join(map(str, numbers)) or "0"


def _patterns(patterns: Sequence[Sequence[int]]) -> list[str]:
    """Patterns as initialisers."""
    return [_list(p) for p in patterns]
