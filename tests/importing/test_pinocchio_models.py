"""Objects of Pinocchio as models: every joint type, composite joints, mimic joints."""

import numpy as np
import pytest
from imported_robots import ARM, joint, link, robot
from pinocchio_agreement import errors

import codegen

pin = pytest.importorskip("pinocchio", reason="compares with Pinocchio: pip install pin")


def random_inertia(rng):
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    a, b, c = rng.uniform(0.1, 0.3, 3)
    return pin.Inertia(rng.uniform(1, 2), rng.normal(size=3) * 0.1, turn @ np.diag([b + c, a + c, a + b]) @ turn.T)


def random_place(rng):
    return pin.SE3(pin.rpy.rpyToMatrix(*rng.normal(size=3)), rng.normal(size=3) * 0.3)


def chain(joints, rng):
    model, last = pin.Model(), 0
    for k, one in enumerate(joints):
        last = model.addJoint(last, one, random_place(rng), f"j{k}")
        model.appendBodyToJoint(last, random_inertia(rng), random_place(rng))
    return model


def composite(rng):
    found = pin.JointModelComposite()
    found.addJoint(pin.JointModelRX(), random_place(rng))
    found.addJoint(pin.JointModelPrismaticUnaligned(np.array([0, 0.6, 0.8])), random_place(rng))
    return found


AXIS = np.array([0.6, 0.0, -0.8])
PLANAR = "planar"
KINDS = {
    "RX": lambda rng: pin.JointModelRX(), "PZ": lambda rng: pin.JointModelPZ(), "RUBY": lambda rng: pin.JointModelRUBY(),
    "unaligned": lambda rng: pin.JointModelRevoluteUnaligned(AXIS), "slide": lambda rng: pin.JointModelPrismaticUnaligned(AXIS),
    "HY": lambda rng: pin.JointModelHY(0.05), "screw": lambda rng: pin.JointModelHelicalUnaligned(AXIS, -0.1),
    "universal": lambda rng: pin.JointModelUniversal(np.array([1.0, 0, 0]), np.array([0, 1.0, 0])),
    "spherical": lambda rng: pin.JointModelSpherical(), "angles": lambda rng: pin.JointModelSphericalZYX(),
    "translation": lambda rng: pin.JointModelTranslation(), PLANAR: lambda rng: pin.JointModelPlanar(),
    "free": lambda rng: pin.JointModelFreeFlyer(), "composite": composite,
}  # fmt: skip


UNGEARED = ("free", PLANAR)
"""Types whose speeds in Pinocchio are components along axes that turn: the model format has no rotors along these."""


def rotors(kind, model, rng):
    """Reflected inertia for every speed of a chain; equal values for the speeds of a ball joint."""
    found = rng.uniform(0.05, 1.5, model.nv)
    for one in list(model.joints)[1:]:
        if one.shortname() == "JointModelSpherical":
            found[one.idx_v : one.idx_v + 3] = found[one.idx_v]
    return found


@pytest.mark.parametrize("kind", KINDS)
def test_every_type_of_joint_moves_as_pinocchio_says(tmp_path, kind):
    rng = np.random.default_rng(list(KINDS).index(kind))
    model = chain([KINDS[kind](rng), pin.JointModelRZ(), KINDS[kind](rng)], rng)
    if kind not in UNGEARED:
        model.rotorInertia, model.rotorGearRatio = rotors(kind, model, rng) / 16, np.full(model.nv, 4.0)
        model.armature = model.rotorInertia * model.rotorGearRatio**2
    found = codegen.from_pinocchio(model)
    assert found.left_out == ()
    assert (sum(bool(b.joint.armature) for b in found.model.bodies) > 2) == (kind not in UNGEARED)
    assert found.model.nu == model.nv
    codegen.generate(found.model, tmp_path / "package", target="numpy")
    solver, data = codegen.load(tmp_path / "package"), model.createData()
    for _ in range(3):
        q, v = pin.randomConfiguration(model, -np.ones(model.nq), np.ones(model.nq)), rng.normal(size=model.nv)
        ours, u, T, rate = state(model, found, solver, q, v)
        right = T @ pin.aba(model, data, q, v, np.zeros(model.nv)) + rate
        assert np.abs(solver.accelerations(ours, u) - right).max() < 1e-11 * np.abs(right).max()


def state(model, found, solver, q, v):
    """The model's state of a chain, T of u = T v, and Tdot v."""
    ours = np.array(solver.initial[0], float)
    T, rate = np.zeros((model.nv, model.nv)), np.zeros(model.nv)
    names_q, names_u = list(solver.coordinate_names), list(solver.speed_names)
    for k in range(1, model.njoints):
        one, name = model.joints[k], model.names[k]
        i, d = one.idx_q, one.idx_v
        bodies = [found.joints[j] for j in found.joints if j == name or j.startswith(f"{name}.")]
        at = [a for b in bodies for a, n in enumerate(names_q) if n.partition(".")[0] == b]
        to = [a for b in bodies for a, n in enumerate(names_u) if n.partition(".")[0] == b]
        values = q[i : i + one.nq]
        matrix = np.eye(one.nv)
        if one.shortname().startswith("JointModelRUB"):
            values = [np.arctan2(values[1], values[0])]
        elif one.shortname() == "JointModelPlanar":
            x, y, c, s = values
            values = [x, y, np.arctan2(s, c)]
            matrix[:2, :2] = [[c, -s], [s, c]]
            rate[to[:2]] = v[d + 2] * np.array([[-s, -c], [c, -s]]) @ v[d : d + 2]
        elif one.shortname() == "JointModelSpherical":
            values = values[[3, 0, 1, 2]]
        elif one.shortname() == "JointModelFreeFlyer":
            values = values[[0, 1, 2, 6, 3, 4, 5]]
            matrix = matrix[[3, 4, 5, 0, 1, 2]]
        ours[at] = values
        T[np.ix_(to, range(d, d + one.nv))] = matrix
    return ours, T @ v, T, rate


def test_a_file_and_what_pinocchio_reads_of_it_are_one_robot(tmp_path):
    path = tmp_path / "robot.urdf"
    path.write_text(ARM)
    found = codegen.from_pinocchio(pin.buildModelFromUrdf(str(path), pin.JointModelFreeFlyer()))
    assert "tool0: {body: forearm, at: [0.1, 0, 0.3]}" in found.text
    assert [b.name for b in found.model.bodies] == ["base", "upper_arm", "forearm"]
    codegen.generate(found.model, tmp_path / "package", target="numpy")
    worst = errors(str(path), found, codegen.load(tmp_path / "package"))
    assert max(worst.values()) < 1e-12, worst


def test_mimic_joints_and_what_has_no_place_are_told(tmp_path):
    text = robot(
        link("base"), link("a"), link("b"), joint("j", "base", "a", more=LIMIT),
        joint("k", "a", "b", axis="0 1 0", more=f'{LIMIT}<mimic joint="j" multiplier="2" offset="0.3"/>'),
    )  # fmt: skip
    model = pin.buildModelFromXML(text, mimic=True)
    assert "b_mimic: {joint: b, follows: {a: 2}, offset: 0.3}" in codegen.from_pinocchio(model).text
    found = codegen.from_pinocchio(model, free_mimic=True)
    assert "joint: {type: revolute, axis: y, at: [0, 0, 0.5]}  # k" in found.text
    model = chain([pin.JointModelRX(), pin.JointModelRY()], np.random.default_rng(0))
    model.armature = np.array([0.1, 0.2])
    model.damping = np.array([0.0, 0.5])
    found = codegen.from_pinocchio(model)
    assert found.left_out == ()
    assert "joint: {type: revolute, axis: x, armature: 0.1" in found.text
    asked = codegen.from_pinocchio(model, parameterize="j1:armature")
    assert "j1_armature: {value: 0.2, unit: kg m^2, min: 0}" in asked.text
    assert "axis: y, armature: j1_armature" in asked.text
    free = chain([pin.JointModelUniversal(np.array([1.0, 0, 0]), np.array([0, 1.0, 0]))], np.random.default_rng(0))
    with pytest.raises(codegen.ModelError, match="the joint of 'j0' has no armature in this file"):
        codegen.from_pinocchio(free, parameterize="j0:armature")
    free.armature = np.array([0.0, 0.3])
    assert "armature: [j0_armature_1, j0_armature_2]" in codegen.from_pinocchio(free, parameterize="j0:armature").text
    assert "j1: {type: joint, joint: j1, value: -0.5*u.j1}" in found.text
    with pytest.raises(TypeError, match=r"takes a pinocchio\.Model, not str"):
        codegen.from_pinocchio("robot.urdf")


def test_rotors_that_the_format_has_no_words_for_are_told():
    rng = np.random.default_rng(0)
    kinds = [pin.JointModelFreeFlyer(), pin.JointModelPlanar(), pin.JointModelSpherical(), pin.JointModelRX()]
    model = chain(kinds, rng)
    model.armature = np.array([*rng.uniform(0.1, 1, model.nv - 1), 0.0])
    model.rotorInertia = np.array([*np.zeros(model.nv - 1), 0.01])
    assert codegen.from_pinocchio(model).left_out == (
        "armature of a free joint: it moves without a motor; the dynamics differ",
        "armature of a planar joint: along axes that rotate with the body; the dynamics differ",
        "armature that differs between the speeds of a spherical joint: the dynamics differ",
        "rotorInertia without armature: armature is rotorInertia*rotorGearRatio**2; no effect on the dynamics",
    )


def test_damping_is_that_of_each_speed():
    """A translation is three slides; the speeds of a free or planar joint are others than Pinocchio's."""
    ball, slides, free = pin.JointModelSpherical(), pin.JointModelTranslation(), pin.JointModelFreeFlyer()
    model = chain([ball, slides, pin.JointModelUniversal(np.eye(3)[0], np.eye(3)[1]), free], np.random.default_rng(0))
    model.damping = np.array([0.1, 0.2, 0.3, 0.4, 0.4, 0.4, 0.5, 0.0, *(0.6,) * 6])
    found = codegen.from_pinocchio(model)
    assert not found.differences
    for line in (
        "value: [-0.1*u.j0.wx, -0.2*u.j0.wy, -0.3*u.j0.wz]", "value: -0.4*u.j1_1}", "value: -0.4*u.j1_2}", "value: -0.4*u.j1}",
        "value: [-0.5*u.j2.1, 0]", "value: [-0.6*u.j3.wx, -0.6*u.j3.wy, -0.6*u.j3.wz, -0.6*u.j3.vx, ",
    ):  # fmt: skip
        assert line in found.text
    asked = codegen.from_pinocchio(model, parameterize="j2:damping").text
    assert "value: [-j2_damping_1*u.j2.1, -j2_damping_2*u.j2.2]" in asked
    model.damping = np.array([*model.damping[:13], 0.7])
    assert codegen.from_pinocchio(model).differences == (
        "damping that differs between the degrees of freedom of a free joint: the dynamics differ",
    )


LIMIT = '<limit lower="-1" upper="1" effort="1" velocity="1"/>'
