"""The types of force elements, one file each.

A law along the line between two points needs one file in `line_laws`, and nothing else. Any other type needs a class of
entries, a class of the elements that they make, and a place in `FORCES`. `reference.forces` and the generator implement
it.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final, get_args

from .along_line import ALONG_LINES, ENTRIES, AlongLine
from .bushing import Bushing, BushingEntry
from .force_element import ForceElement, ForceEntry
from .in_joint import FrictionEntry, InJointEntry, JointForce, JointForceEntry, JointLoad, LimitEntry
from .line_law import LineLaw, LineLawError
from .line_laws import LINE_LAWS
from .on_body import Force, ForceOnBodyEntry, Torque, TorqueEntry
from .spring import Spring, SpringEntry
from .torsion import Torsion, TorsionEntry

__all__ = [
    "ALONG_LINES",
    "FORCES",
    "OTHER_WORDS",
    "AlongLine",
    "Bushing",
    "Force",
    "ForceElement",
    "ForceEntry",
    "InJointEntry",
    "JointForce",
    "JointLoad",
    "Spring",
    "Torque",
    "Torsion",
    "other_words",
    "told_apart",
]


def told_apart(*entries: type[ForceEntry]) -> tuple[type[ForceEntry], ...]:
    """The given entries, after a check that no two of them have the same type.

    Raises
    ------
    LineLawError
        If two have the same type: that of a law in `line_laws` is already used.
    """
    words: set[str] = set()
    for entry in entries:
        (word,) = get_args(entry.model_fields["type"].annotation)
        if word in words:
            taken = ", ".join(str(get_args(e.model_fields["type"].annotation)[0]) for e in entries)
            raise LineLawError(
                f"two types of force elements are called {word!r}; rename the law and its file; used names are {taken}"
            )
        words.add(word)
    return entries


FORCES: Final[tuple[type[ForceEntry], ...]] = told_apart(
    JointForceEntry,
    SpringEntry,
    ForceOnBodyEntry,
    TorqueEntry,
    TorsionEntry,
    BushingEntry,
    FrictionEntry,
    LimitEntry,
    *ENTRIES,
)

_WORDS: Final = {
    "body": "force",
    "point": "force",
    "wrench": "force",
    "moment": "torque",
    "damper": "spring",
    "motor": "joint",
    "bush": "bushing",
}


def other_words(laws: Mapping[str, LineLaw]) -> dict[str, str]:
    """Type names used by other programs, with the names used here; names of the laws included.

    Raises
    ------
    LineLawError
        If a law claims a name that is already used.
    """
    types = {str(get_args(e.model_fields["type"].annotation)[0]) for e in FORCES}
    found = dict(_WORDS)
    for law in laws.values():
        for word in law.other_words:
            if word in types or word in found:
                where = "is a type" if word in types else f"already stands for {found[word]!r}"
                raise LineLawError(f"{law.type}: other_words has {word!r}, which {where}; remove it")
            found[word] = law.type
    return found


OTHER_WORDS: Final = other_words(LINE_LAWS)
"""Type names used by other programs, with the names used here."""
