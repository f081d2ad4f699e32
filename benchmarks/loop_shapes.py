"""What grows how: loops in a ladder, a star, a bundle and a grid, by their number.

python benchmarks/loop_shapes.py [--shapes STAR BUNDLE GRID LADDER] [--most 64]

In a **star** n legs of two rods hold a plate in its plane: all loops share the plate. In a **bundle** n struts, each a slider,
stand between the same two arms: all loops share both. A **grid** has n by n squares of pinned rods, and 2 n freedoms. CPU seconds
and memory of generation, without compiling, are those of a process of its own for each; operations are additions and
multiplications of udot and of one more direction, for every loop.
"""

from __future__ import annotations

import argparse
import math
import resource
import time
from concurrent.futures import BrokenExecutor, ProcessPoolExecutor
from multiprocessing import get_context
from typing import Any

import numpy as np

from codegen.measure.models import text_of
from codegen.measure.operations import of_manifest, plain, total
from codegen.measure.tables import markdown
from codegen.model import Model, ModelBuilder, parse_model
from codegen.pipeline import write_solver

INERTIA = {"xx": 0.01, "yy": 0.01, "zz": 0.01}


def _angle(x: float, z: float) -> float:
    """Of a rod along x that is turned about y to point at (x, z)."""
    return math.atan2(-z, x)


def star(n: int) -> Model:
    """A plate of radius 1 in the plane, held by n legs of two rods from a ring of radius 3."""
    b = ModelBuilder("star", gravity=[0, 0, -9.81])
    b.body("plate", joint="planar", normal="y", mass=2, inertia=INERTIA)
    q: dict[str, Any] = {"plate": [0.1, 0.2, 0.15]}  # along z and x, about y
    turn = np.array([[math.cos(0.15), math.sin(0.15)], [-math.sin(0.15), math.cos(0.15)]])  # of (x, z)
    for k in range(n):
        ring = np.array([math.cos(2 * math.pi * k / n), math.sin(2 * math.pi * k / n)])
        way = np.array([0.2, 0.1]) + turn @ ring - 3 * ring
        far = float(np.hypot(*way))
        inner = 2 * math.asin(far / 3)  # two rods of 1.5, bent to one side
        first = _angle(*way) - (math.pi - inner) / 2
        b.body(f"upper_{k}", axis="y", at=[3 * ring[0], 0, 3 * ring[1]], mass=1, com=[0.75, 0, 0], inertia=INERTIA)
        b.body(f"lower_{k}", f"upper_{k}", axis="y", at=[1.5, 0, 0], mass=1, com=[0.75, 0, 0], inertia=INERTIA)
        pin = {"body": "plate", "at": [ring[0], 0, ring[1]]}
        b.loop(f"pin_{k}", {"type": "inline", "axis": "y"}, start={"body": f"lower_{k}", "at": [1.5, 0, 0]}, end=pin)
        q[f"upper_{k}"], q[f"lower_{k}"] = first, math.pi - inner
    b.initial(q=q)
    return b.build()


def bundle(n: int) -> Model:
    """Two arms on the ground, and n struts between them that slide."""
    b = ModelBuilder("bundle", gravity=[0, 0, -9.81])
    b.body("left", axis="y", mass=1, com=[0, 0, 0.5], inertia=INERTIA)
    b.body("right", axis="y", at=[1.0, 0, 0], mass=1, com=[0, 0, 0.5], inertia=INERTIA)
    q = {"left": 0.0, "right": 0.2}
    for k in range(n):
        height = 0.2 + k / n
        end = np.array([1 + height * math.sin(0.2), height * math.cos(0.2)])
        way = end - [0, height]
        b.body(f"tube_{k}", "left", axis="y", at=[0, 0, height], mass=0.2, com=[0.2, 0, 0], inertia=INERTIA)
        b.body(f"rod_{k}", f"tube_{k}", "prismatic", axis="x", mass=0.2, com=[0.2, 0, 0], inertia=INERTIA)
        pin = {"body": "right", "at": [0, 0, height]}
        b.loop(f"pin_{k}", {"type": "inline", "axis": "y"}, start=f"rod_{k}", end=pin)
        q[f"tube_{k}"], q[f"rod_{k}"] = _angle(*way), float(np.hypot(*way))
    b.initial(q=q)
    return b.build()


def grid(n: int) -> Model:
    """n by n squares of rods of length 1, pinned at their corners, two of these on the ground."""
    b = ModelBuilder("grid", gravity=[0, 0, -9.81])
    rod = {"mass": 1, "inertia": INERTIA}

    def side(name: str, parent: str, along: str, first: bool) -> str:
        at = [0, 0, 0] if first else ([1, 0, 0] if parent.startswith("h") else [0, 0, 1])
        com = [0.5, 0, 0] if along == "h" else [0, 0, 0.5]
        return b.body(name, parent, axis="y", at=at, com=com, **rod)

    for j in range(1, n + 1):
        side(f"v_0_{j}", f"v_0_{j - 1}" if j > 1 else "ground", "v", j == 1)
    for j in range(n + 1):
        for i in range(1, n + 1):
            start = f"h_{i - 1}_{j}" if i > 1 else f"v_0_{j}" if j else "ground"
            side(f"h_{i}_{j}", start, "h", i == 1 and j == 0)
    for j in range(1, n + 1):
        for i in range(1, n + 1):
            side(f"v_{i}_{j}", f"h_{i}_{j - 1}", "v", False)
            ends = {"start": {"body": f"v_{i}_{j}", "at": [0, 0, 1]}, "end": {"body": f"h_{i}_{j}", "at": [1, 0, 0]}}
            b.loop(f"pin_{i}_{j}", {"type": "inline", "axis": "y"}, **ends)
    return b.build()


SHAPES = {"STAR": star, "BUNDLE": bundle, "GRID": grid, "LADDER": lambda n: parse_model(text_of("LADDER", n))}


def measured(shape: str, size: int) -> dict[str, float]:
    """In this process."""
    model = SHAPES[shape](size)
    before = time.process_time()
    source = write_solver(model)
    seconds = time.process_time() - before
    found = {
        "loops": len(model.loops),
        "seconds": seconds,
        "MB": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024,
    }
    udot, along = (of_manifest(source.manifest, f) for f in ("accelerations", "sensitivities"))
    return found | {"udot": plain(total(udot)), "direction": plain(total(along, "per_direction"))}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--shapes", nargs="*", default=list(SHAPES), choices=list(SHAPES))
    parser.add_argument("--most", type=int, default=64, help="loops, at most")
    arguments = parser.parse_args()
    rows = []
    for shape in arguments.shapes:
        sizes = [2, 4, 6, 8] if shape == "GRID" else [4, 16, 64, 256]
        for size in [s for s in sizes if (s * s if shape == "GRID" else s) <= arguments.most]:
            with ProcessPoolExecutor(1, get_context("spawn")) as pool:
                try:
                    r = pool.submit(measured, shape, size).result()
                except (MemoryError, BrokenExecutor, ValueError) as error:
                    rows.append([shape, size, "", "", "", "", str(error)[:60]])
                    continue
            each = [f"{r[k] / r['loops']:.0f}" for k in ("udot", "direction")]
            rows.append([shape, size, r["loops"], f"{r['seconds']:.2f}", f"{r['MB']:.0f}", *each])
    print(markdown(["", "size", "loops", "CPU s", "MB", "udot a loop", "a direction a loop"], rows))


if __name__ == "__main__":
    main()
