"""Cases of a sweep and their results: names with plain values, which can be written to files and sent to other machines."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

Case = dict[str, Any]
"""Names with numbers, words or truth values."""


def listed(cases: Any) -> list[Case]:
    """Convert given cases to a list of cases.

    Parameters
    ----------
    cases : iterable of mappings, mapping of names to values or (n,), or pandas.DataFrame
        In a mapping of columns, a single value applies to all cases.

    Raises
    ------
    TypeError, ValueError
        If cases have another type or different names, or columns have different lengths.
    """
    if hasattr(cases, "to_dict") and hasattr(cases, "columns"):  # a table of pandas or polars
        cases = {str(name): np.asarray(cases[name]) for name in cases.columns}
    if isinstance(cases, Mapping):
        cases = _rows(cases)
    elif isinstance(cases, str) or not isinstance(cases, Iterable):
        raise TypeError(f"cases is {type(cases).__name__}, expected mappings, a mapping of columns or a DataFrame")
    found: list[Case] = []
    for i, case in enumerate(cases):
        if not isinstance(case, Mapping):
            raise TypeError(f"case {i} is {case!r}, expected a mapping of names to values such as {{'length': 0.3}}")
        found.append({_name(name, i): _plain(x, f"case {i}: {name}") for name, x in case.items()})
        if found[i].keys() != found[0].keys():
            odd = sorted(found[i].keys() ^ found[0].keys())
            raise ValueError(
                f"case {i} differs from case 0 in the names {', '.join(odd)}; all cases must have the same names"
            )
    return found


def key(case: Case) -> str:
    """A key for a case, independent of the order of its names."""
    return json.dumps(case, sort_keys=True)


def flattened(measured: Any) -> Case:
    """The result of a measure as one row: an array (n,) of name x becomes x[0], ..., x[n-1].

    Raises
    ------
    TypeError
        If the result is not a mapping of names to numbers, words, truth values and arrays of them.
    """
    if not isinstance(measured, Mapping):
        raise TypeError(f"measure returned {type(measured).__name__}, expected a mapping such as {{'time': 1.2}}")
    row: Case = {}
    for name, value in measured.items():
        if not isinstance(name, str):
            raise TypeError(f"measure returned a mapping with the name {name!r}, expected strings as names")
        several = np.asarray(value)
        if several.ndim == 0:
            row[name] = _plain(value, f"measure returned {name}, which")
            continue
        for place in np.ndindex(several.shape):
            inside = f"{name}[{', '.join(map(str, place))}]"
            row[inside] = _plain(several[place], f"measure returned {inside}, which")
    return row


def _rows(columns: Mapping[Any, Any]) -> list[Case]:
    sizes = {str(name): len(np.asarray(x)) for name, x in columns.items() if np.ndim(x) == 1}
    deep = [str(name) for name, x in columns.items() if np.ndim(x) > 1]
    if deep:
        raise ValueError(f"cases: {', '.join(deep)} has more than one axis, expected values and (n,)")
    if not sizes:
        raise ValueError(
            "cases: no name has several values; give an array such as {'length': [0.2, 0.3]}, or [{...}] for one case"
        )
    if len(set(sizes.values())) > 1:
        raise ValueError(f"cases: numbers of values differ: {', '.join(f'{name} {n}' for name, n in sizes.items())}")
    n = next(iter(sizes.values()))
    return [{name: np.asarray(x)[i] if str(name) in sizes else x for name, x in columns.items()} for i in range(n)]


def _name(name: Any, i: int) -> str:
    if not isinstance(name, str):
        raise TypeError(f"case {i} has the name {name!r}, expected strings as names")
    return name


def _plain(value: Any, what: str) -> Any:
    """A number, word or truth value as a Python object."""
    if isinstance(value, np.generic) or (isinstance(value, np.ndarray) and value.ndim == 0):
        value = value.item()
    if value is None or isinstance(value, (bool, int, float, str)):
        return value
    raise TypeError(f"{what} is {value!r}, expected a number, a string or a truth value")


__all__ = ["Case", "flattened", "key", "listed"]
