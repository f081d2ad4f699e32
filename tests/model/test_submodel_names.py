"""Every kind of name in the file of a submodel: names have the meaning that they have in the file alone."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from codegen.model import load_model
from codegen.reference import DenseEngine

PART = """\
model: part
parameters: {k: 20, L: 0.5, hook: [0.1, 0, 0.2], gear: -2}
inputs: [pull]
constants: {way: 0.1}
tables:
  lift: {x: [0, 1, 2], y: [0, k, 1], outside: linear}
  repeat i in 1..2:
    cam(i): {x: [0, 1, 2], y: [0, i, 0], kind: cubic, outside: periodic}
expressions:
  gap: max(0, -position.tip.z - 2)
  turn: q.arm + lift(q.slide)
bodies:
  arm: {parent: ground, joint: {type: revolute, axis: y}, mass: 1, com: [0, 0, -L], inertia: {xx: 1, yy: 1, zz: 1}}
  slide: {parent: arm, joint: {type: prismatic, axis: z}, mass: 1, inertia: {xx: 1, yy: 1, zz: 1}}
  wheel: {parent: ground, joint: {type: revolute, axis: y, at: hook}, mass: 1, inertia: {xx: 1, yy: 1, zz: 1}}
  crank: {parent: ground, joint: {type: revolute, axis: y, at: [1, 0, 0]}, mass: 1, inertia: {xx: 1, yy: 1, zz: 1}}
  coupler: {parent: crank, joint: {type: revolute, axis: y, at: [0, 0, 0.5]}, mass: 1, inertia: {xx: 1, yy: 1, zz: 1}}
  rocker: {parent: ground, joint: {type: revolute, axis: y, at: [2, 0, 0]}, mass: 1, inertia: {xx: 1, yy: 1, zz: 1}}
  driven: {parent: slide, joint: {type: revolute, axis: x}, mass: 1, com: [0, 0.1, 0], inertia: {xx: 1, yy: 1, zz: 1}}
  bead: {parent: ground, joint: {type: free}, mass: 1, inertia: {xx: 1, yy: 1, zz: 1}}
points:
  tip: {body: slide, at: [0, 0, -L]}
  repeat i in 1..2:
    pin(i): {body: crank, at: [0, 0, 0.1*i]}
motion: {driven: 0.3*sin(2*t) + pull}
loops:
  close: {joint: {type: revolute, axis: y}, from: {body: coupler, at: [1, 0, 0]}, to: {body: rocker, at: [0, 0, 0.5]}}
couplings:
  mesh: {joint: wheel, follows: {arm: gear}}
forces:
  motor: {type: joint, joint: arm, value: pull - k*turn}
  rub: {type: friction, joint: slide, coulomb: 0.1, velocity: 0.1}
  stop: {type: limit, joint: slide, lower: -1, upper: 1, stiffness: k, width: 0.1}
  up: {type: force, on: tip, value: [0, 0, 30*gap + cam_2(position.pin(2).x)]}
  spring: {type: spring, from: tip, to: {body: wheel, at: [0, 0, 1]}, stiffness: k, free_length: L}
  twist: {type: torque, on: bead, value: [0, velocity.bead.x, 0], axes: body}
  mount: {type: bushing, from: {body: rocker, at: [0, 0, 0]}, to: {body: arm, at: [0, 0, 0]}, damping: [1, 1, 1]}
  coil: {type: torsion, from: ground, to: crank, axis: y, stiffness: k}
  cylinder: {type: actuator, from: pin_1, to: bead, force: "20*distance(pin(1), bead) + rate(tip, bead)"}
initial: {q: {arm: 0.1, bead: [1, 2, 3, 1, 0, 0, 0], slide: way, coupler: 0.1}, u: {arm: 0.2}}
independent: [crank, arm]
outputs:
  drive: {driving_force: driven}
  place: {position: tip, axis: z}
  speed: {velocity: {body: bead, at: [0, 0, 0]}, axis: x}
  pull: {acceleration: tip, axis: x}
  spin: {angular_velocity: arm, axis: y}
  middle: {center_of_mass: [arm, slide], axis: x}
  whole: {center_of_mass: system, axis: x}
  apart: {distance: [tip, ground]}
  between: {relative_position: [tip, pin(2)], axis: x}
  closing: {relative_velocity: [tip, pin_1], axis: z}
  swing: {momentum: angular, axis: y, about: ground}
  attitude: {rotation: bead, entry: xx}
  energy: kinetic_energy
  height: {value: q.arm + u.crank*k}
"""
OUTER = """\
model: outer
bodies:
  base: {parent: ground, joint: {type: fixed}}
submodels:
  leg: {use: part.yaml, on: base}
"""


def test_a_model_with_every_key_means_the_same_as_a_submodel(tmp_path: Path) -> None:
    (tmp_path / "part.yaml").write_text(PART)
    (tmp_path / "outer.yaml").write_text(OUTER)
    alone, used = load_model(tmp_path / "part.yaml"), load_model(tmp_path / "outer.yaml")
    assert [n.removeprefix("leg_") for n in used.coordinate_names] == list(alone.coordinate_names)
    assert [o.name for o in used.outputs] == [f"leg_{o.name}" for o in alone.outputs]
    one, other = DenseEngine(alone), DenseEngine(used)
    rng = np.random.default_rng(1)
    q, u = rng.uniform(0.1, 1, len(alone.coordinate_names)), rng.uniform(-1, 1, len(alone.speed_names))
    q[[alone.coordinate_names.index(f"bead.q{c}") for c in "wxyz"]] = 0.5
    for name in ("accelerations", "outputs", "energies", "driving_forces"):  # loops need not be closed for that
        a, b = (getattr(engine, name)(q, u, inputs=np.full(len(alone.inputs), 0.3), t=0.4) for engine in (one, other))
        np.testing.assert_allclose(a, b, rtol=1e-9, atol=1e-9)
