"""Forces that prescribed motion requires, from the forces that joints transmit; for second derivatives."""

from __future__ import annotations

from ...program.block import Scope
from ...program.field import SixField
from ...program.scalar import Value
from .. import fields
from ..rotors import driven_rotor
from ..spatial import SIX
from ..stores import DRIVING, HELD, ME
from ..structure.kinds import LinkKind


def driving(x: Scope, kind: LinkKind) -> None:
    """Outward block of a link with prescribed motion: the driving force in a tree. Eqs. 45, 53."""
    _store(x, kind, (fields.total_needed, fields.transmitted), 0)


def driving_in_loops(x: Scope, kind: LinkKind) -> None:
    """Outward block of a link with prescribed motion: the driving force, with the wrenches of loops and the forces of
    couplings. Eqs. 9, 45."""
    parts = (fields.total_needed, fields.closing_force, fields.tree_transmitted)
    _store(x, kind, parts, x.load(ME, fields.coupling_force(0)))


def _store(x: Scope, kind: LinkKind, parts: tuple[SixField, ...], coupled: Value) -> None:
    """Store the force along the prescribed coordinate, without the model's own force on it."""
    column = kind.joint(x, kind).all_columns[0]
    phi = [x.let("phi", sum(x.load(ME, field.scalars()[i]) for field in parts), "Eq. 45") for i in SIX]
    own: Value = x.entry(HELD, 0) if kind.held else 0
    x.set_entry(DRIVING, 0, x.let("driving", column.along(phi) + coupled + driven_rotor(x, kind) - own, "Eq. 53"))
