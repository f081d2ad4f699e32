"""The list of sweeps: their blocks, directions and purposes.

Read this first. Forward dynamics is ``kinematics``, ``triangularize``, ``back_substitute`` (Eqs. 18-24, 42-47, 53-56). A
sensitivity adds ``balance_out``, ``balance_in``, ``balance_back`` over directions. Loops add ``closures`` before forward
dynamics, and ``complete`` before the sensitivity.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace

from ..program.block import Scope
from ..records import dataclass
from .ears import (
    assembly,
    closed_solutions,
    closed_tree,
    closures,
    completion,
    far_links,
    reaction_tangents,
    reactions,
    region_balance,
    region_system,
    virtual_body,
)
from .ears import back_substitution as ear_back_substitution
from .ears import balance as ear_balance
from .ears import kinematics as ear_kinematics
from .elements import loads
from .outputs import accelerations, energy, sums
from .structure.element_kinds import ElementKind
from .structure.factor_form import FactorForm
from .structure.kinds import EarKind, LinkKind, RegionKind, UnitKind
from .structure.system import System
from .tree import (
    back_substitution,
    balance,
    closed,
    columns,
    composite,
    driving,
    inverse_dynamics,
    kinematics,
    triangularization,
    turning,
)

OUTWARD, INWARD = "outward", "inward"


@dataclass(frozen=True, slots=True)
class Sweep:
    """A pass over all links, or over all units: links, ears and regions.

    Attributes
    ----------
    name, title : str
    write : callable (scope, kind)
        Writes the block of one kind of links.
    direction : str
        ``outward`` or ``inward``.
    lanes : bool
        Runs over directions.
    tangents : bool
        The block is differentiated.
    applies : callable (kind) -> bool
    ear, region : callable (scope, kind), optional
        Write the blocks of ears and regions.
    units : bool
        Runs over units; other sweeps run over all links, in ears or not.
    element : callable (scope, kind), optional
        Writes the block of force elements; the sweep runs over these, and for energies over those that have one.
    groups : str
        For sweeps over all columns of a matrix, the columns that the block of a link processes. ``own``: those of the link;
        ``below``: those of the link and of links outboard; ``rest``: all except ``below``; ``path``: those of the link and of
        links inboard; ``still``: all except ``path``; ``fresh``: in ``path`` of the link but not of its parent.
    then : str
        Sweep whose function for a link is called after that of this sweep.
    closing : bool
        The sweep is needed for loops only. It has blocks for links outside ears only if a loop depends on their motion.
    """

    name: str
    title: str
    write: Callable[[Scope, LinkKind], None]
    direction: str
    lanes: bool = False
    tangents: bool = False
    applies: Callable[[LinkKind], bool] = lambda kind: True
    ear: Callable[[Scope, EarKind], FactorForm | None] | None = None
    region: Callable[[Scope, RegionKind], None] | None = None
    units: bool = False
    closing: bool = False
    groups: str = ""
    then: str = ""
    element: Callable[[Scope, ElementKind], None] | None = None
    energy: bool = False

    def has_block(self, kind: UnitKind) -> bool:
        """Whether the sweep has a block for this kind."""
        if isinstance(kind, LinkKind):
            return self.applies(kind)
        if isinstance(kind, EarKind):
            return self.ear is not None
        if isinstance(kind, ElementKind):
            return self.element is not None and (kind.first.has_energy or not self.energy)
        return self.region is not None

    def write_block(self, x: Scope, kind: UnitKind) -> FactorForm | None:
        """Writes the block of a kind; returns the form of the closure matrix's factor, if the block computes one."""
        if isinstance(kind, LinkKind):
            self.write(x, kind)
        elif isinstance(kind, EarKind) and self.ear is not None:
            return self.ear(x, kind)
        elif isinstance(kind, RegionKind) and self.region is not None:
            self.region(x, kind)
        elif isinstance(kind, ElementKind) and self.element is not None:
            self.element(x, kind)
        return None

    def kinds(self, system: System) -> Sequence[UnitKind]:
        """The kinds for which the sweep has a block."""
        kinds: Sequence[UnitKind] = system.unit_kinds if self.units else system.kinds
        if self.element is not None:
            kinds = system.element_kinds
        found = [k for k in kinds if self.has_block(k)]
        if self.closing and not system.has_link_motion:
            found = [k for k in found if not isinstance(k, LinkKind)]
        return found

    def sequence(self, system: System) -> list[UnitKind]:
        """Kinds of all links, units or force elements of the sweep, in outward order."""
        if self.element is not None:
            of: dict[int, UnitKind] = {n: k for k in system.element_kinds for n in k.members}
            return [of[n] for n in range(len(of))]
        return [*(system.unit_kind_of if self.units else system.kind_of)]


def _quaternion(kind: LinkKind) -> bool:
    return kind.joint.quaternion is not None


def _nothing(x: Scope, kind: LinkKind) -> None:
    pass


def _pulled(kind: LinkKind) -> bool:
    return kind.pulled


def _driven(kind: LinkKind) -> bool:
    return kind.joint.driven


def _tree_outward(x: Scope, kind: LinkKind) -> None:
    """Writes several outward blocks of a link as one."""
    for write in (kinematics.pose, loads.velocities, closed.tree_motion, closed.clear_wrenches):
        write(x, kind)


def _never(kind: LinkKind) -> bool:
    return False


SWEEPS: tuple[Sweep, ...] = (
    Sweep("rotations", "rotation matrices of quaternions (Eq. 22)", kinematics.rotations, OUTWARD, applies=_quaternion),
    Sweep("turns", "rotation vectors of quaternion seeds", kinematics.turns, OUTWARD, lanes=True, applies=_quaternion),
    Sweep("closures", "closure of loops: dependent speeds (Eqs. 30, 32-38)", closures.link_motion, OUTWARD,
          ear=closures.closures, region=far_links.far_poses, units=True, closing=True),
    Sweep("residuals", "residuals of loops in position and velocity", _nothing, OUTWARD, applies=_never,
          ear=assembly.residuals, units=True),
    Sweep("correct", "Newton's step of the dependent coordinates", assembly.link_step, OUTWARD,
          applies=lambda kind: bool(kind.closed_on), ear=assembly.newton_step, region=assembly.far_steps, units=True,
          closing=True),
    Sweep("condition_numbers", "condition numbers of the closure matrices", _nothing, OUTWARD, applies=_never,
          ear=assembly.conditions, units=True),
    Sweep("complete", "completion of seeds: differentiated closure of positions and velocities (Eq. 30)",
          completion.link_displacement, OUTWARD, lanes=True, tangents=True, ear=completion.complete,
          region=far_links.far_displacements, units=True, closing=True),
    Sweep("seed_residuals", "residuals of loops along complete seeds", _nothing, OUTWARD, lanes=True, applies=_never,
          ear=completion.seed_residuals, units=True),
    Sweep("pose", "positions and attitudes in the ground frame", kinematics.pose, OUTWARD),
    Sweep("pose_tangents", "tangent of positions and attitudes", kinematics.pose, OUTWARD, lanes=True, tangents=True),
    Sweep("velocities", "velocities of links (Eq. 18)", loads.velocities, OUTWARD),
    Sweep("velocity_tangents", "tangent of velocities", loads.velocities, OUTWARD, lanes=True, tangents=True),
    Sweep("clear", "forces of force elements set to zero", loads.clear, OUTWARD, applies=_pulled),
    Sweep("clear_tangents", "tangents of force elements set to zero", loads.clear_tangents, OUTWARD, lanes=True, applies=_pulled),
    Sweep("loads", "forces of force elements", _nothing, OUTWARD, element=loads.loads),
    Sweep("load_tangents", "tangent of forces of force elements", _nothing, OUTWARD, lanes=True, tangents=True,
          element=loads.loads),
    Sweep("element_energy", "energy of force elements", _nothing, OUTWARD, element=loads.energy, energy=True),
    Sweep("element_energy_tangents", "tangent of the energy of force elements", _nothing, OUTWARD, lanes=True, tangents=True,
          element=loads.energy, energy=True),
    Sweep("kinematics", "kinematic sweep (Eqs. 18-24, 31)", kinematics.kinematics, OUTWARD, units=True,
          ear=ear_kinematics.ear_kinematics, region=region_system.region_start),
    Sweep("triangularize", "triangularization (Eqs. 39-47)", triangularization.triangularize, INWARD, units=True,
          ear=virtual_body.ear_triangularize, region=region_system.region_triangularize),
    Sweep("back_substitute", "back substitution (Eqs. 53-56)", back_substitution.back_substitute, OUTWARD, units=True,
          ear=ear_back_substitution.ear_back_substitute, region=ear_back_substitution.region_back_substitute),
    Sweep("newton_euler_out", "inverse dynamics, outward (Eqs. 19, 24)", inverse_dynamics.newton_euler_outward, OUTWARD),
    Sweep("newton_euler_in", "inverse dynamics, inward (Eq. 45)", inverse_dynamics.newton_euler_inward, INWARD),
    Sweep("motion", "accelerations and required forces (Eqs. 19, 24)", inverse_dynamics.newton_euler_outward, OUTWARD,
          units=True, ear=reactions.ear_motion, region=reactions.region_motion),
    Sweep("transmitted", "wrenches transmitted by joints and loops (Eqs. 9, 45)", reactions.transmitted, INWARD, units=True,
          ear=reactions.ear_transmitted, region=reactions.region_transmitted),
    Sweep("balance_out", "balance, outward: tangent of the inverse dynamics at fixed udot (Eqs. 25-29)",
          inverse_dynamics.balance_start, OUTWARD, lanes=True, tangents=True, units=True,
          ear=ear_balance.ear_balance_out, region=region_balance.region_balance_start),
    Sweep("balance_in", "balance, inward: transmitted forces and bias forces of the solution (Eqs. 9, 45, 50)",
          balance.balance_inward, INWARD, lanes=True, tangents=True, units=True, ear=ear_balance.ear_balance_in,
          region=region_balance.region_balance_in),
    Sweep("solve_in", "solve M x = b, inward (Eqs. 45, 53)", balance.solve_inward, INWARD, lanes=True),
    Sweep("balance_back", "balance, back substitution (Eqs. 53-55)", balance.balance_outward, OUTWARD, lanes=True, units=True,
          ear=ear_back_substitution.ear_balance_back, region=region_balance.region_balance_back),
    Sweep("reaction_out", "tangent of required forces, with that of udot (Eqs. 19, 24)", reaction_tangents.needed,
          OUTWARD, lanes=True, units=True, ear=reaction_tangents.ear_needed, region=region_balance.clear_transmitted),
    Sweep("reaction_in", "tangent of transmitted wrenches (Eqs. 9, 45)", reaction_tangents.link_tangents,
          INWARD, lanes=True, tangents=True, units=True, ear=reaction_tangents.ear_reaction_tangents,
          region=reaction_tangents.region_reaction_tangents),
    Sweep("inverse_out", "tangent of the inverse dynamics, outward (Eqs. 25-29)", inverse_dynamics.newton_euler_outward, OUTWARD,
          lanes=True, tangents=True),
    Sweep("force_tangents", "tangent of the inverse dynamics, inward", inverse_dynamics.newton_euler_inward, INWARD,
          lanes=True, tangents=True),
    Sweep("mass_out", "product M x, outward (Eqs. 19, 23)", balance.mass_outward, OUTWARD, lanes=True),
    Sweep("mass_in", "product M x, inward", balance.mass_inward, INWARD, lanes=True),
    Sweep("found_motion", "accelerations of the forward dynamics, and required forces (Eqs. 19, 24)",
          inverse_dynamics.balance_start, OUTWARD),
    Sweep("tree_motion", "accelerations of all links at given udot, and required forces (Eqs. 19, 24)", closed.tree_motion,
          OUTWARD),
    Sweep("missing_forces", "joint forces that udot requires in addition to those of the model (Eq. 45)",
          inverse_dynamics.missing_forces, INWARD),
    Sweep("clear_wrenches", "forces of loops set to zero", closed.clear_wrenches, OUTWARD),
    Sweep("tree_outward", "poses, velocities and accelerations of all links, and required forces (Eqs. 18, 19, 22, 24)",
          _tree_outward, OUTWARD),
    Sweep("wrenches", "wrenches of loops on links (Eq. 9)", _nothing, OUTWARD, applies=_never, ear=closed_tree.wrenches,
          units=True),
    Sweep("tree_forces", "joint forces that udot and the wrenches of loops require, in addition to those of the model (Eq. 45)",
          closed.tree_forces, INWARD),
    Sweep("driving", "forces that prescribed motion requires (Eqs. 45, 53)", driving.driving, OUTWARD, applies=_driven),
    Sweep("driving_in_loops", "forces that prescribed motion requires, with those of loops (Eqs. 9, 45)",
          driving.driving_in_loops, OUTWARD, applies=_driven),
    Sweep("acceleration_gaps", "values of the loops' conditions in acceleration (Eq. 31)", _nothing, OUTWARD, applies=_never,
          ear=closed_tree.acceleration_gaps, units=True),
    Sweep("rate_gaps", "values of the loops' conditions in velocity (Eq. 30)", _nothing, OUTWARD, applies=_never,
          ear=closed_tree.rate_gaps, units=True),
    Sweep("gaps", "values of the loops' conditions in position (Eq. 32)", _nothing, OUTWARD, applies=_never,
          ear=closed_tree.gaps, units=True),
    Sweep("coordinate_forces", "gradient with respect to coordinates, along speeds", closed.coordinate_forces, OUTWARD),
    Sweep("tangential_gradients", "gradients with respect to quaternions that loops determine in part", _nothing, OUTWARD,
          applies=_never, ear=closed_tree.tangential_gradients, units=True),
    Sweep("multiplier_gains", "forces of each multiplier on the roots of an ear (Eq. 9)", _nothing, OUTWARD, applies=_never,
          ear=closed_solutions.multiplier_gains, units=True),
    Sweep("multipliers_out", "forces of loops set to zero", _nothing, OUTWARD, lanes=True, applies=_never,
          region=closed_solutions.clear_sums, units=True),
    Sweep("multipliers_in", "multipliers for given forces along dependent degrees of freedom (Eq. 9)",
          closed_solutions.link_multipliers, INWARD, lanes=True, ear=closed_solutions.ear_multipliers,
          region=closed_solutions.region_multipliers, units=True),
    Sweep("response_out", "solve M x + E^T y = b, E x = e: dependent accelerations (Eqs. 19, 23, 31)",
          closed_solutions.link_response, OUTWARD, lanes=True, ear=closed_solutions.ear_response,
          region=closed_solutions.region_response, units=True),
    Sweep("response_in", "solve M x + E^T y = b, E x = e, inward (Eqs. 45, 53)", closed_solutions.link_solution, INWARD,
          lanes=True, ear=closed_solutions.ear_solution, region=region_balance.region_solution, units=True),
    Sweep("virtual_out", "solve M x + E^T y = b, E x = 0: sums set to zero", closed_solutions.link_at_rest, OUTWARD, lanes=True,
          ear=closed_solutions.ear_at_rest, region=closed_solutions.region_response, units=True),
    Sweep("virtual_in", "solve M x + E^T y = b, E x = 0, inward (Eqs. 45, 53)", closed_solutions.link_virtual, INWARD, lanes=True,
          ear=closed_solutions.ear_virtual, region=region_balance.region_solution, units=True),
    Sweep("given_accelerations", "accelerations from those of independent speeds, E x = e; required forces (Eqs. 19, 23)",
          closed_solutions.link_given, OUTWARD, lanes=True, ear=closed_solutions.ear_given, region=closed_solutions.clear_sums,
          units=True),
    Sweep("response_forces", "forces that the accelerations x require (Eqs. 19, 23)", reaction_tangents.needed, OUTWARD,
          lanes=True, ear=reaction_tangents.ear_needed, region=closed_solutions.clear_sums, units=True),
    Sweep("response_multipliers", "the multipliers y of M x + E^T y = b (Eqs. 9, 45)", closed_solutions.link_balanced, INWARD,
          lanes=True, ear=closed_solutions.ear_balanced, region=closed_solutions.region_multipliers, units=True),
    Sweep("turning", "response to rotation, inward (derivatives of Eqs. 21, 24, 45)", turning.turning, INWARD),
    Sweep("column_clear", "columns: forces set to zero", columns.column_clear, OUTWARD, lanes=True, groups="below"),
    Sweep("column_rest", "columns: right sides that are zero", columns.column_rest, OUTWARD, lanes=True, groups="rest"),
    Sweep("column_begin", "columns: parents that do not rotate", columns.column_begin, OUTWARD, lanes=True, groups="fresh",
          applies=lambda kind: kind.has_parent),
    Sweep("column_turns", "columns: rotation vectors of quaternions", columns.column_turns, OUTWARD, lanes=True, groups="own",
          applies=_quaternion),
    Sweep("column_seed", "columns: changes of the links that own the coordinates and speeds", columns.column_seed, OUTWARD,
          lanes=True, tangents=True, groups="own"),
    Sweep("column_unit", "columns: unit forces along degrees of freedom", columns.column_unit, OUTWARD, lanes=True, groups="own"),
    Sweep("column_in", "columns, inward: forces (Eqs. 45, 53)", columns.column_in, INWARD, lanes=True, groups="below"),
    Sweep("column_back", "columns, back substitution on links that they do not rotate (Eqs. 53-55)", columns.column_back, OUTWARD,
          lanes=True, groups="still"),
    Sweep("column_turn", "columns, back substitution on links that they rotate (Eqs. 53-55)", columns.column_turn, OUTWARD,
          lanes=True, groups="path", then="column_add"),
    Sweep("column_add", "columns: changes of their own links", columns.column_add, OUTWARD, lanes=True, groups="own"),
    Sweep("composite", "composite inertias (Eq. 23)", composite.composite, INWARD),
    Sweep("composite_seed", "columns: forces for unit accelerations (Eq. 23)", columns.composite_seed, OUTWARD, lanes=True,
          groups="own", applies=lambda kind: kind.joint.freedoms > 0),
    Sweep("composite_in", "columns, inward: the mass matrix (Eq. 45)", columns.composite_in, INWARD, lanes=True, groups="below"),
    Sweep("rates", "time derivatives of the coordinates (Eq. 1)", kinematics.coordinate_rates, OUTWARD),
    Sweep("rate_tangents", "tangent of the time derivatives of the coordinates", kinematics.coordinate_rates, OUTWARD,
          lanes=True, tangents=True),
    Sweep("kinetic", "velocities and kinetic energy (Eq. 18)", energy.kinetic, OUTWARD),
    Sweep("kinetic_tangents", "tangent of velocities and kinetic energy", energy.kinetic, OUTWARD, lanes=True, tangents=True),
    Sweep("link_accelerations", "accelerations of links (Eqs. 18-21)", accelerations.accelerations, OUTWARD),
    Sweep("link_acceleration_tangents", "tangent of accelerations of links", accelerations.accelerations, OUTWARD, lanes=True,
          tangents=True),
    Sweep("masses", "mass and first moment of the system", sums.masses, OUTWARD),
    Sweep("mass_tangents", "tangent of mass and first moment of the system", sums.masses, OUTWARD, lanes=True, tangents=True),
    Sweep("momenta", "linear and angular momentum of the system (Eq. 23)", sums.momenta, OUTWARD),
    Sweep("momentum_tangents", "tangent of the momentum of the system", sums.momenta, OUTWARD, lanes=True, tangents=True),
    Sweep("moments", "mass and first moment of everything outboard", energy.moments, INWARD),
    Sweep("moment_tangents", "tangent of mass and first moment", energy.moments, INWARD, lanes=True, tangents=True),
)  # fmt: skip


def values_name(sweep: str) -> str:
    """Name of the sweep that computes the scalars used by a sweep over directions."""
    return f"{sweep}_values"


def transpose_name(sweep: str) -> str:
    """Name of the transpose of a sweep over directions."""
    return f"{sweep}_transposed"


def backwards(sweep: Sweep) -> tuple[Sweep, Sweep]:
    """Two sweeps for the transpose of a sweep over directions: one for its scalars, and the transpose itself."""
    turned = INWARD if sweep.direction == OUTWARD else OUTWARD
    return (
        replace(sweep, name=values_name(sweep.name), title=f"values of {sweep.title}", lanes=False),
        replace(sweep, name=transpose_name(sweep.name), title=f"transpose of {sweep.title}", direction=turned),
    )


FALLING = ("balance_out", "inverse_out")
"""Sweeps that begin at the ground with the tangent of its acceleration -g."""

GRADIENT_OUT, GRADIENT_IN, GRADIENT_IN_CLOSED = "gradient_out", "gradient_in", "gradient_in_closed"
"""Merged sweeps of the balance's transpose; the last includes the transpose of the completion of seeds."""


def _together() -> list[Sweep]:
    balance = next(s for s in SWEEPS if s.name == "balance_out")
    inward = "transmitted forces, and gradients of weighted accelerations, inward"
    return [
        replace(balance, name=GRADIENT_OUT, title="accelerations and weights of forces, outward"),
        replace(balance, name=GRADIENT_IN, title=inward, direction=INWARD),
        replace(balance, name=GRADIENT_IN_CLOSED, title=f"{inward}, with closed loops", direction=INWARD),
    ]


DIFFERENTIATED_TWICE = (
    "rotations", "rates", "pose", "velocities", "kinetic", "link_accelerations", "masses", "momenta", "moments", "element_energy",
    "clear", "loads", "found_motion", "tree_motion", "missing_forces", "driving", "clear_wrenches", "wrenches", "tree_forces",
    "driving_in_loops", "acceleration_gaps", "rate_gaps", "gaps", "coordinate_forces", "tangential_gradients",
)  # fmt: skip
"""Sweeps of the inverse dynamics, of quantities and of the loops' conditions, in their order; see `second_order`."""


def along_name(sweep: str) -> str:
    """Name of the tangent of a sweep, which stores the tangents of all values."""
    return f"{sweep}_along"


def adjoint_name(sweep: str) -> str:
    """Name of the adjoint of a sweep, for one vector of weights."""
    return f"{sweep}_adjoint"


def mass_name(sweep: str) -> str:
    """Name of the part of the adjoint's tangent that the mass matrix determines."""
    return f"{sweep}_mass_along"


def back_name(sweep: str) -> str:
    """Name of the transpose of a sweep's tangent."""
    return f"{sweep}_back"


OF_MASS = ("tree_forces", "wrenches", "acceleration_gaps", "tree_motion")
"""Sweeps from whose adjoints ``M z + E^T y`` and ``E z`` follow, in the order of their adjoints."""


def backward_in_loops(sweeps: Iterable[str]) -> list[str]:
    """The order in which the tangents of adjoints are computed. The one of joint forces comes first, because its sweep
    visits all links and reads no other adjoint except those of driving forces."""
    first = ("driving_in_loops", OF_MASS[0])
    order = [*sweeps][::-1]
    return sorted(order, key=lambda s: first.index(s) if s in first else len(first))


RUN_AGAIN = tuple(map(adjoint_name, ("rotations", "pose", "velocities", "rate_gaps", "gaps")))
"""Sweeps that run once to find the multipliers of conditions, and again with the multipliers."""

TOGETHER = {
    "tangents_outward": (
        *map(along_name, ("pose", "velocities", "tree_motion", "clear_wrenches")), mass_name("tree_forces"),
    ),
    "tangents_inward": (along_name("tree_forces"), mass_name("tree_motion")),
    "adjoints_inward": (along_name(adjoint_name("tree_motion")), along_name(adjoint_name("velocities"))),
    "poses_inward": (back_name("velocities"), along_name(adjoint_name("pose"))),
}  # fmt: skip
"""Independent sweeps over links that run as one sweep: for each link, their blocks run one after the other. In a single
sweep, the processor mostly waits for results of the neighbouring link; here it computes the other blocks meanwhile."""


def parts_of(sweeps: Iterable[str]) -> set[str]:
    """The given sweeps, and the sweeps of which they consist (`TOGETHER`)."""
    return {part for s in sweeps for part in (s, *TOGETHER.get(s, ()))}


def _twice() -> list[Sweep]:
    """The sweeps that `second_order` derives from others: all tangents, then all adjoints with their tangents."""
    found = [SWEEP[name] for name in DIFFERENTIATED_TWICE]
    tangents = [replace(s, name=along_name(s.name), title=f"tangent of {s.title}", lanes=True) for s in found]
    adjoints = []
    for s in reversed(found):
        turned = replace(s, direction=INWARD if s.direction == OUTWARD else OUTWARD)
        name, title = adjoint_name(s.name), f"adjoint of {s.title}"
        adjoints.append(replace(turned, name=name, title=title))
        for of in (mass_name(s.name), along_name(name)):
            adjoints.append(replace(turned, name=of, title=f"tangent of the {title}", lanes=True))
        adjoints.append(
            replace(turned, name=back_name(s.name), title=f"transpose of the tangent of {s.title}", lanes=True)
        )
    by_name = {s.name: s for s in (*tangents, *adjoints)}
    together = [
        replace(by_name[parts[0]], name=name, title="; ".join(by_name[p].title for p in parts))
        for name, parts in TOGETHER.items()
    ]
    return [*tangents, *adjoints, *together]


SWEEP = {s.name: s for s in (*SWEEPS, *(b for s in SWEEPS if s.lanes for b in backwards(s)), *_together())}
TWICE = _twice()
SWEEP |= {s.name: s for s in TWICE}
"""All sweeps by name, including transposes."""
