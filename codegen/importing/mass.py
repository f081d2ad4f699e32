"""Masses and inertias that no body has: named, and repaired on request."""

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
"""Of numbers whose squares are still numbers."""
_WATER: Final = 1000.0
"""Density of the balls that points with mass become, kg/m^3."""


def fix_massless(robot: Robot, held: Collection[str], repair: bool) -> list[Problem]:
    """Find joints that move nothing, no rotor either, and fix them on request.

    Parameters
    ----------
    robot : Robot
        All its links lead to the ground; its joints are changed where they are repaired.
    held : collection of str
        Links that loops hold: these may do without mass.
    repair : bool

    Returns
    -------
    list of Problem
        Errors, or warnings that tell the repair.
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
        what = f"{_named(joint)} moves nothing: link {shortened(joint.child)} and all beyond it have neither mass nor inertia"
        if repair:
            found.append(joint.place.problem(f"{what}{FIXED}", "warning"))
            joint.type, joint.axes, joint.laws, joint.start, joint.armature = "fixed", (), (), (), ()
        else:
            found.append(joint.place.problem(f"{what}; give it mass and inertia, or --repair fixes the joint"))
    if not repair:
        return found
    gone = {joint.name for joint in order if joint.type == "fixed"}
    robot.couplings = [c for c in robot.couplings if c.joint not in gone and c.of not in gone]
    return found


def _named(joint: RobotJoint) -> str:
    return f"joint {shortened(joint.name)}" if joint.name else f"the free joint of link {shortened(joint.child)}"


def check_finite(robot: Robot, bodies: Bodies) -> list[Problem]:
    """Find bodies and loops whose numbers became too large for this machine as they were put together."""
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
            what = f"the numbers of link {shortened(body.link.name)} and what is fixed to it are not finite together"
            found.append(body.link.place.problem(f"{what}, or above {_LARGEST:g}; smaller ones are needed"))
    return found


def check_inertias(robot: Robot, bodies: Bodies, repair: bool) -> list[Problem]:
    """Find inertias that no body has, and repair them on request; without, they are kept, and the model says so."""
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
            what = "no body has an inertia without mass; kept as it is: give it a mass"
            found.append(body.link.place.problem(f"{message}; {what}", "warning"))
        elif repair:
            before = body.inertia.matrix
            body.inertia.matrix = nearest_inertia(before) if before.any() else _ball(body.inertia.mass)
            body.tolerated = False
            body.comments.append(f"repaired: {message}")
            found.append(body.link.place.problem(f"{message}; repaired", "warning"))
        else:
            found.append(
                body.link.place.problem(f"{message}; kept as it is: --repair makes it that of a body", "warning")
            )
    return found


def _doubt(body: ImportedBody, dirt: float) -> str | None:
    """What is impossible about a body's inertia."""
    matrix = body.inertia.matrix
    scale = float(np.abs(matrix).max())
    name = f"the inertia of link {shortened(body.link.name)}"
    if any(not link.inertia.is_nothing for link, _ in body.merged):
        name += " and those fixed to it"
    if scale == 0:
        if body.inertia.mass == 0 or body.joint.type in ("fixed", "prismatic") or body.merged:
            return None
        return f"{name} is zero, as of a point"
    low, middle, high = (float(m) for m in np.linalg.eigvalsh(matrix / scale) * scale)
    if body.inertia.mass == 0 and not body.merged:
        return f"{name} stands without mass"
    seen = f"{low:.6g}, {middle:.6g} and {high:.6g}"
    if low < -PSD_TOLERANCE * scale and low < -dirt:
        body.tolerated = True
        return f"{name} has the principal moments {seen}, of which none may be negative"
    if low + middle < high * (1 - TRIANGLE_TOLERANCE) and high - low - middle > dirt:
        return f"{name} has the principal moments {seen}, of which two are together less than the third"
    return None


def nearest_inertia(matrix: Array) -> Array:
    """The inertia of a body that is nearest to a matrix: that of its second moments, negative ones taken for zero.

    The second moments of a distribution of mass, the integral of x x^T, are positive semidefinite; an inertia matrix is their
    trace times the unit matrix less them.
    """
    moments, axes = np.linalg.eigh(0.5 * np.trace(matrix) * np.eye(3) - matrix)
    kept = np.maximum(moments, 0.0)
    second = (axes * kept) @ axes.T
    result: Array = np.trace(second) * np.eye(3) - 0.5 * (second + second.T)
    return result


def _ball(mass: float) -> Array:
    """Inertia of a ball of water."""
    radius = (3 * mass / (4 * math.pi * _WATER)) ** (1 / 3)
    return 0.4 * mass * radius * radius * np.eye(3)
