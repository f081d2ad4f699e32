"""Symbols for quantities in statements: memory, and arguments and results by their names in the model."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import sympy

from ..mechanics.stores import (
    BASE_LINK,
    CONSTANTS,
    ELEMENT_END,
    LINK,
    PARAMETER,
    PARENT,
    PARTNER,
    PER_COORDINATE,
    PER_COORDINATE_LANE,
    PER_PARAMETER_LANE,
    PER_SPEED,
    PER_SPEED_LANE,
    ROOT,
    TRIG,
)
from ..mechanics.structure.kinds import LinkKind, UnitKind
from ..mechanics.structure.owners import owner_links
from ..mechanics.structure.system import System
from ..mechanics.sweeps import SWEEP
from ..model.model import GROUND
from ..program.addresses import Kind, Row
from ..program.formula import Formula
from ..program.plan import Plan
from ..program.shape import Constants
from ..program.store import CONSTANT, NUMBER, SHAPE, Store
from .polynomials import exact

Namer = Callable[[Store, str], sympy.Expr]
"""The symbol, or number, of a component of a store."""

OF_LINKS = (LINK, PARENT, ROOT, BASE_LINK, PARTNER, ELEMENT_END)
COORDINATES, SPEEDS = (PER_COORDINATE, PER_COORDINATE_LANE), (PER_SPEED, PER_SPEED_LANE)


ARGUMENTS = frozenset("q u p inputs t tau udot qdot dq du dp dinputs dt dtau dudot dqdot b outputs doutputs".split())
"""Stores of arguments and results, whose entries have names in the model."""


@dataclass(frozen=True)
class Kept:
    """The quantity that a symbol in memory denotes.

    Attributes
    ----------
    owner : str
        Owner of the memory: the name of a link if known, ``parent``, ...; empty for the unit itself.
    component : str
        Field and component, such as ``w.y``.
    each_direction : bool
        Whether the quantity is stored for each direction of derivatives.
    """

    owner: str
    component: str
    each_direction: bool


def symbol(name: str) -> sympy.Symbol:
    """A real sympy symbol with this name."""
    return sympy.Symbol(name, real=True)


def kept(store: Store, component: str) -> sympy.Expr:
    """The symbol of a stored component, named ``STORE.COMPONENT``."""
    return symbol(f"{store.plain.label}.{component}")


def constant(store: str, component: str, owner: Constants | None) -> sympy.Symbol:
    """The symbol of a constant, or of its derivative with respect to a parameter; the name of the parameter is known if
    the constant has one `owner` only."""
    field, slash, parameter = component.partition("/")
    name = owner.parameters[int(parameter)] if owner is not None and slash else parameter
    return symbol(f"{store}.{field}{slash}{name}")


def of_constants(users: Sequence[Constants], store: Store, component: str) -> sympy.Expr:
    """The symbol of a component in a block of constants; if the block has one owner, its parameter or number."""
    if store is SHAPE:
        return constant("c", component, users[0] if len(users) == 1 else None)
    if len(users) == 1 and store is NUMBER:
        return exact(users[0].numbers[int(component)])
    if len(users) == 1 and store.memory is PARAMETER.memory:
        return symbol(users[0].parameters[int(component)])
    return kept(store, component)


class Names:
    """Names of arguments and results in a plan.

    Parameters
    ----------
    system : System
    plan : Plan
    """

    def __init__(self, system: System, plan: Plan) -> None:
        self.system, self.model = system, system.model
        self.addresses, self.layout = plan.addresses(True), plan.layout
        self.by_argument = {
            "q": self.model.coordinate_names, "u": self.model.speed_names, "p": self.model.parameter_names,
            "inputs": self.model.inputs, "tau": self.model.speed_names, "outputs": [o.name for o in self.model.outputs],
        }  # fmt: skip

    def of_kind(self, kind: Kind, sweep: str, store: Store, component: str) -> sympy.Expr:
        """The symbol of a component in the block of a kind. If the kind has one member, arguments have their names in
        the model."""
        if len(kind.members) == 1 and store is CONSTANTS and isinstance(kind, LinkKind):
            return constant(store.label, component, self.system.constants_of[kind.members[0]])
        if len(kind.members) > 1 or store.memory not in (*COORDINATES, *SPEEDS, PER_PARAMETER_LANE, TRIG.memory):
            return kept(store, component)
        address = self.addresses.address(kind, sweep, store.plain, component)
        if store.memory is PER_PARAMETER_LANE:
            assert isinstance(address.component, Row)
            return symbol(f"dp.{self.model.parameter_names[address.component.values[0]]}")
        assert address.row is not None and isinstance(address.component, str)
        first = address.row.values[0]
        if store.memory is TRIG.memory:
            return self._trigonometric(first, component) or kept(store, component)
        names = self.model.coordinate_names if store.memory in COORDINATES else self.model.speed_names
        place = first + int(component)
        return symbol(f"{store.plain.name}.{names[place]}") if place < len(names) else kept(store, component)

    def owner(self, kind: Kind, sweep: str, store: Store) -> str:
        """The owner of the memory that a store of a kind accesses; a link has its name if the kind has one member."""
        own = store.owner is LINK and store.place is None
        if store.owner in OF_LINKS and len(kind.members) == 1 and (store.memory.region or store.memory is CONSTANT):
            assert isinstance(kind, UnitKind)
            (link,) = owner_links(self.system, kind, store, SWEEP[sweep].units)
            return "ground" if link == GROUND else self.system.links[link].name
        return "" if own else store.owner.name

    def _trigonometric(self, place: int, component: str) -> sympy.Expr | None:
        """Sine or cosine of an angle that is a coordinate, by the angle's place in the layout."""
        if component not in ("sin", "cos") or place >= len(self.layout.angles):
            return None
        angle = symbol(f"q.{self.model.coordinate_names[self.layout.angles[place]]}")
        found: sympy.Expr = getattr(sympy, component)(angle + exact(self.layout.added_angles[place]))
        return found

    def of_formula(self, formula: Formula, store: Store, component: str) -> sympy.Expr:
        """The symbol of a component in a formula. Entries have their names in the model if no other formula has the
        same form."""
        if len(formula.rows) != 1 or not component.isdigit():
            return kept(store, component)
        target, _, places, numbers = formula.rows[0]
        seed = store.name.removeprefix("d")
        if store is NUMBER:
            return exact(numbers[int(component)])
        if store.name == "t" or seed == "t":
            return symbol(store.name)
        argument = store.name if store.name in self.by_argument else seed
        if argument not in self.by_argument:
            return kept(store, component)
        place = (
            target if argument == formula.target.removeprefix("d") and argument not in "qup" else places[int(component)]
        )
        names = self.by_argument[argument]
        if place >= len(names):
            return kept(store, component)
        plain = store.name == argument and argument in ("p", "inputs")
        return symbol(names[place] if plain else f"{store.name}.{names[place]}")
