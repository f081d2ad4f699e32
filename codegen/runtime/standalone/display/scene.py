"""Scene of a view: a model at given parameters, as solids and lines fixed in bodies, points, and lines between bodies."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ..arrays import Array
from ..calls.formulas import value_of

GROUND = -1
"""Index of the ground as a body."""

SAME = 1e-9
"""Points of a body that are closer than this, m, are one corner of its stick figure."""


@dataclass(frozen=True, eq=False)
class Solid:
    """A solid or a mesh, fixed in a body.

    Attributes
    ----------
    body : int
        Index of the body.
    type : str
        box, sphere, ellipsoid, cylinder, capsule, rod or mesh; a cylinder, capsule or rod is along its z axis.
    sizes : ndarray
        Sizes as in `codegen.model.visuals.Visual`, m.
    rotation : ndarray (3, 3)
        From components in the solid's frame to components in the body's frame.
    at : ndarray (3,)
        Centre of the solid, or origin of the mesh, in the body frame, m.
    color, file : str
        ``""`` if the model gives none.
    """

    body: int
    type: str
    sizes: Array
    rotation: Array
    at: Array
    color: str = ""
    file: str = ""

    def placed(self, points: Array) -> Array:
        """Points (n, 3) in the body's frame, from points in the solid's frame, m."""
        return np.asarray(points @ self.rotation.T + self.at)


@dataclass(frozen=True, eq=False)
class Line:
    """A line between two points, each fixed in a body."""

    name: str
    bodies: tuple[int, int]
    ends: Array  # (2, 3), in the frames of the bodies, m


@dataclass(frozen=True, eq=False)
class Mark:
    """A point fixed in a body, at `at` (3,) in its frame, m."""

    name: str
    body: int
    at: Array


@dataclass(frozen=True, eq=False)
class Axis:
    """The motion of a joint.

    Attributes
    ----------
    body : int
        The parent, in whose frame the axis is fixed where all coordinates of the joint are zero.
    type : str
        Type of the joint.
    direction : ndarray (3,)
        Unit vector of its first axis in the frame of the parent; zero where the joint has none.
    """

    body: int
    type: str
    direction: Array


@dataclass(frozen=True, eq=False)
class Scene:
    """What a view shows of a model at given parameters.

    Attributes
    ----------
    names : tuple of str
        The bodies.
    solids : list of Solid
    sticks : list of Line
        Lines of bodies without visuals, between their joints and points; both ends are in one body.
    rails : list of Line
        From the place of a joint in its parent to the body that slides in it.
    elements : list of Line
        Force elements between two places.
    joints, loops, points : list of Mark
        Places of joints, ends of loops, and points of the model.
    ends : list of list of (int, ndarray)
        Bodies and places of the ends of each force element.
    axes : dict of int to Axis
        Axes of joints that are not fixed, by the index of the body.
    centres : list of ndarray (3,)
        Centre of mass of each body in its frame, m.
    """

    names: tuple[str, ...]
    solids: list[Solid] = field(default_factory=list)
    sticks: list[Line] = field(default_factory=list)
    rails: list[Line] = field(default_factory=list)
    elements: list[Line] = field(default_factory=list)
    joints: list[Mark] = field(default_factory=list)
    loops: list[Mark] = field(default_factory=list)
    points: list[Mark] = field(default_factory=list)
    ends: list[list[tuple[int, Array]]] = field(default_factory=list)
    axes: dict[int, Axis] = field(default_factory=dict)
    centres: list[Array] = field(default_factory=list)

    def lines(self, kind: str) -> list[Line]:
        """The lines of a kind: sticks, rails or elements."""
        found: list[Line] = getattr(self, kind)
        return found

    def marks(self, kind: str) -> list[Mark]:
        """The points of a kind: joints, loops or points."""
        found: list[Mark] = getattr(self, kind)
        return found


SLIDING = {"prismatic", "screw", "cylindrical", "planar"}
"""Joints in which the origin of the body moves away from the place of the joint in its parent."""


def scene_of(manifest: Mapping[str, Any], p: Array) -> Scene:
    """The scene of a package with frames.

    Parameters
    ----------
    manifest : mapping
        Content of `model.json`, with the entry ``display``.
    p : ndarray (np,)
        Design parameters.
    """
    given = manifest["display"]
    known = dict(zip(manifest["parameter_names"], p, strict=True))
    scene = Scene(tuple(manifest["bodies"]))

    def place(tree: Sequence[Any]) -> Array:
        return np.array([_value(x, known) for x in tree])

    corners: list[list[Array]] = [[np.zeros(3)] for _ in given["bodies"]]
    for k, body in enumerate(given["bodies"]):
        parent, at = body["parent"], place(body["joint"]["at"])
        if body["joint"]["type"] != "free":
            scene.joints.append(Mark(scene.names[k], parent, at))
        if body["joint"]["type"] != "fixed":
            scene.axes[k] = Axis(parent, body["joint"]["type"], _direction(body["joint"], known))
        if parent != GROUND:
            corners[parent].append(at)
        scene.centres.append(place(body["com"]))
        if body["joint"]["type"] in SLIDING:
            scene.rails.append(Line(scene.names[k], (parent, k), np.stack([at, np.zeros(3)])))
        scene.solids.extend(_solid(k, visual, known) for visual in body.get("visuals", ()))
    scene.solids.extend(_solid(GROUND, visual, known) for visual in given.get("visuals", ()))
    for loop in given["loops"]:
        scene.loops.extend(Mark(loop["name"], end["body"], place(end["at"])) for end in loop["ends"])
    scene.points.extend(Mark(x["name"], x["body"], place(x["at"])) for x in given["points"])
    for element in given["elements"]:
        ends = [(end["body"], place(end["at"])) for end in element["ends"]]
        scene.ends.append(ends)
        if len(ends) == 2:
            bodies = (ends[0][0], ends[1][0])
            scene.elements.append(Line(element["name"], bodies, np.stack([at for _, at in ends])))
        for body, at in ends:
            if body != GROUND:
                corners[body].append(at)
    for mark in (*scene.loops, *scene.points):
        if mark.body != GROUND:
            corners[mark.body].append(mark.at)
    for k, body in enumerate(given["bodies"]):
        if "visuals" not in body:
            found = _distinct(corners[k])
            found = found if len(found) > 1 else _distinct([*found, scene.centres[k]])
            scene.sticks.extend(Line(scene.names[k], (k, k), np.stack([found[0], end])) for end in found[1:])
    return scene


def _direction(joint: Mapping[str, Any], known: Mapping[str, float]) -> Array:
    """The first axis of a joint in the frame of the parent."""
    if not joint["axes"]:
        return np.zeros(3)
    axis = np.array([_value(x, known) for x in joint["axes"][0]])
    return np.asarray(_turn(joint, known) @ axis / np.linalg.norm(axis))


def _turn(given: Mapping[str, Any], known: Mapping[str, float]) -> Array:
    """The matrix of the rotations of an entry, in sequence about the moving axes."""
    turn = np.eye(3)
    for axis, angle in given.get("rotation", ()):
        turn = turn @ _rotation(np.array([_value(x, known) for x in axis]), _value(angle, known))
    return turn


def _distinct(points: Iterable[Array]) -> list[Array]:
    found: list[Array] = []
    for x in points:
        if all(np.abs(x - y).max() > SAME for y in found):
            found.append(x)
    return found


def _solid(body: int, given: Mapping[str, Any], known: Mapping[str, float]) -> Solid:
    turn = _turn(given, known)
    if "axis" in given:
        turn = turn @ _from_z(np.array([_value(x, known) for x in given["axis"]]))
    sizes, at = (np.array([_value(x, known) for x in given[key]]) for key in ("sizes", "at"))
    return Solid(body, given["type"], sizes, turn, at, given.get("color", ""), given.get("file", ""))


def _rotation(axis: Array, angle: float) -> Array:
    """The matrix of a rotation by an angle, rad, about an axis (Rodrigues' formula)."""
    x, y, z = axis / np.linalg.norm(axis)
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.asarray(np.eye(3) + np.sin(angle) * cross + (1.0 - np.cos(angle)) * cross @ cross)


def _from_z(axis: Array) -> Array:
    """A rotation that turns the z axis into an axis."""
    n = axis / np.linalg.norm(axis)
    cross = np.array([-n[1], n[0], 0.0])
    sine = float(np.linalg.norm(cross))
    if sine < 1e-12:
        return np.eye(3) if n[2] > 0.0 else np.diag([1.0, -1.0, -1.0])
    return _rotation(cross, float(np.arctan2(sine, n[2])))


def _value(x: Any, known: Mapping[str, float]) -> float:
    return float(value_of(x, known))
