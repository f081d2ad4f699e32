"""A block on a spring, whose motions are known in closed form: x = start cos(w t) + (u0/w) sin(w t), w^2 = stiffness/mass."""

import numpy as np

import codegen

MODEL = """
model: oscillator
parameters:
  mass: {value: 2.0, unit: kg, min: 0.1}
  stiffness: {value: 8.0, unit: N/m}
  damping: {value: 0.0, unit: N s/m}
  cubic: {value: 0.0, unit: N/m^3}
  start: {value: 0.5, unit: m}
inputs: [force]
bodies:
  block: {parent: ground, joint: {type: prismatic, axis: x}, mass: mass}
forces:
  spring: {type: joint, joint: block, value: force - stiffness*q.block - damping*u.block + cubic*q.block**3}
initial:
  q: {block: start}
outputs:
  x: {value: q.block}
  v: {value: u.block}
  effort: {value: force**2}
"""

FREE = {"stiffness": 0.0, "mass": 1.0, "start": 0.0}
"""The block without its spring, at rest."""


def oscillator(folder):
    """The solver of the oscillator."""
    codegen.generate(codegen.parse_model(MODEL), folder / "oscillator")
    return codegen.load(folder / "oscillator")


def swing(t, mass=2.0, stiffness=8.0, start=0.5):
    """The position of the block over time, and its derivatives with respect to mass, stiffness and start."""
    w = np.sqrt(stiffness / mass)
    x = start * np.cos(w * t)
    by_w = -start * np.sin(w * t) * t
    return x, {"mass": -by_w * w / (2 * mass), "stiffness": by_w * w / (2 * stiffness), "start": np.cos(w * t)}
