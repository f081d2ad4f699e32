"""Packages of hard cases, each generated once in a run."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

import codegen


@pytest.fixture(scope="session")
def build(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., codegen.Solver]:
    """Generate a model's text; default: accelerations and sensitivities, for NumPy. `options` are those of `codegen.generate`."""
    known: dict[Any, codegen.Solver] = {}

    def make(text: str, **options: Any) -> codegen.Solver:
        key = (text, *sorted(options.items()))
        if key not in known:
            wanted = {"target": "numpy", "functions": ("accelerations", "sensitivities"), "compile": "all"} | options
            folder = tmp_path_factory.mktemp("hard") / "package"
            codegen.generate(codegen.parse_model(text), folder, check=False, **wanted)
            known[key] = codegen.load(folder)
        return known[key]

    return make
