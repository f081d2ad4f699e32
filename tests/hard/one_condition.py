"""Random planar mechanisms whose loops have one condition each, and their motion in all coordinates of the tree.

Every body turns about a pivot on the ground or slides along a line of the ground, so the mass matrix of the tree is diagonal and
constant. The reference integrates all of its coordinates with multipliers and projects them onto closure, so it has no dead
point whatever is independent: only a loop that loses rank itself stops it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

import numpy as np
import sympy
from scipy.integrate import solve_ivp

G = 9.81
SINGULAR = 1e-3
"""Of the least eigenvalue of J M^-1 J^T over its largest: nearer to a loss of rank the reference is not exact either."""


@dataclass
class Body:
    """A body with one coordinate: an angle about -y at `at`, or a displacement in direction `angle` from `at` (x-z plane)."""

    turns: bool
    at: tuple[float, float]
    angle: float
    mass: float
    com: float
    inertia: float
    arm: float

    @property
    def generalised_mass(self) -> float:
        return self.inertia + self.mass * self.com**2 if self.turns else self.mass

    def place(self, q: Any, along: Any, up: Any) -> tuple[Any, Any]:
        """Position, on the ground, of a point given in the body's axes."""
        turned = q if self.turns else self.angle
        slid = 0 if self.turns else q
        c, s = (
            (sympy.cos(turned), sympy.sin(turned))
            if isinstance(turned, sympy.Expr)
            else (np.cos(turned), np.sin(turned))
        )
        return self.at[0] + c * (along + slid) - s * up, self.at[1] + s * (along + slid) + c * up

    def seen(self, q: Any, point: tuple[Any, Any]) -> tuple[Any, Any]:
        """Position, in the body's axes, of a point given on the ground."""
        turned = q if self.turns else self.angle
        slid = 0 if self.turns else q
        c, s = (
            (sympy.cos(turned), sympy.sin(turned))
            if isinstance(turned, sympy.Expr)
            else (np.cos(turned), np.sin(turned))
        )
        x, z = point[0] - self.at[0], point[1] - self.at[1]
        return c * x + s * z - slid, -s * x + c * z

    def text(self, name: str) -> str:
        x, z = self.at
        joint = f"at: [{x!r}, 0, {z!r}]"
        if self.turns:
            return (
                f"  {name}: {{parent: ground, joint: {{type: revolute, axis: -y, {joint}}}, mass: {self.mass!r}, "
                f"com: [{self.com!r}, 0, 0], inertia: {{xx: 1, yy: {self.inertia!r}, zz: 1}}}}"
            )
        return (
            f"  {name}: {{parent: ground, joint: {{type: prismatic, axis: x, {joint}, "
            f"rotate: [{{axis: -y, angle: {self.angle!r}}}]}}, mass: {self.mass!r}}}"
        )


@dataclass
class Mechanism:
    """Bodies, loop conditions as expressions of the bodies' coordinates, and the text of the model."""

    bodies: list[Body]
    q: np.ndarray
    loops: list[str] = field(default_factory=list)
    couplings: list[str] = field(default_factory=list)
    conditions: list[Any] = field(default_factory=list)
    u: np.ndarray = field(default_factory=lambda: np.zeros(0))

    @property
    def symbols(self) -> list[sympy.Symbol]:
        return list(sympy.symbols(f"q0:{len(self.bodies)}", real=True))

    def point(self, i: int) -> tuple[Any, Any]:
        """Position of the end of a body's arm, as expressions."""
        return self.bodies[i].place(self.symbols[i], self.bodies[i].arm, 0)

    def value(self, expression: Any) -> float:
        return float(sympy.sympify(expression).subs(dict(zip(self.symbols, self.q, strict=True))))

    def distance(self, i: int, j: int) -> None:
        """Add a condition: a massless rod connects the ends of two arms."""
        (x0, z0), (x1, z1) = self.point(i), self.point(j)
        square = (x1 - x0) ** 2 + (z1 - z0) ** 2
        length = self.value(square) ** 0.5
        self.conditions.append((square - length**2) / 2)
        ends = [f"{{body: b{k}, at: [{self.bodies[k].arm!r}, 0, 0]}}" for k in (i, j)]
        self.loops.append(
            f"  l{len(self.loops)}: {{joint: {{type: distance, length: {length!r}}}, from: {ends[0]}, to: {ends[1]}}}"
        )

    def surface(self, i: int, j: int, rng: np.random.Generator) -> None:
        """Add a condition: the end of one arm is on a cylinder over a curve of the other body."""
        x, z = self.bodies[i].seen(self.symbols[i], self.point(j))
        a, b = float(rng.uniform(0.05, 0.3)), float(rng.uniform(1.0, 3.0))
        if self.bodies[i].turns:
            form = "sqrt(x**2 + z**2) - A*cos(2*atan2(x, z)) - C"
            shape = sympy.sqrt(x**2 + z**2) - a * sympy.cos(2 * sympy.atan2(x, z))
        else:
            form, shape = "z - A*cos(B*x) - C", z - a * sympy.cos(b * x)
        c = self.value(shape)
        self.conditions.append(shape - c)
        equation = form.replace("A*", f"{a!r}*").replace("B*", f"{b!r}*").replace("- C", f"- ({c!r})")
        self.loops.append(
            f'  l{len(self.loops)}: {{joint: {{type: surface, equation: "{equation}"}}, from: b{i}, '
            f"to: {{body: b{j}, at: [{self.bodies[j].arm!r}, 0, 0]}}}}"
        )

    def slot(self, i: int, j: int) -> None:
        """Add a condition: the end of one arm is in a straight slot of the other body."""
        _, z = self.bodies[i].seen(self.symbols[i], self.point(j))
        height = self.value(z)
        self.conditions.append(z - height)
        self.loops.append(
            f"  l{len(self.loops)}: {{joint: {{type: inline, axis: x}}, from: {{body: b{i}, at: [0, 0, {height!r}]}}, "
            f"to: {{body: b{j}, at: [{self.bodies[j].arm!r}, 0, 0]}}}}"
        )

    def gear(self, i: int, j: int, ratio: float) -> None:
        """Add a condition: one coordinate is a multiple of another."""
        qi, qj = self.symbols[i], self.symbols[j]
        offset = float(self.q[j] - ratio * self.q[i])
        self.conditions.append(qj - ratio * qi - offset)
        self.couplings.append(
            f"  c{len(self.couplings)}: {{joint: b{j}, follows: {{b{i}: {ratio!r}}}, offset: {offset!r}}}"
        )

    def jacobian(self) -> np.ndarray:
        at = dict(zip(self.symbols, self.q, strict=True))
        return np.array(sympy.Matrix(self.conditions).jacobian(self.symbols).subs(at), float)

    def text(self, independent: list[int]) -> str:
        values = ", ".join(f"b{i}: {float(x)!r}" for i, x in enumerate(self.q))
        speeds = ", ".join(f"b{i}: {float(self.u[i])!r}" for i in independent)
        lines = [
            "model: one_condition", f"gravity: [0, 0, -{G!r}]", "bodies:",
            *(b.text(f"b{i}") for i, b in enumerate(self.bodies)),
            *(["loops:", *self.loops] if self.loops else []),
            *(["couplings:", *self.couplings] if self.couplings else []),
            "initial:", f"  q: {{{values}}}", f"  u: {{{speeds}}}",
            f"independent: [{', '.join(f'b{i}' for i in independent)}]",
        ]  # fmt: skip
        return "\n".join(lines) + "\n"

    def energy(self, q: np.ndarray, u: np.ndarray) -> np.ndarray:
        """The total energy for each row of coordinates and speeds."""
        total = np.zeros(len(q))
        for i, b in enumerate(self.bodies):
            height = b.com * np.sin(q[:, i]) if b.turns else np.sin(b.angle) * q[:, i]
            total += b.generalised_mass * u[:, i] ** 2 / 2 + b.mass * G * height
        return total

    def reference(self, times: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
        """Coordinates, speeds, and how near the loops came to a loss of rank of their own."""
        n = len(self.bodies)
        symbols, speeds = self.symbols, list(sympy.symbols(f"u0:{n}", real=True))
        g = sympy.Matrix(self.conditions)
        J = g.jacobian(symbols)
        bend = (J * sympy.Matrix(speeds)).jacobian(symbols) * sympy.Matrix(speeds)
        f: Callable[..., Any] = sympy.lambdify([symbols, speeds], [g, J, bend], "numpy", cse=True)
        M = np.array([b.generalised_mass for b in self.bodies])
        nearest = [1.0]

        def parts(q: np.ndarray, u: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
            found = f(q, u)
            return found[0].ravel(), np.asarray(found[1], float), found[2].ravel()

        def rates(_: float, y: np.ndarray) -> np.ndarray:
            q, u = y[:n], y[n:]
            _g, A, b = parts(q, u)
            force = np.array([
                -x.mass * G * (x.com * np.cos(a) if x.turns else np.sin(x.angle)) for x, a in zip(self.bodies, q, strict=True)
            ])  # fmt: skip
            K = (A / M) @ A.T
            nearest[0] = min(nearest[0], float(np.linalg.eigvalsh(K)[0] / max(1.0, np.linalg.eigvalsh(K)[-1])))
            w = np.linalg.solve(K, A @ (force / M) + b)
            return np.concatenate([u, (force - A.T @ w) / M])

        y, rows = np.concatenate([self.q, self.u]), []
        for t0, t1 in pairwise(times):
            rows.append(y)
            y = solve_ivp(rates, (t0, t1), y, method="DOP853", rtol=1e-11, atol=1e-12).y[:, -1]
            q, u = y[:n], y[n:]
            for _ in range(3):
                r, A, _b = parts(q, u)
                q = q - (A.T / M[:, None]) @ np.linalg.solve((A / M) @ A.T, r)
            A = parts(q, u)[1]
            u = u - (A.T / M[:, None]) @ np.linalg.solve((A / M) @ A.T, A @ u)
            y = np.concatenate([q, u])
        rows.append(y)
        found = np.array(rows)
        return found[:, :n], found[:, n:], nearest[0]


def random_body(rng: np.random.Generator, x: float) -> Body:
    """A random body; pivots are about a metre apart."""
    turns = bool(rng.random() < 0.65)
    arm = float(rng.uniform(0.2, 0.9))
    at = (float(x + rng.uniform(-0.2, 0.2)), float(rng.uniform(-0.2, 0.2)))
    com = float(rng.uniform(0, arm)) if turns else 0.0
    return Body(
        turns, at, float(rng.uniform(-0.6, 0.6)), float(rng.uniform(0.5, 2)), com, float(rng.uniform(0.02, 0.2)), arm
    )


def random_mechanism(seed: int) -> tuple[Mechanism, list[int]]:
    """A mechanism with one degree of freedom, and its independent coordinate, which usually has dead points."""
    rng = np.random.default_rng(seed)
    while True:
        count = 2 if rng.random() < 0.6 else 3
        bodies = [random_body(rng, 1.2 * i) for i in range(count)]
        m = Mechanism(
            bodies, np.array([rng.uniform(-np.pi, np.pi) if b.turns else rng.uniform(-0.3, 0.3) for b in bodies])
        )
        for i in range(count - 1):
            kind = rng.choice(["distance", "surface", "slot", "gear"], p=[0.45, 0.25, 0.2, 0.1])
            if kind == "surface":
                m.surface(i, i + 1, rng)
            elif kind == "slot" and bodies[i].turns:
                m.slot(i, i + 1)
            elif kind == "gear" and count > 2 and bodies[i].turns and bodies[i + 1].turns and not m.couplings:
                m.gear(i, i + 1, float(rng.choice([-2.0, -1.0, 0.5, 3.0])))
            else:
                m.distance(i, i + 1)
        J = m.jacobian()
        s = np.linalg.svd(J, compute_uv=False)
        if s[-1] < 0.1 or s[0] > 10:
            continue
        free = np.linalg.svd(J)[2][-1]
        if np.abs(free).min() < 0.15:
            continue
        m.u = free * float(rng.uniform(0.5, 4)) * float(rng.choice([-1, 1]))
        return m, [int(rng.integers(count))]
