"""The name of the model and its numbers: constants, parameters, inputs and gravity."""

from __future__ import annotations

import keyword
import re
import sys
from collections.abc import Iterable
from typing import Final

from pydantic_core import PydanticCustomError

from ..entries import RESERVED, ZERO, parse_name, seen
from ..errors import with_article
from ..expressions import ExpressionError
from ..model import Parameter, Vector
from ..parts import Instance, Part
from ..reading import Reader
from ..repetition import name_of
from ..schema import ParameterEntry

_MODULES: Final = frozenset({"cffi", "codegen", "generated", "numpy", "stdint"})
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
        reader.report(reader.top("model"), (), f"{seen(name)} is no name; {allowed}")
    elif keyword.iskeyword(name) or keyword.issoftkeyword(name) or name in _C_KEYWORDS or name in RESERVED:
        reader.report(reader.top("model"), (), f"{name!r} is a reserved word; {allowed}")
    elif name in sys.stdlib_module_names or name in _MODULES:
        reader.report(reader.top("model"), (), f"{name!r} is a module that the package would hide; {allowed}")
    return str(name)


def read_constants(reader: Reader, parts: Iterable[Part]) -> None:
    """Read the constants of some files; those that a submodel is given stand in the place of its own."""
    for at in reader.section("constants", parts):
        given = reader.given_entry(at, "constants")
        if given is not None:
            at.part.constants[reader.local_name(at)] = given.value
            continue
        name = reader.key_name(at, "constant", "value")
        many = isinstance(at.value, (list, tuple))
        for i, value in enumerate(at.value if many else [at.value]):
            result = reader.scalar(at, (i,) if many else (), value, "constants")
            if name is None or result is None:
                continue
            entry = f"{name}_{i + 1}" if many else name
            if not many or reader.new_name(at, entry, "value", "constant"):
                at.part.constants[at.part.written(entry)] = result.value


def read_parameters(reader: Reader) -> list[tuple[Parameter, Instance]]:
    result = []
    for at in reader.section("parameters"):
        given = reader.given_entry(at, "parameters")
        if given is not None:
            continue
        name = reader.key_name(at, "parameter", "value")
        if isinstance(at.value, dict):
            spec = reader.spec(ParameterEntry, at)
            unit = spec.unit if spec is not None else ""
            fields = {k: e for k in ("value", "min", "max") if (e := getattr(spec, k, None)) is not None}
            numbers = {k: reader.bound(e, at, (k,), "constants").value for k, e in fields.items()}
        else:
            unit = ""
            expression = reader.scalar(at, (), at.value, "constants")
            numbers = {} if expression is None else {"value": expression.value}
        if name is None:
            continue
        value = float(numbers.get("value", 0.0))
        low, high = (float(numbers[k]) if k in numbers else None for k in ("min", "max"))
        if low is not None and high is not None and low > high:
            reader.report(at, ("min",), f"min {low:g} is above max {high:g}; min may be at most max")
        elif (low is not None and value < low) or (high is not None and value > high):
            message = f"value {value:g} is outside min {_limit(low)} and max {_limit(high)}"
            reader.report(at, ("value",), message, severity="warning")
        reader.defaults[name] = value
        reader.allowed["parameters"][name] = None
        result.append((Parameter(name, value, unit, low, high), at))
    return result


def read_inputs(reader: Reader) -> None:
    for at, sub, item in reader.listed("inputs", "[motor, brake]"):
        try:
            local = name_of(parse_name(item), reader.numbers(at))
        except PydanticCustomError as error:
            reader.report(at, sub, str(error.message()))
            continue
        except ExpressionError as error:
            reader.report(at, sub, error.message)
            continue
        if reader.given(at, local, "inputs") is not None:
            continue
        name = at.part.name(local)
        if name in RESERVED:
            reader.report(at, sub, f"{name!r} is reserved and cannot name an input; choose another name")
        elif ("value", name) in reader.first_seen:
            taken = with_article(reader.first_seen["value", name])
            reader.report(at, sub, f"name {name!r} is already taken by {taken}; each name may be given once")
        else:
            reader.first_seen["value", name] = "input"
            reader.inputs.append(name)
            reader.allowed["inputs"][name] = None


def read_gravity(reader: Reader) -> Vector | None:
    at = reader.only("gravity")
    if at is None:
        return None
    value = at.value
    if not isinstance(value, (list, tuple)) or len(value) != 3:
        reader.report(at, (), f"{seen(value)}; three numbers are needed: [x, y, z], m/s^2 in the ground frame")
        return None
    x, y, z = (reader.scalar(at, (i,), v, "parameters") or ZERO for i, v in enumerate(value))
    return None if x is ZERO and y is ZERO and z is ZERO else (x, y, z)


def _limit(value: float | None) -> str:
    return "(none)" if value is None else f"{value:g}"
