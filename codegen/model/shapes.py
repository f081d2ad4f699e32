"""Mass, centre of mass and inertia of simple shapes, as expressions of their dimensions.

The formulas are those of homogeneous solids about their centre, in body axes. A shape with an axis has the moment ``along``
about the axis, and the moment ``across`` about every perpendicular line. With the unit vector a of the axis the inertia matrix
is across 1 + (along - across) a a^T.
"""

from __future__ import annotations

import math

from .entries import ZERO
from .expressions import Expression
from .model import Vector
from .schema import BoxEntry, CapsuleEntry, CylinderEntry, RodEntry, ShapeEntry, SphereEntry

Inertia = tuple[Expression, Expression, Expression, Expression, Expression, Expression]


def mass_properties(shape: ShapeEntry) -> tuple[Expression, Vector, Inertia]:
    """Mass (kg), centre of mass (m) and inertia about it (xx, yy, zz, xy, xz, yz; kg m^2) of a shape, body axes.

    Raises
    ------
    ExpressionError
        If the result is not finite, such as for a capsule with length and radius zero.
    """
    if isinstance(shape, BoxEntry):
        x, y, z = shape.size
        mass = _mass(shape, x * y * z)
        squares = [s * s for s in (x, y, z)]
        xx, yy, zz = (mass * ((squares[i] + squares[j]) / 12) for i, j in ((1, 2), (0, 2), (0, 1)))
        return mass, shape.center, (xx, yy, zz, ZERO, ZERO, ZERO)
    if isinstance(shape, SphereEntry):
        r = shape.radius
        mass = _mass(shape, 4 * math.pi / 3 * r * r * r)
        moment = mass * (2 * r * r / 5)
        return mass, shape.center, (moment, moment, moment, ZERO, ZERO, ZERO)
    if isinstance(shape, CylinderEntry):
        r, length = shape.radius, shape.length
        mass = _mass(shape, math.pi * r * r * length)
        along = mass * (r * r / 2)
        across = mass * (r * r / 4 + length * length / 12)
        return mass, shape.center, _about_axis(shape.axis, along, across)
    if isinstance(shape, CapsuleEntry):
        # a cylinder of the given length with two hemispheres, which together are a ball
        r, length = shape.radius, shape.length
        ball_length = 4 * r / 3  # length of the cylinder with the volume of the ball
        whole = length + ball_length
        mass = _mass(shape, math.pi * r * r * whole)
        cylinder = mass * length / whole
        ball = mass * ball_length / whole
        rr, ll, lr = r * r, length * length, length * r
        along = cylinder * (rr / 2) + ball * (2 * rr / 5)
        # the centre of mass of a hemisphere is 3 r/8 from its flat side
        ends = 2 * rr / 5 + ll / 4 + 3 * lr / 8
        across = cylinder * (rr / 4 + ll / 12) + ball * ends
        return mass, shape.center, _about_axis(shape.axis, along, across)
    if isinstance(shape, RodEntry):
        length = shape.length
        mass = _mass(shape, length)
        across = mass * (length * length / 12)
        return mass, shape.center, _about_axis(shape.axis, ZERO, across)
    raise TypeError(f"no mass properties for {type(shape).__name__}")


def _mass(shape: ShapeEntry, volume: Expression) -> Expression:
    if shape.mass is not None:
        return shape.mass
    assert shape.density is not None
    return shape.density * volume


def _about_axis(axis: Vector, along: Expression, across: Expression) -> Inertia:
    if axis.count(ZERO) == 2:  # the result of the general formula, without its intermediate steps
        xx, yy, zz = (across if e is ZERO else along for e in axis)
        return xx, yy, zz, ZERO, ZERO, ZERO
    square = axis[0] * axis[0] + axis[1] * axis[1] + axis[2] * axis[2]

    def entry(i: int, j: int) -> Expression:
        share = axis[i] * axis[j] / square
        # on the diagonal, in this form, only one of the two moments remains if the share is 0 or 1
        return along * share + across * (1 - share) if i == j else (along - across) * share

    xx, yy, zz, xy, xz, yz = (entry(i, j) for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)))
    return xx, yy, zz, xy, xz, yz
