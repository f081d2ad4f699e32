"""Which functions are compiled together, and when: those of nearly everybody at first, others when they are called.

The C stays one file, and compiled by hand it has everything. With the macro ``ORDERNM_LIBRARY`` it has the functions of one
library only, with ``ORDERNM_UNIT`` beside it a part of these: parts are compiled side by side and linked. Sweeps are static, so
each library has those that it needs and compilers drop the others. Of sweeps that are so long that they stand in parts, each
part is compiled in one unit and the other calls it: twice the same would be most of the time.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import Any

LIBRARIES = (
    "dynamics", "jacobians", "mass", "forces", "outputs", "states", "gradients", "motion", "four", "frames", "few",
)  # fmt: skip
"""Their names; the number in C is the place here and one. The first is compiled when a package is generated or loaded; of other
partitions each is compiled when it is called."""

FRAMES = "frames"
"""Functions for motions of bodies."""

FOUR = "four"
"""Functions for four directions, which motions call: ``NAME_four.c`` has them."""

FEW, FEW_DIRECTIONS = "few", (1, 2)
"""Functions of the first library over one and over two directions, which many users never call, and gcc would take a third
of its time for. The first library calls them when a solver has opened this one."""

_OF = {
    "accelerations": "dynamics", "sensitivities": "dynamics", "coordinate_rates": "dynamics", "closure": "dynamics",
    "conditions": "dynamics", "newton_step": "dynamics", "closing_step": "dynamics", "completion": "dynamics",
    "jacobians": "jacobians", "state_rates": "motion", "state_rate_sensitivities": "motion", "inverse_dynamics": "forces",
    "inverse_dynamics_sensitivities": "forces", "driving_forces": "forces", "driving_force_sensitivities": "forces",
    "energies": "outputs", "energy_sensitivities": "outputs", "outputs": "outputs",
    "output_sensitivities": "outputs", "switches": "motion", "switch_sensitivities": "motion",
}  # fmt: skip

_MOTION = ("closing_step", "completion", "completion_sensitivities", "conditions", "outputs", "output_sensitivities")
"""Functions that motions call, and which are in another library too."""

_ASKED_IN_MOTIONS = ("conditions", "completion_sensitivities")
"""Those of them that Python calls, while a motion changes its independent coordinates."""


def library_of(function: str) -> str:
    """The library that has a function as Python calls it."""
    if function in _OF:
        return _OF[function]
    if function.endswith("_transposed"):
        return "gradients"
    if function.startswith(("frame", "point_place")):
        return FRAMES
    return "mass" if "mass" in function else "states"


def _places(function: str, width: int | None) -> list[tuple[int, int]]:
    """Libraries and units, by number, that have a function for so many directions."""
    if width == 4:
        return [(number_of(FOUR), 1)]
    if width is not None and few_of(function, (width,)):
        return [(number_of(FEW), width)]
    unit = 1 if width in (None, 1) else 2
    found = [(number_of(library_of(function)), unit)]
    return [*found, (number_of("motion"), unit)] if function in _MOTION else found


def few_of(function: str, widths: Collection[int]) -> list[int]:
    """For how many directions at once a function is in another library than for many."""
    return sorted({*widths} & {*FEW_DIRECTIONS}) if library_of(function) == LIBRARIES[0] else []


def number_of(library: str) -> int:
    """What a library is called in C."""
    return LIBRARIES.index(library) + 1


def guard(function: str, widths: Sequence[int] = ()) -> str:
    """The condition of the preprocessor under which a function is compiled; over directions by the macro ``WIDTH``."""
    return _by_width({w: _condition(_places(function, w)) for w in widths or (None,)})


def guard_of_width(function: str, width: int | None) -> str:
    """The same for one width."""
    return guard(function, (width,) if width else ())


def guard_of_run(
    users: Mapping[int | None, Mapping[str, Collection[int]]],
    all_functions: Mapping[str, Collection[int]],
    in_all_units: bool,
) -> str:
    """The condition under which something that functions run is compiled; nothing if it always is.

    Parameters
    ----------
    users : mapping
        By width, None for what has no directions: functions that run it, and of these for how many directions at once.
    all_functions : mapping
        All functions of the solver, with their widths.
    in_all_units : bool
        Its parts are shared among the units of a library.
    """
    units = _units(all_functions)
    everywhere = {(n, u) for n in units for u in units[n]}

    def condition(functions: Mapping[str, Collection[int]]) -> str:
        found = _units(functions)
        places = {(n, u) for n in found for u in (units if in_all_units else found)[n]}
        return _condition(places) if places != everywhere else ""

    return _by_width({width: condition(functions) for width, functions in users.items()})


def _condition(places: Collection[tuple[int, int]]) -> str:
    """That one of these libraries and units is compiled."""
    return " || ".join(f"ORDERNM_HAS({n}, {u})" for n, u in sorted(places))


def _by_width(conditions: Mapping[int | None, str]) -> str:
    """A condition for each width as one by the macro ``WIDTH``; they are nothing where that is always met."""
    found: dict[str, list[int | None]] = {}
    for width, condition in conditions.items():
        found.setdefault(condition, []).append(width)
    if len(found) == 1:
        return next(iter(found))
    of_widths = [(c, " || ".join(f"WIDTH == {w}" for w in widths)) for c, widths in found.items()]
    return " || ".join(f"(({w}) && ({c}))" if c else f"({w})" for c, w in of_widths)


def sharing(users: Mapping[str, Collection[int]], all_functions: Mapping[str, Collection[int]]) -> str:
    """The condition under which two units of a library share parts of a sweep, by functions that run it and all, with widths.

    Elsewhere these parts are static: compilers drop them where nobody runs the sweep.
    """
    units = _units(all_functions)
    return f"ORDERNM_SHARED({sum(1 << n for n in _units(users) if len(units[n]) > 1):#x})"


def _units(functions: Mapping[str, Collection[int]]) -> dict[int, set[int]]:
    """Units of each library, by number, that have some of these functions."""
    found: dict[int, set[int]] = {}
    for name, widths in functions.items():
        for w in widths or (None,):
            for number, unit in _places(name, w):
                found.setdefault(number, set()).add(unit)
    return found


def guard_of_library(function: str) -> str:
    """The condition under which ``NAME_calls.c`` has the call of a function."""
    found = [library_of(function), *(["motion"] if function in _ASKED_IN_MOTIONS else [])]
    return _condition([(number_of(library), 0) for library in found])


def libraries(functions: Mapping[str, Any], divided: bool) -> dict[str, Any]:
    """What the manifest says: of each library its number, its units, its functions, and those of another one that can be called
    in it too; of that over few directions its functions and over how many these are.

    The second unit of the first library runs nearly all that the first one runs. Where no sweep is `divided` among the two,
    it is compiled in one piece: that takes no longer than the second unit alone.
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
