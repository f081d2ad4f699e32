"""Agreement with Pinocchio on random trees: udot and its Jacobians in q, u and tau.

    python benchmarks/against_pinocchio.py [--trees 20]

A random tree (revolute and prismatic joints about any axis, spherical, free; dense inertias; rotated joint frames; gravity) is
made with Pinocchio, and ours from that, by `codegen.measure.pinocchio_models`. What differs:

- Pinocchio's quaternions are (x, y, z, w), ours (w, x, y, z);
- a free joint's speeds are (linear, angular) there, (angular, linear) here, both in body axes;
- its derivative "in q" is along the tangent of the configuration, in body axes, for spherical and free joints. The same comes
  out of our Jacobian by the chain rule: dq = (rate of q per unit of speed) for each speed, which is what `coordinate_rates`
  is linear in. Its d udot/d tau is M^-1, here `solve_mass` of unit forces.

Bodies are made depth first: the derivatives of Pinocchio's `computeABADerivatives` are wrong where a subtree's joints do not have
consecutive numbers.
"""

from __future__ import annotations

import argparse
import statistics
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

import codegen
from codegen.measure.accuracy import largest, relative
from codegen.measure.pinocchio_models import ours, usual_state
from codegen.measure.tables import markdown

CLAIM = 1e-11
TYPES = ("revolute", "prismatic", "spherical", "free")
SMALL = 1e-3
"""Errors of columns whose entries are smaller are in parts of this."""

HEAD = ("", "udot", "d udot/dq", "d udot/du", "d udot/dtau")


def random_tree(rng: np.random.Generator, n: int) -> Any:
    """Pinocchio's model of a tree of n bodies."""
    model = pin.Model()
    model.gravity.linear = np.array([0, 0, -9.81])
    branch = [0]  # the joints from the ground to the last body
    for k in range(n):
        if len(branch) > 1 and rng.random() > 0.6:
            branch = branch[: int(rng.integers(1, len(branch)))]
        turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
        moments = turn @ np.diag(rng.uniform(0.02, 0.3, 3)) @ turn.T
        axis = np.eye(3)[rng.integers(3)] if rng.random() < 0.5 else rng.normal(size=3)
        axis = axis / np.linalg.norm(axis)
        joint = {
            "revolute": lambda a=axis: pin.JointModelRevoluteUnaligned(a),
            "prismatic": lambda a=axis: pin.JointModelPrismaticUnaligned(a),
            "spherical": pin.JointModelSpherical, "free": pin.JointModelFreeFlyer,
        }[str(rng.choice(TYPES, p=(0.5, 0.2, 0.2, 0.1)))]()  # fmt: skip
        rpy = rng.uniform(-1.5, 1.5, 3) if rng.random() < 0.5 else np.zeros(3)
        place = pin.SE3(pin.rpy.rpyToMatrix(*rpy), rng.uniform(-0.6, 0.6, 3))
        branch.append(model.addJoint(branch[-1], joint, place, f"b{k}"))
        inertia = np.trace(moments) * np.eye(3) - moments
        body = pin.Inertia(float(rng.uniform(0.3, 2)), rng.uniform(-0.4, 0.4, 3), inertia)
        model.appendBodyToJoint(branch[-1], body, pin.SE3.Identity())
    return model


def worst(x: np.ndarray, reference: np.ndarray) -> float:
    """Of each direction (column), the largest difference over the largest entry; the worst direction."""
    return max(relative(a, b, max(largest(b), SMALL)) for a, b in zip(x.T, reference.T, strict=True))


def compare(rng: np.random.Generator, n: int, folder: Path) -> list[float]:
    """Errors of udot, d/dq, d/du, d/dtau on one random tree."""
    theirs = random_tree(rng, n)
    codegen.generate(ours(theirs, "tree"), folder)
    solver = codegen.load(folder)
    state = usual_state(theirs, rng.uniform(-1, 1, theirs.nq), rng.uniform(-1, 1, theirs.nv))
    (q, u), (pq, pu) = state.ours, state.theirs
    data, tau = theirs.createData(), np.zeros(theirs.nv)
    expected = pin.aba(theirs, data, pq, pu, tau).copy()
    pin.computeABADerivatives(theirs, data, pq, pu, tau)
    by_tau = np.triu(data.Minv) + np.triu(data.Minv, 1).T
    J, unit = solver.jacobians(q, u), np.eye(solver.nu)
    rates = np.array([solver.coordinate_rates(q, e) for e in unit[state.order]]).T  # (nq, nu), in Pinocchio's order
    inverse = np.array([solver.solve_mass(q, e) for e in unit]).T
    square = np.ix_(state.order, state.order)
    return [
        worst(solver.accelerations(q, u)[state.order][:, None], expected[:, None]),
        worst((J.q @ rates)[state.order], data.ddq_dq), worst(J.u[square], data.ddq_dv), worst(inverse[square], by_tau),
    ]  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--trees", type=int, default=20)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    rng = np.random.default_rng(options.seed)
    with tempfile.TemporaryDirectory() as name:
        errors = []
        for i in range(options.trees):
            n = int(rng.integers(1, 11))
            errors.append(compare(rng, n, Path(name) / f"tree{i}"))
            print(f"tree {i}, {n} bodies: " + ", ".join(f"{e:.1e}" for e in errors[-1]), flush=True)
        columns = list(zip(*errors, strict=True))
        rows = [
            [what, *(f"{of(c):.1e}" for c in columns)] for what, of in (("worst", max), ("median", statistics.median))
        ]
        print("\n" + markdown(HEAD, rows))
    if max(map(max, errors)) > CLAIM:
        raise SystemExit(f"an error is above {CLAIM}")


if __name__ == "__main__":
    main()
