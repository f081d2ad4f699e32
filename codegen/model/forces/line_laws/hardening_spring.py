"""Duffing's spring, whose stiffness changes with its elongation."""

from ..line_law import Coefficient, LineLaw

STRETCH = "(distance - free_length)"

LAW = LineLaw(
    "hardening_spring",
    "A spring and damper whose stiffness grows with the square of the stretch; with a negative `hardening` it becomes softer.",
    {
        "stiffness": Coefficient("N/m", "at the free length"),
        "hardening": Coefficient("N/m^3", "of the cube of the stretch"),
        "damping": Coefficient("N s/m", "of the rate of the distance", default=0),
        "free_length": Coefficient("m", "the distance without force", default=0),
    },
    force=f"-stiffness*{STRETCH} - hardening*{STRETCH}**3 - damping*rate",
    energy=f"stiffness*{STRETCH}**2/2 + hardening*{STRETCH}**4/4",
    other_words=("duffing", "cubic_spring"),
)
