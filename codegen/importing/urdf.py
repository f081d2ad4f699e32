"""Import of URDF: links and joints of a tree, see http://wiki.ros.org/urdf/XML."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Final

import numpy as np

from ..model.errors import nearest
from ..model.positions import shortened
from .files import Files
from .naming import made_name
from .placement import Placement, Three, direction, turning
from .robot import (
    SINGLE,
    WORLD,
    Closing,
    Coupling,
    Effect,
    Inertia,
    Law,
    Link,
    Place,
    Robot,
    RobotJoint,
    Solid,
    as_three,
    symmetric,
)
from .xml_reading import Element
from .xml_values import RobotReader, Sizes, is_version, place_of, version_of

TYPES: Final = {
    "revolute": "revolute", "continuous": "revolute", "prismatic": "prismatic", "fixed": "fixed", "floating": "free",
    "planar": "planar",
}  # fmt: skip

DRAKE_TYPES: Final = {"ball": "spherical", "universal": "universal", "planar": "planar", "screw": "screw"}
"""Types of <drake:joint>; universal and planar joints there use the axes of the joint's frame."""
_DRAKES: Final = "drake:joint"
_X, _Y, _Z = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
LOOP_TYPES: Final = {
    "revolute": "revolute", "continuous": "revolute", "prismatic": "prismatic", "fixed": "fixed", "planar": "planar",
    "spherical": "point", "ball": "point", "universal": "universal", "cylindrical": "cylindrical",
}  # fmt: skip
"""Types of <constraint>, with the joint types that close loops."""

_LINK: Final = {"inertial", "visual", "collision"}
_JOINT: Final = {"origin", "parent", "child", "axis", "limit", "dynamics", "mimic", "drake:screw_thread_pitch"}
_CONSTRAINT: Final = {"parent", "child", "parent_origin", "child_origin", "parent_axis", "child_axis"}
_REMARKS: Final = {
    "gazebo": ("settings of a simulator", Effect.NONE), "material": ("materials", Effect.NONE),
    "transmission": ("transmissions", Effect.DRIVEN), "sensor": ("sensors", Effect.NONE),
    "safety_controller": ("limits of controllers", Effect.DRIVEN), "calibration": ("calibrations of joints", Effect.NONE),
    "mujoco": ("settings of MuJoCo", Effect.NONE), "ros2_control": ("controllers", Effect.DRIVEN),
    "hardwareInterface": ("controllers", Effect.DRIVEN), "contact": ("contacts", Effect.STOPS),
    "contact_coefficients": ("contacts", Effect.STOPS), "self_collision_checking": ("contacts", Effect.STOPS),
    "verbose": ("", Effect.NONE), "collision_checking": ("contacts", Effect.STOPS), "audio_source": ("", Effect.NONE),
    "loop_joint": ("a loop; add it with --loops", Effect.DIFFERS),
    "drake:ball_constraint": ("a constraint of Drake's", Effect.DIFFERS),
    "drake:linear_bushing_rpy": ("a force of Drake's", Effect.DIFFERS),
    "linear_bushing_rpy": ("a force of Drake's", Effect.DIFFERS),
    "force_element": ("a force of Drake's", Effect.DIFFERS),
    "frame": ("a frame of Drake's", Effect.NONE),
    "drake:collision_filter_group": ("contacts", Effect.STOPS), "collision_filter_group": ("contacts", Effect.STOPS),
}  # fmt: skip
"""Elements that the model format lacks, each with a remark and the effect of its absence."""
_ACTING: Final = {
    "joint", "link", "springStiffness", "springReference", "spring_stiffness", "dampingFactor", "damping", "gravity",
    "turnGravityOff", "implicitSpringDamper", "kinematic", "static",
}  # fmt: skip
"""Children of <gazebo> that change the motion of a robot in Gazebo."""
_ATTRIBUTES: Final = {
    "origin": {"xyz", "rpy", "quat_xyzw"}, "axis": {"xyz"}, "mass": {"value"}, "parent": {"link"}, "child": {"link"},
    "inertia": {"ixx", "iyy", "izz", "ixy", "ixz", "iyz"}, "dynamics": {"damping", "friction"},
    "mimic": {"joint", "multiplier", "offset"}, "joint": {"name", "type"}, "link": {"name", "type"}, "inertial": set(),
    "limit": {"lower", "upper", "effort", "velocity", "acceleration", "deceleration", "jerk", "drake:acceleration"},
    "parent_origin": {"xyz", "rpy", "quat_xyzw"}, "child_origin": {"xyz", "rpy", "quat_xyzw"},
    "parent_axis": {"xyz"}, "child_axis": {"xyz"}, "constraint": {"name", "type"},
}  # fmt: skip
_XACRO: Final = "the file is a xacro, in which this element is to be replaced; expand it first: xacro FILE > robot.urdf"
_QUATERNIONS_SINCE: Final = (1, 1)
"""First version of URDF with quat_xyzw."""


def _radius_and_length(reader: RobotReader, element: Element) -> tuple[float, ...]:
    return reader.number(element, "radius", None), reader.number(element, "length", None)


def _scale(reader: RobotReader, element: Element) -> tuple[float, ...]:
    return reader.attribute(element, "scale", 3, (1, 1, 1))


_SIZES: Final[dict[str, Sizes]] = {
    "box": lambda reader, element: reader.attribute(element, "size", 3, (0, 0, 0)),
    "cylinder": _radius_and_length,
    "capsule": _radius_and_length,
    "sphere": lambda reader, element: (reader.number(element, "radius", None),),
}


def read_urdf(root: Element, files: Files, exact_angles: bool = False) -> Robot:
    """The robot of a URDF; with `exact_angles`, 1.5708 is taken as pi/2.

    Raises
    ------
    ModelError
        If the file has errors. The exception lists all of them.
    """
    return _Reader(root, files, exact_angles).whole()


class _Reader(RobotReader):
    remarks = _REMARKS

    def __init__(self, root: Element, files: Files, exact_angles: bool) -> None:
        super().__init__(root, files, exact_angles)
        self.robot.name = root.attributes.get("name", "").strip() or Path(root.file).stem
        self.version = version_of(root.attributes.get("version", "1.0"))

    def read(self) -> None:
        if (xacro := self.xacro()) is not None:
            self.wrong(xacro, f"<{xacro.tag}>: {_XACRO}")
            return
        self.attributes_of_root()
        links: dict[str, Place] = {}
        joints: dict[str, Place] = {}
        for element in self.root.children:
            if element.tag == "link":
                name = self.new_name(element, links, "link")
                if name is not None:
                    self.robot.links[name] = self.link(element, name)
        for element in self.root.children:
            if element.tag in ("joint", _DRAKES):
                name = self.new_name(element, joints, "joint")
                if name is not None:
                    self.joint(element, name, DRAKE_TYPES if element.tag == _DRAKES else TYPES)
            elif element.tag not in ("link", "constraint", "transmission", "material"):
                self.leave_out(element)
        for element in self.root.all("constraint"):
            name = self.new_name(element, joints, "constraint")
            if name is not None:
                self.constraint(element, name)
        for element in self.root.all("transmission"):
            self.transmission(element)
        if not self.robot.links and not self.problems:
            self.wrong(self.root, 'no <link>; a robot has at least one, such as <link name="arm"/>')
        if not self.problems:
            self.check_tree()

    def attributes_of_root(self) -> None:
        """List unknown attributes of <robot>, and an invalid version."""
        for key, text in self.root.attributes.items():
            if key == "version" and not is_version(text):
                what = f"version {shortened(text)} of <robot>"
                self.robot.leave_out(what, self.root.line, Effect.UNKNOWN, "read as 1.0")
            elif key not in ("name", "version") and not key.startswith("xmlns"):
                self.robot.leave_out(f"attribute {shortened(key)} of <robot>", self.root.line, Effect.UNKNOWN)

    def xacro(self) -> Element | None:
        """The first element that xacro should have replaced."""
        stack = [self.root]
        while stack:
            element = stack.pop()
            if element.tag.startswith("xacro:"):
                return element
            stack.extend(reversed(element.children))
        return None

    def remark_of(self, element: Element) -> tuple[str, Effect]:
        if element.tag == "gazebo" and any(child.tag in _ACTING for child in element.children):
            return "only Gazebo reads it", Effect.DIFFERS
        return super().remark_of(element)

    def leave_out_rest(self, element: Element, known: set[str]) -> None:
        """List the unknown children and attributes of elements."""
        self.leave_out_children(element, known)
        allowed = _ATTRIBUTES.get(element.tag)
        if allowed is not None:
            for key in element.attributes:
                if key not in allowed:
                    hint = nearest(key, sorted(allowed)) if element.tag != "limit" else ""
                    self.robot.leave_out(
                        f"attribute {shortened(key)} of <{element.tag}>{hint}", element.line, Effect.UNKNOWN
                    )

    def origin(self, element: Element, tag: str = "origin") -> Placement:
        """Pose in an element's <origin>."""
        found = self.one(element, tag)
        if found is None:
            return Placement()
        self.leave_out_rest(found, set())
        xyz = self.attribute(found, "xyz", 3, (0, 0, 0))
        if "quat_xyzw" in found.attributes:
            if self.version < _QUATERNIONS_SINCE:
                message = 'of version 1.1, ignored as other programs do; <robot version="1.1"> enables it'
                self.robot.leave_out("attribute 'quat_xyzw' of <origin>", found.line, Effect.NONE, message)
            elif "rpy" in found.attributes:
                self.wrong(found, f"<{tag}> has both rpy and quat_xyzw; one of them is allowed")
            else:
                x, y, z, w = self.attribute(found, "quat_xyzw", 4, (0, 0, 0, 1))
                return Placement(xyz, self.quaternion(found, (w, x, y, z)))
        return Placement(xyz, rpy=self.angles(self.attribute(found, "rpy", 3, (0, 0, 0))))

    def link(self, element: Element, name: str) -> Link:
        link = Link(name, place_of(element))
        self.leave_out_rest(element, _LINK)
        inertial = self.one(element, "inertial")
        if inertial is not None:
            link.inertia = self.inertia(inertial)
        for shown in element.all("visual", "collision"):
            solid = self.solid(shown)
            if solid is not None:
                link.solids.append(solid)
        return link

    def inertia(self, element: Element) -> Inertia:
        self.leave_out_rest(element, {"origin", "mass", "inertia"})
        frame = self.origin(element)
        mass, inertia = self.one(element, "mass"), self.one(element, "inertia")
        value, matrix = 0.0, np.zeros((3, 3))
        if mass is None:
            self.wrong(element, '<inertial> has no mass; <mass value="..."/> in kg is needed')
        else:
            self.leave_out_rest(mass, set())
            value = self.number(mass, "value", None)
            if value < 0:
                self.wrong(mass, f"the mass is {value:g}; at least 0 kg is needed")
        if inertia is None:
            self.wrong(
                element, '<inertial> has no inertia; <inertia ixx="..." iyy="..." izz="..."/> in kg m^2 is needed'
            )
        else:
            self.leave_out_rest(inertia, set())
            six = [self.number(inertia, key, None) for key in ("ixx", "iyy", "izz")]
            six += [self.number(inertia, key) for key in ("ixy", "ixz", "iyz")]
            matrix = symmetric(*six)
        return Inertia(value, (0.0, 0.0, 0.0), matrix).seen_from(frame)

    def solid(self, element: Element) -> Solid | None:
        """A primitive solid of <visual> or <collision>; other shapes are listed as left out."""
        self.leave_out_children(element, ("origin", "geometry", *(("material",) if element.tag == "visual" else ())))
        return self.primitive(element, self.origin(element), _SIZES, "filename", _scale)

    def color(self, shown: Element) -> str:
        material = shown.first("material")
        if material is None:
            return ""
        name = material.attributes.get("name", "")
        shared = (e for e in self.root.all("material") if e.attributes.get("name") == name)
        for found in (material, *shared):
            if (color := found.first("color")) is not None:
                return self.hex_color(color.attributes.get("rgba", ""), material)
        return self.hex_color("", material)

    def joint(self, element: Element, name: str, types: Mapping[str, str] = TYPES) -> None:
        self.leave_out_rest(element, _JOINT | set(_REMARKS))
        for child in element.children:
            if child.tag in _REMARKS:
                self.leave_out(child)
        type_ = self.type_of(element, f"joint {shortened(name)}", types)
        ends = self.ends(element, f"joint {shortened(name)}")
        frame = self.origin(element)
        axis = self.axis(element) if type_ not in ("fixed", "floating") else None
        damping = self.dynamics(element)
        for limit in element.all("limit"):
            self.leave_out_rest(limit, set())
            self.robot.leave_out("<limit>", limit.line, Effect.STOPS, "limits of position, speed and force")
        if type_ is None or len(ends) < 2:
            return
        joint = RobotJoint(name, place_of(element), types[type_], ends[0], ends[1], frame, laws=(Law(damping),))
        joint.axes = () if axis is None else (axis,)
        if types is DRAKE_TYPES:
            joint.axes = {"universal": (_X, _Y), "planar": (_Z,), "spherical": ()}.get(joint.type, joint.axes)
            pitch = element.first("drake:screw_thread_pitch")
            joint.pitch = (
                0.0 if pitch is None or joint.type != "screw" else self.number(pitch, "value", None) / (2 * math.pi)
            )
        self.robot.joints[name] = joint
        mimic = self.one(element, "mimic")
        if mimic is not None:
            self.mimic(mimic, name)

    def ends(self, element: Element, what: str) -> list[str]:
        """The links of <parent> and <child>; fewer than two after an error."""
        ends = []
        for tag in ("parent", "child"):
            end = self.one(element, tag)
            if end is None:
                self.wrong(element, f'{what} has no {tag}; <{tag} link="..."/> is needed')
                continue
            link = self.name(end, "link")
            if link is None:
                continue
            if link == "world" and tag == "parent" and link not in self.robot.links:
                link = WORLD  # the name denotes the world, as in Drake
            elif link not in self.robot.links:
                self.unknown(end, "link", link, list(self.robot.links))
            ends.append(link)
        return ends

    def constraint(self, element: Element, name: str) -> None:
        """Add a <constraint>: a joint that closes a loop, with a face and an axis in each link."""
        self.leave_out_rest(element, _CONSTRAINT)
        what = f"constraint {shortened(name)}"
        type_ = self.type_of(element, what, LOOP_TYPES, "are allowed")
        ends = self.ends(element, what)
        start, end = (self.origin(element, f"{tag}_origin") for tag in ("parent", "child"))
        closing = LOOP_TYPES.get(type_ or "", "")
        axes: tuple[Three, ...] = ()
        if closing not in ("", "point", "fixed"):
            first = self.axis(element, "parent_axis")
            second = self.axis(element, "child_axis") if element.first("child_axis") is not None else first
            if closing == "universal":
                axes = (first, second)
                if element.first("child_axis") is None:
                    self.wrong(element, f"{what}, universal, has no <child_axis>; both axes are needed")
            else:
                axes = (first,)
                if closing == "prismatic" and direction(first) != direction(second):
                    message = "has different axes in its links; rotate the faces by <parent_origin> and <child_origin>"
                    self.wrong(element, f"{what}, prismatic, {message}")
                end = end @ Placement(rotation=turning(direction(first), direction(second)))
        if len(ends) == 2 and ends[0] == ends[1]:
            self.wrong(element, f"{what} joins link {shortened(ends[0])} to itself; two links are needed")
        if len(ends) < 2 or not closing:
            return
        if closing == "point":
            start, end = Placement(start.at), Placement(end.at)
        place = place_of(element)
        self.robot.closings.append(Closing(made_name(name), place, closing, (ends[0], start), (ends[1], end), axes))

    def transmission(self, element: Element) -> None:
        """Add a <transmission>: Drake's rotor inertia becomes the joint's armature."""
        self.leave_out(element)
        joint, actuator = element.first("joint"), element.first("actuator")
        if joint is None or actuator is None:
            return
        if (motor := actuator.first("motorInertia")) is not None:
            what = "only <drake:rotor_inertia> is read"
            self.robot.leave_out("<motorInertia>", place_of(motor), Effect.DIFFERS, what)
        values = []
        for tag, default in (("drake:rotor_inertia", 0.0), ("drake:gear_ratio", 1.0)):
            found = actuator.first(tag)
            values.append(default if found is None else self.number(found, "value", None))
        moved = self.robot.joints.get(joint.attributes.get("name", "").strip())
        if moved is not None and moved.type in SINGLE:
            self.robot.give_armature(moved, (values[0] * values[1] ** 2,), place_of(element))

    def axis(self, element: Element, tag: str = "axis") -> Three:
        found = self.one(element, tag)
        if found is None:
            return (1.0, 0.0, 0.0)
        self.leave_out_rest(found, set())
        xyz = self.attribute(found, "xyz", 3, (1, 0, 0))
        if not any(xyz):
            self.wrong(found, 'the axis is 0 0 0, which has no direction; write one such as xyz="0 0 1"')
            return (1.0, 0.0, 0.0)
        return as_three(xyz)

    def dynamics(self, element: Element) -> float:
        found = self.one(element, "dynamics")
        if found is None:
            return 0.0
        self.leave_out_rest(found, set())
        if self.number(found, "friction"):
            self.robot.leave_out("friction of <dynamics>", found.line, Effect.DIFFERS, "dry friction of joints")
        return self.number(found, "damping")

    def mimic(self, element: Element, joint: str) -> None:
        self.leave_out_rest(element, set())
        other = self.name(element, "joint")
        if other is not None:
            ratio, offset = self.number(element, "multiplier", 1.0), self.number(element, "offset")
            self.robot.couplings.append(Coupling(joint, place_of(element), joint, other, ratio, offset))

    def check_tree(self) -> None:
        """Check that every link but one is the child of exactly one joint."""
        robot = self.robot
        carried: dict[str, RobotJoint] = {}
        for joint in robot.joints.values():
            other = carried.setdefault(joint.child, joint)
            if other is not joint:
                self.problems.append(joint.place.problem(
                    f"link {shortened(joint.child)} is the child of joint {shortened(joint.name)} and of {shortened(other.name)} "
                    f"in line {other.place.line}; links of a URDF are a tree: "
                    "make one joint a <constraint>, or take it out and close the loop with --loops"
                ))  # fmt: skip
        roots = [name for name in robot.links if name not in carried]
        on_ground = [joint.child for joint in robot.joints.values() if joint.parent == WORLD]
        if not roots and not on_ground:
            joint = next(iter(robot.joints.values()))
            circle = self.circle(joint.child, carried)
            self.problems.append(carried[circle[0]].place.problem(
                f"every link is the child of a joint: {_around(circle)}; one link must be the root"
            ))  # fmt: skip
            return
        for name in roots[1:]:
            self.problems.append(robot.links[name].place.problem(
                f"link {shortened(name)} is not the child of a joint, nor is {shortened(roots[0])} in line "
                f"{robot.links[roots[0]].place.line}; a robot has one root: join them by a joint"
            ))  # fmt: skip
        if self.problems:
            return
        children, stack = robot.children(), [*roots, *([WORLD] if on_ground else [])]
        reached = set(stack)
        while stack:
            for joint in children.get(stack.pop(), []):
                reached.add(joint.child)
                stack.append(joint.child)
        lost = next((name for name in robot.links if name not in reached), None)
        if lost is not None:
            circle = self.circle(lost, carried)
            self.problems.append(robot.links[circle[0]].place.problem(
                f"joints form a circle of links: {_around(circle)}; "
                f"one of them must be the child of a link that leads to the root {shortened((roots or on_ground)[0])}"
            ))  # fmt: skip

    def circle(self, start: str, carried: dict[str, RobotJoint]) -> list[str]:
        seen: list[str] = []
        while start not in seen:
            seen.append(start)
            start = carried[start].parent
        return seen[seen.index(start) :][:8]


def _around(circle: list[str]) -> str:
    return " -> ".join(map(shortened, [*circle, circle[0]]))
