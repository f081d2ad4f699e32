"""The sweeps: which blocks there are, in which direction they go, and what they are for.

This is the list to read first. Forward dynamics is ``kinematics``, ``triangularize``, ``back_substitute`` (Eqs. 18-24, 42-47,
53-56); a sensitivity adds ``balance_out``, ``balance_in``, ``balance_back`` over directions.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from . import (
    back_substitution,
    balance,
    energy,
    inverse_dynamics,
    kinematics,
    triangularization,
)

OUTWARD, INWARD = "outward", "inward"


@dataclass(frozen=True, slots=True)
class Sweep:
    """A pass over all links.

    Attributes
    ----------
    name, title : str
    write : callable (expansion, kind)
        Writes the block of one kind.
    direction : str
        ``outward`` or ``inward``.
    lanes : bool
        Runs over directions.
    tangents : bool
        The block is differentiated.
    applies : callable (kind) -> bool
    """

    name: str
    title: str
    write: Callable[[Any, Any], None]
    direction: str
    lanes: bool = False
    tangents: bool = False
    applies: Callable[[Any], bool] = lambda kind: True


def _quaternion(kind: Any) -> bool:
    return kind.joint in ("spherical", "free")


SWEEPS: tuple[Sweep, ...] = (
    Sweep("rotations", "rotation matrices of quaternions (Eq. 22)", kinematics.quaternion_matrix, OUTWARD, applies=_quaternion),
    Sweep("turns", "rotation vectors of quaternion seeds", kinematics.quaternion_turn, OUTWARD, lanes=True, applies=_quaternion),
    Sweep("kinematics", "kinematic sweep (Eqs. 18-24)", kinematics.kinematics, OUTWARD),
    Sweep("triangularize", "triangularization (Eqs. 42-47)", triangularization.triangularize, INWARD),
    Sweep("back_substitute", "back substitution (Eqs. 53-56)", back_substitution.back_substitute, OUTWARD),
    Sweep("newton_euler_out", "inverse dynamics, outward (Eqs. 19, 24)", inverse_dynamics.newton_euler_outward, OUTWARD),
    Sweep("newton_euler_in", "inverse dynamics, inward (Eq. 45)", inverse_dynamics.newton_euler_inward, INWARD),
    Sweep("balance_out", "balance, outward: tangent of the inverse dynamics at fixed udot (Eqs. 25-29)",
          inverse_dynamics.newton_euler_outward, OUTWARD, lanes=True, tangents=True),
    Sweep("balance_in", "balance, inward: transmitted forces and bias forces of the solve (Eqs. 9, 45, 50)",
          balance.balance_inward, INWARD, lanes=True, tangents=True),
    Sweep("balance_back", "balance, back substitution (Eqs. 53-55)", balance.balance_outward, OUTWARD, lanes=True),
    Sweep("force_tangents", "tangent of the inverse dynamics, inward", inverse_dynamics.newton_euler_inward, INWARD,
          lanes=True, tangents=True),
    Sweep("solve_in", "solve M x = b, inward (Eqs. 45, 53)", balance.solve_inward, INWARD, lanes=True),
    Sweep("mass_out", "product M x, outward (Eqs. 19, 23)", balance.mass_outward, OUTWARD, lanes=True),
    Sweep("mass_in", "product M x, inward", balance.mass_inward, INWARD, lanes=True),
    Sweep("rates", "time derivatives of the coordinates (Eq. 1)", kinematics.coordinate_rates, OUTWARD),
    Sweep("rate_tangents", "tangent of the time derivatives of the coordinates", kinematics.coordinate_rates, OUTWARD,
          lanes=True, tangents=True),
    Sweep("kinetic", "velocities and kinetic energy (Eq. 18)", energy.kinetic, OUTWARD),
    Sweep("kinetic_tangents", "tangent of velocities and kinetic energy", energy.kinetic, OUTWARD, lanes=True, tangents=True),
    Sweep("moments", "mass and first moment of everything outboard", energy.moments, INWARD),
    Sweep("moment_tangents", "tangent of mass and first moment", energy.moments, INWARD, lanes=True, tangents=True),
    Sweep("pose", "positions and attitudes in the ground frame", energy.pose, OUTWARD),
    Sweep("pose_tangents", "tangent of positions and attitudes", energy.pose, OUTWARD, lanes=True, tangents=True),
)  # fmt: skip

SWEEP = {s.name: s for s in SWEEPS}
