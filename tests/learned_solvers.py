"""Solvers of examples for the tests of JAX and PyTorch, with the functions that these libraries differentiate."""

from __future__ import annotations

from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pytest
from made_once import made

import codegen

EXAMPLES = Path(__file__).parents[1] / "examples"
SECOND = ["accelerations", "sensitivities", "gradients", "hessian_products"]
EVERY = [
    *SECOND, "coordinate_rates", "coordinate_rate_sensitivities", "coordinate_rate_gradients", "outputs", "output_sensitivities",
    "output_gradients", "energies", "energy_sensitivities", "energy_gradients", "inverse_dynamics",
    "inverse_dynamics_sensitivities", "mass_matrix", "mass_matrix_sensitivities", "solve_mass", "solve_mass_sensitivities",
]  # fmt: skip
MEASURES = [
    "outputs", "output_sensitivities", "output_gradients", "output_hessian_products", "energies", "energy_sensitivities",
    "energy_gradients", "energy_hessian_products", "inverse_dynamics", "inverse_dynamics_sensitivities",
    "inverse_dynamics_hessian_products",
]  # fmt: skip


class Extra:
    """A module that takes seconds to import; it is imported when a test first reads one of its names.

    Where its package is not installed, the tests of the file are skipped.
    """

    def __init__(self, module: str, reason: str) -> None:
        if find_spec(module.partition(".")[0]) is None:
            pytest.skip(reason, allow_module_level=True)
        self._module = module

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_"):  # pytest looks for marks and wrappers at every name in a file of tests
            raise AttributeError(name)
        return getattr(import_module(self._module), name)


def example(name: str, folder: Path, functions: list[str], **options: Any) -> codegen.Solver:
    return made(codegen.load_model(EXAMPLES / f"{name}.yaml"), folder, functions=functions, **options)
