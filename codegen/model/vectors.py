"""Vectors, rotations and quaternions over the last axes of float arrays; all other axes broadcast."""

from __future__ import annotations

import numpy as np

Array = np.ndarray

U = np.eye(3)


def cross(a: Array, b: Array) -> Array:
    """Cross product a x b over the last axis; all other axes broadcast."""
    ax, ay, az = a[..., 0], a[..., 1], a[..., 2]
    bx, by, bz = b[..., 0], b[..., 1], b[..., 2]
    x = ay * bz - az * by
    result = np.empty((*x.shape, 3))
    result[..., 0] = x
    result[..., 1] = az * bx - ax * bz
    result[..., 2] = ax * by - ay * bx
    return result


def turn(R: Array, v: Array) -> Array:
    """Product R v over the last axes: ``(..., 3, 3)`` and ``(..., 3)``."""
    return (R @ v[..., None])[..., 0]


def skew(a: Array) -> Array:
    """Matrix of the cross product with a, ``(..., 3, 3)``."""
    K = np.zeros((*a.shape, 3))
    K[..., 2, 1], K[..., 0, 2], K[..., 1, 0] = a[..., 0], a[..., 1], a[..., 2]
    return K - np.swapaxes(K, -1, -2)


def axis_rotation(K: Array, KK: Array, angle: Array) -> Array:
    """Rotation about unit axes by angles ``(...)``: U + sin K + (1 - cos) K K, with the cross-product matrices K of the axes."""
    angle = angle[..., None, None]
    return U + np.sin(angle) * K + (1 - np.cos(angle)) * KK


def quaternion_rotation(e: Array) -> Array:
    """Rotation matrix ``(..., 3, 3)`` of the quaternion e/abs(e), with e = (w, v) over the last axis."""
    K = skew(e[..., 1:])
    two = 2 / np.sum(e * e, axis=-1)
    return U + two[..., None, None] * (e[..., 0, None, None] * K + K @ K)


def unit(a: Array) -> Array:
    return a / np.linalg.norm(a, axis=-1, keepdims=True)


def turned_quaternion(e: Array, rotation: Array) -> Array:
    """Unit quaternion of e times the quaternion of a rotation vector, both over the last axis."""
    half = np.linalg.norm(rotation, axis=-1, keepdims=True) / 2
    v = rotation / 2 * np.sinc(half / np.pi)
    w = np.cos(half)
    e0, ev = e[..., :1], e[..., 1:]
    product = np.concatenate([e0 * w - np.sum(ev * v, axis=-1, keepdims=True), e0 * v + w * ev + cross(ev, v)], axis=-1)
    return unit(product)
