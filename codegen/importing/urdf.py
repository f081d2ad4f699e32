"""URDF: links and joints of a tree, see http://wiki.ros.org/urdf/XML."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np

from ..model.errors import nearest
from ..model.positions import shortened
from .files import Files
from .placement import Placement, Three
from .robot import Coupling, Inertia, Link, Place, Robot, RobotJoint, Solid, as_three, symmetric
from .robot_reader import RobotReader
from .xml_reading import Element
from .xml_values import place_of

TYPES: Final = {
    "revolute": "revolute", "continuous": "revolute", "prismatic": "prismatic", "fixed": "fixed", "floating": "free",
    "planar": "planar",
}  # fmt: skip

_LINK: Final = {"inertial", "visual", "collision"}
_JOINT: Final = {"origin", "parent", "child", "axis", "limit", "dynamics", "mimic"}
_MEANT: Final = {
    "gazebo": "settings of a simulator", "transmission": "transmissions", "material": "materials",
    "sensor": "sensors", "safety_controller": "limits of controllers", "calibration": "calibrations of joints",
}  # fmt: skip
_ATTRIBUTES: Final = {
    "origin": {"xyz", "rpy"}, "axis": {"xyz"}, "mass": {"value"}, "parent": {"link"}, "child": {"link"},
    "inertia": {"ixx", "iyy", "izz", "ixy", "ixz", "iyz"}, "dynamics": {"damping", "friction"},
    "mimic": {"joint", "multiplier", "offset"}, "limit": {"lower", "upper", "effort", "velocity"},
    "joint": {"name", "type"}, "link": {"name", "type"}, "inertial": set(),
}  # fmt: skip


def read_urdf(root: Element, files: Files, exact_angles: bool = False) -> Robot:
    """The robot of a URDF; with `exact_angles`, 1.5708 means pi/2.

    Raises
    ------
    ModelError
        With every problem of the file.
    """
    return _Reader(root, files, exact_angles).whole()


class _Reader(RobotReader):
    def __init__(self, root: Element, files: Files, exact_angles: bool) -> None:
        super().__init__(root, files, exact_angles)
        self.robot.name = root.attributes.get("name", "").strip() or "robot"
        self.solids: dict[str, list[tuple[Element, Solid | None]]] = {}

    def read(self) -> None:
        for tag in ("include", "macro", "property"):
            for element in self.root.all(f"xacro:{tag}"):
                self.wrong(element, f"<xacro:{tag}>: this file is a xacro; expand it first: xacro FILE > robot.urdf")
                return
        links: dict[str, Place] = {}
        joints: dict[str, Place] = {}
        for element in self.root.children:
            if element.tag == "link":
                name = self.new_name(element, links, "link")
                if name is not None:
                    self.robot.links[name] = self.link(element, name)
        for element in self.root.children:
            if element.tag == "joint":
                name = self.new_name(element, joints, "joint")
                if name is not None:
                    self.joint(element, name)
            elif element.tag != "link":
                self.leave_out(element)
        if not self.robot.links and not self.problems:
            self.wrong(self.root, 'no <link>; a robot has at least one, such as <link name="arm"/>')
        if not self.problems:
            self.check_tree()

    def leave_out(self, element: Element) -> None:
        what = _MEANT.get(element.tag, "")
        self.robot.leave_out(f"<{element.tag}>", element.line, what)

    def leave_out_rest(self, element: Element, known: set[str]) -> None:
        """List the children that are not known, and attributes."""
        for child in element.children:
            if child.tag not in known:
                self.leave_out(child)
        allowed = _ATTRIBUTES.get(element.tag)
        if allowed is not None:
            for key in element.attributes:
                if key not in allowed:
                    hint = nearest(key, sorted(allowed)) if element.tag != "limit" else ""
                    self.robot.leave_out(f"attribute {shortened(key)} of <{element.tag}>{hint}", element.line)

    def origin(self, element: Element) -> Placement:
        """The frame of an element's <origin>."""
        found = self.one(element, "origin")
        if found is None:
            return Placement()
        self.leave_out_rest(found, set())
        xyz = self.attribute(found, "xyz", 3, (0, 0, 0))
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
        """A primitive of <visual> or <collision>; what else there is is listed."""
        for child in element.children:
            if child.tag not in ("origin", "geometry"):
                self.leave_out(child)
        geometry = self.one(element, "geometry")
        frame = self.origin(element)
        if geometry is None:
            return None
        read: dict[str, Callable[[Element], tuple[float, ...]]] = {
            "box": lambda e: self.attribute(e, "size", 3, (0, 0, 0)),
            "cylinder": lambda e: (self.number(e, "radius", None), self.number(e, "length", None)),
            "capsule": lambda e: (self.number(e, "radius", None), self.number(e, "length", None)),
            "sphere": lambda e: (self.number(e, "radius", None),),
        }
        found = None
        for child in geometry.children:
            if child.tag == "mesh":
                self.mesh(child)
            elif child.tag in read:
                self.robot.leave_out(f"<{element.tag}> of a {child.tag}", child.line)
                found = Solid(child.tag, read[child.tag](child), frame)
            else:
                self.leave_out(child)
        return found

    def mesh(self, element: Element) -> None:
        name = element.attributes.get("filename", "")
        missing = self.files.missing(name)
        self.robot.leave_out("<mesh>" if missing is None else f"<mesh>, {missing}", element.line)

    def joint(self, element: Element, name: str) -> None:
        self.leave_out_rest(element, _JOINT | set(_MEANT))
        for child in element.children:
            if child.tag in _MEANT:
                self.leave_out(child)
        type_ = self.name(element, "type")
        if type_ is not None and type_ not in TYPES:
            self.wrong(
                element,
                f"joint {shortened(name)} is {shortened(type_)}; {', '.join(TYPES)} are joints{nearest(type_, TYPES)}",
            )
        ends = []
        for tag in ("parent", "child"):
            end = self.one(element, tag)
            if end is None:
                self.wrong(element, f'joint {shortened(name)} has no {tag}; <{tag} link="..."/> is needed')
                continue
            link = self.name(end, "link")
            if link is None:
                continue
            if link not in self.robot.links:
                self.unknown(end, "link", link, list(self.robot.links))
            ends.append(link)
        frame = self.origin(element)
        axis = self.axis(element) if type_ not in ("fixed", "floating") else None
        damping = self.dynamics(element)
        for limit in element.all("limit"):
            self.leave_out_rest(limit, set())
            self.robot.leave_out("<limit>", limit.line, "of position, speed and force")
        if type_ not in TYPES or len(ends) < 2:
            return
        joint = RobotJoint(name, place_of(element), TYPES[type_], ends[0], ends[1], frame, damping=damping)
        joint.axes = () if axis is None else (axis,)
        self.robot.joints[name] = joint
        mimic = self.one(element, "mimic")
        if mimic is not None:
            self.mimic(mimic, name)

    def axis(self, element: Element) -> Three:
        found = self.one(element, "axis")
        if found is None:
            return (1.0, 0.0, 0.0)
        self.leave_out_rest(found, set())
        xyz = self.attribute(found, "xyz", 3, (1, 0, 0))
        if not any(xyz):
            self.wrong(found, 'the axis is 0 0 0, which is no direction; such as xyz="0 0 1" is needed')
            return (1.0, 0.0, 0.0)
        return as_three(xyz)

    def dynamics(self, element: Element) -> float:
        found = self.one(element, "dynamics")
        if found is None:
            return 0.0
        self.leave_out_rest(found, set())
        if self.number(found, "friction"):
            self.robot.leave_out("friction of <dynamics>", found.line, "dry friction of joints")
        return self.number(found, "damping")

    def mimic(self, element: Element, joint: str) -> None:
        self.leave_out_rest(element, set())
        other = self.name(element, "joint")
        if other is not None:
            ratio, offset = self.number(element, "multiplier", 1.0), self.number(element, "offset")
            self.robot.couplings.append(Coupling(joint, place_of(element), joint, other, ratio, offset))

    def check_tree(self) -> None:
        """Every link but one is carried by one joint."""
        robot = self.robot
        carried: dict[str, RobotJoint] = {}
        for joint in robot.joints.values():
            other = carried.setdefault(joint.child, joint)
            if other is not joint:
                self.problems.append(joint.place.problem(
                    f"link {shortened(joint.child)} is the child of joint {shortened(joint.name)} and of {shortened(other.name)} "
                    f"in line {other.place.line}; links of a URDF are a tree: take one joint out, and close the loop with --loops"
                ))  # fmt: skip
        roots = [name for name in robot.links if name not in carried]
        if not roots:
            joint = next(iter(robot.joints.values()))
            circle = self.circle(joint.child, carried)
            self.problems.append(carried[circle[0]].place.problem(
                f"every link is carried by another one: {_around(circle)}; one link must be the root"
            ))  # fmt: skip
            return
        for name in roots[1:]:
            self.problems.append(robot.links[name].place.problem(
                f"link {shortened(name)} is not the child of a joint, nor is {shortened(roots[0])} in line "
                f"{robot.links[roots[0]].place.line}; a robot has one root: join them by a joint"
            ))  # fmt: skip
        if self.problems:
            return
        reached, stack, children = {roots[0]}, [roots[0]], robot.children()
        while stack:
            for joint in children.get(stack.pop(), []):
                reached.add(joint.child)
                stack.append(joint.child)
        lost = next((name for name in robot.links if name not in reached), None)
        if lost is not None:
            circle = self.circle(lost, carried)
            self.problems.append(robot.links[circle[0]].place.problem(
                f"links carry each other in a circle: {_around(circle)}; "
                f"one of them must be the child of a link that leads to the root {shortened(roots[0])}"
            ))  # fmt: skip

    def circle(self, start: str, carried: dict[str, RobotJoint]) -> list[str]:
        seen: list[str] = []
        while start not in seen:
            seen.append(start)
            start = carried[start].parent
        return seen[seen.index(start) :][:8]


def _around(circle: list[str]) -> str:
    return " -> ".join(map(shortened, [*circle, circle[0]]))
