"""The stores of tangents, of adjoints and of tangents of adjoints, for second derivatives (`second_order`)."""

from __future__ import annotations

from collections.abc import Mapping

from ..program.block import Component
from ..program.store import Memory, Store
from . import fields
from .stores import (
    ACCELERATION_GAP,
    ACCELERATION_GAP_BAR,
    ADJOINT,
    ADJOINT_LANE,
    CE_DGP,
    CE_DP,
    CE_GP,
    CHANGE_LANE,
    CL_DGP,
    CL_DP,
    CL_GP,
    COEFFICIENT,
    COEFFICIENT_BAR,
    COORDINATE_FORCE,
    COORDINATES,
    DACCELERATION_GAP,
    DACCELERATION_GAP_BAR,
    DCOEFFICIENT,
    DCOEFFICIENT_BAR,
    DCOORDINATE_FORCE,
    DDRIVE,
    DDRIVE_BAR,
    DDRIVING,
    DFORCE,
    DFORCE_BAR,
    DGAP,
    DGAP_BAR,
    DGP,
    DGQ,
    DGU,
    DHELD,
    DHELD_BAR,
    DKINETIC,
    DKINETIC_BAR,
    DMASSES,
    DMASSES_BAR,
    DMOMENTA,
    DMOMENTA_BAR,
    DMOTION,
    DMOTION_BAR,
    DMULTIPLIER,
    DMULTIPLIER_BAR,
    DP,
    DPOTENTIAL,
    DPOTENTIAL_BAR,
    DQ,
    DQDOT,
    DRATE_GAP,
    DRATE_GAP_BAR,
    DRIVE,
    DRIVE_BAR,
    DRIVING,
    DRIVING_BAR,
    DTAU,
    DTAU_BAR,
    DU,
    DUDOT,
    DUDOT_BAR,
    FORCE,
    FORCE_BAR,
    GAP,
    GAP_BAR,
    GP,
    GQ,
    GU,
    HELD,
    HELD_BAR,
    KINETIC,
    KINETIC_BAR,
    MASS_LANE,
    MASSES,
    MASSES_BAR,
    MOMENTA,
    MOMENTA_BAR,
    MOTION,
    MOTION_BAR,
    MULTIPLIER,
    MULTIPLIER_BAR,
    POTENTIAL,
    POTENTIAL_BAR,
    QDOT,
    QDOT_BAR,
    RATE_GAP,
    RATE_GAP_BAR,
    RECORD,
    SPEEDS,
    TANGENT,
    TAU,
    TAU_BAR,
    UDOT,
    UDOT_BAR,
)

TANGENTS = {
    COORDINATES: DQ, SPEEDS: DU, UDOT: DUDOT, TAU: DTAU, MOTION: DMOTION, COEFFICIENT: DCOEFFICIENT, DRIVE: DDRIVE,
    FORCE: DFORCE, MULTIPLIER: DMULTIPLIER, GAP: DGAP, RATE_GAP: DRATE_GAP, ACCELERATION_GAP: DACCELERATION_GAP,
    COORDINATE_FORCE: DCOORDINATE_FORCE, GQ: DGQ, QDOT: DQDOT, KINETIC: DKINETIC, POTENTIAL: DPOTENTIAL, MASSES: DMASSES,
    MOMENTA: DMOMENTA, DRIVING: DDRIVING, HELD: DHELD,
}  # fmt: skip
"""The store of tangents for each store of arguments, results and values of formulas."""

ADJOINTS = {
    DQ: GQ, DU: GU, DP: GP, CE_DP: CE_GP, DUDOT: UDOT_BAR, DTAU: TAU_BAR, DMOTION: MOTION_BAR,
    DCOEFFICIENT: COEFFICIENT_BAR, DDRIVE: DRIVE_BAR, DFORCE: FORCE_BAR, CL_DP: CL_GP, DMULTIPLIER: MULTIPLIER_BAR,
    DGAP: GAP_BAR, DRATE_GAP: RATE_GAP_BAR, DACCELERATION_GAP: ACCELERATION_GAP_BAR,
    DQDOT: QDOT_BAR, DKINETIC: KINETIC_BAR, DPOTENTIAL: POTENTIAL_BAR, DMASSES: MASSES_BAR, DMOMENTA: MOMENTA_BAR,
    DDRIVING: DRIVING_BAR, DHELD: HELD_BAR,
}  # fmt: skip
"""The store of adjoints for each store of tangents."""

ADJOINT_TANGENTS = {
    GQ: DGQ, GU: DGU, GP: DGP, CE_GP: CE_DGP, UDOT_BAR: DUDOT_BAR, TAU_BAR: DTAU_BAR, MOTION_BAR: DMOTION_BAR,
    COEFFICIENT_BAR: DCOEFFICIENT_BAR, DRIVE_BAR: DDRIVE_BAR, FORCE_BAR: DFORCE_BAR, CL_GP: CL_DGP,
    MULTIPLIER_BAR: DMULTIPLIER_BAR, GAP_BAR: DGAP_BAR, RATE_GAP_BAR: DRATE_GAP_BAR,
    ACCELERATION_GAP_BAR: DACCELERATION_GAP_BAR, KINETIC_BAR: DKINETIC_BAR, POTENTIAL_BAR: DPOTENTIAL_BAR,
    MASSES_BAR: DMASSES_BAR, MOMENTA_BAR: DMOMENTA_BAR, HELD_BAR: DHELD_BAR,
}  # fmt: skip
"""The store of tangents for each store of adjoints."""

READ_BY_FORMULAS = (TAU_BAR, MOTION_BAR, COEFFICIENT_BAR, DRIVE_BAR, HELD_BAR)
"""Adjoints that formulas read in all functions, also in those that compute no gradient."""

READ_BY_SOLUTIONS = (UDOT_BAR, MULTIPLIER_BAR)
"""Adjoints that are right sides in the equation of the virtual motion of outputs."""

GRADIENTS = (GQ, GU, GP, CE_GP, CL_GP)
"""Gradients of a weighted sum of results, for one vector of weights."""

READ_BY_LOOPS = (GQ, GU)
"""Gradients that the multipliers of loops balance, so that these follow from them."""

WITHOUT_TANGENTS = (RATE_GAP_BAR, GAP_BAR, QDOT_BAR, DRIVING_BAR)
"""Adjoints without tangents: multipliers whose changes are added later, and weights of results."""

_PREFIX = {TANGENT: "t", ADJOINT: "a", ADJOINT_LANE: "ta", MASS_LANE: "ma", CHANGE_LANE: "ca"}
_MADE: dict[tuple[Memory, Store], Store] = {}
_BASE: dict[Store, Store] = {}
"""The store of values to which each store in `_MADE` belongs."""


def base_of(store: Store) -> Store:
    """The same store without `place`, the number of its owner in a unit."""
    return _UNPLACED.get(store.name, store) if store.place is not None else store


def _found(table: Mapping[Store, Store], store: Store) -> Store | None:
    """The entry of a table for a store, at the place of this store; None if the table has none."""
    found = table.get(base_of(store))
    return found if found is None or store.place is None else found[store.place]


_UNPLACED = {s.name: s for table in (TANGENTS, ADJOINTS, ADJOINT_TANGENTS) for s in (*table, *table.values())}


def in_memory(memory: Memory, store: Store) -> Store:
    """The store of the same owner in another memory, such as the tangents of a link's record."""
    base = _BASE.get(store, store)
    found = _MADE.get((memory, base))
    if found is None:
        found = _MADE[memory, base] = Store(f"{_PREFIX[memory]}{base.name}", base.owner, memory, place=base.place)
        _BASE[found] = base
    return found


def tangent_of(store: Store, name: str) -> Component | None:
    """The place of the tangent of a value; rotation matrices of links have none (`second_order_poses`)."""
    if store.memory is RECORD:
        return None if name in fields.attitude.components else (in_memory(TANGENT, store), name)
    found = _found(TANGENTS, store)
    return None if found is None else (found, name)


def adjoint_of(store: Store) -> Store:
    """The store of the adjoints of a store of tangents."""
    if store.memory is TANGENT:
        return in_memory(ADJOINT, store)
    found = _found(ADJOINTS, store)
    assert found is not None, store
    return found


def along_of_adjoint(store: Store) -> Store:
    """The store of the tangents of the adjoints of a store of tangents."""
    if store.memory is TANGENT:
        return in_memory(ADJOINT_LANE, store)
    found = _found(ADJOINT_TANGENTS, adjoint_of(store))
    assert found is not None, store
    return found


def adjoint_tangent_of(store: Store, name: str, memory: Memory = ADJOINT_LANE) -> Component | None:
    """The place of the tangent of a value or of an adjoint."""
    if base_of(store) in WITHOUT_TANGENTS:
        return None
    if store.memory is ADJOINT:
        return in_memory(memory, store), name
    found = _found(ADJOINT_TANGENTS, store)
    return tangent_of(store, name) if found is None else (found, name)


def mass_tangent_of(store: Store, name: str) -> Component | None:
    """The place of the tangent of ``M z`` at fixed z, in separate memory."""
    if base_of(store) in (FORCE_BAR, ACCELERATION_GAP_BAR):
        return None
    return adjoint_tangent_of(store, name, MASS_LANE)
