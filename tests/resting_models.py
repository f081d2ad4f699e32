"""A pendulum that a motor holds at rest."""

PENDULUM = """
model: pendulum
gravity: [0, 0, -9.81]
parameters: {l: 0.8, m: 1.5, J: 0.2, c: 0.1}
inputs: [motor]
bodies:
  rod: {parent: ground, joint: {type: revolute, axis: y}, mass: m, com: [0, 0, -l], inertia: {xx: 0, yy: J, zz: 0}}
forces:
  hinge: {type: joint, joint: rod, value: motor - c*u.rod}
initial: {q: {rod: 0.6}}
"""
