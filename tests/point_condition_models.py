"""Texts of mechanisms with distances and with points on surfaces and curves."""

INERTIA = "inertia: {xx: 0.1, yy: 0.2, zz: 0.13, xy: 0.01}"
PLANAR = f"""
model: rodded
gravity: [0, 0, -9.81]
parameters: {{l: 0.7, r: 0.4}}
bodies:
  crank: {{parent: ground, joint: {{type: revolute, axis: y}}, mass: 1.5, com: [0, 0, 0.15], {INERTIA}}}
  rocker: {{parent: ground, joint: {{type: revolute, axis: y, at: [0.6, 0, 0]}}, mass: 1, com: [0.1, 0, 0.3], {INERTIA}}}
loops:
  rod: {{joint: {{type: distance, length: l}}, from: {{body: crank, at: [0, 0, r]}}, to: {{body: rocker, at: [0, 0, 0.6]}}}}
initial: {{q: {{crank: 0.3, rocker: 0.1}}}}
independent: [crank]
outputs: {{kinetic: kinetic_energy, potential: potential_energy}}
"""
SPATIAL = f"""
model: spatial
gravity: [0.3, 0.2, -9.81]
parameters: {{l: 0.7, r: 0.4, k: 0.8}}
bodies:
  base: {{parent: ground, joint: {{type: BASE}}, shape: {{type: box, size: [1, 0.5, 0.3], mass: 5}}}}
  arm: {{parent: base, joint: {{type: universal, axes: [x, y], at: [0.1, 0.2, 0.3]}}, mass: 1.5, com: [0, 0, 0.15], {INERTIA}}}
  ball: {{parent: arm, joint: {{type: spherical, at: [0.6, 0, 0]}}, mass: 1, com: [0.1, 0, 0.3], {INERTIA}}}
  other: {{parent: base, joint: {{type: cylindrical, axis: [0.3, 0.2, 1], at: [0.6, 0.3, 0]}}, mass: 1, com: [0.1, 0, 0.3],
    {INERTIA}}}
loops:
  rod: {{joint: {{type: distance, length: l}}, from: {{body: arm, at: [0, 0, r]}}, to: {{body: other, at: [0, 0.1, 0.6]}}}}
  bead:
    joint: {{type: surface, equation: "z - k*x**2 - 0.3*sin(y + r) + x*y*z**3"}}
    from: {{body: base, at: [0, 0.1, r], rpy: [0.3, 0.2, 0.1]}}
    to: {{body: ball, at: [0.2, 0.1, 0.5]}}
  wire:
    joint: {{type: curve, equations: ["z - k*x**2 - r", "y - r**2*sin(x)"]}}
    from: {{body: other, at: [0, 0.1, r], rpy: [0.3, 0.2, 0.1]}}
    to: {{body: ball, at: [0.2, 0.1, 0.1]}}
initial: {{q: {{arm: [0.3, 0.2], other: [0.1, 0.4]}}}}
outputs: {{kinetic: kinetic_energy, potential: potential_energy}}
"""
MODELS = {
    "planar rod": PLANAR,
    "in space": SPATIAL.replace("BASE", "fixed"),
    "on a free base": SPATIAL.replace("BASE", "free"),
}
