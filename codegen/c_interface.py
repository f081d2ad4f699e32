"""Parts of a package for C programmers besides the functions: indices by name, default values, initial state, and an
example program."""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from .emit.c import C, library_function
from .emit.target import Scalar
from .model.model import Model
from .runtime.standalone.calls.functions import STATE, shapes_of

CLOSING = ("closure", "completion")
"""Functions that close loops; the example program does not print their results."""

NAMES = 1000
"""Maximum number of coordinates, parameters, ... that get an index by name; nobody types longer lists by hand."""
NUMBERS = 10_000
"""Maximum length of an initial state that the header contains."""
LINE = 100
CLOSED = {8: ("1e-13", "1e-9"), 4: ("1e-6", "1e-4")}
"""Two residuals of loops, by size of a scalar: the example program stops iterating at the first, and accepts up to the
second."""


def package_context(model: Model, manifest: Mapping[str, Any]) -> dict[str, Any]:
    """Lines for the templates of a package's ``NAME_model.h`` and ``README.md``."""
    return {
        "rows": _rows(model),
        "indices": _indices(model, manifest),
        "tables": _tables(model, manifest),
        "usage": _usage(manifest),
        "program": _program(model, manifest),
        "codes": _codes(manifest),
    }


def _some(names: Sequence[str], limit: int = 12) -> str:
    return ", ".join(names[:limit]) + (f", ... ({len(names)} in all)" if len(names) > limit else "")


# ---- NAME_model.h ----------------------------------------------------------------------------------------------------


def _indices(model: Model, manifest: Mapping[str, Any]) -> list[str]:
    """The enum ``NAME_Q_crank = 0`` ...; a dot in a name becomes ``_``. Names that coincide after this change are left
    out."""
    outputs = [o.name for o in model.outputs] if any("output" in name for name in manifest["functions"]) else []
    sorts = [
        ("Q", model.coordinate_names), ("U", model.speed_names), ("P", model.parameter_names), ("INPUT", model.inputs),
        ("OUTPUT", outputs),
    ]  # fmt: skip
    found = [f"{index} = {i}" for sort, names in sorts for i, index in _enumerators(model, sort, names).items()]
    return ["enum {", *(f"    {line}," for line in found[:-1]), f"    {found[-1]}", "};"] if found else []


def _enumerators(model: Model, sort: str, names: Sequence[str]) -> dict[int, str]:
    """Lines of a C enum: each name with its index as the value."""
    if len(names) > NAMES:
        return {}
    words = [name.replace(".", "_") for name in names]
    count = Counter(words)
    return {i: f"{model.name.upper()}_{sort}_{word}" for i, word in enumerate(words) if count[word] == 1}


def _index(model: Model, sort: str, names: Sequence[str], name: str) -> str:
    """The enumerator of a name in C, or its index if there is no enumerator."""
    place = names.index(name)
    return _enumerators(model, sort, names).get(place, str(place))


def _tables(model: Model, manifest: Mapping[str, Any]) -> list[list[str]]:
    """Constant arrays in C: default parameters and initial state."""
    name, scalar = model.name.upper(), _scalar(manifest)
    tables = []
    if model.parameters:
        tables.append(
            [
                "/* Default design parameters. */",
                f"static const {scalar.word} {name}_PARAMETERS[{len(model.parameters)}] = {{",
            ]
            + [
                f"    {scalar.literal(repr(float(p.value)))},  /* {p.name}{_unit(p.unit)} */"
                for p in model.parameters
            ]
            + ["};"]
        )  # fmt: skip
    initial = manifest["initial"]
    closed, ignored = (
        (", at which the loops are closed", "; dependent ones are never read") if model.loops else ("", "")
    )
    for what, symbol, numbers, remark in (
        ("coordinates", "Q", initial["q"], closed), ("speeds", "U", initial["u"], ignored)
    ):  # fmt: skip
        if len(numbers) <= NUMBERS:
            tables.append(
                [
                    f"/* Initial {what}{remark}. */",
                    f"static const {scalar.word} {name}_INITIAL_{symbol}[{len(numbers)}] = {{",
                ]
                + _filled([scalar.literal(repr(_held(float(x), scalar))) for x in numbers])
                + ["};"]
            )
    return tables


def _scalar(manifest: Mapping[str, Any]) -> Scalar:
    """The scalar type of a package's C."""
    return C.scalar(manifest.get("scalar", "float64"))


def _held(x: float, scalar: Scalar) -> float:
    """The number, or zero if its magnitude is too small for the scalar type."""
    return x if abs(x) >= scalar.limits.smallest else 0.0


def _unit(unit: str) -> str:
    return ", " + " ".join(unit.split()).replace("*/", "* /").replace("/*", "/ *") if unit else ""


def _filled(words: Iterable[str]) -> list[str]:
    """The words, separated by commas and distributed over lines."""
    lines = [""]
    for word in words:
        if len(lines[-1]) + len(word) > LINE:
            lines.append("")
        lines[-1] += f" {word},"
    return [f"   {line}" for line in lines if line]


# ---- README.md -------------------------------------------------------------------------------------------------------


def _rows(model: Model) -> list[str]:
    """Rows of the table of names in the README of a package."""
    units = [" ".join(p.unit.split()) for p in model.parameters]
    parameters = [
        f"{p.name} = {float(p.value)!r} {unit}".rstrip() for p, unit in zip(model.parameters, units, strict=True)
    ]
    outputs = [o.name for o in model.outputs]
    return [
        f"| {title} ({len(names)}) | {_as_markdown(_some(names, 40))} |"
        for title, names in (
            ("coordinates q", model.coordinate_names), ("speeds u", model.speed_names), ("design parameters p", parameters),
            ("inputs", model.inputs), ("outputs", outputs),
        )
        if names
    ]  # fmt: skip


def _as_markdown(text: str) -> str:
    """The text with Markdown characters escaped: ``N*m*s`` has no emphasis. Underscores within words stay as they
    are."""
    return re.sub(r"[\\`*\[\]<>|~&$#]|(?<!\w)_|_(?!\w)", r"\\\g<0>", text)


def _loops_or_couplings(manifest: Mapping[str, Any]) -> str:
    """The noun for the loops of a model with couplings: "coupling" if all of them are couplings."""
    return "coupling" if len(manifest["couplings"]) == len(manifest["loops"]) else "loop or coupling"


def _codes(manifest: Mapping[str, Any]) -> list[str]:
    """Rows of the table of return codes in the README of a package."""
    rows, first = ["| 0 | done |"], 1
    lost = "lost rank: its dependent speeds are not determined there"
    of_loops = (_loops_or_couplings(manifest), "it") if manifest.get("couplings") else ("loop", "this loop")
    for names, noun, meaning in (
        (manifest["links"], "link", "nothing outboard of this link's joint has inertia about it"),
        (manifest["loops"], of_loops[0], f"{of_loops[1]} has {lost}"),
        (
            manifest.get("elements", ()),
            "force element",
            "its direction is not defined, for example because its attachment points coincide",
        ),
    ):
        if names:
            numbers = str(first) if len(names) == 1 else f"{first} to {first + len(names) - 1}"
            rows.append(f"| {numbers} | {noun} {_some(names)}: {meaning} |")
            first += len(names)
    for name in manifest.get("singular_outputs", ()):
        number = first + manifest["output_names"].index(name)
        rows.append(f"| {number} | output {name}: it has a value there, but no derivative |")
    return rows


def _usage(manifest: Mapping[str, Any]) -> list[str]:
    """Example calls from Python, limited to functions that the package has."""
    calls = {
        "accelerations": "udot = solver.accelerations(q, u)",
        "sensitivities": "udot, dudot = solver.sensitivities(q, u, dq=np.eye(solver.nq))    # one direction per row",
        "jacobians": "J = solver.jacobians(q, u)                           # J.q, J.u, J.p, J.inputs, J.t",
    }
    return [call for name, call in calls.items() if name in manifest["functions"]]


def _shown(manifest: Mapping[str, Any]) -> str:
    """The function that the example program calls: accelerations, or another function of a state."""
    functions = manifest["functions"]
    of_state = [n for n, f in functions.items() if not f.get("seeds") and {"q", "u"} <= set(f["arguments"]) <= {*STATE}]
    return "accelerations" if "accelerations" in functions else ([n for n in of_state if n not in CLOSING] or [""])[0]


def _program(model: Model, manifest: Mapping[str, Any]) -> list[str]:
    """A complete C program: it closes the loops, computes accelerations, and one of their derivatives."""
    name, NAME, real = model.name, model.name.upper(), _scalar(manifest).word
    functions, shown = manifest["functions"], _shown(manifest)
    if not shown or not model.nq:
        return [f"/* {name}.h lists the functions. */"]
    along = "sensitivities" if shown == "accelerations" and "sensitivities" in functions else ""
    seeds = list(functions[along]["seeds"]) if along else []
    result = functions[shown]["results"][0]
    size = math.prod(shapes_of(manifest)[result])
    sizes = {"q": "NQ", "u": "NU", "p": "NP", "inputs": "NINPUTS"}
    state = [f"q[{NAME}_NQ]", f"u[{NAME}_NU]", *([f"full_u[{NAME}_NU]"] if model.loops else [])]
    called = [shown, *(n for n in ("closure", "newton_step", "completion") if n in functions)]
    state += [f"inputs[{NAME}_NINPUTS]"] if any("inputs" in functions[n]["arguments"] for n in called) else []
    count = f"{NAME}_NU" if result == "udot" else str(size)
    arrays = [
        state,
        [f"{s}[{NAME}_{sizes[s[1:]]}]" if s != "dt" else "dt[1]" for s in seeds],
        [f"{result}[{count}]", *([f"d{result}[{count}]"] if along else [])],
    ]
    lines = [
        "#include <stdio.h>",
        "#include <string.h>",
        *(["#include <math.h>"] if model.loops else []),
        f'#include "{name}.h"',
        f'#include "{name}_model.h"',
        "",
        f"static {real} work[{NAME}_WORKSPACE];",
        *(f"static {real} {', '.join(line)};" for line in arrays if line),
        "",
    ]
    if model.loops:
        lines += _assembly(model, manifest)
    return [*lines, *_main(model, manifest, shown, along, result, count)]


def _main(model: Model, manifest: Mapping[str, Any], shown: str, along: str, result: str, count: str) -> list[str]:
    """The main function of the example program; it prints the first entries of the result and of a derivative."""
    name, NAME, functions, scalar = model.name, model.name.upper(), manifest["functions"], _scalar(manifest)
    accepted = scalar.literal(CLOSED[scalar.bytes][1])
    given, call = functions[shown]["arguments"], _arguments(manifest, shown)
    turned = [f"q[{_index(model, 'Q', model.coordinate_names, n)}]" for n in manifest["independent_names"][:1]]
    p_is_read = "p" in given or (model.loops and model.parameters)
    lines = ["int main(void)", "{", *([f"    const {scalar.word} *p = {NAME}_PARAMETERS;"] if p_is_read else [])]
    if model.nq <= NUMBERS:
        lines += [f"    memcpy(q, {NAME}_INITIAL_Q, sizeof q);", f"    memcpy(u, {NAME}_INITIAL_U, sizeof u);"]
    if model.loops:
        p = ", p" if model.parameters else ""
        lines += [
            *(f"    {q} += {scalar.literal('0.001')};    /* the dependent coordinates follow */" for q in turned),
            f"    if (!(assemble(q{p}) < {accepted}) || {name}_completion({_arguments(manifest, 'completion')}, full_u, work)) {{"
            "    /* and so do the speeds */",
            '        fprintf(stderr, "the loops cannot be closed there\\n");',
            "        return 1;",
            "    }",
            "    memcpy(u, full_u, sizeof u);",
        ]
    lines.append(f"    int code = {name}_{shown}({call}, {result}, work);")
    if along:
        if "p" in given:
            seed = f"dp[{_index(model, 'P', model.parameter_names, model.parameter_names[0])}]"
        else:
            seed = "d" + turned[0] if turned else "dt[0]"
        lines += [
            f"    {seed} = {scalar.literal('1.0')};    /* the direction of the derivative */",
            f"    if (!code) code = {name}_{along}_1({call}, {', '.join(functions[along]['seeds'])}, {result}, d{result}, work);",
        ]
    return [
        *lines,
        '    if (code) fprintf(stderr, "singular: %d\\n", code);',
        f"    for (int i = 0; i < {count} && !code; ++i)",
        f'        printf("{"%.17g %.17g" if along else "%.17g"}\\n", {result}[i]{f", d{result}[i]" if along else ""});',
        "    return code;",
        "}",
    ]


def _arguments(manifest: Mapping[str, Any], function: str) -> str:
    """Arguments in a call of a C function, at time zero."""
    return ", ".join(
        _scalar(manifest).literal("0.0") if a == "t" else a for a in manifest["functions"][function]["arguments"]
    )


def _assembly(model: Model, manifest: Mapping[str, Any]) -> list[str]:
    """The example's C function that closes the loops of q."""
    name, NAME, scalar = model.name, model.name.upper(), _scalar(manifest)
    real, zero, closed = scalar.word, scalar.literal("0.0"), scalar.literal(CLOSED[scalar.bytes][0])
    largest, size, root = (library_function(f, scalar) for f in ("fmax", "fabs", "sqrt"))
    p = f", const {real} *p" if model.parameters else ""
    conditions = len(model.closure_names)
    quaternions = manifest["quaternions"]
    lines = [
        "/* Newton's method on the dependent coordinates; returns the largest residual that is left. */",
        f"static {real} assemble({real} *q{p})",
        "{",
        f"    static {real} position[{conditions}], velocity[{conditions}], step[{NAME}_NQ];",
        f"    {real} left = {zero};",
        "    for (int round = 0; round < 30; ++round) {",
        f"        {name}_closure({_arguments(manifest, 'closure')}, position, velocity, work);",
        f"        left = {zero};",
        f"        for (int i = 0; i < {conditions}; ++i) left = {largest}(left, {size}(position[i]));",
        f"        if (left < {closed} || {name}_newton_step({_arguments(manifest, 'newton_step')}, step, work)) break;",
        f"        for (int i = 0; i < {NAME}_NQ; ++i) q[i] += step[i];",
    ]
    if quaternions:
        lines += [
            f"        static const int quaternion[] = {{{', '.join(map(str, quaternions))}}};",
            f"        for (int k = 0; k < {len(quaternions)}; ++k) {{    /* of length one */",
            f"            {real} *e = q + quaternion[k];",
            f"            const {real} length = {root}(e[0]*e[0] + e[1]*e[1] + e[2]*e[2] + e[3]*e[3]);",
            "            for (int i = 0; i < 4; ++i) e[i] /= length;",
            "        }",
        ]
    return [*lines, "    }", "    return left;", "}", ""]
