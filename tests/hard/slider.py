"""A slider-crank without friction; its motion follows from the crank's angle and a closed form of the energy."""

from __future__ import annotations

from typing import Any

import numpy as np

MODEL = """
model: slider_crank
gravity: [0, 0, -g]
parameters: {g: 9.81, crank: 0.5, rod: 1.3, mass: 2.0, flywheel: 0.5, w0: 6.0}
bodies:
  crank: {parent: ground, joint: {type: revolute, axis: -y}, inertia: {xx: flywheel, yy: flywheel, zz: flywheel}}
  rod:
    parent: crank
    joint: {type: revolute, axis: -y, at: [crank, 0, 0]}
    shape: {type: rod, axis: x, length: rod, mass: mass, center: [rod/2, 0, 0]}
  piston: {parent: ground, joint: {type: prismatic, axis: x}, mass: mass}
loops:
  pin: {joint: {type: inline, axis: y}, from: {body: rod, at: [rod, 0, 0]}, to: piston}
initial:
  q: {crank: 0.9, rod: -1.2, piston: 1.4}
  u: {SPEED}
independent: [INDEPENDENT]
outputs: {x: {value: q.piston}, kinetic: kinetic_energy}
"""


def model(independent: str) -> str:
    """The text of the model; if the crank is independent, motions begin at 0.9 rad with the speed w0."""
    speed = "crank: w0" if independent == "crank" else "piston: 0"
    return MODEL.replace("SPEED", speed).replace("INDEPENDENT", independent)


def places(angle: Any, crank: Any, rod: Any) -> tuple[Any, Any]:
    """The angle of the rod relative to the crank, and the position of the piston, on the initial branch."""
    tilt = np.arcsin(-crank / rod * np.sin(angle))  # of the rod against the axis
    return tilt - angle, crank * np.cos(angle) + rod * np.cos(tilt)


def energy(angle: Any, speed: Any, g: Any, crank: Any, rod: Any, mass: Any, flywheel: Any) -> Any:
    """The sum of kinetic and potential energy."""
    tilt = np.arcsin(-crank / rod * np.sin(angle))
    tilting = -crank * np.cos(angle) * speed / (rod * np.cos(tilt))
    piston = -crank * np.sin(angle) * speed - rod * np.sin(tilt) * tilting
    x = -crank * np.sin(angle) * speed - rod / 2 * np.sin(tilt) * tilting
    z = crank * np.cos(angle) * speed + rod / 2 * np.cos(tilt) * tilting
    height = crank * np.sin(angle) + rod / 2 * np.sin(tilt)
    kinetic = flywheel * speed**2 + mass * (piston**2 + x**2 + z**2) + mass * rod**2 / 12 * tilting**2
    return kinetic / 2 + mass * g * height
