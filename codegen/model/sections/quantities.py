"""The name of the model and its numbers: constants, parameters and inputs."""

from __future__ import annotations

import keyword
import re
import sys
from collections.abc import Iterable
from typing import Final

from ..binding import vector_key
from ..entries import RESERVED, shown
from ..expressions import Expression
from ..grammar import ExpressionError
from ..model import Parameter
from ..parsing import parse
from ..parts import Instance, Part
from ..positions import Path_
from ..reading import Reader
from ..schema import ParameterEntry
from ..units import Frequency, in_units, in_words, unit_of

_MODULES: Final = frozenset({"cffi", "codegen", "generated", "numpy", "ordernm", "stdint"})
_C_KEYWORDS: Final = frozenset(
    "auto break case char const continue default do double else enum extern float for goto if inline int long register "
    "restrict return short signed sizeof static struct switch typedef union unsigned void volatile while".split()
)


def model_name(reader: Reader) -> str:
    name = reader.document.root.get("model")
    allowed = "a lower-case identifier such as four_bar is allowed; it names the generated package"
    if name is None:
        reader.report(reader.top("model"), (), f"key 'model' is missing; {allowed}")
    elif not isinstance(name, str) or not re.fullmatch("[A-Za-z_][A-Za-z0-9_]*", name):
        reader.report(reader.top("model"), (), f"{shown(name)} is not a valid name; {allowed}")
    elif keyword.iskeyword(name) or keyword.issoftkeyword(name) or name in _C_KEYWORDS or name in RESERVED:
        reader.report(reader.top("model"), (), f"{name!r} is a reserved word; {allowed}")
    elif name in sys.stdlib_module_names or name in _MODULES:
        reader.report(reader.top("model"), (), f"{name!r} is a module that the package would hide; {allowed}")
    return str(name)


def read_constants(reader: Reader, parts: Iterable[Part]) -> None:
    """Read the constants of some files; constants given to a submodel replace its own."""
    for at in reader.section("constants", parts):
        given = reader.given_entry(at, "constants")
        if given is not None:
            local = reader.local_name(at)
            if len(given) == 1:
                at.part.constants[local] = given[0].value
            for i, e in enumerate(given if len(given) > 1 else ()):
                at.part.constants[f"{local}_{i + 1}"] = at.part.constants[f"{local}.{'xyz'[i]}"] = e.value
            continue
        name = reader.key_name(at, "constant", "value")
        many = isinstance(at.value, (list, tuple))
        values = []
        for i, value in enumerate(at.value if many else [at.value]):
            result = reader.scalar(at, (i,) if many else (), value, "constants")
            values.append(0 if result is None else result.value)
            if name is None or result is None:
                continue
            entry = f"{name}_{i + 1}" if many else name
            if not many or reader.new_name(at, entry, "value", "constant"):
                at.part.constants[at.part.written(entry)] = result.value
        if name is None:
            continue
        local = at.part.written(name)
        if many and len(values) == 3:
            at.part.constants[vector_key(local)] = local
            at.part.constants.update({f"{local}.{c}": v for c, v in zip("xyz", values, strict=True)})
        _note_dimension(reader, at, local, at.value[0] if many and values else at.value)


def read_parameters(reader: Reader) -> list[tuple[Parameter, Instance]]:
    """Read the parameters; a vector becomes three, named after its components."""
    result = []
    for at in reader.section("parameters"):
        if reader.given_entry(at, "parameters") is not None:
            continue
        name = reader.key_name(at, "parameter", "value")
        unit = ""
        written: dict[str, list[tuple[Path_, Expression]]] = {}
        if isinstance(at.value, dict):
            spec = reader.spec(ParameterEntry, at)
            unit = spec.unit if spec is not None else ""
            for key in ("value", "min", "max"):
                found = getattr(spec, key, None)
                if found is not None:
                    listed = found if isinstance(found, tuple) else (found,)
                    written[key] = [((key, i) if len(listed) > 1 else (key,), e) for i, e in enumerate(listed)]
        else:
            written["value"] = reader.numbers_at(at, (), at.value)
        numbers = {k: [float(reader.bound(e, at, sub, "constants").value) for sub, e in v] for k, v in written.items()}
        if name is None:
            continue
        local, size = at.part.written(name), len(numbers.get("value", [0.0]))
        unit = _unit(reader, at, local, unit, [e for _, e in written.get("value", [])])
        if size == 3:
            at.part.constants[vector_key(local)] = local
        for bound in ("min", "max"):
            if len(numbers.get(bound, ())) > size:
                reader.report(at, (bound,), f"three bounds for one number; give one number as {bound}")
                del numbers[bound]
        for i in range(size):
            one = {k: v[i if len(v) > 1 else 0] for k, v in numbers.items()}
            suffix = f".{'xyz'[i]}" if size > 1 else ""
            result.append((_parameter(reader, at, name + suffix, one, unit), at))
    return result


def _parameter(reader: Reader, at: Instance, name: str, numbers: dict[str, float], unit: str) -> Parameter:
    value, low, high = numbers.get("value", 0.0), numbers.get("min"), numbers.get("max")
    if low is not None and high is not None and low > high:
        reader.report(at, ("min",), f"min {low:g} is above max {high:g}; min must not exceed max")
    elif (low is not None and value < low) or (high is not None and value > high):
        message = f"value {value:g} is outside min {_limit(low)} and max {_limit(high)}"
        reader.report(at, ("value",), message, severity="warning")
    reader.defaults[name] = value
    reader.allowed["parameters"][name] = None
    return Parameter(name, value, unit, low, high)


def _unit(reader: Reader, at: Instance, local: str, text: str, values: list[Expression]) -> str:
    """The unit of a parameter for documentation: the unit given in the file, or the unit of the value."""
    dimensions = {reader.dimension(e, at, quiet=True) for e in values} - {None}  # errors are reported at binding
    if len(dimensions) > 1:
        reader.report(at, ("value",), "components have different units; those of a vector must be of the same kind")
    known = unit_of(text) if text else None
    if not dimensions:
        if known is not None and known[0] != 1:
            message = (
                f"unit {text} only documents the value, and numbers are in SI units; write value: {values[0]} {text}, "
                f"or give the value in {in_units(known[1]) or 'rad'}"
                if values
                else f"unit {text}; numbers are in SI units"
            )
            reader.report(at, ("unit",), message, severity="warning")
        if known is not None and isinstance(known[1], Frequency):
            at.part.dimensions[local] = known[1]  # so that it is not taken for an angular rate
        return text
    (dimension,) = list(dimensions)[:1]
    assert dimension is not None
    at.part.dimensions[local] = dimension
    if known is not None and known[1] != dimension:
        reader.report(
            at, ("unit",), f"unit {text} is {in_words(known[1])}, the value {in_words(dimension)}; write one of them"
        )
    return text if known is not None and known[0] == 1 else in_units(dimension)


def _note_dimension(reader: Reader, at: Instance, local: str, value: object) -> None:
    """Store the dimension of a constant whose value is written with a unit."""
    try:
        written = parse(value) if isinstance(value, str) else None
    except ExpressionError:
        return  # the error is reported where the constant is read
    found = None if written is None else reader.dimension(written, at, quiet=True)
    if found is not None:
        at.part.dimensions[local] = found


def read_inputs(reader: Reader) -> None:
    for at, sub, item in reader.listed("inputs", "[motor, brake]"):
        local = reader.name_at(at, sub, item)
        if local is None or reader.given(at, local, "inputs") is not None:
            continue
        name = at.part.name(local)
        if reader.new_name(at, name, "value", "input", sub, key=False):
            reader.inputs.append(name)
            reader.allowed["inputs"][name] = None


def _limit(value: float | None) -> str:
    return "(none)" if value is None else f"{value:g}"


def warn_of_unused_quantities(reader: Reader, parameters: Iterable[tuple[Parameter, Instance]]) -> None:
    """Warn of parameters and inputs that no expression contains."""
    named = [("parameter", p.name, at) for p, at in parameters]
    named += [("input", name, reader.top("inputs")) for name in reader.inputs]
    for what, name, at in named:
        if name not in reader.used:
            reader.report(at, (), f"{what} {name!r} is not used", key=what == "parameter", severity="warning")
