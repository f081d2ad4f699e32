"""A pendulum on a cart that weighs a millionth of its bob: 4429 rad/s for a microsecond, eleven times in 10 s."""

from __future__ import annotations

from ..problem import Goal, Motion, tolerances

TEXT = """\
model: light_cart_pole
gravity: [0, 0, -9.81]
bodies:
  cart:
    parent: ground
    joint: {type: prismatic, axis: x}
    mass: 1.0e-6
  pole:
    parent: cart
    joint: {type: revolute, axis: -y}
    mass: 1.0
    com: [0, 0, -1]
initial:
  q: {pole: pi/2}
"""

CART_POLE = Motion(
    name="cart_pole",
    title="a light cart with a pole, 10 s",
    text=lambda: TEXT,
    end=10.0,
    quantities=("q.pole", "u.pole", "q.cart", "u.cart"),
    exact=lambda: (-1.5491294418948281698, 0.65212777497647409792, 1.9997632824687276547, -0.014128457807169226871),
    source="momentum and energy leave one quadrature, t(theta), in 40 digits; a problem that N. Parsons proposed for the IFToMM "
    "library (light-cartpole-benchmark)",
    settings=tolerances("dop853", 5, 14) + tolerances("radau", 7, 12),
    quick=tolerances("dop853", 9, 9),
    within=1e-6,
    goals=(Goal(1e-6),),
)
PROBLEMS = (CART_POLE,)
