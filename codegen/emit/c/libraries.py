"""Partition of the functions into libraries: common functions are compiled first, others when they are called.

The C is one file; without macros it compiles all functions. The macro ``ORDERNM_LIBRARY`` selects the functions of one library,
and ``ORDERNM_UNIT`` a part of them; such units are compiled in parallel and linked. Sweeps are static, so each library contains
the sweeps that it needs, and compilers drop the others. Long sweeps are divided into parts. Each part is compiled in one unit and
called from the other units, because compiling it again in each unit would take most of the compile time.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import Any

LIBRARIES = (
    "dynamics", "jacobians", "mass", "forces", "outputs", "states", "gradients", "motion", "four", "frames", "few",
)  # fmt: skip
"""Names of the libraries; in C, their numbers begin at 1. The first is compiled when a package is generated or loaded, the others
when one of their functions is called."""

FRAMES = "frames"
"""Name of the library with the functions for motions of bodies."""

FOUR = "four"
"""Name of the library with functions for four directions, which integration uses: ``NAME_four.c``."""

FEW, FEW_DIRECTIONS = "few", (1, 2)
"""Functions of the first library over one and two directions. They are in a separate library, because many users never
call them and gcc would spend a third of its time on them. Once a solver has opened this library, the first library calls
its functions."""

_OF = {
    "accelerations": "dynamics", "sensitivities": "dynamics", "coordinate_rates": "dynamics", "closure": "dynamics",
    "conditions": "dynamics", "newton_step": "dynamics", "closing_step": "dynamics", "completion": "dynamics",
    "jacobians": "jacobians", "state_rates": "motion", "state_rate_sensitivities": "motion", "inverse_dynamics": "forces",
    "inverse_dynamics_sensitivities": "forces", "driving_forces": "forces", "driving_force_sensitivities": "forces",
    "energies": "outputs", "energy_sensitivities": "outputs", "outputs": "outputs",
    "output_sensitivities": "outputs", "switches": "motion", "switch_sensitivities": "motion",
}  # fmt: skip

_MOTION = ("closing_step", "completion", "completion_sensitivities", "conditions", "outputs", "output_sensitivities")
"""Functions for integration that another library contains as well."""

_ASKED_IN_MOTIONS = ("conditions", "completion_sensitivities")
"""Those functions of `_MOTION` that Python also calls, when a motion changes its independent coordinates."""


def library_of(function: str) -> str:
    """The library of a function that Python calls."""
    if function in _OF:
        return _OF[function]
    if function.endswith(("_transposed", "hessian_products", "gradient_tangents")):
        return "gradients"
    if function.startswith(("frame", "point_place")):
        return FRAMES
    return "mass" if "mass" in function else "states"


def _places(function: str, width: int | None) -> list[tuple[int, int]]:
    """Libraries and units, by number, that contain a function for a number of directions."""
    if width == 4:
        return [(number_of(FOUR), 1)]
    if width is not None and few_of(function, (width,)):
        return [(number_of(FEW), width)]
    unit = 1 if width in (None, 1) else 2
    found = [(number_of(library_of(function)), unit)]
    return [*found, (number_of("motion"), unit)] if function in _MOTION else found


def few_of(function: str, widths: Collection[int]) -> list[int]:
    """Numbers of directions for which the library `FEW` contains a function."""
    return sorted({*widths} & {*FEW_DIRECTIONS}) if library_of(function) == LIBRARIES[0] else []


def number_of(library: str) -> int:
    """Number of a library, as C code uses it."""
    return LIBRARIES.index(library) + 1


def guard(function: str, widths: Sequence[int] = ()) -> str:
    """The preprocessor condition under which a function is compiled; over directions it depends on the macro ``WIDTH``."""
    return _by_width({w: _condition(_places(function, w)) for w in widths or (None,)})


def guard_of_width(function: str, width: int | None) -> str:
    """The preprocessor condition under which a function for one width is compiled."""
    return guard(function, (width,) if width else ())


def guard_of_run(
    users: Mapping[int | None, Mapping[str, Collection[int]]],
    all_functions: Mapping[str, Collection[int]],
    in_all_units: bool,
) -> str:
    """The condition for the compilation of code that functions run; empty if it is always compiled.

    Parameters
    ----------
    users : mapping
        By width (None without directions): the functions that run it, with their own widths.
    all_functions : mapping
        All functions of the solver, with their widths.
    in_all_units : bool
        Whether the parts of this code are shared among the units of a library.
    """
    units = _units(all_functions)
    everywhere = {(n, u) for n in units for u in units[n]}

    def condition(functions: Mapping[str, Collection[int]]) -> str:
        found = _units(functions)
        places = {(n, u) for n in found for u in (units if in_all_units else found)[n]}
        return _condition(places) if places != everywhere else ""

    return _by_width({width: condition(functions) for width, functions in users.items()})


def _condition(places: Collection[tuple[int, int]]) -> str:
    """The condition that one of these libraries and units is compiled."""
    return " || ".join(f"ORDERNM_HAS({n}, {u})" for n, u in sorted(places))


def _by_width(conditions: Mapping[int | None, str]) -> str:
    """One condition with the macro ``WIDTH``, from conditions for each width; empty if it always holds."""
    found: dict[str, list[int | None]] = {}
    for width, condition in conditions.items():
        found.setdefault(condition, []).append(width)
    if len(found) == 1:
        return next(iter(found))
    of_widths = [(c, " || ".join(f"WIDTH == {w}" for w in widths)) for c, widths in found.items()]
    return " || ".join(f"(({w}) && ({c}))" if c else f"({w})" for c, w in of_widths)


def sharing(users: Mapping[str, Collection[int]], all_functions: Mapping[str, Collection[int]]) -> str:
    """The condition under which two units of a library share the parts of a sweep.

    The condition follows from the functions that run the sweep, and from all functions, with their widths. Otherwise
    the parts are static, and compilers drop them where the sweep is not run.
    """
    units = _units(all_functions)
    return f"ORDERNM_SHARED({sum(1 << n for n in _units(users) if len(units[n]) > 1):#x})"


def _units(functions: Mapping[str, Collection[int]]) -> dict[int, set[int]]:
    """Units of each library, by number, that contain at least one of these functions."""
    found: dict[int, set[int]] = {}
    for name, widths in functions.items():
        for w in widths or (None,):
            for number, unit in _places(name, w):
                found.setdefault(number, set()).add(unit)
    return found


def guard_of_library(function: str) -> str:
    """The condition under which ``NAME_calls.c`` contains the call of a function."""
    found = [library_of(function), *(["motion"] if function in _ASKED_IN_MOTIONS else [])]
    return _condition([(number_of(library), 0) for library in found])


def libraries(functions: Mapping[str, Any], divided: bool) -> dict[str, Any]:
    """The entry ``libraries`` of the manifest: for each library its number, its compile units, its functions, and functions
    that another library contains as well. The library over few directions lists the widths of its functions.

    The functions of the second unit of the first library run almost all sweeps that those of the first unit run. If no sweep
    is `divided` between the two, the library is compiled as one unit, which takes no longer than the second unit alone.
    """
    found: dict[str, dict[str, Any]] = {}
    units = _units({name: f.get("widths", ()) for name, f in functions.items()})
    for name in functions:
        library = library_of(name)
        found.setdefault(library, {"number": number_of(library), "units": [], "functions": []})["functions"].append(
            name
        )
    apart = {name: few_of(name, f.get("widths", ())) for name, f in functions.items()}
    if any(apart.values()):
        over_few = {name: few for name, few in apart.items() if few}
        found[FEW] = {"number": number_of(FEW), "units": [], "functions": [], "over_few": over_few}
    for entry in found.values():
        in_one = entry["number"] == 1 and not divided
        entry["units"] = [] if in_one else sorted(units[entry["number"]])
    if "motion" in found and (too := [name for name in _ASKED_IN_MOTIONS if name in functions]):
        found["motion"]["too"] = too
    return {name: found[name] for name in LIBRARIES if name in found}


__all__ = [
    "FOUR", "FRAMES", "LIBRARIES", "few_of", "guard", "guard_of_library", "guard_of_run", "guard_of_width", "libraries",
    "library_of", "number_of", "sharing",
]  # fmt: skip
