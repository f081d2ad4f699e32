"""Solvers that tests integrate, each generated once in a run."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest
from motion.models import FALLING, Made, example, mechanism, parsed, tree

import codegen

MOVING = ("motion", "energies")


@pytest.fixture(scope="session")
def made(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., Made]:
    """Generate a model of `motion.models` from the function that makes it and its arguments: ``made(tree, 3)``."""
    known: dict[Any, Made] = {}

    def make(draw: Callable[..., Any], *arguments: Any, **options: Any) -> Made:
        key = (draw, *arguments, *options.items())
        if key not in known:
            model, q, p = draw(*arguments)
            folder = tmp_path_factory.mktemp("motion") / model.name
            wanted = {"functions": MOVING, "compile": "all"} | options  # in one go: most of it is called
            codegen.generate(model, folder, **wanted)
            known[key] = Made(codegen.load(folder), model, q, p)
        return known[key]

    return make


@pytest.fixture(scope="session")
def falling(made: Callable[..., Made]) -> Any:
    """A falling stone, whose motion is known in closed form."""
    return made(parsed, FALLING).solver


@pytest.fixture(scope="session")
def four_bar(made: Callable[..., Made]) -> Any:
    return made(example, "four_bar").solver


__all__ = ["mechanism", "tree"]
