"""An attraction by the inverse square of the distance: Newton's law of gravitation, Coulomb's law of charges."""

from ..line_law import Coefficient, LineLaw

LAW = LineLaw(
    "inverse_square",
    "An attraction like gravity; a negative `strength` gives a repulsion, like that of equal charges.",
    {"strength": Coefficient("N m^2", "the force at a distance of one metre: of two masses m and M, G m M")},
    force="-strength/distance**2",
    energy="-strength/distance",
    other_words=("gravitation", "coulomb"),
)
