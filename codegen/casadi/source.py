"""The C text of a library with CasADi's interface, from the description of its functions."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from ..emit.templates import render
from ..runtime.standalone.assembly.partitions import scale_of
from ..runtime.standalone.calls.functions import Function, functions_of, shapes_of
from ..runtime.standalone.state.derivatives import CURVED
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
        "name": manifest["name"], "version": __version__,
        "orders": "first and second" if any(f.second for f in found) else "first",
        "functions": [_described(f, manifest, closing) for f in found],
        "closing": [] if closing is None else _closing(manifest, closing),
    }  # fmt: skip
    return render("casadi/library.c.jinja", context)


def _described(f: Bridged, manifest: Mapping[str, Any], closing: Function | None) -> dict[str, Any]:
    """The template's variables for one function."""
    m, name = manifest["name"], casadi_name(f.name, manifest["name"])
    outside = {a: f.size(a) for a in f.arguments}
    value = _call(f"{m}_{f.value.name}", f, f.value, {f.value.results[0]: "y"})
    return {
        "name": name, "arguments": f.arguments, "result": f.value.results[0],
        "names": ", ".join(f'"{a}"' for a in f.arguments),
        "sizes": _list(outside.values()), "whole": _list(f.sizes.values()),
        "closing": _closing_of(f, name, manifest, closing) if closing is not None and f.closes else [],
        "velocity": [f"double velocity[{f.rows}];"] if "velocity" in value else [], "value": value,
        "along": {w: _call(f"{m}_{f.along.name}_{w}", f, f.along, _along_results(f)) for w in (1, 8)},
        "transposes": _transposes(f, name, m),
        "places": _arrays("place", name, [_list(f.places[a]) if a in f.places else "" for a in f.arguments]),
        "tables": _tables(f, name, outside),
        "transposed": _arrays("transposed", name, [_list(_transposition(f.jacobian[a])) for a in f.arguments])
        if f.second else [],
        "members": _members(f, name, f"{m.upper()}_WORKSPACE"), "interfaces": _interfaces(f, name),
    }  # fmt: skip


def _tables(f: Bridged, name: str, outside: Mapping[str, int]) -> dict[str, list[str]]:
    """Sparsity patterns of the arguments and results of a function and its derivatives, by the names of their C arrays."""
    dense = [[n, 1, 1] for n in outside.values()]
    none = {a: [n, f.rows, *[0] * (f.rows + 1)] for a, n in outside.items()}
    found: dict[str, list[list[int]]] = {
        "in": dense, "out": [[f.rows, 1, 1]], "blocks": [ccs(f.jacobian[a]) for a in f.arguments],
        "jac_in": [*dense, _nothing(f.rows)],
    }  # fmt: skip
    for w in WIDTHS:
        found[f"fwd{w}_in"] = [*dense, _nothing(f.rows), *([n, w, 1] for n in outside.values())]
        found[f"fwd{w}_out"] = [[f.rows, w, 1]]
        found[f"adj{w}_in"] = [*dense, _nothing(f.rows), [f.rows, w, 1]]
        found[f"adj{w}_out"] = [[n, w, 1] for n in outside.values()]
    if f.second:
        found["second"] = [ccs(f.hessian[a, b]) for a in f.arguments for b in f.arguments]
        rows = [[*(ccs(f.hessian[a, b]) for b in f.arguments), none[a], ccs(f.jacobian[a].T)] for a in f.arguments]
        found["adjoint"] = [p for row in rows for p in row]
        found["jac_adj_in"] = [*dense, _nothing(f.rows), [f.rows, 1, 1], *([n, 1, 0, 0] for n in outside.values())]
    return {f"{kind}_{name}": _patterns(patterns) for kind, patterns in found.items()}


def _transposes(f: Bridged, name: str, model: str) -> list[str]:
    """C functions of the gradient and of Hessian products, if the solver has these."""
    lines: list[str] = []
    if f.back:
        call = _call(f"{model}_{f.back.name}_1", f, f.back, {f.value.results[0]: "y"} | _weights(f))
        lines += [
            f"static int back_{name}(ordernm_given x, const double *weights, double *y, ordernm_found g, double *work)",
            "{", "    (void)y;", f"    return {call};", "}",
        ]  # fmt: skip
    if f.second:
        call = _call(f"{model}_{f.second.name}_8", f, f.second, {CURVED[f.name].weights: "weights"})
        lines += [
            f"static int products_{name}(ordernm_given x, const double *weights, ordernm_given dx, ordernm_found g, "
            "double *work)",
            "{", f"    return {call};", "}",
        ]  # fmt: skip
    return lines


def _members(f: Bridged, name: str, workspace: str) -> list[str]:
    """Members of the ``ordernm_function``; those that the solver lacks are 0."""
    second = [f"{x}_{name}" if f.second else "0" for x in ("products", "second", "transposed")]
    return [
        f"{len(f.arguments)}, {f.rows}, size_{name}, whole_{name}, place_{name}, {sum(f.sizes.values())}, {workspace},",
        f"{f'&loops_{name}' if f.closes else '0'}, value_{name}, along_1_{name}, along_8_{name},",
        f"{f'back_{name}' if f.back else '0'}, {second[0]}, blocks_{name},",
        f"{second[1]}, {second[2]}",
    ]


Table = tuple[str, int]
"""Name of an array of patterns, and the number of patterns."""


def _interfaces(f: Bridged, name: str) -> list[tuple[str, Table, Table, str]]:
    """Name, arguments, results and call of each function that CasADi finds in the library."""
    n, of = len(f.arguments), f"&of_{name}"
    found = [
        (name, (f"in_{name}", n), (f"out_{name}", 1), f"ordernm_value({of}, arg, res, w)"),
        (f"jac_{name}", (f"jac_in_{name}", n + 1), (f"blocks_{name}", n), f"ordernm_jacobian({of}, arg, res, w)"),
    ]
    for w in WIDTHS:
        forward, reverse = f"fwd{w}", f"adj{w}"
        found += [
            (f"{forward}_{name}", (f"{forward}_in_{name}", 2 * n + 1), (f"{forward}_out_{name}", 1),
             f"ordernm_forward({of}, {w}, arg, res, w)"),
            (f"{reverse}_{name}", (f"{reverse}_in_{name}", n + 2), (f"{reverse}_out_{name}", n),
             f"ordernm_adjoint({of}, {w}, arg, res, w)"),
        ]  # fmt: skip
    if f.second:
        results = f"adjoint_{name}", n * (n + 2)
        call = f"ordernm_hessian({of}, arg, res, w)"
        found.append((f"jac_adj1_{name}", (f"jac_adj_in_{name}", 2 * n + 2), results, call))
    return found


def _along_results(f: Bridged) -> dict[str, str]:
    (derived,) = (r for r, d in zip(f.along.results, f.along.derived, strict=True) if d)
    return {f.value.results[0]: "y", derived: "dy"}


def _weights(f: Bridged) -> dict[str, str]:
    assert f.back is not None
    return dict.fromkeys(f.back.seeds, "weights")


def _call(name: str, f: Bridged, function: Function, more: Mapping[str, str]) -> str:
    """The text of a call of a generated function. The array x holds the arguments, dx the seeds, and g gradients or their
    changes."""
    index = {a: i for i, a in enumerate(f.arguments)}
    known = {a: f"x[{i}]" if a != "t" else f"*x[{i}]" for a, i in index.items()}
    known |= {f"d{a}": f"dx[{i}]" for a, i in index.items()} | {f"dg{a}": f"g[{i}]" for a, i in index.items()}
    known |= {"velocity": "velocity"}
    if function is f.back:
        known |= {f"d{a}": f"g[{i}]" for a, i in index.items()}
    known |= more
    given = [*function.arguments, *function.seeds, *function.results]
    return f"{name}({', '.join(known[a] for a in given)}, work)"


def _starting(manifest: Mapping[str, Any]) -> dict[str, Sequence[float]]:
    """The model's initial coordinates and its default parameters, inputs and time."""
    inputs = [0.0] * len(manifest["input_names"])
    return {"q": manifest["initial"]["q"], "p": manifest["parameters"], "t": [0.0], "inputs": inputs}


def _closing(manifest: Mapping[str, Any], step: Function) -> list[str]:
    """Arrays in C for closing the loops: the initial state, units of change, and dependent quaternions."""
    start = _starting(manifest)
    lines = [f"static const double start_{a}[] = {{{_list(map(repr, map(float, start[a])))}}};" for a in step.arguments]
    lines.append(f"static const double scale[] = {{{_list(map(repr, scale_of(manifest).tolist()))}}};")
    lines.append(f"static const int quaternions[] = {{{_list(_dependent_quaternions(manifest))}}};")
    return lines


def _dependent_quaternions(manifest: Mapping[str, Any]) -> list[int]:
    own = {manifest["coordinate_names"].index(n) for n in manifest["independent_names"]}
    return [i for i in manifest["quaternions"] if i not in own]


def _closing_of(f: Bridged, name: str, manifest: Mapping[str, Any], step: Function) -> list[str]:
    """Newton's step and the ``ordernm_loops`` of a function in C."""
    given = [f"{'*' if a == 't' else ''}x[{f.arguments.index(a)}]" for a in step.arguments]
    start = [f"start_{a}" if a in step.arguments else "0" for a in f.arguments]
    counts = f"{len(_dependent_quaternions(manifest))}, {len(manifest['coordinate_names'])}"
    return [
        f"static int step_{name}(ordernm_given x, double *step, double *work)",
        "{", f"    return {manifest['name']}_{CLOSING}({', '.join([*given, 'step', 'work'])});", "}",
        f"static const double *const start_{name}[] = {{{', '.join(start)}}};",
        f"static const ordernm_loops loops_{name} = {{step_{name}, start_{name}, scale, quaternions, {counts}}};",
    ]  # fmt: skip


def _arrays(kind: str, name: str, lists: Sequence[str]) -> list[str]:
    """Arrays of numbers in C, and an array of pointers to them; an empty text stands for a null pointer."""
    lines = [f"static const int {kind}_{i}_{name}[] = {{{x}}};" for i, x in enumerate(lists) if x]
    pointers = ", ".join(f"{kind}_{i}_{name}" if x else "0" for i, x in enumerate(lists))
    return [*lines, f"static const int *const {kind}_{name}[] = {{{pointers}}};"]


# -- patterns as C -----------------------------------------------------------------------------------------------------


def ccs(pattern: Pattern) -> list[int]:
    """A pattern as CasADi's compressed columns: numbers of rows and columns, beginning of each column, row of each
    entry."""
    rows, columns = pattern.shape
    beginnings = np.concatenate([[0], np.cumsum(pattern.sum(axis=0))]).tolist()
    return [rows, columns, *beginnings, *np.nonzero(pattern.T)[1].tolist()]


def _nothing(rows: int) -> list[int]:
    return [rows, 1, 0, 0]


def _transposition(pattern: Pattern) -> list[int]:
    """Where each entry of a compressed Jacobian is in its compressed transpose."""
    number = np.full(pattern.shape, -1)
    rows, columns = np.nonzero(pattern)  # by rows, the order of entries in the compressed transpose
    number[rows, columns] = np.arange(len(rows))
    columns, rows = np.nonzero(pattern.T)
    return [int(x) for x in number[rows, columns]]


def _list(numbers: Iterable[Any]) -> str:
    """Numbers of a C initialiser, which must not be empty."""
    return ", ".join(map(str, numbers)) or "0"


def _patterns(patterns: Sequence[Sequence[int]]) -> list[str]:
    """Patterns as initialisers."""
    return [_list(p) for p in patterns]
