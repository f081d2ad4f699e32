"""The types of force elements, a file each.

A law along the line between two points is a file of `line_laws`, and nothing more. Any other type is an entry here, the
element that it makes, and a place in this list; what it does stands in `reference.forces` and in the generator.
"""

from __future__ import annotations

from typing import Final, get_args

from .along_line import ALONG_LINES, ENTRIES, AlongLine
from .along_line import OTHER_WORDS as OTHER_WORDS_OF_LAWS
from .force import Force, ForceOnBodyEntry
from .force_element import ForceElement, ForceEntry
from .joint_force import JointForce, JointForceEntry
from .line_law import LineLawError
from .spring import Spring, SpringEntry
from .torque import Torque, TorqueEntry
from .torsion import Torsion, TorsionEntry

__all__ = [
    "ALONG_LINES",
    "FORCES",
    "OTHER_WORDS",
    "AlongLine",
    "Force",
    "ForceElement",
    "ForceEntry",
    "JointForce",
    "Spring",
    "Torque",
    "Torsion",
]


def told_apart(*entries: type[ForceEntry]) -> tuple[type[ForceEntry], ...]:
    """Entries no two of which have the same type.

    Raises
    ------
    LineLawError
        Two have: the word of one of the laws of `line_laws` is taken.
    """
    words: set[str] = set()
    for entry in entries:
        (word,) = get_args(entry.model_fields["type"].annotation)
        if word in words:
            raise LineLawError(
                f"two types of force elements are called {word!r}; call the law, and its file, otherwise"
            )
        words.add(word)
    return entries


FORCES: Final[tuple[type[ForceEntry], ...]] = told_apart(
    JointForceEntry,
    SpringEntry,
    ForceOnBodyEntry,
    TorqueEntry,
    TorsionEntry,
    *ENTRIES,
)

OTHER_WORDS: Final = {
    "body": "force",
    "point": "force",
    "wrench": "force",
    "moment": "torque",
    "damper": "spring",
    "motor": "joint",
    **OTHER_WORDS_OF_LAWS,
}
"""What some call them elsewhere, and what they are called here."""
