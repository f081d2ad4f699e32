"""Planar chains of total length and mass 1, straight and coiled: mass matrices of condition 4e12 without loss of digits.

Every joint of the coiled chain is at 22.5 degrees, so 16 rods make one turn. The condition of its mass matrix is 2.0e4, 1.1e6
and 1.1e8 for 10, 100 and 1000 rods. The straight chain is at 60 degrees to the vertical, and its mass matrix has the condition
4.4e4, 4.0e8 and 3.9e12.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import mpmath
import numpy as np

from ...measure import articulated_chain
from ..dual import cosine, sine
from ..problem import JOINT, SPEED, Evaluation, Family, Reference
from .families import DIGITS, along

TEXT = """\
model: planar_chain
gravity: [0, 0, -9.81]
constants: {{n: {n}}}
parameters:
  length: 1.0
bodies:
  repeat k in 1..n:
    rod(k):
      parent: rod(k-1)
      joint: {{type: revolute, axis: y, at: [0, 0, -length/n]}}
      shape: {{type: rod, axis: z, length: length/n, mass: 1/n, center: [0, 0, -length/n/2]}}
      first: {{parent: ground, joint: {{at: [0, 0, 0]}}}}
"""
DIRECTIONS = ("first joint", "middle joint", "all joints", "length", "all speeds")
"""Directions of differentiation. A straight chain turns as one body, so derivatives with respect to its speeds are left
out."""
ALL_TO, SOME = 100, 20
"""Largest chain in which each joint gives two directions, its angle and its speed; number of such joints in longer
chains."""


def planar(n: int, first: float, others: float) -> Evaluation:
    """A chain of n rods; `first` is the angle of its first joint, `others` that of all other joints, rad."""
    k = np.arange(1, n + 1)
    q, u = np.full(n, others), 0.2 * np.cos(k)
    q[0] = first
    names = list(DIRECTIONS if others else DIRECTIONS[:-1])
    each = np.arange(n) if n <= ALL_TO else np.linspace(0, n - 1, SOME).astype(int)
    first_joint = len(names)
    names += [f"{JOINT}{i + 1}" for i in each]
    first_speed = len(names)
    names += [f"{SPEED}{i + 1}" for i in each] if others else []
    dq, du, dp = np.zeros((len(names), n)), np.zeros((len(names), n)), np.zeros((len(names), 1))
    dq[first_joint + np.arange(len(each)), each] = 1.0
    dq[0, 0] = dq[1, n // 2] = dp[3] = 1.0
    dq[2] = np.sin(2.0 * k)
    if others:
        du[4] = np.cos(3.0 * k)
        du[first_speed + np.arange(len(each)), each] = 1.0

    def rates(q: Sequence[Any], u: Sequence[Any], length: Any) -> list[Any]:
        density = 1 / length  # the total mass is 1
        return articulated_chain.accelerations(
            list(q), list(u), length / n, sine, cosine, density, 0, mpmath.mpf(9.81), planar=True
        )

    def reference() -> Reference:
        return along(rates, q, u, 1.0, dq, du, dp)

    return Evaluation(TEXT.format(n=n), q, u, dq, du, dp, reference, tuple(names))


def straight(n: int) -> Evaluation:
    return planar(n, np.pi / 3, 0.0)


def coiled(n: int) -> Evaluation:
    return planar(n, np.pi / 8, np.pi / 8)


SOURCE = f"a hand-written articulated-body algorithm on dual numbers of {DIGITS} digits"
STRAIGHT = Family(
    "straight",
    "a straight planar chain, 60 degrees from the vertical",
    SOURCE,
    "rods",
    straight,
    (10, 100, 1000),
    (10,),
    1e-12,
)
COILED = Family(
    "coiled", "a coiled planar chain, 22.5 degrees at each joint", SOURCE, "rods", coiled, (10, 100, 1000), (10,), 1e-12
)
PROBLEMS = (STRAIGHT, COILED)
