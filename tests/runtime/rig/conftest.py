"""Two small solvers, generated once: one with every kind of argument and result, one with as few as possible."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import codegen
from codegen.model import parse_model

RIG = """
model: rig
gravity: [0, 0, -9.81]
parameters:
  length: {value: 0.8, unit: m}
  mass: 1.5
  wheel: {value: 0.02, unit: kg m^2}
inputs: [motor, wind]
bodies:
  arm:
    parent: ground
    joint: {type: revolute, axis: y}
    mass: mass
    com: [0, 0, -length/2]
    inertia: {xx: mass*length**2/12, yy: mass*length**2/12, zz: 1e-3}
  ball:
    parent: arm
    joint: {type: spherical, at: [0, 0, -length]}
    shape: {type: box, size: [0.2, 0.3, 0.4], mass: 2, center: [0, 0.1, -0.2]}
  disc:
    parent: arm
    joint: {type: revolute, axis: y, at: [0, 0.1, 0]}
    inertia: {yy: wheel}
forces:
  drive: {type: joint, joint: arm, value: motor - 0.1*u.arm + 0.5*sin(3*t)}
  air: {type: joint, joint: ball, value: [wind, -0.05*u.ball.wy, 0.3*wind*t]}
initial:
  q: {arm: 0.3}
  u: {ball.wx: 0.5}
outputs:
  height: {position: {body: ball, at: [0, 0.1, -0.2]}, axis: z}
  speed: {velocity: ball, axis: x}
  energy: kinetic_energy
  power: {value: motor*u.arm + t*wind}
"""

BARE = """
model: bare
bodies:
  slide:
    parent: ground
    joint: {type: prismatic, axis: x}
    mass: 2
  swing:
    parent: slide
    joint: {type: revolute, axis: y}
    mass: 1
    com: [0, 0, -0.5]
    inertia: {yy: 0.1}
"""

VALUES = {
    "accelerations": "q u p inputs t",
    "jacobians": "q u p inputs t",
    "coordinate_rates": "q u p inputs t",
    "mass_matrix": "q p",
    "inverse_mass_matrix": "q p",
    "solve_mass": "q b p",
    "inverse_dynamics": "q u udot p inputs t",
    "bias_force": "q u p inputs t",
    "energies": "q u p inputs t",
    "outputs": "q u p inputs t",
    "closure": "q u p inputs t",
    "assemble": "q u p inputs t",
}
"""Functions without directions, and the arguments they take."""

ALONG = {
    "sensitivities": "q u p inputs t",
    "coordinate_rate_sensitivities": "q u p inputs t",
    "mass_matrix_sensitivities": "q p",
    "solve_mass_sensitivities": "q b p",
    "inverse_dynamics_sensitivities": "q u udot p inputs t",
    "bias_force_sensitivities": "q u p inputs t",
    "energy_sensitivities": "q u p inputs t",
    "output_sensitivities": "q u p inputs t",
    "assemble_sensitivities": "q u p inputs t",
}
"""Functions over directions, and the arguments they take; every argument has a seed."""


@pytest.fixture(scope="session")
def rig_folder(tmp_path_factory) -> Path:
    """A package with parameters, inputs, time, gravity, outputs and nq != nu."""
    return codegen.generate(parse_model(RIG), tmp_path_factory.mktemp("packages") / "rig", compile="all").folder


@pytest.fixture(scope="session")
def bare_folder(tmp_path_factory) -> Path:
    """A package without parameters, inputs, time, gravity and outputs."""
    return codegen.generate(parse_model(BARE), tmp_path_factory.mktemp("packages") / "bare", compile="all").folder


@pytest.fixture(scope="session")
def rig(rig_folder):
    return codegen.load(rig_folder)


@pytest.fixture(scope="session", params=["c", "numpy"])
def either(request, rig_folder):
    """The solver with every kind of argument, for each target."""
    return codegen.load(rig_folder, request.param)


@pytest.fixture(scope="session", params=["c", "numpy"])
def either_bare(request, bare_folder):
    """The solver with as few arguments as possible, for each target."""
    return codegen.load(bare_folder, request.param)


def sizes(solver) -> dict[str, int]:
    """Lengths of the last axes of arguments."""
    return {"q": solver.nq, "u": solver.nu, "p": solver.np, "inputs": solver.ninputs, "udot": solver.nu, "b": solver.nu}


def draw(rng, solver, names, leads=None) -> dict:
    """Random arguments ``{name: (*lead, n)}``; a name with a d in front is a seed, its lead beginning with k."""
    drawn = {}
    for name in names:
        lead = (leads or {}).get(name, ())
        of = name[1:] if name.startswith("d") else name
        if of == "t":
            drawn[name] = rng.uniform(0.1, 2, lead) if lead else float(rng.uniform(0.1, 2))
        elif name == "p":
            drawn[name] = solver.parameters * rng.uniform(0.9, 1.1, (*lead, solver.np))
        else:
            drawn[name] = rng.uniform(-1, 1, (*lead, sizes(solver)[of]))
            if name == "q":
                for i, coordinate in enumerate(solver.coordinate_names):
                    drawn[name][..., i] += 2.0 * coordinate.endswith(".qw")
    return drawn


def flat(result) -> list:
    """The arrays of a result, taken out of its tuples."""
    if isinstance(result, tuple):
        return [a for part in result for a in flat(part)]
    if hasattr(result, "inputs"):  # Jacobians
        return [result.q, result.u, result.p, result.inputs, result.t]
    return [np.asarray(result)]


@pytest.fixture(scope="session")
def tools():
    """Functions that the tests in this folder share."""
    return SimpleNamespace(VALUES=VALUES, ALONG=ALONG, draw=draw, flat=flat, sizes=sizes, rig_model=parse_model(RIG))
