"""Rotor inertias against `armature` in Pinocchio and MuJoCo."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from comparison import error

import codegen


def test_mass_matrix_inverse_dynamics_and_derivatives_are_pinocchios(tmp_path: Path) -> None:
    pin = pytest.importorskip("pinocchio", reason="compares with Pinocchio: pip install pin")
    rng, model, last = np.random.default_rng(1), pin.Model(), 0
    axis = np.array([0.6, 0.0, -0.8])
    for k, joint in enumerate(
        (
            pin.JointModelRX(),
            pin.JointModelRevoluteUnaligned(axis),
            pin.JointModelPY(),
            pin.JointModelHZ(0.2),
            pin.JointModelRY(),
        )
    ):
        last = model.addJoint(last, joint, pin.SE3.Random(), f"j{k}")
        model.appendBodyToJoint(last, pin.Inertia.Random(), pin.SE3.Identity())
    model.rotorInertia, model.rotorGearRatio = rng.uniform(1e-4, 1e-2, model.nv), rng.uniform(5, 20, model.nv)
    model.armature = model.rotorInertia * model.rotorGearRatio**2
    codegen.generate(codegen.from_pinocchio(model).model, tmp_path / "arm", target="c", compile="all")
    solver, data = codegen.load(tmp_path / "arm"), model.createData()
    for _ in range(3):
        q, v, a = rng.normal(size=(3, model.nv))
        M = np.array(pin.crba(model, data, q))
        M = np.triu(M) + np.triu(M, 1).T
        assert error(solver.mass_matrix(q), M) < 1e-12
        assert error(solver.inverse_mass_matrix(q), np.linalg.inv(M)) < 1e-10
        assert error(solver.inverse_dynamics(q, v, a), pin.rnea(model, data, q, v, a)) < 1e-12
        by_q, by_v, _ = pin.computeABADerivatives(model, data, q, v, np.zeros(model.nv))
        found = solver.jacobians(q, v)
        assert error(solver.accelerations(q, v), data.ddq) < 1e-11
        assert error(found.q, by_q) < 1e-10
        assert error(found.u, by_v) < 1e-10


def test_a_closed_loop_moves_as_mujoco_says_of_its_tree(tmp_path: Path) -> None:
    """MuJoCo's mass matrix has armature on its diagonal; on motions that keep the loop closed it is ours."""
    mujoco = pytest.importorskip("mujoco", reason="MuJoCo reads MJCF: pip install mujoco")
    text = """
<mujoco>
  <option gravity="0 0 -9.81"><flag contact="disable"/></option>
  <worldbody>
    <body name="crank" pos="0 0 1">
      <joint name="j1" axis="0 1 0" armature="0.03"/><geom type="capsule" fromto="0 0 0 0 0 .4" size=".02"/>
      <body name="coupler" pos="0 0 .4">
        <joint name="j2" axis="0 1 0" armature="0.002"/><geom type="capsule" fromto="0 0 0 .8 0 0" size=".02"/>
      </body>
    </body>
    <body name="rocker" pos="0.8 0 0.9">
      <joint name="j3" axis="0 1 0" armature="0.4"/><geom type="capsule" fromto="0 0 0 0 0 .5" size=".02"/>
    </body>
  </worldbody>
  <equality><connect name="pin" body1="coupler" body2="rocker" anchor=".8 0 0"/></equality>
</mujoco>
"""
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    found = codegen.from_mujoco(model)
    codegen.generate(found.model, tmp_path / "bars", target="numpy")
    solver = codegen.load(tmp_path / "bars")
    q, u = solver.assemble(solver.initial[0] + 0.2, np.ones(3))
    places = [solver.coordinate_names.index(n) for n in ("crank", "coupler", "rocker")]
    data.qpos[:] = model.qpos0 + q[places]
    mujoco.mj_forward(model, data)
    Y, MY = u[places], np.zeros(3)
    mujoco.mj_mulM(model, data, MY, Y)
    assert solver.energies(q, u)[0] == pytest.approx(Y @ MY / 2, rel=1e-12)
    free = solver.speed_names.index(solver.independent_speed_names[0])
    assert solver.mass_matrix(q)[0, 0] == pytest.approx(Y @ MY / u[free] ** 2, rel=1e-12)
