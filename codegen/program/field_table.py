"""The table of fields: the name of each component in generated code, and its field.

The mechanics lists its fields here once (`list_fields`); blocks may only use listed fields.
"""

from __future__ import annotations

import functools
import re
from collections.abc import Mapping

from .field import AnyField

_EXACT: dict[str, tuple[str, AnyField]] = {}
_FAMILIES: list[tuple[str, str, AnyField]] = []


def list_fields(fields: dict[str, AnyField], called: Mapping[str, str]) -> None:
    """Enter fields into the table, with their names in generated code.

    Parameters
    ----------
    fields : dict of str to Field
        Fields by name. If a field has several names, the first one is used.
    called : mapping of str to str
        Name in generated code where it differs from the field's name; ``{}`` stands for a number.
    """
    families: dict[str, tuple[str, AnyField]] = {}
    for name, field in reversed(fields.items()):
        field.listed = True
        field.called = called.get(name, f"{name.replace('.', '_')}{'_{}' * field.name.count('{}')}")
    for field in fields.values():
        for component, identified in zip(field.components, field.identifiers, strict=True):
            (families if "{}" in component else _EXACT).setdefault(component, (identified, field))
    _FAMILIES.extend((component, *found) for component, found in families.items())


@functools.cache
def _found(component: str) -> tuple[str, AnyField | None]:
    """Name in generated code of a component that is not a derivative, and its field if listed."""
    if component in _EXACT:
        return _EXACT[component]
    for family, called, field in _FAMILIES:
        start, *_, end = family.split("{}")
        if component.startswith(start) and component.endswith(end) and (match := _pattern(family).fullmatch(component)):
            return called.format(*match.groups()), field
    return component.replace(".", "_"), None


@functools.cache
def _pattern(family: str) -> re.Pattern[str]:
    """Pattern for the components of a family of fields, whose numbers are its groups. A model uses few families."""
    return re.compile(re.escape(family).replace(r"\{\}", r"(\d+|[AB])"))


@functools.cache
def identifier(component: str) -> str:
    """Name of a component in generated code.

    Examples
    --------
    ``w.y`` is ``omega_y``, ``Z3.w.x`` is ``per_source_3_omega_x``, and ``h.x/1``, a constant's derivative with respect to one of
    its
    parameters, ``first_moment_x_d1``.
    """
    plain, _, parameter = component.partition("/")
    return f"{_found(plain)[0]}_d{parameter.replace('/', '_d')}" if parameter else _found(plain)[0]


def field_of(component: str) -> AnyField | None:
    """The field or family of fields to which a component belongs; None if it is not listed."""
    return _found(component.partition("/")[0])[1]
