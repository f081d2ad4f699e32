"""Laws of force elements: power, energy, and loads at a point of a body in the engines."""

from dataclasses import dataclass
from typing import ClassVar, get_args

import mpmath
import numpy as np
import pytest
from joint_types import DIGITS, body, coordinates, extended, joint
from random_models import expression, vector

from codegen.mechanics.elements import LAWS as GENERATED
from codegen.mechanics.elements.element import Law as GeneratedLaw
from codegen.model.expressions import Expression
from codegen.model.forces import FORCES, AlongLine, ForceElement, InJointEntry, JointForce, JointLoad, Spring
from codegen.model.joints import JOINTS
from codegen.model.model import GROUND, Model
from codegen.model.outputs import MEASURES
from codegen.model.places import Point
from codegen.reference import DenseEngine, RecursiveEngine
from codegen.reference.arithmetic import Arithmetic
from codegen.reference.forces import LAWS, End, Law, Wrench
from codegen.reference.outputs import VALUES
from codegen.reference.pairs import Pair, Pairs


@dataclass(frozen=True, slots=True, eq=False)
class Thruster(ForceElement):
    """A force and a torque in the axes of its body: an element type that models do not have."""

    type: ClassVar[str] = "thruster"

    point: Point
    force: tuple[Expression, ...]
    torque: tuple[Expression, ...]

    @property
    def ends(self):
        return (self.point,)

    @property
    def coefficients(self):
        return *self.force, *self.torque


class ThrusterLaw(Law):
    def wrenches(self, element, pairs, ends):
        (end,) = ends
        return [Wrench(end.R @ pairs.vector(element.force), end.R @ pairs.vector(element.torque))]


@pytest.fixture(autouse=True)
def known_elements(monkeypatch):
    monkeypatch.setitem(LAWS, Thruster, ThrusterLaw())


def test_every_element_has_a_law_and_every_output_a_value():
    # what acts in a joint by a law is written out as a force of the joint
    entries = [entry for entry in FORCES if not issubclass(entry, InJointEntry)]
    made = {get_args(entry.model_fields["type"].annotation)[0] for entry in entries}
    in_joints = {JointLoad.type}  # what a joint force is that reads points
    assert {element.type for element in LAWS} == made | {"thruster"} | in_joints
    assert {element.type for element in GENERATED} == made - {"joint"} | in_joints
    for element, law in GENERATED.items():
        if issubclass(element, AlongLine):
            assert element.has_energy == (element.law.potential is not None)
            continue
        assert element.has_energy == (type(law).energy is not GeneratedLaw.energy)
        assert element.has_energy == (type(LAWS[element]).energy is not Law.energy)
    assert VALUES.keys() == MEASURES.keys()


def ends(rng: np.random.Generator, count: int, pairs: Pairs) -> list[End]:
    """Random attachment points, each of which moves along every one of 3 count directions."""
    result = []
    for i in range(count):
        seed = np.zeros((3 * count, 3, 1))
        seed[3 * i : 3 * i + 3, :, 0] = np.eye(3)
        still = pairs.constant(np.eye(3))
        v, omega = (pairs.constant(rng.normal(size=(3, 1))) for _ in range(2))
        result.append(End(Pair(rng.normal(size=(3, 1)), seed), v, still, omega))
    return result


def spring(damping, free_length=0.3) -> Spring:
    at = vector(0, 0, 0)
    return Spring("s", Point("a", 0, at), Point("b", 1, at), *map(expression, (7.0, damping, free_length)))


def test_a_spring_pulls_down_the_slope_of_its_energy_and_a_damper_takes_energy_away():
    for seed in range(5):
        pairs, law = Pairs(Arithmetic(), 6, {}), LAWS[Spring]
        at = ends(np.random.default_rng(seed), 2, pairs)
        slope = law.energy(spring(0), pairs, at).tangent
        pull = np.concatenate([w.force.value[:, 0] for w in law.wrenches(spring(0), pairs, at)])
        np.testing.assert_allclose(pull, -slope, rtol=1e-14, atol=1e-14)
        assert all(w.torque is None for w in law.wrenches(spring(0), pairs, at))
        damped = np.concatenate([w.force.value[:, 0] for w in law.wrenches(spring(2.0), pairs, at)])
        velocity = np.concatenate([end.v.value[:, 0] for end in at])
        r = at[1].x.value - at[0].x.value
        rate = ((at[1].v.value - at[0].v.value) * r).sum() / np.linalg.norm(r)
        np.testing.assert_allclose((damped - pull) @ velocity, -2.0 * rate**2, rtol=1e-12)


def test_a_spring_whose_ends_coincide():
    pairs = Pairs(Arithmetic(), 6, {})
    there = ends(np.random.default_rng(0), 1, Pairs(Arithmetic(), 3, {}))[0]
    at = [End(pairs.constant(there.x.value), *(pairs.constant(x.value) for x in (there.v, there.R, there.omega)))] * 2
    for wrench in LAWS[Spring].wrenches(spring(0, 0), pairs, at):
        assert not wrench.force.value.any()
    law = LAWS[Spring]
    assert law.energy(spring(1.0, 0), pairs, at).value == 0
    for method, element in ((law.wrenches, spring(1.0, 0)), (law.wrenches, spring(0)), (law.energy, spring(0))):
        with pytest.raises(ValueError, match="spring s: its two points coincide, so its force has no direction"):
            method(element, pairs, at)


def model(rng: np.random.Generator) -> Model:
    """A model with a thruster on the second of three bodies, a motor and a spring."""
    joints = [joint(JOINTS[name], rng, placed=True) for name in ("free", "universal", "revolute")]
    bodies = tuple(body(f"b{k}", k - 1 if k else GROUND, on, rng) for k, on in enumerate(joints))
    thruster = Thruster("t", Point("", 1, vector(0.3, -0.2, 0.5)), vector(1, "2*u.b2", -1), vector("q.b2", 0.5, 2))
    between = Spring(
        "s", Point("", 0, vector(0.1, 0, 0)), Point("", 2, vector(0, 1, 0)), *map(expression, (7.0, 0.2, 0.3))
    )
    motor = JointForce("m", 1, tuple(map(expression, ("0.3*q.b2", "sin(t)"))))
    return Model("m", None, (), (), bodies, forces=(motor,), loads=(between, thruster))


def test_the_engines_agree_on_forces_and_torques():
    rng = np.random.default_rng(3)
    m = model(rng)
    assert [e.name for e in m.elements] == ["m", "s", "t"]
    with mpmath.workdps(DIGITS):
        q, u = extended(coordinates(m, rng)), extended(rng.normal(size=m.nu))
        seeds = {"dq": rng.normal(size=(2, m.nq)), "du": rng.normal(size=(2, m.nu)), "dt": rng.normal(size=2)}
        one, other = (e(m, "mpmath").sensitivities(q, u, t=0.4, **seeds) for e in (DenseEngine, RecursiveEngine))
        for a, b in zip(one, other, strict=True):
            assert max(abs(x) for x in (a - b).flat) < 1e-40


def test_power():
    """What all elements do is what the kinetic energy gains, the spring's potential energy taken off."""
    rng = np.random.default_rng(4)
    m = model(rng)
    e = DenseEngine(m)
    q, u = coordinates(m, rng), rng.normal(size=m.nu)
    udot, qdot = e.accelerations(q, u), e.coordinate_rates(q, u)
    _, (gained, stored) = e.energy_sensitivities(q, u, dq=qdot[None], du=udot[None])
    state = e._state(q, u, None, None, 0.0)
    power = 0.0
    for _, end, wrench in e._wrenches(state.pairs, e._motion(state)):
        for load, rate in ((wrench.force, end.v), (wrench.torque, end.omega)):
            power += 0.0 if load is None else float((load.value * rate.value).sum())
    power += float(e._forces_on_speeds(state.pairs).value[:, 0] @ u)
    np.testing.assert_allclose(gained[0], power, rtol=1e-11)
    assert abs(stored[0]) > 1e-3
