"""Two to four directions are integrated in four lanes, with the results of eight lanes."""

from __future__ import annotations

import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from motion.models import Made, example

import codegen
from codegen.runtime.standalone.files.build import Build
from codegen.runtime.standalone.files.compiler import find_compiler
from codegen.runtime.standalone.motion import run as motion_run

TIMES = np.linspace(0.0, 1.5, 7)


@pytest.mark.parametrize("name", ["four_bar", "double_pendulum"])
@pytest.mark.parametrize("k", [2, 4])
def test_four_lanes_give_what_eight_give(
    made: Callable[..., Made], name: str, k: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    solver = made(example, name).solver
    asked: list[int] = []
    address = motion_run._four

    def four(opened: Any) -> int:
        asked.append(address(opened))
        return asked[-1]

    names = (
        *(f"u0.{n}" for n in solver.independent_speed_names),
        *solver.parameter_names,
        *(f"q0.{n}" for n in solver.independent_names),
    )[:k]
    options = {"sensitivities": names, "atol_sensitivities": 1e-9}
    monkeypatch.setattr(motion_run, "_four", four)
    found = solver.simulate(TIMES, **options)
    assert len(asked) == 1 and asked[0]
    monkeypatch.setattr(motion_run, "_four", lambda opened: 0)
    expected = solver.simulate(TIMES, **options)
    assert found.stats["evaluations"] == expected.stats["evaluations"]
    for part in ("q", "u", "dq", "du", "outputs", "doutputs"):
        x, y = getattr(found, part), getattr(expected, part)
        np.testing.assert_allclose(x, y, rtol=0, atol=1e-12 * np.abs(y).max(initial=1.0))


def test_others_do_without(made: Callable[..., Made], monkeypatch: pytest.MonkeyPatch) -> None:
    solver = made(example, "double_pendulum").solver

    def four(opened: Any) -> int:
        raise AssertionError("not wanted")

    monkeypatch.setattr(motion_run, "_four", four)
    names = (*solver.parameter_names, *(f"{x}0.{n}" for x in "qu" for n in solver.independent_names))
    for wanted in ((), names[:1], names[:5]):
        solver.simulate(0.1, sensitivities=wanted)
    solver.simulate(0.1, sensitivities=names[:3], method="radau")


def test_a_compiler_that_fails_leaves_eight(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = tmp_path / "double_pendulum"
    codegen.generate(
        Path(__file__).parents[2] / "examples" / "double_pendulum.yaml", folder, check=False, functions=("simulate",)
    )
    solver = codegen.load(folder)
    solver.simulate(0.1)
    monkeypatch.setenv("CC", "no-such-compiler")
    with pytest.warns(RuntimeWarning, match="two to four directions take as long as with eight: no C compiler found"):
        found = solver.simulate(0.1, sensitivities=solver.parameter_names[:2])
    assert np.isfinite(found.dq).all()


def test_it_compiles_without_warnings_and_its_key_knows_what_it_includes(
    made: Callable[..., Made], tmp_path: Path
) -> None:
    folder = made(example, "four_bar").solver.folder
    command = [
        *find_compiler(),
        "-std=gnu11",
        "-Wall",
        "-Wextra",
        "-Werror",
        "-O1",
        "-c",
        "-o",
        str(tmp_path / "four.o"),
    ]
    said = subprocess.run([*command, str(folder / "four_bar_four.c")], capture_output=True, text=True, check=False)
    assert not said.returncode, said.stderr[:2000]
    copy = Path(shutil.copytree(folder, tmp_path / "copy"))
    arguments = (copy, "four_bar_four", ["four_bar_four.c"], ["four_bar.c"])
    before = Build(*arguments).key()
    (copy / "four_bar.c").write_text("/* another one */\n" + (copy / "four_bar.c").read_text())
    assert Build(*arguments).key() != before
