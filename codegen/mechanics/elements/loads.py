"""Sweeps over force elements: forces on links, energies, and the tangents of both.

Points move in the ground frame. The force on a link, and the moment about the link's origin, are along the link's axes
(fields ``ext``). The kinematic sweep subtracts them from the force that the link's motion requires. The `Law` of each
type is in a file of its own.
"""

from __future__ import annotations

from ...program import algebra
from ...program.algebra import Expr, Symbol
from ...program.block import Expansion, Scope
from ...program.derivatives import Tangents
from ...program.scalar import Value
from .. import fields, propagation
from ..formulas import has_values
from ..spatial import is_zero
from ..stores import (
    CE_DP,
    CE_PARAMETER,
    DPOTENTIAL,
    ELEMENT_CONSTANTS,
    ELEMENT_END,
    LANE_ENDS,
    ME,
    MY_LANE,
    POTENTIAL,
    TANGENT_OF,
)
from ..structure.element_kinds import ElementKind
from ..structure.kinds import LinkKind
from ..tree.kinematics import angular_velocity, origin_velocity
from ..tree.tangents import store_motion, tangent
from . import LAWS
from .element import Element


def velocities(x: Scope, kind: LinkKind) -> None:
    """Outward block of a link: angular velocity and velocity of the origin, along its axes. Eq. 18."""
    joint = kind.joint(x, kind)
    _, w = angular_velocity(x, joint, fields.applied_twist.angular)
    v = origin_velocity(x, joint, fields.applied_twist.angular, fields.applied_twist.linear)
    store_motion(x, kind, joint, ((fields.applied_twist.angular, w), (fields.applied_twist.linear, v)))


def clear(x: Scope, kind: LinkKind) -> None:
    """Set the forces of force elements on a link to zero."""
    propagation.clear(x, ME, fields.external)


def clear_tangents(x: Scope, kind: LinkKind) -> None:
    """Set the tangents of the forces of force elements on a link to zero."""
    propagation.clear(x, MY_LANE, fields.external)


def loads(x: Scope, kind: ElementKind) -> None:
    """The forces of a force element on its links."""
    e = Element(x, kind)
    acting = e.on_links(LAWS[type(kind.first)].wrenches(e))
    if not x.tangents:
        for link, wrench in acting:
            x.store(link.sum, fields.external, wrench)
    else:
        d = _tangents(x, kind, e)
        for link, wrench in acting:
            assert link.place is not None
            x.store(LANE_ENDS[link.place].sum, fields.external, [tangent(d, c) for c in wrench])
    _check(x, kind, "its force")


def energy(x: Scope, kind: ElementKind) -> None:
    """The potential energy of a force element."""
    e = Element(x, kind)
    found = LAWS[type(kind.first)].energy(e)
    x.set_entry(POTENTIAL.sum, 0, found)
    if x.tangents:
        d = _tangents(x, kind, e)
        x.set_entry(DPOTENTIAL.sum, 0, tangent(d, found))
    _check(x, kind, "its energy")


def _check(x: Scope, kind: ElementKind, what: str) -> None:
    """Raises the model's error if the block contains a number that is not finite in every state."""
    if isinstance(x, Expansion) and not has_values(x.block):
        raise kind.no_value(what)


def _tangents(x: Scope, kind: ElementKind, e: Element) -> Tangents | None:
    """Tangents of all statements written so far."""
    if not isinstance(x, Expansion):
        return None
    seeds: dict[Symbol, Value] = {}
    transparent: dict[Symbol, dict[Symbol, Expr]] = {}
    for symbol, (store, name) in list(x.block.loads.items()):
        if store.owner is ELEMENT_END:
            assert store.place is not None
            seeds[symbol] = x.component(LANE_ENDS[store.place], name)
        elif store in TANGENT_OF:
            seeds[symbol] = x.component(TANGENT_OF[store], name)
        elif store is ELEMENT_CONSTANTS and "/" not in name:
            inner: dict[Symbol, Expr] = {}
            for j in range(kind.parameters):
                value = x.component(ELEMENT_CONSTANTS, f"{name}/{j}")
                if value is not algebra.ZERO:
                    root = x.symbol(CE_PARAMETER, j)
                    inner[root] = value
                    seeds[root] = x.entry(CE_DP, j)
            if inner:
                transparent[symbol] = inner
    d = Tangents(x, {s: v for s, v in seeds.items() if not is_zero(v)}, transparent, known=e.slopes)
    for statement in list(x.block.statements):
        d.statement(statement)
    return d
