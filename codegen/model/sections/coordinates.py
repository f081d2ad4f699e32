"""Coordinates that entries name: single coordinates, or all coordinates of a joint by the joint's name."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any, NamedTuple

from ..errors import nearest
from ..joints import JointType
from ..model import joint_coordinates
from ..parts import Instance
from ..positions import Path_
from ..reading import Reader
from ..unknown_names import some
from .bodies import BodySection


class JointOf(NamedTuple):
    """The type, coordinates and speeds of a body's joint, and the body's index."""

    kind: type[JointType]
    coordinates: tuple[str, ...]
    speeds: tuple[str, ...]
    body: int


class Joints(dict[str, JointOf]):
    """The joints of all bodies that have no errors, by name."""

    def __init__(self, bodies: BodySection) -> None:
        super().__init__(
            (name, JointOf(type(spec.joint), *joint_coordinates(name, spec.joint.type), i))
            for i, (spec, name) in enumerate(zip(bodies.specs, bodies.names, strict=True))
            if spec is not None
        )

    def owner(self, name: str) -> str:
        """The joint with this name, or with a coordinate of this name."""
        return name if name in self else name.rpartition(".")[0]

    def named(
        self, reader: Reader, at: Instance, sub: Path_, name: str, what: str, key: bool = False
    ) -> tuple[str, JointOf] | None:
        """The joint that has the named coordinate, or the named joint; an error is reported if it has a quaternion.

        Parameters
        ----------
        name : str
            Name of the coordinate, or of the joint.
        what : str
            The use of the coordinates, for messages: ``coupled``.
        key : bool
            Whether the name is the key at the path, and not the value.

        Returns
        -------
        (str, JointOf) or None
            None after an error.
        """
        joint = self.owner(name)
        if name.partition(".")[0] in reader.broken:
            return None
        if joint not in self or (name != joint and name not in self[joint].coordinates):

            def unknown() -> str:
                groups = ((j, x.coordinates) for j, x in self.items() if x.coordinates and not x.kind.quaternions)
                return unknown_name(reader, "joint or coordinate", name, (n for j, of in groups for n in (j, *of)))

            reader.report(at, sub, unknown, key=key)
            return None
        kind, coordinates, *_ = self[joint]
        if coordinates and not kind.quaternions:
            return joint, self[joint]
        if not coordinates:
            message = f"joint {joint!r} is {kind.name} and has no coordinate to be {what}; leave it out"
        else:
            message = (
                f"the {kind.name} joint {joint!r} has a quaternion, which cannot be {what}; replace the joint by several with "
                f"single coordinates, with massless bodies between them: prismatic, revolute, universal or planar ones"
            )
        reader.report(at, sub, message, key=key)
        return None


def unknown_name(reader: Reader, what: str, name: str, known: Iterable[str]) -> str:
    """Message about an unknown name, with the known names."""
    listed = list(dict.fromkeys(known))
    hint = reader.loop_hint(name) or nearest(name, listed)
    return f"unknown {what} {name!r}; allowed are {some(listed)}{hint}"


def values_of(value: Any) -> Iterator[tuple[Path_, Any]]:
    """A single value, or the values of a list, each with its path."""
    if isinstance(value, (list, tuple)):
        yield from (((i,), v) for i, v in enumerate(value))
    else:
        yield (), value
