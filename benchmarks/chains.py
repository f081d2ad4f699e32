"""CHAIN(n) for the benchmarks: the example with another n, its usual state and seeds, and its functions as contestants."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from ctiming import Contestant

from codegen.model import Model, parse_model
from codegen.pipeline import Source, write_solver

FILE = Path(__file__).parents[1] / "examples" / "chain.yaml"


def chain_text(n: int) -> str:
    """examples/chain.yaml with another number of rods."""
    text = FILE.read_text()
    if text.count("{n: 12,") != 1:
        raise ValueError(f"{FILE} does not say how many rods there are where this script expects it")
    return text.replace("{n: 12,", f"{{n: {n},")


def chain_model(n: int) -> Model:
    return parse_model(chain_text(n), f"CHAIN({n})")


def chain_state(n: int) -> tuple[np.ndarray, np.ndarray]:
    """q_k = 0.3 sin k and u_k = 0.2 cos k, k from 1."""
    k = np.arange(1, n + 1)
    return 0.3 * np.sin(k), 0.2 * np.cos(k)


def chain_seeds(n: int, width: int = 8) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """dq (width, n), du (width, n) and dL (width, 1), nothing in them zero; the first direction is the usual one."""
    k, j = np.arange(1, n + 1), np.arange(width)[:, None]
    dq, du = 0.1 * np.sin(2.0 * k + 0.7 * j), 0.1 * np.cos(3.0 * k + 0.5 * j)
    return dq, du, 1.0 + 0.1 * np.arange(width)[:, None]


def c_files(source: Source) -> dict[str, str]:
    """What a C program needs: without what only calls from Python and integration over time need."""
    apart = ("_calls.c", "_motion.c", "_precise.c", "_four.c", "_states.c", "_threads.c")
    return {
        name: text for name, text in source.files.items() if name.endswith((".c", ".h")) and not name.endswith(apart)
    }


def accelerations(source: Source, n: int, name: str = "udot") -> Contestant:
    """udot of CHAIN(n); the result is array 3."""
    arrays = [*chain_state(n), np.ones(1), np.zeros(n), np.zeros(source.manifest["workspace"])]
    call = "chain_accelerations(a[0], a[1], a[2], a[3], a[4])"
    return Contestant(name, c_files(source), '#include "chain.h"', call, arrays)


def sensitivities(source: Source, n: int, width: int, name: str = "") -> Contestant:
    """udot of CHAIN(n) and its derivatives along `width` directions; the results are arrays 6 and 7."""
    seeds = [np.ascontiguousarray(seed.T) for seed in chain_seeds(n, width)]
    workspace = np.zeros(source.manifest["workspace"])
    arrays = [*chain_state(n), np.ones(1), *seeds, np.zeros(n), np.zeros((n, width)), workspace]
    call = f"chain_sensitivities_{width}(a[0], a[1], a[2], a[3], a[4], a[5], a[6], a[7], a[8])"
    return Contestant(name or f"udot + {width}", c_files(source), '#include "chain.h"', call, arrays)


def chain_source(n: int, layout: str = "auto") -> Source:
    return write_solver(chain_model(n), layout)
