"""Writes the text of a model file as a person would."""

from __future__ import annotations

import json
import os
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Final

import numpy as np

from .bodies import Bodies, ImportedBody
from .naming import free_name, made_name
from .parameters import Parameters
from .placement import Placement, Three
from .robot import WORLD, Closing, Link, Place, Robot, Solid
from .solids import moments
from .words import WIDTH, angle, axis_text, number, one_line, vector, wrapped

_AGREES: Final = 1e-9
"""Relative tolerance within which the mass properties of a shape agree with those of the file."""
SHAPES: Final = ("box", "cylinder", "capsule", "sphere")
"""Types of solids that the model format has as shapes."""
_COORDINATES: Final = {
    "cylindrical": ("1", "2"), "planar": ("1", "2", "3"), "universal": ("1", "2"),
    "spherical": ("wx", "wy", "wz"), "free": ("wx", "wy", "wz", "vx", "vy", "vz"),
}  # fmt: skip
"""Suffixes of the speed names of joints with several degrees of freedom."""


class ModelWriter:
    """Writes the text of a model.

    Parameters
    ----------
    robot : Robot
    bodies : Bodies
    name : str
        Name of the model.
    names : dict of str to str
        Names of the links in the model.
    parameters : Parameters
    head : sequence of str
        Lines of the comment at the top.
    sections : dict of str to sequence of str
        Lines of sections that are made elsewhere.
    motors : bool
        Whether every degree of freedom of a joint, except those of the base, has an input.
    folder : str
        Folder that names of mesh files start from.
    """

    def __init__(
        self,
        robot: Robot,
        bodies: Bodies,
        name: str,
        names: Mapping[str, str],
        parameters: Parameters,
        head: Sequence[str] = (),
        sections: Mapping[str, Sequence[str]] | None = None,
        motors: bool = False,
        folder: str = ".",
    ) -> None:
        self.robot = robot
        self.bodies = bodies
        self.name = name
        self.names = {**names, WORLD: "ground"}
        self.parameters = parameters
        self.head = head
        self.sections = dict(sections or {})
        self.motors = motors
        self.folder = folder
        self.mark_names: dict[str, str] = {}

    def text(self) -> str:
        """The text of the whole file."""
        bodies = [line for body in self.bodies.all.values() for line in self.body(body)]  # this adds parameters
        scenery = Link(WORLD, Place(self.robot.file), solids=self.robot.scenery)
        points = self.points()
        inputs, forces = self.forces()
        parts: list[tuple[str, Sequence[str]]] = [
            ("parameters", self.parameters.lines()),
            ("inputs", inputs),
            ("bodies", bodies),
            ("visuals", self.visuals([(scenery, Placement()), *self.bodies.grounded])),
            ("points", points),
            ("loops", [line for closing in self.robot.closings for line in self.closing(closing)]),
            ("couplings", self.couplings()),
            (
                "motion",
                [f"{self.names[self.robot.joints[j].child]}: {number(v)}" for j, v in self.robot.locked.items()],
            ),
            ("forces", forces),
            ("initial", self.initial()),
        ]
        lines = [*(f"# {line}".rstrip() for line in self.head), f"model: {self.name}"]
        if any(self.robot.gravity):
            lines.append(f"gravity: {vector(self.robot.gravity)}")
        known = dict(parts)
        for key in (*known, *(k for k in self.sections if k not in known)):
            own = () if key == "initial" and key in self.sections else known.get(key, ())
            content = [*own, *self.sections.get(key, ())]
            inline = f"{key}: [{', '.join(line[2:] for line in content)}]"
            if content and all(line.startswith("- ") for line in content) and len(inline) <= WIDTH:
                lines += ["", inline]
            elif content:
                lines += ["", f"{key}:", *(f"  {line}" if line else "" for line in content)]
        return "\n".join(lines) + "\n"

    def body(self, body: ImportedBody) -> list[str]:
        """The lines of a body in the model file."""
        joint, words = body.joint, body.words
        keys = [f"type: {joint.type}", *_axis_keys(joint.type, joint.axes)]
        if joint.pitch:
            keys.append(f"pitch: {number(joint.pitch)}")
        parent = self.bodies.all.get(body.parent)
        name = self.names[body.link.name]
        if rotors := self.parameters.armature(name, joint, words):
            keys.append(f"armature: {rotors[0] if len(rotors) == 1 else '[' + ', '.join(rotors) + ']'}")
        at = self.parameters.at(name, body.frame.at, words, parent)
        keys += _place_keys(body.frame, at)
        title = f"{name}:" + (f"  # {one_line(body.link.name)}" if body.link.name != name else "")
        lines = [title, f"  parent: {self.names[body.parent]}", f"  joint: {{{', '.join(keys)}}}"]
        if joint.name and joint.name not in (name, body.link.name):
            lines[-1] += f"  # {one_line(joint.name)}"
        lines += [f"  # {part}" for comment in body.comments for part in wrapped(comment, WIDTH - 6)]
        mass = self.mass(body, name)
        visuals = [] if _is_shown_by_shape(body, mass) else self.visuals([(body.link, Placement()), *body.merged])
        return lines + [f"  {line}" for line in (*mass, *(["visuals:"] if visuals else []), *visuals)]

    def visuals(self, links: Iterable[tuple[Link, Placement]]) -> list[str]:
        """Lines of the visuals of links that are placed in one body."""
        return [f"- {{{', '.join(self.visual(s))}}}" for link, frame in links for s in link.visible(frame)]

    def visual(self, solid: Solid) -> list[str]:
        """The keys of a visual."""
        keys = [f"type: {solid.type}"]
        if solid.type == "mesh":
            keys.append(f"file: {json.dumps(os.path.relpath(solid.file, self.folder).replace(os.sep, '/'))}")
            if any(x != 1 for x in solid.sizes):
                same = len(set(solid.sizes)) == 1
                keys.append(f"scale: {number(solid.sizes[0]) if same else vector(solid.sizes)}")
        elif solid.type in ("box", "ellipsoid"):
            keys.append(f"{'size' if solid.type == 'box' else 'radii'}: {vector(solid.sizes)}")
        else:
            keys.append(f"radius: {number(solid.sizes[0])}")
            keys += [f"length: {number(x)}" for x in solid.sizes[1:]]
        color = [f'color: "{solid.color}"'] if solid.color else []
        return [*keys, *_place_keys(solid.frame), *color]

    def mass(self, body: ImportedBody, name: str) -> list[str]:
        """Mass, com and inertia of a body, or an equivalent shape."""
        mass, com, matrix = body.inertia.mass, body.inertia.com, body.inertia.matrix
        shape = None if body.words & {"mass", "com", "inertia"} else shape_of(body)
        if shape is not None:
            return [f"shape: {shape}"]
        lines = []
        if mass or "mass" in body.words:
            lines.append(f"mass: {self.parameters.mass(name, mass, body.words)}")
        if any(com) or "com" in body.words:
            lines.append(f"com: {self.parameters.com(name, com, body.words)}")
        entries = {"xx": (0, 0), "yy": (1, 1), "zz": (2, 2), "xy": (0, 1), "xz": (0, 2), "yz": (1, 2)}
        six = {key: float(matrix[place]) for key, place in entries.items()}
        written = self.parameters.inertia(name, six, body.words)
        if body.tolerated:
            written["check"] = "warn"
        if any(six.values()) or "inertia" in body.words:
            lines.append(f"inertia: {{{', '.join(f'{k}: {v}' for k, v in written.items())}}}")
        return lines

    def points(self) -> list[str]:
        """Lines of the points: first links that are not bodies, with their rotation in a comment; then marks."""
        lines = []
        every = self.bodies.merged_frames()
        for link, holder, own in every:
            if holder != WORLD or not own.is_identity:
                name = self.names[link]
                remarks = [one_line(link)] if link != name else []
                remarks += [f"turned by rpy [{', '.join(map(angle, own.rpy))}]"] if own.is_turned else []
                lines.append(self.point(name, holder, own.at, ", ".join(remarks)))
        used = set(self.names.values())
        for mark in self.robot.marks:
            holder, place = self.bodies.holders[mark.link]
            name = self.mark_names[mark.name] = free_name(made_name(mark.name), used)
            used.add(name)
            lines.append(
                self.point(name, holder, place.point(mark.at), one_line(mark.name) if mark.name != name else "")
            )
        return lines

    def point(self, name: str, holder: str, at: Three, remark: str) -> str:
        """The line of a point in the model file."""
        place = f", at: {vector(at)}" if any(at) else ""
        return f"{name}: {{body: {self.names[holder]}{place}}}" + (f"  # {remark}" if remark else "")

    def closing(self, closing: Closing) -> list[str]:
        """The lines of a loop in the model file."""
        keys = [f"type: {closing.type}", *_axis_keys(closing.type, closing.axes)]
        lines = [f"{closing.name}:", f"  joint: {{{', '.join(keys)}}}"]
        for key, (link, frame) in (("from", closing.start), ("to", closing.end)):
            holder, place = self.bodies.holders[link]
            face = place @ frame
            lines.append(f"  {key}: {{{', '.join([f'body: {self.names[holder]}', *_place_keys(face)])}}}")
        return lines

    def couplings(self) -> list[str]:
        """The lines of the couplings in the model file."""
        lines: list[str] = []
        used = {*self.names.values(), *(closing.name for closing in self.robot.closings)}
        for coupling in self.robot.couplings:
            joint, other = (self.robot.joints[name] for name in (coupling.joint, coupling.of))
            own, followed = self.names[joint.child], self.names[other.child]
            name = free_name(made_name(coupling.name) if coupling.name != coupling.joint else f"{own}_mimic", used)
            used.add(name)
            ratio = "" if coupling.ratio == 1 else number(coupling.ratio)
            keys = [f"joint: {own}", f"follows: {{{followed}: {ratio}}}" if ratio else f"follows: {followed}"]
            if coupling.offset:
                keys.append(
                    f"offset: {number(coupling.offset) if joint.type == 'prismatic' else angle(coupling.offset)}"
                )
            lines.append(f"{name}: {{{', '.join(keys)}}}")
        return lines

    def forces(self) -> tuple[list[str], list[str]]:
        """Lines of the inputs, and of the forces in joints: dampers, springs, motors."""
        inputs, forces = [], []
        named: dict[str, str] = {}
        further: dict[str, list[str]] = {}
        for term in self.robot.terms:
            coordinates = [self.names[self.robot.joints[of].child] for of in term.of]
            further.setdefault(self.robot.joints[term.joint].child, []).append(term.text.format(*coordinates))
        for link, body in self.bodies.all.items():
            joint, name = body.joint, self.names[link]
            if joint.type == "fixed":
                continue
            freedoms = [f"{name}.{part}" for part in _COORDINATES.get(joint.type, ())] or [name]
            motors = [f"tau_{f.replace('.', '_')}" for f in freedoms] if self.motors and body.joint.name else []
            inputs += [f"- {motor}" for motor in motors]
            values = []
            damping = self.parameters.damping(name, joint, body.words)
            for k, freedom in enumerate(freedoms):
                terms, law = motors[k : k + 1], joint.law(k)
                if law.stiffness:
                    q = f"q.{freedom}"
                    if law.rest:
                        q = f"({q} {'-' if law.rest > 0 else '+'} {angle(abs(law.rest))})"
                    terms.append(_times(-law.stiffness, q))
                if damping:
                    terms.append(f"-{damping[min(k, len(damping) - 1)]}*u.{freedom}")
                elif law.damping:
                    terms.append(_times(-law.damping, f"u.{freedom}"))
                terms += further.get(link, ())
                values.append(" + ".join(terms).replace("+ -", "- "))
            if any(values):
                named[name] = name
                forces.append(f"{name}: {{type: joint, joint: {name}, value: {_listed(values)}}}")
        for force in self.robot.forces:
            name = free_name(made_name(force.name), named)
            named[name] = name
            forces.append(f"{name}: {{{force.text.format(*(self.mark_names[m] for m in force.at))}}}")
        return inputs, forces

    def initial(self) -> list[str]:
        """The lines of the initial coordinates and speeds."""
        q, u = [], []
        for link, body in self.bodies.all.items():
            if body.joint.name in self.robot.locked:
                continue
            start, speeds = body.joint.start, self.robot.speeds.get(body.joint.name, ())
            if any(start) and not (len(start) > 3 and start == _unit(len(start))):
                q.append(f"{self.names[link]}: {_listed([angle(v) if len(start) == 1 else number(v) for v in start])}")
            if any(speeds) and body.joint.type != "fixed":
                u.append(f"{self.names[link]}: {_listed([number(v) for v in speeds])}")
        return [f"{key}: {{{', '.join(entries)}}}" for key, entries in (("q", q), ("u", u)) if entries]


def _listed(values: Sequence[str]) -> str:
    """One value, or a list; a value with a comma is quoted."""
    if len(values) == 1:
        return f'"{values[0]}"' if "," in values[0] else values[0]
    return f"[{', '.join(_listed([value or '0']) for value in values)}]"


def _times(factor: float, what: str) -> str:
    """The text of a product, such as ``-2*x`` or ``-x``."""
    return what if factor == 1 else f"-{what}" if factor == -1 else f"{number(factor)}*{what}"


def _unit(count: int) -> tuple[float, ...]:
    """Initial coordinates of a free or spherical joint in its reference pose."""
    return tuple(1.0 if k == count - 4 else 0.0 for k in range(count))


def _axis_keys(type_: str, axes: Sequence[Three]) -> list[str]:
    if not axes:
        return []
    if len(axes) == 1:
        return [f"{'normal' if type_ == 'planar' else 'axis'}: {axis_text(axes[0])}"]
    return [f"axes: [{', '.join(map(axis_text, axes))}]"]


def _place_keys(frame: Placement, at: str | None = None) -> list[str]:
    keys = []
    if at or any(frame.at):
        keys.append(f"at: {at or vector(frame.at)}")
    if frame.is_turned:
        keys.append(f"rpy: [{', '.join(map(angle, frame.rpy))}]")
    return keys


def _is_shown_by_shape(body: ImportedBody, mass: Sequence[str]) -> bool:
    """Whether the only visual of a body is its shape, which `mass` contains."""
    every = [s for link in (body.link, *(link for link, _ in body.merged)) for s in link.visible(Placement())]
    is_shape = bool(mass) and mass[0].startswith("shape:")
    return is_shape and len(every) == 1 and every[0].type in SHAPES and not every[0].color


def shape_of(body: ImportedBody) -> str | None:
    """Entry of the primitive solid that has a body's mass properties; None if there is none."""
    inertia = body.inertia
    if inertia.mass <= 0:
        return None
    for solid in body.link.solids:
        if _agrees(solid, inertia.mass, inertia.com, inertia.matrix):
            return _shape_entry(solid, inertia.mass, inertia.com)
    return None


def _agrees(solid: Solid, mass: float, com: Three, matrix: Any) -> bool:
    """Whether a homogeneous solid with the body's mass has the body's mass properties."""
    if solid.type not in SHAPES or min(solid.sizes) <= 0 or (solid.type == "box" and _box_axes(solid.frame) is None):
        return False
    own = mass * np.diag(moments(solid))
    turned = solid.frame.rotation @ own @ solid.frame.rotation.T
    largest = max(solid.sizes)
    return bool(
        np.abs(turned - matrix).max() <= _AGREES * np.abs(matrix).max()
        and np.abs(np.subtract(solid.frame.at, com)).max() <= _AGREES * largest
    )


def _box_axes(frame: Placement) -> list[int] | None:
    """The edge of a box along each axis of the body; None if the box is not aligned with the axes."""
    size = np.abs(frame.rotation)
    return [int(i) for i in np.argmax(size, axis=1)] if np.all((size == 0) | (size == 1)) else None


def _shape_entry(solid: Solid, mass: float, com: Three) -> str:
    keys = [f"type: {solid.type}"]
    if solid.type == "box":
        order = _box_axes(solid.frame)
        assert order is not None
        keys.append(f"size: {vector(solid.sizes[i] for i in order)}")
    elif solid.type == "sphere":
        keys.append(f"radius: {number(solid.sizes[0])}")
    else:
        x, y, z = (abs(v) if abs(v) == 1 else v for v in solid.frame.vector((0, 0, 1)))
        keys += [
            f"axis: {axis_text((x, y, z))}",
            f"length: {number(solid.sizes[1])}",
            f"radius: {number(solid.sizes[0])}",
        ]
    keys.append(f"mass: {number(mass)}")
    if any(com):
        keys.append(f"center: {vector(com)}")
    return f"{{{', '.join(keys)}}}"
