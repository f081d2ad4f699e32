"""Impossible masses and inertias: the import reports them, and repairs them on request."""

from __future__ import annotations

import math
from collections.abc import Collection
from typing import Final

import numpy as np

from ..model.checks import DIRT, PSD_TOLERANCE, TRIANGLE_TOLERANCE
from ..model.errors import Problem
from ..model.positions import shortened
from .bodies import Bodies, ImportedBody
from .placement import Array
from .robot import Robot, RobotJoint

FIXED: Final = "; repaired: the joint is fixed"
_LARGEST: Final = 1e150
"""Largest number accepted; its square is still finite."""
_WATER: Final = 1000.0
"""Density of the balls that replace point masses: the density of water, kg/m^3."""


def fix_massless(robot: Robot, held: Collection[str], repair: bool) -> list[Problem]:
    """Find joints that move no mass and no rotor, and fix them on request.

    Parameters
    ----------
    robot : Robot
        Every link leads to the ground; joints are changed if they are repaired.
    held : collection of str
        Links that loops hold: these may be massless.
    repair : bool

    Returns
    -------
    list of Problem
        Errors, or warnings that describe the repair.
    """
    beyond: dict[str, bool] = {}
    order = list(robot.depth_first())
    children = robot.children()
    found = []
    for joint in reversed(order):
        empty = robot.links[joint.child].inertia.is_nothing and joint.child not in held
        beyond[joint.child] = empty and all(beyond[c.child] for c in children.get(joint.child, []))
    for joint in order:
        if not beyond[joint.child] or joint.type == "fixed" or (joint.armature and all(joint.armature)):
            continue
        what = f"{_named(joint)} moves nothing: link {shortened(joint.child)} and all outboard links are without mass and inertia"
        if repair:
            found.append(joint.place.problem(f"{what}{FIXED}", "warning"))
            joint.type, joint.axes, joint.laws, joint.start, joint.armature = "fixed", (), (), (), ()
        else:
            found.append(joint.place.problem(f"{what}; give the link mass and inertia, or --repair fixes the joint"))
    if not repair:
        return found
    gone = {joint.name for joint in order if joint.type == "fixed"}
    robot.couplings = [c for c in robot.couplings if c.joint not in gone and c.of not in gone]
    return found


def _named(joint: RobotJoint) -> str:
    return f"joint {shortened(joint.name)}" if joint.name else f"the free joint of link {shortened(joint.child)}"


def check_finite(robot: Robot, bodies: Bodies) -> list[Problem]:
    """Finds bodies and loops whose numbers became too large when links were merged."""
    found = []
    for closing in robot.closings:
        faces = [v for _, f in (closing.start, closing.end) for v in (*f.at, *f.rotation.ravel())]
        if not np.abs(faces + [v for axis in closing.axes for v in axis]).max() < _LARGEST:
            what = f"the numbers of loop {shortened(closing.name)} are not finite"
            found.append(closing.place.problem(f"{what}, or above {_LARGEST:g}; smaller ones are needed"))
    for body in bodies.all.values():
        inertia, frame = body.inertia, body.frame
        joint = body.joint
        numbers = [inertia.mass, *inertia.com, *inertia.matrix.ravel(), *frame.at, *frame.rotation.ravel()]
        numbers += [joint.pitch, *joint.start, *(v for three in (*joint.laws, *joint.axes) for v in three)]
        size = np.abs(numbers).max()
        if not size < _LARGEST:
            what = f"the combined numbers of link {shortened(body.link.name)} and of links fixed to it are not finite"
            found.append(body.link.place.problem(f"{what}, or above {_LARGEST:g}; smaller ones are needed"))
    return found


def check_inertias(robot: Robot, bodies: Bodies, repair: bool) -> list[Problem]:
    """Finds impossible inertias and repairs them on request; without repair they are kept, with a warning."""
    whole, size = 0.0, 0.0
    for body in bodies.all.values():
        whole += body.inertia.mass
        size = max(size, *map(abs, body.inertia.com), *map(abs, body.frame.at))
    dirt = DIRT * whole * size * size
    found = []
    for body in bodies.all.values():
        message = _doubt(body, dirt)
        if message is None:
            continue
        if body.inertia.mass == 0:
            what = "this is impossible; it is kept: give the link a mass"
            found.append(body.link.place.problem(f"{message}; {what}", "warning"))
        elif repair:
            before = body.inertia.matrix
            body.inertia.matrix = nearest_inertia(before) if before.any() else _ball(body.inertia.mass)
            body.tolerated = False
            body.comments.append(f"repaired: {message}")
            found.append(body.link.place.problem(f"{message}; repaired", "warning"))
        else:
            found.append(
                body.link.place.problem(f"{message}; it is kept: --repair replaces it by a possible one", "warning")
            )
    return found


def _doubt(body: ImportedBody, dirt: float) -> str | None:
    """The reason why the inertia of a body is impossible; None if it is possible."""
    matrix = body.inertia.matrix
    scale = float(np.abs(matrix).max())
    name = f"the inertia of link {shortened(body.link.name)}"
    if any(not link.inertia.is_nothing for link, _ in body.merged):
        name += " and of the links fixed to it"
    if scale == 0:
        if body.inertia.mass == 0 or body.joint.type in ("fixed", "prismatic") or body.merged:
            return None
        return f"{name} is zero, like that of a point mass"
    low, middle, high = (float(m) for m in np.linalg.eigvalsh(matrix / scale) * scale)
    if body.inertia.mass == 0 and not body.merged:
        return f"{name} is given without a mass"
    seen = f"{low:.6g}, {middle:.6g} and {high:.6g}"
    if low < -PSD_TOLERANCE * scale and low < -dirt:
        body.tolerated = True
        return f"{name} has the principal moments {seen}; none may be negative"
    if low + middle < high * (1 - TRIANGLE_TOLERANCE) and high - low - middle > dirt:
        return f"{name} has the principal moments {seen}; two of them must not sum to less than the third"
    return None


def nearest_inertia(matrix: Array) -> Array:
    """The possible inertia nearest to a matrix: its second moments of mass S, with negative principal values set to zero.

    S, the integral of x x^T over the mass, is positive semidefinite; the inertia matrix is tr(S) 1 - S.
    """
    moments, axes = np.linalg.eigh(0.5 * np.trace(matrix) * np.eye(3) - matrix)
    kept = np.maximum(moments, 0.0)
    second = (axes * kept) @ axes.T
    result: Array = np.trace(second) * np.eye(3) - 0.5 * (second + second.T)
    return result


def _ball(mass: float) -> Array:
    """The inertia of a ball of water of the given mass."""
    radius = (3 * mass / (4 * math.pi * _WATER)) ** (1 / 3)
    return 0.4 * mass * radius * radius * np.eye(3)
