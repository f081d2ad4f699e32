"""fmuloader, an independent binding of every function of both versions, simulates FMUs with the solver's results."""

import zipfile
from pathlib import Path

import numpy as np
import pytest

import codegen

pytest.importorskip("fmuloader", reason="needs fmuloader (pip install --pre fmuloader)")

FOUR_BAR = Path(__file__).parents[3] / "examples" / "four_bar.yaml"


@pytest.fixture(scope="module")
def motion(tmp_path_factory):
    folder = tmp_path_factory.mktemp("solver")
    codegen.generate(FOUR_BAR, folder / "four_bar", functions="simulate,outputs", check=False)
    return codegen.load(folder / "four_bar").simulate(np.linspace(0.0, 0.5, 6))


def token_of(file):
    with zipfile.ZipFile(file) as archive:
        text = archive.read("modelDescription.xml").decode()
    return next(
        text.partition(f'{word}="')[2].partition('"')[0]
        for word in ("instantiationToken", "guid")
        if f"{word}=" in text
    )


def test_fmi_2_and_3(motion, tmp_path):
    from fmuloader import fmi2, fmi3

    for version in ("2.0", "3.0"):
        found = codegen.export_fmu(FOUR_BAR, tmp_path / f"{version}.fmu", fmi=version)
        if version == "2.0":
            of = fmi2.Fmi2Slave(found.file, model_identifier="four_bar")
            of.instantiate("unit", fmi2.Fmi2Type.CO_SIMULATION, guid=token_of(found.file))
            of.setup_experiment(start_time=0.0)
            get = of.get_real
        else:
            of = fmi3.Fmi3Slave(found.file, model_identifier="four_bar")
            of.instantiate_co_simulation("unit", instantiation_token=token_of(found.file))
            get = of.get_float64
        of.enter_initialization_mode()
        of.exit_initialization_mode()
        for n in range(5):
            assert np.abs(np.array(get([1, 2, 3])) - motion.q[n]).max() <= 1e-8
            of.do_step(0.1 * n, 0.1)
        outputs = [found.variables.index(n) for n in ("trace_x", "swing")]
        assert np.abs(np.array(get(outputs)) - motion.outputs[-1][[0, 2]]).max() <= 1e-8
        of.terminate()
        of.free_instance()
