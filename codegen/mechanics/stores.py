"""The stores of the mechanics: memory that a block may read and write, by its owner and its sort.

Every link has a *record* for one call, a *slot* and *lanes*. A slot has values per direction that only neighbours need during one
sweep; lanes have values per direction that are kept between sweeps. Ears, regions and couplings have memory of their own. A
block names the record of its own link `ME`, that of the parent `UP`, and so on: see `Owner`.
"""

from __future__ import annotations

from ..program.store import CONSTANT, MARGIN, MODEL, Life, Memory, Owner, Store

# -- sorts of memory ---------------------------------------------------------------------------------------------------

RECORD = Memory("record", region="records")
SLOT = Memory("slot", True, Life.SWEEP, "slots")
LANE = Memory("lane", True, region="lanes")
EAR_RECORD, REGION_RECORD = Memory("ear", region="ears"), Memory("region", region="regions")
COUPLING_BLOCK = Memory("coupling", region="couplings")
REGION_LANE = Memory("region lane", True, region="region_lanes")
COLUMN = Memory("column", True, region="columns")
"""Columns of matrices that are computed at once; a link has memory for the columns that it affects."""

TANGENT = Memory("tangent", True, region="tangents")
ADJOINT, ADJOINT_LANE = Memory("adjoint", region="adjoints"), Memory("adjoint", True, region="adjoint_tangents")
MASS_LANE = Memory("adjoint", True, region="mass_tangents")
CHANGE_LANE = Memory("adjoint", True, region="adjoint_changes")
"""For products with second derivatives: tangents of records; adjoints of records for one vector of weights; the
adjoints' tangents; the part of these tangents that the mass matrix determines; and changes of the adjoints with
multipliers of loops. See `second_order`."""

LAID_OUT = (
    RECORD, SLOT, LANE, EAR_RECORD, REGION_RECORD, REGION_LANE, COLUMN, COUPLING_BLOCK, TANGENT, ADJOINT, ADJOINT_LANE,
    MASS_LANE, CHANGE_LANE,
)  # fmt: skip
"""Memory whose layout places the fields; in all other memory, places are known beforehand."""

KEPT = {
    RECORD: Memory("kept record", region="kept"),
    REGION_RECORD: Memory("kept region", region="kept_regions"),
}
"""Scalars propagated by sweeps over directions and stored for their transposes."""

PER_COORDINATE, PER_COORDINATE_LANE = (
    Memory("coordinates", life=Life.OUTSIDE),
    Memory("coordinates", True, Life.OUTSIDE),
)
PER_SPEED, PER_SPEED_LANE = Memory("speeds", life=Life.OUTSIDE), Memory("speeds", True, Life.OUTSIDE)
PER_ANGLE = Memory("sines and cosines")
TURN = Memory("rotations", True)
PER_MOTION, PER_MOTION_LANE = Memory("prescribed motion"), Memory("prescribed motion", True)
PER_DRIVE, PER_DRIVE_LANE = Memory("driving forces"), Memory("driving forces", True)
PER_PARAMETER, PER_PARAMETER_LANE = Memory("parameters", life=Life.OUTSIDE), Memory("parameters", True, Life.OUTSIDE)
ENERGY, ENERGY_LANE = Memory("energies", life=Life.OUTSIDE), Memory("energies", True, Life.OUTSIDE)
SUM, SUM_LANE = Memory("sums"), Memory("sums", True)
COEFFICIENTS, COEFFICIENTS_LANE = Memory("coefficients"), Memory("coefficients", True)
PER_CONDITION, PER_CONDITION_LANE = Memory("conditions", life=Life.OUTSIDE), Memory("conditions", True, Life.OUTSIDE)
PER_LOOP = Memory("loops", life=Life.OUTSIDE)
WRENCH, WRENCH_LANE = Memory("wrenches", life=Life.OUTSIDE), Memory("wrenches", True, Life.OUTSIDE)

# -- owners ------------------------------------------------------------------------------------------------------------

LINK = Owner("link")
"""The link of a block; in blocks of ears and force elements, the link at the given position."""
PARENT = Owner("parent")
ROOT = Owner("root", several=True)
"""A link from which an ear starts; see `structure.EarLinks`."""
BASE_LINK = Owner("base")
"""The link whose axes a region uses."""
PARTNER = Owner("partner", several=True)
"""A link to which the unit is coupled; see `elimination_order.Partners`."""
GROUND_LINK = Owner("ground")
ELEMENT_END = Owner("end", several=True)
"""A link on which a force element acts, or whose motion it reads; see `element_kinds.ElementKind`."""
EAR_ITSELF, REGION_ITSELF = Owner("ear"), Owner("region")
OWN_COUPLING = Owner("coupling that ends with the unit", several=True)
CHANGED_COUPLING = Owner("coupling that the unit adds to", several=True)
LOOP = Owner("loop", several=True)
ELEMENT = Owner("force element")

# -- memory of links ---------------------------------------------------------------------------------------------------

ME, LME, MY_LANE = Store("me", LINK, RECORD), Store("lme", LINK, SLOT), Store("lane", LINK, LANE)
UP, LUP = Store("up", PARENT, RECORD), Store("lup", PARENT, SLOT)
MY_COLUMNS, UP_COLUMNS = Store("columns", LINK, COLUMN), Store("upcolumns", PARENT, COLUMN)
ROOTS, LROOTS, LANE_ROOTS = Store("root", ROOT, RECORD), Store("lroot", ROOT, SLOT), Store("laneroot", ROOT, LANE)
BASE, LBASE, LANE_BASE = (
    Store("base", BASE_LINK, RECORD),
    Store("lbase", BASE_LINK, SLOT),
    Store("lanebase", BASE_LINK, LANE),
)
PARTNERS, LPARTNERS = Store("partner", PARTNER, RECORD), Store("lpartner", PARTNER, SLOT)
GROUND, LGROUND = Store("ground", GROUND_LINK, RECORD), Store("lground", GROUND_LINK, SLOT)
ENDS, LANE_ENDS = Store("end", ELEMENT_END, RECORD), Store("laneend", ELEMENT_END, LANE)

# -- memory of ears, regions and couplings -----------------------------------------------------------------------------

EAR = Store("ear", EAR_ITSELF, EAR_RECORD)
REGION, LREGION = Store("region", REGION_ITSELF, REGION_RECORD), Store("lregion", REGION_ITSELF, REGION_LANE)
OWN, PAIR = Store("own", OWN_COUPLING, COUPLING_BLOCK), Store("pair", CHANGED_COUPLING, COUPLING_BLOCK)

# -- constants, and the design parameters that they depend on ------------------------------------------------------------

CONSTANTS, LOOP_CONSTANTS, ELEMENT_CONSTANTS = (
    Store("c", LINK, CONSTANT),
    Store("cl", LOOP, CONSTANT),
    Store("ce", ELEMENT, CONSTANT),
)
PARAMETER, DP = Store("parameter", LINK, PER_PARAMETER), Store("dp", LINK, PER_PARAMETER_LANE)
CL_PARAMETER, CL_DP = Store("clparameter", LOOP, PER_PARAMETER), Store("cldp", LOOP, PER_PARAMETER_LANE)
CE_PARAMETER, CE_DP = Store("ceparameter", ELEMENT, PER_PARAMETER), Store("cedp", ELEMENT, PER_PARAMETER_LANE)

# -- arguments and results by link -------------------------------------------------------------------------------------

COORDINATES, DQ = Store("q", LINK, PER_COORDINATE), Store("dq", LINK, PER_COORDINATE_LANE)
QDOT, DQDOT = Store("qdot", LINK, PER_COORDINATE), Store("dqdot", LINK, PER_COORDINATE_LANE)
QDOT_BAR = Store("qdot_bar", LINK, PER_COORDINATE)
STEP = Store("step", LINK, PER_COORDINATE)
SPEEDS, DU = Store("u", LINK, PER_SPEED), Store("du", LINK, PER_SPEED_LANE)
GIVEN_U = Store("given_u", LINK, PER_SPEED)
UDOT, DUDOT = Store("udot", LINK, PER_SPEED), Store("dudot", LINK, PER_SPEED_LANE)
TAU, DTAU = Store("tau", LINK, PER_SPEED), Store("dtau", LINK, PER_SPEED_LANE)
FORCE, DFORCE = Store("force", LINK, PER_SPEED), Store("dforce", LINK, PER_SPEED_LANE)
RIGHT_SIDE = Store("b", LINK, PER_SPEED_LANE)
MOTION, DMOTION = Store("prescribed", LINK, PER_MOTION), Store("dprescribed", LINK, PER_MOTION_LANE)
"""A prescribed coordinate, its rate and its acceleration."""
DRIVING, DDRIVING = Store("driving", LINK, PER_DRIVE), Store("ddriving", LINK, PER_DRIVE_LANE)
"""The generalised force that a prescribed motion requires."""
HELD, DHELD = Store("held_force", LINK, PER_DRIVE), Store("dheld_force", LINK, PER_DRIVE_LANE)
"""Joint forces along prescribed coordinates."""
TRIG = Store("trig", LINK, PER_ANGLE)
TURNS = Store("turn", LINK, TURN)
"""Rotation vector of a joint, with respect to which sines, cosines and rotation matrices are differentiated; not
stored."""

PIVOT, RANK = Store("pivot", LINK, MARGIN), Store("rank", LINK, MARGIN)
"""Values that must be positive."""

# -- arguments and results of other owners -------------------------------------------------------------------------------

POSITION, DPOSITION = Store("position", LOOP, PER_CONDITION), Store("dposition", LOOP, PER_CONDITION_LANE)
VELOCITY = Store("velocity", LOOP, PER_CONDITION)
CONDITION = Store("condition", LOOP, PER_LOOP)
REACTION, LOOP_REACTION = Store("reaction", LINK, WRENCH), Store("loop_reaction", LOOP, WRENCH)
DREACTION, DLOOP_REACTION = Store("dreaction", LINK, WRENCH_LANE), Store("dloop_reaction", LOOP, WRENCH_LANE)
KINETIC, DKINETIC = Store("energy", MODEL, ENERGY), Store("denergy", MODEL, ENERGY_LANE)
POTENTIAL, DPOTENTIAL = Store("potential", MODEL, ENERGY), Store("dpotential", MODEL, ENERGY_LANE)
MASSES, DMASSES = Store("masses", MODEL, SUM), Store("dmasses", MODEL, SUM_LANE)
"""Mass and first moment of the system."""
MOMENTA, DMOMENTA = Store("momenta", MODEL, SUM), Store("dmomenta", MODEL, SUM_LANE)
"""Linear and angular momentum of the system."""
COEFFICIENT, DCOEFFICIENT = (
    Store("coefficient", ELEMENT, COEFFICIENTS),
    Store("dcoefficient", ELEMENT, COEFFICIENTS_LANE),
)
"""Coefficients of force elements with an energy; they depend on time or inputs only if the energy does."""
DRIVE, DDRIVE = Store("drive", ELEMENT, COEFFICIENTS), Store("ddrive", ELEMENT, COEFFICIENTS_LANE)
"""Coefficients of force elements without an energy."""

FORCE_BAR, DFORCE_BAR = Store("force_bar", LINK, PER_SPEED), Store("dforce_bar", LINK, PER_SPEED_LANE)
TAU_BAR, DTAU_BAR = Store("tau_bar", LINK, PER_SPEED), Store("dtau_bar", LINK, PER_SPEED_LANE)
UDOT_BAR, DUDOT_BAR = Store("udot_bar", LINK, PER_SPEED), Store("dudot_bar", LINK, PER_SPEED_LANE)
MOTION_BAR, DMOTION_BAR = Store("prescribed_bar", LINK, PER_MOTION), Store("dprescribed_bar", LINK, PER_MOTION_LANE)
COEFFICIENT_BAR, DCOEFFICIENT_BAR = (
    Store("coefficient_bar", ELEMENT, COEFFICIENTS),
    Store("dcoefficient_bar", ELEMENT, COEFFICIENTS_LANE),
)
DRIVE_BAR, DDRIVE_BAR = Store("drive_bar", ELEMENT, COEFFICIENTS), Store("ddrive_bar", ELEMENT, COEFFICIENTS_LANE)
"""Adjoints of the missing joint forces (the virtual motion), of joint forces, udot, prescribed motion and coefficients."""
DRIVING_BAR = Store("driving_bar", LINK, PER_DRIVE)
HELD_BAR, DHELD_BAR = Store("held_force_bar", LINK, PER_DRIVE), Store("dheld_force_bar", LINK, PER_DRIVE_LANE)
"""Adjoints of the forces that prescribed motion requires, and of the model's own forces on prescribed coordinates."""
GQ, DGQ = Store("gq", LINK, PER_COORDINATE), Store("dgq", LINK, PER_COORDINATE_LANE)
GU, DGU = Store("gu", LINK, PER_SPEED), Store("dgu", LINK, PER_SPEED_LANE)
GP, DGP = Store("gp", LINK, PER_PARAMETER), Store("dgp", LINK, PER_PARAMETER_LANE)
CE_GP, CE_DGP = Store("cegp", ELEMENT, PER_PARAMETER), Store("cedgp", ELEMENT, PER_PARAMETER_LANE)
CL_GP, CL_DGP = Store("clgp", LOOP, PER_PARAMETER), Store("cldgp", LOOP, PER_PARAMETER_LANE)
"""Gradients of a weighted sum."""

KINETIC_BAR, DKINETIC_BAR = Store("energy_bar", MODEL, ENERGY), Store("denergy_bar", MODEL, ENERGY_LANE)
POTENTIAL_BAR, DPOTENTIAL_BAR = Store("potential_bar", MODEL, ENERGY), Store("dpotential_bar", MODEL, ENERGY_LANE)
MASSES_BAR, DMASSES_BAR = Store("masses_bar", MODEL, SUM), Store("dmasses_bar", MODEL, SUM_LANE)
MOMENTA_BAR, DMOMENTA_BAR = Store("momenta_bar", MODEL, SUM), Store("dmomenta_bar", MODEL, SUM_LANE)
"""Adjoints of energies and of sums over all links."""

MULTIPLIER, DMULTIPLIER = Store("multiplier", LOOP, PER_CONDITION), Store("dmultiplier", LOOP, PER_CONDITION_LANE)
MULTIPLIER_BAR, DMULTIPLIER_BAR = (
    Store("multiplier_bar", LOOP, PER_CONDITION),
    Store("dmultiplier_bar", LOOP, PER_CONDITION_LANE),
)
"""Multipliers of the loops' conditions, which are their wrenches, and adjoints of these."""
GAP, DGAP = Store("gap", LOOP, PER_CONDITION), Store("dgap", LOOP, PER_CONDITION_LANE)
GAP_BAR, DGAP_BAR = Store("gap_bar", LOOP, PER_CONDITION), Store("dgap_bar", LOOP, PER_CONDITION_LANE)
RATE_GAP, DRATE_GAP = Store("rate_gap", LOOP, PER_CONDITION), Store("drate_gap", LOOP, PER_CONDITION_LANE)
RATE_GAP_BAR, DRATE_GAP_BAR = (
    Store("rate_gap_bar", LOOP, PER_CONDITION),
    Store("drate_gap_bar", LOOP, PER_CONDITION_LANE),
)
ACCELERATION_GAP, DACCELERATION_GAP = (
    Store("acceleration_gap", LOOP, PER_CONDITION),
    Store("dacceleration_gap", LOOP, PER_CONDITION_LANE),
)
ACCELERATION_GAP_BAR, DACCELERATION_GAP_BAR = (
    Store("acceleration_gap_bar", LOOP, PER_CONDITION),
    Store("dacceleration_gap_bar", LOOP, PER_CONDITION_LANE),
)
"""Values of the loops' conditions in position, velocity and acceleration, all zero, and their adjoints."""
GAP_RIGHT_SIDE = Store("gap_b", LOOP, PER_CONDITION_LANE)
"""Right sides of the conditions in a solution with the mass matrix of a model with loops."""
COORDINATE_FORCE, DCOORDINATE_FORCE = (
    Store("coordinate_force", LINK, PER_SPEED),
    Store("dcoordinate_force", LINK, PER_SPEED_LANE),
)
"""The gradient with respect to coordinates, converted to degrees of freedom."""

TANGENT_OF = {
    SPEEDS: DU,
    COORDINATES: DQ,
    MOTION: DMOTION,
    COEFFICIENT: DCOEFFICIENT,
    DRIVE: DDRIVE,
    MASSES: DMASSES,
    MOMENTA: DMOMENTA,
}
"""The stores of the seeds of arguments, and those of the tangents of sums."""
