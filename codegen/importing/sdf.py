"""SDF: links with poses of their own, and joints between them that may close loops, see http://sdformat.org/spec.

Poses are relative to the model (a joint's to its child) or to what ``relative_to`` names; an axis has components in the
joint's frame, in the model's with ``use_parent_model_frame`` and in files before 1.5, or in the frame that
``expressed_in`` names.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from ..model import ModelError
from ..model.errors import nearest
from ..model.positions import shortened
from .files import Files
from .naming import made_name
from .placement import Placement, Three, to_quaternion, without_dirt
from .robot import WORLD, Closing, Coupling, Inertia, Link, Place, Robot, RobotJoint, Solid, as_three, symmetric
from .robot_reader import RobotReader
from .spanning import Edge, spanning_tree
from .xml_reading import Element, parse_xml, read_robot_file
from .xml_values import place_of

TYPES: Final = {
    "revolute": "revolute", "continuous": "revolute", "prismatic": "prismatic", "ball": "spherical", "universal": "universal",
    "fixed": "fixed", "screw": "screw",
}  # fmt: skip
_LOOP_TYPES: Final = {"spherical": "point"}
_LINK: Final = {"pose", "inertial", "visual", "collision"}
_JOINT: Final = {
    "pose", "parent", "child", "axis", "axis2", "thread_pitch", "screw_thread_pitch", "gearbox_ratio", "gearbox_reference_body",
}  # fmt: skip
_MODEL: Final = {"pose", "link", "joint", "frame", "static", "model", "include"}
_GRAVITY: Final = (0.0, 0.0, -9.8)
"""Of a world that does not say it."""


PARALLEL: Final = 1e-6
"""rad: axes of a gear and of a hinge that differ by less are the same."""


@dataclass(slots=True)
class _Joint:
    """A joint as read."""

    name: str
    element: Element
    type: str
    parent: str
    child: str
    axes: tuple[Element, ...] = ()
    pitch: float = 0.0
    damping: float = 0.0
    stiffness: float = 0.0
    rest: float = 0.0


def read_sdf(root: Element, files: Files, exact_angles: bool = False) -> Robot:
    """The robot of an SDF file, or of a world with one model; with `exact_angles`, 1.5708 means pi/2.

    Raises
    ------
    ModelError
        With every problem of the file.
    """
    return _Reader(root, files, exact_angles).whole()


class _Reader(RobotReader):
    def __init__(self, root: Element, files: Files, exact_angles: bool) -> None:
        super().__init__(root, files, exact_angles)
        self.poses: dict[str, Element] = {}
        """What has a frame, by its name."""
        self.placed: dict[str, Placement | None] = {}
        self.joints: dict[str, _Joint] = {}
        self.gears: list[_Joint] = []
        self.version = 1.0

    def read(self) -> None:
        parts = self.root.attributes.get("version", "1.0").split(".")
        self.version = float(".".join(parts[:2])) if all(p.isdigit() for p in parts) else 1.0
        model = self.model()
        if model is None:
            return
        self.robot.name = model.attributes.get("name", "").strip() or "robot"
        self.model_element = model
        self.elements(model)
        if not self.robot.links and not self.problems:
            self.wrong(model, 'no <link>; a model has at least one, such as <link name="arm"/>')
        if not self.problems:
            self.put_together(model)

    def model(self) -> Element | None:
        """The one model of the file."""
        found = list(self.root.all("model"))
        for world in self.root.all("world"):
            found += world.all("model")
            gravity = world.first("gravity")
            self.robot.gravity = as_three(self.content(gravity, 3, _GRAVITY))
            for child in world.children:
                if child.tag not in ("model", "gravity", "include"):
                    self.leave_out(child)
            for include in world.all("include"):
                model = self.included(include)
                if model is not None:
                    found.append(model)
        moving = [m for m in found if not self.is_static(m)] or found
        for model in found:
            if model not in moving:
                self.robot.leave_out("static <model>", model.line)
        if not moving:
            if not self.problems:
                self.wrong(self.root, 'no <model>; <sdf> holds one, such as <model name="robot">')
            return None
        for other in moving[1:]:
            names = " and ".join(shortened(m.attributes.get("name", "")) for m in (moving[0], other))
            self.wrong(other, f"a second model, {names}; one is read: put them into files of their own")
        return moving[0]

    def included(self, include: Element) -> Element | None:
        """The model that an <include> of a world means."""
        uri = include.first("uri")
        name = uri.text.strip() if uri is not None else ""
        path = self.files.find(name)
        if path is not None and path.is_dir():
            path = next((p for p in (path / "model.sdf", *sorted(path.glob("*.sdf"))) if p.exists()), None)
        if path is None:
            self.wrong(
                include, f"<include> of {shortened(name)}: {self.files.missing(name) or 'no .sdf in that folder'}"
            )
            return None
        try:
            root = parse_xml(read_robot_file(path), str(path))
        except ModelError as error:
            self.problems += error.problems
            return None
        return root.first("model")

    def is_static(self, model: Element) -> bool:
        static = model.first("static")
        return static is not None and static.text.strip() in ("1", "true")

    def leave_out(self, element: Element, remark: str = "") -> None:
        self.robot.leave_out(f"<{element.tag}>", element.line, remark)

    # ---- elements ------------------------------------------------------------------------------------------------------

    def elements(self, model: Element) -> None:
        names: dict[str, Place] = {}
        for child in model.children:
            if child.tag in ("model", "include"):
                self.wrong(child, f"<{child.tag}> within a model is not read; write the file flat: gz sdf -p FILE")
            elif child.tag not in _MODEL:
                self.leave_out(child)
            elif child.tag in ("link", "joint", "frame"):
                name = self.new_name(child, names, "name")
                if name is not None:
                    self.poses[name] = child
        for name, element in self.poses.items():
            if element.tag == "link":
                self.robot.links[name] = self.link(element, name)
        for name, element in self.poses.items():
            if element.tag == "joint":
                self.joint(element, name)

    def link(self, element: Element, name: str) -> Link:
        link = Link(name, place_of(element))
        for child in element.children:
            if child.tag not in _LINK:
                self.leave_out(child)
        inertial = self.one(element, "inertial")
        if inertial is None:
            link.inertia = Inertia(1.0, (0.0, 0.0, 0.0), np.eye(3))
            message = f"link {shortened(name)} has no <inertial>; SDF means 1 kg and 1 kg m^2 about every axis then"
            self.robot.warnings.append(element.problem(message, "warning"))
        else:
            link.inertia = self.inertia(inertial)
        for shown in element.all("visual", "collision"):
            solid = self.solid(shown)
            if solid is not None:
                link.solids.append(solid)
        return link

    def inertia(self, element: Element) -> Inertia:
        for child in element.children:
            if child.tag not in ("pose", "mass", "inertia"):
                self.leave_out(child)
        frame = self.pose(self.one(element, "pose"))
        mass = self.content(self.one(element, "mass"), 1, (1.0,))[0]
        if mass < 0:
            self.wrong(element, f"the mass is {mass:g}; at least 0 kg is needed")
        inertia = self.one(element, "inertia")
        six = [0.0] * 6
        for k, key in enumerate(("ixx", "iyy", "izz", "ixy", "ixz", "iyz")):
            found = self.one(inertia, key) if inertia is not None else None
            six[k] = self.content(found, 1, (1.0 if k < 3 else 0.0,))[0]
        return Inertia(mass, (0.0, 0.0, 0.0), symmetric(*six)).seen_from(frame)

    def solid(self, element: Element) -> Solid | None:
        for child in element.children:
            if child.tag not in ("pose", "geometry"):
                self.leave_out(child)
        geometry = self.one(element, "geometry")
        if geometry is None:
            return None
        frame = self.pose(self.one(element, "pose"))
        read: dict[str, Callable[[Element], tuple[float, ...]]] = {
            "box": lambda e: self.content(e.first("size"), 3, (0, 0, 0)),
            "cylinder": lambda e: tuple(self.content(e.first(k), 1, (0,))[0] for k in ("radius", "length")),
            "capsule": lambda e: tuple(self.content(e.first(k), 1, (0,))[0] for k in ("radius", "length")),
            "sphere": lambda e: self.content(e.first("radius"), 1, (0,)),
        }
        for child in geometry.children:
            if child.tag in read:
                self.robot.leave_out(f"<{element.tag}> of a {child.tag}", child.line)
                return Solid(child.tag, read[child.tag](child), frame)
            if child.tag == "mesh":
                uri = child.first("uri")
                missing = self.files.missing(uri.text.strip() if uri is not None else "")
                self.robot.leave_out("<mesh>" if missing is None else f"<mesh>, {missing}", child.line)
            else:
                self.leave_out(child)
        return None

    def joint(self, element: Element, name: str) -> None:
        for child in element.children:
            if child.tag not in _JOINT:
                self.leave_out(child)
        type_ = self.name(element, "type")
        if type_ is not None and type_ not in TYPES and type_ != "gearbox":
            known = [*TYPES, "gearbox"]
            self.wrong(
                element,
                f"joint {shortened(name)} is {shortened(type_)}; {', '.join(known)} are joints{nearest(type_, known)}",
            )
        ends = []
        for tag in ("parent", "child"):
            end = self.one(element, tag)
            if end is None:
                self.wrong(element, f"joint {shortened(name)} has no {tag}; <{tag}>LINK</{tag}> is needed")
                continue
            link = end.text.strip()
            if link != "world" and link not in self.robot.links:
                self.unknown(end, "link", link, list(self.robot.links))
            ends.append(WORLD if link == "world" else link)
        if len(ends) == 2 and ends[0] == ends[1]:
            self.wrong(
                element, f"joint {shortened(name)} joins link {shortened(ends[0])} to itself; two links are needed"
            )
            return
        if type_ == "gearbox" and len(ends) == 2:
            self.gears.append(_Joint(name, element, type_, ends[0], ends[1]))
        if len(ends) < 2 or type_ not in TYPES:
            return
        joint = self.joints[name] = _Joint(name, element, TYPES[type_], ends[0], ends[1])
        tags = {"universal": ("axis", "axis2"), "ball": (), "fixed": ()}.get(type_, ("axis",))
        found = [self.one(element, tag) for tag in tags]
        joint.axes = tuple(a for a in found if a is not None)
        for axis in found:
            if axis is None:
                needed = "<axis><xyz>0 0 1</xyz></axis>" + (" and <axis2>" if type_ == "universal" else "")
                self.wrong(element, f"joint {shortened(name)}, {type_}, has not all its axes; {needed} is needed")
            else:
                self.axis(axis, joint)
        if type_ == "screw":
            self.thread(element, joint)

    def thread(self, element: Element, joint: _Joint) -> None:
        """The pitch of a screw: ``screw_thread_pitch`` is in metres a turn, ``thread_pitch`` in radians a metre, negative."""
        pitch, old = element.first("screw_thread_pitch"), element.first("thread_pitch")
        if pitch is not None:
            joint.pitch = self.content(pitch, 1, (0,))[0] / (2 * np.pi)
        elif old is not None:
            value = self.content(old, 1, (0,))[0]
            if value == 0:
                self.wrong(old, "thread_pitch is 0; a number of radians a metre is needed")
            joint.pitch = -1.0 / value if value else 0.0
        else:
            joint.pitch = 1.0 / (2 * np.pi)

    def axis(self, element: Element, joint: _Joint) -> None:
        for child in element.children:
            if child.tag == "limit":
                self.leave_out(child, "of position, speed and force")
            elif child.tag == "dynamics":
                self.dynamics(child, joint)
            elif child.tag not in ("xyz", "use_parent_model_frame"):
                self.leave_out(child)
        if not any(self.content(element.first("xyz"), 3, (0, 0, 1))):
            self.wrong(element, "the axis is 0 0 0, which is no direction; such as <xyz>0 0 1</xyz> is needed")

    def dynamics(self, element: Element, joint: _Joint) -> None:
        values = {}
        for child in element.children:
            if child.tag in ("damping", "friction", "spring_reference", "spring_stiffness"):
                values[child.tag] = self.content(child, 1, (0,))[0]
            else:
                self.leave_out(child)
        if values.get("friction"):
            self.robot.leave_out("<friction> of <dynamics>", element.line, "dry friction of joints")
        if len(joint.axes) > 1 and (values.get("damping") or values.get("spring_stiffness")):
            self.robot.leave_out("<dynamics> of a universal joint", element.line)
            return
        joint.damping = values.get("damping", 0.0)
        joint.stiffness = values.get("spring_stiffness", 0.0)
        joint.rest = values.get("spring_reference", 0.0) if joint.stiffness else 0.0

    # ---- frames --------------------------------------------------------------------------------------------------------

    def pose(self, element: Element | None) -> Placement:
        """The numbers of a <pose>."""
        if element is None or not element.text.strip():
            return Placement()
        six = self.content(element, 6, (0,) * 6)
        rpy = np.radians(six[3:]) if element.attributes.get("degrees") in ("1", "true") else six[3:]
        return Placement(six[:3], rpy=self.angles([float(a) for a in rpy]))

    def frame(self, name: str, asked: Element) -> Placement:
        """A frame in that of the model."""
        if name in ("", "__model__"):
            return Placement()
        if name == "world":
            return self.pose(self.model_element.first("pose")).inverse()
        element = self.poses.get(name)
        if element is None:
            self.unknown(asked, "frame", name, ["__model__", *self.poses])
            return Placement()
        if name in self.placed:
            found = self.placed[name]
            if found is None:
                message = (
                    f"frame {shortened(name)} is relative to itself by way of others; one must be relative to the model"
                )
                self.wrong(asked, message)
                return Placement()
            return found
        self.placed[name] = None
        pose = element.first("pose")
        base = "__model__"
        if element.tag == "joint":
            child = element.first("child")
            base = child.text.strip() if child is not None else base
        elif element.tag == "frame":
            base = element.attributes.get("attached_to", base)
        if pose is not None:
            base = pose.attributes.get("relative_to", "").strip() or base
        result = self.frame(base, pose if pose is not None else element) @ self.pose(pose)
        self.placed[name] = result
        return result

    def direction(self, joint: _Joint, axis: Element, child: Placement) -> Three:
        """Components of an axis in the child's axes."""
        xyz = axis.first("xyz")
        value = as_three(self.content(xyz, 3, (0, 0, 1)))
        in_model = axis.first("use_parent_model_frame")
        expressed = xyz.attributes.get("expressed_in", "").strip() if xyz is not None else ""
        if expressed:
            value = self.frame(expressed, axis).vector(value)
        elif self.version < 1.5 or (in_model is not None and in_model.text.strip() in ("1", "true")):
            pass
        else:
            value = self.frame(joint.name, joint.element).vector(value)
        return without_dirt(child.inverse().vector(value))

    # ---- the tree ------------------------------------------------------------------------------------------------------

    def put_together(self, model: Element) -> None:
        """Choose joints for a tree; the others close loops."""
        robot = self.robot
        edges = [Edge(j.name, j.parent, j.child, j.type == "spherical") for j in self.joints.values()]
        tree = spanning_tree(list(robot.links), edges)
        poses = {
            name: self.frame(name, link_element) for name, link_element in self.poses.items() if name in robot.links
        }
        outside = self.pose(model.first("pose"))
        used: dict[str, Placement] = {WORLD: outside.inverse()}
        static = self.is_static(model)
        for name, reverse in tree.carriers:
            if name not in self.joints:  # of a base: name is that of the link
                used[name] = poses[name]
                at = outside @ poses[name]
                place = robot.links[name].place
                joint = RobotJoint("", place, "fixed" if static else "free", WORLD, name, at if static else Placement())
                joint.start = () if static else (*at.at, *to_quaternion(at.rotation))
                robot.joints[f" {name}"] = joint
                continue
            self.carry(self.joints[name], reverse, poses, used)
        for name in robot.links:
            robot.links[name].moved_to(poses[name].inverse() @ used[name])
        carried = {name for name, _ in tree.carriers}
        for gear in self.gears:
            robot.couplings.append(self.gear(gear, used))
        for left in self.joints.values():
            if left.name not in carried:
                self.close(left, poses, used)

    def carry(self, joint: _Joint, reverse: bool, poses: dict[str, Placement], used: dict[str, Placement]) -> None:
        """A joint of the tree; reversed, its child carries its parent."""
        above, below = (joint.child, joint.parent) if reverse else (joint.parent, joint.child)
        at = self.frame(joint.name, joint.element).at
        used[below] = Placement(at, poses[below].rotation, poses[below].rpy)
        axes = [self.direction(joint, axis, used[below]) for axis in joint.axes]
        if reverse:
            axes = [as_three([-v for v in axis]) for axis in reversed(axes)]
        self.robot.joints[joint.name] = RobotJoint(
            joint.name, place_of(joint.element), joint.type, above, below, used[above].inverse() @ used[below],
            tuple(as_three(np.array(a) + 0.0) for a in axes), joint.pitch, joint.damping, joint.stiffness, joint.rest,
        )  # fmt: skip

    def gear(self, gear: _Joint, used: dict[str, Placement]) -> Coupling:
        """A gearbox as a coupling of the two hinges that its links have on its reference body.

        The specification: theta_2 = -gearbox_ratio theta_1, the angles of the parent about ``axis`` and of the child about
        ``axis2``, both against ``gearbox_reference_body``.
        """
        place, told = (
            place_of(gear.element),
            f"is a gear between links {shortened(gear.parent)} and {shortened(gear.child)}",
        )
        reference, ratio = (gear.element.first(f"gearbox_{word}") for word in ("reference_body", "ratio"))
        if reference is None:
            return Coupling(gear.name, place, gear.name, "", 0.0, 0.0, told, is_gear=True)
        body = WORLD if reference.text.strip() == "world" else reference.text.strip()
        if body != WORLD and body not in self.robot.links:
            self.unknown(reference, "link", body, list(self.robot.links))
        hinges: list[tuple[str, int]] = []
        for link, tag in ((gear.parent, "axis"), (gear.child, "axis2")):
            axis = gear.element.first(tag) or gear.element.first("axis")
            along = None if axis is None else np.array(self.direction(gear, axis, Placement()))
            hinges += [] if along is None else self.hinge(body, link, along, used)[:1]
        if len(hinges) < 2:
            told += f", one of which has no hinge about the gear's axis on its reference body {shortened(reference.text.strip())}"
            return Coupling(gear.name, place, gear.name, "", 0.0, 0.0, told, is_gear=True)
        (of, first), (joint, second) = hinges
        value = 1.0 if ratio is None else self.content(ratio, 1, (1.0,))[0]
        return Coupling(gear.name, place, joint, of, -value * first * second, 0.0, is_gear=True)

    def hinge(self, body: str, link: str, along: Any, used: dict[str, Placement]) -> list[tuple[str, int]]:
        """Joints of the tree that turn a link against a body about an axis, and 1, or -1 where they count the other way."""
        found = []
        for name, joint in self.robot.joints.items():
            if joint.type not in ("revolute", "continuous") or {joint.parent, joint.child} != {body, link}:
                continue
            axis = np.array(used[joint.child].vector(joint.axes[0]))
            size = float(np.linalg.norm(axis) * np.linalg.norm(along))
            if np.linalg.norm(np.cross(axis, along)) <= PARALLEL * size:
                found.append((name, (1 if axis @ along > 0 else -1) * (1 if joint.child == link else -1)))
        return found

    def close(self, joint: _Joint, poses: dict[str, Placement], used: dict[str, Placement]) -> None:
        """A joint that closes a loop."""
        place = place_of(joint.element)
        if joint.type == "screw":
            message = (
                f"joint {shortened(joint.name)}, a screw, closes a loop, which models cannot say; let it carry a link"
            )
            self.wrong(joint.element, message)
            return
        if joint.damping or joint.stiffness:
            self.robot.leave_out("<dynamics> of a joint that closes a loop", place.line)
        rotation = poses[joint.child].rotation if joint.child != WORLD else np.eye(3)
        face = Placement(self.frame(joint.name, joint.element).at, rotation)
        if joint.type == "spherical":
            face = Placement(face.at)
        axes = tuple(self.direction(joint, axis, face) for axis in joint.axes)
        ends = []
        for link in (joint.parent, joint.child):
            end = used[link].inverse() @ face
            ends.append((link, Placement(end.at) if joint.type == "spherical" else end))
        self.robot.closings.append(
            Closing(made_name(joint.name), place, _LOOP_TYPES.get(joint.type, joint.type), ends[0], ends[1], axes)
        )
