"""Numerical check whether a joint of a tree can move without moving mass, in every configuration."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from random import Random

import numpy as np

from .chains import Chain, step
from .expressions import Expression
from .model import GROUND, Body, Joint
from .vectors import axis_rotation, skew, unit

Value = Callable[[Expression], float]
"""Type of a function that gives the value of an expression at the default parameters."""
Driven = Mapping[int, Sequence[int]]
"""Prescribed coordinates, by body and index in its joint."""

MAX_BODIES = 1000
"""Larger systems are not checked, because the sweep is written for clarity, not for speed."""

_TOLERANCE = 1e-13
_STATES = 2


def placement(joint: Joint, value: Value) -> tuple[np.ndarray, np.ndarray]:
    """Origin (3,) and rotation (3, 3) of a joint's frame in the parent's body frame."""
    turn = np.eye(3)
    for axis, angle in joint.rotation:
        a = np.array([value(e) for e in axis])
        K = skew(unit(a / np.abs(a).max()))
        turn = turn @ axis_rotation(K, K @ K, np.array(value(angle)))
    return np.array([value(e) for e in joint.at]), turn


def singular_joint(
    bodies: Sequence[Body],
    order: Sequence[int],
    mass: np.ndarray,
    inertia: np.ndarray,
    value: Value,
    driven: Driven,
) -> int | None:
    """The first body, outward, whose joint has zero articulated inertia at random configurations; None if there is none.

    If every body's own inertia resists its joint, all joints move mass, and nothing is computed.

    Parameters
    ----------
    order : sequence of int
        Parents before children.
    mass, inertia : (n,) and (n, 3, 3) arrays
        At the default parameters; the inertia about the centres of mass.
    driven : mapping of int to sequence of int
        Prescribed coordinates, by body and index in its joint: they do not move freely.
    """
    if len(bodies) > MAX_BODIES and len({id(b.joint) for b in bodies}) > MAX_BODIES:
        return None
    resists: dict[tuple[int, ...], bool] = {}  # repeated bodies share their expressions
    for k, b in enumerate(bodies):
        key = id(b.joint), id(b.mass), id(b.com), id(b.inertia), *driven.get(k, ())
        if key not in resists:
            resists[key] = _resists(b, mass[k], inertia[k], value, driven.get(k, ()))
    if all(resists.values()) or len(bodies) > MAX_BODIES:
        return None
    rng = Random(1)
    with np.errstate(all="ignore"):
        found = [_singular_at(rng, bodies, order, mass, inertia, value, driven) for _ in range(_STATES)]
    common = set(found[0]).intersection(*found[1:])
    return next((k for k in order if k in common), None)


def _resists(body: Body, mass: float, inertia: np.ndarray, value: Value, driven: Sequence[int]) -> bool:
    """Whether a body's own inertia resists every degree of freedom of its joint."""
    if len(driven) == len(body.joint.kind.speeds):
        return True
    with np.errstate(all="ignore"):
        s = np.delete(_freedoms(body.joint, Random(2), value)[2], driven, axis=1)
        own = _spatial(mass, np.array([value(e) for e in body.com]), inertia)
        pivot = s.T @ own @ s + armature_matrix(body.joint, value, driven)
        scale = float(np.abs(pivot).max())
    if not np.isfinite(scale) or scale == 0:
        return scale != 0
    return bool(np.abs(np.linalg.eigvalsh(pivot / scale)).min() > _TOLERANCE)


def _singular_at(
    rng: Random,
    bodies: Sequence[Body],
    order: Sequence[int],
    mass: np.ndarray,
    inertia: np.ndarray,
    value: Value,
    driven: Driven,
) -> list[int]:
    """Bodies whose joints have a singular articulated inertia at one random configuration."""
    shift, freedoms, articulated, composite = {}, {}, {}, {}
    for k in order:
        at, turn = placement(bodies[k].joint, value)
        own_turn, own_at, columns = _freedoms(bodies[k].joint, rng, value)
        freedoms[k] = np.delete(columns, driven.get(k, ()), axis=1) if k in driven else columns
        at, turn = at + turn @ own_at, turn @ own_turn
        # transforms motion of the parent's frame to the body's: angular part first, body components
        shift[k] = np.zeros((6, 6))
        shift[k][:3, :3] = shift[k][3:, 3:] = turn.T
        shift[k][3:, :3] = -turn.T @ skew(at)
        articulated[k] = _spatial(mass[k], np.array([value(e) for e in bodies[k].com]), inertia[k])
        composite[k] = articulated[k].copy()
    singular = []
    for k in reversed(order):
        s, a = freedoms[k], articulated[k]
        if s.shape[1]:
            u = a @ s
            rotors = armature_matrix(bodies[k].joint, value, driven.get(k, ()))
            pivot = s.T @ u + rotors
            full = np.sqrt(np.abs(np.diag(s.T @ composite[k] @ s + rotors)))
            full[full == 0] = 1.0
            if not np.isfinite(pivot).all() or not np.isfinite(full).all():
                return []  # numbers are too large for a decision
            values, vectors = np.linalg.eigh(pivot / np.outer(full, full))
            good = np.abs(values) > _TOLERANCE
            if not good.all():
                singular.append(k)
            basis = vectors[:, good] / full[:, None]  # inverse on the subspace in which the inertia is not zero
            a = a - (u @ basis / values[good]) @ (u @ basis).T
        parent = bodies[k].parent
        if parent != GROUND:
            articulated[parent] += shift[k].T @ a @ shift[k]
            composite[parent] += shift[k].T @ composite[k] @ shift[k]
    return singular


def armature_matrix(joint: Joint, value: Value, driven: Sequence[int] = ()) -> np.ndarray:
    """Reflected rotor inertias (f, f) along those degrees of freedom of a joint that are not `driven`."""
    found = np.array([value(e) for e in joint.armature]) if joint.armature else np.zeros(len(joint.kind.speeds))
    return np.diag(np.delete(found, driven))


def _freedoms(joint: Joint, rng: Random, value: Value) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rotation and displacement of the body in the joint frame at random coordinates, and its partial velocities (6, f)."""
    kind = joint.kind
    if not kind.motion:
        return np.eye(3), np.zeros(3), np.zeros((6, 0))
    axes = np.array([[value(e) for e in axis] for axis in joint.axes]).reshape(-1, 3)
    axes = unit(axes / np.abs(axes).max(axis=1, keepdims=True))
    factors = np.array([[value(e) for e in joint.factors]])
    chain = Chain(kind.motion, [step(m, np.array([0]), axes[None], factors) for m in kind.motion])
    # Python's random numbers, because the import of NumPy's takes longer than the whole check
    q = np.array([[rng.uniform(0.3, 2.8) for _ in kind.coordinates]])
    R, d = chain.transforms(q)
    w, v = (screw[0].T.copy() for screw in chain.unit_screws(set(range(len(kind.motion))) - set(chain.altered)))
    for i, (w_own, v_own) in zip(chain.altered, chain.screws(q), strict=True):
        for total, own in ((w, w_own), (v, v_own)):
            if own is not None:
                total[:, chain.steps[i].speeds] += own.reshape(-1, 3).T
    return np.eye(3) if R is None else R[0, 0], np.zeros(3) if d is None else d.reshape(3), np.concatenate([w, v])


def _spatial(mass: float, com: np.ndarray, inertia: np.ndarray) -> np.ndarray:
    """Spatial inertia (6, 6) about the body's origin, angular part first."""
    cross = skew(com)
    return np.block([[inertia - mass * cross @ cross, mass * cross], [-mass * cross, mass * np.eye(3)]])
