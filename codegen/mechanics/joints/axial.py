"""Joints that rotate about an axis of the link's frame, slide along it, or both.

The rotation is planar: a vector takes six operations, and an inertia is rotated with the products ``c^2, s^2, c s``. The sine
and cosine are not differentiated as values: their tangents follow from that of the angle.
"""

from __future__ import annotations

from functools import cached_property
from typing import ClassVar

from ...program.block import Scope
from ...program.field import XYZ
from ...program.scalar import Matrix, Value, Vector
from ...program.store import Store
from .. import fields
from ..spatial import cross
from ..stores import CONSTANTS, COORDINATES, DQ, MY_LANE, SPEEDS, TRIG, TURNS
from .link_joint import LinkJoint, Primitives


class Axial(LinkJoint):
    """A joint that rotates about its axis by the coordinate number `angle` (None: no rotation) and, if it `slides`, slides
    along its axis by the distance `shift`."""

    slides: ClassVar[bool] = False

    def own_coordinate(self) -> Value:
        """The only coordinate of a joint with one degree of freedom."""
        return self.x.entry(COORDINATES, 0)

    def own_speed(self) -> Value:
        """The rate of the joint's only coordinate."""
        return self.x.entry(SPEEDS, 0)

    def own_change(self) -> Value:
        """Change of the joint's only coordinate along a direction."""
        return self.x.entry(DQ, 0)

    # -- overridden by the joints ------------------------------------------------------------------------------------

    def turn_speed(self) -> Value:
        """Angular velocity of the joint about its axis."""
        return 0 if self.angle is None else self.own_speed()

    def shift(self) -> Value:
        """Displacement of the joint along its axis."""
        return 0

    def slide_speed(self) -> Value:
        """Velocity of the joint along its axis."""
        return 0

    def shift_tangent(self) -> Value:
        """Displacement of the joint along its axis due to dq."""
        return 0

    def shift_by(self, parameter: int) -> Value:
        """Derivative of `shift` with respect to a design parameter."""
        return 0

    # -- place and attitude ----------------------------------------------------------------------------------------

    def _along_axis(self, value: Value) -> Vector:
        return [value if i == self.kind.axis else 0 for i in range(3)]

    def way(self) -> Vector | None:
        return self._along_axis(self.shift()) if self.slides else None

    def way_by(self, parameter: int) -> Vector | None:
        return self._along_axis(self.shift_by(parameter)) if self.slides else None

    def offset(self) -> Vector:
        if self.slides and self.fixed is None:
            r = self.x.load(CONSTANTS, fields.joint_place)
            r[self.kind.axis] = self.x.let("r_q", r[self.kind.axis] + self.shift(), "Eq. 22")
            return r
        return super().offset()

    # -- vectors and inertias --------------------------------------------------------------------------------------

    @cached_property
    def trig(self) -> tuple[Value, Value]:
        """Cosine and sine of the joint angle."""
        return self.x.load(TRIG, fields.cosine), self.x.load(TRIG, fields.sine)

    @cached_property
    def squares(self) -> tuple[Value, Value, Value]:
        c, s = self.trig
        let = self.x.let
        return let("cc", c * c, "Eq. 22"), let("ss", s * s, "Eq. 22"), let("cs", c * s, "Eq. 22")

    def _turned(self, W: Matrix) -> Matrix:
        if self.angle is None:
            return W
        c, s = self.trig
        i, j = (self.kind.axis + 1) % 3, (self.kind.axis + 2) % 3
        W = [list(row) for row in W]
        for row in W:
            row[i], row[j] = (
                self.x.let("W", c * row[i] + s * row[j], "Eq. 22"),
                self.x.let("W", c * row[j] - s * row[i], "Eq. 22"),
            )
        return W

    def _behind(self, v: Vector, name: str, tag: str) -> Vector:
        return self._rotated(v, name, tag, back=True)

    def _before(self, v: Vector, name: str, tag: str) -> Vector:
        return self._rotated(v, name, tag, back=False)

    def _rotated(self, v: Vector, name: str, tag: str, back: bool) -> Vector:
        """A vector rotated about the axis by the angle, or (`back`) by minus the angle."""
        if self.angle is None:
            return v
        c, s = self.trig
        s = -s if back else s
        i, j = (self.kind.axis + 1) % 3, (self.kind.axis + 2) % 3
        v = list(v)
        v[i], v[j] = (
            self._let(f"{name}_{XYZ[i]}", c * v[i] - s * v[j], tag),
            self._let(f"{name}_{XYZ[j]}", c * v[j] + s * v[i], tag),
        )
        return v

    def _inertia_before(self, J: Matrix, H: Matrix, M: Matrix, tag: str) -> tuple[Matrix, Matrix, Matrix]:
        if self.angle is None:
            return J, H, M
        J = self._turn_symmetric(J, "J", tag)
        M = self._turn_symmetric(M, "M", tag)
        return J, self._turn(H, "H", tag), M

    def _turn_symmetric(self, m: Matrix, name: str, tag: str) -> Matrix:
        """``R m R^T`` for a rotation about the axis and a symmetric m.

        Uses the squares of sine and cosine: at a right angle the shorter ``m_bb - s (s d + c e)``, d = m_bb - m_cc and
        e = 2 m_bc, loses a small diagonal entry next to a large one.
        """
        let = self.x.let
        a, b, c = self.kind.axis, (self.kind.axis + 1) % 3, (self.kind.axis + 2) % 3
        cos, sin = self.trig
        cc, ss, cs = self.squares
        bb, cc_, bc = (let(f"{name}_e", e, tag) for e in (m[b][b], m[c][c], m[b][c]))
        ab, ac = (let(f"{name}_e", e, tag) for e in (m[a][b], m[a][c]))
        out: Matrix = [[0] * 3 for _ in range(3)]
        twice = let(f"{name}_w", 2 * cs * bc, tag)
        out[b][b] = let(f"{name}_{b}{b}", cc * bb + ss * cc_ - twice, tag)
        out[c][c] = let(f"{name}_{c}{c}", ss * bb + cc * cc_ + twice, tag)
        out[b][c] = out[c][b] = let(f"{name}_{b}{c}", cs * let(f"{name}_d", bb - cc_, tag) + self.difference * bc, tag)
        out[a][b] = out[b][a] = let(f"{name}_{a}{b}", cos * ab - sin * ac, tag)
        out[a][c] = out[c][a] = let(f"{name}_{a}{c}", cos * ac + sin * ab, tag)
        out[a][a] = m[a][a]
        return out

    @property
    def difference(self) -> Value:
        cc, ss, _ = self.squares
        return self.x.let("c2", cc - ss, "Eq. 22")

    def _turn(self, m: Matrix, name: str, tag: str) -> Matrix:
        """``R m R^T`` for a rotation about the axis, where m is not symmetric."""
        let = self.x.let
        a, b, c = self.kind.axis, (self.kind.axis + 1) % 3, (self.kind.axis + 2) % 3
        cos, sin = self.trig
        cc, ss, cs = self.squares
        m = [[let(f"{name}_e", e, tag) for e in row] for row in m]
        out: Matrix = [[0] * 3 for _ in range(3)]
        both = let(f"{name}_w", cs * let(f"{name}_s", m[b][c] + m[c][b], tag), tag)
        skewed = let(f"{name}_d", cs * let(f"{name}_d", m[b][b] - m[c][c], tag), tag)
        out[b][b] = let(f"{name}_{b}{b}", cc * m[b][b] + ss * m[c][c] - both, tag)
        out[c][c] = let(f"{name}_{c}{c}", ss * m[b][b] + cc * m[c][c] + both, tag)
        out[b][c] = let(f"{name}_{b}{c}", skewed + cc * m[b][c] - ss * m[c][b], tag)
        out[c][b] = let(f"{name}_{c}{b}", skewed + cc * m[c][b] - ss * m[b][c], tag)
        out[a][b] = let(f"{name}_{a}{b}", cos * m[a][b] - sin * m[a][c], tag)
        out[a][c] = let(f"{name}_{a}{c}", cos * m[a][c] + sin * m[a][b], tag)
        out[b][a] = let(f"{name}_{b}{a}", cos * m[b][a] - sin * m[c][a], tag)
        out[c][a] = let(f"{name}_{c}{a}", cos * m[c][a] + sin * m[b][a], tag)
        out[a][a] = m[a][a]
        return out

    # -- motion ----------------------------------------------------------------------------------------------------

    def turning(self, carried: Vector) -> Vector:
        w = list(carried)
        if self.angle is not None:
            axis = self.kind.axis
            w[axis] = self.x.let(f"w_{XYZ[axis]}", w[axis] + self.turn_speed(), "Eq. 18")
        return w

    def sliding(self, carried: Vector) -> Vector:
        v = list(carried)
        if self.slides:
            v[self.kind.axis] = self.x.let("v", v[self.kind.axis] + self.slide_speed(), "Eq. 18")
        return v

    def bias(self, carried: Vector) -> tuple[Vector, Vector]:
        turning = cross(carried, self._along_axis(self.turn_speed()))
        if not self.slides:
            return turning, [0, 0, 0]
        # the axis does not rotate with the joint, so products of the joint's own velocities vanish
        return turning, cross(carried, self._along_axis(self.x.let("u2", 2 * self.slide_speed(), "Eq. 21")))

    # -- displacements along directions ----------------------------------------------------------------------------

    def displacement(self) -> tuple[Vector, Vector]:
        turn = 0 if self.angle is None else self.own_change()
        return self._along_axis(turn), self._along_axis(self.shift_tangent())

    # -- differentiation -------------------------------------------------------------------------------------------

    def transparent(self) -> Primitives:
        if self.angle is None:
            return {}
        c, s = self.trig
        angle = self.x.entry(TURNS, 0)
        return {c: {angle: -s}, s: {angle: c}}

    @classmethod
    def turn_seed(cls, x: Scope, component: str, store: Store = MY_LANE) -> Value:
        assert cls.angle is not None
        return x.entry(DQ, cls.angle)
