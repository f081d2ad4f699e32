"""Sweeps that are printed as one function give the results of the functions of their links, with no more operations."""

from __future__ import annotations

from functools import reduce
from itertools import chain
from operator import add
from pathlib import Path

import numpy as np
import pytest
from random_models import random_seeds, random_state, random_tree

import codegen
from codegen.mechanics import merging
from codegen.mechanics.merging import with_merged_sweeps
from codegen.mechanics.statements import expanded, laid_out
from codegen.model.model import Model
from codegen.program.operations import count

EXAMPLES = Path(__file__).parents[2] / "examples"
FUNCTIONS = ["accelerations", "sensitivities", "gradients", "energies", "energy_sensitivities", "energy_gradients"]


def model_of(which: str | int) -> Model:
    """An example by its name, or a random tree by its seed."""
    if isinstance(which, str):
        return codegen.load_model(EXAMPLES / f"{which}.yaml")
    return random_tree(np.random.default_rng(which), 4)


@pytest.mark.parametrize("which", ["double_pendulum", "four_bar", 3])
def test_results_are_those_of_the_links(which: str | int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ORDERNM_CFLAGS", "-O0 -ffp-contract=off")
    model, rng = model_of(which), np.random.default_rng(0)
    for limit, folder in ((10**6, "merged"), (0, "links")):
        monkeypatch.setattr(merging, "LONGEST", limit)
        monkeypatch.setattr(merging, "LONGEST_ALONG", limit)
        codegen.generate(model, tmp_path / folder, layout="unrolled", compile=False, check=False, functions=FUNCTIONS)
    merged, links = codegen.load(tmp_path / "merged"), codegen.load(tmp_path / "links")
    at = random_state(rng, model)
    state = dict(zip("qu", links.initial, strict=True)) if model.loops else at._asdict()
    seeds = {name: seed for name, seed in random_seeds(rng, model, 3).items() if name in ("dq", "du", "dp")}
    for name in FUNCTIONS:
        more = seeds if name.endswith("sensitivities") else {}
        if name.endswith("gradients"):
            more = {"weights": np.ones(model.nu if name == "gradients" else 2)}
        found, expected = (np.hstack([np.ravel(x) for x in getattr(s, name)(**state, **more)]) for s in (merged, links))
        np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-12 * np.abs(expected).max(initial=0.0))


@pytest.mark.parametrize("which", ["double_pendulum", "four_bar", "arm", "satellite", 3, 8])
def test_operations_are_no_more(which: str | int) -> None:
    system, _ = laid_out(model_of(which), "unrolled", None, turning=True)
    program, plan, _ = expanded(system, False)
    sweeps = with_merged_sweeps(program, plan.formulas).sweeps
    both = [
        tuple(
            reduce(add, chain.from_iterable(map(count, blocks))) for blocks in ([of.merged.block], of.blocks.values())
        )
        for of in sweeps.values()
        if of.merged is not None
    ]
    assert len(both) > len(sweeps) / 3
    for merged, links in both:
        assert merged.flops <= links.flops and merged.functions <= links.functions
