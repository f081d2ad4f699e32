"""Rotation of a body relative to another: entries of its matrix, or of its quaternion.

The rotation matrix R gives all products of two components of the quaternion e: ``K = 4 e e^T`` is linear in R. Let d be
the largest diagonal entry of K. The row of K that contains d is ``2 sqrt(d) e`` up to sign. Since d is at least 1, no
square root is taken near zero. The sign is chosen so that qw is positive; if qw is zero (half a turn), the sign of the row
is kept. At half a turn the quaternion jumps to its negative; the derivative there is that of the side with this sign.
Everywhere else derivatives are exact.
"""

from __future__ import annotations

from ...model.outputs import Output
from ...program.algebra import expression
from ...program.functions import AtLeast, Maximum
from ...program.scalar import Matrix, Value
from ..spatial import dot, matmul, transpose
from .measure import RecordMeasure
from .records import Records

COMPONENTS = ("qw", "qx", "qy", "qz")


def rotation(records: Records, output: Output) -> Value:
    """The rotation matrix ``R = W_other^T W_body``, or its quaternion."""
    body, other = output.bodies
    (entry,) = output.choice
    W, V = records.attitude(body), records.attitude(other)
    if entry not in COMPONENTS:
        i, j = ("xyz".index(letter) for letter in entry)
        return dot([row[i] for row in V], [row[j] for row in W])
    R: Matrix = [[records.x.let("R", e) for e in row] for row in matmul(transpose(V), W)]
    return quaternion(records, R, COMPONENTS.index(entry))


def quaternion(records: Records, R: Matrix, component: int) -> Value:
    """A component of the quaternion of a rotation matrix."""
    let = records.x.let
    K = [[expression(0)] * 4 for _ in range(4)]
    xx, yy, zz = (expression(R[i][i]) for i in range(3))
    for i, e in enumerate((xx + yy + zz, xx - yy - zz, yy - xx - zz, zz - xx - yy)):
        K[i][i] = expression(let("K", 1 + e))
    for i, j in ((1, 2), (2, 0), (0, 1)):
        k = 3 - i - j
        K[0][1 + k] = K[1 + k][0] = expression(let("K", R[j][i] - R[i][j]))
        K[1 + i][1 + j] = K[1 + j][1 + i] = expression(let("K", R[i][j] + R[j][i]))
    chosen, left = [], expression(1)
    for i in range(3):  # the largest diagonal entry; the first one of several equal ones
        largest = K[i + 1][i + 1]
        for n in range(i + 2, 4):
            largest = expression(let("largest", Maximum(largest, K[n][n])))
        chosen.append(expression(let("chosen", left * AtLeast(K[i][i], largest))))
        left = expression(let("left", left - chosen[-1]))
    chosen.append(left)

    def picked(column: int) -> Value:
        found: Value = let("row", sum((s * row[column] for s, row in zip(chosen, K, strict=True)), expression(0)))
        return found

    d = let("d", sum((s * K[i][i] for i, s in enumerate(chosen)), expression(0)))
    sign = let("sign", 2 * AtLeast(picked(0), 0) - 1)
    scale = let("scale", records.x.half / records.x.sqrt(d))
    found: Value = let("component", sign * let("size", picked(component) * scale))
    return found


ROTATION = RecordMeasure(("pose",), rotation)
