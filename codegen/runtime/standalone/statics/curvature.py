"""Second derivatives of equilibria with respect to parameters and inputs.

Let w be a small motion, q(w, p) the closed coordinates, and ``g(q, p) = 0`` the accelerations of the independent speeds at
rest, with ``J = dg/dw``; indices w and p mean derivatives. Along dp, an equilibrium moves by the w of ``J w = -g_p dp``. With
mu from ``J^T mu = -q_w^T c``, the gradient of ``c . q`` in p is that of ``l = c . q + mu . g`` at fixed w and mu. Its change:

    J w = -g_p dp        r = tangent of l_w        J^T nu = -r        d(gradient) = tangent of l_p + g_p^T nu

The tangents of l_w and l_p are products with Hessians along (w, dp) at fixed mu.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ....html_tables import html_of, shapes_of, shapes_text
from ..arrays import Array, Numbers
from ..calls.arguments import Seeds
from ..calls.package import EQUILIBRIA
from ..calls.room import alone
from ..state.hessians import Hessians
from ..state.weighted_gradients import WeightedGradients
from ..warning import warn
from .equilibrium import neutral_directions, rests
from .statics import AT_REST, Statics

NEEDED = {
    "accelerations", "sensitivities", "coordinate_rates", "coordinate_rate_sensitivities", "hessian_products",
    "sensitivities_transposed",
}  # fmt: skip
"""The generated functions from which the products are composed."""


class EquilibriumProducts(NamedTuple):
    """Products of the Hessian of an equilibrium with k directions.

    Attributes
    ----------
    p : ndarray (k, np)
        The entries for the design parameters.
    inputs : ndarray (k, ninputs)
        The entries for the inputs.
    """

    p: Array
    inputs: Array

    def __repr__(self) -> str:
        return f"<EquilibriumProducts along {len(self.p)} directions: {shapes_text(self._asdict().items())}>"

    def _repr_html_(self) -> str:
        return html_of([repr(self)], ("by", "shape", "largest"), shapes_of(self._asdict().items()))


def equilibrium_products(
    statics: Statics, hessians: Hessians, gradients: WeightedGradients, given: tuple[Any, ...], weights: Numbers,
    dp: Numbers, dinputs: Numbers,
) -> EquilibriumProducts:  # fmt: skip
    """See `Solver.equilibrium_hessian_products`; `given` holds q, p, inputs and t."""
    if not statics._functions.keys() >= NEEDED:
        raise AttributeError(statics._why_not(EQUILIBRIA))
    q, p, inputs, t = given
    at, space = statics._point(q, 0.0, p, inputs, t), statics._tangent_space()
    arguments = statics._arguments
    (along, k), batch = Seeds.take(arguments, {"dp": dp, "dinputs": dinputs}, at.named(), ())
    alone(batch)
    c = arguments.array("weights_q", weights, "q")
    if c.shape != at.q.shape:
        raise ValueError(f"weights_q has shape {c.shape}, expected {at.q.shape}")
    m = statics._motions(space, at)
    if not rests(m.udot, m.J, AT_REST):
        worst = int(np.argmax(np.abs(m.udot)))
        raise ValueError(
            f"q is not an equilibrium: {space.speed_names[worst]} accelerates by {m.udot[worst]:.2g} (rad/s^2 or m/s^2); "
            f"pass the q of an Equilibrium"
        )
    statics._look_at_rank(EQUILIBRIA, at, space, AT_REST)
    if len(neutral := neutral_directions(m.J)):
        name = statics.coordinate_names[int(np.argmax(np.abs(neutral[0] @ m.tangents)))]
        warn(
            f"equilibrium_hessian_products: {name} may rest anywhere (Equilibrium.neutral); second derivatives are NaN"
        )
        return EquilibriumProducts(*(np.full((k, n), np.nan) for n in (statics.np, statics.ninputs)))
    dp, dinputs = (along.get(n, np.zeros((k, x.size))) for n, x in (("dp", at.p), ("dinputs", at.inputs)))
    pushes = statics._accelerations_along(at, dp=dp, dinputs=dinputs)[1][:, space.speeds]
    dq = np.linalg.solve(m.J, -pushes.T).T @ m.tangents
    mu = np.linalg.solve(m.J.T, -(m.tangents @ c)) @ space.units
    of_udot = hessians.products("accelerations", (*at, mu), (dq, None, dp, dinputs, None))
    closed = statics._assembled_along(at, dq, dp)[2]
    of_q = hessians.of_assembled(tuple(at), c, None, (closed, None, dp, dinputs, None))
    rows = (of_udot.q + of_q.q) @ m.tangents.T
    by_q = gradients.of("sensitivities_transposed", tuple(at), (mu[None],)).q[0]
    for i in arguments.quaternions:  # a small rotation w moves a quaternion e along its sphere: d^2 e = -|de|^2 e
        e = slice(i, i + 4)
        rows -= (at.q[e] @ by_q[e]) * (dq[:, e] @ m.tangents[:, e].T)
    nu = np.linalg.solve(m.J.T, -rows.T).T @ space.units
    rest = gradients.of("sensitivities_transposed", tuple(at), (nu,))
    return EquilibriumProducts(of_udot.p + of_q.p + rest.p, of_udot.inputs + of_q.inputs + rest.inputs)
