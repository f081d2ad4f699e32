"""Energies of models without gravity and springs: the potential energy is zero in every function that uses it."""

import numpy as np
import pytest

import ordernm
from codegen.runtime import Integral

MODEL = """
model: free_wheel
parameters: {inertia: 0.2}
bodies:
  wheel:
    parent: ground
    joint: {type: revolute, axis: y}
    mass: 1
    com: [0, 0, 0.5]
    inertia: {xx: 0.1, yy: inertia, zz: 0.1}
  slider: {parent: wheel, joint: {type: prismatic, axis: z}, mass: 0.5}
initial: {q: {slider: 0.3}, u: {wheel: 1}}
outputs: {%s}
"""
OUTPUTS = ("potential: potential_energy", "potential: potential_energy, kinetic: kinetic_energy")


@pytest.mark.parametrize("outputs", OUTPUTS, ids=("alone", "beside kinetic energy"))
@pytest.mark.parametrize("target", ["numpy", "c"])
@pytest.mark.parametrize("layout", ["kinds", "unrolled"])
def test_the_potential_energy_is_zero_everywhere(tmp_path, outputs, target, layout):
    model = ordernm.parse_model(MODEL % outputs)
    ordernm.generate(model, tmp_path / "wheel", target=target, layout=layout)
    solver = ordernm.load(tmp_path / "wheel", target=target)
    q, u = solver.initial
    n = solver.noutputs
    many = np.tile(q, (40, 1)), np.tile(u, (40, 1))
    assert solver.outputs(q, u)[0] == 0.0
    values, along = solver.output_sensitivities(q, u, dq=np.eye(2), du=np.eye(2))
    assert values[0] == 0.0 and not along[:, 0].any()
    assert not solver.outputs(*many)[:, 0].any()
    gradients = solver.output_gradients(q, u, weights=np.eye(n))
    assert not any(x[0].any() for x in (gradients.q, gradients.u, gradients.p))
    run = solver.simulate(np.linspace(0.0, 0.3, 4), sensitivities="inertia")
    assert not run["potential"].any() and not run.derivative("potential", "inertia").any()
    kinetic, potential = solver.energies(q, u)
    assert potential == 0.0 and kinetic > 0.0
    if n == 2:
        assert solver.outputs(q, u)[1] == kinetic
    judged = solver.judge(0.3, Integral("potential"), wrt="inertia", method="adjoint")
    assert judged.values[0] == 0.0 and judged.gradients[0, 0] == 0.0
