"""Joints that follow others, in URDF, MJCF and objects of Pinocchio, as couplings; against reduced matrices of Pinocchio."""

from __future__ import annotations

import numpy as np
import pytest
from comparison import error
from imported_robots import joint, link, robot

import codegen
from codegen.measure.pinocchio_models import robots_folder

LIMIT = '<limit lower="-1" upper="1" effort="1" velocity="1"/>'


def gripper(*mimic: str) -> str:
    """A wrist with three fingers, two of which follow."""
    turned = [
        joint("wrist", "base", "palm", axis="0 1 0", more=LIMIT),
        joint("l", "palm", "left", axis="1 0 0", more=LIMIT),
    ]
    following = [
        joint("r", "left", "right", axis="0 0 1", more=LIMIT + mimic[0]),
        joint("s", "palm", "slide", "prismatic", axis="0 1 0", more=LIMIT + mimic[1]),
    ]
    links = [link(n, 1 + 0.3 * k, (0.1, 0.12, 0.15)) for k, n in enumerate(("base", "palm", "left", "right", "slide"))]
    return robot(*links, *turned, *following)


MIMIC = ('<mimic joint="l" multiplier="-1.5" offset="0.2"/>', '<mimic joint="r" multiplier="0.3" offset="0.05"/>')


def test_a_gripper_moves_as_pinocchio_reduced_by_hand(tmp_path) -> None:
    """M = S^T M S and S^T bias of the robot without mimic joints, S the followers' ratios; a follower of a follower too."""
    pin = pytest.importorskip("pinocchio", reason="compares with Pinocchio: pip install pin")
    path = tmp_path / "gripper.urdf"
    path.write_text(gripper(*MIMIC))
    found = codegen.import_model(path, motors=True)
    assert found.text[found.text.index("couplings:") :].splitlines()[1:3] == [
        "  right_mimic: {joint: right, follows: {left: -1.5}, offset: 0.2}",
        "  slide_mimic: {joint: slide, follows: {right: 0.3}, offset: 0.05}",
    ]
    codegen.generate(found.model, tmp_path / "package", target="numpy")
    solver = codegen.load(tmp_path / "package")
    theirs = pin.buildModelFromUrdf(str(path))
    data = theirs.createData()
    order = [theirs.joints[theirs.getJointId(n)].idx_v for n in ("wrist", "l", "r", "s")]
    ours = [solver.speed_names.index(n) for n in ("palm", "left", "right", "slide")]
    S = np.array([[1, 0], [0, 1], [0, -1.5], [0, -0.45]])
    rng = np.random.default_rng(4)
    for _ in range(3):
        q = np.zeros(4)
        q[:2] = rng.normal(size=2)
        q[2] = -1.5 * q[1] + 0.2
        q[3] = 0.3 * q[2] + 0.05
        v, tau = S @ rng.normal(size=2), rng.normal(size=4)
        here = [np.zeros(4) for _ in range(3)]
        for mine, given in zip(here, (q, v, tau), strict=True):
            mine[ours] = given
        there_q, there_v = np.zeros(4), np.zeros(4)
        there_q[order], there_v[order] = q, v
        M = pin.crba(theirs, data, there_q)
        M = (np.triu(M) + np.triu(M, 1).T)[np.ix_(order, order)]
        bias = pin.nonLinearEffects(theirs, data, there_q, there_v)[order]
        expected = S @ np.linalg.solve(S.T @ M @ S, S.T @ (tau - bias))
        inputs = np.zeros(4)
        inputs[[solver.input_names.index(f"tau_{n}") for n in ("palm", "left", "right", "slide")]] = tau
        assert error(solver.accelerations(here[0], here[1], inputs=inputs)[ours], expected) < 1e-12
        assert error(solver.mass_matrix(here[0]), S.T @ M @ S) < 1e-12
        needed = solver.inverse_dynamics(here[0], here[1], np.zeros(4))
        assert error(needed, S.T @ bias) < 1e-12


ROBOTS = [
    "panda_description/urdf/panda.urdf", "baxter_description/urdf/baxter.urdf", "tiago_pro_description/robots/tiago_pro.urdf",
    "talos_data/robots/talos_full_v2.urdf", "talos_data/robots/talos_reduced.urdf",
]  # fmt: skip
"""Grippers and hands of the package example-robot-data; the last one's followers are fixed."""


@pytest.mark.campaign
@pytest.mark.parametrize("file", ROBOTS, ids=[file.rpartition("/")[2] for file in ROBOTS])
def test_real_robots_move_as_pinocchio_reduced_by_hand(tmp_path, file: str) -> None:
    pin = pytest.importorskip("pinocchio", reason="compares with Pinocchio: pip install pin")
    path = robots_folder() / file
    if not path.exists():
        pytest.skip("the robots of example-robot-data are not installed: pip install example-robot-data")
    found = codegen.import_model(path)
    codegen.generate(found.model, tmp_path / "package", target="numpy")
    solver, theirs = codegen.load(tmp_path / "package"), pin.buildModelFromUrdf(str(path))
    data, model = theirs.createData(), found.model
    joint_of = {body: name for name, body in found.joints.items()}
    names = [joint_of[body] for body in solver.speed_names]
    order = [theirs.joints[theirs.getJointId(n)].idx_v for n in names]
    rng = np.random.default_rng(1)
    q, S = rng.uniform(-1, 1, model.nu), np.eye(model.nu)
    followers = []
    for loop in model.loops:  # each after those that it follows
        own, (other,) = loop.terms[0].body, loop.terms[1:]
        row, of = (solver.speed_names.index(model.bodies[k].name) for k in (own, other.body))
        ratio = -other.factor.value
        q[row], S[row] = ratio * q[of] + loop.offset.value, ratio * S[of]
        followers.append(row)
    S = np.delete(S, followers, axis=1)
    v, there_q, there_v = S @ rng.normal(size=S.shape[1]), pin.neutral(theirs), np.zeros(theirs.nv)
    for name, value in zip(names, q, strict=True):
        of = theirs.joints[theirs.getJointId(name)]
        there_q[of.idx_q : of.idx_q + of.nq] = (np.cos(value), np.sin(value)) if of.nq == 2 else value
    there_v[order] = v
    M = pin.crba(theirs, data, there_q)
    M = S.T @ (np.triu(M) + np.triu(M, 1).T)[np.ix_(order, order)] @ S
    bias = S.T @ pin.nonLinearEffects(theirs, data, there_q, there_v)[order]
    assert error(solver.mass_matrix(q), M) < 1e-9
    known = {f"u.{n}": x for n, x in zip(solver.speed_names, v, strict=True)}
    tau = np.zeros(model.nu)
    for force in model.forces:
        tau[solver.speed_names.index(model.bodies[force.body].name)] += force.values[0].evaluate(known)
    assert error(solver.inverse_dynamics(q, v, np.zeros(model.nu)), bias - S.T @ tau) < 1e-9


def test_objects_of_pinocchio_with_mimic_joints_have_couplings(tmp_path) -> None:
    pin = pytest.importorskip("pinocchio", reason="compares with Pinocchio: pip install pin")
    model = pin.buildModelFromXML(gripper(MIMIC[0], ""), mimic=True)
    found = codegen.from_pinocchio(model)
    (coupling,) = found.model.loops
    assert [t.factor.evaluate({}) for t in coupling.terms] == [1, 1.5] and coupling.offset.value == 0.2
    codegen.generate(found.model, tmp_path / "package", target="numpy")
    solver, data = codegen.load(tmp_path / "package"), model.createData()
    rng = np.random.default_rng(3)
    q, v, tau = rng.normal(size=model.nq), rng.normal(size=model.nv), np.zeros(model.nv)
    M = pin.crba(model, data, q)
    M = np.triu(M) + np.triu(M, 1).T
    expected = np.linalg.solve(M, tau - pin.nonLinearEffects(model, data, q, v))
    names = [found.joints[n] for n in ("wrist", "l", "s")]
    mine = [solver.speed_names.index(n) for n in names]
    theirs = [model.joints[model.getJointId(n)].idx_v for n in ("wrist", "l", "s")]
    here_q, here_u = np.zeros(4), np.zeros(4)
    here_q[mine], here_u[mine] = q[theirs], v[theirs]
    here_q, here_u = solver.assemble(here_q, here_u)
    assert error(solver.accelerations(here_q, here_u)[mine], expected[theirs]) < 1e-12


MUJOCO = """\
<mujoco>
  <option gravity="1 0 -9.81"><flag contact="disable"/></option>
  <worldbody>
    <body name="crank" pos="0 0 1">
      <joint name="j1" axis="0 1 0" ref="20"/><geom type="capsule" fromto="0 0 0 0 0 .4" size=".02"/>
      <body name="follower" pos="0 0 .4">
        <joint name="j2" type="slide" axis="0 1 1"/><geom type="capsule" fromto="0 0 0 .8 0 0" size=".02"/>
      </body>
    </body>
  </worldbody>
  <equality><joint name="rack" joint1="j2" joint2="j1" polycoef="0.1 0.25 0 0 0"/></equality>
</mujoco>
"""


def test_joints_of_mjcf_that_follow_others_are_couplings(tmp_path) -> None:
    mujoco = pytest.importorskip("mujoco", reason="compares with MuJoCo: pip install mujoco")
    path = tmp_path / "rack.xml"
    path.write_text(MUJOCO)
    found = codegen.import_model(path)
    assert "rack: {joint: follower, follows: {crank: 0.25}, offset: 0.1}" in found.text
    assert any("softness of <equality>" in what for what in found.left_out)
    codegen.generate(found.model, tmp_path / "package", target="numpy")
    solver = codegen.load(tmp_path / "package")
    model = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(model)
    q, u = solver.assemble([0.7, 0], [1.3, 0])
    assert q[1] == pytest.approx(0.1 + 0.25 * 0.7, rel=1e-15)
    data.qpos[:], data.qvel[:] = model.qpos0 + q, u
    mujoco.mj_forward(model, data)
    M = np.zeros((2, 2))
    try:
        mujoco.mj_fullM(model, M, data.qM)
    except (AttributeError, TypeError):
        mujoco.mj_fullM(model, data, M)
    S = np.array([1.0, 0.25])
    expected = S * (-S @ data.qfrc_bias / (S @ M @ S))
    assert error(solver.accelerations(q, u), expected) < 1e-11
    path.write_text(MUJOCO.replace("0.1 0.25 0 0 0", "0.1 0.25 0 1 0"))
    with pytest.raises(codegen.ModelError, match="by a polynomial"):
        codegen.import_model(path)


@pytest.mark.parametrize(
    ("mimic", "message"),
    [
        ('<mimic joint="k"/>', "joint 'r' follows 'k', which is not a joint of this file"),
        ('<mimic joint="r"/>', "joint 'r' follows 'r', which is the same joint"),
        (
            '<mimic joint="l" multiplier="0"/>',
            "with a multiplier of 0, so that it does not move; make it a fixed joint",
        ),
        ('<mimic joint="f"/>', "joint 'f' is fixed, and only revolute, prismatic, screw joints can follow each other"),
    ],
)
def test_what_cannot_follow_is_told_with_its_line(tmp_path, mimic: str, message: str) -> None:
    path = tmp_path / "gripper.urdf"
    text = gripper(mimic, "").replace("</robot>", link("tip") + joint("f", "slide", "tip", "fixed") + "</robot>")
    path.write_text(text)
    with pytest.raises(codegen.ModelError, match=message) as caught:
        codegen.import_model(path)
    assert all(p.line for p in caught.value.problems if p.severity == "error")
    assert not codegen.import_model(path, free_mimic=True).model.loops


def test_followers_need_no_mass(tmp_path) -> None:
    path = tmp_path / "gripper.urdf"
    text = gripper(*MIMIC)
    own = link("slide", 1 + 0.3 * 4, (0.1, 0.12, 0.15))
    assert own in text
    path.write_text(text.replace(own, '<link name="slide"/>\n'))
    assert len(codegen.import_model(path).model.loops) == 2
