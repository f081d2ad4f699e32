"""Types of rows of memory in C: names and declarations."""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Iterable

from ...program.field import AnyField
from ...program.field_table import field_of, identifier
from ...records import dataclass

TYPES = {
    "records": "link_record", "slots": "link_slot", "lanes": "link_lanes", "ears": "ear_record",
    "regions": "region_record", "region_lanes": "region_lanes", "couplings": "coupling_block", "kept": "link_kept",
    "kept_regions": "region_kept", "columns": "link_columns",
    "tangents": "link_tangents", "adjoints": "link_adjoints", "adjoint_tangents": "link_adjoint_tangents",
    "mass_tangents": "link_mass_tangents", "adjoint_changes": "link_adjoint_changes", "kept_adjoints": "link_kept_adjoints",
}  # fmt: skip
"""Type name of a row of each region of memory."""

ABOUT = {
    "records": "Values of a link in one call.", "ears": "Values of an ear of loops in one call.",
    "regions": "Values of a region of loops in one call.", "couplings": "The coupling of two links in one call.",
    "kept": "Scalars of a link that backward sweeps read again.",
    "kept_regions": "Scalars of a region that backward sweeps read again.",
    "lanes": "Values of a link per direction.", "region_lanes": "Values of a region of loops per direction.",
    "columns": "Values of a link per column of a matrix.",
    "tangents": "Tangents of a link's values per direction.",
    "adjoints": "Adjoints of a link's values, for one vector of weights.", "kept_adjoints": "Copies of some of them.",
    "adjoint_tangents": "Tangents of these adjoints per direction.",
    "mass_tangents": "The part of these tangents that the mass matrix determines.",
    "adjoint_changes": "Changes of these tangents with multipliers of loops.",
    "slots": "Values per direction that neighbouring links exchange: scratch memory of each sweep.",
}  # fmt: skip
"""Description of the memory in each region, for comments of generated code."""

ENERGIES = ("KINETIC", "POTENTIAL")
"""Names of the entries in the array of energies."""

TWICE = ("tangents", "adjoint_tangents", "mass_tangents", "adjoint_changes")
"""Regions of functions with second derivatives that hold one value for every direction."""

LANE_REGIONS = ("slots", "lanes", "region_lanes", "columns", *TWICE)
"""Regions that hold one value for every direction."""


NUMBER_TYPE = "number"
"""Element type of tables of numbers: a single number, even if the type of values is a vector with several states."""

UNUSED_WORK = ["(void)work;"]
"""Statement that marks the workspace as unused in a function that needs no memory."""

MEMBERS, COMMENTED = 100, 120
"""Longest line of struct members, without and with a comment."""


SHARES = {1: 3, 2: 2}
"""The ratio in which the lines of long functions are divided among the compile units of a library. The second unit gets
fewer, because it contains more functions over directions."""


@dataclass(frozen=True, slots=True)
class Type:
    """A type of rows of memory: description, struct or union, member lines, name."""

    about: str
    kind: str
    lines: list[str]
    name: str


def near_name(sweep: str, component: str) -> str:
    """Name of a component in the scratch that neighbouring links share."""
    return f"{sweep}_{identifier(component)}".upper()


def members(
    components: Iterable[str], type_: str, end: str = ";", called: Callable[[str], str] = identifier
) -> list[str]:
    """Lines of a struct or an enum: the components of each field on a line, with the meaning of the field."""
    found: list[tuple[AnyField | None, list[str]]] = []
    for component in components:
        field = field_of(component)
        if not found or found[-1][0] is not field:
            found.append((field, []))
        found[-1][1].append(called(component))
    lines = []
    for field, names in found:
        listed = f"{type_} {', '.join(names)}{end}".strip()
        lines += [listed] if len(listed) <= MEMBERS else textwrap.wrap(listed, MEMBERS, subsequent_indent="    ")
        if field is not None:
            unit = "" if field.unit in ("", "1") else f", {field.unit.replace('*/', '* /')}"
            comment = f"/* {field.meaning}{unit} */"
            if len(lines[-1]) + len(comment) <= COMMENTED:
                lines[-1] += f" {comment}"
            else:
                lines.append(f"    {comment}")
    return lines


def of_width(name: str, lanes: bool) -> str:
    return f"DIRECTIONS({name})" if lanes else name


def cast(region: str) -> str:
    """The cast from an array of numbers to the type of a region of memory."""
    return f"({TYPES[region]} *)" if region in TYPES else ""
