"""Helpers for tests of outputs: outputs drawn for random models, values by name, and derivatives along the motion."""

from __future__ import annotations

import importlib.util
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from random_models import vector

from codegen.model import ModelError, parse_model
from codegen.model.model import GROUND, Model, Output, Point, Vector

Array = np.ndarray
Draw = Callable[[np.random.Generator, Model], list[Output]]

TREE = """
model: measured
gravity: [0.5, 0, -9.81]
parameters: {length: 1.1, mass: 0.8, tilt: 0.3}
inputs: [pull]
bodies:
  stand: {parent: ground, joint: {type: fixed, at: [length, 0.2, 0], rotate: [{axis: x, angle: tilt}]}, mass: 2*mass,
          com: [0.1, length, 0]}
  arm: {parent: ground, joint: {type: revolute, axis: -y}, mass: mass, com: [0, 0.1, -length/2],
        inertia: {xx: 0.1, yy: 0.12, zz: 0.05, xy: 0.01}}
  hand: {parent: arm, joint: {type: spherical, at: [0, 0, -length]}, mass: 0.7, com: [0, 0.05, -0.2],
         inertia: {xx: 0.02, yy: 0.025, zz: 0.015}}
  ring: {parent: hand, joint: {type: fixed, at: [0.1, 0.2, -0.3], rpy: [0.3, tilt, 0.1]}, mass: 0.3, com: [0, 0, 0.1],
         inertia: {xx: 0.01, yy: 0.01, zz: 0.01}}
  hull: {parent: ground, joint: {type: free}, mass: 1.3, com: [0.1, 0, 0.2],
         inertia: {xx: 0.3, yy: 0.2, zz: 0.25, yz: 0.02}}
  wheel: {parent: hull, joint: {type: revolute, axis: [0.2, 1, tilt], at: [0.1, 0, 0.2]}, mass: 0.4, com: [0.1, 0.02, 0],
          inertia: {xx: 0.03, yy: 0.02, zz: 0.02}}
points:
  tip: {body: ring, at: [0.1, length/4, 0.3]}
  rim: {body: wheel, at: [0.2, 0, -0.1]}
forces:
  drive: {type: joint, joint: arm, value: pull*sin(t) - 0.2*u.arm}
  spring: {type: spring, from: rim, to: hand, stiffness: 30*(1 + pull), damping: 0.5, free_length: 0.5}
outputs:
"""
"""A tree with every way in which a body can lie in its link."""

FLOATING = """
model: floating
gravity: GRAVITY
inputs: [pull]
bodies:
  hull: {parent: ground, joint: {type: free}, mass: 2, com: [0.1, 0, 0.2], inertia: {xx: 0.3, yy: 0.2, zz: 0.25, yz: 0.02}}
  arm: {parent: hull, joint: {type: revolute, axis: [1, 1, 0], at: [0, 0.3, 0]}, mass: 0.8, com: [0, 0.1, -0.4],
        inertia: {xx: 0.1, yy: 0.12, zz: 0.05}}
  hand: {parent: arm, joint: {type: spherical, at: [0, 0, -0.8]}, mass: 0.7, com: [0, 0.05, -0.2],
         inertia: {xx: 0.02, yy: 0.025, zz: 0.015}}
  slide: {parent: hull, joint: {type: prismatic, axis: x, at: [0, 0, 0.5]}, mass: 0.5, inertia: {xx: 0.1, yy: 0.1, zz: 0.1}}
forces:
  drive: {type: joint, joint: arm, value: pull*sin(t) - 0.2*u.arm}
  spring: {type: spring, from: {body: hand, at: [0, 0, -0.3]}, to: slide, stiffness: 30, damping: 0.5, free_length: 0.5}
outputs:
"""
"""A tree that nothing holds: what acts inside changes no momentum."""


def outputs_of(text: str) -> str:
    """The lines of the section ``outputs``, from lines that may be indented."""
    return "".join(f"  {line.strip()}\n" for line in text.strip().splitlines())


def problems(entry: str) -> list[str]:
    """The messages about errors in one output of the tree."""
    try:
        parse_model(f"{TREE}  o: {entry}\n")
    except ModelError as error:
        return [str(p) for p in error.problems]
    return []


class Seen:
    """Outputs of a reference engine by name, and their derivatives in time along the motion."""

    def __init__(self, engine: Any, *state: Any):
        model = engine.model
        q, u, p, inputs, t = state
        qdot, udot = engine.coordinate_rates(q, u, p, inputs, t), engine.accelerations(q, u, p, inputs, t)
        values, rates = engine.output_sensitivities(q, u, p, inputs, t, dq=qdot, du=udot, dt=[1.0])
        names = [o.name for o in model.outputs]
        self.value = dict(zip(names, np.asarray(values, float), strict=True))
        self.rate = dict(zip(names, np.asarray(rates, float)[0], strict=True))

    def vector(self, name: str) -> Array:
        """The vector of the three outputs ``name_x``, ``name_y`` and ``name_z``."""
        return np.array([self.value[f"{name}_{i}"] for i in "xyz"])

    def rates(self, name: str) -> Array:
        return np.array([self.rate[f"{name}_{i}"] for i in "xyz"])


# -- random outputs ------------------------------------------------------------------------------------------------------


def draws() -> Iterator[Draw]:
    """The functions ``draw`` of the tests of the measures, one in each test file."""
    for file in sorted((Path(__file__).parent / "outputs").glob("test_*.py")):
        spec = importlib.util.spec_from_file_location(f"drawing_{file.stem}", file)
        assert spec is not None and spec.loader is not None
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
        if hasattr(module, "draw"):
            yield module.draw


def with_outputs(rng: np.random.Generator, model: Model) -> Model:
    """The model with its own outputs, and outputs of every measure that has a ``draw``."""
    drawn = [o for draw in draws() for o in draw(rng, model)]
    named = tuple(replace(o, name=f"{o.name}_{i}") for i, o in enumerate(drawn))
    return replace(model, outputs=(*model.outputs, *named))


def some_body(rng: np.random.Generator, model: Model) -> int:
    return int(rng.integers(len(model.bodies)))


def some_axis(rng: np.random.Generator, model: Model) -> Vector:
    """A coordinate axis, or an axis whose components are numbers and a parameter."""
    if rng.random() < 0.3:
        return (vector(1, 0, 0), vector(0, 0, -1))[int(rng.integers(2))]
    names = [p.name for p in model.parameters]
    last = names[int(rng.integers(len(names)))] if names else "0.4"
    return vector(round(float(rng.uniform(0.2, 1)), 3), round(float(rng.uniform(-1, 1)), 3), last)


def some_point(rng: np.random.Generator, model: Model, body: int | None = None) -> Point:
    """A random point of a body, or sometimes of the ground."""
    if body is None:
        body = GROUND if rng.random() < 0.1 else some_body(rng, model)
    x, y, z = (round(float(e), 3) for e in rng.uniform(-0.5, 0.5, 3))
    return Point("", body, vector(x, y, z))
