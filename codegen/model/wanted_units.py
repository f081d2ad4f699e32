"""Dimensions required at the places of a model file, for comparison with the units of numbers."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final, get_args

from .forces import FORCES, InJointEntry
from .joints import JOINTS
from .positions import Path_
from .units import Dimension, unit_of

_BY_KEY: Final = {
    **dict.fromkeys(("at", "com", "center", "size", "radii", "length", "radius"), "m"),
    **dict.fromkeys(("xx", "yy", "zz", "xy", "xz", "yz"), "kg*m**2"),
    **dict.fromkeys(("rpy", "angle"), "rad"),
    **{"mass": "kg", "pitch": "m/rad", "gravity": "m/s**2"},
}
_BY_FORCE: Final[dict[str, Mapping[str, str]]] = {
    str(get_args(entry.model_fields["type"].annotation)[0]): entry.units for entry in FORCES
}
IN_JOINTS: Final[dict[str, Mapping[str, tuple[str, str]]]] = {
    "joint": {"value": ("N*m", "N")},
    **{
        str(get_args(entry.model_fields["type"].annotation)[0]): entry.units_in_joint
        for entry in FORCES
        if issubclass(entry, InJointEntry)
    },
}
"""Units of the numbers of forces in joints, by type and key: in a revolute joint, and in a prismatic one."""


def unit_wanted(section: str, path: Path_, entry: Any) -> Dimension | None:
    """The dimension of the number at a path of an entry; None if any dimension is allowed."""
    keys = [k for k in path if isinstance(k, str)]
    if keys[:1] == ["with"]:  # numbers given to a submodel have the names of its own numbers
        return None
    key = keys[-1] if keys else section
    type_ = entry.get("type") if isinstance(entry, dict) else None
    if section == "forces" and len(keys) == 1:
        unit = _BY_FORCE.get(str(type_), {}).get(key)
    elif key == "armature":
        unit = _unit_of_armature(path, entry)
    elif key == "density":
        shape = entry.get("shape") if isinstance(entry, dict) else None
        unit = "kg/m" if isinstance(shape, dict) and shape.get("type") == "rod" else "kg/m**3"
    else:
        unit = _BY_KEY.get(key)
    return None if unit is None else dimension_of_unit(unit)


def _unit_of_armature(path: Path_, entry: Any) -> str | None:
    """Unit of a rotor's reflected inertia on a revolute or prismatic joint."""
    joint = entry.get("joint") if isinstance(entry, dict) else None
    kind = JOINTS.get(str(joint.get("type"))) if isinstance(joint, dict) else None
    units = kind.armature_units() if kind is not None else ()
    place = path[-1] if isinstance(path[-1], int) else 0
    return units[place][1] if place < len(units) else None


def dimension_of_unit(text: str) -> Dimension | None:
    """Dimension of a unit as it is written in the source code: ``N s/m``, ``N/m^3``."""
    found = unit_of(text.replace(" ", "*"))
    return None if found is None else found[1]
