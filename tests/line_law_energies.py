"""Checks with sympy that the force of a law along a line is minus the derivative of its energy."""

from __future__ import annotations

import random

import sympy

from codegen.model.expressions import functions_for
from codegen.model.forces.line_law import LineLaw, LineLawError

DISTANCES = (0.3, 3.0)
"""m, at which energies are compared with forces."""
POINTS = 8
"""Number of random distances and coefficients at which force and energy are compared, where both have a value."""
TRIES = 100


def check_energy(law: LineLaw) -> None:
    """Check that the force at rest is minus the derivative of the energy with respect to the distance, at some values.

    The derivative is sympy's, of the formula as it stands; nothing of blocks is in it.

    Raises
    ------
    LineLawError
    """
    if law.potential is None:
        return
    functions = functions_for(sympy)
    names = {name: sympy.Symbol(name, real=True) for name in ("distance", "rate", *law.coefficients)}
    force = law.formula.evaluate({**names, "rate": sympy.Integer(0)}, functions)
    slope = -sympy.diff(law.potential.evaluate(names, functions), names["distance"])
    ranges = {"distance": DISTANCES, **{key: c.between for key, c in law.coefficients.items()}}
    drawn, compared = random.Random(0), 0
    for _ in range(TRIES):
        at = {name: round(drawn.uniform(*limits), 3) for name, limits in ranges.items()}
        values = [sympy.sympify(x).evalf(subs={names[n]: v for n, v in at.items()}) for x in (force, slope)]
        if not all(v.is_Float or v.is_Integer for v in values):
            continue
        acting, falling = map(float, values)
        if abs(acting - falling) > 1e-9 * max(abs(acting), abs(falling)):
            where = ", ".join(f"{name} = {value:g}" for name, value in at.items())
            raise LineLawError(
                f"{law.type}: at {where} the force at rest is {acting:.9g} N, but minus the derivative of its energy by the "
                f"distance is {falling:.9g} N; force {law.force!r} and energy {law.energy!r} do not belong together"
                + (
                    "; the sign of one is wrong"
                    if acting * falling < 0
                    else "; change one of them, or leave energy out"
                )
            )
        compared += 1
        if compared == POINTS:
            return
    raise LineLawError(
        f"{law.type}: force {law.force!r} and energy {law.energy!r} have values in {compared} of {TRIES} places only; "
        f"let `between` of its coefficients say where it has some"
    )
