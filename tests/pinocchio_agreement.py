"""Differences between an imported robot and Pinocchio's model of the same file."""

from typing import Any

import numpy as np

import codegen
from codegen.measure.pinocchio_models import State


def states(theirs: Any, imported: codegen.Imported, solver: Any, seed: int) -> State:
    """A random state in both programs. Coordinates are matched by joint names; the free joint without a name is the base."""
    import pinocchio as pin

    rng = np.random.default_rng(seed)
    q, u = pin.neutral(theirs), rng.normal(0, 0.7, theirs.nv)
    here_q, here_u = (np.array(a, float) for a in solver.initial)
    order, rates = np.zeros(theirs.nv, int), np.zeros((len(here_q), theirs.nv))
    for k in range(1, theirs.njoints):
        joint, i, v = theirs.joints[k], theirs.joints[k].idx_q, theirs.joints[k].idx_v
        body = imported.joints.get(theirs.names[k]) or imported.model.bodies[0].name
        if joint.nv == 6:
            e = rng.normal(size=4)
            q[i : i + 7] = *rng.normal(size=3), *(e / np.linalg.norm(e))
            x, y, z, w = q[i + 3 : i + 7]
            at = [solver.coordinate_names.index(f"{body}.{c}") for c in ("px", "py", "pz", "qw", "qx", "qy", "qz")]
            here_q[at] = *q[i : i + 3], w, x, y, z
            order[v : v + 6] = [solver.speed_names.index(f"{body}.{c}") for c in ("vx", "vy", "vz", "wx", "wy", "wz")]
            rates[np.ix_(at[:3], range(v, v + 3))] = pin.Quaternion(w, x, y, z).matrix()
            turning = [[-x, -y, -z], [w, -z, y], [z, w, -x], [-y, x, w]]
            rates[np.ix_(at[3:], range(v + 3, v + 6))] = 0.5 * np.array(turning)
            continue
        angle = rng.uniform(-1.2, 1.2)
        place = solver.coordinate_names.index(body)
        q[i : i + joint.nq] = (np.cos(angle), np.sin(angle)) if joint.nq == 2 else angle
        here_q[place], order[v], rates[place, v] = angle, solver.speed_names.index(body), 1.0
    here_u[order] = u
    return State((q, u), (here_q, here_u), order, rates)


def errors(
    file: str, imported: codegen.Imported, solver: Any, seeds: int = 3, free: bool | None = None
) -> dict[str, float]:
    """Largest relative difference of every function, in the norm of the largest entry.

    The base is free where our first body is, or as `free` says.
    """
    import pinocchio as pin

    free = imported.model.bodies[0].joint.type == "free" if free is None else free
    theirs = pin.buildModelFromUrdf(file, pin.JointModelFreeFlyer()) if free else pin.buildModelFromUrdf(file)
    assert theirs.nv == imported.model.nu
    data, found = theirs.createData(), {}

    def note(what: str, ours: np.ndarray, right: np.ndarray) -> None:
        found[what] = max(found.get(what, 0.0), float(np.abs(ours - right).max() / np.abs(right).max()))

    for seed in range(seeds):
        (q, u), here, order, rates = states(theirs, imported, solver, seed)
        damping = np.array(theirs.damping)
        udot = pin.aba(theirs, data, q, u, -damping * u).copy()
        note("udot", solver.accelerations(*here)[order], udot)
        by_q, by_u, inverse = (np.array(m) for m in pin.computeABADerivatives(theirs, data, q, u, -damping * u))
        inverse = np.triu(inverse) + np.triu(inverse, 1).T
        J = solver.jacobians(*here, wrt="q, u")
        note("udot by q", J.q[order] @ rates, by_q)
        note("udot by u", J.u[np.ix_(order, order)], by_u - inverse * damping)
        M = pin.crba(theirs, data, q).copy()
        note("mass matrix", solver.mass_matrix(here[0])[np.ix_(order, order)], np.triu(M) + np.triu(M, 1).T)
        wanted = np.random.default_rng(seed + 1).normal(size=theirs.nv)
        turned = np.zeros(theirs.nv)
        turned[order] = wanted
        note(
            "inverse dynamics",
            solver.inverse_dynamics(*here, turned)[order],
            pin.rnea(theirs, data, q, u, wanted) + damping * u,
        )
    return found
