"""Formulas that read records of links: their adjoints, and the tangents of these adjoints, for second derivatives."""

from __future__ import annotations

from ..program.block import Component, Expansion
from ..program.formula import Formula
from ..program.passes import simplify
from ..program.second_order import adjoint, along
from ..program.store import ARGUMENT, MARGIN, NUMBER, Store, argument
from ..program.transpose import always
from .formulas import has_derivative, seed_of
from .second_order_poses import attitudes
from .second_order_stores import adjoint_of, adjoint_tangent_of, tangent_of


def differentiate_records(formula: Formula) -> None:
    """Sets `Formula.of_records`, the tangent of the formula's adjoint."""
    target = formula.target

    def place(store: Store) -> Store:
        name = store.name.removeprefix("d")
        if store.memory.region or store.name not in (f"d{target}", *(f"d{n}" for n in GIVEN)):
            return adjoint_of(store)
        return argument(f"{name}_bar" if name == target else f"g{name}")

    def seed(store: Store, name: str) -> Component | None:
        if store.memory is ARGUMENT:
            return (seed_of(store), name) if has_derivative(store) else None
        return None if store is NUMBER else tangent_of(store, name)

    def again(store: Store, name: str) -> Component | None:
        return seed(store, name) if store.memory is ARGUMENT else adjoint_tangent_of(store, name)

    values = formula.differentiable
    assert values is not None
    title, name = formula.value.title, formula.value.name
    tangent = along(Expansion(f"{name}_along", "", always).resume(values), seed, attitudes)
    back = adjoint(tangent, f"{name}_adjoint", f"adjoint of {title}", place, always)
    twice = along(
        Expansion(f"{name}_twice", f"tangent of the adjoint of {title}", always).resume(back), again, attitudes
    )
    twice.stores += [s for s in values.stores if s[0].memory is MARGIN]
    back.stores = [
        s for s in back.stores if s[0].memory is not ARGUMENT or (formula.in_loops and s[0].name in ("gq", "gu"))
    ]
    formula.of_records = simplify(back), simplify(twice)


GIVEN = ("q", "u", "p", "inputs", "t")
"""Arguments that formulas read."""
