"""Binaries for five platforms from one machine; those for Linux run, on other processors under qemu."""

import platform
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest

import codegen
from codegen.exporting.fmu.binaries import PLATFORMS
from codegen.runtime.standalone.errors import NoCompilerError

EXAMPLES = Path(__file__).parents[3] / "examples"
HOST = Path(__file__).with_name("host.c")

MAGIC = {
    "x86_64-linux": (b"\x7fELF\x02", b"\x3e\x00", 18), "aarch64-linux": (b"\x7fELF\x02", b"\xb7\x00", 18),
    "x86_64-windows": (b"MZ", b"", 0), "x86_64-darwin": (b"\xcf\xfa\xed\xfe", b"\x07\x00\x00\x01", 4),
    "aarch64-darwin": (b"\xcf\xfa\xed\xfe", b"\x0c\x00\x00\x01", 4),
}  # fmt: skip
"""First bytes of a library; the bytes for the processor, and their place."""

EMULATORS = {"x86_64-linux": (), "aarch64-linux": ("qemu-aarch64", "-L", "/usr/aarch64-linux-gnu")}


@pytest.mark.campaign
def test_one_machine_builds_for_five_platforms(tmp_path, monkeypatch):
    pytest.importorskip("ziglang", reason="needs the extra fmi")
    monkeypatch.setenv("ORDERNM_CFLAGS", "-O1")
    model = EXAMPLES / "four_bar.yaml"
    found = codegen.export_fmu(model, tmp_path / "all.fmu", platforms="all")
    assert found.platforms == tuple(PLATFORMS)
    with zipfile.ZipFile(found.file) as archive:
        archive.extractall(tmp_path)
    for name, about in PLATFORMS.items():
        start, processor, place = MAGIC[name]
        content = (tmp_path / "binaries" / name / f"four_bar{about.ending}").read_bytes()
        assert content.startswith(start) and content[place : place + len(processor)] == processor
        assert b"fmi3GetAdjointDerivative" in content and len(content) > 100_000
    of_two = codegen.export_fmu(model, tmp_path / "two.fmu", fmi="2.0", platforms="all")
    assert of_two.platforms == ("x86_64-linux", "x86_64-windows", "x86_64-darwin")
    codegen.generate(model, tmp_path / "solver", functions="simulate,outputs", check=False)
    solver = codegen.load(tmp_path / "solver")
    motion = solver.simulate(np.array([0.0, 0.5]))
    wanted = np.concatenate([[0.5], motion.q[-1], motion.u[-1]])
    token = (tmp_path / "modelDescription.xml").read_text().partition('instantiationToken="')[2].partition('"')[0]
    values = []
    for name, emulator in EMULATORS.items():
        if emulator and shutil.which(emulator[0]) is None:
            continue
        if not emulator and platform.machine() != "x86_64":
            continue
        target = PLATFORMS[name].zig
        host = tmp_path / f"host_{name}"
        subprocess.run(
            [sys.executable, "-m", "ziglang", "cc", "-target", target, str(HOST), "-o", str(host), "-ldl"], check=True
        )
        library = tmp_path / "binaries" / name / "four_bar.so"
        line = [*emulator, str(host), str(library), token, "5", "0.1", str(len(found.variables))]
        done = subprocess.run(line, capture_output=True, text=True, check=True)
        values.append(np.array(done.stdout.split(), float))
        assert np.abs(values[-1][:7] - wanted).max() <= 1e-7, name
    assert values
    assert all((x == values[0]).all() for x in values)  # processors compute the same numbers


def test_without_zig_other_platforms_say_what_to_install(tmp_path, monkeypatch):
    monkeypatch.setattr("codegen.exporting.fmu.binaries.importlib.util.find_spec", lambda name: None)
    monkeypatch.setattr("codegen.exporting.fmu.binaries.this_platform", lambda: "none")
    with pytest.raises(NoCompilerError, match=r"binaries for aarch64-darwin need zig: pip install 'ordernm\[fmi\]'"):
        codegen.export_fmu(EXAMPLES / "pendulum.yaml", tmp_path / "x.fmu", platforms=["aarch64-darwin"])
    assert not list(tmp_path.iterdir())
