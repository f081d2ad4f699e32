"""All types of joints, a few more that only the tests know, and their poses from elementary matrices in 50 digits.

What is tested for every type is so for a new one without a line here.
"""

from __future__ import annotations

from typing import Any

import mpmath
import numpy as np
import pytest
from random_models import expression, vector

from codegen.model.entries import Axis, Expr
from codegen.model.expressions import functions_for
from codegen.model.joints import JOINTS, JointType
from codegen.model.model import GROUND, Body, Joint, Model
from codegen.model.motions import Ball, Displacement, Slide, Turn

DIGITS = 50


class Helical(JointType):
    """A rotation and a displacement that share one coordinate."""

    name = "helical"
    motion = (Turn(axis=0, index=0), Slide(axis=0, index=0, factor=0))

    axis: Axis
    pitch: Expr


class Polar(JointType):
    """A displacement away from the axis of the preceding rotation, which carries it along."""

    name = "polar"
    motion = (Turn(axis=0, index=0), Slide(axis=1, index=1), Turn(axis=1, index=2))

    axes: tuple[Axis, Axis]


class Corkscrew(JointType):
    """A rotation that a later rotation turns, and a displacement that it does not turn, with one coordinate."""

    name = "corkscrew"
    motion = (Turn(axis=0, index=0), Slide(axis=1, index=0, factor=0), Turn(axis=1, index=1))

    axes: tuple[Axis, Axis]
    pitch: Expr


class Gimballed(JointType):
    """A displacement that several rotations follow."""

    name = "gimballed"
    motion = (Displacement(coordinate=3, speed=3), Turn(0, 0), Turn(1, 1), Turn(0, 2))

    axes: tuple[Axis, Axis]


class Geared(JointType):
    """A displacement by a multiple of its coordinate, followed by a ball joint."""

    name = "geared"
    motion = (Slide(axis=0, index=0, factor=0), Ball(coordinate=1, speed=1))

    axis: Axis
    gain: Expr


OTHERS = {kind.name: kind for kind in (Helical, Polar, Corkscrew, Gimballed, Geared)}

TYPES: list[type[JointType]] = [*JOINTS.values(), *OTHERS.values()]

every_type = pytest.mark.parametrize("kind", TYPES, ids=lambda kind: kind.name)


@pytest.fixture(autouse=True)
def known_types(monkeypatch):
    """Registers the joint types of the tests as types of joints."""
    for name, kind in OTHERS.items():
        monkeypatch.setitem(JOINTS, name, kind)


# --- joints -------------------------------------------------------------------------------------------------------------


def given_axes(kind: type[JointType], rng: np.random.Generator) -> list[list[float]]:
    """Axes as a model file may give them: in any direction, perpendicular if there are several, not of unit length."""
    columns = np.linalg.qr(rng.normal(size=(3, 3)))[0].T * rng.uniform(0.5, 2, (3, 1))
    return columns[: len(kind.axis_keys)].tolist()


def joint(kind: type[JointType], rng: np.random.Generator, placed: bool = False) -> Joint:
    """A joint of a type with random axes and factors; with `placed`, also with a random pose in its parent."""
    axes = kind.axes_of_motion(tuple(vector(*a) for a in given_axes(kind, rng)), {})
    factors = tuple(expression(float(x)) for x in rng.uniform(0.3, 0.9, len(kind.factor_keys)))
    if not placed:
        return Joint(kind.name, axes, vector(0, 0, 0), (), factors)
    at = vector(*rng.uniform(-0.8, 0.8, 3).tolist())
    turns = ((vector(*rng.normal(size=3).tolist()), expression(float(rng.uniform(-2, 2)))),)
    return Joint(kind.name, axes, at, turns, factors)


def body(name: str, parent: int, joint: Joint, rng: np.random.Generator) -> Body:
    moments = np.diag(rng.uniform(0.2, 0.4, 3)) + 0.03
    inertia = np.trace(moments) * np.eye(3) - moments
    six = tuple(expression(float(inertia[i])) for i in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)))
    return Body(name, parent, joint, expression(1.3), vector(*rng.uniform(-0.4, 0.4, 3).tolist()), six)


def one_body(kind: type[JointType], rng: np.random.Generator) -> Model:
    return Model("m", None, (), (), (body("b", GROUND, joint(kind, rng), rng),))


def coordinates(model: Model, rng: np.random.Generator) -> np.ndarray:
    """Random coordinates of a model; quaternions have unit length."""
    q = rng.uniform(-1.5, 1.5, model.nq)
    for _, place in model.quaternions:
        q[place] /= np.linalg.norm(q[place])
    return q


# --- poses and motions in extended precision, from nothing but what the motions say they are ------------------------------


def skew(a: Any) -> mpmath.matrix:
    x, y, z = a
    return mpmath.matrix([[0, -z, y], [z, 0, -x], [-y, x, 0]])


def product(a: list, b: list) -> list:
    """Hamilton's product of two quaternions."""
    v, w = mpmath.matrix(a[1:]), mpmath.matrix(b[1:])
    vector = a[0] * w + b[0] * v + skew(a[1:]) * w
    return [a[0] * b[0] - (v.T * w)[0], *vector]


def numbers(joint: Joint) -> tuple[list, list]:
    """The unit axes and the factors of a joint, as numbers."""
    axes = [mpmath.matrix([e.evaluate({}, functions_for(mpmath)) for e in axis]) for axis in joint.axes]
    return [a / mpmath.norm(a) for a in axes], [mpmath.mpf(float(e.value)) for e in joint.factors]


def pose(joint: Joint, q: list) -> mpmath.matrix:
    """The child's frame in the joint's, (4, 4): the product of the elementary motions' matrices."""
    axes, factors = numbers(joint)
    T = mpmath.eye(4)
    for m in joint.kind.motion:
        own = mpmath.eye(4)
        match m:
            case Turn():
                K = skew(axes[m.axis])
                own[:3, :3] += mpmath.sin(q[m.index]) * K + 2 * mpmath.sin(q[m.index] / 2) ** 2 * K * K
            case Slide():
                own[:3, 3] = axes[m.axis] * q[m.index] * (1 if m.factor is None else factors[m.factor])
            case Ball():
                e = list(q[m.coordinate : m.coordinate + 4])
                inverse = [e[0], -e[1], -e[2], -e[3]]
                for i in range(3):
                    unit = [0, *(int(i == n) for n in range(3))]
                    own[:3, i] = mpmath.matrix(product(product(e, unit), inverse)[1:]) / sum(x * x for x in e)
            case Displacement():
                own[:3, 3] = mpmath.matrix(q[m.coordinate : m.coordinate + 3])
        T = T * own
    return T


def moved(joint: Joint, q: list, u: list, s: Any) -> list:
    """Coordinates after a time s at speeds u, to first order in s."""
    result, R = list(q), pose(joint, q)[:3, :3]
    for m in joint.kind.motion:
        match m:
            case Turn() | Slide():
                result[m.index] = q[m.index] + s * u[m.index]
            case Ball():
                step = [1, *(s * w / 2 for w in u[m.speed : m.speed + 3])]
                result[m.coordinate : m.coordinate + 4] = product(list(q[m.coordinate : m.coordinate + 4]), step)
            case Displacement():
                way = R * mpmath.matrix(u[m.speed : m.speed + 3]) * s
                result[m.coordinate : m.coordinate + 3] = [q[m.coordinate + i] + way[i] for i in range(3)]
    return result


def twist(joint: Joint, q: list, u: list) -> np.ndarray:
    """Angular velocity and velocity of the child's origin at speeds u, child components, (6,): the pose differentiated."""
    T, h = pose(joint, q), mpmath.mpf(10) ** (-mpmath.mp.dps // 3)
    rate = (pose(joint, moved(joint, q, u, h)) - pose(joint, moved(joint, q, u, -h))) / (2 * h)  # exact to h^2
    R = T[:3, :3]
    W, v = R.T * rate[:3, :3], R.T * rate[:3, 3]
    return np.array([W[2, 1], W[0, 2], W[1, 0], *v], dtype=object)


def extended(x: Any) -> list:
    return [mpmath.mpf(float(value)) for value in x]
