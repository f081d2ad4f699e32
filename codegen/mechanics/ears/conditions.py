"""Closing conditions: the directions that a loop joint constrains, and the components of a motion at the cut along
these directions.

Linear conditions are divided by the characteristic length. Section 4.1 of the theory page.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import field

from ...program.scalar import Value, Vector
from ...records import dataclass
from ..spatial import UNIT, add, cross, inner, product, scale
from .geometry import EarGeometry
from .motions import Twist
from .surfaces import SurfaceCondition


@dataclass(slots=True)
class Condition:
    """A closing condition of a loop.

    Attributes
    ----------
    loop : int
        Index among the ear's loops.
    angular : bool
    n : Vector
        Direction at the cut, in region axes, scaled: the condition is the component of the motion along n.
    turning : list of (weight, Vector, Vector)
        For loops whose dropped conditions may be open: terms of an angular condition. The sum of ``weight * c . d`` is
        zero, where c is fixed in the end face and d in the start face; n is the sum of ``weight * c x d``.
    axis : Vector or None
        A direction of the start face in place of n, for residuals.
    surface : SurfaceCondition or None
        For a condition on a point: its equation; n is the gradient.
    share : Value
        For a condition on a point: its factor, one over the length of the gradient.
    """

    loop: int
    angular: bool
    n: Vector
    turning: list[tuple[Value, Vector, Vector]] = field(default_factory=list)
    axis: Vector | None = None
    surface: SurfaceCondition | None = None
    share: Value = 1

    @property
    def gap(self) -> Value:
        """The residual of a condition on a point, multiplied by its factor."""
        assert self.surface is not None
        return self.surface.x.let("gap", self.share * self.surface.value, "Eq. 32")


def counted_conditions(ear: EarGeometry) -> list[Condition]:
    """The conditions of all loops, without the dropped ones; linear conditions are divided by the characteristic
    length."""
    found: list[Condition] = []
    for c, closure in enumerate(ear.kind.closures):
        rows = _of_joint(ear, c, ear.x.number(ear.kind.scale), True)
        chosen = closure.is_coupling or closure.surfaces or closure.gaps
        found += [row for i, row in enumerate(rows) if not (chosen and i in closure.dropped)]
    return found


def kept_conditions(ear: EarGeometry) -> list[Condition]:
    """The conditions in the rows of the factored closure matrix: rows that can be nonzero, without dropped
    conditions."""
    kept = ear.kind.form.rows
    rows = counted_conditions(ear) if kept else []
    return [rows[i] for i in kept]


def joint_conditions(ear: EarGeometry, c: int) -> list[Condition]:
    """All conditions of a loop joint: linear ones, scaled, then angular ones."""
    return _of_joint(ear, c, ear.x.number(ear.kind.per_length), False)


def _of_joint(ear: EarGeometry, c: int, share: Value, counted: bool) -> list[Condition]:
    """Conditions of a loop joint, along axes of the faces. But if `counted`, and if all three directions are constrained,
    they are along the region's axes."""
    closure = ear.kind.closures[c]
    if closure.is_coupling:  # a coupling's value is the first of three components, see `ears.couplings`
        return [Condition(c, True, [1, 0, 0])]
    if closure.surfaces:
        return surface_conditions(ear, c, share)
    if closure.gaps:
        return open_conditions(ear, c, share)
    holds = closure.holds
    columns = [] if counted and holds.linear == 3 and holds.angular != 2 else ear.face_axes(c, 0)
    every = [list(e) for e in UNIT] if counted else columns
    linear = held(holds.linear, closure.axis, columns, every)
    angular = held_in_turning(ear, c, columns, every)
    linear = linear if counted and share == 1 else [scale(share, n) for n in linear]
    return [Condition(c, False, n) for n in linear] + [Condition(c, True, n) for n in angular]


def surface_conditions(ear: EarGeometry, c: int, scaled: Value) -> list[Condition]:
    """Conditions on a point: each is a linear condition along the gradient of its equation."""
    found = []
    for i in range(len(ear.kind.closures[c].surfaces)):
        surface = SurfaceCondition(ear, c, i)
        share = ear.x.let("share", surface.size * scaled, "Eq. 33")
        n = ear.x.let_vector("n", scale(share, surface.gradient), "Eq. 33")
        found.append(Condition(c, False, n, surface=surface, share=share))
    return found


def held(count: int, axis: int, columns: list[Vector], every: list[Vector]) -> list[Vector]:
    """Directions that a joint constrains, by `count`: all three, two across its axis, the axis, or none."""
    if count == 3:
        return every
    if count == 2:
        return [columns[(axis + 1) % 3], columns[(axis + 2) % 3]]
    return [columns[axis]] if count == 1 else []


def held_in_turning(ear: EarGeometry, c: int, columns: list[Vector], every: list[Vector]) -> list[Vector]:
    """Directions about which a joint cannot rotate; for a universal joint, the normal to its two axes."""
    closure = ear.kind.closures[c]
    if closure.holds.angular != 1:
        return held(closure.holds.angular, closure.axis, columns, every)
    first, second = ear.universal_axes(c)
    return [ear.x.let_vector("n", cross(first, second), "Eq. 33")]


def open_conditions(ear: EarGeometry, c: int, share: Value) -> list[Condition]:
    """All conditions of a loop joint whose faces may be apart. Residuals and rates are valid even if dropped conditions
    are not met."""
    closure = ear.kind.closures[c]
    s = ear.face_axes(c, 0)
    found = [Condition(c, False, scale(share, n)) for n in held(closure.holds.linear, closure.axis, s, s)]
    count = closure.holds.angular
    if not count:
        return found
    e = ear.face_axes(c, 1)
    i, j, k = closure.axis, (closure.axis + 1) % 3, (closure.axis + 2) % 3
    half = ear.x.half
    if count == 1:
        turning: list[tuple[list[tuple[Value, Vector, Vector]], Vector | None]] = [
            ([(-1, e[closure.end_axis], s[i])], None)
        ]
    elif count == 2:
        turning = [([(-1, e[i], s[k])], s[j]), ([(1, e[i], s[j])], s[k])]
    else:
        turning = [([(half, e[n - 2], s[n - 1]), (-half, e[n - 1], s[n - 2])], s[n]) for n in range(3)]
    for terms, axis in turning:
        total: Vector = [0, 0, 0]
        for weight, a, b in terms:
            total = add(total, scale(weight, cross(a, b)))
        found.append(Condition(c, True, ear.x.let_vector("n", total, "Eq. 33"), terms, axis))
    return found


def components_along(
    ear: EarGeometry, rows: Sequence[Condition], at_cuts: list[Twist], name: str, tag: str, lanes: bool = False
) -> Vector:
    """Components of motions at the cuts along the conditions' directions."""
    result: Vector = []
    for row in rows:
        v = at_cuts[row.loop].angular if row.angular else at_cuts[row.loop].linear
        result.append(ear.x.let(name, inner(row.n, v), tag, lanes=lanes))
    return result


def of_loop(rows: list[Condition], c: int, multipliers: Vector, along: Sequence[Vector]) -> tuple[Vector, Vector]:
    """Moment and force of loop c: the sum of multipliers times `along`, the directions of the loop's conditions or the
    changes of these directions."""
    found: tuple[Vector, Vector] = ([0, 0, 0], [0, 0, 0])
    for row, value, n in zip(rows, multipliers, along, strict=True):
        if row.loop == c:
            part = [product(e, value) for e in n]
            found = (add(found[0], part), found[1]) if row.angular else (found[0], add(found[1], part))
    return found
