"""Pose of one frame in another. Sums and quarter turns keep the decimal digits of a file."""

from __future__ import annotations

import math
from decimal import Decimal
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Three = tuple[float, float, float]

_PART: Final = math.pi / 12
_NEAR: Final = 1e-15
"""Entries of a rotation, and angles, within this distance of an exact value are taken as that value."""


class Placement:
    """Pose of a frame in an outer frame: x_outer = rotation x_inner + at.

    Parameters
    ----------
    at : three float
        The origin in the outer frame, m.
    rotation : (3, 3) array_like, optional
        Matrix from inner to outer components; if omitted, made from `rpy`.
    rpy : three float, optional
        Roll, pitch, yaw about the outer frame's fixed x, y, z axes, rad; kept as written.
    """

    __slots__ = ("_rpy", "at", "rotation")

    def __init__(self, at: Any = (0.0, 0.0, 0.0), rotation: Any = None, rpy: Any = None) -> None:
        x, y, z = (float(v) for v in at)
        self.at: Three = (x, y, z)
        self._rpy: Three | None = None if rpy is None else (float(rpy[0]), float(rpy[1]), float(rpy[2]))
        if rotation is None:
            rotation = np.eye(3) if self._rpy is None else of_rpy(*self._rpy)
        self.rotation: Array = _clean(np.array(rotation, dtype=float))

    @property
    def rpy(self) -> Three:
        """Roll, pitch, yaw: as written, or computed from the rotation."""
        if self._rpy is None:
            self._rpy = to_rpy(self.rotation)
        return self._rpy

    @property
    def is_turned(self) -> bool:
        """Whether the axes of the two frames differ."""
        return not np.array_equal(self.rotation, np.eye(3))

    @property
    def is_identity(self) -> bool:
        """Whether the two frames coincide."""
        return self.at == (0.0, 0.0, 0.0) and not self.is_turned

    def __matmul__(self, inner: Placement) -> Placement:
        """The pose, in the outer frame, of a frame whose pose in the inner frame is given."""
        at = self.point(inner.at)
        if not self.is_turned:
            return Placement(at, inner.rotation, inner._rpy)
        if not inner.is_turned:
            return Placement(at, self.rotation, self._rpy)
        return Placement(at, self.rotation @ inner.rotation)

    def inverse(self) -> Placement:
        """Pose of the outer frame in the inner frame."""
        back = Placement(rotation=self.rotation.T)
        one_turn = self._rpy is not None and np.count_nonzero(self._rpy) == 1
        rpy = [-v for v in self._rpy] if one_turn and self._rpy is not None else None
        return Placement([-v for v in back.point(self.at)], self.rotation.T, rpy)

    def point(self, x: Any) -> Three:
        """Coordinates of a point in the outer frame, m."""
        return plus(self.at, turned(self.rotation, x))

    def vector(self, x: Any) -> Three:
        """Components of a vector along the axes of the outer frame."""
        return turned(self.rotation, x)


def plus(a: Any, b: Any) -> Three:
    """a + b, computed in exact decimals: 0.1 + 0.2 is 0.3."""
    x, y, z = (exact_sum(float(i), float(j)) for i, j in zip(a, b, strict=True))
    return x, y, z


def turned(rotation: Array, x: Any) -> Three:
    """A rotation times a vector; quarter turns keep the decimal digits."""
    result = []
    for row in rotation:
        if np.all((row == 0) | (np.abs(row) == 1)):
            k = int(np.argmax(np.abs(row)))
            result.append(float(row[k]) * float(x[k]) + 0.0)
        else:
            result.append(float(row @ np.asarray(x, dtype=float)) + 0.0)
    return result[0], result[1], result[2]


def exact_sum(a: float, b: float) -> float:
    """The sum of two numbers in exact decimals."""
    if a == 0 or b == 0:
        return a + b
    return float(Decimal(repr(a)) + Decimal(repr(b)))


def of_rpy(roll: float, pitch: float, yaw: float) -> Array:
    """The rotation matrix of roll, pitch and yaw: R = Rz(yaw) Ry(pitch) Rx(roll)."""
    (cr, cp, cy), (sr, sp, sy) = (tuple(f(a) for a in (roll, pitch, yaw)) for f in (math.cos, math.sin))
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )


def to_rpy(rotation: Array) -> Three:
    """Roll, pitch, yaw of a rotation; yaw is 0 at gimbal lock, where pitch is a quarter turn.

    Roll is computed after the yaw has been removed, so that the rotation is accurate even if yaw alone is ill
    determined.
    """
    r = rotation
    yaw = math.atan2(r[1, 0], r[0, 0]) if math.hypot(r[0, 0], r[1, 0]) > _NEAR else 0.0
    c, s = math.cos(yaw), math.sin(yaw)
    pitch = math.atan2(-r[2, 0], c * r[0, 0] + s * r[1, 0])
    roll = math.atan2(s * r[0, 2] - c * r[1, 2], c * r[1, 1] - s * r[0, 1])
    one = _whole(roll), _whole(pitch), _whole(yaw)
    other = tuple(_whole(a - math.copysign(math.pi, a)) for a in one)
    other = other[0], -other[1], other[2]  # the same rotation, with roll and yaw changed by half a turn
    return min(one, other, key=lambda angles: sum(map(abs, angles)))


def of_quaternion(w: float, x: float, y: float, z: float) -> Array:
    """The rotation of a quaternion, which is normalised first."""
    e = np.array([w, x, y, z], dtype=float)
    w, x, y, z = (float(v) for v in e / np.linalg.norm(e))
    return np.array(
        [
            [w * w + x * x - y * y - z * z, 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), w * w - x * x + y * y - z * z, 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), w * w - x * x - y * y + z * z],
        ]
    )


def turning(a: Three, b: Three) -> Array:
    """The shortest rotation from unit vector a to unit vector b; if b is -a, half a turn about a perpendicular axis."""
    x, y = np.array(a), np.array(b)
    c = float(x @ y)
    if a == b:
        return np.eye(3)
    if c < -1 + 1e-12:
        across = np.cross(x, np.eye(3)[int(np.argmin(np.abs(x)))])
        across /= np.linalg.norm(across)
        half: Array = 2 * np.outer(across, across) - np.eye(3)
        return half
    v = np.cross(x, y)
    skew = np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])
    result: Array = np.eye(3) + skew + skew @ skew / (1 + c)
    return result


def without_dirt(x: Any) -> Three:
    """The vector with components of rounding size set to zero."""
    v = np.asarray(x, dtype=float)
    v = np.where(np.abs(v) < _NEAR * np.abs(v).max(), 0.0, v)
    return float(v[0]), float(v[1]), float(v[2])


def direction(x: Any) -> Three:
    """The unit vector of x, with components of rounding size set to zero."""
    v = np.asarray(x, dtype=float)
    v = v / np.abs(v).max()
    v = v / np.linalg.norm(v)
    near = np.round(v)
    v = np.where(np.abs(v - near) < _NEAR, near, v) + 0.0
    return float(v[0]), float(v[1]), float(v[2])


def _clean(rotation: Array) -> Array:
    near = np.round(rotation)
    return np.where(np.abs(rotation - near) < _NEAR, near, rotation) + 0.0


def _whole(angle: float) -> float:
    """The angle, or the multiple of pi/12 that it equals up to rounding."""
    count = round(angle / _PART)
    whole = pi_multiple(count)
    return whole if abs(angle - whole) <= 4 * _NEAR else angle + 0.0


def pi_multiple(twelfths: int) -> float:
    """A multiple of pi/12, evaluated like the expression that `pi_text` writes."""
    common = math.gcd(twelfths, 12)
    return twelfths // common * math.pi / (12 // common) if twelfths else 0.0


def pi_text(angle: float) -> str | None:
    """The text ``3*pi/4`` for an angle that has exactly this value; None for other angles."""
    count = round(angle / _PART) if abs(angle) < 1e3 else 0
    if not count or pi_multiple(count) != angle:
        return None
    common = math.gcd(count, 12)
    above, below = abs(count) // common, 12 // common
    text = ("-" if count < 0 else "") + (f"{above}*pi" if above != 1 else "pi")
    return text + (f"/{below}" if below != 1 else "")


def to_quaternion(rotation: Array) -> tuple[float, float, float, float]:
    """w, x, y, z of a rotation with w >= 0, computed from the largest component to keep all digits."""
    r = rotation
    squares = [
        1 + r[0, 0] + r[1, 1] + r[2, 2], 1 + r[0, 0] - r[1, 1] - r[2, 2],
        1 - r[0, 0] + r[1, 1] - r[2, 2], 1 - r[0, 0] - r[1, 1] + r[2, 2],
    ]  # fmt: skip
    k = int(np.argmax(squares))
    products = np.array(
        [
            [squares[0], r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]],
            [r[2, 1] - r[1, 2], squares[1], r[1, 0] + r[0, 1], r[0, 2] + r[2, 0]],
            [r[0, 2] - r[2, 0], r[1, 0] + r[0, 1], squares[2], r[2, 1] + r[1, 2]],
            [r[1, 0] - r[0, 1], r[0, 2] + r[2, 0], r[2, 1] + r[1, 2], squares[3]],
        ]
    )
    e = products[k] / np.linalg.norm(products[k])
    w, x, y, z = (float(v) + 0.0 for v in (e if e[0] >= 0 else -e))
    return w, x, y, z
