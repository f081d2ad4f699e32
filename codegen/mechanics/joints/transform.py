"""Joints: how vectors and inertias pass between the frame of a link and that of its parent.

A revolute joint turns about an axis of its link's frame by q: one plane rotation, so a vector costs six operations and
an inertia is turned with the products ``c^2, s^2, c s``. The constant rotation between the parent's frame and the
joint at q = 0 is the constant ``R`` (parent components from joint components), mostly the identity.
A spherical or free joint has a rotation matrix made of its quaternion.

The sine and cosine of q and the entries of a quaternion's matrix are transparent to differentiation
(`JointTransform.transparent`): their tangent is a rotation vector, one number or three.
"""

from __future__ import annotations

from ...program.block import Scope
from ...program.field import XYZ
from ...program.scalar import Matrix, Value, Vector
from .. import fields
from ..spatial import add, dot, matmul, matvec, six, skew, symmetric, transpose
from ..stores import CONSTANTS, COORDINATES, ME, TRIG, TURNS
from ..structure.kinds import LinkKind


class JointTransform:
    """The motion between a link and its parent, as statements of an expansion.

    Parameters
    ----------
    x : Expansion or StructuralExpansion
    kind : LinkKind
    lanes : bool
        Whether the vectors that are passed are one per direction.
    """

    def __init__(self, x: Scope, kind: LinkKind, lanes: bool = False):
        self.x = x
        self.lanes = lanes
        self.joint: str = kind.joint
        self.axis: int = kind.axis
        self.fixed: Matrix | None = None
        if not kind.aligned:
            self.fixed = x.load(CONSTANTS, fields.joint_attitude)
        self._trig: tuple[Value, Value] | None = None
        self._squares: tuple[Value, Value, Value] | None = None
        self._matrix: Matrix | None = None

    # -- what the coordinates give ---------------------------------------------------------------------------------

    @property
    def trig(self) -> tuple[Value, Value]:
        """Cosine and sine of a revolute joint's coordinate."""
        if self._trig is None:
            self._trig = self.x.load(TRIG, fields.cosine), self.x.load(TRIG, fields.sine)
        return self._trig

    @property
    def squares(self) -> tuple[Value, Value, Value]:
        if self._squares is None:
            c, s = self.trig
            let = self.x.let
            self._squares = let("cc", c * c, "Eq. 22"), let("ss", s * s, "Eq. 22"), let("cs", c * s, "Eq. 22")
        return self._squares

    @property
    def matrix(self) -> Matrix:
        """Rotation matrix of a quaternion joint, parent side from child components."""
        if self._matrix is None:
            self._matrix = self.x.load(ME, fields.quaternion_matrix)
        return self._matrix

    def _let(self, name: str, value: Value, tag: str) -> Value:
        return self.x.let(name, value, tag, lanes=self.lanes)

    def offset(self) -> Vector:
        """Origin of the link in its parent's frame."""
        x = self.x
        r = x.load(CONSTANTS, fields.joint_place)
        if self.joint == "prismatic":
            q = x.entry(COORDINATES, 0)
            if self.fixed is None:
                r[self.axis] = x.let("r_q", r[self.axis] + q, "Eq. 22")
            else:
                r = x.let_vector("r", [r[k] + self.fixed[k][self.axis] * q for k in range(3)], "Eq. 22")
        elif self.joint == "free":
            position = [x.entry(COORDINATES, i) for i in range(3)]
            moved = position if self.fixed is None else matvec(self.fixed, position)
            r = x.let_vector("r", add(r, moved), "Eq. 22")
        return r

    # -- vectors ---------------------------------------------------------------------------------------------------

    def to_child(self, v: Vector, name: str, tag: str) -> Vector:
        """Components in the link's frame of a vector given in its parent's."""
        v = [self._let(f"{name}_p{i}", v[k], tag) for k, i in enumerate(XYZ)]
        if self.fixed is not None:
            v = matvec(transpose(self.fixed), v)
            v = [self._let(f"{name}_f{i}", v[k], tag) for k, i in enumerate(XYZ)]
        if self.joint == "revolute":
            c, s = self.trig
            i, j = (self.axis + 1) % 3, (self.axis + 2) % 3
            v = list(v)
            v[i], v[j] = (
                self._let(f"{name}_{XYZ[i]}", c * v[i] + s * v[j], tag),
                self._let(f"{name}_{XYZ[j]}", c * v[j] - s * v[i], tag),
            )
        elif self.joint in ("spherical", "free"):
            v = matvec(transpose(self.matrix), v)
            v = [self._let(f"{name}_{i}", v[k], tag) for k, i in enumerate(XYZ)]
        return v

    def to_parent(self, v: Vector, name: str, tag: str) -> Vector:
        """Components in the parent's frame of a vector given in the link's."""
        v = [self._let(f"{name}_c{i}", v[k], tag) for k, i in enumerate(XYZ)]
        if self.joint == "revolute":
            c, s = self.trig
            i, j = (self.axis + 1) % 3, (self.axis + 2) % 3
            v = list(v)
            v[i], v[j] = (
                self._let(f"{name}_{XYZ[i]}", c * v[i] - s * v[j], tag),
                self._let(f"{name}_{XYZ[j]}", c * v[j] + s * v[i], tag),
            )
        elif self.joint in ("spherical", "free"):
            v = matvec(self.matrix, v)
            v = [self._let(f"{name}_{i}", v[k], tag) for k, i in enumerate(XYZ)]
        if self.fixed is not None:
            v = matvec(self.fixed, v)
            v = [self._let(f"{name}_f{i}", v[k], tag) for k, i in enumerate(XYZ)]
        return v

    # -- inertias --------------------------------------------------------------------------------------------------

    def inertia_to_parent(self, J: Matrix, H: Matrix, M: Matrix, tag: str) -> tuple[Matrix, Matrix, Matrix]:
        """The blocks of a generalised inertia in the parent's axes, about the same point."""
        if self.joint == "revolute":
            J = self._turn_symmetric(J, "J", tag)
            M = self._turn_symmetric(M, "M", tag)
            H = self._turn(H, "H", tag)
        elif self.joint in ("spherical", "free"):
            J, H, M = self._rotate_all(self.matrix, J, H, M, tag)
        if self.fixed is not None:
            J, H, M = self._rotate_all(self.fixed, J, H, M, tag)
        return J, H, M

    def _rotate_all(self, R: Matrix, J: Matrix, H: Matrix, M: Matrix, tag: str) -> tuple[Matrix, Matrix, Matrix]:
        def named(m: Matrix, name: str) -> Matrix:
            return [[self.x.let(f"{name}{i}{j}", m[i][j], tag) for j in range(3)] for i in range(3)]

        def turned(m: Matrix, name: str, is_symmetric: bool) -> Matrix:
            half = named(matmul(R, named(m, name + "_in")), name + "_h")
            if is_symmetric:
                entries = [dot(half[i], R[j]) for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))]
                return symmetric([self.x.let(f"{name}_r", e, tag) for e in entries])
            return named(matmul(half, transpose(R)), name + "_r")

        return turned(J, "J", True), turned(H, "H", False), turned(M, "M", True)

    def _turn_symmetric(self, m: Matrix, name: str, tag: str) -> Matrix:
        """``R m R^T`` of a plane rotation.

        Written with the squares of sine and cosine: the shorter ``m_bb - s (s d + c e)`` loses a small diagonal entry next
        to a large one at a right angle.
        """
        let = self.x.let
        a, b, c = self.axis, (self.axis + 1) % 3, (self.axis + 2) % 3
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
        """``R m R^T`` of a plane rotation, m not symmetric."""
        let = self.x.let
        a, b, c = self.axis, (self.axis + 1) % 3, (self.axis + 2) % 3
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

    # -- differentiation -------------------------------------------------------------------------------------------

    def transparent(self) -> dict[Value, dict[Value, Value]]:
        """Derivatives of sine, cosine and matrix entries with respect to the rotation of the link."""
        x = self.x
        result: dict[Value, dict[Value, Value]] = {}
        if self.joint == "revolute":
            c, s = self.trig
            angle = x.entry(TURNS, 0)
            result = {c: {angle: -s}, s: {angle: c}}
        elif self.joint in ("spherical", "free"):
            R = self.matrix
            turn = [x.entry(TURNS, i) for i in range(3)]
            for i in range(3):
                for j in range(3):
                    k, n = (j + 1) % 3, (j + 2) % 3
                    # d R = R [delta x], delta in the link's frame
                    result[R[i][j]] = {turn[n]: R[i][k], turn[k]: -R[i][n]}
        return result


def shift_inertia(x: Scope, r: Vector, J: Matrix, H: Matrix, M: Matrix, tag: str) -> tuple[Matrix, Matrix, Matrix]:
    """The blocks of a generalised inertia about a point at -r: Eq. 44's ``S I S^T``."""
    let = x.let
    rM = matmul_named(x, skew(r), M, "rM", tag)
    H_out = [[let("H_s", H[i][j] + rM[i][j], tag) for j in range(3)] for i in range(3)]
    X = skew(r)
    first = matmul(X, transpose(H))
    second = matmul(H_out, transpose(X))
    J_out = [[J[i][j] + first[i][j] + second[i][j] if j >= i else 0 for j in range(3)] for i in range(3)]
    return symmetric(six(J_out)), H_out, M


def matmul_named(x: Scope, a: Matrix, b: Matrix, name: str, tag: str) -> Matrix:
    """A product whose single terms are named, so that a symmetric factor's are computed once."""
    out: Matrix = []
    for row in a:
        line = []
        for j in range(3):
            terms = [x.let(name, row[k] * b[k][j], tag) for k in range(3)]
            line.append(terms[0] + terms[1] + terms[2])
        out.append(line)
    return out
