"""The cart-pole whose optimal swing-up is known: a point on a massless rod, without damping."""

CART_POLE = """
model: cart_pole
gravity: [0, 0, -g]
parameters:
  cart_mass: {value: 1.0, unit: kg}
  pole_mass: {value: 0.3, unit: kg}
  length: {value: 0.5, unit: m}
  g: {value: 9.81, unit: m/s^2}
inputs: [push]
bodies:
  cart: {parent: ground, joint: {type: prismatic, axis: x}, mass: cart_mass}
  pole: {parent: cart, joint: {type: revolute, axis: -y}, mass: pole_mass, com: [0, 0, -length]}
forces:
  rail: {type: joint, joint: cart, value: push}
"""
