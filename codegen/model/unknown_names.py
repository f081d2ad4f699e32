"""Messages about names in expressions that are unknown or not allowed."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any, Final, Protocol

from .errors import nearest
from .grammar import MEASURED
from .parts import Instance
from .positions import Path_
from .problems import existing_path
from .surfaces import AS_WRITTEN

ALLOWED: Final = {
    "constants": "numbers and constants",
    "parameters": "numbers, constants and parameters",
    "equations": "numbers, constants, parameters and the coordinates x, y and z of the point",
    "inputs": "numbers, constants, parameters, inputs and t",
    "motion": "numbers, constants, parameters, inputs, t, q.NAME and u.NAME",
}
"""Names allowed in expressions of each scope, in words."""


class Known(Protocol):
    """The known names that messages need; see `reading.Reader`."""

    allowed: dict[str, dict[str, None]]
    inputs: list[str]
    defaults: dict[str, float]
    points: list[Mapping[str, Any]]

    def loop_hint(self, name: str) -> str:
        """A hint if a loop is taken for a joint."""


def is_measured(name: str) -> bool:
    """Whether a name is the position or velocity of a point."""
    return name.startswith(tuple(f"{what}." for what in MEASURED))


def unknown_name(reader: Known, name: str, scope: str, at: Instance) -> str:
    """Message about a name that is not allowed in an expression of a scope."""
    everything = reader.allowed["motion"]
    if name.lower() in ("nan", "inf", "infinity"):
        return f"{name} is not a finite number; only finite numbers are allowed"
    if is_measured(name):
        return _not_measured(reader, name, scope)
    if name in everything or name == "t" or (name[:2] in ("q.", "u.") and scope not in ("motion", "measured")):
        kind = "input" if name in reader.inputs else "parameter" if name in reader.defaults else "motion"
        what = {
            "input": f"input {name!r}",
            "parameter": f"parameter {name!r}",
            "motion": f"{name!r}, which changes with the motion,",
        }[kind]
        return f"{what} is not allowed here; only {ALLOWED[scope]} are"
    if name[:2] in ("q.", "u."):
        what = "coordinate" if name[0] == "q" else "speed"
        names = [n for n in everything if n[:2] == name[:2]]
        joint = [n for n in names if n.startswith(name + ".")]
        if joint:
            return f"{name} has several degrees of freedom; write one of {', '.join(sorted(joint))}"
        hint = reader.loop_hint(name[2:]) or nearest(name, names)
        return f"unknown {what} {name!r}; the joints of this model have {some(names)}{hint}"
    those = reader.allowed["motion" if scope == "measured" else scope]
    known = [n for n in at.part.constants if n[0] != "'" and "." not in n]
    known += at.part.own(n for n in those if n[:2] not in ("q.", "u."))
    known += AS_WRITTEN if scope == "equations" else ()
    name = at.part.written(name)
    which = "constants written before it" if scope == "constants" else "known here"
    return f"unknown name {name!r}; {which}: {some(known)}{nearest(name, known)}"


def _not_measured(reader: Known, name: str, scope: str) -> str:
    """Message about the position or velocity of a point."""
    if scope != "measured":
        return (
            f"{name!r}, which changes with the motion, is not allowed here; only {ALLOWED[scope]} are; positions and "
            f"velocities of points are allowed in forces in joints, and in forces on bodies without potential energy"
        )
    point, known = name.split(".")[1], [n for names in reader.points for n in names]
    return f"unknown point {point!r} in {name}; a point or a body is allowed: {some(known)}{nearest(point, known)}"


def column_of(at: Instance, sub: Path_, name: str) -> int | None:
    """Column at which a name begins in the text at a path, counted from 1."""
    value: Any = at.container
    for part in existing_path(value, (at.key, *sub)):
        value = value[part]
    if not isinstance(value, str):
        return None
    name = at.part.written(name)
    start = value.find(name)
    while start >= 0:  # no regular expression, because compiling it for each name would take most of the time
        end = start + len(name)
        around = value[max(start - 1, 0) : start] + value[end : end + 1]
        if not any(c.isalnum() or c in "_." for c in around):
            return start + 1
        start = value.find(name, end)
    return None


def some(names: Iterable[str]) -> str:
    """The first names of a list; a long list is followed by its number of names."""
    listed = list(names)
    text = ", ".join(listed[:12])
    return (f"{text}, ... ({len(listed)} in all)" if len(listed) > 12 else text) or "(none)"
