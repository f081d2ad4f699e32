"""Systems of `sympy.physics.mechanics` as models: accelerations against sympy's own equations."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import sympy as s
from sympy.physics.mechanics import (
    CylindricalJoint,
    Force,
    ForceActuator,
    KanesMethod,
    LinearPathway,
    LinearSpring,
    ObstacleSetPathway,
    Particle,
    PinJoint,
    PlanarJoint,
    Point,
    PrismaticJoint,
    ReferenceFrame,
    RigidBody,
    SphericalJoint,
    System,
    Torque,
    TorqueActuator,
    WeldJoint,
    dynamicsymbols,
    inertia,
)
from sympy_systems import EXAMPLES, Values, body, errors, pendulum_of

import codegen

L, M, G = s.symbols("L M g", positive=True)
VALUES: Values = {L: 0.4, M: 1.3, G: 9.81}


ORDINARY = ("cart and pendulum", "chaos pendulum")
"""The others are left to the campaign, since sympy takes seconds to form their equations."""


@pytest.mark.parametrize(
    "name", [n if n in ORDINARY else pytest.param(n, marks=pytest.mark.campaign) for n in EXAMPLES]
)
def test_accelerations_are_those_of_form_eoms(name: str, tmp_path: Path) -> None:
    system, values = EXAMPLES[name]()
    assert max(errors(system, values, tmp_path)) < 1e-10


def solid(name: str) -> RigidBody:
    """A body with a full inertia matrix and the mass centre at sympy's default."""
    axes, center = ReferenceFrame(f"{name}_axes"), Point(f"{name}_center")
    third = s.Rational(1, 30)
    moments = inertia(
        axes, M * L**2, M * L**2 * s.Rational(4, 3), M * L**2 * s.Rational(5, 4), third, -third / 2, third / 3
    )
    return RigidBody(name, center, axes, M, (moments, center))


def turned(frame: ReferenceFrame, name: str, *turns: Any) -> ReferenceFrame:
    """A frame rotated about axes of the preceding frames."""
    for k, (axis, angle) in enumerate(turns):
        new = ReferenceFrame(f"{name}_{k}")
        new.orient_axis(frame, getattr(frame, axis), angle)
        frame = new
    return frame


JOINTS: dict[str, Any] = {
    "pin": lambda **keys: PinJoint(joint_axis=keys["parent_interframe"].y + 2 * keys["parent_interframe"].z, **keys),
    "prismatic": lambda **keys: PrismaticJoint(joint_axis=-keys["parent_interframe"].y, **keys),
    "cylindrical": lambda **keys: CylindricalJoint(joint_axis=keys["parent_interframe"].z, **keys),
    "planar": PlanarJoint,
    "spherical": SphericalJoint,
    "in space": lambda **keys: SphericalJoint(rot_type="SPACE", rot_order="ZXY", **keys),
    "amounts": lambda **keys: SphericalJoint(
        rot_order=313, coordinates=dynamicsymbols("c1:4"), amounts=dynamicsymbols("c3 c1 c2"), **keys
    ),
    "weld": WeldJoint,
}


def chain(kind: str) -> System:
    """A hinge, the joint between rotated frames, and another hinge."""
    wall, first, second, third = RigidBody("wall"), *(solid(n) for n in ("one", "two", "three"))
    system = System.from_newtonian(wall)
    keys = {
        "parent": first,
        "child": second,
        "parent_point": L / 2 * first.x - L / 3 * first.z,
        "child_point": -L / 4 * second.y + L * second.x,
        "parent_interframe": turned(first.frame, "P", ("x", 0.3), ("z", L)),
        "child_interframe": turned(second.frame, "C", ("y", s.pi / 3)),
    }
    joint = JOINTS[kind](name="middle", **keys)
    system.add_joints(
        PinJoint("before", wall, first, joint_axis=wall.y + wall.x, child_point=L * first.z),
        joint,
        PinJoint("after", second, third, joint_axis=second.x, child_point=L / 2 * third.z),
    )
    system.apply_uniform_gravity(-G * wall.z + G / 5 * wall.x)
    return system


@pytest.mark.parametrize("kind", ["prismatic", "planar", "in space"])
def test_a_joint_of_a_point_mass_on_a_wall(kind: str, tmp_path: Path) -> None:
    wall, bob = RigidBody("wall"), body("bob", M, L, 2 * L, 3 * L)
    system = System.from_newtonian(wall)
    own = turned(wall.frame, "P", ("x", s.pi / 3))
    system.add_joints(JOINTS[kind](name="j", parent=wall, child=bob, parent_point=L * wall.x, parent_interframe=own))
    system.apply_uniform_gravity(-G * wall.z + G / 5 * wall.x)
    assert max(errors(system, VALUES, tmp_path, 2)) < 1e-10


@pytest.mark.campaign
@pytest.mark.parametrize("kind", JOINTS)
def test_every_joint_between_turned_frames(kind: str, tmp_path: Path) -> None:
    assert max(errors(chain(kind), VALUES, tmp_path, 2)) < 1e-10


@pytest.mark.campaign
@pytest.mark.parametrize("kind", ["pin", "prismatic", "cylindrical", "weld"])
def test_joints_whose_child_carries_their_parent(kind: str, tmp_path: Path) -> None:
    wall, arm = RigidBody("wall"), solid("arm")
    bob = solid("bob")
    system = System.from_newtonian(wall)
    keys = {"parent": arm, "child": wall, "parent_interframe": turned(arm.frame, "P", ("x", 0.3))}
    system.add_joints(
        JOINTS[kind](name="j", parent_point=L * arm.x, child_point=L / 3 * wall.y, child_interframe=wall.frame, **keys),
        PinJoint("after", arm, bob, joint_axis=arm.y, child_point=L / 2 * bob.z),
    )
    system.apply_uniform_gravity(-G * wall.z)
    assert codegen.from_sympy(system, VALUES).model.bodies[0].name == "arm"
    assert max(errors(system, VALUES, tmp_path, 2)) < 1e-10


def loaded(*, actuators: bool) -> System:
    """Two links with loads in turned frames that depend on coordinates, speeds, time and an input."""
    wall, one, two = RigidBody("wall"), solid("one"), solid("two")
    q, u, v, w = dynamicsymbols("q u v w")
    push = dynamicsymbols("push")
    system = System.from_newtonian(wall)
    hinge = PinJoint("hinge", one, two, q, u, joint_axis=one.y + one.z, child_point=L * two.x)
    system.add_joints(PinJoint("base", wall, one, v, w, joint_axis=wall.z, child_point=L / 2 * one.y), hinge)
    tip = two.masscenter.locatenew("tip", L / 3 * two.z)
    frame = turned(two.frame, "T", ("z", 0.7))
    if not actuators:
        system.apply_uniform_gravity(-G * wall.y)
        system.add_loads(Force(one, s.sin(v) * M * wall.x), Force(tip, push * frame.x - u * q * one.z))
        system.add_loads(Torque(frame, s.Piecewise((u, u > 0), (u**3, True)) * wall.z + s.sin(s.Symbol("t")) * two.x))
        system.add_loads(Torque(wall, push * wall.x))
        return system
    hook = wall.masscenter.locatenew("hook", 3 * L * wall.x + wall.z)
    ring = one.masscenter.locatenew("ring", L * one.x)
    path = LinearPathway(hook, tip)
    system.add_actuators(
        LinearSpring(5 + q**2, path, L), ForceActuator(push - path.extension_velocity, LinearPathway(ring, tip)),
        ForceActuator(push * L, ObstacleSetPathway(hook, ring, tip)),
        TorqueActuator(push - u, 2 * one.y + 2 * one.z, frame, one), TorqueActuator(u, one.x, two.frame, one.frame),
        TorqueActuator.at_pin_joint(3 * w, hinge), TorqueActuator(q, one.y + one.z, one.frame, two.frame),
        TorqueActuator(push, wall.z, one.frame),
    )  # fmt: skip
    return system


@pytest.mark.campaign
@pytest.mark.parametrize("actuators", [False, True])
def test_loads_and_actuators_between_any_frames(actuators: bool, tmp_path: Path) -> None:
    system = loaded(actuators=actuators)
    values = {x: v for x, v in VALUES.items() if x != G or not actuators}
    forces = codegen.from_sympy(system, values).model
    assert (forces.gravity is None) == actuators and forces.inputs == ("push",)
    assert max(errors(system, values, tmp_path, 2)) < 1e-10


def test_weights_of_some_bodies_are_forces(tmp_path: Path) -> None:
    system, values = pendulum_of(2)
    system.loads = [load for load in system.loads if load.location is not system.bodies[2].masscenter]
    found = codegen.from_sympy(system, values).model
    assert found.gravity is None and len(found.loads) == 3
    assert max(errors(system, values, tmp_path, 2)) < 1e-10


def legs(n: int, *, linear: bool = False, of_angles: bool = False) -> System:
    """A chain of n rods whose end is held on a line; or with a gear; or with an equation between angles."""
    wall = RigidBody("wall")
    system = System.from_newtonian(wall)
    last: Any = wall
    for k in range(n):
        rod = body(f"rod{k}", M, 0, 0, M * L**2 / 12)
        start = last.masscenter.locatenew(f"s{k}", (L / 2 if k else 0) * last.x)
        system.add_joints(
            PinJoint(f"j{k}", last, rod, joint_axis=last.z, parent_point=start, child_point=-L / 2 * rod.x)
        )
        last = rod
    end = last.masscenter.locatenew("end", L / 2 * last.x)
    q, u = list(system.q), list(system.u)
    if linear:
        system.add_holonomic_constraints(q[0] - M * q[1] / 2 + 1 / L, 3 * q[2] - s.pi)
    elif of_angles:
        total = sum((k + 1) * s.sin(x) * (s.cos(q[0]) if k else 1) for k, x in enumerate(q))
        system.add_holonomic_constraints(total + L * q[1] - M)
    else:
        system.add_holonomic_constraints(end.pos_from(wall.masscenter).dot(wall.y) - L / 3)
    held = 2 if linear else 1
    system.q_ind, system.q_dep = q[:-held] if not linear else [q[1], *q[3:]], q[-held:] if not linear else [q[0], q[2]]
    system.u_ind, system.u_dep = [u[q.index(x)] for x in system.q_ind], [u[q.index(x)] for x in system.q_dep]
    system.apply_uniform_gravity(-G * wall.y)
    return system


@pytest.mark.parametrize("n", [2, *(pytest.param(n, marks=pytest.mark.campaign) for n in (3, 4, 5))])
def test_constraints_of_any_number_of_angles(n: int, tmp_path: Path) -> None:
    system = legs(n)
    start = dict(zip(system.q, (0.9, -1.2, 0.8, -0.7, 0.6), strict=False))
    assert max(errors(system, {**VALUES, **start}, tmp_path, 2, 0.05)) < 1e-10


@pytest.mark.parametrize("n", [2, *(pytest.param(n, marks=pytest.mark.campaign) for n in (3, 4))])
def test_equations_between_angles_are_surfaces(n: int, tmp_path: Path) -> None:
    system = legs(n, of_angles=True)
    start = dict(zip(system.q, (0.4, 0.5, 0.1, -0.2), strict=False))
    types = {loop.type for loop in codegen.from_sympy(system, {**VALUES, **start}).model.loops}
    assert types == {"surface", "coupling"}
    assert max(errors(system, {**VALUES, **start}, tmp_path, 2, 0.02)) < 1e-10


def test_a_point_that_is_held_is_a_loop() -> None:
    found = codegen.from_sympy(*EXAMPLES["four-bar"]())
    joint = "joint: {type: curve, equations: [l1/2 + x, y]}"
    assert f"constraint_1: {{{joint}, from: ground, to: {{body: rod4, at: [l4, 0, 0]}}}}" in found.text
    assert [b.name for b in found.model.bodies] == ["rod2", "rod3", "rod4"]


def test_linear_constraints_are_couplings_and_constants(tmp_path: Path) -> None:
    system = legs(4, linear=True)
    found = codegen.from_sympy(system, VALUES).model
    assert [loop.type for loop in found.loops] == ["coupling"] and set(found.motion) == {"rod2"}


def test_a_spring_without_free_length_has_a_force_where_its_ends_coincide(tmp_path: Path) -> None:
    wall, bob = RigidBody("wall"), body("bob", M)
    system = System.from_newtonian(wall)
    system.add_joints(PlanarJoint("j", wall, bob))
    bob.central_inertia = L * inertia(bob.frame, 1, 1, 1)
    system.add_actuators(LinearSpring(3, LinearPathway(wall.masscenter, bob.masscenter.locatenew("end", L * bob.y))))
    values = {M: 1.3, L: 0.4}
    assert max(errors(system, values, tmp_path, 2)) < 1e-10
    codegen.generate(codegen.from_sympy(system, values).model, tmp_path / "rest", target="numpy")
    assert np.abs(codegen.load(tmp_path / "rest").accelerations([-0.4, 0, 0], [0, 0, 0])).max() < 1e-15


@pytest.mark.filterwarnings("ignore")
def test_joints_methods_are_read() -> None:
    from sympy.physics.mechanics import Body, JointsMethod

    wall, rod = Body("wall"), Body("rod")
    joint = PinJoint("pin", wall, rod, joint_axis=wall.z, child_point=L * rod.y)
    rod.apply_force(-rod.mass * G * wall.y)
    rod.apply_torque(M * wall.z)
    found = codegen.from_sympy(JointsMethod(wall, joint), {L: 1, M: 1, G: 9.81, "rod_mass": 2})
    assert "gravity: [0, -g, 0]" in found.text and "load_1: {type: torque, on: rod, value: [0, 0, M]}" in found.text


def test_joints_may_be_listed_from_the_outside_to_the_inside_and_grounds_be_several() -> None:
    walls, one, two = [RigidBody(n) for n in ("wall", "other")], body("one", M, 0, 0, L), body("two", M, 0, 0, L)
    system = System.from_newtonian(walls[0])
    walls[1].frame.orient_axis(walls[0].frame, walls[0].z, s.pi / 6)
    walls[1].masscenter.set_pos(walls[0].masscenter, 2 * L * walls[0].x)
    first = PinJoint("first", walls[1], one, joint_axis=walls[1].z, child_point=L * one.x)
    system.add_joints(PinJoint("second", one, two, joint_axis=one.z, child_point=L * two.x), first)
    found = codegen.from_sympy(system, {M: 1, L: 0.5})
    assert found.bodies == {"wall": "ground", "other": "ground", "one": "one", "two": "two"}
    assert (
        "parent: ground\n    joint: {type: revolute, axis: z, at: [2*L, 0, 0], rotate: [{axis: z, angle: pi/6}]}"
        in found.text
    )


def message(system: Any, **keys: Any) -> str:
    with pytest.raises(codegen.ModelError) as caught:
        codegen.from_sympy(system, **keys)
    return str(caught.value)


def simple(**keys: Any) -> System:
    """A pendulum."""
    wall, rod = RigidBody("wall"), body("rod", M, 0, 0, L)
    system = System.from_newtonian(wall)
    system.add_joints(PinJoint("pin", wall, rod, joint_axis=wall.z, child_point=L * rod.y, **keys))
    return system


def test_what_a_model_cannot_say_is_refused_by_name() -> None:
    q, u, w = dynamicsymbols("q u w")
    free = simple()
    free.add_bodies(RigidBody("lost"))
    assert "bodies.lost: no joint carries this body; every body needs one of these joints" in message(free)
    rolling = simple(coordinates=q, speeds=u)
    rolling.add_nonholonomic_constraints(u - w)
    assert "nonholonomic_constraints: velocity constraints are not read" in message(rolling)
    other = simple(coordinates=q, speeds=u)
    other.kdes = [u - 2 * q.diff()]
    assert "kdes lacks the kinematical equation u(t) = Derivative(q(t), t)" in message(other)
    more = simple(coordinates=q, speeds=u)
    more.add_coordinates(w)
    assert "q w(t): belongs to no joint" in message(more)
    driven = simple(coordinates=q, speeds=u)
    driven.add_holonomic_constraints(q**2 - w)
    assert "holonomic_constraints[0]: q(t)**2 - w(t) depends on time or on other functions than coordinates" in message(
        driven
    )
    imaginary = simple(coordinates=q, speeds=u)
    imaginary.add_holonomic_constraints(s.I * q)
    assert "holonomic_constraints[0]: I*q(t) has a constant that is not a finite real number" in message(imaginary)
    loose = simple(coordinates=q, speeds=u)
    moving = loose.bodies[0].masscenter.locatenew("moving", w * loose.x)
    loose.add_loads(Force(moving, loose.y))
    assert "loads.moving: point moving is not fixed in a body; forces need points that are fixed in bodies" in message(
        loose
    )
    gamma = simple(coordinates=q, speeds=u)
    gamma.add_loads(Torque(gamma.bodies[1], s.gamma(q) * gamma.z), Force(gamma.bodies[1], u.diff() * gamma.x))
    text = message(gamma)
    assert "gamma(q(t)): gamma is not a function of a model; functions are sin" in text
    assert "Derivative(u(t), t): time derivatives of the joints' coordinates are allowed" in text
    assert "values[k]: is not a symbol of this system; symbols are" in message(simple(), values={"k": 1})
    assert "'A b' cannot name a model" in message(simple(), name="A b")


def test_objects_without_joints_are_refused() -> None:
    q, u = dynamicsymbols("q u")
    frame, point = ReferenceFrame("N"), Point("P")
    point.set_vel(frame, u * frame.x)
    kane = KanesMethod(frame, [q], [u], [u - q.diff()], bodies=[Particle("p", point, M)])
    with pytest.raises(
        TypeError, match=re.escape("System, not KanesMethod; KanesMethod keeps no joints; pass the System")
    ):
        codegen.from_sympy(kane)
    with pytest.raises(
        TypeError, match="from_sympy takes a sympy.physics.mechanics.System, not str".replace(".", "[.]")
    ):
        codegen.from_sympy("system")


def test_names_values_and_warnings() -> None:
    wall, rod = RigidBody("wall"), RigidBody("long rod")
    system = System.from_newtonian(wall)
    theta, omega = dynamicsymbols("theta omega")
    length = s.Symbol("sin")
    system.add_joints(PinJoint("a pin", wall, rod, theta, omega, joint_axis=wall.z, child_point=length * rod.y))
    rod.potential_energy = M * theta
    found = codegen.from_sympy(system, {theta: 0.3, "omega(t)": 2, "sin": 0.7}, name="one")
    assert found.model.name == "one" and found.bodies == {"wall": "ground", "long rod": "long_rod"}
    assert found.joints == {"a pin": "long_rod"} and found.renamed == {"long rod": "long_rod"}
    assert (
        found.symbols[theta] == "q.long_rod"
        and found.symbols[omega] == "u.long_rod"
        and found.symbols[length] == "sin_"
    )
    assert {n: e.value for n, e in found.model.initial_q.items()} == {"long_rod": 0.3}
    assert next(p for p in found.model.parameters if p.name == "sin_").value == 0.7
    assert [("1 is used" in w, "0 is used" in w) for w in found.warnings] == [(True, False), (False, True)]
    assert "potential_energy of bodies" in found.left_out[0] and found.differences == ()


def test_the_same_system_gives_the_same_bytes(tmp_path: Path) -> None:
    texts = {codegen.from_sympy(*EXAMPLES["several freedoms"]()).text for _ in range(2)}
    assert len(texts) == 1
    found = codegen.from_sympy(*EXAMPLES["four-bar"]())
    assert codegen.load_model(found.save(tmp_path / "model.yaml")).coordinate_names == found.model.coordinate_names


@pytest.mark.campaign
@pytest.mark.parametrize("n", [4, 6])
def test_long_pendulums(n: int, tmp_path: Path) -> None:
    assert max(errors(*pendulum_of(n), tmp_path, 2)) < 1e-10


def test_sensitivities_to_the_symbols_of_sympy(tmp_path: Path) -> None:
    system, values = EXAMPLES["chaos pendulum"]()
    found = codegen.from_sympy(system, values)
    codegen.generate(found.model, tmp_path / "package", target="numpy")
    solver = codegen.load(tmp_path / "package")
    system.form_eoms()
    udot = system.mass_matrix.LUsolve(system.forcing)
    rng = np.random.default_rng(0)
    q, u = rng.normal(size=2), rng.normal(size=2)
    at = {**values, **dict(zip(system.q, q, strict=True)), **dict(zip(system.u, u, strict=True))}
    for k, parameter in enumerate(found.model.parameters):
        symbol = next(x for x, n in found.symbols.items() if n == parameter.name)
        expected = np.array(udot.diff(symbol).subs(at).evalf(), dtype=float).ravel()
        seed = np.zeros((1, len(found.model.parameters)))
        seed[0, k] = 1
        assert solver.sensitivities(q, u, dp=seed)[1][0] == pytest.approx(expected, rel=1e-10, abs=1e-10)
