"""Rotation of a body against another one."""

from __future__ import annotations

from ...model.outputs import Output
from ...model.outputs.rotation import QUATERNION
from ..pairs import Pair
from .seen import Seen


def rotation(output: Output, seen: Seen) -> Pair:
    """An entry of ``R = R_other^T R_body``, or a component of its quaternion, qw >= 0.

    The largest component is a square root, the others follow from products of two components. At qw = 0 the largest is positive.
    """
    body, other = output.bodies
    (entry,) = output.choice
    R = seen.attitude(other)[0].mT @ seen.attitude(body)[0]
    if entry not in QUATERNION:
        return R["xyz".index(entry[0]), "xyz".index(entry[1])]
    one, two, four = (seen.pairs.number(x) for x in (1, 2, 4))
    xx, yy, zz = (R[i, i] for i in range(3))
    squares = [one + xx + yy + zz, one + xx - yy - zz, one - xx + yy - zz, one - xx - yy + zz]
    largest = max(range(4), key=lambda i: squares[i].value)
    e = seen.pairs.call("sqrt", squares[largest]) / two
    antisymmetric = [R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]]
    component = QUATERNION.index(entry)

    def product(i: int, j: int) -> Pair:
        """Four times the product of two different components."""
        i, j = sorted((i, j))
        return antisymmetric[j - 1] if i == 0 else R[i - 1, j - 1] + R[j - 1, i - 1]

    def of(i: int) -> Pair:
        return e if i == largest else product(i, largest) / (four * e)

    return of(component) if of(0).value >= 0 else -of(component)
