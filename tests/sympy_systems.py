"""Systems of `sympy.physics.mechanics`, and sympy's own equations of motion for them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import sympy as s
from sympy.physics.mechanics import (
    DuffingSpring,
    Force,
    LinearDamper,
    LinearPathway,
    LinearSpring,
    Particle,
    PinJoint,
    Point,
    PrismaticJoint,
    ReferenceFrame,
    RigidBody,
    System,
    Torque,
    TorqueActuator,
    WeldJoint,
    dynamicsymbols,
    inertia,
)

import codegen

Values = dict[Any, float]


def body(name: str, mass: Any, *moments: Any) -> RigidBody:
    """A rigid body with principal moments about its own axes."""
    axes, center = ReferenceFrame(f"{name}_axes"), Point(f"{name}_center")
    return RigidBody(name, center, axes, mass, (inertia(axes, *(moments or (0, 0, 0))), center))


def cart_and_pendulum() -> tuple[System, Values]:
    """A cart on a rail with a hanging rod and a force on the cart."""
    mc, mp, l, g = s.symbols("m_c m_p l g")
    push = dynamicsymbols("F")
    rail, cart = RigidBody("rail"), body("cart", mc)
    rod = body("rod", mp, 0, 0, mp * l**2 / 12)
    system = System.from_newtonian(rail)
    system.add_joints(
        PrismaticJoint("slide", rail, cart, joint_axis=rail.x),
        PinJoint("hinge", cart, rod, joint_axis=cart.z, child_point=l / 2 * rod.y),
    )
    system.apply_uniform_gravity(-g * rail.y)
    system.add_loads(Force(cart, push * rail.x))
    return system, {mc: 2, mp: 0.7, l: 0.8, g: 9.81}


def chaos_pendulum() -> tuple[System, Values]:
    """A rod on a hinge that carries a plate, which rotates about the rod."""
    ma, mb, la, lb, h, w, g = s.symbols("m_A m_B l_A l_B h w g")
    theta, phi, omega, alpha = dynamicsymbols("theta phi omega alpha")
    ceiling = RigidBody("ceiling")
    rod = body("rod", ma, ma * la**2 / 3, ma * la**2 / 3, 0)
    plate = body("plate", mb, mb * h**2 / 12, mb * (w**2 + h**2) / 12, mb * w**2 / 12)
    system = System.from_newtonian(ceiling)
    system.add_joints(
        PinJoint("hinge", ceiling, rod, theta, omega, joint_axis=ceiling.y, child_point=-la * rod.z),
        PinJoint("collar", rod, plate, phi, alpha, joint_axis=rod.z, parent_point=lb * rod.z),
    )
    system.apply_uniform_gravity(g * ceiling.z)
    return system, {ma: 0.01, mb: 0.1, la: 0.075, lb: 0.2, h: 0.1, w: 0.2, g: 9.81}


def pendulum_of(n: int) -> tuple[System, Values]:
    """A cart with an applied force that carries n point masses on massless rods."""
    g, push = s.Symbol("g"), dynamicsymbols("F")
    masses, lengths = s.symbols(f"m:{n + 1}"), s.symbols(f"l:{n}")
    rail, cart = RigidBody("rail"), body("cart", masses[0])
    system = System.from_newtonian(rail)
    system.add_joints(PrismaticJoint("slide", rail, cart, joint_axis=rail.x))
    last: Any = cart
    for k in range(n):
        bob = body(f"bob{k}", masses[k + 1])
        system.add_joints(PinJoint(f"hinge{k}", last, bob, joint_axis=last.z, child_point=lengths[k] * bob.y))
        last = bob
    system.apply_uniform_gravity(-g * rail.y)
    system.add_loads(Force(cart, push * rail.x))
    values = {m: 1 + k / 10 for k, m in enumerate(masses)} | {l: 0.5 + k / 20 for k, l in enumerate(lengths)}
    return system, {**values, g: 9.81}


def several_freedoms() -> tuple[System, Values]:
    """A block between spring and damper, with a rod, a bob welded to it, spring and damper in the hinge, and a force."""
    m, l, k, c, g, w = s.symbols("m l k c g w")
    force, torque = dynamicsymbols("f T")
    x, theta, v, omega = dynamicsymbols("x theta v omega")
    wall, block = RigidBody("wall"), body("block", m)
    rod = body("rod", m / 3, 0, 0, m * l**2 / 36)
    bob_axes = ReferenceFrame("bob_axes")
    bob = Particle("bob", mass=2 * m)
    system = System.from_newtonian(wall)
    system.add_joints(
        PrismaticJoint("slide", wall, block, x, v, joint_axis=wall.x),
        PinJoint("hinge", block, rod, theta, omega, joint_axis=block.z, child_point=l / 2 * rod.y),
        WeldJoint("weld", rod, bob, parent_point=-l / 2 * rod.y, child_interframe=bob_axes),
    )
    system.apply_uniform_gravity(-g * wall.y)
    end = wall.masscenter.locatenew("end", -w * wall.x)
    path = LinearPathway(end, block.masscenter)
    system.add_actuators(
        LinearSpring(k, path, w / 2), LinearDamper(c, path), DuffingSpring(k / 3, k * 7, path, w),
        TorqueActuator(torque - k * theta / 50 - c * omega / 9, wall.z, rod, block),
    )  # fmt: skip
    system.add_loads(Force(bob, force * rod.x - c * wall.x), Torque(rod, torque / 2 * wall.z))
    return system, {m: 1.2, l: 0.6, k: 30, c: 0.4, g: 9.81, w: 0.9}


def four_bar() -> tuple[System, Values]:
    """Four rods, the first at rest, closed by two constraints."""
    lengths, rho, g = s.symbols("l1:5"), s.Symbol("rho"), s.Symbol("g")
    q, u = dynamicsymbols("q1:4"), dynamicsymbols("u1:4")
    rods = [RigidBody("rod1")]
    for k, l in enumerate(lengths[1:], 2):
        rods.append(body(f"rod{k}", rho * l, 0, 0, rho * l**3 / 12))
    system = System.from_newtonian(rods[0])
    for k in range(3):
        one, other = rods[k], rods[k + 1]
        system.add_joints(
            PinJoint(
                f"hinge{k + 1}", one, other, q[k], u[k], joint_axis=one.z,
                parent_point=lengths[k] / 2 * one.x, child_point=-lengths[k + 1] / 2 * other.x,
            )
        )  # fmt: skip
    end = rods[3].masscenter.pos_from(rods[0].masscenter) + lengths[3] / 2 * rods[3].x + lengths[0] / 2 * rods[0].x
    system.add_holonomic_constraints(end.dot(rods[0].x), end.dot(rods[0].y))
    system.q_ind, system.q_dep = [q[0]], q[1:]
    system.u_ind, system.u_dep = [u[0]], u[1:]
    system.apply_uniform_gravity(-g * rods[0].y)
    given = dict(zip(lengths, (1.0, 0.8, 1.1, 0.9), strict=True))
    closed = {q[0]: 1.8, q[1]: 1.3, q[2]: 1.5}
    return system, {**given, rho: 2.0, g: 9.81, **closed}


EXAMPLES: dict[str, Callable[[], tuple[System, Values]]] = {
    "cart and pendulum": cart_and_pendulum,
    "chaos pendulum": chaos_pendulum,
    "pendulum of 3": lambda: pendulum_of(3),
    "several freedoms": several_freedoms,
    "four-bar": four_bar,
}


class Theirs:
    """Accelerations by `System.form_eoms`."""

    def __init__(self, system: Any, parameters: Mapping[Any, str]) -> None:
        system.form_eoms()
        self.system = system
        self.q, self.u = list(system.q), list(system.u)
        self.free = sorted({x for x, n in parameters.items() if not n.startswith(("q.", "u."))}, key=str)
        self.free.append(dynamicsymbols._t)
        arguments = [*self.q, *self.u, *self.free]
        self.equations = s.lambdify(arguments, [system.mass_matrix, system.forcing], cse=True)

    def accelerations(self, values: Mapping[Any, float]) -> np.ndarray:
        """Accelerations of the model, in the order of sympy's speeds."""
        mass, forcing = self.equations(*(values[x] for x in (*self.q, *self.u, *self.free)))
        return np.linalg.solve(np.array(mass, dtype=float), np.array(forcing, dtype=float)).ravel()


def errors(system: Any, values: Values, folder: Path, states: int = 3, spread: float = 0.3) -> list[float]:
    """Relative differences of the accelerations at random states with closed loops."""
    found = codegen.from_sympy(system, values)
    codegen.generate(found.model, folder / "package", target="numpy")
    solver, theirs = codegen.load(folder / "package"), Theirs(system, found.symbols)
    rng = np.random.default_rng(3)
    result = []
    for _ in range(states):
        q, u = solver.initial
        q, u = solver.assemble(q + spread * rng.normal(size=q.shape), rng.normal(size=u.shape))
        given = rng.normal(size=solver.ninputs)
        names = {f"q.{n}": x for n, x in zip(found.model.coordinate_names, q, strict=True)}
        names |= {f"u.{n}": x for n, x in zip(found.model.speed_names, u, strict=True)}
        names |= dict(zip(found.model.inputs, given, strict=True))
        names |= {p.name: p.value for p in found.model.parameters}
        at = {x: names[n] for x, n in found.symbols.items() if n in names}
        expected = theirs.accelerations({**at, dynamicsymbols._t: 0.7})
        udot = dict(zip(found.model.speed_names, solver.accelerations(q, u, None, given, 0.7), strict=True))
        ours = np.array([udot[found.symbols[x][2:]] for x in theirs.u])
        result.append(float(np.abs(ours - expected).max() / np.abs(expected).max()))
    return result
