"""LADDER(L), HOOKE(L), PINNED(n) and CLOSED(n) for the benchmarks: the examples at other sizes, states, seeds, functions.

Coordinates are closed to rounding; dependent speeds need not be, since every function solves for them.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from chains import c_files, chain_state
from ctiming import Contestant

from codegen.loops import initial_configuration
from codegen.model import Model, parse_model
from codegen.pipeline import Source, write_solver

EXAMPLES = Path(__file__).parents[1] / "examples"


def example_text(name: str, old: str, new: str) -> str:
    """An example with other constants."""
    path = EXAMPLES / f"{name}.yaml"
    text = path.read_text()
    if text.count(old) != 1:
        raise ValueError(f"{path} does not say {old!r} once, as this script expects")
    return text.replace(old, new)


def ladder_text(loops: int) -> str:
    return example_text("ladder", "{L: 3,", f"{{L: {loops},")


def hooke_text(loops: int) -> str:
    return example_text("hooke_ladder", "{L: 3,", f"{{L: {loops},")


def closed_text(n: int) -> str:
    """The paper's closed chain; 8 divides n."""
    return example_text("closed_chain", "{n: 16,", f"{{n: {n},")


def pinned_text(n: int) -> str:
    text = example_text("pinned_chain", "{n: 12,", f"{{n: {n},")
    old = text[text.index("x: -2.14") : text.index("}", text.index("x: -2.14"))]
    x, y, z = map(float, chain_tip(chain_state(n)[0]))
    return text.replace(old, f"x: {x!r}, y: {y!r}, z: {z!r}")


def chain_tip(q: np.ndarray, length: float = 1.0) -> np.ndarray:
    """Where the end of CHAIN(n) is."""
    R, place = np.eye(3), np.zeros(3)
    for k, (c, s) in enumerate(zip(np.cos(q), np.sin(q), strict=True)):
        turn = [[1, 0, 0], [0, c, -s], [0, s, c]] if k % 2 else [[c, 0, s], [0, 1, 0], [-s, 0, c]]
        R = R @ np.array(turn)
        place = place - length * R[:, 2]
    return place


TEXTS = {"LADDER": ladder_text, "HOOKE": hooke_text, "PINNED": pinned_text, "CLOSED": closed_text}


@dataclass(frozen=True)
class Mechanism:
    """One of them at one size.

    Attributes
    ----------
    name : str
        LADDER, HOOKE, PINNED or CLOSED.
    size : int
        Loops of a ladder, rods of a chain.
    model : Model
    state : tuple of arrays
        q and u, (nu,) each.
    """

    name: str
    size: int
    model: Model
    state: tuple[np.ndarray, np.ndarray]

    @property
    def bodies(self) -> int:
        return len(self.model.bodies)


def mechanism(name: str, size: int) -> Mechanism:
    model = parse_model(TEXTS[name](size), f"{name}({size})")
    return Mechanism(name, size, model, initial_configuration(model))


def seeds(m: Mechanism, width: int = 8) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """dq, du (width, nu) and dlen (width, 1), nothing in them zero; entries of dependent coordinates are not read."""
    k, j = np.arange(1, m.model.nu + 1), np.arange(width)[:, None]
    dq, du = 0.1 * np.sin(2.0 * k + 0.7 * j), 0.1 * np.cos(3.0 * k + 0.5 * j)
    return dq, du, 1.0 + 0.1 * np.arange(width)[:, None]


def source_of(m: Mechanism, layout: str = "auto", functions: Collection[str] | None = None) -> Source:
    return write_solver(m.model, layout, functions=functions)


def accelerations(m: Mechanism, source: Source, name: str = "udot") -> Contestant:
    """udot; the result is array 3."""
    package = m.model.name
    arrays = [*m.state, np.ones(1), np.zeros(m.model.nu), np.zeros(source.manifest["workspace"])]
    call = f"{package}_accelerations(a[0], a[1], a[2], a[3], a[4])"
    return Contestant(name, c_files(source), f'#include "{package}.h"', call, arrays)


def sensitivities(m: Mechanism, source: Source, width: int, name: str = "") -> Contestant:
    """udot and its derivatives along `width` directions; the results are arrays 6 and 7, the latter (nu, width)."""
    package, n = m.model.name, m.model.nu
    directions = [np.ascontiguousarray(seed.T) for seed in seeds(m, width)]
    workspace = np.zeros(source.manifest["workspace"])
    arrays = [*m.state, np.ones(1), *directions, np.zeros(n), np.zeros((n, width)), workspace]
    call = f"{package}_sensitivities_{width}(a[0], a[1], a[2], a[3], a[4], a[5], a[6], a[7], a[8])"
    return Contestant(name or f"udot + {width}", c_files(source), f'#include "{package}.h"', call, arrays)
