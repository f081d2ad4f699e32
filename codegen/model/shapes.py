"""Mass, centre of mass and inertia of simple shapes, as expressions of the shape's own numbers.

The formulas are those of homogeneous solids about their centre, in body axes. A shape with an axis has one moment about
the axis, ``along``, and one about every line across it, ``across``; with the unit vector a of the axis the inertia
matrix is across 1 + (along - across) a a^T.
"""

from __future__ import annotations

import math
from typing import Any

from .expressions import Expression, combine
from .grammar import Tree
from .model import Vector
from .schema import BoxEntry, CapsuleEntry, CylinderEntry, RodEntry, ShapeEntry, SphereEntry

Inertia = tuple[Expression, Expression, Expression, Expression, Expression, Expression]


def mass_properties(shape: ShapeEntry) -> tuple[Expression, Vector, Inertia]:
    """Mass (kg), centre of mass (m) and inertia about it (xx, yy, zz, xy, xz, yz; kg m^2) of a shape, body axes.

    Raises
    ------
    ExpressionError
        If numbers of the shape have no finite result, such as a capsule of length and radius zero.
    """
    if isinstance(shape, BoxEntry):
        x, y, z = (_tree(e) for e in shape.size)
        mass = _mass(shape, _times(x, y, z))
        squares = [_times(s, s) for s in (x, y, z)]
        moments = [_times(mass, _over(_plus(squares[i], squares[j]), 12)) for i, j in ((1, 2), (0, 2), (0, 1))]
        zero = _number(0)
        return _result(shape, mass, (*moments, zero, zero, zero))
    if isinstance(shape, SphereEntry):
        r = _tree(shape.radius)
        mass = _mass(shape, _times(_number(4 * math.pi / 3), r, r, r))
        moment, zero = _times(mass, _over(_times(_number(2), r, r), 5)), _number(0)
        return _result(shape, mass, (moment, moment, moment, zero, zero, zero))
    if isinstance(shape, CylinderEntry):
        r, length = _tree(shape.radius), _tree(shape.length)
        mass = _mass(shape, _times(_number(math.pi), r, r, length))
        along = _times(mass, _over(_times(r, r), 2))
        across = _times(mass, _plus(_over(_times(r, r), 4), _over(_times(length, length), 12)))
        return _result(shape, mass, _about_axis(shape.axis, along, across))
    if isinstance(shape, CapsuleEntry):
        # a cylinder of the given length and two half balls on its ends; both halves together are the ball
        r, length = _tree(shape.radius), _tree(shape.length)
        ball_length = _over(_times(_number(4), r), 3)  # length of the cylinder that has the volume of the ball
        whole = _plus(length, ball_length)
        mass = _mass(shape, _times(_number(math.pi), r, r, whole))
        cylinder = combine("/", _times(mass, length), whole)
        ball = combine("/", _times(mass, ball_length), whole)
        rr, ll, lr = _times(r, r), _times(length, length), _times(length, r)
        along = _plus(_times(cylinder, _over(rr, 2)), _times(ball, _over(_times(_number(2), rr), 5)))
        # a half ball has its centre of mass 3 r/8 from its flat side
        ends = _plus(_plus(_over(_times(_number(2), rr), 5), _over(ll, 4)), _over(_times(_number(3), lr), 8))
        across = _plus(_times(cylinder, _plus(_over(rr, 4), _over(ll, 12))), _times(ball, ends))
        return _result(shape, mass, _about_axis(shape.axis, along, across))
    if isinstance(shape, RodEntry):
        length = _tree(shape.length)
        mass = _mass(shape, length)
        across = _times(mass, _over(_times(length, length), 12))
        return _result(shape, mass, _about_axis(shape.axis, _number(0), across))
    raise TypeError(f"no mass properties for {type(shape).__name__}")


def _mass(shape: ShapeEntry, volume: Tree) -> Tree:
    if shape.mass is not None:
        return _tree(shape.mass)
    assert shape.density is not None
    return _times(_tree(shape.density), volume)


def _about_axis(axis: Vector, along: Tree, across: Tree) -> tuple[Tree, ...]:
    a = [_tree(e) for e in axis]
    zero = _number(0)
    if a.count(zero) == 2:  # what the general formula comes to, without the way there
        return (*(across if e == zero else along for e in a), zero, zero, zero)
    square = _plus(_plus(_times(a[0], a[0]), _times(a[1], a[1])), _times(a[2], a[2]))

    def entry(i: int, j: int) -> Tree:
        share = combine("/", _times(a[i], a[j]), square)
        if i != j:
            return _times(combine("-", along, across), share)
        # written so that a share of 0 or 1 leaves one moment alone
        return _plus(_times(along, share), _times(across, combine("-", _number(1), share)))

    return tuple(entry(i, j) for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)))


def _result(shape: ShapeEntry, mass: Tree, inertia: Any) -> tuple[Expression, Vector, Inertia]:
    xx, yy, zz, xy, xz, yz = (Expression(t) for t in inertia)
    return Expression(mass), shape.center, (xx, yy, zz, xy, xz, yz)


def _tree(expression: Expression) -> Tree:
    return expression.tree


def _number(value: int | float) -> Tree:
    return Expression.number(value).tree


def _times(*factors: Tree) -> Tree:
    product = factors[0]
    for factor in factors[1:]:
        product = combine("*", product, factor)
    return product


def _plus(a: Tree, b: Tree) -> Tree:
    return combine("+", a, b)


def _over(a: Tree, number: int) -> Tree:
    return combine("/", a, _number(number))
