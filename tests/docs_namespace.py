"""Names that examples in docstrings use: NumPy, ordernm, and solvers of four models."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

import codegen

EXAMPLES = Path(__file__).parents[1] / "examples"

MODELS: dict[str, tuple[str, dict[str, Any]]] = {
    "solver": ("double_pendulum", {"reactions": True, "frames": True}),
    "four_bar": ("four_bar", {"partitions": 2}),
    "slider_crank": (
        "slider_crank",
        {"functions": "statics,assemble_gradients,gradients,hessian_products,assemble_hessian_products"},
    ),
    "shaken": ("shaken_pendulum", {}),
    "pendulum": (
        "pendulum",
        {
            "functions": "accelerations,gradients,motion,hessian_products,inverse_dynamics_hessian_products,"
            "output_hessian_products,energy_hessian_products,coordinate_rate_hessian_products"
        },
    ),
}
"""Name of the solver, model in `EXAMPLES`, options of `generate`."""


def namespace(folder: Path) -> dict[str, Any]:
    """The names. The solvers compute with NumPy, so only motions are compiled."""
    found: dict[str, Any] = {"np": np, "ordernm": codegen}
    for name, (model, options) in MODELS.items():
        package = folder / model
        if not package.exists():
            codegen.generate(EXAMPLES / f"{model}.yaml", package, target="numpy", **options)
        found[name] = codegen.load(package)
    return found
