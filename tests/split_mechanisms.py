"""Mechanisms whose ball joints or free bodies cannot be dependent as a whole, assembled, for tests at every level."""

from __future__ import annotations

import dataclasses
from functools import cache

import numpy as np
from loops.mechanisms import rssr, three_rods
from random_mechanisms import Mechanism
from random_models import expression, vector

from codegen.loops import complete_speeds, partition

BY_HAND = {
    "rssr": rssr,
    "driven_rssr": lambda: dataclasses.replace(rssr(), independent=("crank",)),
    "rods_on_ground": lambda: three_rods(False),
    "rods_on_platform": lambda: three_rods(True),
}


@cache
def by_hand(name: str) -> Mechanism:
    """One of the mechanisms above with general masses and gravity, at its assembled initial configuration."""
    made = BY_HAND[name]()
    inertia = tuple(expression(x) for x in (1.1, 1.3, 1.6, 0.1, -0.2, 0.15))
    bodies = tuple(dataclasses.replace(b, com=vector(0.1, -0.2, 0.3), inertia=inertia) for b in made.bodies)
    made = dataclasses.replace(made, bodies=bodies, gravity=vector(1, 2, -9))
    chosen = partition(made)
    assert chosen.split(made)
    u = complete_speeds(made, chosen, chosen.q, np.cos(np.arange(made.nu)))
    return Mechanism(made, np.array(chosen.q), u, np.zeros(0), np.zeros(0), 0.0)
