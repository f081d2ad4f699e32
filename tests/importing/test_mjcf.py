"""MJCF through MuJoCo: motion of every joint type against `mj_forward`, loops against MuJoCo's matrices."""

import re
from pathlib import Path

import numpy as np
import pytest
from mujoco_agreement import of_mujoco, ours_of

import codegen

mujoco = pytest.importorskip("mujoco", reason="MuJoCo reads MJCF: pip install mujoco")

JOINTS = """\
<mujoco model="all joints">
  <compiler angle="radian"/>
  <option gravity="0.3 -0.2 -9.81"><flag contact="disable"/></option>
  <worldbody>
    <light pos="0 0 3"/>
    <geom type="plane" size="1 1 1"/>
    <body name="arm" pos="0.1 0 1" euler="0 1.5707963267948966 0.2">
      <joint name="yaw" type="hinge" axis="0 1 0.5" pos="0 0 .1" damping=".2" stiffness="3" springref=".4" ref=".1"
             armature=".07"/>
      <joint name="slide" type="slide" axis="1 0 0" pos="0.2 0 0" damping="0.7" stiffness="20" armature="1.5"/>
      <joint name="roll" type="hinge" axis="1 0 0" pos="0 0.3 .1"/>
      <geom type="box" size=".1 .2 .3" pos="0.1 0 0"/>
      <geom type="sphere" size=".1" pos="0 0.4 0"/>
      <body name="hand" pos=".3 0 0">
        <joint name="wrist" type="ball" damping=".3" armature=".02" pos="0 0 -.1"/>
        <geom type="capsule" size=".02 .2"/>
        <site name="tip" pos="0 0 .2"/>
        <body name="camera-mount" pos="0 0 .1" euler="1 0 0">
          <inertial pos="0 .01 0" mass=".2" diaginertia="1e-3 2e-3 1.5e-3"/>
        </body>
      </body>
    </body>
    <body name="drone" pos="0 0 3" euler="0.1 0.2 0.3">
      <freejoint name="flying"/>
      <inertial pos="0.01 0 0.1" mass="1" diaginertia=".1 .1 .15" euler="0.3 0.4 0"/>
    </body>
  </worldbody>
  <actuator><motor joint="yaw"/></actuator>
  <sensor><jointpos joint="yaw"/></sensor>
</mujoco>
"""

BARS = """\
<mujoco>
  <option gravity="3 0 -9.81"><flag contact="disable"/></option>
  <worldbody>
    <body name="crank" pos="0 0 1">
      <joint name="j1" axis="0 1 0"/><geom type="capsule" fromto="0 0 0 0 0 .4" size=".02"/>
      <body name="coupler" pos="0 0 .4">
        <joint name="j2" axis="0 1 0"/><geom type="capsule" fromto="0 0 0 .8 0 0" size=".02"/>
      </body>
    </body>
    <body name="rocker" pos="0.8 0 0.9">
      <joint name="j3" axis="0 1 0"/><geom type="capsule" fromto="0 0 0 0 0 .5" size=".02"/>
    </body>
    {more}
  </worldbody>
  <equality>{equality}</equality>
</mujoco>
"""
PAYLOAD = '<body name="load" pos="0.1 0 1.5" euler="20 30 40"><freejoint/><geom type="box" size=".1 .05 .02"/></body>'


def solver_of(found, tmp_path):
    codegen.generate(found.model, tmp_path / found.model.name, target="numpy")
    return codegen.load(tmp_path / found.model.name)


def test_every_type_of_joint_moves_as_mujoco_says(tmp_path):
    path = tmp_path / "robot.xml"
    path.write_text(JOINTS)
    found = codegen.import_model(path)
    model = mujoco.MjModel.from_xml_path(str(path))
    solver, data, rng = solver_of(found, tmp_path), mujoco.MjData(model), np.random.default_rng(0)
    for _ in range(5):
        data.qpos[:] = model.qpos0
        mujoco.mj_integratePos(model, data.qpos, rng.normal(size=model.nv), 1.0)
        data.qvel[:] = rng.normal(size=model.nv)
        mujoco.mj_forward(model, data)
        q, u, T = of_mujoco(model, data, found, solver)
        right = ours_of(model, data, T, data.qacc)
        assert np.abs(solver.accelerations(q, u) - right).max() < 1e-11 * np.abs(right).max()


def test_mujocos_own_model_moves_as_mujoco_says(tmp_path):
    """The model that its package carries: what the model format cannot say is taken out of it on both sides."""
    path = Path(mujoco.__file__).parent / "testdata" / "model.xml"
    if not path.is_file():
        pytest.skip("this MuJoCo carries no testdata/model.xml")
    model = mujoco.MjModel.from_xml_path(str(path))
    assert np.any(model.dof_armature)
    off = mujoco.mjtDisableBit
    model.opt.disableflags |= off.mjDSBL_CONTACT | off.mjDSBL_CONSTRAINT | off.mjDSBL_ACTUATION
    model.opt.density = model.opt.viscosity = 0
    for array in (model.body_gravcomp, model.eq_active0, model.tendon_stiffness, model.tendon_damping):
        array[...] = 0
    found = codegen.from_mujoco(model)
    assert found.model.nu == model.nv > 15
    solver, data, rng = solver_of(found, tmp_path), mujoco.MjData(model), np.random.default_rng(4)
    for _ in range(3):
        data.qpos[:] = model.qpos0
        mujoco.mj_integratePos(model, data.qpos, rng.normal(size=model.nv), 0.5)
        data.qvel[:] = rng.normal(size=model.nv)
        mujoco.mj_forward(model, data)
        q, u, T = of_mujoco(model, data, found, solver)
        right = ours_of(model, data, T, data.qacc)
        assert np.abs(solver.accelerations(q, u) - right).max() < 1e-9 * np.abs(right).max()


def test_a_body_of_several_joints_is_a_chain(tmp_path):
    path = tmp_path / "robot.xml"
    path.write_text(JOINTS)
    found = codegen.import_model(path)
    assert [b.name for b in found.model.bodies] == ["arm_yaw", "arm_slide", "arm", "hand", "drone"]
    assert found.model.name == "all_joints"
    assert "initial:\n  q: {drone: [0, 0, 3, " in found.text
    assert "value: -3*(q.arm_yaw - 0.3) - 0.2*u.arm_yaw" in found.text.replace("0.30000000000000004", "0.3")
    assert "camera_mount: {body: hand, at: [0, 0, 0.2]}  # camera-mount" in found.text
    assert {what.split(" (")[0] for what in found.left_out} >= {
        "<light>",
        "<site>",
        "<actuator>",
        "<sensor>",
    }
    assert any(what.startswith("<actuator> (line 28): --motors adds inputs") for what in found.left_out)
    assert not found.differences


def test_a_geom_that_agrees_is_a_shape(tmp_path):
    path = tmp_path / "robot.xml"
    geom = '<geom type="box" size=".1 .2 .3" mass="2"/>'
    path.write_text(f'<mujoco><worldbody><body name="b"><joint/>{geom}</body></worldbody></mujoco>')
    assert "shape: {type: box, size: [0.2, 0.4, 0.6], mass: 2}" in codegen.import_model(path).text


CONNECT = '<connect name="pin" body1="coupler" body2="rocker" anchor=".8 0 0"/>'


@pytest.mark.parametrize(
    ("equality", "more", "types"),
    [
        (CONNECT, "", ["point"]),
        ('<connect site1="s1" site2="s2"/>', "", ["point"]),
        (f'<weld body1="coupler" body2="load"/>{CONNECT}', PAYLOAD, ["fixed", "point"]),
        (
            '<weld body1="coupler" body2="load" relpose=".1 0 .1 1 0 0 0"/>',
            PAYLOAD.replace('euler="20 30 40"', ""),
            ["fixed"],
        ),
        ('<weld body1="load" body2="coupler" anchor=".2 0 .1"/>', PAYLOAD, ["fixed"]),
        ('<weld body1="coupler" body2="rocker" anchor="0 0 .5" torquescale="0"/>', "", ["point"]),
        ('<connect body1="coupler" anchor=".8 0 0"/>', "", ["point"]),
    ],
    ids=["connect", "sites", "weld", "weld at a pose", "weld at an anchor", "weld without torque", "to the world"],
)  # fmt: skip
def test_loops_move_as_mujocos_matrices_say(tmp_path, equality, more, types):
    """MuJoCo's constraints are soft; its mass matrix, bias and Jacobians with rigid ones are the other way here."""
    path = tmp_path / "loop.xml"
    text = BARS.format(equality=equality, more=more)
    if "site1" in equality:
        text = text.replace('name="j2" axis="0 1 0"/>', 'name="j2" axis="0 1 0"/><site name="s1" pos=".8 0 0"/>')
        text = text.replace('name="j3" axis="0 1 0"/>', 'name="j3" axis="0 1 0"/><site name="s2" pos="0 0 .5"/>')
    path.write_text(text)
    found = codegen.import_model(path)
    assert re.findall(r"joint: {type: (point|fixed)}", found.text) == types
    model = mujoco.MjModel.from_xml_path(str(path))
    solver, data, rng = solver_of(found, tmp_path), mujoco.MjData(model), np.random.default_rng(1)
    mujoco.mj_forward(model, data)
    pairs = constrained(model)
    for _ in range(3):
        # speeds that the constraints allow, at the closed reference configuration
        data.qpos[:] = model.qpos0
        data.qvel[:] = 0
        mujoco.mj_forward(model, data)
        J, _ = rows(model, data, pairs)
        _, s, vt = np.linalg.svd(J)
        allowed = vt[np.sum(s > 1e-9 * s[0]) :]
        data.qvel[:] = rng.normal(size=len(allowed)) @ allowed
        mujoco.mj_forward(model, data)
        J, rate = rows(model, data, pairs)
        M = np.zeros((model.nv, model.nv))
        mujoco.mj_fullM(model, data, M) if _new_order() else mujoco.mj_fullM(model, M, data.qM)
        n, m = model.nv, len(J)
        system = np.block([[M, J.T], [J, np.zeros((m, m))]])
        right = np.concatenate([data.qfrc_passive - data.qfrc_bias, -rate])
        qacc = np.linalg.lstsq(system, right, rcond=1e-13)[0][:n]
        q, u, T = of_mujoco(model, data, found, solver)
        expected = ours_of(model, data, T, qacc)
        assert np.abs(solver.closure(q, u)[0]).max() < 1e-9
        np.testing.assert_allclose(solver.accelerations(q, u), expected, rtol=1e-9, atol=1e-9 * np.abs(expected).max())


def constrained(model):
    """For every constraint: the two bodies, a point fixed in each, and whether rotation is constrained."""
    found = []
    for e in range(model.neq):
        first, second = model.eq_obj1id[e], model.eq_obj2id[e]
        if model.eq_objtype[e] == mujoco.mjtObj.mjOBJ_SITE:
            at = model.site_bodyid, model.site_pos
            found.append((at[0][first], at[1][first], at[0][second], at[1][second], False))
        elif model.eq_type[e] == mujoco.mjtEq.mjEQ_CONNECT:
            found.append((first, model.eq_data[e][:3], second, model.eq_data[e][3:6], False))
        else:
            found.append((first, model.eq_data[e][3:6], second, model.eq_data[e][:3], model.eq_data[e][10] != 0))
    return found


def rows(model, data, pairs):
    """Rows of the conditions on qvel, and the terms Jdot qvel of their derivatives."""
    lines, rates = [], []
    for a, x, b, y, held in pairs:
        both = []
        for body, local in ((a, x), (b, y)):
            point = data.xpos[body] + data.xmat[body].reshape(3, 3) @ local
            parts = [np.zeros((3, model.nv)) for _ in range(4)]
            mujoco.mj_jac(model, data, parts[0], parts[1], point, body)
            mujoco.mj_jacDot(model, data, parts[2], parts[3], point, body)
            both.append(parts)
        for k in (0, 1) if held else (0,):
            lines.append(both[0][k] - both[1][k])
            rates.append((both[0][k + 2] - both[1][k + 2]) @ data.qvel)
    return np.vstack(lines), np.concatenate(rates)


def _new_order():
    """MuJoCo 4 takes the data, earlier ones their mass matrix."""
    return not hasattr(mujoco.MjData, "qM")


def test_what_models_cannot_say_of_constraints_is_told(tmp_path):
    path = tmp_path / "loop.xml"
    path.write_text(BARS.format(more="", equality='<joint joint1="j1" joint2="j2" polycoef="0 2 0 0 0"/>'))
    (coupling,) = codegen.import_model(path).model.loops
    assert [t.factor.value for t in coupling.terms] == [1, -2]
    assert len(codegen.import_model(path, free_mimic=True).model.bodies) == 3
    path.write_text(BARS.format(more="", equality='<joint joint1="j1" joint2="j2" polycoef="0 2 1 0 0"/>'))
    with pytest.raises(codegen.ModelError, match="by a polynomial of degree above 1, polycoef 0 2 1 0 0"):
        codegen.import_model(path)
    path.write_text(
        BARS.format(more="", equality='<connect body1="coupler" body2="rocker" anchor=".8 0 0" active="false"/>')
    )
    found = codegen.import_model(path)
    assert not found.model.loops and any("not active" in what for what in found.left_out)


def world(bodies, more=""):
    return f"<mujoco>{more}<worldbody>{bodies}</worldbody></mujoco>"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            "<mujoco>\n<worldbody>\n<body>\n<joint tpe='hinge'/></body></worldbody></mujoco>",
            "loop.xml:4:1: MuJoCo cannot compile it: XML Error: Schema violation: unrecognized attribute: 'tpe'",
        ),
        (world("<body name='b'><joint/></body>"), "mass and inertia of moving bodies must be larger than mjMINVAL"),
        (
            "<mujoco>\n<include file='no.xml'/></mujoco>",
            "loop.xml:2:1: MuJoCo cannot compile it: XML Error: Error opening",
        ),
        ("<mujoco>\n<include file='loop.xml'/></mujoco>", "already included"),
        (
            world("<body><joint/><geom type='mesh' mesh='m'/></body>", "<asset><mesh name='m' file='m.stl'/></asset>"),
            "m.stl",
        ),
        ("<!DOCTYPE m [<!ENTITY a 'b'>]><mujoco/>", "a document type (DOCTYPE)"),
        (world("<geom size='1'/>"), "nothing moves"),
    ],
)
def test_what_mujoco_refuses_is_told_with_its_line(tmp_path, text, message):
    path = tmp_path / "loop.xml"
    path.write_text(text)
    with pytest.raises(codegen.ModelError) as error:
        codegen.import_model(path)
    assert message in str(error.value) and str(path) in str(error.value)


def test_what_mujoco_warns_of_is_told_and_no_file_is_left(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    twice = '<body name="b"><joint/><joint/><geom size="1"/></body>'  # the same freedom two times: singular
    held = '<equality><connect body1="b" anchor="1 0 0"/></equality>'
    (tmp_path / "robot.xml").write_text(world(twice, held))
    found = codegen.import_model("robot.xml")
    assert (
        len(found.warnings) == 1 and "robot.xml: warning: MuJoCo says: Inertia matrix is too close" in found.warnings[0]
    )
    assert [p.name for p in tmp_path.iterdir()] == ["robot.xml"]


def test_the_base_of_mjcf_is_in_the_file(tmp_path):
    path = tmp_path / "robot.xml"
    path.write_text(JOINTS)
    with pytest.raises(codegen.ModelError, match="--base free is for URDF; an MJCF specifies"):
        codegen.import_model(path, base="free")


def test_an_object_gives_what_its_file_gives(tmp_path):
    path = tmp_path / "robot.xml"
    path.write_text(JOINTS)
    from_file, from_object = codegen.import_model(path), codegen.from_mujoco(mujoco.MjModel.from_xml_path(str(path)))

    def without_comments(text):
        return [line for line in text.splitlines() if not line.startswith("#")]

    assert without_comments(from_object.text) == without_comments(from_file.text)
    assert "<sensor>: no effect on the dynamics" in from_object.left_out
    with pytest.raises(TypeError, match=r"takes a mujoco\.MjModel, such as .*, not str"):
        codegen.from_mujoco("robot.xml")
