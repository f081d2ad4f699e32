"""Joint frames rotated about their own axes change the zero of the joint's angle, and add no constant rotation."""

from __future__ import annotations

from pathlib import Path

import mpmath
import numpy as np
import pytest
from comparison import compare

import codegen
from codegen.model import Model, parse_model
from codegen.pipeline import write_solver
from codegen.reference import DenseEngine, RecursiveEngine
from codegen.reference.engine import Engine

JOINTS = [
    "type: revolute, axis: y, at: [L, 0, 0.1], rpy: [0, 0.3, 0]",
    "type: revolute, axis: -z, at: [0.1, L, 0], rotate: [{axis: x, angle: 0.2}, {axis: z, angle: 0.7}]",
    "type: universal, axes: [x, y], at: [0.1, 0.2, 0], rpy: [1.2, 0, 0]",
    "type: cylindrical, axis: z, at: [0.1, 0.2, L], rotate: [{axis: x, angle: L}, {axis: -z, angle: 2}]",
    "type: screw, axis: [1, 2, 2], pitch: 0.1*L, at: [0.1, 0, 0], rotate: [{axis: [1, 2, 2], angle: -0.4}]",
    "type: revolute, axis: x, at: [0.1, 0, 0], rotate: [{axis: x, angle: L}]",
    "type: prismatic, axis: x, at: [0.1, 0, 0], rpy: [0.5, 0, 0]",
]
MASS = "mass: 1.5, com: [0.1, -0.2, L/3], inertia: {xx: 0.2, yy: 0.3, zz: 0.25, xy: 0.01}"


def chain(joints: list[str], more: str = "") -> Model:
    bodies = "".join(
        f"  b{k}: {{parent: {f'b{k - 1}' if k else 'ground'}, joint: {{{joint}}}, {MASS}}}\n"
        for k, joint in enumerate(joints)
    )
    return parse_model(
        f"model: m\ngravity: [0.3, 0.2, -9.81]\nparameters: {{L: 0.7}}\nbodies:\n{bodies}"
        f"outputs:\n  turned: {{rotation: b{len(joints) - 1}, entry: xy}}\n{more}"
    )


LONG = [JOINTS[0], JOINTS[1]] * 9
DRIVEN = "motion: {b0: 0.4*t + L}\n"
CASES = {
    "few": chain(JOINTS),
    "many": chain(LONG),
    "prescribed": chain(JOINTS[:3], DRIVEN),
    "many, one prescribed": chain(LONG, DRIVEN),
}


def operations(model: Model) -> int:
    manifest = write_solver(model, "unrolled").manifest
    counts = [manifest["operations"][s]["per_call"] for s in manifest["functions"]["accelerations"]["sweeps"]]
    return sum(c["additions"] + c["multiplications"] for c in counts)


def test_they_cost_one_addition() -> None:
    turned = ["type: revolute, axis: y, at: [0.3, 0, 0.1], rpy: [0, {}, 0]"] * 4
    straight, bent = (chain([j.format(angle) for j in turned]) for angle in ("0", "0.3"))
    assert operations(bent) == operations(straight) + 4


@pytest.mark.parametrize(
    ("target", "reference"), [("c", DenseEngine), ("numpy", DenseEngine), ("numpy", RecursiveEngine)]
)
@pytest.mark.parametrize("case", CASES)
def test_against_the_engines(tmp_path: Path, case: str, reference: type[Engine], target: str) -> None:
    model = CASES[case]
    layout = "kinds" if "many" in case else "unrolled"
    codegen.generate(model, tmp_path / "package", target=target, layout=layout, compile="all")
    found = compare(model, codegen.load(tmp_path / "package"), reference(model), np.random.default_rng(5))
    assert max(found.values()) < 1e-10, found


@pytest.mark.parametrize("case", ["few", "prescribed"])
def test_in_many_digits(tmp_path: Path, case: str) -> None:
    model = CASES[case]
    codegen.generate(model, tmp_path / "package", target="numpy", functions=("accelerations", "outputs"))
    solver = codegen.load(tmp_path / "package").in_precision(30, model)
    rng = np.random.default_rng(3)
    q, u = rng.normal(size=model.nq), rng.normal(size=model.nu)
    with mpmath.workdps(30):
        engine = DenseEngine(model, "mpmath")
        for name in ("accelerations", "outputs"):
            ours, theirs = (np.array(getattr(x, name)(q, u), object) for x in (solver, engine))
            assert abs(ours - theirs).max() < 1e-26 * abs(theirs).max(), name


def test_several_states_at_once(tmp_path: Path) -> None:
    for case in ("few", "many"):
        model = CASES[case]
        codegen.generate(model, tmp_path / case, functions=("accelerations",), compile="all")
        solver = codegen.load(tmp_path / case)
        rng = np.random.default_rng(4)
        q, u = rng.normal(size=(9, model.nq)), rng.normal(size=(9, model.nu))
        single = np.array([solver.accelerations(*state) for state in zip(q, u, strict=True)])
        together = solver.accelerations(q, u)
        assert np.abs(together - single).max() < 1e-10 * np.abs(single).max()
