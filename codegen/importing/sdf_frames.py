"""Where the frames of an SDF stand, and of which links they are part.

A pose is relative to the model, a joint's to its child, or to what ``relative_to`` names; a frame is part of what
``attached_to`` names, a model of its canonical link.
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
    """Finds frames by their names.

    Parameters
    ----------
    values : Values
        Reads numbers, and gathers what is wrong.
    """

    def __init__(self, values: Values) -> None:
        self.values = values
        self.placed: dict[tuple[int, str], Placement | None] = {}
        self.attached: dict[tuple[int, str], str | None] = {}

    def pose(self, element: Element | None) -> Placement:
        """The numbers of a <pose>."""
        if element is None or not element.text.strip():
            return Placement()
        values = self.values
        format_ = element.attributes.get("rotation_format", "euler_rpy").strip()
        in_degrees = is_true(element.attributes.get("degrees", ""))
        if format_ == "quat_xyzw":
            if in_degrees:
                values.wrong(element, "degrees of a quaternion; leave degrees out, or write angles")
            seven = values.content(element, 7, (0, 0, 0, 0, 0, 0, 1))
            x, y, z, w = seven[3:]
            return Placement(seven[:3], values.quaternion(element, (w, x, y, z)))
        if format_ != "euler_rpy":
            values.wrong(element, f"rotation_format {shortened(format_)}; euler_rpy or quat_xyzw is allowed")
        six = values.content(element, 6, (0,) * 6)
        rpy = [math.radians(a) for a in six[3:]] if in_degrees else six[3:]
        return Placement(six[:3], rpy=values.angles(rpy))

    def relative_to(
        self, scope: Scope, home: Scope, pose: Element | None, asked: Element, otherwise: str = ""
    ) -> Placement:
        """The frame that a pose is relative to, in that of a scope."""
        name = pose.attributes.get("relative_to", "").strip() if pose is not None else ""
        return self.of(scope, home, name or otherwise, pose if pose is not None else asked)

    def of(self, scope: Scope, home: Scope, name: str, asked: Element) -> Placement:
        """The frame that a name means for what stands in `home`, in the frame of the scope of names."""
        if name in ("", "__model__"):
            return self.of_model(home) if home.is_merged else Placement()
        return self.named(scope, name, asked)

    def named(self, scope: Scope, name: str, asked: Element) -> Placement:
        """A frame by its name in a scope, in the frame of that scope."""
        if name in ("", "__model__"):
            return Placement()
        if name in _ROOTS:
            return self.absolute(scope).inverse()
        first, _, rest = name.partition("::")
        if first in scope.models:
            model = scope.models[first]
            return self.of_model(model) @ self.named(model, rest, asked)
        item = scope.items.get(name)
        if item is None:
            self.values.unknown(asked, "frame", name, scope.known())
            return Placement()
        return self.once(scope, name, asked, lambda: self.of_item(scope, item))

    def once(self, scope: Scope, name: str, asked: Element, make: object) -> Placement:
        """What `make` gives, computed one time; a problem where it needs itself."""
        assert callable(make)
        key = (id(scope), name)
        if key in self.placed:
            found = self.placed[key]
            if found is None:
                message = (
                    f"frame {shortened(name)} is relative to itself by way of others; one must be relative to the model"
                )
                self.values.wrong(asked, message)
                return Placement()
            return found
        self.placed[key] = None
        result: Placement = make()
        self.placed[key] = result
        return result

    def of_item(self, scope: Scope, item: Item) -> Placement:
        """The frame of a link, a joint or a frame, in that of its scope."""
        element = item.element
        pose, otherwise = element.first("pose"), ""
        if element.tag == "joint":
            child = element.first("child")
            otherwise = child.text.strip() if child is not None else ""
        elif element.tag == "frame":
            otherwise = element.attributes.get("attached_to", "").strip()
        return self.relative_to(scope, item.home, pose, element, otherwise) @ self.pose(pose)

    def of_model(self, model: Scope) -> Placement:
        """The frame of a model in that of the scope in which its name is."""
        if model.parent is None or model.home is None:
            return Placement()
        parent, home = model.parent, model.home
        asked = model.pose if model.pose is not None else model.element

        def found() -> Placement:
            at = self.relative_to(parent, home, model.pose, model.element) @ self.pose(model.pose)
            if not model.placement_frame:
                return at
            if model.is_merged:  # its names are those of the parent: find the frame as if the model stood in its origin
                alone = Frames(self.values)
                alone.placed[id(parent), f"::{id(model)}"] = Placement()
                return at @ alone.named(parent, model.placement_frame, model.element).inverse()
            return at @ self.named(model, model.placement_frame, model.element).inverse()

        return self.once(parent, f"::{id(model)}", asked, found)

    def absolute(self, scope: Scope) -> Placement:
        """The frame of a scope in that of the world."""
        return Placement() if scope.parent is None else self.absolute(scope.parent) @ self.of_model(scope)

    # ---- links ---------------------------------------------------------------------------------------------------------

    def link(self, scope: Scope, home: Scope, name: str, asked: Element) -> str | None:
        """The link, by its name in the scope, that a frame is part of, or `WORLD`; None after a problem."""
        if name == "world":
            return WORLD
        if name in ("", "__model__"):
            if scope.is_world:
                return WORLD
            return self.canonical(home if home.is_merged else scope, asked)
        first, _, rest = name.partition("::")
        if first in scope.models:
            model = scope.models[first]
            inner = self.link(model, model, rest, asked)
            return f"{first}::{inner}" if inner else inner
        item = scope.items.get(name)
        if item is None:
            self.values.unknown(asked, "link or frame", name, scope.known())
            return None
        if item.element.tag == "link":
            return name
        key = (id(scope), name)
        if key in self.attached:
            if self.attached[key] is None:
                message = f"frame {shortened(name)} is attached to itself by way of others; attach one to a link"
                self.values.wrong(asked, message)
            return self.attached[key]
        self.attached[key] = None
        if item.element.tag == "joint":
            child = item.element.first("child")
            to = child.text.strip() if child is not None else ""
        else:
            to = item.element.attributes.get("attached_to", "").strip()
        self.attached[key] = self.link(scope, item.home, to, item.element)
        return self.attached[key]

    def canonical(self, model: Scope, asked: Element) -> str | None:
        """The link that the frame of a model is part of: the one it names, else its first one."""
        names = model.parent if model.is_merged and model.parent is not None else model
        said = model.element.attributes.get("canonical_link", "").strip()
        if said:
            return self.link(names, model, said, model.element)
        for name, item in names.items.items():
            if item.element.tag == "link" and (item.home is model or not model.is_merged):
                return name
        for name, inner in names.models.items():
            if inner.home is model or not model.is_merged:
                found = self.canonical(inner, asked)
                if found is not None:
                    return f"{name}::{found}"
        self.values.wrong(
            asked, f"model {shortened(model.name)} has no link, of which its frame could be part; name a link"
        )
        return None


class PartReader:
    """Reads some elements of an SDF.

    Parameters
    ----------
    reader : RobotReader
    frames : Frames
    """

    def __init__(self, reader: RobotReader, frames: Frames) -> None:
        self.reader = reader
        self.frames = frames
