"""The source code in an FMU can be built by the importer's own tools, and computes the same numbers."""

import shutil
from pathlib import Path

import numpy as np
import pytest

import codegen

pytest.importorskip("fmpy", reason="needs the extra fmi")

import fmpy
from fmpy.build import build_platform_binary

BOUNCER = Path(__file__).with_name("bouncer.yaml")


@pytest.mark.parametrize("version", ["3.0", "2.0"])
def test_fmpy_builds_a_binary_from_the_source_code(version, tmp_path):
    if shutil.which("cmake") is None:
        pytest.skip("needs cmake")
    results = []
    for way, platforms in (("ours", None), ("theirs", "none")):
        file = tmp_path / f"{way}.fmu"
        codegen.export_fmu(BOUNCER, file, fmi=version, platforms=platforms)
        folder = fmpy.extract(str(file), str(tmp_path / way))
        if platforms:
            build_platform_binary(folder, configuration="Debug")
        results.append(fmpy.simulate_fmu(folder, fmi_type="CoSimulation", stop_time=1.0, output_interval=0.1))
    assert len(results[0]) == 11
    for name in ("height", "kinetic"):
        assert np.abs(results[0][name] - results[1][name]).max() <= 1e-8
