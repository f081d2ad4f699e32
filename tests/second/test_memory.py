"""Products with second derivatives read no memory of a call that they have not written: the memory is full of NaN before."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from painted_memory import filled
from prescribed_models import with_prescribed_at
from random_models import random_seeds
from second_derivatives import (
    EXAMPLES,
    every_output_of_a_mechanism,
    every_output_of_a_tree,
    observed_mechanism,
    observed_tree,
)

import codegen
from codegen.runtime.standalone.calls.arguments import Seeds

PRODUCTS = (
    "hessian_products", "output_hessian_products", "energy_hessian_products", "inverse_dynamics_hessian_products",
)  # fmt: skip
OF_KINEMATICS = ("coordinate_rate_hessian_products", "assemble_hessian_products")


def check(model: Any, state: Any, functions: tuple[str, ...], folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Compare C with NumPy."""
    codegen.generate(model, folder / "package", functions=",".join(("accelerations", *functions)))
    in_c, in_numpy = (codegen.load(folder / "package", target=t)._opened for t in ("c", "numpy"))
    rng = np.random.default_rng(4)
    arrays = dict(zip(("q", "u", "p", "inputs", "t"), state, strict=True))
    arrays |= {n: rng.normal(size=model.nu) for n in ("udot", "b", "force_weights")}
    arrays |= {
        "rate_weights": rng.normal(size=model.nq),
        "q_weights": rng.normal(size=model.nq),
        "u_weights": arrays["b"],
    }
    arrays |= {"output_weights": rng.normal(size=len(model.outputs)), "energy_weights": rng.normal(size=2)}
    seeds = random_seeds(rng, model, 8) | {"dudot": rng.normal(size=(8, model.nu))}
    seeds["dt"] = seeds["dt"].reshape(8, 1)
    for name in functions:
        f = in_c.functions[name]
        along = Seeds({n: seeds[n] for n in f.seeds}, 8)
        expected = in_numpy.target.compute(f, arrays, (), along)
        with monkeypatch.context() as patched:
            painted = filled(patched)
            found = in_c.target.compute(f, arrays, (), along)
        assert in_c.manifest["workspace"] in painted or name != functions[0]
        largest = max(np.abs(x).max(initial=0) for x in expected)
        assert largest > 0
        for x, y in zip(found, expected, strict=True):
            assert np.abs(x - y).max(initial=0) < 1e-11 * largest, name


@pytest.mark.parametrize("functions", [PRODUCTS[:1], PRODUCTS[3:], PRODUCTS], ids=["forward", "inverse", "all"])
@pytest.mark.parametrize("seed", (0, 2))
def test_trees(seed: int, functions: tuple[str, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The products of one function alone assign first contributions; those of several functions add to zeros."""
    model, state = observed_tree(seed)
    check(model, state, functions, tmp_path, monkeypatch)


def test_loops(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    model, state = observed_mechanism(25, scene="spatial", bodies=(2, 4), loops=(1, 2))
    check(model, state, (*PRODUCTS, *OF_KINEMATICS), tmp_path, monkeypatch)


@pytest.mark.parametrize("loops", [False, True], ids=["tree", "loops"])
def test_outputs_of_accelerations_and_driving_forces(
    loops: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    options: dict[str, Any] = {"scene": "spatial", "bodies": (2, 4), "loops": (1, 2), "more": with_prescribed_at}
    model, state = every_output_of_a_mechanism(4, **options) if loops else every_output_of_a_tree(2)
    check(model, state, PRODUCTS[:2], tmp_path, monkeypatch)


def test_neighbours_exchange_in_scratch_memory(tmp_path: Path) -> None:
    """Along a chain only the adjoints of forces outlive their sweep: they need memory for every link."""
    codegen.generate(
        EXAMPLES / "chain.yaml", tmp_path, functions="accelerations,hessian_products", check=False, compile=False
    )
    (text,) = (path.read_text() for path in tmp_path.glob("*_directions.h"))
    for name in ("link_adjoint_tangents", "link_mass_tangents"):
        start = text.rindex("typedef struct {", 0, text.index(f" DIRECTIONS({name});"))
        members = set(re.findall(r"\w+_[xyz]\b", text[start : text.index(f" DIRECTIONS({name});")]))
        assert members <= {f"transmitted_{n}_{axis}" for n in ("moment", "force") for axis in "xyz"} | {
            f"total_{n}_{axis}" for n in ("moment", "force") for axis in "xyz"
        }, name
        assert len(members) == 6
