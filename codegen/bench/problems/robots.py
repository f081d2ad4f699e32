"""Robots given as URDF: matrices and batches, from Python, beside Pinocchio."""

from __future__ import annotations

from ..problem import Robots

ROBOTS = Robots(
    name="robots",
    title="Jacobians, mass matrices and batches of robots given as URDF",
    source="Pinocchio's aba, computeABADerivatives, crba and computeMinverse on the same robot in the same state",
    models=("CHAIN(7)", "CHAIN(24)", "UR5", "Panda", "Solo12", "ANYmal", "G1", "Talos"),
    quick=("CHAIN(7)",),
    within=1e-9,
)
PROBLEMS = (ROBOTS,)
