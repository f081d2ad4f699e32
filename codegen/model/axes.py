"""Directions given as expressions: base vectors, and vectors made of them."""

from __future__ import annotations

from .expressions import Expression, combine_exactly

Vector = tuple[Expression, Expression, Expression]


def coordinate_axis(axis: Vector) -> tuple[int, int] | None:
    """Index and sign of the base vector along an axis; None if the axis is not given as a base vector."""
    if not all(a.is_number for a in axis):
        return None
    values = [float(a.value) for a in axis]
    along = [i for i in range(3) if values[i] != 0]
    return (along[0], 1 if values[along[0]] > 0 else -1) if len(along) == 1 else None


def least_along(axis: Vector, defaults: dict[str, float]) -> int:
    """Index of the base vector that is most nearly perpendicular to an axis, at the default parameters."""
    sizes = [abs(float(a.evaluate(defaults))) for a in axis]
    return sizes.index(min(sizes))


def signed_base(i: int, sign: int = 1) -> Vector:
    """A base vector, or the negative of one."""
    x, y, z = (Expression.number(sign if k == i else 0) for k in range(3))
    return x, y, z


def cross(a: Vector, b: Vector) -> Vector:
    """Cross product of two vectors of expressions."""

    def entry(i: int) -> Expression:
        j, k = (i + 1) % 3, (i + 2) % 3
        first, second = (combine_exactly("*", a[m].tree, b[n].tree) for m, n in ((j, k), (k, j)))
        return Expression(combine_exactly("-", first, second))

    return entry(0), entry(1), entry(2)
