"""Solvers of model texts, or of models, each generated once."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import pytest

import codegen


def solvers(
    tmp_path_factory: pytest.TempPathFactory, functions: Sequence[str] | None = None
) -> Callable[..., codegen.Solver]:
    """A function of a model and a target that gives its solver, of chosen functions if there are any."""
    known: dict[Any, tuple[codegen.Solver, Any]] = {}

    def make(model: Any, target: str = "numpy") -> codegen.Solver:
        key = (model if isinstance(model, str) else id(model), target)
        if key not in known:
            folder = tmp_path_factory.mktemp("once") / "package"
            read = codegen.parse_model(model) if isinstance(model, str) else model
            codegen.generate(read, folder, target=target, functions=functions)
            known[key] = codegen.load(folder), model  # which keeps its id
        return known[key][0]

    return make
