"""Joints of bodies in trees and in loops: properties that joints of every type must have, in generated code and both engines."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from comparison import compare, error, transposes, worst
from random_models import random_seeds, random_state

import codegen
from codegen.loops.partition import partition
from codegen.model import Model, parse_model
from codegen.reference import DenseEngine, RecursiveEngine

TREE = """
model: tree
gravity: [0.5, 0, -9.81]
parameters: {k: 1.1, l: 0.5, w: 1.2}
inputs: [pull]
bodies:
  a: {parent: ground, joint: JOINT, mass: 1, com: [0.1, 0.2*k, -0.4], inertia: {xx: 0.1, yy: 0.15, zz: 0.12, xy: 0.01}}
  b: {parent: a, joint: {type: spherical, at: [0.1, 0, -l]}, mass: k, com: [0.2, 0, -0.4],
    inertia: {xx: 0.1, yy: 0.1, zz: 0.14}}
  c: {parent: b, joint: JOINT, mass: 1.3*k, com: [0.2, 0.1, 0.1], inertia: {xx: 0.13, yy: 0.1, zz: 0.14}}
  d: {parent: c, joint: {type: revolute, axis: [1, 0, w], at: [0.1, 0.2, l]}, mass: 0.7, com: [0.2, 0.1, 0.1],
    inertia: {xx: 0.1, yy: 0.1, zz: 0.14}}
  e: {parent: a, joint: JOINT, mass: 0.9, com: [0.1, 0.3, -0.4], inertia: {xx: 0.1, yy: 0.12, zz: 0.1}}
forces:
  motor: {type: joint, joint: c, value: FORCE}
  rope: {type: spring, from: {body: c, at: [0.1, l, 0]}, to: {body: ground, at: [1, 2, 3]}, stiffness: 20*k, damping: 0.5,
    free_length: l}
outputs:
  height: {position: {body: d, at: [0.1, 0, l]}, axis: z}
  speed: {velocity: {body: d, at: [0.1, 0, l]}, axis: [1, 0, w]}
  kinetic: kinetic_energy
  potential: potential_energy
"""
"""A joint on the ground, in a branch under a ball, and at a branch's end."""

LOOP = """
model: loop
gravity: [0.5, 0, -9.81]
parameters: {k: 1.1, l: 0.5, w: 1.2}
bodies:
  base: {parent: ground, joint: BASE, mass: 2, com: [0.1, 0.2*k, 0.1], inertia: {xx: 0.3, yy: 0.35, zz: 0.32}}
  a: {parent: base, joint: {type: spherical, at: [0.3, 0, 0.2]}, mass: 1, com: [0.1, 0.2, -0.4],
    inertia: {xx: 0.1, yy: 0.15, zz: 0.12}}
  b: {parent: a, joint: JOINT, mass: k, com: [0.2, 0.1, -0.4], inertia: {xx: 0.1, yy: 0.12, zz: 0.14}}
  c: {parent: base, joint: JOINT, mass: 0.9, com: [0.1, 0.3, -0.4], inertia: {xx: 0.1, yy: 0.12, zz: 0.1}}
  d: {parent: c, joint: {type: universal, axes: [y, x], at: [0.1, 0.2, l]}, mass: 0.7, com: [0.2, 0.1, 0.1],
    inertia: {xx: 0.1, yy: 0.1, zz: 0.14}}
loops:
  rod: {joint: CLOSING, from: {body: b, at: [0.1, 0, -l]}, to: {body: d, at: [0.2*w, 0.1, 0.3]}}
forces:
  motor: {type: joint, joint: b, value: FORCE}
outputs:
  height: {position: {body: d, at: [0.1, 0, l]}, axis: z}
  speed: {velocity: {body: b, at: [0.1, 0, l]}, axis: [1, 0, w]}
  kinetic: kinetic_energy
"""
"""A loop on a base with joints on both sides of it."""


def with_joint(text: str, joint: str, count: int, **more: str) -> Model:
    """The model `TREE` or `LOOP` with a joint of `count` degrees of freedom; `joint` is the text of its type and further keys."""
    entry = f"{{type: {joint}, at: [0.1, 0.2*k, 0.3], rotate: [{{axis: [1, 2, 0], angle: 0.3*w}}]}}"
    force = ["k*pull - 0.3*u.b.wx", "sin(t)", "k"][:count] if "pull" in text else ["k*t", "sin(t)", "k"][:count]
    text = text.replace("FORCE", f"[{', '.join(force)}]" if count > 1 else force[0])
    for name, value in more.items():
        text = text.replace(name, value)
    return parse_model(text.replace("JOINT", entry))


def tree_errors(joint: str, count: int, folder: Path, target: str = "numpy") -> dict[str, float]:
    """Errors of every function of the tree's solver, and of the recursive engine, against the dense engine."""
    model = with_joint(TREE, joint, count)
    package = codegen.generate(model, folder, target=target, compile="all").folder
    found = compare(model, codegen.load(package, target), DenseEngine(model), np.random.default_rng(1))
    return found | engine_errors(model, random_state(np.random.default_rng(2), model))


def loop_errors(
    joint: str, count: int, folder: Path, *, independent: str, closing: str, base: str, target: str = "numpy"
) -> dict[str, float]:
    """The same for the loop. Of the coordinates of this joint's bodies, those in `independent` are independent."""
    text = LOOP + f"independent: [{independent}]\n"
    model = with_joint(text, joint, count, CLOSING=closing, BASE=base)
    package = codegen.generate(model, folder, target=target, compile="all").folder
    solver, engine, rng = codegen.load(package, target), DenseEngine(model), np.random.default_rng(3)
    _, u, p, _, t = random_state(rng, model)
    q, u = solver.assemble(solver.initial[0] + 0.05 * rng.normal(size=model.nq), u, p)
    seeds, state = random_seeds(rng, model, 3), (q, u, p, [], t)
    found = {"closed": float(max(np.abs(x).max() for x in solver.closure(q, u, p)))}
    pairs = {"sensitivities": {}, "output_sensitivities": {}, "coordinate_rate_sensitivities": {"dq", "du", "dp"}}
    for name, some in pairs.items():
        (x, dx), (y, dy) = (
            getattr(e, name)(*state, **{n: s for n, s in seeds.items() if not some or n in some}) for e in (solver, engine)
        )  # fmt: skip
        found[name] = max(error(x, y), worst(dx, dy))
    ours, theirs = solver.jacobians(*state), engine.jacobians(*state)
    for name in ("q", "u", "p"):
        found[f"J.{name}"] = worst(getattr(ours, name).T, np.asarray(getattr(theirs, name), dtype=float).T)
    return found | transposes(solver, state, rng) | engine_errors(model, state) | power_error(solver, model, state)


def dependents(joint: str, count: int, *, independent: str, closing: str, base: str) -> set[str]:
    """Names of the dependent speeds of the loop."""
    model = with_joint(LOOP + f"independent: [{independent}]\n", joint, count, CLOSING=closing, BASE=base)
    found = partition(model)
    return {name for i, name in enumerate(model.speed_names) if i not in found.independent}


def engine_errors(model: Model, state: tuple[Any, ...]) -> dict[str, float]:
    """The largest differences between the recursive and the dense engine."""
    seeds = random_seeds(np.random.default_rng(4), model, 2)
    (x, dx), (y, dy) = (e(model).sensitivities(*state, **seeds) for e in (RecursiveEngine, DenseEngine))
    return {"engines": max(worst([x], [y]), worst(dx, dy))}


def power_error(solver: codegen.Solver, model: Model, state: tuple[Any, ...]) -> dict[str, float]:
    """The difference of the rate of the energies and the power of the joint forces; constraints must do no work."""
    q, u, p, inputs, t = state
    rates, udot = solver.coordinate_rates(q, u, p), solver.accelerations(*state)
    _, (dT, dV) = solver.energy_sensitivities(q, u, p, inputs, t, dq=[rates], du=[udot], dp=np.zeros((1, len(p))))
    values = dict(zip((x.name for x in model.parameters), p, strict=True)) | {"t": t}
    power = 0.0
    for force in model.forces:
        speeds = model.coordinate_slices[force.body][1]
        power += sum(float(e.evaluate(values)) * x for e, x in zip(force.values, u[speeds], strict=True))
    return {"power": abs(float(dT[0] + dV[0]) - power) / max(1.0, abs(power))}


def accelerations_and_mujocos(joint: str, joints: str, q: Any, u: Any) -> tuple[Any, Any]:
    """Accelerations of a link on a joint with a hinged link on it, by ordernm and by MuJoCo with elementary joints."""
    mujoco = pytest.importorskip("mujoco")
    model = parse_model(f"""
model: m
gravity: [0, 0, -9.81]
bodies:
  a: {{parent: ground, joint: {joint}, mass: 1, com: [0.2, 0.1, -0.4], inertia: {{xx: 0.1, yy: 0.15, zz: 0.12}}}}
  b: {{parent: a, joint: {{type: revolute, axis: x, at: [0.2, 0, -1]}}, mass: 1.3, com: [0.1, 0, -0.4],
    inertia: {{xx: 0.1, yy: 0.12, zz: 0.11}}}}
""")
    theirs = mujoco.MjModel.from_xml_string(f"""
<mujoco><compiler angle="radian"/><option gravity="0 0 -9.81"><flag constraint="disable"/></option><worldbody>
<body>{joints}<inertial pos="0.2 0.1 -0.4" mass="1" diaginertia="0.1 0.15 0.12"/>
<body pos="0.2 0 -1"><joint type="hinge" axis="1 0 0"/><inertial pos="0.1 0 -0.4" mass="1.3" diaginertia="0.1 0.12 0.11"/>
</body></body></worldbody></mujoco>""")
    data = mujoco.MjData(theirs)
    data.qpos[:], data.qvel[:] = q, u
    mujoco.mj_forward(theirs, data)
    return DenseEngine(model).accelerations(q, u), data.qacc
