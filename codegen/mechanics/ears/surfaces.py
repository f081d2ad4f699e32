"""Conditions on points: a function f of the end's position in the start face is zero. Section 4.12 of the theory page.

Let s be the position in the start face, F the axes of this face, and n = F grad f. In velocity the condition is ``n . v = 0``,
with v the velocity of the end relative to the start face, as for a sliding joint. But n changes along the surface, so
accelerations also contain ``v . H v``, H the Hessian of f. A distance l is the condition ``(r . r - l^2)/2 = 0``, r the vector
between the points. Rows are divided by the length of the gradient. Along directions this divisor is constant, since it
divides residuals of zero.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

from ...model.expressions import Expression
from ...model.grammar import Tree
from ...model.surfaces import COORDINATES, PAIRS
from ...program.limits import limits
from ...program.scalar import Value, Vector
from .. import fields
from ..spatial import add, dot, is_zero, scale
from ..stores import CL_DP, EAR, LOOP_CONSTANTS, RANK
from ..structure.constants import written
from ..structure.surface_forms import SurfaceForm, part_number
from .geometry import EarGeometry

TINY = 1e-200
"""Number added to the square of a gradient, so that a vanishing gradient gives a row of zeros, which is reported, instead
of a division by zero."""

DIRECTED = 1e-16
"""Smallest squared distance from a zero of the gradient, in squared characteristic lengths; at smaller distances, the
gradient has no direction."""


class SurfaceCondition:
    """One condition on a point in a block; each quantity is written once, when it is first read.

    Parameters
    ----------
    ear : EarGeometry
    c : int
        Loop of the ear.
    i : int
        Condition of the loop.
    """

    def __init__(self, ear: EarGeometry, c: int, i: int):
        closure = ear.kind.closures[c]
        assert closure.slides
        slip = ear.slip(c)
        assert slip is not None
        self.ear, self.x, self.c, self.i = ear, ear.x, c, i
        self.is_distance = closure.is_distance
        self.form: SurfaceForm = closure.surfaces[i]
        self.axes = [] if self.is_distance else ear.face_axes(c, 0)
        self.place = slip if self.is_distance else self._own(slip, "at")

    def _own(self, v: Vector, name: str) -> Vector:
        """Components, along the axes of the start face, of a vector given along the region's axes."""
        return [self.x.let(name, dot(axis, v), "Eq. 33") for axis in self.axes]

    def formula(self, expression: Expression, name: str) -> Value:
        """The value of an expression over the point's coordinates and numbered parts."""
        return self.x.let(name, written(self.x, expression.tree, self._leaf, "Eq. 33"), "Eq. 33")

    def _leaf(self, tree: Tree) -> Value:
        name = tree[1]
        if name in COORDINATES:
            return self.place[COORDINATES.index(name)]
        return self._part(part_number(name))

    def _part(self, i: int) -> Value:
        return self.x.load(LOOP_CONSTANTS[self.c], fields.surface_part(i))

    @cached_property
    def value(self) -> Value:
        """Value of the function, which is zero where the condition is met."""
        if self.is_distance:
            length = self._part(0)
            return self.x.let("f", self.x.half * (dot(self.place, self.place) - length * length), "Eq. 33")
        return self.formula(self.form.value, "f")

    @cached_property
    def gradient(self) -> Vector:
        """Gradient of the function along region axes."""
        if self.is_distance:
            return self.place
        own = [self.formula(e, "g") for e in self.form.gradient]
        return self.x.let_vector("grad", add(*(scale(g, a) for g, a in zip(own, self.axes, strict=True))), "Eq. 33")

    @cached_property
    def size(self) -> Value:
        """Reciprocal of the gradient's length. It is held along directions, unless the ear differentiates its
        `shares`."""
        field = fields.surface_share(self.c, self.i)
        if self.ear.shares == "held":
            return self.x.load(EAR, field)
        g = self.gradient
        square = self.x.let("gg", dot(g, g) + self.x.number(limits().tiny(TINY, 1.5)), "Eq. 33")
        share = self.x.let("share", 1 / self.x.let("root", self.x.sqrt(square), "Eq. 33"), "Eq. 33")
        if self.ear.shares == "found":
            self.x.store(EAR, field, share)
        return share

    def check_direction(self, entry: int) -> bool:
        """If the gradient may vanish, write the check that it has a direction; returns whether it may vanish."""
        x = self.x
        if self.is_distance:
            bend: Value = 1
        else:
            found = [self.formula(e, "h") for e in self.form.hessian]
            bend = sum((1 if i == j else 2) * h * h for h, (i, j) in zip(found, PAIRS, strict=True))
            if is_zero(bend):
                return False
        near = (
            x.number(limits().rounding(DIRECTED))
            * bend
            / (x.number(1) * self.ear.kind.per_length * self.ear.kind.per_length)
        )
        x.set_entry(RANK, entry, x.let("margin", dot(self.gradient, self.gradient) - near, "rank"))
        return True

    def curvature(self, v: Vector) -> Value:
        """Second derivative of the function along v, a relative velocity to the start face along region axes: ``v . H v``."""
        if self.is_distance:
            return dot(v, v)
        own = self._own(v, "vs")
        total: Value = 0
        for e, (i, j) in zip(self.form.hessian, PAIRS, strict=True):
            h = self.formula(e, "h")
            total = total + (h * own[i] * own[j] if i == j else 2 * h * own[i] * own[j])
        return self.x.let("vhv", total, "Eq. 31")

    def by_parameters(self) -> Value:
        """Change of the function along a direction, due to parameters in its formula; the point is held. d Eq. 30."""
        total: Value = 0
        x = self.x
        for j in range(self.ear.kind.closures[self.c].parameters):
            change: Value = 0
            for i in self._parts():
                more = x.load(LOOP_CONSTANTS[self.c], fields.surface_part(i).derivative(j))
                if not is_zero(more):
                    change = change + self._slope(i) * more
            if not is_zero(change):
                total = total + x.let("df", change, "d Eq. 30") * x.entry(CL_DP[self.c], j)
        return total

    def _parts(self) -> Sequence[int]:
        """Indices of the numbered parts that may contain parameters."""
        return [0] if self.is_distance else [i for i, _ in self.form.by_part]

    def _slope(self, i: int) -> Value:
        """Derivative of the function with respect to part i."""
        return -self._part(0) if self.is_distance else self.formula(dict(self.form.by_part)[i], "fp")
