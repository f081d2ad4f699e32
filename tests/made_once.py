"""Solvers of models or model texts, each generated only once."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pytest

import codegen


def made(model: codegen.Model | str, folder: Path, **options: Any) -> codegen.Solver:
    """The solver of a model or its text, generated with options of `codegen.generate`."""
    codegen.generate(codegen.parse_model(model) if isinstance(model, str) else model, folder, **options)
    return codegen.load(folder)


def solvers(
    tmp_path_factory: pytest.TempPathFactory, functions: Sequence[str] | None = None
) -> Callable[..., codegen.Solver]:
    """A function that returns the solver of a model for a target, with selected functions if any are given."""
    known: dict[Any, tuple[codegen.Solver, Any]] = {}

    def make(model: Any, target: str = "numpy") -> codegen.Solver:
        key = (model if isinstance(model, str) else id(model), target)
        if key not in known:
            folder = tmp_path_factory.mktemp("once") / "package"
            solver = made(model, folder, target=target, functions=functions, compile="all")
            known[key] = solver, model  # which keeps its id
        return known[key][0]

    return make
