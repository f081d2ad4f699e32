"""MJCF, compiled by MuJoCo itself: bodies, joints and equality constraints of an `mujoco.MjModel`.

A body of MuJoCo's may have several joints, each at a place of its own; here it becomes a chain of bodies, of which the last
has the mass. Coordinates are those of MuJoCo less the ones of the model's reference configuration (``ref``).
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any, Final

import numpy as np

from ..model import ModelError
from ..model.errors import Problem
from ..model.positions import shortened
from .naming import free_name, made_name
from .placement import Placement, direction, of_quaternion, plus
from .robot import WORLD, Closing, Coupling, Inertia, Link, Place, Robot, RobotJoint, Solid, as_three
from .xml_reading import Element

_FREE, _BALL, _SLIDE, _HINGE = range(4)
_TYPES: Final = {_FREE: "free", _BALL: "spherical", _SLIDE: "prismatic", _HINGE: "revolute"}
_CONNECT, _WELD, _JOINT = range(3)
_SITE: Final = 6
"""Of mjtObj."""
_SPHERE, _CAPSULE, _CYLINDER, _BOX = 2, 3, 5, 6
_DIRT: Final = 1e-15

_LISTED: Final = {
    "site": "", "tendon": "", "actuator": "--motors makes inputs", "sensor": "", "contact": "", "keyframe": "", "camera": "",
    "light": "", "skin": "", "flex": "", "flexcomp": "", "composite": "", "plugin": "", "extension": "",
    "deformable": "", "custom": "",
}  # fmt: skip
"""Elements that have no place in a model, wherever they stand."""


def read_mjcf(root: Element, path: Path) -> Robot:
    """The robot of a file.

    Raises
    ------
    ModelError
        With what MuJoCo says, and the line.
    """
    file = root.file
    mujoco = _mujoco()
    said: list[str] = []
    before = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(said.append)  # which else go to a file in the working directory
    try:
        model = mujoco.MjModel.from_xml_path(str(path))
    except (ValueError, RuntimeError, mujoco.FatalError) as error:
        raise ModelError([_said(file, str(error))]) from None
    finally:
        mujoco.set_mju_user_warning(before)
    robot = _Reader(model, file, root).read()
    robot.warnings += [Problem(file, None, None, "", f"MuJoCo says: {' '.join(w.split())}", "warning") for w in said]
    return robot


def read_mujoco(model: Any) -> Robot:
    """The robot of an `mujoco.MjModel`."""
    mujoco = _mujoco()
    if not isinstance(model, mujoco.MjModel):
        raise TypeError(
            f"from_mujoco takes a mujoco.MjModel, not {type(model).__name__}; such as MjModel.from_xml_path(...)"
        )
    return _Reader(model, "MjModel", None).read()


def _mujoco() -> Any:
    try:
        import mujoco
    except ImportError as error:
        raise ImportError(f"MJCF is compiled by MuJoCo, which is not installed ({error}); pip install mujoco") from None
    return mujoco


def _said(file: str, text: str) -> Problem:
    """An error of MuJoCo's."""
    line = re.search(r"\bline[ =](?:number=)?(\d+)", text) or re.search(r"Line number=(\d+)", text)
    what = " ".join(re.sub(r"(?:, )?line \d+|Error(?:ID)?=\S+(?: \(\w+\))?|Line number=\d+:?", " ", text).split())
    message = f"MuJoCo cannot compile it: {what}"
    return Problem(file, int(line[1]) if line else None, 1 if line else None, "", message)


class _Reader:
    def __init__(self, model: Any, file: str, root: Element | None) -> None:
        self.model = model
        self.file = file
        self.places = _places(root) if root is not None else {}
        name = model.names[: model.names.index(b"\0")].decode("utf-8", "replace") if b"\0" in model.names else ""
        self.robot = Robot(name or "robot", file, as_three(model.opt.gravity))
        self.root = root
        self.links: list[str] = [WORLD]
        self.joint_names: list[str] = []
        self.problems: list[Problem] = []

    def read(self) -> Robot:
        model = self.model
        if int(model.opt.disableflags) & int(_mujoco().mjtDisableBit.mjDSBL_GRAVITY):
            self.robot.gravity = (0.0, 0.0, 0.0)
        self.names = self.unique("body", model.nbody)
        self.joint_names = self.unique("joint", model.njnt)
        for b in range(1, model.nbody):
            self.body(b)
        for e in range(model.neq):
            self.equality(e)
        self.leave_out()
        if self.problems:
            raise ModelError(self.problems)
        return self.robot

    def unique(self, kind: str, count: int) -> list[str]:
        """Names of all objects of a kind; those that have none get one."""
        access = getattr(self.model, kind)
        given = [access(i).name for i in range(count)]
        used = set(given)
        for i, name in enumerate(given):
            if not name:
                given[i] = free_name(f"{kind}_{i}", used)
                used.add(given[i])
        return given

    def place(self, kind: str, name: str) -> Place:
        element = self.places.get((kind, name))
        return Place(self.file) if element is None else Place(self.file, element.line, element.column)

    def origin(self, b: int) -> Placement:
        """A body's frame of MuJoCo's in that used here."""
        return Placement() if b == 0 else self.robot.links[self.links[b]].origin

    def body(self, b: int) -> None:
        """A body with its joints."""
        model, name = self.model, self.names[b]
        place = self.place("body", name)
        parent = int(model.body_parentid[b])
        link = Link(name, place, self.inertia(b), self.solids(b))
        self.links.append(name)
        self.robot.links[name] = link
        frame = self.origin(parent) @ _frame(model.body_pos[b], model.body_quat[b])
        above, count, first = self.links[parent], int(model.body_jntnum[b]), int(model.body_jntadr[b])
        if not count:
            self.robot.joints[f" {name}"] = RobotJoint("", place, "fixed", above, name, frame)
            return
        before = Placement()
        for k in range(first, first + count):
            joint = self.joint(k)
            anchor = Placement() if joint.type == "free" else Placement(model.jnt_pos[k])
            last = k == first + count - 1
            joint.parent, joint.child = above, name if last else self.between(name, joint, place)
            if joint.type == "free":
                joint.start = (*map(float, model.qpos0[model.jnt_qposadr[k] :][:7]),)
            else:
                joint.frame = frame @ anchor if k == first else Placement(plus(anchor.at, [-v for v in before.at]))
            self.robot.joints[joint.name] = joint
            above, before = joint.child, anchor
        link.moved_to(before)

    def between(self, body: str, joint: RobotJoint, place: Place) -> str:
        """A link without mass between two joints of a body."""
        name = free_name(f"{body}_{made_name(joint.name)}", [*self.robot.links, *self.names])
        self.robot.links[name] = Link(name, place)
        return name

    def joint(self, k: int) -> RobotJoint:
        model, name = self.model, self.joint_names[k]
        place = self.place("joint", name)
        type_ = int(model.jnt_type[k])
        joint = RobotJoint(name, place, _TYPES[type_], "", "")
        if type_ in (_SLIDE, _HINGE):
            joint.axes = (direction(model.jnt_axis[k]),)
        dof, q = int(model.jnt_dofadr[k]), int(model.jnt_qposadr[k])
        joint.damping = float(model.dof_damping[dof])
        stiffness = float(np.ravel(model.jnt_stiffness[k])[0])
        if stiffness and type_ in (_SLIDE, _HINGE):
            joint.stiffness = stiffness
            joint.rest = float(model.qpos_spring[q] - model.qpos0[q])
        elif stiffness:
            self.robot.leave_out(f"stiffness of a {joint.type} joint", place.line)
        end = dof + {_FREE: 6, _BALL: 3}.get(type_, 1)
        self.robot.give_armature(joint, model.dof_armature[dof:end], place.line)
        if np.any(model.dof_frictionloss[dof:end]):
            self.robot.leave_out("frictionloss of a joint", place.line)
        if model.jnt_limited[k]:
            self.robot.leave_out("range of a joint", place.line)
        for what, poly in (("damping", "dof_dampingpoly"), ("stiffness", "jnt_stiffnesspoly")):
            rows = getattr(model, poly, None)
            if rows is not None and np.any(rows[dof if what == "damping" else k]):
                self.robot.leave_out(f"{what} of a joint by powers of its motion", place.line)
        return joint

    def inertia(self, b: int) -> Inertia:
        model = self.model
        own = Inertia(float(model.body_mass[b]), (0.0, 0.0, 0.0), np.diag(model.body_inertia[b].astype(float)))
        found = own.seen_from(_frame(model.body_ipos[b], model.body_iquat[b]))
        largest = np.abs(found.matrix).max()
        found.matrix = np.where(np.abs(found.matrix) < _DIRT * largest, 0.0, found.matrix)
        return found

    def solids(self, b: int) -> list[Solid]:
        model, found = self.model, []
        for g in range(int(model.body_geomadr[b]), int(model.body_geomadr[b]) + int(model.body_geomnum[b])):
            type_, size = int(model.geom_type[g]), model.geom_size[g]
            radius, length = float(size[0]), 2 * float(size[1])
            sizes: dict[int, tuple[str, tuple[float, ...]]] = {
                _BOX: ("box", (2 * float(size[0]), length, 2 * float(size[2]))),
                _SPHERE: ("sphere", (radius,)),
                _CYLINDER: ("cylinder", (radius, length)),
                _CAPSULE: ("capsule", (radius, length)),
            }
            if type_ in sizes:
                found.append(Solid(*sizes[type_], _frame(model.geom_pos[g], model.geom_quat[g])))
        return found

    def equality(self, e: int) -> None:
        """A constraint: a loop, or a coordinate that follows another."""
        model = self.model
        type_, data = int(model.eq_type[e]), model.eq_data[e]
        name = model.equality(e).name or free_name(f"equality_{e}", [c.name for c in self.robot.closings])
        place = self.place("equality", model.equality(e).name)
        ids = int(model.eq_obj1id[e]), int(model.eq_obj2id[e])
        if not model.eq_active0[e]:
            self.robot.leave_out("equality that is not active", place.line)
        elif type_ == _JOINT:
            self.coupled(name, place, ids, data)
        elif type_ not in (_CONNECT, _WELD):
            self.robot.leave_out("equality of tendons or flexible bodies", place.line)
        else:
            self.robot.leave_out("softness of <equality>", place.line, "loops are closed exactly: no solref, no solimp")
            if int(model.eq_objtype[e]) == _SITE:
                bodies = tuple(int(model.site_bodyid[i]) for i in ids)
                first, second = (_frame(model.site_pos[i], model.site_quat[i]) for i in ids)
            elif type_ == _CONNECT:
                bodies = ids
                first, second = Placement(data[0:3]), Placement(data[3:6])
            else:
                bodies = ids
                first, second = _frame(data[3:6], data[6:10]), Placement(data[0:3])
            if type_ == _CONNECT:
                first, second = Placement(first.at), Placement(second.at)
            ends = [(self.links[b], self.origin(b) @ f) for b, f in zip(bodies, (first, second), strict=True)]
            closing = "point" if type_ == _CONNECT else "fixed"
            self.robot.closings.append(Closing(made_name(name), place, closing, ends[0], ends[1]))

    def coupled(self, name: str, place: Place, joints: tuple[int, int], data: Any) -> None:
        first, second = joints
        what = f"joint {shortened(self.joint_names[first])}"
        if second < 0:
            self.problems.append(place.problem(f"{what} is held at a value by an equality; take the joint out instead"))
        elif np.any(data[2:5]):
            coefficients = " ".join(f"{v:g}" for v in data[:5])
            by = f"by a polynomial, polycoef {coefficients}; a line, of which the last three are 0, is read"
            self.problems.append(place.problem(f"{what} follows {shortened(self.joint_names[second])} {by}"))
        else:
            names = self.joint_names[first], self.joint_names[second]
            self.robot.leave_out("softness of <equality>", place.line, "loops are closed exactly: no solref, no solimp")
            self.robot.couplings.append(Coupling(name, place, *names, float(data[1]), float(data[0])))

    def leave_out(self) -> None:
        """What the model has and a file of ours has not."""
        model, robot = self.model, self.robot
        if self.root is not None:
            _leave_out_elements(robot, self.root)
        else:
            for what, count in (
                ("sites", model.nsite), ("tendons", model.ntendon), ("actuators", len(model.actuator_trntype)),
                ("sensors", model.nsensor), ("keyframes", model.nkey), ("cameras", model.ncam), ("plugins", model.nplugin),
                ("flexible bodies", model.nflex),
            ):  # fmt: skip
                for _ in range(int(count)):
                    robot.leave_out(what)
        if np.any(model.geom_contype) and np.any(model.geom_conaffinity):
            robot.leave_out("contacts of geoms")
        for name, value in (
            ("density", model.opt.density),
            ("viscosity", model.opt.viscosity),
            ("wind", model.opt.wind),
        ):
            if np.any(value):
                robot.leave_out(f"{name} of the medium")
        if np.any(model.body_gravcomp):
            robot.leave_out("gravcomp of bodies")
        if np.any(model.body_mocapid >= 0):
            robot.leave_out("mocap of bodies", remark="they stand still")


def _frame(at: Any, quaternion: Any) -> Placement:
    return Placement(at, of_quaternion(*map(float, quaternion)))


def _places(root: Element) -> dict[tuple[str, str], Element]:
    """Named elements of a file, by what they are."""
    found: dict[tuple[str, str], Element] = {}
    stack = [(root, "")]
    while stack:
        element, above = stack.pop()
        kind = {"freejoint": "joint"}.get(element.tag, element.tag)
        if above == "equality":
            kind = "equality"
        if above not in ("default", "actuator", "sensor", "tendon") and "name" in element.attributes:
            found.setdefault((kind, element.attributes["name"]), element)
        stack.extend((child, element.tag) for child in reversed(element.children))
    return found


def _leave_out_elements(robot: Robot, root: Element) -> None:
    stack = [root]
    while stack:
        element = stack.pop()
        if element.tag == "default":
            continue
        if element.tag in _LISTED:
            listed = (
                element.children
                if element.tag in ("tendon", "actuator", "sensor", "contact", "keyframe")
                else [element]
            )
            for child in listed:
                robot.leave_out(f"<{element.tag}>", child.line, _LISTED[element.tag])
            continue
        if element.tag == "geom" and element.attributes.get("type") == "mesh":
            robot.leave_out("<geom> of a mesh", element.line, "its mass is counted")
        stack.extend(reversed(element.children))
