"""The fields of the mechanics: all values that blocks store for other blocks, with shape, unit, axes and meaning.

The glossary in the documentation is printed from this table. Names are those of the generated code. In units, ``u`` is the unit
of a degree of freedom (rad or m), and ``[..., ...]`` are the units of angular and linear parts. Values per direction have the
same names, in slots and lanes, unless another name is given.

A field has a short name, from which components and local variables are named (``w.y``, ``up_w_y``). Its name in the memory of
generated code (``me->omega_y``) is that of this table or of `CALLED`.
"""

from __future__ import annotations

from dataclasses import replace

from ..program.field import (
    AccelerationField,
    AnyField,
    BlockField,
    EarShiftField,
    Field,
    MatrixField,
    ScalarField,
    ShiftField,
    SixField,
    SymmetricField,
    TwistField,
    VectorField,
)
from ..program.field_table import list_fields
from ..records import dataclass

OWN, PARENT, GROUND, REGION, LINK = "the link", "the parent", "the ground", "the region (its base)", "its own link"
WRENCH, TWIST, INERTIA = "[N m, N]", "[rad/s, m/s]", "[kg m^2, kg m, kg]"
ACCELERATION, DISPLACEMENT = "[rad/s^2, m/s^2]", "[rad, m]"

NO_LINK_READS = "every pivot is compared with quantities that are computed anyway"
NO_FORCE_READS = "no force element reads it"
NO_EAR_STARTS = "no other ear starts from the link"
"""Reasons why some fields are never read."""


@dataclass(frozen=True)
class MotionFields:
    """Fields of a link's motion: angular velocity, angular acceleration, acceleration of the origin, and B."""

    w: VectorField
    al: VectorField
    a: VectorField
    B: MatrixField

    def __call__(self, *numbers: int) -> MotionFields:
        """The fields of one member of a numbered family of fields."""
        return MotionFields(self.w(*numbers), self.al(*numbers), self.a(*numbers), self.B(*numbers))


@dataclass(frozen=True)
class InertiaFields:
    """Fields of a generalised inertia: blocks of moments, of mass, and of their coupling."""

    J: SymmetricField
    M: SymmetricField
    H: MatrixField


def _inertia(prefix: str, frame: str, meaning: str, propagated: bool) -> InertiaFields:
    J, M, H = (("kg m^2", "moments"), ("kg", "mass"), ("kg m", "their coupling"))
    return InertiaFields(
        SymmetricField(f"{prefix}J", J[0], frame, f"{meaning}: {J[1]}", propagated=propagated),
        SymmetricField(f"{prefix}M", M[0], frame, f"{meaning}: {M[1]}", propagated=propagated),
        MatrixField(f"{prefix}H", H[0], frame, f"{meaning}: {H[1]}", propagated=propagated),
    )


def _motion(
    w: VectorField, prefix: str, frame: str, how: str, turning: str = "", unread: str = "", of: str = " of the origin"
) -> MotionFields:
    """Fields of motion, described by a text that ends with `how`, or with `turning` for B."""
    return MotionFields(
        w,
        VectorField(f"{prefix}al", "rad/s^2", frame, f"angular acceleration{how}", unread=unread),
        VectorField(f"{prefix}a", "m/s^2", frame, f"acceleration{of}{how}", unread=unread),
        MatrixField(f"{prefix}B", "1/s^2", frame, f"alpha x + omega x omega x{turning or how}", unread=unread),
    )


# -- constants of a link -----------------------------------------------------------------------------------------------

mass = ScalarField("m", "kg", "", "mass of a link")
first_moment = VectorField("h", "kg m", OWN, "mass times centre of mass, from the origin")
inertia = SymmetricField("J", "kg m^2", OWN, "inertia about the origin")
joint_place = VectorField("r", "m", PARENT, "origin of the joint in the parent")
joint_attitude = MatrixField("R", "1", PARENT, "parent components from joint components, at q = 0")
joint_factor = ScalarField("factor", "m/rad", "", "displacement per angle of a joint, such as a screw's pitch")
armature = ScalarField("rotor{}", "kg m^2 or kg", "", "reflected inertia of the rotor that turns with a speed")
face_place = VectorField(
    "{}.r", "m", LINK, "origin of a face of a loop joint (A: start, B: end), or attachment point of a force element"
)
face_axes = MatrixField(
    "{}.F", "1", LINK, "link components from those of a face, of a loop joint or of a force element"
)
coupling_factor = ScalarField("factor{}", "u/u", "", "factor of a coordinate in a coupling")
coupling_offset = ScalarField("offset", "u", "", "sum of the coordinates of a coupling, each times its factor")
surface_part = ScalarField(
    "part{}", "any", "", "subexpression without coordinates of the equation of a condition on a point, or its length"
)
cosine, sine = ScalarField("cos", "1", "", "cosine of an angle"), ScalarField("sin", "1", "", "sine of an angle")

# -- motion of a link --------------------------------------------------------------------------------------------------

quaternion_matrix = MatrixField(
    "Q", "1", PARENT, "rotation matrix of a quaternion, joint components from link components"
)
turn = ScalarField("turn.{}", "rad", OWN, "component of the rotation vector of a quaternion's seed")
attitude = MatrixField("W", "1", GROUND, "rotation matrix, ground from link components", unread=NO_FORCE_READS)
position = VectorField("pos", "m", GROUND, "position of the origin", unread=NO_FORCE_READS)
attitude_turn = VectorField("rot", "rad", GROUND, "rotation vector of a direction, for second derivatives")
angular_velocity = VectorField("w", "rad/s", OWN, "angular velocity (omega)")
parents_velocity = VectorField("wp", "rad/s", OWN, "angular velocity of the parent, along the link's axes")
velocity = VectorField("v", "m/s", OWN, "velocity of the origin")
applied_twist = TwistField(
    "v", TWIST, OWN, "angular velocity and velocity of the origin, computed for force elements", unread=NO_FORCE_READS
)
remainder = _motion(
    angular_velocity, "", OWN, " with udot = 0; along directions: tangent of the total",
    " with udot = 0; along directions: tangent of the total",
)  # fmt: skip
total = _motion(angular_velocity, "t", OWN, ", total", " with the total alpha")
ear_own = replace(
    total, w=VectorField("tw", "rad/s", OWN, "angular velocity of a link of an ear", unread=NO_EAR_STARTS)
)
moving = _motion(
    VectorField("gw", "rad/s", OWN, "angular velocity, computed with accelerations for outputs"), "g", OWN,
    " relative to the ground, for outputs",
)  # fmt: skip
explicit_acceleration = AccelerationField(
    "b",
    ACCELERATION,
    OWN,
    "part of the angular acceleration and the acceleration of the origin that is explicit in udot or due to gravity",
)

# -- forces on a link --------------------------------------------------------------------------------------------------

needed = SixField("", WRENCH, OWN, "moment about the origin and force that a link's motion with udot = 0 requires")
total_needed = SixField("t", WRENCH, OWN, "moment about the origin and force that a link's total motion requires")
external = SixField("ext.", WRENCH, OWN, "moment about the origin and force of the force elements on a link")
articulated = _inertia("acc.", OWN, "articulated inertia propagated by the children", True)
moment_scale = ScalarField(
    "acc.sJ",
    "kg m^2",
    "",
    "size of the children's moments of inertia (zero pivot)",
    propagated=True,
    unread=NO_LINK_READS,
)
mass_scale = ScalarField(
    "acc.sM", "kg", "", "size of the children's masses (zero pivot)", propagated=True, unread=NO_LINK_READS
)
articulated_force = SixField("acc.", WRENCH, OWN, "articulated force propagated by the children", propagated=True)
transmitted = SixField(
    "tacc.", WRENCH, OWN, "wrench that outboard joints transmit, with all accelerations known", propagated=True
)
inverse_pivot = ScalarField("Dinv.{}", "1/(kg u^2)", "", "one over the inertia along a degree of freedom (D of Eq. 47)")
right_side = ScalarField("rD.{}", "u/s^2", "", "driving force of a degree of freedom over its inertia (Eq. 53)")
gain = ScalarField(
    "G{}.{}",
    "1",
    OWN,
    "inertia over the inertia along the degree of freedom (Eq. 46), by degree and component; after the sixth, of partners",
)

driving_gain = ScalarField(
    "drive.{}",
    "[kg m^2, kg m] or [kg m, kg]",
    OWN,
    "inertia along a prescribed coordinate, by component of the acceleration; after the sixth, of partners",
)
driving_rest = ScalarField(
    "drive", "N m or N", "", "force that a prescribed coordinate requires with the explicit accelerations at zero"
)

# -- columns of matrices -----------------------------------------------------------------------------------------------

joint_force = SixField("phi.", WRENCH, OWN, "moment and force that the joint transmits, with all accelerations known")
turning_moment = MatrixField(
    "Tn", "N m s", OWN, "change of the articulated moment with the angular velocity", propagated=True
)
turning_push = MatrixField(
    "Tf", "N s", OWN, "change of the articulated force with the angular velocity", propagated=True
)
all_turning_moment = MatrixField("Wn", "N m s", OWN, "change of the total moment with the angular velocity")
all_turning_push = MatrixField("Wf", "N s", OWN, "change of the total force with the angular velocity")
turning_gain = ScalarField(
    "tg{}.{}", "1/s", OWN, "change of udot with the parent's angular velocity, by degree of freedom and component"
)
column_force = SixField("P.", WRENCH, OWN, "articulated force of a column")
column_drive = ScalarField(
    "cD.{}", "u/s^2", "", "driving force of a degree of freedom over its inertia, in a column (Eq. 53)"
)
column_turning = VectorField("dw", "rad/s", OWN, "change of the angular velocity in a column")
column_acceleration = AccelerationField("dA.", ACCELERATION, OWN, "change of the accelerations in a column")
seed_turning = VectorField(
    "ownw", "rad/s", OWN, "change of the angular velocity by the link's own coordinates and speeds"
)
seed_acceleration = AccelerationField(
    "sA.", ACCELERATION, OWN, "change of the accelerations by the link's own coordinates and speeds, with udot held"
)
composite_mass = ScalarField("comp.m", "kg", "", "mass of the link and everything outboard", propagated=True)
composite_moment = VectorField(
    "comp.h", "kg m", OWN, "first moment of the link and everything outboard", propagated=True
)
composite_inertia = SymmetricField(
    "comp.J", "kg m^2", OWN, "inertia of the link and everything outboard", propagated=True
)
composite_force = SixField(
    "F{}.", INERTIA, OWN, "force for a unit acceleration of a degree of freedom and of everything outboard"
)

# -- energies ----------------------------------------------------------------------------------------------------------

outboard_mass = ScalarField("sum.m", "kg", "", "mass of everything outboard", propagated=True)
outboard_moment = VectorField("sum.h", "kg m", OWN, "first moment of everything outboard", propagated=True)

# -- links on whose motion loops close: relative to the link that carries the whole loop --------------------------------

closing_attitude = MatrixField("cW", "1", "the origin", "attitude relative to the origin")
closing_position = VectorField("co", "m", "the origin", "position relative to the origin")
closing_twist = TwistField("c", TWIST, OWN, "angular velocity and velocity relative to the origin")
closing_shift = ShiftField(
    "c", DISPLACEMENT, OWN, "rotation vector and displacement of a direction, relative to the origin"
)
step = ShiftField("n", DISPLACEMENT, OWN, "rotation vector and displacement of Newton's step, relative to the origin")

# -- links of ears, along the axes of their region ---------------------------------------------------------------------

ear_attitude = MatrixField("sW", "1", REGION, "region components from link components")
ear_position = VectorField("o", "m", REGION, "position relative to the region's base", unread=NO_EAR_STARTS)
ear_inertia = SymmetricField("sJ", "kg m^2", REGION, "inertia about the origin")
ear_first_moment = VectorField("sh", "kg m", REGION, "mass times centre of mass")
per_source = TwistField(
    "Z{}.", "per unit of the source", REGION, "motion of a link per unit of a source (Gamma and Xi of Eq. 37)"
)
ear_remainder = _motion(
    VectorField("sw", "rad/s", REGION, "angular velocity", unread=NO_EAR_STARTS), "s", REGION, ", with the sources at rest",
    unread=NO_EAR_STARTS,
)  # fmt: skip
ear_total = _motion(ear_remainder.w, "ts", REGION, ", total", " with the total alpha", NO_EAR_STARTS)
ear_needed = SixField("s", WRENCH, REGION, "moment and force that a link's motion requires, with the sources at rest")
ear_total_needed = SixField("ts", WRENCH, REGION, "moment and force that a link's total motion requires")
ear_transmitted = SixField(
    "sacc.", WRENCH, REGION, "contribution of later ears to a link from which they start", propagated=True
)
root_transmitted = SixField(
    "oacc.", WRENCH, OWN, "contribution of later ears to a link from which they start", propagated=True
)
measured_position = VectorField("ro", "m", REGION, "position at which residuals are measured", unread=NO_EAR_STARTS)
measured_velocity = TwistField(
    "r", TWIST, REGION, "velocity at the given speeds; along directions: tangent of the velocity", unread=NO_EAR_STARTS
)
ear_step = ShiftField(
    "s",
    DISPLACEMENT,
    REGION,
    "rotation vector and displacement of Newton's step, relative to the base",
    unread=NO_EAR_STARTS,
)
shift = EarShiftField("", DISPLACEMENT, REGION, "rotation vector and displacement of a direction, relative to the base")
lever_tangent = VectorField("dr", "m", REGION, "tangent of the vector from the parent's origin to the link's")
arm_tangent = VectorField(
    "da{}{}",
    "m",
    REGION,
    "tangent of the vector from the origin to a face, by loop and side",
    unread="later blocks use the axes of the faces' own links",
)
dependent_acceleration = ScalarField(
    "x.{}", "u/s^2", "", "tangent of udot of a dependent degree of freedom, the sources' udot held"
)

closing_force = SixField("cf.", WRENCH, OWN, "moment about the origin and force of the loops' wrenches on a link")
tree_transmitted = SixField(
    "cacc.",
    WRENCH,
    OWN,
    "wrench that outboard joints of the tree transmit, with all accelerations known",
    propagated=True,
)
coupling_force = ScalarField(
    "cc.{}", "N m or N", "", "force of couplings along a degree of freedom, with opposite sign"
)

# -- ears --------------------------------------------------------------------------------------------------------------

dependent_rate = ScalarField(
    "Y{}.{}", "per unit of the source", "", "rate of a dependent degree of freedom with a source (Eq. 37)"
)
dependent_remainder = ScalarField(
    "y{}", "u/s^2", "", "udot of a dependent degree of freedom, with the sources at rest (Eq. 38)"
)
orthogonal_entry = ScalarField(
    "q{}.{}",
    "1",
    "",
    "entry of Q of the factored closure matrix, by column and condition",
    unread="the ear has one dependent degree of freedom, and its dependents have no remainder",
)
triangular_entry = ScalarField("R{}.{}", "1", "", "entry of R of the factored closure matrix, by columns")
inverse_diagonal = ScalarField("d{}", "1", "", "one over the diagonal of R")
multiplier_gain = SixField(
    "W{}.{}.", WRENCH, OWN, "force on a root by multipliers equal to a column of Q, by column and root"
)

surface_share = ScalarField(
    "share{}.{}", "any", "", "one over the length of the gradient of a condition on a point, by loop and condition"
)

# -- regions -----------------------------------------------------------------------------------------------------------

source_speed = ScalarField(
    "s{}", "u/s", "", "independent speed that is a source", unread="no motion of a root depends on it"
)
source_inertia = ScalarField("Q{}.{}", "kg u^2", "", "inertia along two sources (Eq. 40)")
source_force = ScalarField("g{}", "kg u^2/s^2", "", "force along a source (Eq. 41)")
source_to_base = SixField(
    "K{}.", "kg u [m, 1]", REGION, "inertia that couples a source and the base's six components (Eq. 39)"
)
source_to_partner = ScalarField(
    "P{}.{}.{}", "kg u [m, 1]", REGION, "inertia that couples a source and a partner's six components"
)
region_inertia = _inertia("I.", REGION, "inertia of a region that its base carries", False)
region_force = SixField("", WRENCH, REGION, "force of a region that its base carries")
source_inverse_pivot = ScalarField("Dinv{}", "1/(kg u^2)", "", "one over the inertia along a source (Eq. 47)")
source_right_side = ScalarField("rD{}", "u/s^2", "", "driving force of a source over its inertia (Eq. 53)")
source_gain = ScalarField("G{}.{}", "1", "", "inertia divided by that along the source (Eq. 46)")
source_driving_gain = ScalarField(
    "dG{}.{}",
    "kg u [m, 1]",
    "",
    "inertia that couples a prescribed source and accelerations known before the region's own",
)
source_driving_rest = ScalarField(
    "dr{}",
    "kg u^2/s^2",
    "",
    "force that a prescribed source requires if accelerations known before its region's are zero",
)
source_driving = ScalarField("drive{}", "kg u^2/s^2", "", "force that a prescribed source requires")
source_acceleration = ScalarField("a{}", "u/s^2", "", "acceleration of a source")
source_tangent_force = ScalarField("r{}", "kg u^2/s^2", "", "right side of the balance along a source")
region_transmitted = SixField(
    "t.", WRENCH, "the base", "contribution of ears to the base, with all accelerations known"
)
region_balance = SixField("b.", WRENCH, "the base", "tangent of the contribution of ears to the base")

far_attitude = MatrixField("far{}.W", "1", REGION, "attitude of a far link relative to the base")
far_position = VectorField("far{}.o", "m", REGION, "position of a far link relative to the base")
far_velocity = TwistField("far{}.", TWIST, REGION, "velocity of a far link relative to the base")
far_remainder = _motion(
    VectorField("far{}.aw", "rad/s", REGION, "angular velocity of a far link"), "far{}.", REGION,
    " of a far link with udot = 0", of="",
)  # fmt: skip
far_total = _motion(far_remainder.w, "far{}.t", REGION, " of a far link", of="")
far_own = _motion(
    VectorField("far{}.ow", "rad/s", "the far link", "angular velocity of a far link"), "far{}.o", "the far link",
    " of a far link", of="",
)  # fmt: skip
far_shift = EarShiftField(
    "far{}.", DISPLACEMENT, REGION, "rotation vector and displacement of a far link, relative to the base"
)
far_step = ShiftField(
    "far{}.n", DISPLACEMENT, REGION, "rotation vector and displacement of a far link in Newton's step"
)
far_transmitted = SixField(
    "far{}.t.", WRENCH, "the far link", "contribution of ears to a far link, with all accelerations known"
)
far_balance = SixField("far{}.b.", WRENCH, "the far link", "tangent of the contribution of ears to a far link")

# -- couplings ---------------------------------------------------------------------------------------------------------

coupling = BlockField("", INERTIA, "the two links", "inertia that couples two links, rows first")


def _listed() -> dict[str, AnyField]:
    """All fields, by their names in the generator."""
    found: dict[str, AnyField] = {}
    for name, value in list(globals().items()):
        if isinstance(value, Field):
            found[name] = value
        elif isinstance(value, (MotionFields, InertiaFields)):
            found |= {f"{name}.{part}": field for part, field in vars(value).items()}
    return found


FIELDS = _listed()
"""Every field by its name in the generator."""

CALLED = {
    "face_place": "{}_place", "face_axes": "{}_axes", "angular_velocity": "omega", "parents_velocity": "parent_omega",
    "remainder.al": "alpha", "remainder.a": "acceleration", "remainder.B": "B",
    "total.al": "total_alpha", "total.a": "total_acceleration", "ear_own.w": "own_omega", "moving.w": "moving_omega",
    "explicit_acceleration": "explicit", "needed": "", "total_needed": "total", "articulated_force": "articulated",
    "closing_twist": "closing", "closing_shift": "closing", "ear_remainder.w": "ear_omega", "ear_remainder.al": "ear_alpha",
    "ear_remainder.a": "ear_acceleration", "ear_remainder.B": "ear_B", "ear_total.al": "ear_total_alpha",
    "ear_total.a": "ear_total_acceleration", "ear_needed": "ear", "ear_total_needed": "ear_total",
    "measured_velocity": "measured", "shift": "", "source_gain": "gain_{}_{}", "region_force": "",
    "far_attitude": "far_{}_attitude", "far_position": "far_{}_position", "far_velocity": "far_{}",
    "far_remainder.w": "far_{}_remainder_omega", "far_remainder.al": "far_{}_alpha", "far_remainder.a": "far_{}_acceleration",
    "far_remainder.B": "far_{}_B", "far_total.al": "far_{}_total_alpha", "far_total.a": "far_{}_total_acceleration",
    "far_total.B": "far_{}_total_B", "far_own.w": "far_{}_own_omega", "far_own.al": "far_{}_own_alpha",
    "far_own.a": "far_{}_own_acceleration", "far_own.B": "far_{}_own_B", "far_shift": "far_{}", "far_step": "far_{}_step",
    "far_transmitted": "far_{}_transmitted", "far_balance": "far_{}_balance", "coupling": "inertia_",
}  # fmt: skip
"""Names of memory in generated code that differ from this table; ``{}`` are numbers."""
list_fields(FIELDS, CALLED)
