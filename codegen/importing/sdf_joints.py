"""Joints of an SDF as written: their links, their axes, and the forces in them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from ..model.positions import shortened
from .robot import WORLD, Coupling, Effect, Law
from .sdf_frames import PartReader
from .sdf_scopes import Item, Scope
from .xml_reading import Element
from .xml_values import place_of

TYPES: Final = {
    "revolute": "revolute", "continuous": "revolute", "prismatic": "prismatic", "ball": "spherical", "universal": "universal",
    "fixed": "fixed", "screw": "screw",
}  # fmt: skip
GEARBOX: Final = "gearbox"
_JOINT: Final = {
    "pose", "parent", "child", "axis", "axis2", "thread_pitch", "screw_thread_pitch", "gearbox_ratio", "gearbox_reference_body",
    "drake:rotor_inertia", "drake:gear_ratio", "drake:mimic",
}  # fmt: skip
_REMARKS: Final = {
    "limit": ("limits of position, speed and force", Effect.STOPS), "physics": ("settings of a simulator", Effect.NONE),
    "sensor": ("sensors", Effect.NONE), "drake:controller_gains": ("controllers", Effect.DRIVEN),
    "initial_position": ("the model begins at 0", Effect.NONE),
}  # fmt: skip


@dataclass(frozen=True, slots=True)
class SdfJoint:
    """An SDF joint as read.

    Attributes
    ----------
    name : str
        The joint's name, with the names of the models that contain the joint.
    scope : Scope
        The scope of its name.
    item : Item
    path : str
        Path of the scope within what is read: ``arm::``, or empty.
    type : str
        A type of the model format, or ``gearbox``.
    parent, child : str
        Full names of the links, or `WORLD`.
    axes : tuple of Element
    pitch, armature : float
    laws : tuple of Law
        The law of each axis.
    cut : str
        For a joint outside the robot's model: prefix of the robot's names there; inside, they lack it. Otherwise empty.
    """

    name: str
    scope: Scope
    item: Item
    path: str
    type: str
    parent: str
    child: str
    axes: tuple[Element, ...] = ()
    pitch: float = 0.0
    laws: tuple[Law, ...] = ()
    armature: float = 0.0
    cut: str = ""

    @property
    def element(self) -> Element:
        """The XML element of the joint."""
        return self.item.element


class JointReader(PartReader):
    """Reads the joints of an SDF."""

    def read(self, scope: Scope, item: Item, path: str, cut: str) -> SdfJoint | None:
        """The joint of an item; None after an error.

        Parameters
        ----------
        scope : Scope
            The scope of its name.
        item : Item
        path : str
            Path of the scope.
        cut : str
            Prefix of the robot's names in this scope that is removed, see `SdfJoint.cut`.
        """
        reader, element = self.reader, item.element
        reader.leave_out_children(element, _JOINT, _REMARKS)
        what = f"joint {shortened(item.name)}"
        type_ = reader.type_of(element, what, [*TYPES, GEARBOX])
        ends = self.ends(scope, item, path, cut, what)
        if len(ends) < 2 or type_ is None:
            return None
        first, last = ends
        if first == last:
            reader.wrong(element, f"{what} joins link {shortened(first or 'world')} to itself; two links are needed")
            return None
        if type_ == GEARBOX:
            return SdfJoint(path + item.name, scope, item, path, GEARBOX, first, last, cut=cut)
        axes = self.axes(element, type_, what)
        laws = tuple(map(self.law, axes))
        pitch = self.pitch(element) if type_ == "screw" else 0.0
        joint = SdfJoint(
            path + item.name, scope, item, path, TYPES[type_], first, last, axes, pitch, laws, self.rotor(element), cut
        )
        self.mimic(joint)
        return joint

    def ends(self, scope: Scope, item: Item, path: str, cut: str, what: str) -> list[str]:
        """The links of <parent> and <child>, which may name frames; fewer than two after an error."""
        ends = []
        for tag in ("parent", "child"):
            end = self.reader.one(item.element, tag)
            if end is None:
                self.reader.wrong(item.element, f"{what} has no {tag}; <{tag}>LINK</{tag}> is needed")
                continue
            link = self.frames.link(scope, item.home, end.text.strip(), end)
            if link is not None:
                ends.append((path + link).removeprefix(cut) if link != WORLD else WORLD)
        return ends

    def axes(self, element: Element, type_: str, what: str) -> tuple[Element, ...]:
        """The axes that a joint of this type has."""
        reader = self.reader
        tags = {"universal": ("axis", "axis2"), "ball": (), "fixed": ()}.get(type_, ("axis",))
        for tag in ("axis", "axis2"):
            if tag not in tags and (more := element.first(tag)) is not None:
                reader.robot.leave_out(f"<{tag}> of a {type_} joint", place_of(more), Effect.NONE)
        found = [reader.one(element, tag) for tag in tags]
        for axis in found:
            if axis is None:
                needed = "<axis><xyz>0 0 1</xyz></axis>" + (" and <axis2>" if type_ == "universal" else "")
                reader.wrong(element, f"{what} of type {type_} lacks an axis; {needed} is needed")
                continue
            reader.leave_out_children(axis, ("xyz", "use_parent_model_frame", "dynamics", "mimic"), _REMARKS)
            if not any(reader.content(axis.first("xyz"), 3, (0, 0, 1))):
                reader.wrong(axis, "the axis is 0 0 0, which has no direction; write one such as <xyz>0 0 1</xyz>")
        return tuple(axis for axis in found if axis is not None)

    def pitch(self, element: Element) -> float:
        """Pitch of a screw: ``screw_thread_pitch`` is in m per turn, ``thread_pitch`` in rad/m with opposite sign."""
        pitch, old = element.first("screw_thread_pitch"), element.first("thread_pitch")
        if pitch is not None or old is None:
            return self.reader.content(pitch, 1, (1.0,))[0] / (2 * math.pi)
        value = self.reader.content(old, 1, (0,))[0]
        if value == 0:
            self.reader.wrong(old, "thread_pitch is 0; a nonzero number in rad/m is needed")
        return -1.0 / value if value else 0.0

    def law(self, axis: Element) -> Law:
        """The spring and damper that the <dynamics> of an axis describes."""
        values, element = {}, axis.first("dynamics")
        for child in element.children if element is not None else ():
            if child.tag in ("damping", "friction", "spring_reference", "spring_stiffness"):
                values[child.tag] = self.reader.content(child, 1, (0,))[0]
            else:
                self.reader.leave_out(child, _REMARKS)
        if values.get("friction") and element is not None:
            where, what = place_of(element), "dry friction of joints"
            self.reader.robot.leave_out("<friction> of <dynamics>", where, Effect.DIFFERS, what)
        stiffness = values.get("spring_stiffness", 0.0)
        return Law(values.get("damping", 0.0), stiffness, values.get("spring_reference", 0.0) if stiffness else 0.0)

    def rotor(self, element: Element) -> float:
        """The reflected inertia of a rotor, from elements of Drake."""
        inertia, ratio = (element.first(f"drake:{word}") for word in ("rotor_inertia", "gear_ratio"))
        if inertia is None:
            return 0.0
        axis = element.first("axis")
        limit = axis.first("limit") if axis is not None else None
        effort = limit.first("effort") if limit is not None else None
        if effort is not None and self.reader.content(effort, 1, (1.0,))[0] == 0:
            what = "a joint of effort 0 has no motor in Drake"
            self.reader.robot.leave_out("<drake:rotor_inertia>", place_of(inertia), Effect.NONE, what)
            return 0.0
        n = self.reader.content(ratio, 1, (1.0,))[0]
        value = self.reader.content(inertia, 1, (0.0,))[0]
        if value < 0:
            self.reader.wrong(inertia, f"the inertia of a rotor is {value:g}; it must not be negative")
        return value * n * n

    def mimic(self, joint: SdfJoint) -> None:
        """Add a joint whose coordinate follows another one: q = multiplier (q_other - reference) + offset."""
        reader = self.reader
        for axis in joint.axes:
            element = axis.first("mimic")
            if element is None:
                continue
            other = reader.name(element, "joint")
            numbers = [
                reader.content(element.first(tag), 1, (default,))[0]
                for tag, default in (("multiplier", 1.0), ("offset", 0.0), ("reference", 0.0))
            ]
            ratio, offset, reference = numbers
            second = element.attributes.get("axis", "axis").strip() == "axis2"
            unreadable = "follows the second axis of another joint" if second or axis is not joint.axes[0] else ""
            self.follow(
                joint, element, other, ratio, offset - ratio * reference if ratio * reference else offset, unreadable
            )
        drakes = joint.element.first("drake:mimic")
        if drakes is not None:
            other = reader.name(drakes, "joint")
            ratio, offset = reader.number(drakes, "multiplier", 1.0), reader.number(drakes, "offset")
            self.follow(joint, drakes, other, ratio, offset, "")

    def follow(
        self, joint: SdfJoint, element: Element, other: str | None, ratio: float, offset: float, unreadable: str
    ) -> None:
        if other is not None:
            place, name = place_of(element), joint.name
            self.reader.robot.couplings.append(
                Coupling(name, place, name, (joint.path + other).removeprefix(joint.cut), ratio, offset, unreadable)
            )
