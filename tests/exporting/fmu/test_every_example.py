"""FMUs of every example are valid in both versions; in the campaign, their motions are those of the solver."""

from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("fmpy", reason="needs the extra fmi")

import fmpy
from fmpy.validation import validate_fmu

import codegen

EXAMPLES = Path(__file__).parents[3] / "examples"
MODELS = sorted([*EXAMPLES.glob("*.yaml"), *EXAMPLES.glob("gallery/*.yaml")])

STOPS = {"andrews": 0.03}
"""End of motions that are short, s."""


def short(path):
    return path.stem


def test_there_are_many_examples():
    assert len(MODELS) > 30


@pytest.mark.parametrize("version", ["3.0", "2.0"])
@pytest.mark.parametrize("model", MODELS, ids=short)
def test_validation_has_no_remark(model, version, tmp_path):
    file = tmp_path / "unit.fmu"
    codegen.export_fmu(model, file, fmi=version, platforms="none")
    assert validate_fmu(str(file)) == []


@pytest.mark.campaign
@pytest.mark.parametrize("model", MODELS, ids=short)
def test_it_moves_as_simulate_does(model, tmp_path):
    codegen.generate(model, tmp_path / "solver", functions="simulate,outputs", check=False)
    solver = codegen.load(tmp_path / "solver")
    stop = STOPS.get(model.stem, 0.2)
    times = np.linspace(0.0, stop, 5)
    motion = solver.simulate(times, rtol=1e-12, atol=1e-12)
    wanted = {f"q.{n}": motion.q[:, i] for i, n in enumerate(solver.coordinate_names)}
    wanted |= {f"u.{n}": motion.u[:, i] for i, n in enumerate(solver.speed_names)}
    wanted |= {n: motion.outputs[:, i] for i, n in enumerate(solver.output_names)}
    sizes = {n: 1.0 + np.abs(x).max() for n, x in wanted.items()}
    for version, kinds in (("3.0", ("CoSimulation", "ModelExchange")), ("2.0", ("CoSimulation",))):
        file = tmp_path / f"unit_{version}.fmu"
        codegen.export_fmu(model, file, fmi=version)
        for kind in kinds:
            found = fmpy.simulate_fmu(
                str(file), fmi_type=kind, stop_time=stop, output=list(wanted),
                output_interval=stop / (4 if kind == "CoSimulation" else 400),  # CVode takes at most 500 steps in an interval
                relative_tolerance=1e-11 if kind == "CoSimulation" else 1e-10,
            )  # fmt: skip
            rows = [np.flatnonzero(np.abs(found["time"] - t) < 1e-9)[-1] for t in times]
            errors = {n: np.abs(found[n][rows] - x).max() / sizes[n] for n, x in wanted.items()}
            worst = max(errors, key=errors.__getitem__)
            print(f"{model.stem} {version} {kind}: {errors[worst]:.1e} in {worst}")
            assert errors[worst] <= (1e-8 if kind == "CoSimulation" else 1e-6)
