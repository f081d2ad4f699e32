"""Closing conditions: what the joint of a loop holds together, and what of a motion at the cut each of its conditions sees.

Linear conditions are divided by the characteristic length. Section 4.1 of the theory page.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from ...model.model import CLOSURE_ROWS
from ...program.scalar import Value, Vector
from ..spatial import UNIT, add, cross, scale
from .geometry import EarGeometry
from .motions import Twist
from .orthogonal import product


@dataclass(slots=True)
class Condition:
    """A condition of a loop.

    Attributes
    ----------
    loop : int
        Among the ear's.
    angular : bool
    n : Vector
        What it sees of a motion at the cut, in region axes: the component along n, scaled.
    turning : list of (weight, Vector, Vector)
        Where the loop may be open in others: an angular condition is that a sum of weight c . d is zero, c fixed in the end, d
        in the start, and n the sum of weight c x d.
    axis : Vector or None
        A direction of the start face in the place of n where what is open is told.
    """

    loop: int
    angular: bool
    n: Vector
    turning: list[tuple[Value, Vector, Vector]] = field(default_factory=list)
    axis: Vector | None = None


def counted_conditions(ear: EarGeometry) -> list[Condition]:
    """The conditions of all loops that count. Linear ones are divided by the characteristic length."""
    found: list[Condition] = []
    for c, closure in enumerate(ear.kind.closures):
        s = ear.x.number(ear.kind.scale)
        if closure.gaps:
            every = open_conditions(ear, c, s)
            found += [row for i, row in enumerate(every) if i not in closure.dropped]
            continue
        type_ = closure.type
        linear: list[Vector] = [list(e) for e in UNIT]
        angular: list[Vector] = [list(e) for e in UNIT] if type_ in ("fixed", "prismatic") else []
        if type_ == "universal":
            a, b = ear.universal_axes(c)
            angular = [ear.x.let_vector("n", cross(a, b), "Eq. 33")]
        elif type_ not in ("fixed", "spherical"):
            columns = ear.face_axes(c, 0)
            axis = closure.axis
            across = [columns[(axis + 1) % 3], columns[(axis + 2) % 3]]
            if type_ in ("prismatic", "cylindrical", "inline"):
                linear = across
            elif type_ == "planar":
                linear = [columns[axis]]
            if type_ not in ("prismatic", "inline"):
                angular = across
        found += [Condition(c, False, n if s == 1 else scale(s, n)) for n in linear]
        found += [Condition(c, True, n) for n in angular]
    return found


def kept_conditions(ear: EarGeometry) -> list[Condition]:
    """Those of the conditions that count which can matter, as the block of the closures has found."""
    kept = ear.kind.form.rows
    rows = counted_conditions(ear) if kept else []
    return [rows[i] for i in kept]


def joint_conditions(ear: EarGeometry, c: int) -> list[Condition]:
    """All conditions of a loop joint: linear ones, scaled, then angular ones."""
    closure = ear.kind.closures[c]
    share = ear.x.number(ear.kind.per_length)
    if closure.gaps:
        return open_conditions(ear, c, share)
    linear, columns = linear_directions(ear, c)
    across = [columns[(closure.axis + 1) % 3], columns[(closure.axis + 2) % 3]]
    angular = {"fixed": columns, "prismatic": columns, "spherical": [], "inline": []}.get(closure.type, across)
    if closure.type == "universal":
        first, second = ear.universal_axes(c)
        angular = [ear.x.let_vector("n", cross(first, second), "Eq. 33")]
    return [Condition(c, False, scale(share, n)) for n in linear] + [Condition(c, True, n) for n in angular]


def linear_directions(ear: EarGeometry, c: int) -> tuple[list[Vector], list[Vector]]:
    """Directions of a loop joint's linear conditions, and the axes of its start face."""
    closure = ear.kind.closures[c]
    columns = ear.face_axes(c, 0)
    axis = closure.axis
    across = [columns[(axis + 1) % 3], columns[(axis + 2) % 3]]
    linear = {"prismatic": across, "cylindrical": across, "inline": across, "planar": [columns[axis]]}
    return linear.get(closure.type, columns), columns


def open_conditions(ear: EarGeometry, c: int, share: Value) -> list[Condition]:
    """All conditions of a loop joint whose faces may be apart: they hold, and so do their rates, where others do not."""
    closure = ear.kind.closures[c]
    linear, s = linear_directions(ear, c)
    found = [Condition(c, False, scale(share, n)) for n in linear]
    count = CLOSURE_ROWS[closure.type][1]
    if not count:
        return found
    e = ear.face_axes(c, 1)
    i, j, k = closure.axis, (closure.axis + 1) % 3, (closure.axis + 2) % 3
    half = ear.x.half
    if closure.type == "universal":
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


def seen_by(
    ear: EarGeometry, rows: Sequence[Condition], at_cuts: list[Twist], name: str, tag: str, lanes: bool = False
) -> Vector:
    """Components of motions at the cuts along the conditions."""
    result: Vector = []
    for row in rows:
        v = at_cuts[row.loop].angular if row.angular else at_cuts[row.loop].linear
        result.append(ear.x.let(name, _along(row.n, v), tag, lanes=lanes))
    return result


def _along(n: Vector, v: Vector) -> Value:
    total: Value = 0
    for a, b in zip(n, v, strict=True):
        total = total + product(a, b)
    return total
