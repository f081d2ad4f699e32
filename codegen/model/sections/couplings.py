"""Couplings of coordinates: gears, belts, racks, mimic joints, differentials."""

from __future__ import annotations

from ..expressions import Expression
from ..model import Coupling, Term, coupling
from ..parts import Instance
from ..positions import Path_
from ..reading import Reader
from ..schema import CouplingEntry
from ..unknown_names import some
from .bodies import BodySection
from .coordinates import Joints


def read_couplings(reader: Reader, bodies: BodySection) -> list[Coupling]:
    """Read the couplings; each must determine a different coordinate."""
    joints = Joints(bodies)
    owner: dict[str, str] = {}
    found = []
    for at, name, spec in reader.entries("couplings", CouplingEntry, "coupling", "body"):
        if spec is None or not reader.is_whole(spec):
            continue
        before = reader.errors
        own = _coordinate(reader, at, ("joint",), spec.joint, joints)
        if own is not None and own in owner:
            message = (
                f"coupling {owner[own]!r} already determines {own!r}; remove one of the two couplings, or let this one "
                f"determine another of its coordinates"
            )
            reader.report(at, ("joint",), message)
        if own is not None and f"q.{own}" in reader.prescribed:
            message = (
                f"{own!r} is prescribed under `motion`, so it cannot follow; let the other coordinate follow it, or remove it "
                f"from `motion`"
            )
            reader.report(at, ("joint",), message)
        terms = [] if own is None else [_term(own, joints, Expression.number(1))]
        if own is not None and name is not None:
            owner.setdefault(own, name)
        _read_followed(reader, at, spec, own, joints, terms)
        offset = reader.bound(spec.offset, at, ("offset",), "parameters")
        if name is not None and reader.errors == before:
            found.append(coupling(name, tuple(terms), offset))
    return found


def _read_followed(
    reader: Reader, at: Instance, spec: CouplingEntry, own: str | None, joints: Joints, terms: list[Term]
) -> None:
    """Add the coordinates that the coupling's coordinate follows; their factors are minus the ratios."""
    if not spec.follows:
        reader.report(at, ("follows",), "follows is empty; give coordinates with their ratios: {crank: -z1/z2}")
    seen: set[str] = set()
    for key, ratio in spec.follows.items():
        # a name without a ratio has the ratio 1
        sub: Path_ = ("follows", key) if isinstance(at.value.get("follows"), dict) else ("follows",)
        other = _coordinate(reader, at, sub, key, joints)
        errors = reader.errors
        value = reader.bound(ratio, at, sub, "parameters")
        if other is None or reader.errors > errors:
            continue
        if other == own or other in seen:
            twice = "follows itself" if other == own else "is given twice"
            reader.report(at, sub, f"{other!r} {twice}; a coupling needs different coordinates, each given once")
            continue
        seen.add(other)
        if reader.value(value) == 0:
            message = f"the ratio {value} is 0 at the default parameters, so {other!r} has no effect; leave it out"
            reader.report(at, sub, message)
        terms.append(_term(other, joints, -value))


def _term(name: str, joints: Joints, factor: Expression) -> Term:
    joint = joints[joints.owner(name)]
    return Term(joint.body, joint.coordinates.index(name), factor)


def _coordinate(reader: Reader, at: Instance, sub: Path_, written: Expression | str, joints: Joints) -> str | None:
    """The single coordinate that a name denotes; None after an error."""
    name = reader.coordinate(written, at, sub)
    named = None if name is None else joints.named(reader, at, sub, name, "coupled")
    if named is None or name in named[1].coordinates:
        return name if named is not None else None
    joint, of = named
    message = (
        f"joint {joint!r} is {of.kind.name} and has several coordinates; a coupling relates single ones: write one of "
        f"{some(of.coordinates)}"
    )
    reader.report(at, sub, message)
    return None
