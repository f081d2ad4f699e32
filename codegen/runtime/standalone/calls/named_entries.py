"""Variables of differentiation by name: parameters, initial values, inputs, and single values of inputs."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from ..arrays import Array
from .arguments import name_or_names, some, unknown


class Entry(NamedTuple):
    """The variable that a name denotes.

    Attributes
    ----------
    of : {"p", "q", "u", "inputs"}
        Parameters, initial coordinates or speeds, or inputs.
    at : int
        Its index among these parameters, coordinates, speeds or inputs.
    row : int or None
        Index among an input's values; None for all of them, and for variables other than inputs.
    """

    of: str
    at: int
    row: int | None = None


class Names(NamedTuple):
    """The names of a model; if it lacks names of coordinates and speeds, initial values have no names."""

    parameters: Sequence[str]
    inputs: Sequence[str]
    coordinates: Sequence[str] = ()
    speeds: Sequence[str] = ()
    independent: Sequence[str] = ()
    independent_speeds: Sequence[str] = ()


def names_of(solver: Any) -> Names:
    """The variables with respect to which a motion can be differentiated."""
    return Names(
        solver.parameter_names, solver.signal_names, solver.coordinate_names, solver.speed_names,
        solver.independent_names, solver.independent_speed_names,
    )  # fmt: skip


def apart(names: Names, asked: Sequence[Any]) -> tuple[Any, ...]:
    """Replaces the name of a vector, or of a joint of several degrees of freedom, by the names of its entries.

    ``hard_point`` becomes ``hard_point.x``, ``hard_point.y``, ``hard_point.z``; ``q0.JOINT`` becomes the names of the joint's
    independent coordinates.
    """
    found: list[Any] = []
    parameters = set(names.parameters)
    for name in asked:
        parts = () if not isinstance(name, str) or name in parameters else _entries(names, name)
        found.extend(parts or (name,))
    return tuple(found)


def _entries(names: Names, name: str) -> tuple[str, ...]:
    """The names that begin with `name` and a dot, unless `name` is itself a variable."""
    kind, _, of = name.partition(".")
    initial = {"q0": names.independent, "u0": names.independent_speeds}
    if kind not in initial:
        return tuple(n for n in names.parameters if n.startswith(f"{name}."))
    known = names.coordinates if kind == "q0" else names.speeds
    return () if of in known or not of else tuple(f"{kind}.{n}" for n in initial[kind] if n.startswith(f"{of}."))


def look_up(names: Names, asked: Any, values: Sequence[int] | None = None) -> Entry:
    """The variable with this name: a parameter, ``q0.NAME``, ``u0.NAME``, ``inputs.NAME``, ``inputs.NAME[i]``.

    `values` are the numbers of values of the inputs, or None if single values have no names.

    Raises
    ------
    ValueError
        If the name is not known; the message names the most similar one.
    """
    if asked in names.parameters:
        return Entry("p", names.parameters.index(asked))
    found = _initial_or_input(names, asked, values) if isinstance(asked, str) else None
    if found is not None:
        return found
    known = [
        *names.parameters, *(f"q0.{n}" for n in names.independent), *(f"u0.{n}" for n in names.independent_speeds),
        *(f"inputs.{n}" for n in names.inputs),
    ]  # fmt: skip
    raise unknown("sensitivities", asked, known)


def _initial_or_input(names: Names, asked: str, values: Sequence[int] | None) -> Entry | None:
    kind, _, of = asked.partition(".")
    for word, place, among, independent in (
        ("q0", "q", names.coordinates, names.independent),
        ("u0", "u", names.speeds, names.independent_speeds),
    ):
        if kind == word and of in among:
            if of not in independent:
                raise ValueError(f"sensitivities: {asked} is dependent; name an independent one: {some(independent)}")
            return Entry(place, among.index(of))
    entry = re.fullmatch(r"inputs\.(.+?)(?:\[(\d+)\])?", asked)
    if not entry or entry[1] not in names.inputs or (entry[2] is not None and values is None):
        return None
    at = names.inputs.index(entry[1])
    if entry[2] is not None and values is not None and int(entry[2]) >= values[at]:
        raise ValueError(
            f"sensitivities: {asked}: the input has {values[at]} value{'s' * (values[at] > 1)}, counted from 0"
            if values[at]
            else f"sensitivities: {asked}: the input is a function of time without single values; give (times, values)"
        )
    return Entry("inputs", at, None if entry[2] is None else int(entry[2]))


def look_up_all(names: Names, asked: Sequence[Any], values: Sequence[int]) -> list[Entry]:
    """Looks up several names, which must differ.

    Raises
    ------
    ValueError
    """
    if len(set(asked)) < len(asked):
        raise ValueError(f"sensitivities contain a name twice: {some(asked)}")
    places = {name: i for i, name in enumerate(names.parameters)}
    found = []
    for name in asked:
        if not isinstance(name, str):
            raise ValueError(f"sensitivities contain {name!r}, expected names such as 'length' or 'q0.crank'")
        found.append(Entry("p", places[name]) if name in places else look_up(names, name, values))
    return found


class Named(NamedTuple):
    """Unit seeds of k entries of parameters (k, np) and inputs (k, ninputs), and the names of these entries."""

    names: tuple[str, ...]
    p: Array
    inputs: Array


def seeds_by_name(asked: str | Sequence[str], parameters: Sequence[str], inputs: Sequence[str]) -> Named:
    """Unit seeds of parameters, and of inputs as ``inputs.motor``.

    Raises
    ------
    ValueError
        If a name is not known; the message names the most similar one.
    """
    known = Names(parameters, inputs)
    names = apart(known, name_or_names("sensitivities", asked))
    found = Named(names, np.zeros((len(names), len(parameters))), np.zeros((len(names), len(inputs))))
    for row, entry in enumerate(look_up(known, name) for name in names):
        (found.p if entry.of == "p" else found.inputs)[row, entry.at] = 1.0
    return found
