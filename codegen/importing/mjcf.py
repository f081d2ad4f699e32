"""MJCF, compiled by MuJoCo itself: bodies, joints and equality constraints of an `mujoco.MjModel`.

A MuJoCo body may have several joints, each at its own place; it becomes a chain of bodies, of which the last has the
mass. Coordinates are MuJoCo's, minus the values in the model's reference configuration (``ref``).
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any, Final

import numpy as np

from ..model import ModelError
from ..model.errors import Problem, nearest
from ..model.positions import shortened
from .files import Files
from .mjcf_files import MjcfFiles
from .mjcf_forces import PassiveForces, damper_law, disabled, row, spring_law, terms_of
from .mjcf_numbers import problems_of_numbers
from .naming import free_name, made_name
from .placement import Placement, direction, of_quaternion, plus
from .robot import (
    WORLD,
    Closing,
    Coupling,
    Effect,
    Inertia,
    JointTerm,
    Law,
    Link,
    Place,
    Robot,
    RobotJoint,
    Solid,
    as_three,
)
from .xml_reading import Element
from .xml_values import hex_color, place_of

_FREE, _BALL, _SLIDE, _HINGE = range(4)
_TYPES: Final = {_FREE: "free", _BALL: "spherical", _SLIDE: "prismatic", _HINGE: "revolute"}
_CONNECT, _WELD, _JOINT = range(3)
_SITE: Final = 6
"""MuJoCo's number for the object type "site" (mjtObj)."""
_SPHERE, _CAPSULE, _ELLIPSOID, _CYLINDER, _BOX, _MESH = 2, 3, 4, 5, 6, 7
_GREY: Final = (0.5, 0.5, 0.5, 1.0)
"""The colour of a geom without a colour of its own."""
_MESH_FOLDERS: Final = ("meshdir", "assetdir")
_HIDDEN: Final = 3
"""The first group of geoms that MuJoCo's viewer does not show."""
_DIRT: Final = 1e-15

_LISTED: Final[dict[str, tuple[str, str, str, Effect]]] = {
    "nsite": ("site", "", "", Effect.NONE), "nsensor": ("sensor", "sensor", "", Effect.NONE),
    "ncam": ("camera", "", "", Effect.NONE), "nlight": ("light", "", "", Effect.NONE), "nskin": ("skin", "", "", Effect.NONE),
    "nflex": ("flex", "", "flexible bodies; here nothing connects their masses", Effect.DIFFERS),
    "nplugin": ("plugin", "", "", Effect.UNKNOWN), "npair": ("contact", "contact", "", Effect.STOPS),
    "nexclude": ("contact", "contact", "", Effect.STOPS), "nnumeric": ("custom", "custom", "", Effect.NONE),
    "ntext": ("custom", "custom", "", Effect.NONE), "ntuple": ("custom", "custom", "", Effect.NONE),
}  # fmt: skip
"""Parts of a compiled model that the model format lacks.

Each key is the field of `mjModel` that counts the parts. Its value: the parts' tag, the tag of the list that contains them, a
remark, and the effect of their absence.
"""
_SOFT: Final = "here loops are closed exactly, without solref and solimp"
_UNNAMED: Final = "MuJoCo Model"
_MEDIUM: Final = ("density", "viscosity", "wind")


def read_mjcf(root: Element, path: Path, files: Files, key: str | None = None) -> Robot:
    """Read the robot of an MJCF file.

    Parameters
    ----------
    root : Element
    path : path
    files : Files
        The files that may be read.
    key : str, optional
        The initial keyframe; the first one if omitted, none for ``""``.

    Raises
    ------
    ModelError
        With MuJoCo's message and the line.
    """
    file = root.file
    mujoco = _mujoco()
    if not path.is_file():
        raise ModelError([root.problem("MuJoCo reads MJCF from a file; write it into one")])
    parts = MjcfFiles(root, files)
    said: list[str] = []
    before = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(said.append)  # otherwise MuJoCo writes warnings to a file
    try:
        model = mujoco.MjModel.from_xml_path(str(path.resolve()))
    except (ValueError, RuntimeError, mujoco.FatalError) as error:
        raise ModelError([_said(file, str(error), parts)]) from None
    finally:
        mujoco.set_mju_user_warning(before)
    robot = _Reader(model, file, parts, key).read()
    if robot.name == _UNNAMED and not parts.is_named():
        robot.name = path.stem
    robot.warnings += [Problem(file, None, None, "", f"MuJoCo says: {' '.join(w.split())}", "warning") for w in said]
    return robot


def read_mujoco(model: Any, key: str | None = None) -> Robot:
    """The robot of an `mujoco.MjModel`, initially in the keyframe `key`, or in the first keyframe."""
    mujoco = _mujoco()
    if not isinstance(model, mujoco.MjModel):
        raise TypeError(
            f"from_mujoco takes a mujoco.MjModel, such as MjModel.from_xml_path(...), not {type(model).__name__}"
        )
    return _Reader(model, "MjModel", None, key).read()


def _mujoco() -> Any:
    try:
        import mujoco
    except ImportError as error:
        raise ImportError(f"MJCF is compiled by MuJoCo, which is not installed ({error}); pip install mujoco") from None
    return mujoco


def _said(file: str, text: str, parts: MjcfFiles) -> Problem:
    """A MuJoCo error with its place: the line in MuJoCo's message, or the element that the message names."""
    line = re.search(r"\bline[ =](?:number=)?(\d+)", text) or re.search(r"Line number=(\d+)", text)
    what = " ".join(re.sub(r"(?:, )?line \d+|Error(?:ID)?=\S+(?: \(\w+\))?|Line number=\d+:?", " ", text).split())
    message = f"MuJoCo cannot compile it: {what}"
    named = re.search(r"Element name '([^']+)'", text)
    if line is None and named is not None:
        found = next((place for (_, name), place in parts.places().items() if name == named[1]), None)
        if found is not None:
            return found.problem(message)
    return Problem(file, int(line[1]) if line else None, 1 if line else None, "", message)


class _Reader:
    def __init__(self, model: Any, file: str, parts: MjcfFiles | None, key: str | None) -> None:
        self.model = model
        self.disabled = partial(disabled, _mujoco(), model)
        """Whether at least one of the given flags of the model is disabled."""
        self.file = file
        self.parts = parts
        self.key = key
        self.places = parts.places() if parts is not None else {}
        name = model.names[: model.names.index(b"\0")].decode("utf-8", "replace") if b"\0" in model.names else ""
        self.robot = Robot(name or "robot", file, as_three(model.opt.gravity))
        self.links: list[str] = [WORLD]
        self.joint_names: list[str] = []
        self.problems: list[Problem] = []

    def read(self) -> Robot:
        model = self.model
        if self.disabled("GRAVITY"):
            self.robot.gravity = (0.0, 0.0, 0.0)
        self.names = self.unique("body", model.nbody)
        self.joint_names = self.unique("joint", model.njnt)
        if wrong := problems_of_numbers(model, self.file, self.place):
            raise ModelError(wrong)
        self.robot.scenery = self.solids(0)
        for b in range(1, model.nbody):
            self.body(b)
        for e in range(model.neq):
            self.equality(e)
        PassiveForces(_mujoco(), model, self.robot, self.links, self.joint_names, self.origin, self.place).read()
        self.begin()
        self.leave_out()
        if self.problems:
            raise ModelError(self.problems)
        return self.robot

    def unique(self, kind: str, count: int) -> list[str]:
        """Unique names of all objects of one kind; objects without a name get one."""
        access = getattr(self.model, kind)
        given = [access(i).name for i in range(count)]
        used = set(given)
        for i, name in enumerate(given):
            if not name:
                given[i] = free_name(f"{kind}_{i}", used)
                used.add(given[i])
        return given

    def place(self, kind: str, name: str, number: int | None = None) -> Place:
        """The place in the files of an element of one kind: found by name, or by number in the list of that kind."""
        found = self.places.get((kind, name)) if name else None
        if found is None and number is not None and self.parts is not None:
            listed = self.parts.joints() if kind == "joint" else self.parts.listed(kind)
            if listed and len(self.ranked(kind)) % len(listed) == 0:  # copies of an attached model follow each other
                found = place_of(listed[number % len(listed)])
        return found or Place(self.file)

    def ranked(self, kind: str) -> range:
        """The indices of compiled objects of one kind."""
        model = self.model
        counts = {"equality": model.neq, "tendon": model.ntendon, "keyframe": model.nkey, "joint": model.njnt}
        return range(int(counts.get(kind, len(model.actuator_trntype))))

    def origin(self, b: int) -> Placement:
        """The frame of a MuJoCo body relative to the frame of its link."""
        return Placement() if b == 0 else self.robot.links[self.links[b]].origin

    def body(self, b: int) -> None:
        """Add a body of the compiled model, with its joints."""
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
        """Add a massless link between two joints of a body."""
        name = free_name(f"{body}_{made_name(joint.name)}", [*self.robot.links, *self.names])
        self.robot.links[name] = Link(name, place)
        return name

    def joint(self, k: int) -> RobotJoint:
        model, name = self.model, self.joint_names[k]
        place = self.place("joint", name, k)
        type_ = int(model.jnt_type[k])
        joint = RobotJoint(name, place, _TYPES[type_], "", "")
        if type_ in (_SLIDE, _HINGE):
            joint.axes = (direction(model.jnt_axis[k]),)
        dof, q = int(model.jnt_dofadr[k]), int(model.jnt_qposadr[k])
        end = dof + {_FREE: 6, _BALL: 3}.get(type_, 1)
        single = type_ in (_SLIDE, _HINGE)
        damping = 0.0 if self.disabled("DAMPER") else self.damper(joint, dof, single)
        spring = (0.0, 0.0) if self.disabled("SPRING") else self.spring(joint, k, q, single)
        joint.laws = (Law(damping, *spring),)
        self.robot.give_armature(joint, model.dof_armature[dof:end], place)
        if np.any(model.dof_frictionloss[dof:end]) and not self.disabled("FRICTIONLOSS", "CONSTRAINT"):
            self.robot.leave_out("frictionloss of a joint", place, Effect.DIFFERS, "dry friction")
        if model.jnt_limited[k] and not self.disabled("LIMIT", "CONSTRAINT"):
            self.robot.leave_out("range of a joint", place, Effect.STOPS)
        return joint

    def damper(self, joint: RobotJoint, dof: int, single: bool) -> float:
        """Damping of a joint; 0 if it is a polynomial in the speed, which becomes a force term."""
        damping, more = float(self.model.dof_damping[dof]), row(self.model, "dof_dampingpoly", dof)
        if not np.any(more):
            return damping
        if single:
            self.robot.terms.append(
                JointTerm(joint.name, text := damper_law(damping, more, "u.{}"), (joint.name,) * text.count("{}"))
            )
        else:
            self.robot.leave_out(
                f"damping of a {joint.type} joint by powers of its motion", joint.place, Effect.DIFFERS
            )
        return 0.0

    def spring(self, joint: RobotJoint, k: int, q: int, single: bool) -> tuple[float, float]:
        """Stiffness and rest position of the spring of a joint; 0 if it is a polynomial, which becomes a force term."""
        model = self.model
        stiffness, more = float(np.ravel(model.jnt_stiffness[k])[0]), row(model, "jnt_stiffnesspoly", k)
        if not stiffness and not np.any(more):
            return 0.0, 0.0
        if not single:
            self.robot.leave_out(f"stiffness of a {joint.type} joint", joint.place, Effect.DIFFERS)
            return 0.0, 0.0
        rest = float(model.qpos_spring[q] - model.qpos0[q])
        if np.any(more):
            text = spring_law(stiffness, more, terms_of([(1.0, "q.{}")], -rest))
            self.robot.terms.append(JointTerm(joint.name, text, (joint.name,) * text.count("{}")))
        if np.any(row(model, "jnt_springyield", k)):
            self.robot.leave_out("springyield of a joint", joint.place, Effect.DIFFERS, "here the spring is elastic")
        return (0.0, 0.0) if np.any(more) else (stiffness, rest)

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
                _ELLIPSOID: ("ellipsoid", tuple(float(x) for x in size)),
            }
            frame = _frame(model.geom_pos[g], model.geom_quat[g])
            shown, color = int(model.geom_group[g]) < _HIDDEN, self.color(g)
            if type_ in sizes:
                found.append(Solid(*sizes[type_], frame, shown, color))
            elif type_ == _MESH and shown and (file := self.mesh_file(mesh := int(model.geom_dataid[g]))):
                own = _frame(model.mesh_pos[mesh], model.mesh_quat[mesh])  # MuJoCo moves a mesh to its principal axes
                scale = tuple(float(x) for x in model.mesh_scale[mesh])
                found.append(Solid("mesh", scale, frame @ own.inverse(), True, color, file))
        return found

    def color(self, g: int) -> str:
        """Colour of a geom: its own colour, or that of its material if the geom has MuJoCo's default colour."""
        rgba, material = self.model.geom_rgba[g], int(self.model.geom_matid[g])
        if material >= 0 and np.allclose(rgba, _GREY):
            rgba = self.model.mat_rgba[material]
        return hex_color(" ".join(map(str, rgba)))

    def mesh_file(self, mesh: int) -> str:
        """Path of the file of a mesh; ``""`` if there is none."""
        start = int(self.model.mesh_pathadr[mesh])
        if start < 0 or self.parts is None:
            return ""
        name = self.model.paths[start:].split(b"\0")[0].decode("utf-8", "replace")
        folder = Path(self.file).parent
        found = [folder / name] + [folder / d / name for key in _MESH_FOLDERS for d in sorted(self.parts.folders[key])]
        return next((str(path) for path in found if path.is_file()), "")

    def equality(self, e: int) -> None:
        """Add a constraint: a loop, or a coordinate that follows another."""
        model = self.model
        type_, data = int(model.eq_type[e]), model.eq_data[e]
        name = model.equality(e).name or free_name(f"equality_{e}", [c.name for c in self.robot.closings])
        place = self.place("equality", model.equality(e).name, e)
        ids = int(model.eq_obj1id[e]), int(model.eq_obj2id[e])
        if not model.eq_active0[e] or self.disabled("EQUALITY", "CONSTRAINT"):
            self.robot.leave_out("equality that is not active", place, Effect.NONE)
        elif type_ == _JOINT:
            self.coupled(name, place, ids, data)
        elif type_ not in (_CONNECT, _WELD):
            self.robot.leave_out("equality of tendons or flexible bodies", place, Effect.DIFFERS)
        else:
            self.robot.leave_out("softness of <equality>", place, Effect.DIFFERS, _SOFT)
            if int(model.eq_objtype[e]) == _SITE:
                bodies = tuple(int(model.site_bodyid[i]) for i in ids)
                first, second = (_frame(model.site_pos[i], model.site_quat[i]) for i in ids)
            elif type_ == _CONNECT:
                bodies = ids
                first, second = Placement(data[0:3]), Placement(data[3:6])
            else:
                bodies = ids
                first, second = _frame(data[3:6], data[6:10]), Placement(data[0:3])
            is_point = type_ == _CONNECT or data[10] == 0  # data[10] is the torquescale of a weld
            if is_point:
                first, second = Placement(first.at), Placement(second.at)
            ends = [(self.links[b], self.origin(b) @ f) for b, f in zip(bodies, (first, second), strict=True)]
            self.robot.closings.append(
                Closing(made_name(name), place, "point" if is_point else "fixed", ends[0], ends[1])
            )

    def coupled(self, name: str, place: Place, joints: tuple[int, int], data: Any) -> None:
        first, second = joints
        unreadable, of = "", self.joint_names[second] if second >= 0 else ""
        if second < 0 and np.any(data[1:5]):
            unreadable = "is held at a value by an equality"
        elif np.any(data[2:5]):
            coefficients = " ".join(f"{v:g}" for v in data[:5])
            unreadable = f"follows {shortened(of)} by a polynomial of degree above 1, polycoef {coefficients}"
        self.robot.leave_out("softness of <equality>", place, Effect.DIFFERS, _SOFT)
        own = self.joint_names[first]
        if second < 0:
            self.robot.locked[own] = float(data[0])
        else:
            self.robot.couplings.append(Coupling(name, place, own, of, float(data[1]), float(data[0]), unreadable))

    def begin(self) -> None:
        """Sets the initial state to that of a keyframe."""
        model, count = self.model, int(self.model.nkey)
        names = [model.key(i).name for i in range(count)]
        if self.key == "" or (self.key is None and not count):
            k = -1
        elif self.key is None:
            k = 0
        elif self.key in names:
            k = names.index(self.key)
        else:
            shown = ", ".join(filter(None, names[:12])) or "none with a name"
            message = f"--key {self.key} is not a keyframe; keyframes are {shown}{nearest(self.key, names)}"
            self.problems.append(Place(self.file).problem(message))
            return
        for i in range(count):
            if i != k:
                place = self.place("keyframe", names[i], i)
                self.robot.leave_out("<key>", place, Effect.NONE, "--key NAME begins in it")
        if k >= 0:
            called = f"keyframe {names[k]}" if names[k] else "first keyframe"
            self.robot.notes.append(f"Initial state: {called}.")
            for j in range(int(model.njnt)):
                self.begin_joint(j, model.key_qpos[k], model.key_qvel[k])
            self.leave_out_of_key(k, self.place("keyframe", names[k], k))

    def leave_out_of_key(self, k: int, place: Place) -> None:
        """Lists values of a keyframe that have no state in the model: those of actuators and mocap bodies."""
        model, leave_out = self.model, self.robot.leave_out
        if model.key_act[k].any():
            leave_out("act of the <key>", place, Effect.DIFFERS, "actuators have no activation here")
        if model.key_ctrl[k].any():
            leave_out("ctrl of the <key>", place, Effect.DRIVEN, "there are no controls here")
        for body in range(int(model.nbody)):
            i = int(model.body_mocapid[body])
            own = [*model.body_pos[body], *model.body_quat[body]]
            if i >= 0 and [*model.key_mpos[k][3 * i : 3 * i + 3], *model.key_mquat[k][4 * i : 4 * i + 4]] != own:
                leave_out("mpos, mquat of the <key>", place, Effect.DIFFERS, "mocap bodies are placed as <body> says")

    def begin_joint(self, j: int, qpos: Any, qvel: Any) -> None:
        model, joint = self.model, self.robot.joints[self.joint_names[j]]
        type_, q, v = int(model.jnt_type[j]), int(model.jnt_qposadr[j]), int(model.jnt_dofadr[j])
        if type_ in (_SLIDE, _HINGE):
            joint.start = (float(qpos[q] - model.qpos0[q]),)
            self.robot.speeds[joint.name] = (float(qvel[v]),)
            return
        at = [float(x) for x in qpos[q : q + 3]] if type_ == _FREE else []
        e = np.array(qpos[q + len(at) : q + len(at) + 4], dtype=float)
        size = float(np.linalg.norm(e))
        e = e / size if size > 0 else np.array([1.0, 0.0, 0.0, 0.0])
        joint.start = (*at, *(float(x) for x in e))
        speeds = [float(x) for x in qvel[v : v + (6 if type_ == _FREE else 3)]]
        if type_ == _FREE:
            turned = of_quaternion(*joint.start[3:]).T @ np.array(speeds[:3])
            speeds = [*speeds[3:], *(float(x) for x in turned)]
        self.robot.speeds[joint.name] = tuple(speeds)

    def leave_out(self) -> None:
        """Lists parts of the compiled model that the model format cannot express, each with its lines in the files."""
        model, robot = self.model, self.robot
        seen: set[str] = set()
        for count, (tag, group, remark, effect) in _LISTED.items():
            total = int(getattr(model, count, 0))
            if not total or tag in seen:
                continue
            seen.add(tag)
            found = self.lines(tag, group)
            for place in found or [None] * total:
                robot.leave_out(f"<{tag}>", place, effect, remark)
        meshes = [g for g in range(int(model.ngeom)) if int(model.geom_type[g]) == _MESH]
        if any(not self.mesh_file(int(model.geom_dataid[g])) for g in meshes):
            found = [place_of(e) for e in self.elements("geom") if e.attributes.get("type") == "mesh"]
            places: list[Place | None] = [*found]
            for place in places or [None] * len(meshes):
                robot.leave_out("<geom> of a mesh", place, Effect.NONE, "its mass is counted")
        collides = np.any(model.geom_contype) and np.any(model.geom_conaffinity)
        if collides and not self.disabled("CONTACT", "CONSTRAINT"):
            geoms: list[Place | None] = [place_of(element) for element in self.elements("geom", "flexcomp")]
            for place in geoms or [None]:
                robot.leave_out("contacts of geoms", place, Effect.STOPS)
        is_passive = not (self.disabled("SPRING") and self.disabled("DAMPER"))  # both off: no passive forces act
        for name in _MEDIUM if is_passive else ():
            if np.any(getattr(model.opt, name)):
                said = [place_of(element) for element in self.elements("option") if name in element.attributes]
                robot.leave_out(f"{name} of the medium", said[-1] if said else None, Effect.DIFFERS)
        for b in range(1, int(model.nbody)):
            if model.body_gravcomp[b] and is_passive:
                robot.lifted[self.links[b]] = float(model.body_gravcomp[b])
        for mocap in np.flatnonzero(np.ravel(model.body_mocapid) >= 0):
            robot.leave_out(
                "mocap of bodies", self.place("body", self.names[int(mocap)]), Effect.NONE, "they are fixed"
            )

    def elements(self, *tags: str) -> Iterator[Element]:
        """All elements with the given tags in all files, except elements in defaults."""
        return iter(()) if self.parts is None else (e for e in self.parts.used() if e.tag in tags)

    def lines(self, tag: str, group: str) -> list[Place | None]:
        """The places of all elements of a tag, or of all children of `group`."""
        if group:
            return [place_of(child) for element in self.elements(group) for child in element.children]
        also = {"flex": ("flex", "flexcomp")}.get(tag, (tag,))
        return [place_of(element) for element in self.elements(*also)]


def _frame(at: Any, quaternion: Any) -> Placement:
    return Placement(at, of_quaternion(*map(float, quaternion)))
