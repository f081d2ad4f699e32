"""Checks of a tree of bodies: circular parents, rigidly connected bodies, and mass properties at the default
parameters."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from types import MappingProxyType

import numpy as np

from .expressions import Expression
from .members import outward
from .mobility import Driven, Value, placement, singular_joint
from .model import GROUND, Body, Joint
from .motions import Ball, Displacement, Slide, Turn

Finding = tuple[int, tuple[str, ...], str, str]
"""A result of a check: body, path to the key, message and severity."""

PSD_TOLERANCE = 1e-12
TRIANGLE_TOLERANCE = 1e-9
SINGULAR_TOLERANCE = 1e-14
DIRT = 1e-15
"""Moments of inertia below this limit, relative to mass times size squared of the whole system, are rounding errors."""


def cycles(parents: Sequence[int]) -> list[list[int]]:
    """Circles in a list of parent indices: each lists its bodies with a child before its parent."""
    state = [0] * len(parents)  # 0: not visited, 1: on the present walk, 2: finished
    found = []
    for start in range(len(parents)):
        walk = []
        k = start
        while k != GROUND and state[k] == 0:
            state[k] = 1
            walk.append(k)
            k = parents[k]
        if k != GROUND and state[k] == 1:
            found.append(walk[walk.index(k) :])
        for k in walk:
            state[k] = 2
    return found


def rigid_parts(bodies: Sequence[Body]) -> list[int]:
    """For each body, the innermost body that fixed joints connect it with: itself, another body, or the ground."""
    result = [GROUND - 1] * len(bodies)
    for k in range(len(bodies)):
        walk = []
        while k != GROUND and result[k] < GROUND and bodies[k].joint.is_fixed:
            walk.append(k)
            k = bodies[k].parent
        part = k if k == GROUND or result[k] < GROUND else result[k]
        for i in (*walk, *([k] if k != GROUND else [])):
            result[i] = part
    return result


def fixed_path(a: int, b: int, bodies: Sequence[Body]) -> list[int]:
    """The bodies whose fixed joints connect two bodies of one rigid part; empty if both are the same.

    Parameters
    ----------
    a, b : int
        Indices into `bodies`, or `GROUND`.
    bodies : sequence of Body
        A tree.
    """
    paths = []
    for k in (a, b):
        path = [k]
        while k != GROUND and bodies[k].joint.is_fixed:
            k = bodies[k].parent
            path.append(k)
        paths.append(path)
    first, second = paths
    while len(first) > 1 and len(second) > 1 and first[-2] == second[-2]:
        first.pop()
        second.pop()
    return [*first[:-1], *second[-2::-1]]


def _mass_and_inertia(bodies: Sequence[Body], value: Value) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
    """Masses (n,), inertia matrices (n, 3, 3), the largest entry of each (n,), and the size of rounding errors in moments."""
    known: dict[tuple[int, int], tuple[float, ...]] = {}  # repeated bodies share their expressions
    rows = []
    for b in bodies:
        key = id(b.mass), id(b.inertia)
        if key not in known:
            known[key] = value(b.mass), *(value(e) for e in b.inertia)
        rows.append(known[key])
    seven = np.array(rows)
    mass = seven[:, 0]
    inertia = seven[:, [1, 4, 5, 4, 2, 6, 5, 6, 3]].reshape(len(bodies), 3, 3)
    scale = np.abs(inertia).max(axis=(1, 2))
    places = {id(v): v for b in bodies for v in (b.joint.at, b.com)}
    size = max(abs(value(e)) for v in places.values() for e in v)
    with np.errstate(over="ignore"):
        whole = max(float(np.abs(mass).sum()) * size * size, float(scale.max()))
    return mass, inertia, scale, DIRT * whole if np.isfinite(whole) else 0.0


def check_inertia(
    bodies: Sequence[Body], value: Value, tolerated: Collection[int] = (), is_whole: bool = True
) -> Iterator[Finding]:
    """Impossible or doubtful masses and inertias of single bodies at the default parameters.

    A negative principal moment is not an error if it is a rounding error relative to the whole system. It is no error
    either if the body is fixed to other bodies and the combined inertia is possible.

    Parameters
    ----------
    bodies : sequence of Body
    value : callable
        Value of an expression at the default parameters.
    tolerated : collection of int
        Bodies whose impossible inertia is only a warning.
    is_whole : bool
        Whether `bodies` are all bodies of a tree; otherwise the inertias of bodies on fixed joints are not checked.
    """
    if not bodies:
        return
    mass, inertia, scale, dirt = _mass_and_inertia(bodies, value)
    # scaled, so that very large or small numbers neither overflow nor underflow in the eigenvalues
    moments = np.linalg.eigvalsh(inertia / np.where(scale > 0, scale, 1.0)[:, None, None])
    for i in _where(mass < 0):
        seen = with_value(bodies[i].mass, mass[i])
        yield i, ("mass",), f"mass of {bodies[i].name!r}, {seen}, is negative; it must be at least 0", "error"
    possible_mass = mass >= 0  # a negative mass makes the moments of a solid negative, too: one message is enough
    impossible = (moments[:, 0] < -PSD_TOLERANCE) & (moments[:, 0] * scale < -dirt) & possible_mass
    for i in _where(impossible):
        low = moments[i, 0] * scale[i]
        message = f"the inertia of {bodies[i].name!r} has the negative principal moment {low:.6g}"
        if not is_whole and bodies[i].joint.is_fixed:
            continue
        fixed = _merged_is_possible(i, bodies, mass, inertia, value, dirt) if is_whole else ""
        if fixed:
            yield i, ("inertia",), f"{message}; {fixed}", "warning"
        elif i in tolerated:
            yield i, ("inertia",), f"{message}, which is impossible; accelerations may have the wrong sign", "warning"
        else:
            message += (
                "; none may be below 0 (kg m^2, about the centre of mass); if it is intended, "
                "write check: warn beside xx, yy, ..."
            )
            yield i, ("inertia",), message, "error"
    if is_whole and _is_planar(bodies):
        return
    broken = (
        (moments[:, 2] - moments[:, 1] - moments[:, 0] > TRIANGLE_TOLERANCE * moments[:, 2])
        & ~impossible
        & possible_mass
    )
    for i in _where(broken & (scale > dirt)):
        a, b, c = moments[i] * scale[i]
        message = (
            f"the principal moments of {bodies[i].name!r}, {a:.6g}, {b:.6g}, {c:.6g}, violate the triangle inequality "
            f"({c:.6g} > {a:.6g} + {b:.6g}), which is impossible; it has no effect in a planar model"
        )
        yield i, ("inertia",), message, "warning"


def _is_planar(bodies: Sequence[Body]) -> bool:
    """Whether all bodies rotate about one coordinate axis at most, and slide across it, by joints without rotated frames; then
    only moments of inertia about this axis have an effect."""
    turned: set[int] = set()
    across: set[int] = {0, 1, 2}
    for joint in (b.joint for b in bodies):
        if joint.rotation or joint.type not in ("fixed", "revolute", "prismatic"):
            return False
        for axis in joint.axes:
            if any(e.tree[0] != "number" for e in axis):
                return False
            along = {i for i, e in enumerate(axis) if e.value}
            if joint.type == "prismatic":
                across -= along
            elif len(along) != 1:
                return False
            else:
                turned |= along
    return len(turned) <= 1 and turned <= across


def _where(condition: np.ndarray) -> list[int]:
    return [int(i) for i in np.flatnonzero(condition)]


def _merged_is_possible(
    k: int, bodies: Sequence[Body], mass: np.ndarray, inertia: np.ndarray, value: Value, dirt: float
) -> str:
    """Reason why a body's impossible inertia has no effect, since only a combined inertia counts; empty if it has an
    effect."""
    root = k
    while root != GROUND and bodies[root].joint.is_fixed:
        root = bodies[root].parent
    if root == GROUND:
        return "the body is fixed to the ground, so this has no effect"
    children: dict[int, list[int]] = {}
    for i, b in enumerate(bodies):
        if b.joint.is_fixed:
            children.setdefault(b.parent, []).append(i)
    members = [(root, np.eye(3), np.zeros(3))]
    for i, turn, origin in members:  # the list grows in the loop
        for c in children.get(i, ()):
            at, own = placement(bodies[c].joint, value)
            members.append((c, turn @ own, origin + turn @ at))
    if len(members) == 1:
        return ""
    with np.errstate(all="ignore"):
        centers = {i: origin + turn @ [value(e) for e in bodies[i].com] for i, turn, origin in members}
        total = sum(mass[i] for i in centers)
        middle = sum(mass[i] * c for i, c in centers.items()) / (total or 1.0)
        whole = sum(turn @ inertia[i] @ turn.T + mass[i] * _parallel(centers[i] - middle) for i, turn, _ in members)
        scale = float(np.abs(whole).max())
    if not np.isfinite(scale) or scale == 0:
        return ""
    low = float(np.linalg.eigvalsh(whole / scale)[0])
    if low < -PSD_TOLERANCE and low * scale < -dirt:
        return ""
    others = ", ".join(repr(bodies[i].name) for i, *_ in members[:4] if i != k)
    return f"with the bodies fixed to it ({others}{', ...' if len(members) > 4 else ''}) the inertia is possible"


def _parallel(c: np.ndarray) -> np.ndarray:
    """Inertia (3, 3) of a unit point mass at c."""
    return c @ c * np.eye(3) - np.outer(c, c)


def check_freedoms(
    bodies: Sequence[Body],
    value: Value,
    held: Collection[int] = (),
    driven: Driven = MappingProxyType({}),
) -> Iterator[Finding]:
    """Joints that move no mass at the default parameters: their accelerations would be divided by zero.

    Parameters
    ----------
    bodies : sequence of Body
        A tree.
    value : callable
        Value of an expression at the default parameters.
    driven : mapping of int to list of int
        Prescribed coordinates, by body and index in its joint: they need no inertia.
    held : collection of int
        Bodies that a loop joins to others. They need no mass of their own: their joints also move bodies beyond the loop, and
        the loop may determine their coordinates.
    """
    if not bodies:
        return
    if all(b.joint.is_fixed for b in bodies):
        yield 0, ("joint",), "all joints are fixed, so nothing can move; give at least one a degree of freedom", "error"
        return
    mass, inertia, scale, dirt = _mass_and_inertia(bodies, value)
    children, order = outward(bodies)
    massless = (mass == 0) & (scale <= dirt)
    light = massless.copy()
    light[list(held)] = False
    for k in reversed(order):
        light[k] = light[k] and all(light[c] for c in children[k])
    inside = [False] * len(bodies)  # outboard of a joint that has been reported
    sound = True
    for k in order:
        parent = bodies[k].parent
        inside[k] = parent != GROUND and inside[parent]
        type_ = bodies[k].joint.type
        if k in driven:  # `singular_joint` checks the coordinates of this joint that are not prescribed
            continue
        if light[k] and not inside[k] and not bodies[k].joint.is_fixed and not _all_geared(bodies[k].joint, value):
            inside[k] = True
            beyond = " and everything outboard" if children[k] else ""
            message = (
                f"the {type_} joint of {bodies[k].name!r} moves no mass: the body{beyond} has neither mass "
                f"nor inertia; give it mass, the joint an armature, or fix the joint"
            )
            sound = False
            yield k, ("joint",), message, "error"
            continue
        ends = not children[k] and k not in held and not massless[k] and mass[k] >= 0
        if ends and not _all_geared(bodies[k].joint, value):
            message = _idle_freedom(bodies[k], mass[k], inertia[k], value)
            if message:
                sound = False
                yield k, ("joint",), message, "error"
    if sound and not held:
        yield from _giving_way(bodies, singular_joint(bodies, order, mass, inertia, value, driven))


def _giving_way(bodies: Sequence[Body], singular: int | None) -> Iterator[Finding]:
    """The error for a joint whose body can move without moving mass, because joints outboard of it move as well."""
    if singular is not None:
        message = (
            f"the {bodies[singular].joint.type} joint of {bodies[singular].name!r} is free to move without moving any mass, "
            f"in every configuration, because the joints outboard give way; give the body mass and inertia"
        )
        yield singular, ("joint",), message, "error"


def _all_geared(joint: Joint, value: Value) -> bool:
    """Whether a rotor resists every degree of freedom of a joint, whatever the body's own inertia is."""
    return bool(joint.armature) and all(value(e) > 0 for e in joint.armature)


def _idle_freedom(body: Body, mass: float, inertia: np.ndarray, value: Value) -> str:
    """Reason why the last body of a branch makes the mass matrix singular; empty if it does not.

    Joints that slide and turn by different coordinates are left to `singular_joint`.
    """
    type_, motion = body.joint.type, body.joint.kind.motion
    turning = {m.index for m in motion if isinstance(m, Turn)}
    slides = {m.index for m in motion if isinstance(m, Slide)} - turning
    last = motion[-1] if motion else None
    anywhere = any(isinstance(m, Displacement) for m in motion)
    if mass == 0 and (slides or anywhere):
        return f"the {type_} joint of {body.name!r} displaces a body with inertia but no mass; give it mass"
    if slides or not isinstance(last, Turn | Ball):
        return ""
    with np.errstate(over="ignore", invalid="ignore"):
        c = np.array([value(e) for e in body.com])
        about = inertia if anywhere else inertia + mass * _parallel(c)
        top = float(np.abs(about).max())
    if not np.isfinite(top):
        return ""
    if top == 0:
        return f"the {type_} joint of {body.name!r} rotates a point mass about its centre; give the body inertia"
    about = about / top
    if isinstance(last, Turn):
        axis = np.array([value(e) for e in body.joint.axes[last.axis]])
        axis = axis / (np.abs(axis).max() or 1.0)
        if abs(axis @ about @ axis) <= SINGULAR_TOLERANCE * (axis @ axis):
            return f"body {body.name!r} has no inertia about the axis of its {type_} joint; give it some"
    elif -PSD_TOLERANCE <= np.linalg.eigvalsh(about)[0] <= SINGULAR_TOLERANCE:
        return f"body {body.name!r} has no inertia about one line, but its {type_} joint rotates it about every line"
    return ""


def with_value(expression: Expression, value: float) -> str:
    """Text with the value: ``L - 2 = -1``, or the number alone."""
    return f"{value:g}" if expression.is_number else f"{expression} = {value:g}"
