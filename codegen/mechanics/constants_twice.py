"""Second derivatives of constants with respect to design parameters."""

from __future__ import annotations

from ..program import algebra
from ..program.algebra import Symbol
from ..program.block import Expansion
from ..program.derivatives import Tangents
from ..program.passes import simplify
from ..program.shape import Shape
from ..program.store import SHAPE
from .stores import PARAMETER


def differentiate_twice(shape: Shape) -> None:
    """Adds the second derivatives of constants with respect to design parameters, with keys such as ``m/0/1``."""
    x = Expansion(shape.block.name, shape.block.title, lambda a, f: True).resume(shape.block)
    first = [(n, e) for _, n, e in shape.block.stores if "/" in n]
    parameters = [x.component(PARAMETER, str(k)) for k in range(shape.parameters)]
    statements = list(x.block.statements)
    for k, p in enumerate(parameters):
        assert isinstance(p, Symbol)
        d = Tangents(x, {p: algebra.ONE}, {}, lanes=False)
        for s in statements:
            d.statement(s)
        for name, e in first:
            value = x.let("d", d.expression(e))
            if value.is_Number:
                shape.fixed[f"{name}/{k}"] = value
            else:
                shape.varying[f"{name}/{k}"] = f"{name}/{k}"
                x.set_component(SHAPE, f"{name}/{k}", value)
    for name, same in list(shape.varying.items()):
        for k in range(shape.parameters):
            key = f"{name}/{k}"
            if name.count("/") != 1 or name == same:
                continue
            if f"{same}/{k}" in shape.fixed:
                shape.fixed[key] = shape.fixed[f"{same}/{k}"]
            else:
                shape.varying[key] = f"{same}/{k}"
    shape.block = simplify(x.finish())
