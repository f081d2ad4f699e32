"""Shipped models of any size, from ``examples/`` of a checkout or from the wheel, with states and directions."""

from __future__ import annotations

import re
from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..loops import initial_configuration
from ..model import Model, parse_model
from ..pipeline import Source, write_solver

Array = NDArray[np.float64]


def example(name: str) -> str:
    """The text of the model file of a shipped model."""
    package = Path(__file__).resolve().parents[1]
    places = [package / "examples", package.parent / "examples"]
    found = next((file for folder in places if (file := folder / f"{name}.yaml").is_file()), None)
    if found is None:
        raise FileNotFoundError(2, "this installation lacks a model of the benchmark", f"{name}.yaml")
    return found.read_text(encoding="utf-8")


def changed(name: str, old: str, new: str) -> str:
    """The text of a shipped model in which one piece of text, which must occur exactly once, is replaced."""
    text = example(name)
    if text.count(old) != 1:
        raise ValueError(f"{name}.yaml does not contain {old!r} exactly once, as the benchmark expects")
    return text.replace(old, new)


SIZES = {
    "CHAIN": ("chain", "{n: 12,"), "LADDER": ("ladder", "{L: 3,"), "HOOKE": ("hooke_ladder", "{L: 3,"),
    "PINNED": ("pinned_chain", "{n: 12,"), "CLOSED": ("closed_chain", "{n: 16,"),
}  # fmt: skip
"""Models of any size, with the text to replace: number of rods of a chain (a multiple of 8 for CLOSED) or loops of a ladder."""


def text_of(name: str, size: int) -> str:
    """The text of one of the models in `SIZES`, with a given size."""
    file, old = SIZES[name]
    text = changed(file, old, re.sub(r"\d+", str(size), old))
    if name != "PINNED":
        return text
    x, y, z = map(float, chain_tip(chain_state(size)[0]))
    return re.sub(r"x: -2\.14[^}]*", f"x: {x!r}, y: {y!r}, z: {z!r}", text)


def chain_state(n: int) -> tuple[Array, Array]:
    """The state q_k = 0.3 sin k and u_k = 0.2 cos k, where k begins with 1."""
    k = np.arange(1, n + 1)
    return 0.3 * np.sin(k), 0.2 * np.cos(k)


def chain_tip(q: Array) -> Array:
    """Position of the end of CHAIN(n), m."""
    R, place = np.eye(3), np.zeros(3)
    for k, (c, s) in enumerate(zip(np.cos(q), np.sin(q), strict=True)):
        R = R @ np.array([[1, 0, 0], [0, c, -s], [0, s, c]] if k % 2 else [[c, 0, s], [0, 1, 0], [-s, 0, c]])
        place = place - R[:, 2]
    return place


def seeds(n: int, width: int = 8) -> tuple[Array, Array, Array]:
    """Seeds dq and du (width, n), and seeds of the parameter (width, 1), all of them nonzero."""
    k, j = np.arange(1, n + 1), np.arange(width)[:, None]
    dq: Array = 0.1 * np.sin(2.0 * k + 0.7 * j)
    du: Array = 0.1 * np.cos(3.0 * k + 0.5 * j)
    dp: Array = 1.0 + 0.1 * j.astype(float)
    return dq, du, dp


@dataclass(frozen=True)
class Sized:
    """A model of a given size, with loops closed to rounding; dependent speeds need not be consistent, since functions
    compute these.

    Attributes
    ----------
    name : str
        A key of `SIZES`.
    size : int
    model : Model
    q, u : (nq,), (nu,)
    """

    name: str
    size: int
    model: Model
    q: Array
    u: Array

    def __str__(self) -> str:
        return f"{self.name}({self.size})"

    @property
    def bodies(self) -> int:
        return len(self.model.bodies)

    def given(self, width: int = 0) -> dict[str, Array]:
        """State and parameters by name, and seeds of `width` directions."""
        found = {"q": self.q, "u": self.u, "p": np.array(list(self.model.defaults.values()), float)}
        return found | dict(zip(("dq", "du", "dp"), seeds(self.model.nu, width), strict=True)) if width else found

    def source(self, layout: str = "auto", functions: Collection[str] | None = None) -> Source:
        """The generated source of the model's solver."""
        return write_solver(self.model, layout, functions=functions)


def sized(name: str, size: int) -> Sized:
    """One of the models in `SIZES` with a given size, in its standard state."""
    model: Any = parse_model(text_of(name, size), f"{name}({size})")
    return Sized(name, size, model, *(chain_state(size) if name == "CHAIN" else initial_configuration(model)))
