"""Motions whose final states were computed once, each by an independent method."""

from __future__ import annotations

from ...measure.models import changed, example
from ..problem import Goal, Motion, Setting, tolerances

# Andrews' squeezing mechanism (Test Set for IVP Solvers; A03 of the IFToMM library): seven bodies, three loops, 0.03 s.
ANDREWS_END = (
    15.810771195153704691, -15.756371058411837046, 0.040822240119646751159, -0.53473011634207794399, 0.52440996587995403308,
    0.53473011634207770118, 1.0480807410419377723,
)  # fmt: skip
"""The angles beta, Theta, gamma, Phi, delta, Omega and epsilon at 0.03 s, rad."""

ANDREWS = Motion(
    name="andrews",
    title="Andrews' squeezing mechanism, 0.03 s",
    text=lambda: example("andrews"),
    end=0.03,
    quantities=tuple(f"q.k{i}" for i in range(1, 8)),
    exact=lambda: ANDREWS_END,
    source="computed again by Gragg-Bulirsch-Stoer extrapolation of order 16 from the index-1 equations of the Test Set for "
    "IVP Solvers, in 80-bit numbers with 600 steps; 300 steps agree to 1e-13, and the energy balance holds to 9e-16 "
    "J. The 16 digits printed by the Test Set are correct to about 1e-10",
    settings=(*tolerances("dop853", 5, 14), Setting("dop853", 7e-14, 7e-14), *tolerances("radau", 5, 13)),
    quick=tolerances("dop853", 9, 9) + tolerances("radau", 8, 8),
    within=1e-5,
    goals=(Goal(1e-12, evaluations=3500), Goal(1e-10, seconds=0.01)),
)

# A04 of the IFToMM library: Bricard's mechanism, one loop of six revolute joints with one redundant condition.
BRICARD = Motion(
    name="bricard",
    title="A04, Bricard's mechanism, 10 s",
    text=lambda: example("bricard"),
    end=10.0,
    quantities=("x", "y", "z"),
    exact=lambda: (0.9997309873038327, -0.9999999638258171, -0.00026897651225189534),
    source="computed in the polar angle of the closure curve (1 + sin alpha)(1 + sin beta) = 1, with energies from the "
    "kinematics of the rods, 1024 Fourier coefficients and DOP853 at 1e-13; the loops close to 3e-15, the energy "
    "drifts by 6e-13 J",
    settings=tolerances("dop853", 5, 14) + tolerances("radau", 5, 13),
    quick=tolerances("dop853", 8, 8) + tolerances("radau", 6, 6),
    within=1e-5,
    goals=(Goal(1e-9), Goal(1e-8, seconds=0.01)),
)

# A05 of the IFToMM library: a stiff flyball governor with eigenvalues from -7403 to 7i per second.
FLYBALL = Motion(
    name="flyball",
    title="A05, a stiff flyball governor, 10 s",
    text=lambda: example("flyball"),
    end=10.0,
    quantities=("height",),
    exact=lambda: (0.6196229170613666,),
    source="computed in the two coordinates of the symmetric motion, with the angular momentum about the shaft conserved, by"
    " DOP853 at 1e-11 (412 000 evaluations); Radau at 1e-11 agrees to 8 digits",
    settings=tolerances("dop853", 5, 12) + tolerances("radau", 5, 13),
    quick=tolerances("radau", 7, 7),
    within=1e-5,
    goals=(Goal(1e-7),),
)

# The cart has a millionth of the mass of the pendulum's bob. The pendulum reaches 4429 rad/s for a microsecond, eleven
# times in 10 s.
CART_POLE_TEXT = """\
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
    text=lambda: CART_POLE_TEXT,
    end=10.0,
    quantities=("q.pole", "u.pole", "q.cart", "u.cart"),
    exact=lambda: (-1.5491294418948281698, 0.65212777497647409792, 1.9997632824687276547, -0.014128457807169226871),
    source="one quadrature, t(theta), from the conservation of momentum and energy, in 40 digits; proposed by N. Parsons for"
    " the IFToMM library (light-cartpole-benchmark)",
    settings=tolerances("dop853", 5, 14) + tolerances("radau", 7, 12),
    quick=tolerances("dop853", 9, 9),
    within=1e-6,
    goals=(Goal(1e-6),),
)

# CHAIN(4) for 5 s with derivatives with respect to the length of the rods; `ordernm bench --peers` compares programs on it.
RODS = 4
ANGLES = (-0.23433117203060152193, 0.028574050956611388793, -0.13486517489853769978, 0.32255523538455153714)
BY_LENGTH = (0.07334979262674368285, -1.2520856904143540374, -0.25336031277269753588, 0.7743732997239442641)

CHAIN_MOTION = Motion(
    name="chain_motion",
    title="a chain of four rods, 5 s",
    text=lambda: changed("chain", "{n: 12,", f"{{n: {RODS},"),
    end=5.0,
    quantities=tuple(f"q.link_{k}" for k in range(1, RODS + 1)),
    exact=lambda: ANGLES,
    source="computed by Gragg-Bulirsch-Stoer extrapolation of order 16 with a hand-written articulated-body algorithm, on "
    "dual 80-bit numbers with 100 steps; 60 steps agree to 6e-17 in the angles and 3e-16 in their derivatives",
    settings=tolerances("dop853", 5, 13) + tolerances("radau", 5, 11),
    quick=tolerances("dop853", 8, 8),
    within=1e-8,
    derivatives=lambda: (BY_LENGTH,),
    sensitivities=("L",),
)

PROBLEMS = (ANDREWS, BRICARD, FLYBALL, CART_POLE, CHAIN_MOTION)
