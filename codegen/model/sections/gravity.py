"""Gravity: one acceleration for all bodies if it is constant in time, otherwise a force on each of them."""

from __future__ import annotations

from ..entries import ZERO
from ..forces import Force
from ..model import Vector
from ..places import GROUND, Point
from ..reading import Reader
from .bodies import BodySection
from .points import rigid_parts


def read_gravity(reader: Reader) -> Vector | None:
    """The vector, m/s^2, an expression of parameters, inputs and t; None if there is none."""
    at = reader.only("gravity")
    if at is None:
        return None
    vector = reader.vector(at, (), at.value, "inputs", "[x, y, z], m/s^2 in the ground frame")
    if vector is None:
        return None
    x, y, z = vector
    return None if x is ZERO and y is ZERO and z is ZERO else (x, y, z)


def is_constant(reader: Reader, gravity: Vector) -> bool:
    """Whether gravity depends on parameters only. Such gravity is equivalent to an acceleration of the ground, and has
    a potential."""
    return all(e.names <= reader.defaults.keys() for e in gravity)


def weights(gravity: Vector, bodies: BodySection) -> list[Force]:
    """The force on each body at its centre of mass, named ``gravity.BODY``; bodies rigidly fixed to the ground have none."""
    parts = rigid_parts(bodies)
    found = []
    for k, body in enumerate(bodies.bodies):
        if body.mass is ZERO or parts[k] == parts[GROUND]:
            continue
        x, y, z = (body.mass * g for g in gravity)
        name = f"gravity.{body.name}"
        found.append(Force(name, Point(f"{name}.on", k, body.com), (x, y, z)))
    return found
