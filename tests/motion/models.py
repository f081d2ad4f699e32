"""Models that the tests of motion share: random models with outputs of all kinds, and small ones with closed forms."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from emit.test_random_mechanisms import draw
from random_elements import with_random_elements
from random_models import expression, random_state, random_tree, vector
from split_mechanisms import by_hand

import codegen
from codegen.model.model import Model, Output, Parameter, Point

EXAMPLES = Path(__file__).parents[2] / "examples"

TAME = ("actuator", "hardening_spring")
"""Laws along a line under which points do not fall onto each other."""

Array = np.ndarray
Drawn = tuple[Model, Array | None, Array | None]


class Made(NamedTuple):
    """A solver with its model, initial state and parameters; None stands for those of the model."""

    solver: Any
    model: Model
    q: Array | None
    p: Array | None


FALLING = """
model: falling
parameters: {g: {value: 9.81, unit: m/s^2}, h: {value: 2.0, unit: m}, v: {value: 0.0, unit: m/s}, m: {value: 1.0, unit: kg}}
inputs: [push]
gravity: [0, 0, -g]
bodies:
  stone:
    parent: ground
    joint: {type: prismatic, axis: z}
    mass: m
    inertia: {xx: 0.1, yy: 0.1, zz: 0.1}
forces:
  push: {type: joint, joint: stone, value: push}
initial: {q: {stone: h}, u: {stone: v}}
outputs:
  z: {value: q.stone}
  w: {value: u.stone}
  force: {value: push}
  cube: {value: (q.stone - 1)**3}
  tiny: {value: 1e-12*q.stone}
"""
"""z = h + v t - g t^2/2 + push t^2/(2 m)."""

PENDULUM = """
model: pendulum
parameters: {g: {value: 9.81, unit: m/s^2}, L: {value: 1.0, unit: m}}
gravity: [0, -g, 0]
bodies:
  bob:
    parent: ground
    joint: {type: revolute, axis: z}
    mass: 1.0
    com: [0, -L, 0]
    inertia: {xx: 0, yy: 0, zz: 0}
points: {tip: {body: bob, at: [0, -L, 0]}}
initial: {q: {bob: -pi/2}}
outputs:
  x: {position: tip, axis: x}
  y: {position: tip, axis: y}
"""


def parsed(text: str) -> Drawn:
    return codegen.parse_model(text), None, None


def example(name: str) -> Drawn:
    return codegen.load_model(EXAMPLES / f"{name}.yaml"), None, None


def driven(body: str, force: str, initial: str = "", **extra: str) -> Drawn:
    """A body of unit mass on a prismatic joint with a force that depends on q and u."""
    text = f"""
model: driven
parameters: {{a: 1.0}}
bodies:
  stone:
    parent: ground
    joint: {{type: prismatic, axis: z}}
    mass: {body}
    inertia: {{xx: 0.1, yy: 0.1, zz: 0.1}}
forces:
  push: {{type: joint, joint: stone, value: "{force}"}}
initial: {{{initial}}}
outputs:
  z: {{value: q.stone}}
  w: {{value: u.stone}}
"""
    for old, new in extra.items():
        text = text.replace(old, new)
    return codegen.parse_model(text), None, None


def seen(model: Model) -> Model:
    """The model with outputs for position, velocity and energy of its last body."""
    tip = Point("tip", len(model.bodies) - 1, vector(0.3, -0.2, 0.7))
    outputs = (
        Output("height", "position", (tip,), vector(0, 0, 1)),
        Output("speed", "velocity", (tip,), vector(1, 2, 3)),
        Output("kinetic", "kinetic_energy"),
    )
    names = {o.name for o in model.outputs}
    return dataclasses.replace(model, outputs=(*model.outputs, *(o for o in outputs if o.name not in names)))


def tree(seed: int, n: int = 3, **options: Any) -> Drawn:
    """A random tree with random forces, at a random state and other parameters than its defaults."""
    rng = np.random.default_rng(seed)
    model = random_tree(rng, n, **options)
    q, _, p, *_ = random_state(rng, model)
    return with_random_elements(rng, model, laws=TAME), q, p


def ball(seed: int) -> Drawn:
    """A single body on a ball joint."""
    return tree(seed, 1, joints=("spherical",))


def mechanism(seed: int, scene: str = "spatial", **options: Any) -> Drawn:
    """A random mechanism with closed loops, in its assembled state."""
    drawn = draw(seed, scene=scene, bodies=(3, 4), loops=(1, 2), **options)
    assert drawn is not None
    return seen(drawn.model), None, None


def split(name: str) -> Drawn:
    """One of `split_mechanisms`, whose masses and heights of gravity are parameters."""
    model = by_hand(name).model
    last = model.bodies[-1]
    changed = dataclasses.replace(last, mass=expression("m*exp(a - 1)"), com=vector("0.1*a", -0.2, "0.3*m"))
    moved = dataclasses.replace(changed.joint, at=tuple(expression(f"({e})*a") for e in changed.joint.at))
    model = dataclasses.replace(
        model,
        parameters=(Parameter("a", 1.0), Parameter("m", 1.0)),
        bodies=(*model.bodies[:-1], dataclasses.replace(changed, joint=moved)),
    )
    return seen(model), None, None
