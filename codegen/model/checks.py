"""Checks of a tree of bodies: circles of parents, what fixed joints hold together, and mass properties at the defaults."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Sequence

import numpy as np

from .expressions import Expression
from .model import GROUND, Body, joint_coordinates

Finding = tuple[int, tuple[str, ...], str, str]
"""Body, path to the key, message, severity."""

PSD_TOLERANCE = 1e-12
TRIANGLE_TOLERANCE = 1e-9
SINGULAR_TOLERANCE = 1e-14


def cycles(parents: Sequence[int]) -> list[list[int]]:
    """Circles in a list of parent indices, each as a list of bodies, a child before its parent."""
    state = [0] * len(parents)  # 0 unseen, 1 on the present walk, 2 done
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


def fixed_path(a: int, b: int, bodies: Sequence[Body]) -> list[int] | None:
    """The bodies whose fixed joints hold two bodies together: none for one and the same, None if the two can move.

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
        while k != GROUND and bodies[k].joint.type == "fixed":
            k = bodies[k].parent
            path.append(k)
        paths.append(path)
    first, second = paths
    if first[-1] != second[-1]:
        return None
    while len(first) > 1 and len(second) > 1 and first[-2] == second[-2]:
        first.pop()
        second.pop()
    return [*first[:-1], *second[-2::-1]]


def _mass_and_inertia(
    bodies: Sequence[Body], value: Callable[[Expression], float]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Masses (n,), inertia matrices (n, 3, 3) and the largest entry of each (n,)."""
    mass = np.array([value(b.mass) for b in bodies])
    six = np.array([[value(e) for e in b.inertia] for b in bodies])
    inertia = six[:, [0, 3, 4, 3, 1, 5, 4, 5, 2]].reshape(len(bodies), 3, 3)
    return mass, inertia, np.abs(inertia).max(axis=(1, 2))


def check_inertia(bodies: Sequence[Body], value: Callable[[Expression], float]) -> Iterator[Finding]:
    """What is impossible or doubtful about the mass and inertia of single bodies at the default parameters.

    Parameters
    ----------
    bodies : sequence of Body
    value : callable
        Value of an expression at the default parameters.
    """
    if not bodies:
        return
    mass, inertia, scale = _mass_and_inertia(bodies, value)
    # scaled, so that huge or tiny numbers neither overflow nor vanish in the eigenvalues
    moments = np.linalg.eigvalsh(inertia / np.where(scale > 0, scale, 1.0)[:, None, None])
    for i in _where(mass < 0):
        seen = with_value(bodies[i].mass, mass[i])
        yield i, ("mass",), f"mass of {bodies[i].name!r}, {seen}, is negative; at least 0 is needed", "error"
    impossible = moments[:, 0] < -PSD_TOLERANCE
    for i in _where(impossible):
        low = moments[i, 0] * scale[i]
        message = (
            f"the inertia of {bodies[i].name!r} has the negative principal moment {low:.6g}; "
            f"none may be below 0 (kg m^2, about the centre of mass)"
        )
        yield i, ("inertia",), message, "error"
    broken = (moments[:, 2] - moments[:, 1] - moments[:, 0] > TRIANGLE_TOLERANCE * moments[:, 2]) & ~impossible
    for i in _where(broken):
        a, b, c = moments[i] * scale[i]
        message = (
            f"the principal moments of {bodies[i].name!r}, {a:.6g}, {b:.6g}, {c:.6g}, break the triangle inequality "
            f"({c:.6g} > {a:.6g} + {b:.6g}), which no real body does; harmless in a planar model"
        )
        yield i, ("inertia",), message, "warning"


def _where(condition: np.ndarray) -> list[int]:
    return [int(i) for i in np.flatnonzero(condition)]


def check_freedoms(
    bodies: Sequence[Body], value: Callable[[Expression], float], held: Collection[int] = ()
) -> Iterator[Finding]:
    """Joints that move nothing at the default parameters: their accelerations would be a division by zero.

    Parameters
    ----------
    bodies : sequence of Body
        A tree.
    value : callable
        Value of an expression at the default parameters.
    held : collection of int
        Bodies that a loop joins to another one. Their joints move what is beyond the loop too, and the loop may take
        their freedoms, so they need no mass of their own.
    """
    if not bodies:
        return
    if all(b.joint.type == "fixed" for b in bodies):
        yield 0, ("joint",), "all joints are fixed, so nothing can move; give at least one of them a freedom", "error"
        return
    mass, inertia, scale = _mass_and_inertia(bodies, value)
    n = len(bodies)
    children: list[list[int]] = [[] for _ in range(n)]
    roots: list[int] = []
    for k, body in enumerate(bodies):
        (roots if body.parent == GROUND else children[body.parent]).append(k)
    order = []
    stack = roots[::-1]
    while stack:
        k = stack.pop()
        order.append(k)
        stack.extend(children[k][::-1])
    massless = (mass == 0) & (scale == 0)
    light = massless.copy()
    light[list(held)] = False
    for k in reversed(order):
        light[k] = light[k] and all(light[c] for c in children[k])
    inside = [False] * n  # below a joint that has been reported
    for k in order:
        parent = bodies[k].parent
        inside[k] = parent != GROUND and inside[parent]
        type_ = bodies[k].joint.type
        if light[k] and not inside[k] and joint_coordinates("", type_)[1]:
            inside[k] = True
            beyond = " and everything beyond it" if children[k] else ""
            message = (
                f"the {type_} joint of {bodies[k].name!r} moves no mass: the body{beyond} has neither mass "
                f"nor inertia; give it mass or fix the joint"
            )
            yield k, ("joint",), message, "error"
        elif not children[k] and k not in held and not massless[k] and mass[k] >= 0:
            message = _idle_freedom(bodies[k], mass[k], inertia[k], value)
            if message:
                yield k, ("joint",), message, "error"


def _idle_freedom(body: Body, mass: float, inertia: np.ndarray, value: Callable[[Expression], float]) -> str:
    """Why the mass matrix is singular because of the last body of a branch, or nothing."""
    type_ = body.joint.type
    if type_ in ("prismatic", "free") and mass == 0:
        return f"the {type_} joint of {body.name!r} shifts a body with inertia but no mass; give it mass"
    if type_ not in ("revolute", "spherical", "universal", "free"):
        return ""
    c = np.array([value(e) for e in body.com])
    about = inertia if type_ == "free" else inertia + mass * (c @ c * np.eye(3) - np.outer(c, c))
    top = np.abs(about).max()
    if top == 0:
        return f"the {type_} joint of {body.name!r} turns a point mass in its centre; give the body inertia"
    about = about / top
    if type_ in ("revolute", "universal"):
        axis = np.array([value(e) for e in body.joint.axes[-1]])
        axis = axis / (np.abs(axis).max() or 1.0)
        if abs(axis @ about @ axis) <= SINGULAR_TOLERANCE * (axis @ axis):
            return f"body {body.name!r} has no inertia about the axis of its {type_} joint; give it some"
    elif -PSD_TOLERANCE <= np.linalg.eigvalsh(about)[0] <= SINGULAR_TOLERANCE:
        return f"body {body.name!r} has no inertia about one line, and its {type_} joint turns it about every line"
    return ""


def with_value(expression: Expression, value: float) -> str:
    """``L - 2 = -1``, or the number alone."""
    return f"{value:g}" if expression.is_number else f"{expression} = {value:g}"
