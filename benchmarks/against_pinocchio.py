"""Agreement with Pinocchio on random trees: udot and its Jacobians in q, u and tau; and the time of udot beside `pin.aba`.

    python benchmarks/against_pinocchio.py [--trees 20] [--no-timing]

A random tree (revolute and prismatic joints about any axis, spherical, free, fixed; dense inertias; rotated joint frames;
gravity) is built twice, from one description: with `codegen.ModelBuilder` and with Pinocchio. What differs:

- Pinocchio's quaternions are (x, y, z, w) after the position, ours (w, x, y, z);
- Pinocchio takes the bodies depth first (the derivatives of its `computeABADerivatives` are wrong where a subtree's joints do
  not have consecutive numbers), ours come in any order;
- a free joint's speeds are (linear, angular) there, (angular, linear) here, both in body axes;
- its derivative "in q" is along the tangent of the configuration, in body axes, for spherical and free joints. The same comes
  out of our Jacobian by the chain rule: dq = (rate of q per unit of speed) for each speed, which is what `coordinate_rates`
  is linear in. Its d udot/d tau is M^-1, here `solve_mass` of unit forces.
"""

from __future__ import annotations

import argparse
import statistics
import tempfile
import time
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin
from chains import chain_text
from ctiming import table, use_one_core

import codegen
from codegen.model import ModelBuilder, parse_model

CLAIM = 1e-11
TYPES = ("revolute", "prismatic", "spherical", "free")


class Link(NamedTuple):
    """One body: parent index (-1: ground), joint type, unit axis, placement, mass properties about the centre of mass."""

    parent: int
    type: str
    axis: np.ndarray
    rpy: np.ndarray
    at: np.ndarray
    mass: float
    com: np.ndarray
    inertia: np.ndarray


def random_links(rng: np.random.Generator, n: int) -> list[Link]:
    links = []
    for k in range(n):
        parent = -1 if k == 0 else int(k - 1 if rng.random() < 0.6 else rng.integers(0, k))
        turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
        moments = turn @ np.diag(rng.uniform(0.02, 0.3, 3)) @ turn.T
        axis = np.eye(3)[rng.integers(3)] if rng.random() < 0.5 else rng.normal(size=3)
        type = str(rng.choice(TYPES, p=(0.5, 0.2, 0.2, 0.1)))
        rpy = rng.uniform(-1.5, 1.5, 3) if rng.random() < 0.5 else np.zeros(3)
        inertia = np.trace(moments) * np.eye(3) - moments
        links.append(Link(parent, type, axis / np.linalg.norm(axis), rpy, rng.uniform(-0.6, 0.6, 3),
                          float(rng.uniform(0.3, 2)), rng.uniform(-0.4, 0.4, 3), inertia))  # fmt: skip
    return links


def our_model(links: list[Link]) -> Any:
    builder = ModelBuilder("tree", gravity=[0, 0, -9.81])
    for k, link in enumerate(links):
        parent = "ground" if link.parent < 0 else f"b{link.parent}"
        entries = {"xx": (0, 0), "yy": (1, 1), "zz": (2, 2), "xy": (0, 1), "xz": (0, 2), "yz": (1, 2)}
        axis = {"axis": list(map(float, link.axis))} if link.type in ("revolute", "prismatic") else {}
        builder.body(
            f"b{k}", parent, link.type, **axis, at=list(map(float, link.at)), rpy=list(map(float, link.rpy)),
            mass=link.mass, com=list(map(float, link.com)),
            inertia={name: float(link.inertia[place]) for name, place in entries.items()},
        )  # fmt: skip
    return builder.build()


def depth_first(links: list[Link]) -> list[int]:
    """Bodies in an order that keeps subtrees together."""
    order: list[int] = []
    waiting = [k for k, link in enumerate(links) if link.parent < 0][::-1]
    while waiting:
        order.append(waiting.pop())
        waiting += [k for k, link in enumerate(links) if link.parent == order[-1]][::-1]
    return order


def their_model(links: list[Link]) -> Any:
    model = pin.Model()
    model.gravity.linear = np.array([0, 0, -9.81])
    number = {-1: 0}
    for k in depth_first(links):
        link = links[k]
        joint = {
            "revolute": lambda a=link.axis: pin.JointModelRevoluteUnaligned(a),
            "prismatic": lambda a=link.axis: pin.JointModelPrismaticUnaligned(a),
            "spherical": pin.JointModelSpherical,
            "free": pin.JointModelFreeFlyer,
        }[link.type]()
        place = pin.SE3(pin.rpy.rpyToMatrix(*link.rpy), link.at)
        number[k] = model.addJoint(number[link.parent], joint, place, f"b{k}")
        model.appendBodyToJoint(number[k], pin.Inertia(link.mass, link.com, link.inertia), pin.SE3.Identity())
    return model


def places(links: list[Link]) -> tuple[np.ndarray, np.ndarray]:
    """For each of Pinocchio's coordinates and speeds, where it stands in ours."""
    sizes = {"spherical": (4, 3), "free": (7, 6)}
    nq, nu = zip(*(sizes.get(link.type, (1, 1)) for link in links), strict=True)
    q: list[int] = []
    u: list[int] = []
    for k in depth_first(links):
        i, j = sum(nq[:k]), sum(nu[:k])
        if links[k].type == "spherical":
            q += [i + 1, i + 2, i + 3, i]
            u += [j, j + 1, j + 2]
        elif links[k].type == "free":
            q += [i, i + 1, i + 2, i + 4, i + 5, i + 6, i + 3]
            u += [j + 3, j + 4, j + 5, j, j + 1, j + 2]
        else:
            q.append(i)
            u.append(j)
    return np.array(q), np.array(u)


def relative(x: np.ndarray, reference: np.ndarray) -> float:
    """Per direction (column), the largest difference over the largest entry; the worst direction."""
    scale = np.abs(reference).max(axis=0)
    return float((np.abs(x - reference).max(axis=0) / np.maximum(scale, 1e-3)).max())


def compare(rng: np.random.Generator, n: int, folder: Path) -> list[float]:
    """Errors of udot, d/dq, d/du, d/dtau on one random tree."""
    links = random_links(rng, n)
    model, other = our_model(links), their_model(links)
    codegen.generate(model, folder)
    solver = codegen.load(folder)
    where_q, where_u = places(links)
    q, u = rng.uniform(-1, 1, solver.nq), rng.uniform(-1, 1, solver.nu)
    for i, name in enumerate(solver.coordinate_names):
        if name.endswith(".qw"):
            e = rng.normal(size=4)
            q[i : i + 4] = e / np.linalg.norm(e)
    pq, pu = q[where_q], u[where_u]
    data = other.createData()
    tau = np.zeros(other.nv)
    expected = pin.aba(other, data, pq, pu, tau).copy()
    pin.computeABADerivatives(other, data, pq, pu, tau)
    by_q, by_u, by_tau = data.ddq_dq.copy(), data.ddq_dv.copy(), data.Minv.copy()
    by_tau = np.triu(by_tau) + np.triu(by_tau, 1).T

    J = solver.jacobians(q, u)
    unit = np.eye(solver.nu)
    rates = np.array([solver.coordinate_rates(q, e) for e in unit]).T  # (nq, nu)
    inverse = np.array([solver.solve_mass(q, e) for e in unit]).T
    square = np.ix_(where_u, where_u)
    return [
        relative(solver.accelerations(q, u)[where_u][:, None], expected[:, None]),
        relative((J.q @ rates)[square], by_q),
        relative(J.u[square], by_u),
        relative(inverse[square], by_tau),
    ]


def microseconds(call: Any, batches: int = 60) -> float:
    """Least over the batches, microseconds a call."""
    repetitions, best = 1, float("inf")
    while True:
        begin = time.process_time()
        for _ in range(repetitions):
            call()
        if (elapsed := time.process_time() - begin) > 2e-3:
            break
        repetitions *= 2
    for _ in range(batches):
        begin = time.process_time()
        for _ in range(repetitions):
            call()
        best = min(best, (time.process_time() - begin) / repetitions)
    return min(best, elapsed / repetitions) * 1e6


def timing(n: int, folder: Path) -> list[object]:
    """CHAIN(n) from Python, one state a call: ours and Pinocchio's, the binding's overhead in both."""
    model = parse_model(chain_text(n))
    codegen.generate(model, folder)
    solver = codegen.load(folder)
    other = pin.Model()
    other.gravity.linear = np.array([0, 0, -9.81])
    inertia = pin.Inertia(1.0, np.array([0, 0, -0.5]), np.diag([(3 * 0.05**2 + 1) / 12] * 2 + [0.05**2 / 2]))
    for k in range(n):
        joint = pin.JointModelRY() if k % 2 == 0 else pin.JointModelRX()
        place = pin.SE3(np.eye(3), np.array([0.0, 0.0, -1.0 if k else 0.0]))
        other.appendBodyToJoint(other.addJoint(k, joint, place, f"link{k}"), inertia, pin.SE3.Identity())
    data, k = other.createData(), np.arange(1, n + 1)
    q, u, tau = 0.3 * np.sin(k), 0.2 * np.cos(k), np.zeros(n)
    error = relative(solver.accelerations(q, u)[:, None], pin.aba(other, data, q, u, tau)[:, None])
    figures = [
        microseconds(lambda: solver.accelerations(q, u)),
        microseconds(lambda: pin.aba(other, data, q, u, tau)),
        microseconds(lambda: solver.jacobians(q, u)),
        microseconds(lambda: pin.computeABADerivatives(other, data, q, u, tau)),
    ]
    return [n, *(f"{x:.2f}" for x in figures), f"{error:.0e}"]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--trees", type=int, default=20)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--no-timing", action="store_true")
    arguments = parser.parse_args()
    use_one_core()
    rng = np.random.default_rng(arguments.seed)
    with tempfile.TemporaryDirectory() as name:
        errors = []
        for i in range(arguments.trees):
            n = int(rng.integers(1, 11))
            errors.append(compare(rng, n, Path(name) / f"tree{i}"))
            print(f"tree {i}, {n} bodies: " + ", ".join(f"{e:.1e}" for e in errors[-1]), flush=True)
        worst = [max(column) for column in zip(*errors, strict=True)]
        middle = [statistics.median(column) for column in zip(*errors, strict=True)]
        head = ["", "udot", "d udot/dq", "d udot/du", "d udot/dtau"]
        rows = [[what, *(f"{e:.1e}" for e in x)] for what, x in (("worst", worst), ("median", middle))]
        print("\n" + table(head, rows))
        if not arguments.no_timing:
            head = ["n", "ours, accelerations", "pin.aba", "ours, jacobians (q, u, p)", "pin.computeABADerivatives (q, u, tau)",
                    "difference of udot"]  # fmt: skip
            print("\nus a call from Python, CHAIN(n)\n")
            print(table(head, [timing(n, Path(name) / f"chain{n}") for n in (4, 12, 24, 50, 100)]))
    if max(worst) > CLAIM:
        raise SystemExit(f"an error is above {CLAIM}")


if __name__ == "__main__":
    main()
