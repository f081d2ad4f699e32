"""A robot as read from any format: links, joints, mass properties, and parts that the model format lacks."""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from enum import Enum
from typing import Any, Final, NamedTuple

import numpy as np

from ..model.errors import Problem
from ..model.joints import JOINTS
from .placement import Array, Placement, Three, exact_sum

WORLD = ""
"""The parent of links on the ground."""


VISIBLE: Final = ("box", "cylinder", "capsule", "sphere", "ellipsoid", "mesh")
"""Types of visuals that exist in the model format."""

SINGLE: Final = ("revolute", "prismatic", "screw")
"""Types of joints that have one coordinate."""


@dataclass(frozen=True, slots=True)
class Place:
    """Position of an element in a file.

    Attributes
    ----------
    file : str
    line, column : int or None
        None if there is no text, for an object of another program.
    """

    file: str
    line: int | None = None
    column: int | None = None

    def problem(self, message: str, severity: str = "error") -> Problem:
        """An error or a warning at this place."""
        return Problem(self.file, self.line, self.column, "", message, severity)


@dataclass(slots=True)
class Inertia:
    """Mass properties of a link.

    Attributes
    ----------
    mass : float
        kg.
    com : three float
        Centre of mass in the link's frame, m.
    matrix : (3, 3) array
        Inertia about the centre of mass, in the link's axes, kg m^2.
    """

    mass: float = 0.0
    com: Three = (0.0, 0.0, 0.0)
    matrix: Array = field(default_factory=lambda: np.zeros((3, 3)))

    @property
    def is_nothing(self) -> bool:
        """Whether mass and inertia are zero."""
        return self.mass == 0 and not self.matrix.any()

    def seen_from(self, frame: Placement) -> Inertia:
        """These mass properties, expressed in the frame in which the pose `frame` is given."""
        if not frame.is_turned:
            return Inertia(self.mass, frame.point(self.com), self.matrix)
        return Inertia(self.mass, frame.point(self.com), turned_matrix(frame.rotation, self.matrix))

    def __add__(self, other: Inertia) -> Inertia:
        """Mass properties of two rigidly connected parts, in their common frame."""
        if other.is_nothing:
            return self
        if self.is_nothing:
            return other
        mass = exact_sum(self.mass, other.mass)
        if mass == 0:
            return Inertia(0.0, self.com, self.matrix + other.matrix)
        a, b = np.array(self.com), np.array(other.com)
        com = (self.mass * a + other.mass * b) / mass
        apart = b - a
        shift = self.mass * other.mass / mass * (apart @ apart * np.eye(3) - np.outer(apart, apart))
        return Inertia(mass, (float(com[0]), float(com[1]), float(com[2])), self.matrix + other.matrix + shift)


def turned_matrix(rotation: Array, matrix: Array) -> Array:
    """R I R^T, exactly symmetric; quarter turns keep the decimal digits."""
    if np.all((rotation == 0) | (np.abs(rotation) == 1)):
        order = np.argmax(np.abs(rotation), axis=1)
        signs = rotation[np.arange(3), order]
        exact: Array = matrix[np.ix_(order, order)] * np.outer(signs, signs) + 0.0
        return exact
    full = rotation @ matrix @ rotation.T
    return 0.5 * (full + full.T)


@dataclass(frozen=True, slots=True)
class Solid:
    """A primitive or a mesh of a link, visible or for collisions.

    Attributes
    ----------
    type : str
        ``box``, ``cylinder``, ``capsule``, ``sphere`` or another primitive with its axis along z; ``mesh``.
    sizes : tuple of float
        Edges of a box; radius and length; radius; semi-axes; m. Scale factors of a mesh.
    frame : Placement
        Pose of its centre, or of the origin of a mesh, in the link.
    shown : bool
        Whether it is visible.
    color : str
        ``#rrggbb`` or ``#rrggbbaa``; ``""`` if there is none.
    file : str
        Path of the file of a mesh.
    """

    type: str
    sizes: tuple[float, ...]
    frame: Placement
    shown: bool = False
    color: str = ""
    file: str = ""


@dataclass(slots=True)
class Link:
    """A link of a robot.

    Attributes
    ----------
    name : str
        Its name in the file.
    place : Place
    inertia : Inertia
    solids : list of Solid
    origin : Placement
        The link's frame in the file, relative to the frame used here, whose origin is at the joint.
    """

    name: str
    place: Place
    inertia: Inertia = field(default_factory=Inertia)
    solids: list[Solid] = field(default_factory=list)
    origin: Placement = field(default_factory=Placement)

    def visible(self, frame: Placement) -> list[Solid]:
        """The solids and meshes that views show, from the pose of the link."""
        shown = (s for s in self.solids if s.shown and s.type in VISIBLE and (s.type == "mesh" or min(s.sizes) >= 0))
        return [replace(s, frame=frame @ s.frame) for s in shown]

    def moved_to(self, frame: Placement) -> None:
        """Change the link to another frame, whose pose in the present frame is given."""
        back = frame.inverse()
        self.inertia = self.inertia.seen_from(back)
        self.solids = [replace(s, frame=back @ s.frame) for s in self.solids]
        self.origin = back @ self.origin


class Law(NamedTuple):
    """A force or torque -stiffness (q - rest) - damping u along one degree of freedom."""

    damping: float = 0.0
    stiffness: float = 0.0
    rest: float = 0.0


@dataclass(slots=True)
class RobotJoint:
    """A joint between two links; at zero coordinates the child's frame coincides with the joint's.

    Attributes
    ----------
    name : str
    place : Place
    type : str
        A type of the model format.
    parent, child : str
        Links; the parent `WORLD` is the ground.
    frame : Placement
        Frame of the joint in the parent.
    axes : tuple of three float
        One axis, the two axes of a universal joint, or none.
    pitch : float
        Pitch of a screw joint, m/rad.
    laws : tuple of Law
        One law for all degrees of freedom, one for each, or none.
    armature : tuple of float
        Reflected rotor inertia, kg m^2 or kg: one for each degree of freedom, one for a ball joint, or none.
    start : tuple of float
        Initial coordinates: all or none.
    """

    name: str
    place: Place
    type: str
    parent: str
    child: str
    frame: Placement = field(default_factory=Placement)
    axes: tuple[Three, ...] = ()
    pitch: float = 0.0
    laws: tuple[Law, ...] = ()
    armature: tuple[float, ...] = ()
    start: tuple[float, ...] = ()

    @property
    def is_passive(self) -> bool:
        """Whether neither a spring nor a damper acts in the joint."""
        return not any(law.damping or law.stiffness for law in self.laws)

    def give_laws(self, laws: Sequence[Law]) -> None:
        """Set the laws of all degrees of freedom; laws that are equal are stored once."""
        self.laws = tuple(laws[:1] if len(set(laws)) == 1 else laws)

    def law(self, k: int) -> Law:
        """The spring and damper along degree of freedom k."""
        return self.laws[min(k, len(self.laws) - 1)] if self.laws else Law()


@dataclass(slots=True)
class Closing:
    """A joint that closes a loop.

    Attributes
    ----------
    name : str
    place : Place
    type : str
    start, end : tuple of str and Placement
        A link, or `WORLD`, and the joint's face in it.
    axes : tuple of three float
        The axes in both faces.
    """

    name: str
    place: Place
    type: str
    start: tuple[str, Placement]
    end: tuple[str, Placement]
    axes: tuple[Three, ...] = ()


@dataclass(frozen=True, slots=True)
class Coupling:
    """A coupling q_joint = ratio q_of + offset between two joints with one coordinate each.

    Attributes
    ----------
    name : str
    place : Place
    joint, of : str
        The coupled joints.
    ratio, offset : float
    unreadable : str
        Description of a coupling that is not linear; empty for linear ones.
    is_gear : bool
        Whether it is a gear joint between two links, not a mimic joint.
    """

    name: str
    place: Place
    joint: str
    of: str
    ratio: float
    offset: float
    unreadable: str = ""
    is_gear: bool = False


@dataclass(frozen=True, slots=True)
class JointTerm:
    """A term of the generalised force of a joint with one coordinate.

    Attributes
    ----------
    joint : str
    text : str
        Expression with ``{}`` for coordinate names: ``-3*(q.{} - 2*q.{})``.
    of : tuple of str
        The joints whose coordinates the ``{}`` are.
    """

    joint: str
    text: str
    of: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Mark:
    """A point fixed in a link, to which forces refer.

    Attributes
    ----------
    name : str
    link : str
        The link, or `WORLD`.
    at : three float
        Position in the link, m.
    """

    name: str
    link: str
    at: Three


@dataclass(frozen=True, slots=True)
class BodyForce:
    """A force element between points: an entry of the model file with ``{}`` for the names of points.

    Attributes
    ----------
    name : str
    text : str
    at : tuple of str
        The marks, in the order of the ``{}`` that their names replace.
    """

    name: str
    text: str
    at: tuple[str, ...]


class Effect(Enum):
    """How leaving out an element affects the motion."""

    DIFFERS = "the dynamics differ"
    STOPS = "no effect within limits and without contact"
    DRIVEN = "acts only when driven"
    UNKNOWN = "its effect is unknown"
    NONE = "no effect on the dynamics"


@dataclass(slots=True)
class LeftOut:
    """Parts of the file that the model lacks.

    Attributes
    ----------
    what : str
    effect : Effect
    lines : list of str
        Line numbers; the file's name precedes them if it is not the robot's file.
    count : int
    remark : str
    """

    what: str
    effect: Effect
    lines: list[str] = field(default_factory=list)
    count: int = 0
    remark: str = ""

    def __str__(self) -> str:
        shown = ", ".join(self.lines[:3])
        if self.lines:
            more = f" and {len(self.lines) - 3} more" if len(self.lines) > 3 else ""
            shown = f" (line{'s' * (len(self.lines) > 1)} {shown}{more})"
        else:
            shown = f" ({self.count})" if self.count > 1 else ""
        return f"{self.what}{shown}: {self.remark}{'; ' * bool(self.remark)}{self.effect.value}"


@dataclass(slots=True)
class Robot:
    """A robot as read from a file or an object.

    Attributes
    ----------
    name : str
    file : str
        Its name in messages.
    gravity : three float
    links : dict of str to Link
    scenery : list of Solid
        Solids and meshes on the ground that belong to no link.
    joints : dict of str to RobotJoint
        One for each link except the root of a URDF.
    closings : list of Closing
    couplings : list of Coupling
    terms : list of JointTerm
    marks : list of Mark
    forces : list of BodyForce
    lifted : dict of str to float
        Links with gravity compensation, and the fraction of the weight that is carried.
    locked : dict of str to float
        Joints with one coordinate that are fixed, and their values.
    speeds : dict of str to tuple of float
        Initial speeds of joints, for all degrees of freedom of each.
    left_out : dict of (str, Effect) to LeftOut
        Parts that the model lacks, by description and effect.
    notes : list of str
        Lines about the robot's origin, for the comment at the top of the model file.
    warnings : list of Problem
    format : str
        ``URDF``, ``MJCF`` or another format.
    """

    name: str
    file: str
    gravity: Three = (0.0, 0.0, -9.81)
    links: dict[str, Link] = field(default_factory=dict)
    scenery: list[Solid] = field(default_factory=list)
    joints: dict[str, RobotJoint] = field(default_factory=dict)
    closings: list[Closing] = field(default_factory=list)
    couplings: list[Coupling] = field(default_factory=list)
    terms: list[JointTerm] = field(default_factory=list)
    marks: list[Mark] = field(default_factory=list)
    forces: list[BodyForce] = field(default_factory=list)
    lifted: dict[str, float] = field(default_factory=dict)
    locked: dict[str, float] = field(default_factory=dict)
    speeds: dict[str, tuple[float, ...]] = field(default_factory=dict)
    left_out: dict[tuple[str, Effect], LeftOut] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    warnings: list[Problem] = field(default_factory=list)
    format: str = ""

    def leave_out(self, what: str, at: Place | int | None, effect: Effect, remark: str = "") -> None:
        """Record a part of the file that the model lacks.

        Parameters
        ----------
        what : str
        at : Place, int or None
            Its place; an integer is a line of the robot's file.
        effect : Effect
            Effect of its absence.
        remark : str
        """
        entry = self.left_out.setdefault((what, effect), LeftOut(what, effect))
        entry.count += 1
        line = at.line if isinstance(at, Place) else at
        if line is not None:
            other = isinstance(at, Place) and at.file != self.file
            shown = f"{os.path.basename(at.file)}:{line}" if other and isinstance(at, Place) else str(line)
            if shown not in entry.lines[-1:]:
                entry.lines.append(shown)
        if remark:
            entry.remark = remark

    def listed(self) -> list[LeftOut]:
        """The parts that are left out; parts that change the dynamics come first."""
        order = list(Effect)
        return sorted(self.left_out.values(), key=lambda entry: order.index(entry.effect))

    def give_armature(self, joint: RobotJoint, of_speeds: Sequence[float], at: Place | None = None) -> None:
        """Set the reflected rotor inertias of a joint, one for each speed; record inertias that the model format lacks."""
        count = len(JOINTS[joint.type].armature_units())
        of_speeds = tuple(float(a) for a in of_speeds)
        if not any(of_speeds):
            return
        if count == 1 and len(set(of_speeds)) == 1:
            joint.armature = of_speeds[:1]
        elif count == len(of_speeds) > 1:
            joint.armature = of_speeds
        elif count:
            self.leave_out(f"armature that differs between the speeds of a {joint.type} joint", at, Effect.DIFFERS)
        else:
            self.leave_out(f"armature of a {joint.type} joint", at, Effect.DIFFERS, "it moves without a motor")

    def children(self) -> dict[str, list[RobotJoint]]:
        """For every link the joints that it carries, in the order of the file."""
        found: dict[str, list[RobotJoint]] = {}
        for joint in self.joints.values():
            found.setdefault(joint.parent, []).append(joint)
        return found

    def depth_first(self) -> Iterable[RobotJoint]:
        """The joints from the ground outward, branch by branch, parents before children."""
        children = self.children()
        stack = list(reversed(children.get(WORLD, [])))
        while stack:
            joint = stack.pop()
            yield joint
            stack.extend(reversed(children.get(joint.child, [])))


def symmetric(xx: float, yy: float, zz: float, xy: float, xz: float, yz: float) -> Array:
    """The symmetric matrix with six given entries."""
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def as_three(x: Any) -> Three:
    """Three components as a tuple of floats."""
    return float(x[0]), float(x[1]), float(x[2])
