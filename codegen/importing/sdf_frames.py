"""Poses of the frames of an SDF, and the links that they belong to.

A pose is relative to the frame that ``relative_to`` names; by default to the model, or for a joint to its child. A
frame belongs to the link that ``attached_to`` names; a model's frame belongs to its canonical link.
"""

from __future__ import annotations

import math

from ..model.positions import shortened
from .placement import Placement
from .robot import WORLD
from .sdf_scopes import Item, Scope
from .xml_reading import Element
from .xml_values import RobotReader, Values, is_true

_ROOTS = ("world", "__root__")


class Frames:
    """Finds the frames of an SDF by name.

    Parameters
    ----------
    values : Values
        Reads numbers, and collects the errors.
    """

    def __init__(self, values: Values) -> None:
        self.values = values
        self.placed: dict[tuple[int, str], Placement | None] = {}
        self.attached: dict[tuple[int, str], str | None] = {}

    def pose(self, element: Element | None) -> Placement:
        """The pose that a <pose> element describes."""
        if element is None or not element.text.strip():
            return Placement()
        values = self.values
        format_ = element.attributes.get("rotation_format", "euler_rpy").strip()
        in_degrees = is_true(element.attributes.get("degrees", ""))
        if format_ == "quat_xyzw":
            if in_degrees:
                values.wrong(element, "a quaternion in degrees; remove degrees, or write angles")
            seven = values.content(element, 7, (0, 0, 0, 0, 0, 0, 1))
            x, y, z, w = seven[3:]
            return Placement(seven[:3], values.quaternion(element, (w, x, y, z)))
        if format_ != "euler_rpy":
            values.wrong(element, f"rotation_format {shortened(format_)} is unknown; euler_rpy or quat_xyzw is allowed")
        six = values.content(element, 6, (0,) * 6)
        rpy = [math.radians(a) for a in six[3:]] if in_degrees else six[3:]
        return Placement(six[:3], rpy=values.angles(rpy))

    def relative_to(
        self, scope: Scope, home: Scope, pose: Element | None, user: Element, otherwise: str = ""
    ) -> Placement:
        """The pose, in a scope, of the frame to which a <pose> is relative."""
        name = pose.attributes.get("relative_to", "").strip() if pose is not None else ""
        return self.of(scope, home, name or otherwise, pose if pose is not None else user)

    def of(self, scope: Scope, home: Scope, name: str, user: Element) -> Placement:
        """Pose of a named frame in a scope of names; `home` is the scope of the element that uses the name."""
        if name in ("", "__model__"):
            return self.of_model(home) if home.is_merged else Placement()
        return self.named(scope, name, user)

    def named(self, scope: Scope, name: str, user: Element) -> Placement:
        """Pose of a named frame of a scope, in the frame of that scope."""
        if name in ("", "__model__"):
            return Placement()
        if name in _ROOTS:
            return self.absolute(scope).inverse()
        first, _, rest = name.partition("::")
        if first in scope.models:
            model = scope.models[first]
            return self.of_model(model) @ self.named(model, rest, user)
        item = scope.items.get(name)
        if item is None:
            self.values.unknown(user, "frame", name, scope.known())
            return Placement()
        return self.once(scope, name, user, lambda: self.of_item(scope, item))

    def once(self, scope: Scope, name: str, user: Element, make: object) -> Placement:
        """The result of `make`, computed once; an error if the result depends on itself."""
        assert callable(make)
        key = (id(scope), name)
        if key in self.placed:
            found = self.placed[key]
            if found is None:
                message = f"frame {shortened(name)} depends on itself through others; one must be relative to the model"
                self.values.wrong(user, message)
                return Placement()
            return found
        self.placed[key] = None
        result: Placement = make()
        self.placed[key] = result
        return result

    def of_item(self, scope: Scope, item: Item) -> Placement:
        """Pose of a link, joint or frame in its scope."""
        element = item.element
        pose, otherwise = element.first("pose"), ""
        if element.tag == "joint":
            child = element.first("child")
            otherwise = child.text.strip() if child is not None else ""
        elif element.tag == "frame":
            otherwise = element.attributes.get("attached_to", "").strip()
        return self.relative_to(scope, item.home, pose, element, otherwise) @ self.pose(pose)

    def of_model(self, model: Scope) -> Placement:
        """Pose of a model in the scope that contains its name."""
        if model.parent is None or model.home is None:
            return Placement()
        parent, home = model.parent, model.home
        user = model.pose if model.pose is not None else model.element

        def found() -> Placement:
            at = self.relative_to(parent, home, model.pose, model.element) @ self.pose(model.pose)
            if not model.placement_frame:
                return at
            if model.is_merged:  # find the frame as if the merged model were at the parent's origin
                alone = Frames(self.values)
                alone.placed[id(parent), f"::{id(model)}"] = Placement()
                return at @ alone.named(parent, model.placement_frame, model.element).inverse()
            return at @ self.named(model, model.placement_frame, model.element).inverse()

        return self.once(parent, f"::{id(model)}", user, found)

    def absolute(self, scope: Scope) -> Placement:
        """Pose of a scope's frame in the world."""
        return Placement() if scope.parent is None else self.absolute(scope.parent) @ self.of_model(scope)

    # ---- links ---------------------------------------------------------------------------------------------------------

    def link(self, scope: Scope, home: Scope, name: str, user: Element) -> str | None:
        """The link that a frame belongs to, by its name in the scope, or `WORLD`; None after an error."""
        if name == "world":
            return WORLD
        if name in ("", "__model__"):
            if scope.is_world:
                return WORLD
            return self.canonical(home if home.is_merged else scope, user)
        first, _, rest = name.partition("::")
        if first in scope.models:
            model = scope.models[first]
            inner = self.link(model, model, rest, user)
            return f"{first}::{inner}" if inner else inner
        item = scope.items.get(name)
        if item is None:
            self.values.unknown(user, "link or frame", name, scope.known())
            return None
        if item.element.tag == "link":
            return name
        key = (id(scope), name)
        if key in self.attached:
            if self.attached[key] is None:
                message = f"frame {shortened(name)} is attached to itself through others; attach one to a link"
                self.values.wrong(user, message)
            return self.attached[key]
        self.attached[key] = None
        if item.element.tag == "joint":
            child = item.element.first("child")
            to = child.text.strip() if child is not None else ""
        else:
            to = item.element.attributes.get("attached_to", "").strip()
        self.attached[key] = self.link(scope, item.home, to, item.element)
        return self.attached[key]

    def canonical(self, model: Scope, user: Element) -> str | None:
        """The link that a model's frame belongs to: its canonical link, otherwise its first link."""
        names = model.parent if model.is_merged and model.parent is not None else model
        said = model.element.attributes.get("canonical_link", "").strip()
        if said:
            return self.link(names, model, said, model.element)
        for name, item in names.items.items():
            if item.element.tag == "link" and (item.home is model or not model.is_merged):
                return name
        for name, inner in names.models.items():
            if inner.home is model or not model.is_merged:
                found = self.canonical(inner, user)
                if found is not None:
                    return f"{name}::{found}"
        self.values.wrong(
            user, f"model {shortened(model.name)} has no link to which its frame could belong; name a link"
        )
        return None


class PartReader:
    """Base class of readers for some elements of an SDF.

    Parameters
    ----------
    reader : RobotReader
    frames : Frames
    """

    def __init__(self, reader: RobotReader, frames: Frames) -> None:
        self.reader = reader
        self.frames = frames
