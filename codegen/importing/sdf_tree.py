"""Choice of the joints of an SDF that form a tree; other joints close loops or are gears."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import numpy as np

from ..model.positions import shortened
from .naming import free_name, made_name
from .placement import Placement, Three, to_quaternion, without_dirt
from .robot import WORLD, Closing, Coupling, Effect, RobotJoint, as_three
from .sdf_frames import Frames
from .sdf_joints import GEARBOX, SdfJoint
from .sdf_scopes import Scope
from .spanning import Edge, spanning_tree
from .xml_reading import Element
from .xml_values import RobotReader, is_true, place_of

PARALLEL: Final = 1e-6
"""Angle in rad up to which the axes of a gear and of a joint count as parallel."""
_LOOP_TYPES: Final = {"spherical": "point"}
_AXES_IN_JOINTS: Final = (1, 5)
"""First version in which axes are in the joint's frame."""
_EXPRESSED_IN: Final = (1, 7)
"""First version in which only ``expressed_in`` selects another frame."""


class TreeMaker:
    """Chooses joints for the tree; the others close loops.

    Parameters
    ----------
    reader : RobotReader
        The reader's robot receives joints, loops and gears.
    frames : Frames
    base : Scope
        Scope whose frame is the reference of all poses.
    static : set of str
        Links that are fixed to the ground if no joint carries them.
    """

    def __init__(self, reader: RobotReader, frames: Frames, base: Scope, static: set[str]) -> None:
        self.reader = reader
        self.robot = reader.robot
        self.frames = frames
        self.base = base
        self.static = static
        self.outside = frames.absolute(base)
        self.used: dict[str, Placement] = {WORLD: self.outside.inverse()}

    def put_together(self, joints: Mapping[str, SdfJoint], poses: Mapping[str, Placement]) -> None:
        """Enter joints, loops and gears into the robot.

        Parameters
        ----------
        joints : dict of str to SdfJoint
        poses : dict of str to Placement
            Poses of the links in the frame of the base.
        """
        robot, used = self.robot, self.used
        moving = {name: joint for name, joint in joints.items() if joint.type != GEARBOX}
        edges = [Edge(j.name, j.parent, j.child, j.type == "spherical") for j in moving.values()]
        fixed = [link for link in robot.links if link in self.static and not any(e.child == link for e in edges)]
        carriers = spanning_tree(list(robot.links), edges)
        for name, reverse in carriers:
            if name in moving:
                self.carry(moving[name], reverse, poses)
                continue
            used[name] = poses[name]  # this link is attached to the ground, so `name` is a link, not a joint
            at = self.outside @ poses[name]
            is_static = name in self.static
            stand = RobotJoint("", robot.links[name].place, "fixed" if is_static else "free", WORLD, name)
            stand.frame = at if is_static else Placement()
            stand.start = () if is_static else (*at.at, *to_quaternion(at.rotation))
            robot.joints[f" {name}"] = stand
        if fixed and any(j.type != "fixed" and j.child in self.static for j in moving.values()):
            message = "a static model does not move in SDF; here its base is fixed to the ground, and its joints move"
            robot.warnings.append(robot.links[fixed[0]].place.problem(message, "warning"))
        for name, link in robot.links.items():
            link.moved_to(poses[name].inverse() @ used[name])
        carried = {name for name, _ in carriers}
        for joint in joints.values():
            if joint.type == GEARBOX:
                robot.couplings.append(self.gear(joint))
            elif joint.name not in carried:
                self.close(joint, poses)

    def frame(self, joint: SdfJoint) -> Placement:
        """Pose, in the base, of a joint's frame."""
        return self.in_base(joint) @ self.frames.named(joint.scope, joint.item.name, joint.element)

    def in_base(self, joint: SdfJoint) -> Placement:
        """Pose, in the base, of the scope that contains a joint's name."""
        if joint.scope is self.base:
            return Placement()
        if joint.cut:
            return self.outside.inverse() @ self.frames.absolute(joint.scope)
        return self.frames.named(self.base, joint.path.removesuffix("::"), joint.element)

    def direction(self, joint: SdfJoint, axis: Element, child: Placement) -> Three:
        """Components of an axis in the child's frame."""
        xyz, old = axis.first("xyz"), axis.first("use_parent_model_frame")
        value = as_three(self.reader.content(xyz, 3, (0, 0, 1)))
        home, version = joint.item.home, joint.item.home.version
        expressed = xyz.attributes.get("expressed_in", "").strip() if xyz is not None else ""
        in_model = old is not None and is_true(old.text)
        if in_model and version >= _EXPRESSED_IN and not expressed:
            what = 'of files before 1.7, ignored as SDF says; write <xyz expressed_in="__model__">'
            self.robot.leave_out("<use_parent_model_frame>", place_of(axis), Effect.NONE, what)
            in_model = False
        if expressed or in_model or version < _AXES_IN_JOINTS:
            frame = self.frames.of(joint.scope, home, expressed, axis)
        else:
            frame = self.frames.named(joint.scope, joint.item.name, joint.element)
        return without_dirt(child.inverse().vector((self.in_base(joint) @ frame).vector(value)))

    def carry(self, joint: SdfJoint, reverse: bool, poses: Mapping[str, Placement]) -> None:
        """Add a joint to the tree; if reversed, its child carries its parent."""
        used = self.used
        above, below = (joint.child, joint.parent) if reverse else (joint.parent, joint.child)
        at = self.frame(joint).at
        used[below] = Placement(at, poses[below].rotation, poses[below].rpy)
        axes, laws = [self.direction(joint, axis, used[below]) for axis in joint.axes], joint.laws
        if reverse:
            axes, laws = [as_three([-v for v in axis]) for axis in reversed(axes)], laws[::-1]
        made = self.robot.joints[joint.name] = RobotJoint(
            joint.name, place_of(joint.element), joint.type, above, below, used[above].inverse() @ used[below],
            tuple(as_three(np.array(a) + 0.0) for a in axes), joint.pitch,
        )  # fmt: skip
        made.give_laws(laws)
        self.robot.give_armature(made, (joint.armature,) * len(axes), place_of(joint.element))

    def gear(self, gear: SdfJoint) -> Coupling:
        """The coupling that represents a gearbox: between the two revolute joints that connect its links to its
        reference body.

        In the specification, theta_2 = -gearbox_ratio theta_1. These are the angles of the parent about ``axis`` and of the child
        about ``axis2``, both relative to ``gearbox_reference_body``.
        """
        place = place_of(gear.element)
        what = f"is a gear between links {shortened(gear.parent)} and {shortened(gear.child)}"
        reference, ratio = (gear.element.first(f"gearbox_{word}") for word in ("reference_body", "ratio"))
        where = reference.text.strip() if reference is not None else ""
        named = None if reference is None else self.frames.link(gear.scope, gear.item.home, where, reference)
        hinges: list[tuple[str, int]] = []
        if named is not None:
            body = WORLD if named == WORLD else (gear.path + named).removeprefix(gear.cut)
            for link, tag in ((gear.parent, "axis"), (gear.child, "axis2")):
                axis = gear.element.first(tag) or gear.element.first("axis")
                along = None if axis is None else np.array(self.direction(gear, axis, Placement()))
                hinges += [] if along is None else self.hinge(body, link, along)[:1]
            what += f", one of which has no revolute joint about the gear's axis on reference body {shortened(where)}"
        if len(hinges) < 2:
            return Coupling(gear.name, place, gear.name, "", 0.0, 0.0, what, is_gear=True)
        (of, first), (joint, second) = hinges
        value = 1.0 if ratio is None else self.reader.content(ratio, 1, (1.0,))[0]
        return Coupling(gear.name, place, joint, of, -value * first * second, 0.0, is_gear=True)

    def hinge(self, body: str, link: str, along: Any) -> list[tuple[str, int]]:
        """Joints of the tree that rotate a link relative to a body about an axis, each with its sense, 1 or -1."""
        found = []
        for name, joint in self.robot.joints.items():
            if joint.type != "revolute" or {joint.parent, joint.child} != {body, link}:
                continue
            axis = np.array(self.used[joint.child].vector(joint.axes[0]))
            size = float(np.linalg.norm(axis) * np.linalg.norm(along))
            if np.linalg.norm(np.cross(axis, along)) <= PARALLEL * size:
                found.append((name, (1 if axis @ along > 0 else -1) * (1 if joint.child == link else -1)))
        return found

    def close(self, joint: SdfJoint, poses: Mapping[str, Placement]) -> None:
        """Enter a joint that closes a loop."""
        place = place_of(joint.element)
        if joint.type == "screw":
            what = f"joint {shortened(joint.name)}, a screw, closes a loop"
            self.reader.wrong(joint.element, f"{what}, which is not supported; let it carry a link")
            return
        if any(law.damping or law.stiffness for law in joint.laws):
            self.robot.leave_out("<dynamics> of a joint that closes a loop", place, Effect.DIFFERS)
        if joint.armature:
            self.robot.leave_out("rotor of a joint that closes a loop", place, Effect.DIFFERS)
        rotation = poses[joint.child].rotation if joint.child != WORLD else np.eye(3)
        face = Placement(self.frame(joint).at, rotation)
        if joint.type == "spherical":
            face = Placement(face.at)
        axes = tuple(self.direction(joint, axis, face) for axis in joint.axes)
        ends = []
        for link in (joint.parent, joint.child):
            end = self.used[link].inverse() @ face
            ends.append((link, Placement(end.at) if joint.type == "spherical" else end))
        name = free_name(made_name(joint.name), [closing.name for closing in self.robot.closings])
        type_ = _LOOP_TYPES.get(joint.type, joint.type)
        self.robot.closings.append(Closing(name, place, type_, ends[0], ends[1], axes))
