"""Random spatial mechanisms with one degree of freedom, and their motion in all coordinates of the tree.

The reference integrates the tree with multipliers: mass matrix and accelerations of the tree alone, the loops' conditions as
the package evaluates them, and projects onto closure. So it has no dead point, whatever is independent.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from loop_closure import closure
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

import codegen

RANK = 1e-9
"""Singular values of the conditions' matrix below this part of the largest are of conditions that follow from others."""
STEP = 3e-4
"""s: of the differences for the rates of the conditions' matrix, whose error is its fourth power."""

Vector = np.ndarray


@dataclass
class Spatial:
    """A model's text without its last section, its coordinates and speeds, and the part of the text for the tree."""

    bodies: list[str]
    closing: list[str]
    q: Vector
    u: Vector
    names: list[str]

    def text(self, independent: int | None = None) -> str:
        """The text of the model with one independent coordinate; without it, the text of the tree."""
        lines = ["model: in_space", "gravity: [0.5, -1.0, -9.7]", "bodies:", *self.bodies]
        if independent is not None:
            values = ", ".join(f"{n}: {x!r}" for n, x in zip(self.names, self.q.tolist(), strict=True))
            speed = f"{self.names[independent]}: {float(self.u[independent])!r}"
            initial = ["initial:", f"  q: {{{values}}}", f"  u: {{{speed}}}"]
            lines += [*self.closing, *initial, f"independent: [{self.names[independent]}]"]
        return "\n".join(lines) + "\n"

    def conditions(self) -> Conditions:
        """The conditions of the loops, computed by `codegen.loops` and not by generated code."""
        return Conditions(codegen.parse_model(self.text(0)))


class Conditions:
    """Residuals of loops, and their rates per unit speed; every coordinate is an angle or a displacement."""

    def __init__(self, model: Any) -> None:
        self.model = model

    def residual(self, q: Vector) -> Vector:
        return closure(self.model, q, np.zeros(len(q)))[0]

    def matrix(self, q: Vector) -> Vector:
        return np.array([closure(self.model, q, unit)[1] for unit in np.eye(len(q))]).T

    def bend(self, q: Vector, u: Vector) -> Vector:
        """The time derivative of the condition matrix, times u."""
        rate = [closure(self.model, q + part * STEP * u, u)[1] for part in (1, -1, 0.5, -0.5)]
        return (4 * (rate[2] - rate[3]) - (rate[0] - rate[1]) / 2) / (3 * STEP)


def least(A: Vector, b: Vector) -> Vector:
    """The solution of A x = b with the smallest norm."""
    return np.linalg.lstsq(A, b, rcond=RANK)[0]


def closed(conditions: Conditions, q: Vector, M: Vector | None = None) -> Vector:
    """The closed coordinates nearest to q, by Newton's method."""
    weight = np.eye(len(q)) if M is None else np.linalg.inv(M)
    for _ in range(30):
        r = conditions.residual(q)
        if np.abs(r).max() < 1e-13:
            break
        A = conditions.matrix(q)
        step = weight @ A.T @ least(A @ weight @ A.T, r)
        q = q - step * min(1.0, 0.3 / max(np.abs(step).max(), 1e-300))
    return q


def reference(mechanism: Spatial, tree: Any, times: Vector) -> tuple[Vector, Vector, float]:
    """Coordinates, speeds, and how near the loops came to a loss of rank of their own: a part of their largest singular value."""
    conditions, n = mechanism.conditions(), len(mechanism.q)
    nearest = [1.0]
    rank = np.linalg.matrix_rank(conditions.matrix(mechanism.q), tol=1e-7)

    def rates(_: float, y: Vector) -> Vector:
        q, u = y[:n], y[n:]
        A, inverse = conditions.matrix(q), np.linalg.inv(tree.mass_matrix(q))
        sizes = np.linalg.svd(A, compute_uv=False)
        nearest[0] = min(nearest[0], float(sizes[rank - 1] / max(1.0, sizes[0])))
        free = tree.accelerations(q, u)
        return np.concatenate([u, free - inverse @ A.T @ least(A @ inverse @ A.T, A @ free + conditions.bend(q, u))])

    y, rows = np.concatenate([mechanism.q, mechanism.u]), []
    for t0, t1 in pairwise(times):
        rows.append(y)
        y = solve_ivp(rates, (t0, t1), y, method="DOP853", rtol=1e-9, atol=1e-10).y[:, -1]
        if nearest[0] < 1e-3:
            break
        M = tree.mass_matrix(y[:n])
        q = closed(conditions, y[:n], M)
        A, inverse = conditions.matrix(q), np.linalg.inv(tree.mass_matrix(q))
        u = y[n:] - inverse @ A.T @ least(A @ inverse @ A.T, A @ y[n:])
        y = np.concatenate([q, u])
    rows.append(y)
    found = np.array(rows)
    return found[:, :n], found[:, n:], nearest[0]


# --- families -----------------------------------------------------------------------------------------------------------


def written(v: Any) -> str:
    return "[" + ", ".join(repr(float(x) + 0.0) for x in v) + "]"


def direction(rng: np.random.Generator) -> Vector:
    v = rng.normal(size=3)
    return v / np.linalg.norm(v)


def across(rng: np.random.Generator, a: Vector) -> Vector:
    v = np.cross(a, rng.normal(size=3))
    return v / np.linalg.norm(v)


def solid(rng: np.random.Generator, arm: Vector) -> str:
    i = rng.uniform(0.02, 0.1)
    return (
        f"mass: {rng.uniform(0.5, 2)!r}, com: {written(arm * rng.uniform(0.2, 0.8))}, "
        f"inertia: {{xx: {i!r}, yy: {1.3 * i!r}, zz: {0.9 * i!r}}}"
    )


def crank(rng: np.random.Generator, name: str, at: Vector, slides: float) -> tuple[str, Vector]:
    """The text of a body that rotates or slides on the ground, and the vector of its arm."""
    axis = direction(rng)
    arm = rng.uniform(0.25, 0.8) * across(rng, axis)
    kind = "prismatic" if rng.random() < slides else "revolute"
    joint = f"{{type: {kind}, axis: {written(axis)}, at: {written(at)}}}"
    return f"  {name}: {{parent: ground, joint: {joint}, {solid(rng, arm)}}}", arm


def rods(rng: np.random.Generator, gear: bool) -> Spatial:
    """Cranks and sliders about askew axes, with massless rods between them: a condition each. A gear joins the last two."""
    count = int(rng.integers(2, 4)) + gear
    made = [crank(rng, f"b{i}", rng.uniform(-0.3, 0.3, 3) + [1.1 * i, 0, 0], 0.2) for i in range(count - gear)]
    loops = []
    for i in range(count - gear - 1):
        ends = [f"{{body: b{k}, at: {written(made[k][1])}}}" for k in (i, i + 1)]
        loops.append((f"  l{i}: {{joint: {{type: distance, length: ", f"}}, from: {ends[0]}, to: {ends[1]}}}"))
    couplings = []
    if gear:
        made.append(crank(rng, f"b{count - 1}", rng.uniform(-1, 1, 3), 0.0))
        ratio = float(rng.choice([-2.0, -0.7, 0.5, 3.0]))
        couplings = [
            "couplings:",
            f"  c: {{joint: b{count - 1}, follows: {{b{count - 2}: {ratio!r}}}, offset: OFFSET}}",
        ]
    q = rng.uniform(-np.pi, np.pi, count)
    places = codegen.parse_model("model: m\nbodies:\n" + "\n".join(b for b, _ in made) + "\n")
    ends = _points(places, q, [arm for _, arm in made])
    lengths = [float(np.linalg.norm(ends[i + 1] - ends[i])) for i in range(len(loops))]
    if gear:
        couplings[1] = couplings[1].replace("OFFSET", repr(float(q[-1] - ratio * q[-2])))
    closing = ["loops:", *(f"{a}{x!r}{b}" for (a, b), x in zip(loops, lengths, strict=True)), *couplings]
    return Spatial([b for b, _ in made], closing, q, np.zeros(count), [f"b{i}" for i in range(count)])


def _points(model: Any, q: Vector, arms: list[Vector]) -> Vector:
    """Positions of the ends of the arms relative to the ground."""
    found = []
    for body, x, arm in zip(model.bodies, q, arms, strict=True):
        at, axis = (np.array([float(e.value) for e in v]) for v in (body.joint.at, body.joint.axes[0]))
        turned = Rotation.from_rotvec(axis * x).apply(arm) if body.joint.type == "revolute" else arm + axis * x
        found.append(at + turned)
    return np.array(found)


def coupler(rng: np.random.Generator) -> Spatial:
    """A crank, a heavy coupler on a universal joint, and a rocker or a slider that holds its end in a ball: three conditions."""
    first, arm = crank(rng, "b0", rng.uniform(-0.2, 0.2, 3), 0.0)
    last, other = crank(rng, "b2", rng.uniform(-0.2, 0.2, 3) + [1.2, 0, 0], 0.3)
    a = direction(rng)
    long = rng.uniform(0.8, 1.6) * direction(rng)
    joint = f"{{type: universal, axes: [{written(a)}, {written(across(rng, a))}], at: {written(arm)}}}"
    rod = f"  b1: {{parent: b0, joint: {joint}, {solid(rng, long)}}}"
    closing = [
        "loops:",
        f"  l: {{joint: {{type: point}}, from: {{body: b1, at: {written(long)}}}, to: {{body: b2, at: {written(other)}}}}}",
    ]
    names = ["b0", "b1.1", "b1.2", "b2"]
    return Spatial([first, rod, last], closing, rng.uniform(-1.5, 1.5, 4), np.zeros(4), names)


def spherical_four_bar(rng: np.random.Generator) -> Spatial:
    """Four hinges through a point: five conditions of rank two, of which three follow from others."""
    axes = [direction(rng) for _ in range(4)]
    bodies = []
    for i in range(3):
        parent = "ground" if i == 0 else f"b{i - 1}"
        joint = f"{{type: revolute, axis: {written(axes[i])}}}"
        bodies.append(f"  b{i}: {{parent: {parent}, joint: {joint}, {solid(rng, rng.uniform(-1, 1, 3))}}}")
    closing = ["loops:", f"  l: {{joint: {{type: revolute, axis: {written(axes[3])}}}, from: b2, to: ground}}"]
    return Spatial(bodies, closing, np.zeros(3), np.zeros(3), ["b0", "b1", "b2"])


def cardan(rng: np.random.Generator) -> Spatial:
    """Two shafts at an angle, joined by a universal joint that closes a loop about a sliding sleeve."""
    tilt, axis = rng.uniform(0.3, 1.1), direction(rng)
    b = across(rng, axis)
    other = np.cos(tilt) * axis + np.sin(tilt) * np.cross(axis, b)
    bodies = [
        f"  b0: {{parent: ground, joint: {{type: revolute, axis: {written(axis)}}}, {solid(rng, 0.5 * b)}}}",
        f"  b1: {{parent: ground, joint: {{type: revolute, axis: {written(other)}}}, {solid(rng, 0.5 * b)}}}",
    ]
    pin = across(rng, axis)
    closing = [
        "loops:",
        f"  l: {{joint: {{type: universal, axes: [{written(pin)}, {written(np.cross(other, pin))}]}}, from: b0, to: b1}}",
    ]
    return Spatial(bodies, closing, rng.uniform(-1, 1, 2), np.zeros(2), ["b0", "b1"])


def bennett(rng: np.random.Generator) -> Spatial:
    """Bennett's linkage: it has one degree of freedom, although the count of joints and conditions gives none."""
    alpha, beta, first = rng.uniform(0.4, 0.9), rng.uniform(1.0, 1.4), rng.uniform(0.4, 2.5)
    a, b = 1.0, float(np.sin(beta) / np.sin(alpha))
    second = 2 * np.arctan(np.sin((beta + alpha) / 2) / np.sin((beta - alpha) / 2) / np.tan(first / 2))
    at = [(0.0, 0.0, 0.0, 0.0), (a, 0.0, 0.0, alpha), (b, 0.0, 0.0, beta)]
    bodies = []
    for i, (x, y, z, turn) in enumerate(at):
        parent = "ground" if i == 0 else f"b{i - 1}"
        joint = f"{{type: revolute, axis: z, at: [{x!r}, {y}, {z}], rotate: [{{axis: x, angle: {float(turn)!r}}}]}}"
        bodies.append(f"  b{i}: {{parent: {parent}, joint: {joint}, {solid(rng, rng.uniform(-0.4, 0.4, 3))}}}")
    closing = [
        "loops:",
        f"  l: {{joint: {{type: revolute, axis: z}}, from: {{body: b2, at: [{a!r}, 0, 0], rotate: [{{axis: x, angle: "
        f"{float(alpha)!r}}}]}}, to: {{body: ground, at: [{-b!r}, 0, 0], rotate: [{{axis: x, angle: {-float(beta)!r}}}]}}}}",
    ]
    q = np.array([first, second, -first])
    return Spatial(bodies, closing, q, np.zeros(3), ["b0", "b1", "b2"])


FAMILIES: dict[str, Callable[[np.random.Generator], Spatial]] = {
    "rods": lambda rng: rods(rng, False), "gears": lambda rng: rods(rng, True), "coupler": coupler,
    "spherical": spherical_four_bar, "cardan": cardan, "bennett": bennett,
}  # fmt: skip


def random_in_space(family: str, seed: int) -> tuple[Spatial, int]:
    """A closed mechanism that has one degree of freedom and can move, and its independent coordinate."""
    rng = np.random.default_rng([seed, list(FAMILIES).index(family)])
    while True:
        m = FAMILIES[family](rng)
        conditions = m.conditions()
        m.q = closed(conditions, m.q)
        if np.abs(conditions.residual(m.q)).max() > 1e-12 or np.abs(m.q).max() > 4:
            continue
        A = conditions.matrix(m.q)
        sizes, free = np.linalg.svd(A)[1:]
        rank = int(np.sum(sizes > 1e-7))
        if rank != len(m.q) - 1 or sizes[rank - 1] < 0.1 or np.abs(free[-1]).min() < 0.1:
            continue
        m.u = free[-1] * float(rng.uniform(1.0, 5.0)) * float(rng.choice([-1, 1]))
        return m, int(rng.integers(len(m.q)))
