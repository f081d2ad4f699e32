"""Quantities of a body in the recursive engine, in the notation of the paper.

For body k with its parent Pr[k]; components in body k's own axes unless said otherwise:

======== ======= ==============================================================================================
C        (3, 3)  direction cosines: turns components in k into components in Pr[k]
gamma    (3, 1)  from the mass centre of Pr[k] to that of k, m
S        (6, 6)  shift: force systems at k's mass centre, in k, to Pr[k]'s mass centre, in Pr[k]
P        (6, f)  partial velocities P_k^k of the mass centre for the joint's f speeds
V        (6, 1)  angular velocity, rad/s, above velocity of the mass centre, m/s, relative to the ground
A_t      (6, 1)  acceleration remainder: all of the acceleration that is not explicit in udot
A_bar    (6, 1)  the part that is explicit in udot
I        (6, 6)  generalised inertia about the mass centre
R        (6, 1)  applied moments about, and forces at, the mass centre (the paper's bold F^k)
F        (6, 1)  generalised force
tau      (f, 1)  joint force, working on the joint's speeds
I_hat    (6, 6)  articulated inertia
F_hat    (6, 1)  articulated force
M        (f, f)  the block M_k of the triangularized mass matrix
T        (6, 6)  triangularization matrix
======== ======= ==============================================================================================
"""

from __future__ import annotations

from dataclasses import dataclass

from .pairs import Pair


@dataclass(slots=True)
class Terms:
    """The quantities of one body, named as in the module's table, each with its total derivatives.

    ``N_C (3, 3)`` turns components in k into components in the ground, ``x (3, 1)`` is the mass centre in the ground
    frame, m, ``com (3, 1)`` the mass centre in the body frame.
    """

    S: Pair
    P: Pair
    V: Pair
    A_t: Pair
    I: Pair
    F: Pair
    tau: Pair
    N_C: Pair
    x: Pair
    com: Pair
