"""Gepetto's ``robot.yaml`` beside a URDF: frames that are held together, and new types of some joints.

``closed_loop`` lists pairs of frames. ``type`` is 3D (their origins coincide) or 6D (the frames coincide) for each
pair. ``joint_name`` and ``joint_type`` turn revolute joints into spherical, universal and fixed ones, since URDF lacks
some of these types.
"""

from __future__ import annotations

import os
import re
from itertools import permutations
from pathlib import Path
from typing import Any, Final

from ..model import ModelError
from ..model.errors import Problem, nearest
from ..model.positions import Document, compose, read_file, shortened
from .naming import made_name
from .placement import Placement, Three
from .robot import Closing, Effect, Place, Robot

BESIDE: Final = "robot.yaml"
KEYS: Final = ("closed_loop", "type", "joint_name", "joint_type", "name_mot")
_OWN: Final = re.compile(r"\b(closed_loop|joint_type|name_mot)\b")
"""Keys that occur only in files of Gepetto."""
_AXES: Final[dict[str, Three]] = {"X": (1.0, 0.0, 0.0), "Y": (0.0, 1.0, 0.0), "Z": (0.0, 0.0, 1.0)}
JOINTS: Final[dict[str, tuple[str, tuple[Three, ...]]]] = {
    "SPHERICAL": ("spherical", ()), "FIXED": ("fixed", ()), "CARDAN": ("universal", (_AXES["X"], _AXES["Y"])),
    **{f"UJOINT_{a}{b}": ("universal", (_AXES[a], _AXES[b])) for a, b in permutations("XYZ", 2)},
}  # fmt: skip
"""Gepetto's joint types as joints of the model format, with axes in the joint's frame."""
LOOPS: Final = {"3D": "point", "6D": "fixed"}


def beside(urdf: str) -> str | None:
    """The path of ``robot.yaml`` in the folder of a URDF, if the file is in Gepetto's format."""
    path = Path(urdf).parent / BESIDE
    return str(path) if path.is_file() and is_gepettos(path) else None


def is_gepettos(path: str | os.PathLike[str]) -> bool:
    """Whether a file is in Gepetto's format, and not a side file in the model format."""
    try:
        text = read_file(os.fspath(path))
        if _OWN.search(text) is None:  # a search avoids the slow parsing of a long model file
            return False
        root = compose(text, os.fspath(path)).root
    except ModelError:
        return False
    return isinstance(root, dict) and any(key in root for key in ("closed_loop", "joint_type", "name_mot"))


def apply_gepetto(robot: Robot, path: str | os.PathLike[str]) -> None:
    """Add loops and change joint types as the file specifies.

    Raises
    ------
    ModelError
        If the file has errors. The exception lists all of them.
    """
    file = os.fspath(path)
    _Reader(robot, compose(read_file(file), file)).read()


class _Reader:
    def __init__(self, robot: Robot, document: Document) -> None:
        self.robot = robot
        self.document = document
        self.problems: list[Problem] = list(document.problems)

    def read(self) -> None:
        root = self.document.root
        for key in root:
            if key == "name_mot":
                self.robot.leave_out("name_mot", self.place(key), Effect.DRIVEN, "--motors makes inputs of all joints")
            elif key not in KEYS:
                self.robot.leave_out(f"key {shortened(str(key))}", self.place(key), Effect.UNKNOWN)
        names, types = self.strings("joint_name"), self.strings("joint_type")
        if self.as_many("joint_type", types, "joint_name", names):
            seen: set[str] = set()
            for k, (name, type_) in enumerate(zip(names, types, strict=True)):
                if name in seen:
                    self.wrong(f"joint {shortened(name)} is listed twice; list each joint once", "joint_name", k)
                seen.add(name)
                self.joint(k, name, type_)
        pairs = root.get("closed_loop") or []
        kinds = self.strings("type") if "type" in root else ["6D"] * len(pairs)
        if not isinstance(pairs, list):
            self.wrong("a list of pairs of frames is needed, such as [[foot_a, foot_b]]", "closed_loop")
        elif self.as_many("type", kinds, "closed_loop", pairs):
            for k, (pair, kind) in enumerate(zip(pairs, kinds, strict=True)):
                self.loop(k, pair, kind)
        if self.problems:
            raise ModelError(self.problems)

    def place(self, *path: Any) -> Place:
        line, column = self.document.place(self.document.root, path)
        return Place(self.document.file, line, column)

    def wrong(self, message: str, *path: Any) -> None:
        self.problems.append(self.place(*path).problem(message))

    def strings(self, key: str) -> list[str]:
        value = self.document.root.get(key) or []
        if isinstance(value, list) and all(isinstance(v, str) for v in value):
            return value
        self.wrong(f"{key} is not a list of names; write a list such as [left, right]", key)
        return []

    def as_many(self, key: str, values: list[Any], other: str, others: list[Any]) -> bool:
        """Whether two lists have equal lengths; an error is reported if not."""
        if len(values) == len(others):
            return True
        if key in self.document.root:
            self.wrong(f"{key} has {len(values)} entries and {other} has {len(others)}; the numbers must agree", key)
        else:
            self.wrong(f"{other} has {len(others)} entries, and there is no {key}; both lists are needed", other)
        return False

    def joint(self, k: int, name: str, type_: str) -> None:
        joint = self.robot.joints.get(name)
        if joint is None:
            known = list(self.robot.joints)
            message = f"joint {shortened(name)} is not in the URDF, so its type is not changed{nearest(name, known)}"
            self.robot.warnings.append(self.place("joint_name", k).problem(message, "warning"))
        elif type_ not in JOINTS:
            hint = nearest(type_, JOINTS)
            self.wrong(f"joint_type {shortened(type_)} is not one of {', '.join(JOINTS)}{hint}", "joint_type", k)
        else:
            if not joint.is_passive:
                self.robot.leave_out("<dynamics> of a joint whose type is changed", joint.place, Effect.DIFFERS)
            joint.type, joint.axes = JOINTS[type_]
            joint.laws, joint.armature = (), ()

    def loop(self, k: int, pair: Any, kind: str) -> None:
        if not isinstance(pair, list) or len(pair) != 2 or not all(isinstance(name, str) for name in pair):
            self.wrong("two frames of the URDF are needed, such as [foot_a, foot_b]", "closed_loop", k)
            return
        if kind.upper() not in LOOPS:
            self.wrong(f"type {shortened(kind)} is unknown; {' or '.join(LOOPS)} is allowed", "type", k)
            return
        links = [self.link(name, k, i) for i, name in enumerate(pair)]
        if None in links:
            return
        first, second = (link for link in links if link is not None)
        place = self.place("closed_loop", k)
        name = made_name("_".join(pair))
        ends = (first, Placement()), (second, Placement())
        self.robot.closings.append(Closing(name, place, LOOPS[kind.upper()], *ends))

    def link(self, name: str, k: int, i: int) -> str | None:
        """The link of a frame that is named after the link, or after the joint that carries the link."""
        if name in self.robot.links:
            return name
        joint = self.robot.joints.get(name)
        if joint is not None:
            return joint.child
        known = [*self.robot.links, *self.robot.joints]
        self.wrong(
            f"frame {shortened(name)} is not a link or joint of the URDF{nearest(name, known)}", "closed_loop", k, i
        )
        return None
