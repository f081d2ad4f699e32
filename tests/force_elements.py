"""Force elements on a small tree and in a small loop: properties that every type must have, in generated code and in both
engines."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from comparison import compare, transposes, worst
from random_models import random_seeds, random_state

import codegen
from codegen.model import Model, parse_model
from codegen.model.errors import ModelError
from codegen.reference import DenseEngine, RecursiveEngine
from codegen.reference.engine import Engine

TREE = """
model: pushed
gravity: [0, 0, -9.81]
parameters: {k: 3, l: 0.5, w: 1.2}
inputs: [pull]
points:
  tip: {body: b, at: [0.1, l, -0.3]}
  top: {body: ground, at: [0.3, 0.2, 1]}
bodies:
  a: {parent: ground, joint: {type: revolute, axis: y}, mass: 1, com: [0, 0.1, -0.4], inertia: {xx: 0.1, yy: 0.15, zz: 0.12}}
  b: {parent: a, joint: {type: revolute, axis: [0.6, w, 0.8], at: [0, 0, -l]}, mass: 1, com: [0.2, 0, -0.4],
    inertia: {xx: 0.1, yy: 0.1, zz: 0.14}}
  c: {parent: b, joint: {type: fixed, at: [0.1, 0, 0.2], rpy: [0.1, l, 0.3]}, mass: 0.4, com: [0.2, 0.1, 0],
    inertia: {xx: 0.1, yy: 0.1, zz: 0.14}}
  d: {parent: a, joint: {type: spherical, at: [0.1, 0, l], rpy: [0.2, w, 0]}, mass: 1.3, com: [0.1, 0, -0.4],
    inertia: {xx: 0.1, yy: 0.12, zz: 0.1}}
forces:
ELEMENTS
outputs:
  stored: potential_energy
  height: {position: tip, axis: z}
"""
"""A chain with a branch; c is fixed to b. ``ELEMENTS`` are to be put in."""

LOOP = """
model: held
gravity: [0, 0, -9.81]
parameters: {k: 3, l: 0.5, w: 1.2}
inputs: [pull]
points:
  tip: {body: b, at: [0.1, 0.1, -0.3]}
  top: {body: ground, at: [0.3, 0.2, 1]}
bodies:
  a: {parent: ground, joint: {type: revolute, axis: y}, mass: 1, com: [0, 0.1, -0.4], inertia: {xx: 0.1, yy: 0.15, zz: 0.12}}
  b: {parent: a, joint: {type: revolute, axis: y, at: [0, 0, -1]}, mass: 1, com: [0.2, 0, -0.4],
    inertia: {xx: 0.1, yy: 0.1, zz: 0.14}}
  c: {parent: ground, joint: {type: revolute, axis: y, at: [1.5, 0, 0]}, mass: 0.4, com: [0.2, 0.1, 0],
    inertia: {xx: 0.1, yy: 0.1, zz: 0.14}}
  d: {parent: b, joint: {type: spherical, at: [0.1, 0, 0.5], rpy: [0.2, w, 0]}, mass: 1.3, com: [0.1, 0, -0.4],
    inertia: {xx: 0.1, yy: 0.12, zz: 0.1}}
loops:
  pin: {joint: {type: revolute, axis: y}, from: {body: b, at: [0, 0, -1.2]}, to: {body: c, at: [0, 0, -1.3]}}
initial: {q: {a: 0.2, b: -0.9, c: -0.1}}
forces:
ELEMENTS
outputs:
  stored: potential_energy
"""
"""A four-bar linkage with a body on its coupler."""


def with_elements(text: str, elements: str) -> Model:
    """The model `TREE` or `LOOP` with force elements."""
    return parse_model(
        text.replace("ELEMENTS", "\n".join(f"  {line.strip()}" for line in elements.strip().splitlines()))
    )


def tree_errors(elements: str, folder: Path, target: str = "numpy") -> dict[str, float]:
    """Errors of every function of the tree's solver, and of the recursive engine, against the dense engine."""
    model = with_elements(TREE, elements)
    package = codegen.generate(model, folder, target="both", compile="all" if target == "c" else False).folder
    found = compare(model, codegen.load(package, target), DenseEngine(model), np.random.default_rng(1))
    return found | engine_errors(model, random_state(np.random.default_rng(2), model))


def loop_errors(elements: str, folder: Path, target: str = "numpy") -> dict[str, float]:
    """The same for the loop, with the functions that models with loops have."""
    model = with_elements(LOOP, elements)
    package = codegen.generate(model, folder, target="both", compile="all" if target == "c" else False).folder
    solver, engine, rng = codegen.load(package, target), DenseEngine(model), np.random.default_rng(3)
    _, u, p, inputs, t = random_state(rng, model)
    q, u = solver.assemble(solver.initial[0] + 0.05 * rng.normal(size=model.nq), u)
    seeds, state = random_seeds(rng, model, 3), (q, u, p, inputs, t)
    found = {}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)
        for name in ("sensitivities", "energy_sensitivities", "output_sensitivities"):
            given = {n: s for n, s in seeds.items() if name != "energy_sensitivities" or n in ("dq", "du", "dp")}
            (x, dx), (y, dy) = (getattr(e, name)(*state, **given) for e in (solver, engine))
            pairs = [(x, y), (np.array(dx), np.array(dy))]
            found[name] = max(worst(np.atleast_2d(a), np.atleast_2d(np.asarray(b, float))) for a, b in pairs)
        ours, theirs = solver.jacobians(*state), engine.jacobians(*state)
        for name in ("inputs", "t"):
            found[f"J.{name}"] = worst([getattr(ours, name)], [getattr(theirs, name)])
        return found | transposes(solver, state, rng) | engine_errors(model, state)


def engine_errors(model: Model, state: tuple[Any, ...]) -> dict[str, float]:
    """The largest differences between the recursive and the dense engine."""
    seeds = random_seeds(np.random.default_rng(4), model, 2)
    (x, dx), (y, dy) = (e(model).sensitivities(*state, **seeds) for e in (RecursiveEngine, DenseEngine))
    return {"engines": max(worst([x], [y]), worst(dx, dy))}


def power(model: Model, state: tuple[Any, ...]) -> tuple[float, float, float]:
    """Of the elements on bodies at a state: power on the bodies, rate of the stored energy, of which what is by p, inputs and t
    is left out; and the largest component of all forces and of all moments about the ground's origin added up."""
    engine: Engine = DenseEngine(model)
    seen = engine._state(*state)
    motion = engine._motion(seen)
    done, force, moment = 0.0, np.zeros(3), np.zeros(3)
    for _, end, wrench in engine._wrenches(seen.pairs, motion):
        if wrench.force is not None:
            f = wrench.force.value[:, 0].astype(float)
            done += float(f @ end.v.value[:, 0])
            force, moment = force + f, moment + np.cross(end.x.value[:, 0].astype(float), f)
        if wrench.torque is not None:
            n = wrench.torque.value[:, 0].astype(float)
            done += float(n @ end.omega.value[:, 0])
            moment = moment + n
    q, u, p, inputs, t = state
    along = engine._state(q, u, p, inputs, t, dq=engine.coordinate_rates(q, u, p)[None], du=0 * np.asarray(u)[None],
                          dp=np.zeros((1, len(p))), dinputs=np.zeros((1, len(inputs))), dt=np.zeros(1))  # fmt: skip
    stored = engine._potential(along.pairs, engine._motion(along))
    rate = float(stored.tangent[0]) if np.ndim(stored.tangent) else 0.0
    return done, rate, float(max(np.abs(force).max(), np.abs(moment).max()))


MUJOCOS = """
<mujoco><compiler angle="radian"/><option gravity="0 0 -9.81"><flag constraint="disable"/></option><worldbody>
<body><joint type="hinge" axis="0 1 0"/><inertial pos="0 0.1 -0.4" mass="1" diaginertia="0.1 0.15 0.12"/>
<body pos="0.2 0 -1"><joint type="ball"/><inertial pos="0.1 0 -0.4" mass="1.3" diaginertia="0.1 0.12 0.11"/></body></body>
</worldbody></mujoco>"""
OURS = """
model: m
gravity: [0, 0, -9.81]
bodies:
  a: {parent: ground, joint: {type: revolute, axis: y}, mass: 1, com: [0, 0.1, -0.4], inertia: {xx: 0.1, yy: 0.15, zz: 0.12}}
  b: {parent: a, joint: {type: spherical, at: [0.2, 0, -1]}, mass: 1.3, com: [0.1, 0, -0.4],
    inertia: {xx: 0.1, yy: 0.12, zz: 0.11}}
forces:
ELEMENTS
"""
"""The same two links on a hinge and a ball."""


def accelerations_and_mujocos(
    elements: str, force: list[float], torque: list[float], at: list[float], in_body: bool
) -> tuple[Any, Any]:
    """Accelerations with elements, and MuJoCo's accelerations with a force and torque at a point of the second link."""
    mujoco = pytest.importorskip("mujoco")
    rng = np.random.default_rng(2)
    q, u = rng.normal(size=5), rng.normal(size=4)
    q[1:] /= np.linalg.norm(q[1:])
    model = mujoco.MjModel.from_xml_string(MUJOCOS)
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:] = q, u
    mujoco.mj_forward(model, data)
    R = data.xmat[2].reshape(3, 3)
    f, n = (R @ v if in_body else np.array(v, float) for v in (force, torque))
    mujoco.mj_applyFT(model, data, f, n, data.xpos[2] + R @ at, 2, data.qfrc_applied)
    mujoco.mj_forward(model, data)
    return DenseEngine(with_elements(OURS, elements)).accelerations(q, u), data.qacc


def problems(elements: str) -> list[str]:
    """The messages of the errors in force elements of the tree."""
    try:
        with_elements(TREE, elements)
    except ModelError as error:
        return [f"{p.path}: {p.message}" for p in error.problems if p.severity == "error"]
    return []
