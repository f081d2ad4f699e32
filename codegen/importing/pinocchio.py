"""Import of a `pinocchio.Model`: its joints, placements and inertias."""

from __future__ import annotations

from typing import Any, Final, NamedTuple

import numpy as np

from ..model import ModelError
from ..model.errors import Problem
from ..model.joints import JOINTS
from .naming import free_name
from .placement import Array, Placement, Three
from .robot import WORLD, Coupling, Effect, Inertia, Law, Link, Place, Robot, RobotJoint, as_three

_FILE: Final = "pinocchio.Model"
_NOTHING: Final = 1e-200
"""Magnitude below which entries count as zero, since Pinocchio leaves some entries uninitialised."""
_BASE: Final[dict[str, Three]] = {"X": (1.0, 0.0, 0.0), "Y": (0.0, 1.0, 0.0), "Z": (0.0, 0.0, 1.0)}
_OTHER_SPEEDS: Final = ("free", "planar")
"""Joint types whose speeds have another order or another direction in Pinocchio than in the model format."""


class _Step(NamedTuple):
    """One of the model-format joints that replace a Pinocchio joint, relative to the previous joint."""

    frame: Placement
    type: str
    axes: tuple[Three, ...] = ()
    pitch: float = 0.0


def read_pinocchio(model: Any) -> Robot:
    """The robot of a `pinocchio.Model`; body frames become points.

    Raises
    ------
    ModelError
        If the model format lacks a joint type.
    """
    try:
        import pinocchio
    except ImportError as error:
        raise ImportError(f"Pinocchio is not installed ({error}); pip install pin") from None
    if not isinstance(model, pinocchio.Model):
        raise TypeError(f"from_pinocchio takes a pinocchio.Model, not {type(model).__name__}")
    return _Reader(model).read()


class _Reader:
    def __init__(self, model: Any) -> None:
        self.model = model
        self.robot = Robot(str(model.name) or "robot", _FILE, as_three(model.gravity.linear))
        self.problems: list[Problem] = []
        self.links = [WORLD]

    def read(self) -> Robot:
        model, place = self.model, Place(_FILE)
        bodies = self.bodies()
        for i in range(1, model.njoints):
            joint, name = model.joints[i], str(model.names[i])
            steps = self.steps(joint, name)
            link = free_name(bodies.get(i, name), self.robot.links)
            above = self.links[model.parents[i]]
            frame = _placement(model.jointPlacements[i])
            self.links.append(link)
            own_joints = []
            for k, step in enumerate(steps):
                last = k == len(steps) - 1
                child = link if last else free_name(f"{link}_{k + 1}", self.robot.links)
                self.robot.links[child] = Link(child, place)
                own = name if len(steps) == 1 else f"{name}.{k + 1}"
                self.robot.joints[own] = RobotJoint(
                    own, place, step.type, above, child, frame @ step.frame, step.axes, step.pitch
                )
                own_joints.append(self.robot.joints[own])
                above, frame = child, Placement()
            inertia = model.inertias[i]
            self.robot.links[link].inertia = Inertia(
                float(inertia.mass), as_three(inertia.lever), np.array(inertia.inertia, dtype=float)
            )
            self.strengths(i, own_joints)
        self.frames()
        if self.problems:
            raise ModelError(self.problems)
        return self.robot

    def bodies(self) -> dict[int, str]:
        """Names of bodies whose frames coincide with frames of joints."""
        found: dict[int, str] = {}
        for frame in self.model.frames:
            if _is_body(frame) and _placement(frame.placement).is_identity:
                found.setdefault(int(frame.parentJoint), str(frame.name))
        return found

    def frames(self) -> None:
        """Add the remaining body frames, as massless links."""
        for frame in self.model.frames:
            name, parent = str(frame.name), int(frame.parentJoint)
            if _is_body(frame) and parent and name not in self.robot.links:
                self.robot.links[name] = Link(name, Place(_FILE))
                self.robot.joints[f" {name}"] = RobotJoint(
                    "", Place(_FILE), "fixed", self.links[parent], name, _placement(frame.placement)
                )

    def strengths(self, i: int, joints: list[RobotJoint]) -> None:
        """Add damping, and the reflected inertia (Pinocchio's `armature`) of each speed."""
        model = self.model
        at, end = int(model.idx_vs[i]), int(model.idx_vs[i]) + int(model.nvs[i])
        damping, armature = (np.array(values[at:end], dtype=float) for values in (model.damping, model.armature))
        friction = getattr(model, "upperDryFrictionLimit", getattr(model, "friction", np.zeros(0)))
        if np.any(friction[at:end]):
            self.robot.leave_out("dry friction of joints", None, Effect.DIFFERS)
        reflected = np.array(model.rotorInertia[at:end]) * np.array(model.rotorGearRatio[at:end]) ** 2
        if np.any(reflected[armature == 0]):
            remark = "armature is rotorInertia*rotorGearRatio**2"
            self.robot.leave_out("rotorInertia without armature", None, Effect.NONE, remark)
        place = 0
        for joint in joints:
            own = slice(place, place := place + len(JOINTS[joint.type].speeds))
            if joint.type in _OTHER_SPEEDS and len(set(damping[own])) > 1:
                self.robot.leave_out(
                    f"damping that differs between the degrees of freedom of a {joint.type} joint", None, Effect.DIFFERS
                )
            else:
                joint.give_laws([Law(float(d)) for d in damping[own]])
            if joint.type == "planar" and np.any(armature[own]):
                remark = "along axes that rotate with the body"
                self.robot.leave_out("armature of a planar joint", None, Effect.DIFFERS, remark)
            else:
                self.robot.give_armature(joint, armature[own].tolist())

    def steps(self, joint: Any, name: str) -> list[_Step]:
        """The model-format joints that are equivalent to a Pinocchio joint."""
        inner = joint.extract() if hasattr(joint, "extract") else joint  # has the attributes of the joint's type
        kind, here = joint.shortname().removeprefix("JointModel"), Placement()
        if kind == "Composite":
            parts = zip(inner.joints, inner.jointPlacements, strict=True)
            found = []
            for part, placement in parts:
                first, *rest = self.steps(part, name)
                found += [first._replace(frame=_placement(placement) @ first.frame), *rest]
            return found
        if kind == "Mimic":
            return self.mimic(joint, inner, name)
        whole = {
            "FreeFlyer": ["free"], "Spherical": ["spherical"],
            "Planar": ["planar:Z"], "Translation": ["prismatic:X", "prismatic:Y", "prismatic:Z"],
            "SphericalZYX": ["revolute:Z", "revolute:Y", "revolute:X"],
        }  # fmt: skip
        if kind in whole:
            return [_Step(here, t.partition(":")[0], _axes(t.partition(":")[2])) for t in whole[kind]]
        if kind == "Universal":
            return [_Step(here, "universal", (as_three(inner.axis1), as_three(inner.axis2)))]
        if joint.nv == 1:  # these joints are revolute, prismatic or helical
            (column,) = _columns(joint)
            along, about = column[:3], column[3:]
            if not np.any(about):
                return [_Step(here, "prismatic", (as_three(along),))]
            pitch = float(getattr(inner, "pitch", along @ about))
            return [_Step(here, "screw" if pitch else "revolute", (as_three(about),), pitch)]
        self.problems.append(Problem(_FILE, None, None, name, f"joint type {kind} does not exist in the model format"))
        return [_Step(here, "fixed")]

    def mimic(self, joint: Any, inner: Any, name: str) -> list[_Step]:
        """A joint whose coordinate follows the coordinate of another joint."""
        other = self.model.mimicked_joints[list(self.model.mimicking_joints).index(joint.id)]
        (motion,) = _columns(joint, int(self.model.nqs[other])) / inner.scaling
        of = str(self.model.names[other])
        self.robot.couplings.append(Coupling(name, Place(_FILE), name, of, float(inner.scaling), float(inner.offset)))
        turns = bool(np.any(motion[3:]))
        return [
            _Step(Placement(), "revolute" if turns else "prismatic", (as_three(motion[3:] if turns else motion[:3]),))
        ]


def _is_body(frame: Any) -> bool:
    import pinocchio

    return bool(frame.type == pinocchio.FrameType.BODY)


def _axes(letter: str) -> tuple[Three, ...]:
    return (_BASE[letter],) if letter else ()


def _columns(joint: Any, nq: int | None = None) -> Array:
    """Partial velocities (nv, 6) at zero coordinates, linear components first."""
    data, q = joint.createData(), np.zeros(joint.nq if nq is None else nq)
    if len(q) == 2 and joint.nv < 2:
        q[0] = 1.0  # q is the cosine and sine of the angle
    joint.calc(data, q)
    columns = np.array(data.S, dtype=float).reshape(6, -1).T
    return np.where(np.abs(columns) < _NOTHING, 0.0, columns)


def _placement(placement: Any) -> Placement:
    return Placement(placement.translation, np.array(placement.rotation, dtype=float))
