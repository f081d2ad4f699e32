"""Merges links that fixed joints connect into bodies."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, field
from typing import Final

from .placement import Placement
from .robot import WORLD, Inertia, Link, Robot, RobotJoint

BASES: Final = ("fixed", "free")


@dataclass(slots=True)
class ImportedBody:
    """A body of the model.

    Attributes
    ----------
    link : Link
        The innermost of the body's links, whose frame is the body's frame.
    joint : RobotJoint
    parent : str
        Link of the parent body, or `WORLD`.
    frame : Placement
        Frame of the joint in the parent body.
    inertia : Inertia
        Mass properties of all links of the body together, in the body's frame.
    merged : list of (Link, Placement)
        The other links, each with the pose of its frame (not the file's, see `Link.origin`) in the body.
    words : set of str
        Which numbers of the body become parameters: ``mass``, ``com``, ... (see `parameters.WORDS`).
    comments : list of str
    tolerated : bool
        Whether the body's inertia is physically impossible but kept.
    """

    link: Link
    joint: RobotJoint
    parent: str
    frame: Placement
    inertia: Inertia
    merged: list[tuple[Link, Placement]] = field(default_factory=list)
    words: set[str] = field(default_factory=set)
    comments: list[str] = field(default_factory=list)
    tolerated: bool = False


@dataclass(slots=True)
class Bodies:
    """The bodies of a robot.

    Attributes
    ----------
    all : dict of str to ImportedBody
        Bodies by their innermost links, parents before children.
    holders : dict of str to (str, Placement)
        For every link: the innermost link of its body, or `WORLD`, and its frame in that body.
    grounded : list of (Link, Placement)
        Links that are part of the ground.
    """

    all: dict[str, ImportedBody] = field(default_factory=dict)
    holders: dict[str, tuple[str, Placement]] = field(default_factory=dict)
    grounded: list[tuple[Link, Placement]] = field(default_factory=list)

    def merged_frames(self) -> list[tuple[str, str, Placement]]:
        """Links merged into a body: name, innermost link of the body or `WORLD`, and the file's frame relative to
        it."""
        every = [(WORLD, link, frame) for link, frame in self.grounded]
        every += [(name, link, frame) for name, body in self.all.items() for link, frame in body.merged]
        return [(link.name, holder, frame @ link.origin) for holder, link, frame in every]

    def children(self, link: str) -> list[ImportedBody]:
        """The bodies that are attached to a body by joints."""
        return [body for body in self.all.values() if body.parent == link]


def put_on_ground(robot: Robot, base: str) -> None:
    """Attaches every link that is not the child of a joint to the ground, by a fixed or a free joint."""
    carried = {joint.child for joint in robot.joints.values()}
    before = {}
    for link in robot.links.values():
        if link.name not in carried:
            before[f" {link.name}"] = RobotJoint("", link.place, base, WORLD, link.name)
    robot.joints = {**before, **robot.joints}  # the blank avoids a clash: no name in a file begins with one


def merged_bodies(robot: Robot, keep_fixed: bool = False, kept: Collection[str] = ()) -> Bodies:
    """The bodies of a robot, in which every link leads to the ground.

    Parameters
    ----------
    robot : Robot
    keep_fixed : bool
        Keep links on fixed joints as bodies of their own.
    kept : collection of str
        Links that are never merged.
    """
    bodies = Bodies(holders={WORLD: (WORLD, Placement())})
    for joint in robot.depth_first():
        link = robot.links[joint.child]
        holder, place = bodies.holders[joint.parent]
        frame = place @ joint.frame
        if joint.type != "fixed" or keep_fixed or link.name in kept:
            bodies.all[link.name] = ImportedBody(link, joint, holder, frame, link.inertia)
            bodies.holders[link.name] = link.name, Placement()
            continue
        bodies.holders[link.name] = holder, frame
        if holder == WORLD:
            bodies.grounded.append((link, frame))
        else:
            body = bodies.all[holder]
            body.merged.append((link, frame))
            body.inertia = body.inertia + link.inertia.seen_from(frame)
    return bodies
