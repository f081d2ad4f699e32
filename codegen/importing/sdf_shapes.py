"""Shapes of an SDF, and the mass properties that ``<inertial auto="true">`` computes from them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from ..model.positions import shortened
from .placement import Placement
from .robot import Inertia, Solid
from .sdf_frames import PartReader
from .sdf_scopes import Item, Scope
from .solids import of_density
from .xml_reading import Element
from .xml_values import RobotReader, Sizes

_WATER: Final = 1000.0
"""SDF's default density, kg/m^3."""


class ShapeReader(PartReader):
    """Reads the shapes in <visual> and <collision>."""

    def solid(self, scope: Scope, item: Item, element: Element) -> Solid | None:
        """The primitive solid of an element in its link; other shapes are listed as left out."""
        self.reader.leave_out_children(element, ("pose", "geometry", "material", "density", "auto_inertia_params"))
        frame = self.frame(scope, item, self.reader.one(element, "pose"))
        return self.reader.primitive(element, frame, _SIZES, "uri", _scale)

    def frame(self, scope: Scope, item: Item, pose: Element | None) -> Placement:
        """A pose in the frame of a link; a <pose> with ``relative_to`` is converted to this frame."""
        own = self.frames.pose(pose)
        if pose is None or not pose.attributes.get("relative_to", "").strip():
            return own
        link = self.frames.named(scope, item.name, item.element)
        return link.inverse() @ self.frames.relative_to(scope, item.home, pose, item.element) @ own

    def of_collisions(self, inertial: Element, collisions: Sequence[tuple[Element, Solid | None]]) -> Inertia:
        """Mass properties of all collision shapes of a link, from their densities."""
        reader, total = self.reader, Inertia()
        wanted = "write <mass> and <inertia>, without auto"
        if not collisions:
            reader.wrong(inertial, f'<inertial auto="true"> of a link without <collision>; {wanted}')
        whole = self.density(inertial, _WATER)
        for element, solid in collisions:
            if solid is None:
                geometry = element.first("geometry")
                kinds = [child.tag for child in geometry.children] if geometry is not None else []
                kind = shortened(kinds[0]) if kinds else "no geometry"
                message = f'<inertial auto="true"> in line {inertial.line} with a collision of {kind}'
                reader.wrong(element, f"{message}; {', '.join(_SIZES)} are read: {wanted}")
            elif min(solid.sizes) > 0:
                total = total + of_density(solid, self.density(element, whole))
            else:
                reader.wrong(
                    element, "the geometry has a size that is not above zero, so it has no mass; a mass is needed here"
                )
        mass = inertial.first("mass")
        if mass is None or total.mass <= 0:
            return total
        given = reader.content(mass, 1, (total.mass,))[0]
        if given <= 0:
            reader.wrong(mass, f"the mass is {given:g}; more than 0 kg is needed")
            return total
        return Inertia(given, total.com, total.matrix * (given / total.mass))

    def density(self, element: Element, otherwise: float) -> float:
        """The density of an element, kg/m^3."""
        found = element.first("density")
        value = self.reader.content(found, 1, (otherwise,))[0]
        if value <= 0 and found is not None:
            self.reader.wrong(found, f"the density is {value:g}; more than 0 kg/m^3 is needed")
            return otherwise
        return value


def _scale(reader: RobotReader, element: Element) -> tuple[float, ...]:
    return reader.content(element.first("scale"), 3, (1, 1, 1))


def _texts(*tags: str) -> Sizes:
    return lambda reader, element: tuple(reader.content(element.first(tag), 1, (1.0,))[0] for tag in tags)


_SIZES: Final[dict[str, Sizes]] = {
    "box": lambda reader, element: reader.content(element.first("size"), 3, (1, 1, 1)),
    "cylinder": _texts("radius", "length"),
    "capsule": _texts("radius", "length"),
    "sphere": _texts("radius"),
    "cone": _texts("radius", "length"),
    "ellipsoid": lambda reader, element: reader.content(element.first("radii"), 3, (1, 1, 1)),
}
