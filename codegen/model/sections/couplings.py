"""Couplings of coordinates: gears, belts, racks, mimic joints, differentials."""

from __future__ import annotations

from pydantic_core import PydanticCustomError

from ..entries import parse_name
from ..errors import nearest
from ..expressions import Expression
from ..joints import JointType
from ..model import Coupling, Term, coupling, joint_coordinates
from ..parts import Instance
from ..positions import Path_
from ..reading import Reader
from ..schema import CouplingEntry
from ..unknown_names import some
from .bodies import BodySection

Joints = dict[str, tuple[type[JointType], tuple[str, ...], int]]
"""Of every joint the type, the coordinates and the body's number."""


def read_couplings(reader: Reader, bodies: BodySection) -> list[Coupling]:
    """Read the couplings; each determines a coordinate of its own."""
    joints: Joints = {
        name: (type(spec.joint), joint_coordinates(name, spec.joint.type)[0], i)
        for i, (spec, name) in enumerate(zip(bodies.specs, bodies.names, strict=True))
        if spec is not None
    }
    owner: dict[str, str] = {}
    found = []
    for at, name, spec in reader.entries("couplings", CouplingEntry, "coupling", "body"):
        if spec is None or not reader.is_whole(spec):
            continue
        before = reader.errors
        own = _coordinate(reader, at, ("joint",), spec.joint, joints)
        if own is not None and own in owner:
            message = (
                f"{own!r} follows others by coupling {owner[own]!r} already; a coordinate is determined once: take one of the "
                f"two couplings away, or let this one determine another of its coordinates"
            )
            reader.report(at, ("joint",), message)
        if own is not None and f"q.{own}" in reader.prescribed:
            message = (
                f"{own!r} is prescribed under `motion`, so it cannot follow; let the other coordinate follow it, or take it "
                f"from `motion`"
            )
            reader.report(at, ("joint",), message)
        terms = [] if own is None else [_term(own, joints, Expression.number(1))]
        if own is not None and name is not None:
            owner.setdefault(own, name)
        _read_followed(reader, at, spec, own, joints, terms)
        offset = reader.bound(spec.offset, at, ("offset",), "parameters")
        if isinstance(why := reader.value(offset), str):
            reader.report(at, ("offset",), f"{offset} has no finite value at the default parameters: {why}")
        if name is not None and reader.errors == before:
            found.append(coupling(name, tuple(terms), offset))
    return found


def _read_followed(
    reader: Reader, at: Instance, spec: CouplingEntry, own: str | None, joints: Joints, terms: list[Term]
) -> None:
    """Add the coordinates that are followed, with minus their ratios."""
    if not spec.follows:
        reader.report(at, ("follows",), "nothing to follow; give coordinates with their ratios: {crank: -z1/z2}")
    seen: set[str] = set()
    for key, ratio in spec.follows.items():
        # a name alone stands for a ratio of 1
        sub: Path_ = ("follows", key) if isinstance(at.value.get("follows"), dict) else ("follows",)
        try:
            reference = Expression(parse_name(key, prefix="q."))
        except PydanticCustomError as error:
            reader.report(at, sub, str(error.message()))
            continue
        other = _coordinate(reader, at, sub, reference, joints)
        errors = reader.errors
        value = reader.bound(ratio, at, sub, "parameters")
        if other is None or reader.errors > errors:
            continue
        if other == own or other in seen:
            twice = "follows itself" if other == own else "stands here twice"
            reader.report(at, sub, f"{other!r} {twice}; a coupling relates different coordinates, each given once")
            continue
        seen.add(other)
        number = reader.value(value)
        if isinstance(number, str):
            reader.report(at, sub, f"{value} has no finite value at the default parameters: {number}")
        elif number == 0:
            message = f"the ratio {value} is 0 at the default parameters, so nothing follows {other!r}; leave it out"
            reader.report(at, sub, message)
        terms.append(_term(other, joints, -value))


def _term(name: str, joints: Joints, factor: Expression) -> Term:
    joint = name if name in joints else name.rpartition(".")[0]
    _, coordinates, body = joints[joint]
    return Term(body, coordinates.index(name), factor)


def _coordinate(reader: Reader, at: Instance, sub: Path_, reference: Expression, joints: Joints) -> str | None:
    """The single coordinate that a name means, or None after a problem."""
    name = reader.coordinate(reference, at, sub)
    if name is None:
        return None
    if name.partition(".")[0] in reader.broken:
        return None
    joint = name if name in joints else name.rpartition(".")[0]
    if joint not in joints or (name != joint and name not in joints[joint][1]):

        def unknown() -> str:
            known = [n for kind, of, _ in joints.values() if not kind.quaternions for n in of]
            hint = reader.loop_hint(name) or nearest(name, known)
            return f"unknown joint or coordinate {name!r}; allowed are {some(known)}{hint}"

        reader.report(at, sub, unknown)
        return None
    kind, coordinates, _ = joints[joint]
    if not coordinates:
        reader.report(at, sub, f"joint {joint!r} is {kind.name} and has no coordinate that could be coupled")
    elif kind.quaternions:
        message = (
            f"the {kind.name} joint {joint!r} has a quaternion, whose speeds are no rates of coordinates, so it cannot be "
            f"coupled; give the body joints of single coordinates, one after the other with bodies without mass between them"
        )
        reader.report(at, sub, message)
    elif name not in coordinates:
        message = (
            f"joint {joint!r} is {kind.name} and has several coordinates; a coupling relates single ones: write one of "
            f"{some(coordinates)}"
        )
        reader.report(at, sub, message)
    else:
        return name
    return None
